"""The panels beneath a dynamic fit: where it is worst, an edge, other channels, the law inside."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..experiment import FloatArray
from ..families import get_family
from ..family import PhysicsView, Simulated
from ..outcome import Outcome, Simulation
from ..parameter_table import recorded_units
from ..rows import blocks
from . import style
from .numbers import Scale, choose_scale, plain, scale_of, scaled, spoken
from .panels import draw_curves
from .runs import drive_role, envelope, instants, is_too_long, subset, worst_residual

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHARE = 0.06  # of a run that a close-up shows
_FEWEST = 40  # samples that it shows at least
_BEFORE = 0.25  # share of a close-up before its edge
_MOST_POINTS = 6000
Draw = Callable[["Axes"], None]


@dataclass(frozen=True)
class _Closeup:
    """Part of a run: its bounds [s], what it is, and the instant [s] that it is about."""

    run: Simulation
    low: float
    high: float
    title: str
    at: float | None = None


def detail_row(figure: Figure, result: Outcome, left: float, right: float, top: float) -> None:
    """Draw a row of panels beneath ``top``, as wide as the picture.

    Close-ups of the largest residual and of the sharpest edge, other channels that the model
    gives, and the law inside the model where its family shows one.
    """
    view, others = physics_view(result), _others(result)
    longest = 22 if len(others) < 2 else 0  # of the name of a log in a title
    draws: list[Draw] = [partial(_close_up, c, result, longest) for c in _closeups(result)]
    draws += [partial(_other, result, role) for role in others]
    if view is not None:
        draws.append(partial(_law, view, recorded_units(result.document)))
    grid = figure.add_gridspec(1, len(draws), left=left, right=right, top=top, bottom=0.06,
                               wspace=0.27)  # fmt: skip
    for axes, draw in zip(grid.subplots(squeeze=False)[0], draws):
        draw(axes)


def physics_view(result: Outcome) -> PhysicsView | None:
    """The law inside a dynamic model, as its family shows it; ``None`` for long records."""
    if is_too_long(result):
        return None
    runs = [(s.experiment, Simulated(s.simulated, offset=s.offset)) for s in result.fitted]
    return get_family(result.family).physics_view(result.solution.plant, runs)


def _closeups(result: Outcome) -> list[_Closeup]:
    """The largest residual of all runs, and the sharpest edge of the run with most of them."""
    (size, k), worst = max(
        ((worst_residual(r), r) for r in result.fitted), key=lambda entry: entry[0][0]
    )
    unit = result.experiments[0].signals[result.variant.output.name].unit
    units = recorded_units(result.document)
    what = f"largest residual: {scaled(size, unit, units)}"
    out = [_around(worst, float(instants(worst)[k]), 0.5, what)]
    edges = [(_sharpest(r, drive_role(result.variant)), r) for r in result.fitted]
    (_, at), run = max(edges, key=lambda entry: entry[0][0])
    return [*out, _around(run, at, _BEFORE, "sharpest edge")]


def _around(run: Simulation, at: float, before: float, what: str) -> _Closeup:
    """A part of a run about an instant, of which a share lies before it."""
    time = instants(run)
    whole = float(np.ptp(time))
    width = min(max(_SHARE * whole, _FEWEST * whole / max(time.size - 1, 1)), whole) or 1.0
    low = min(max(at - before * width, float(time[0])), float(time[-1]) - width)
    return _Closeup(run, low, low + width, what, at)


def _sharpest(run: Simulation, drive: str) -> tuple[float, float]:
    """Largest change of the drive from sample to sample, and when; of the output without one."""
    signal = run.experiment.signals.get(drive)
    time, values = instants(run), run.simulated
    if signal is not None and signal.values.size == signal.time.size > 1:
        time, values = signal.time, signal.values
    size, where = 0.0, 0
    for at in blocks(values.size - 1):
        change = np.nan_to_num(np.abs(np.diff(values[at.start : at.stop + 1])))
        if change.size and change.max() > size:
            size, where = float(change.max()), at.start + int(change.argmax()) + 1
    return size, float(time[where])


def _close_up(part: _Closeup, result: Outcome, longest: int, axes: Axes) -> None:
    output = result.variant.output.name
    unit = part.run.experiment.signals[output].unit
    curves = [("measured", part.run.measured, style.MEASURED, 3.0),
              ("simulated", part.run.simulated, style.SIMULATED, 1.2)]  # fmt: skip
    name = plain(part.run.experiment.name, longest) if longest else ""
    units = recorded_units(result.document)
    y = scale_of([part.run.measured], unit, units)
    _over_time(axes, part, curves, (choose_scale("s", part.high, units), y), spoken(output))
    style.dress(axes, part.title + (f" ({name})" if name else ""))


def _over_time(
    axes: Axes, part: _Closeup, curves: Sequence[tuple[str, FloatArray, str, float]],
    scales: tuple[Scale, Scale], label: str,
) -> None:  # fmt: skip
    """Draw curves over a part of a run; ``scales`` are those of the time and of the values."""
    time = instants(part.run)
    first, last = (int(k) for k in time.searchsorted([part.low, part.high]))
    shown = slice(first, last + 1)
    t, y = scales
    sparse = last - first < 120
    for name, values, colour, width in curves:
        x, v = envelope(time[shown], values[shown], 300)
        dots = sparse and name == "measured"
        axes.plot(x * t.factor, v * y.factor, color=style.SPARSE if dots else colour, label=name,
                  linewidth=0.0 if dots else width, marker="o" if dots else "", markersize=3,
                  markeredgewidth=0)  # fmt: skip
    if part.at is not None:
        axes.axvline(part.at * t.factor, color=style.FAINT, linewidth=0.8, linestyle=":", zorder=1)
    axes.set(xlabel=t.label("time"), ylabel=y.label(label))
    axes.margins(x=0.02)
    axes.locator_params(axis="x", nbins=5)
    axes.locator_params(axis="y", nbins=5)


def _others(result: Outcome) -> list[str]:
    """Roles that a run recorded and the model gives beside the output, two at most."""
    return list(dict.fromkeys(role for r in result.fitted for role in r.also))[:2]


def _other(result: Outcome, role: str, axes: Axes) -> None:
    run = next(r for r in result.fitted if role in r.also)
    measured, simulated = run.others[role]
    time = instants(run)
    part = _Closeup(run, float(time[0]), float(time[-1]), role)
    curves = [("measured", measured, style.MEASURED, 2.4),
              ("simulated", simulated, style.SIMULATED, 1.0)]  # fmt: skip
    units = recorded_units(result.document)
    y = scale_of([measured], run.experiment.signals[role].unit, units)
    _over_time(axes, part, curves, (choose_scale("s", part.high, units), y), spoken(role))
    style.dress(axes, f"{spoken(role)} ({plain(run.experiment.name, 22)})")


def _law(view: PhysicsView, units: Sequence[str], axes: Axes) -> None:
    x = scale_of([view.samples.x], view.x_unit, units)
    y = scale_of([c.y for c in view.curves], view.y_unit, units)
    index = np.flatnonzero(np.isfinite(view.samples.x) & np.isfinite(view.samples.y))
    index = index[subset(index.size, _MOST_POINTS)]
    axes.plot(view.samples.x[index] * x.factor, view.samples.y[index] * y.factor, linestyle="",
              marker="o", markersize=2.6, markeredgewidth=0, color=style.SPARSE, alpha=0.5,
              label=view.samples.label, rasterized=index.size > 1000)  # fmt: skip
    draw_curves(axes, view.curves, x, y)
    axes.set(xlabel=x.label(spoken(view.x_name)), ylabel=y.label(spoken(view.y_name)))
    axes.locator_params(nbins=6)
    axes.legend(fontsize=style.SMALL, frameon=False, loc="best", handlelength=1.6,
                borderaxespad=0.2)  # fmt: skip
    style.dress(axes, view.title)
