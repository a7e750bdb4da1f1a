"""One picture per fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..families import get_family
from ..family import StaticView
from ..notices import is_note
from ..outcome import Outcome, Simulation, agreement
from ..parameter_table import recorded_units
from ..tables import probability_text
from . import panels
from .details import detail_row
from .numbers import choose_scale, count, percent, plain, scale_of, scaled, spoken
from .runs import choose, drive_role, instants
from .style import FAINT, INK, LARGE, NORMAL, SETTINGS, SMALL, VERDICT, legend, load_matplotlib

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SIZE = (13.0, 7.6)  # inches
_DETAILS = 3.1  # inches of the row beneath a dynamic fit
_SIDE = 4.3 / 13.0  # share of the text column


def plot_result(result: Outcome) -> Figure:
    """Draw a fit: the model against the data, the residuals, and the numbers.

    A dynamic model shows measured against simulated output over time, residuals with a
    band of two root-mean-square errors, the input, and the autocorrelation of the
    residuals; beneath, close-ups of the largest residual and of the sharpest edge, other
    channels, and the law inside where its family shows one. A static map shows its curve
    through the samples and the residuals over its input.

    Parameters
    ----------
    result
        A finished fit.

    Returns
    -------
    matplotlib.figure.Figure
        Belongs to no window and no global state.
    """
    matplotlib = load_matplotlib()
    from matplotlib.figure import Figure

    with matplotlib.rc_context(SETTINGS):
        view = static_view(result)
        width, height = _SIZE
        figure = Figure(figsize=(width, height + _DETAILS * (view is None)))
        _title(figure, result)
        if view is None:
            _dynamic(figure, result.fitted, result, right=0.975 - _SIDE)
            lowest = _side(figure, result)
            detail_row(figure, result, 0.055, 0.975, _height(figure, -0.055))
            panels.correlation_panel(
                lowest, [r.residual for r in result.fitted], _whiteness(result)
            )
        else:
            _static(figure, view, result)
    return figure


def plot_validation(result: Outcome) -> Figure | None:
    """Draw the validation logs; ``None`` when there are none."""
    matplotlib = load_matplotlib()
    from matplotlib.figure import Figure

    if not result.validation or static_view(result) is not None:
        return None
    with matplotlib.rc_context(SETTINGS):
        figure = Figure(figsize=(13.0, 6.4))
        runs = result.validation
        a = agreement(runs)
        _heading(figure, f"{result.family}: logs that were not fitted",
                 f"fit {percent(a.fit_percent)}   ·   {count(a.samples)} samples")  # fmt: skip
        _dynamic(figure, runs, result, right=0.975)
    return figure


def static_view(result: Outcome) -> StaticView | None:
    """View of a static map, from the family or, without a drive, over its first input."""
    if result.static_view is not None or drive_role(result.variant):
        return result.static_view
    return _plain_view(result)


def _plain_view(result: Outcome) -> StaticView | None:
    """Output over the first input, for a map without a view of its own."""
    first, output = result.experiments[0], result.variant.output.name
    others = (r.name for r in result.variant.roles if r.name not in (output, "time"))
    role = next((name for name in others if name in first), None)
    if role is None:
        return None
    raw = np.concatenate([e[output] for e in result.experiments])
    measured = np.concatenate([s.measured for s in result.fitted])
    return StaticView(
        role, first.signals[role].unit, output, first.signals[output].unit,
        np.concatenate([e[role] for e in result.experiments]),
        raw if raw.size == measured.size else measured,
        np.concatenate([s.simulated for s in result.fitted]),
        np.isfinite(measured),
    )  # fmt: skip


def _title(figure: Figure, result: Outcome) -> None:
    fit = result.document.fit
    logs = len({e.log for e in result.experiments})
    runs = len(result.experiments)
    parts = [
        f"fit {percent(fit.fit_percent)}",
        f"rmse {scaled(fit.rmse.value, fit.rmse.unit, recorded_units(result.document))}",
        f"{count(fit.samples)} samples",
        f"{logs} log{'s' * (logs > 1)}" + (f", {runs} runs" if runs > logs else ""),
    ]
    judged = [v.fit_percent for v in result.document.validation if v.fit_percent is not None]
    if judged:
        parts.append(f"validation fit {percent(min(judged))}" + (" (worst)" * (len(judged) > 1)))
    _name_warnings(figure, result)
    figure.text(0.975, _height(figure, 0.957), result.verdict.upper(), fontsize=LARGE,
                weight="bold", color="white", ha="right", va="center",
                bbox={"boxstyle": "round,pad=0.35", "facecolor": VERDICT[result.verdict],
                      "edgecolor": "none"})  # fmt: skip
    _heading(figure, get_family(result.family).title, "   ·   ".join(parts))


def _name_warnings(figure: Figure, result: Outcome) -> None:
    """The warnings that turned the verdict, by name under the badge."""
    codes = [w.code for w in result.document.warnings]
    names = [c.replace("-", " ") for c in dict.fromkeys(codes) if not is_note(c)]
    if not names or result.verdict == "pass":
        return
    lines = [" · ".join(names[:2]), " · ".join(names[2:4])]
    if len(names) > 4:
        lines[1] += f" · {len(names) - 4} more"
    for k, line in enumerate(filter(None, lines)):
        figure.text(0.975, _height(figure, 0.918 - 0.02 * k), line, fontsize=SMALL, ha="right",
                    va="center", color=VERDICT[result.verdict], parse_math=False)  # fmt: skip


def _height(figure: Figure, share: float) -> float:
    """A height given as a share of a picture without details, as a share of this one."""
    return float(1.0 - (1.0 - share) * min(_SIZE[1] / figure.get_figheight(), 1.0))


def _heading(figure: Figure, title: str, line: str) -> None:
    figure.text(0.055, _height(figure, 0.962), title, fontsize=LARGE, weight="bold",
                color=INK, va="center",
                parse_math=False)  # fmt: skip
    figure.text(0.055, _height(figure, 0.922), line, fontsize=NORMAL + 1, color=FAINT, va="center",
                parse_math=False)  # fmt: skip


def _side(figure: Figure, result: Outcome) -> Axes:
    """Right column: the numbers as text; returns the axes of a panel beneath."""
    grid = figure.add_gridspec(
        2, 1, height_ratios=(2.1, 1.0), left=0.975 - _SIDE + 0.055, right=0.975,
        top=_height(figure, 0.865), bottom=_height(figure, 0.085), hspace=0.2,
    )  # fmt: skip
    (upper,), (lower,) = grid.subplots(squeeze=False)
    units = recorded_units(result.document)
    panels.table_panel(upper, result.parameters, result.derived, units)
    return lower


def _dynamic(figure: Figure, runs: Sequence[Simulation], result: Outcome, right: float) -> None:
    """Columns of output, residual and input, one per run or all in one."""
    choice = choose(runs)
    shown = choice.runs
    columns = [shown] if choice.overlay else [[r] for r in shown]
    drive, output = drive_role(result.variant), result.variant.output.name
    heights = (3.2, 1.5, 1.0) if drive else (3.2, 1.5)
    grid = figure.add_gridspec(
        len(heights), len(columns), height_ratios=heights, left=0.055, right=right,
        top=_height(figure, 0.855), bottom=_height(figure, 0.085), hspace=0.16, wspace=0.2,
    )  # fmt: skip
    rows = grid.subplots(sharex="col", squeeze=False)
    for row in rows[1:]:  # what is compared between logs; the output has a range of its own
        for axes in row[1:]:
            axes.sharey(row[0])
            axes.tick_params(labelleft=False)
    signals, units = result.experiments[0].signals, recorded_units(result.document)
    t = choose_scale("s", max(float(np.ptp(instants(r))) for r in shown), units)
    y = scale_of([r.measured for r in shown], signals[output].unit, units)
    e = scale_of([r.residual for r in shown], signals[output].unit, units)
    rmse = agreement(runs).rmse
    for column, (upper, lower, *_) in zip(columns, rows.T):
        name = choice.note if choice.overlay else _run_title(column[0], len(columns), len(runs))
        panels.output_panel(upper, column, t, y, name)
        panels.residual_panel(lower, column, rmse, t, e)
    for column, upper in zip(columns, rows[0]):  # when the limits that they share are settled
        panels.replaced_samples(upper, column, output, t, y)
    labels = [y.label(spoken(output)), e.label("residual")]
    if drive:
        driven = [r.experiment[drive] for r in shown if drive in r.experiment]
        u = scale_of(driven, signals[drive].unit, units)
        for column, axes in zip(columns, rows[2]):
            panels.input_panel(axes, column, drive, t, u)
        for column, axes in zip(columns, rows[2]):
            panels.replaced_samples(axes, column, drive, t, u)
        labels.append(u.label(spoken(drive)))
    _label(figure, rows, t.label("time"), labels)
    legend(rows[1, -1], rows[0, -1])
    if choice.note and not choice.overlay:
        figure.text(right, _height(figure, 0.893), choice.note, fontsize=NORMAL,
                    color=FAINT, ha="right",
                    va="center")  # fmt: skip


def _run_title(run: Simulation, columns: int, runs: int) -> str:
    name = plain(run.experiment.name, 72 // columns)
    return f"{name} · {percent(run.agreement.fit_percent)}" if runs > 1 else name


def _label(figure: Figure, rows: npt.NDArray[np.object_], time: str, labels: Sequence[str]) -> None:
    """Labels of all axes, shown at the outer edges only."""
    for j, (row, label) in enumerate(zip(rows, labels)):
        for k, axes in enumerate(row):
            axes.set(xlabel=time, ylabel=label)
            axes.xaxis.label.set_visible(j == len(rows) - 1)
            axes.yaxis.label.set_visible(k == 0)
            axes.margins(x=0.015)
            axes.locator_params(axis="y", nbins=7 if j == 0 else 4)
    figure.align_ylabels(rows[:, 0])


def _as_recorded(view: StaticView, result: Outcome) -> StaticView:
    """The view with the samples that were replaced as they were recorded, and left out."""
    output = result.variant.output.name
    signals = [e.signals[output] for e in result.experiments if output in e]
    rows = sum(s.values.size for s in signals)
    if view.y_name != output or rows != view.measured.size:
        return view
    measured, used, begin = view.measured.copy(), view.used.copy(), 0
    for s in signals:
        for k, value in s.recorded.items():
            measured[begin + k], used[begin + k] = value, False
        begin += s.values.size
    return replace(view, measured=measured, used=used)


def _static(figure: Figure, view: StaticView, result: Outcome) -> None:
    grid = figure.add_gridspec(
        2, 1, height_ratios=(2.6, 1.0), left=0.065, right=0.975 - _SIDE, top=0.855, bottom=0.085,
        hspace=0.13 if len(view.curves) < 4 else 0.2,  # room for a second line of the legend
    )  # fmt: skip
    (upper,), (lower,) = grid.subplots(sharex=True, squeeze=False)
    view = _as_recorded(view, result)
    units = recorded_units(result.document)
    x = scale_of([view.x], view.x_unit, units)
    y = scale_of([view.measured[view.used]], view.y_unit, units)
    rest = (view.measured - view.fitted)[view.used]
    e = scale_of([rest], view.y_unit, units)
    rmse = float(np.sqrt(np.mean(rest**2))) if rest.size else 0.0
    panels.map_panel(upper, view, x, y)
    upper.set_xlabel(x.label(spoken(view.x_name)), visible=False)
    panels.map_residual_panel(lower, view, x, e, rmse)
    legend(lower, upper, columns=6)
    figure.align_ylabels([upper, lower])
    panels.histogram_panel(_side(figure, result), rest, e)


def _whiteness(result: Outcome) -> str:
    w = result.document.fit.residual_whiteness
    if w is None:
        return ""
    return f"test for white noise: {probability_text(w.p_value)}"
