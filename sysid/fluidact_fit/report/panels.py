"""The panels of a figure. Each draws into axes it is given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..experiment import FloatArray, Signal
from ..family import Curve, Quantity, StaticView
from ..outcome import Simulation
from . import style
from .numbers import Scale, count, in_scale, plain, show, spoken
from .runs import envelope, instants, subset

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_POINTS = 6000
_MOST_ROWS = 18


def output_panel(axes: Axes, runs: Sequence[Simulation], t: Scale, y: Scale, title: str) -> None:
    """Measured against simulated over time; several runs are overlaid."""
    many = len(runs) > 1
    sparse = max(r.measured.size for r in runs) <= 120
    for k, run in enumerate(runs):
        for values, colour, label, order in (
            (run.measured, style.MEASURED, "measured", 2),
            (run.simulated, style.SIMULATED, "simulated", 3),
        ):
            x, v = envelope(instants(run), values)
            measured = label == "measured"
            axes.plot(
                x * t.factor, v * y.factor, color=style.SPARSE if measured and sparse else colour,
                zorder=order + 2 * (measured and sparse),
                marker="o" if sparse else "", markersize=3.5 if measured else 2, markeredgewidth=0,
                linestyle="" if measured and sparse else "-",
                linewidth=2.8 if measured and not many else 1.0,
                alpha=0.55 if many else 1.0, label=label if k == 0 else None,
            )  # fmt: skip
    style.dress(axes, title)


def replaced_samples(axes: Axes, runs: Sequence[Simulation], role: str, t: Scale, y: Scale) -> None:
    """Draw the recorded values of replaced samples; distant ones at the edge of the panel."""
    label: str | None = "left out"
    for run in runs:
        signal = run.experiment.signals.get(role)
        if signal is None or not signal.recorded or signal.time.size not in (0, signal.values.size):
            continue
        time = signal.time if signal.time.size else np.arange(float(signal.values.size))
        low, high = axes.get_ylim()
        for k, value in signal.recorded.items():
            seen = float(np.clip(value * y.factor, low, high))
            far = seen != value * y.factor
            axes.plot([time[k] * t.factor], [seen], linestyle="", markersize=6 if far else 5,
                      marker=("^" if seen == high else "v") if far else "x", color=style.REPLACED,
                      markeredgewidth=1.2, clip_on=False, zorder=5, label=label)  # fmt: skip
            label = None
        axes.set_ylim(low, high)


def residual_panel(axes: Axes, runs: Sequence[Simulation], rmse: float, t: Scale, y: Scale) -> None:
    """Residuals over time with the band of two root-mean-square errors."""
    style.band(axes, 2.0 * rmse * y.factor, 0.22, "± 2 rmse")
    many = len(runs) > 1
    for run in runs:
        x, v = envelope(instants(run), run.residual)
        sparse = x.size <= 120
        axes.plot(x * t.factor, v * y.factor, color=style.RESIDUAL, alpha=0.4 if many else 1.0,
                  linewidth=0.0 if many and sparse else 0.7, marker="o" if sparse else "",
                  markersize=3 if sparse else 2, markeredgewidth=0)  # fmt: skip
    style.dress(axes)


def input_panel(axes: Axes, runs: Sequence[Simulation], drive: str, t: Scale, u: Scale) -> None:
    """Draw the input with the hold that the fit used."""
    for run in runs:
        signal = run.experiment.signals.get(drive)
        if signal is None:
            continue
        x, v = _drawn(signal, instants(run))
        step = "steps-post" if signal.hold in (None, "zoh") and x.size == v.size else "default"
        x, v = envelope(x, v)
        axes.plot(x * t.factor, v * u.factor, color=style.INPUT, linewidth=0.9, drawstyle=step,
                  alpha=0.4 if len(runs) > 1 else 1.0)  # fmt: skip
    style.dress(axes)


def _drawn(signal: Signal, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Instants and values of an input over the time of its run, the level before included."""
    x, v = signal.time, signal.values
    if v.size > 3:
        return x, v
    ends = [min(float(time[0]), float(x[0]) - 0.03 * float(np.ptp(time))), *x.tolist()]
    values = [signal.before, *v.tolist()]
    return np.array([*ends, float(time[-1])]), np.array([*values, values[-1]])


def correlation_panel(axes: Axes, residuals: Sequence[FloatArray], whiteness: str) -> None:
    """Autocorrelation of the residuals with the band of white noise."""
    finite = [r[np.isfinite(r)] for r in residuals]
    lags, rho = correlation(finite)
    half = 1.96 / max(sum(r.size for r in finite), 1) ** 0.5
    style.band(axes, half, 0.35)
    axes.vlines(lags, 0.0, rho, color=style.RESIDUAL, linewidth=1.6)
    low, high = min(float(rho.min(initial=0.0)), -half), max(float(rho.max(initial=0.0)), half)
    room = 0.35 * (high - low)  # the words above the stems
    axes.set_ylim(low - 0.2 * room, high + room)
    axes.set_yticks([k for k in axes.get_yticks() if low - 0.2 * room <= k <= min(high + room, 1)])
    axes.set_xlim(0, float(lags[-1]) + float(lags[0]))
    axes.set(xlabel="lag [samples]", ylabel="autocorrelation")
    axes.yaxis.label.set_visible(False)
    if whiteness:
        axes.text(1.0, 0.96, whiteness, transform=axes.transAxes, ha="right", va="top",
                  fontsize=style.SMALL, color=style.FAINT)  # fmt: skip
    style.dress(axes, "Residual autocorrelation, shaded: 95 % band of white noise")


def correlation(
    residuals: Sequence[FloatArray], stems: int = 40
) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """Autocorrelation at up to ``stems`` lags, as far as the residuals of the runs have any.

    The lags are one sample apart unless the correlation is still above one half at the last;
    then they are spread, up to a quarter of the longest run.
    """
    longest = max((r.size for r in residuals), default=0)
    energy = sum(float(r @ r) for r in residuals) or 1.0

    def rho(lag: int) -> float:
        return sum(float(r[: r.size - lag] @ r[lag:]) for r in residuals if r.size > lag) / energy

    stride = 1
    while 16 * stride * stems <= longest and rho(stride * stems) > 0.5:
        stride *= 4
    lags = np.arange(1, max(min(stems, longest // (2 * stride)), 1) + 1) * stride
    return lags, np.array([rho(int(k)) for k in lags])


def map_panel(axes: Axes, view: StaticView, x: Scale, y: Scale) -> None:
    """Samples of a static map with the fitted curve."""
    size = int(view.used.sum())
    beside = _draw_samples(axes, view, x.factor, view.measured * y.factor, style.SPARSE, named=True)
    draw_curves(axes, view.curves, x, y)
    if not view.curves:
        order = np.argsort(view.x, kind="stable")
        axes.plot(view.x[order] * x.factor, view.fitted[order] * y.factor, color=style.SIMULATED,
                  linewidth=1.4, label="fitted", zorder=4)  # fmt: skip
    if view.points is not None:
        axes.plot(view.points.x * x.factor, view.points.y * y.factor, color=style.POINTS,
                  linewidth=0.8, linestyle=":", marker="s", markersize=4.5, zorder=5,
                  markerfacecolor="white", label=plain(view.points.label, 30))  # fmt: skip
    axes.set_ylabel(y.label(spoken(view.y_name)))
    axes.set_xlim(*(x.factor * end for end in window(view)))
    notes = [f"{count(size)} samples" + (f" ({count(_MOST_POINTS)} drawn)" * (size > _MOST_POINTS))]
    left = view.used.size - size
    if left:
        beyond = left - beside
        notes.append(
            f"{count(left)} left out" + (f", {count(beyond)} beyond the picture" * (beyond > 0))
        )
    style.dress(axes, "; ".join(notes))


def draw_curves(axes: Axes, curves: Sequence[Curve], x: Scale, y: Scale) -> None:
    """Curves of a model, each in a colour and with a line of its own."""
    styles = zip(
        cycle((style.SIMULATED, style.INPUT, style.POINTS, style.INK)),
        cycle(("-", "--", "-.", ":")),
    )
    for curve, (colour, line) in zip(curves, styles):
        axes.plot(curve.x * x.factor, curve.y * y.factor, color=colour, linestyle=line,
                  linewidth=1.5, zorder=4, label=plain(curve.label, 30))  # fmt: skip


def window(view: StaticView) -> tuple[float, float]:
    """Range of x that shows the fitted samples, with room for what lies just beside them."""
    used = view.x[view.used] if view.used.any() else view.x
    ends = [*(c.x for c in view.curves), used]
    low = min(float(e.min()) for e in ends if e.size)
    high = max(float(e.max()) for e in ends if e.size)
    room = 0.3 if (~view.used).any() else 0.04
    room *= (high - low) or 1.0
    seen = view.x[(view.x >= low - room) & (view.x <= high + room)]
    edge = 0.04 * ((high - low) or 1.0)
    return min(low, float(seen.min())) - edge, max(high, float(seen.max())) + edge


def map_residual_panel(axes: Axes, view: StaticView, x: Scale, y: Scale, rmse: float) -> None:
    """Residuals over the input of a static map."""
    style.band(axes, 2.0 * rmse * y.factor, 0.22, "± 2 rmse")
    rest = view.measured - view.fitted
    if _draw_samples(axes, view, x.factor, rest * y.factor, style.RESIDUAL, named=False):
        inside = np.abs(rest[view.used]).max(initial=0.0)
        axes.set_ylim(*(np.array([-1.3, 1.3]) * max(inside, 2.5 * rmse) * y.factor))
    axes.set_ylabel(y.label("residual"))
    axes.set_xlabel(x.label(spoken(view.x_name)))
    style.dress(axes)


def _draw_samples(
    axes: Axes, view: StaticView, factor: float, values: FloatArray, colour: str, *, named: bool
) -> int:
    """Samples of a map, and those left out just beside them, whose number is returned."""
    low, high = window(view)
    beside = ~view.used & (view.x >= low) & (view.x <= high)
    for chosen, shade, marker, edge, label in (
        (beside, style.LEFT_OUT, "x", 0.8, "left out"), (view.used, colour, "o", 0, "measured"),
    ):  # fmt: skip
        index = np.flatnonzero(chosen)
        index = index[subset(index.size, _MOST_POINTS)]
        if not index.size:
            continue
        axes.plot(view.x[index] * factor, values[index], linestyle="", marker=marker,
                  markersize=2.5 if index.size > 400 else 4, color=shade, markeredgewidth=edge,
                  alpha=0.5 if index.size > 1000 else 0.8, label=label if named else None,
                  zorder=2, rasterized=index.size > 1000)  # fmt: skip
    return int(beside.sum())


def histogram_panel(axes: Axes, residuals: FloatArray, y: Scale) -> None:
    """Distribution of the residuals with the normal curve of the same width."""
    rest = residuals[np.isfinite(residuals)] * y.factor
    if rest.size and np.ptp(rest) > 0.0:
        width = float(rest.std())
        bins = int(np.clip(np.sqrt(rest.size), 8, 60))
        axes.hist(rest, bins=bins, density=True, color=style.BAND, alpha=0.6)
        x = np.linspace(rest.min(), rest.max(), 200)
        normal = np.exp(-0.5 * ((x - rest.mean()) / width) ** 2) / (width * np.sqrt(2 * np.pi))
        axes.plot(x, normal, color=style.INK, linewidth=1.0)
    axes.set_yticks([])
    axes.locator_params(axis="x", nbins=5)
    axes.set_xlabel(y.label("residual"))
    style.dress(axes, "Residuals and the normal distribution with the same SD")


def table_panel(
    axes: Axes,
    parameters: Mapping[str, Quantity],
    derived: Mapping[str, Quantity],
    recorded: Sequence[str],
) -> None:
    """Parameters with standard errors as text, in units of the log; the status if unusual."""
    axes.set_axis_off()
    axes.set_xlim(0.0, 1.0)
    rows = [("Parameters", "value ± standard error", "", style.INK), *_rows(parameters, recorded)]
    extra = _rows(derived, recorded)
    if extra and len(rows) + len(extra) < _MOST_ROWS:
        rows += [("", "", "", style.INK), ("Derived", "", "", style.INK), *extra]
    if len(rows) > _MOST_ROWS:
        rows = [*rows[: _MOST_ROWS - 1], ("…", "more in the file", "", style.FAINT)]
    slots = max(len(rows), 11)
    for k, (name, value, status, colour) in enumerate(rows):
        y = 1.0 - (k + 0.5) / slots
        title = name in ("Parameters", "Derived")
        weight = "bold" if title else "normal"
        size = style.NORMAL if title else style.SMALL + 0.3
        axes.text(0.0, y, plain(spoken(name), 26), fontsize=size, weight=weight, color=style.INK,
                  va="center", parse_math=False)  # fmt: skip
        tail = f"{value}   {status}" if status else value
        axes.text(1.0, y, tail, fontsize=style.SMALL if title else size, ha="right", va="center",
                  color=style.FAINT if title else colour, parse_math=False)  # fmt: skip


def _rows(
    quantities: Mapping[str, Quantity], recorded: Sequence[str]
) -> list[tuple[str, str, str, str]]:
    said = {
        "not_identified": ("not identified", style.VERDICT["fail"]),
        "fixed": ("fixed", style.FAINT),
    }
    rows = []
    for name, q in quantities.items():
        value, error, scale = in_scale(q, recorded)
        text = f"{show(value, error)} {scale.unit}".rstrip()
        rows.append((name, text, *said.get(q.status, ("", style.INK))))
    return rows
