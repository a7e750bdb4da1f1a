"""Pictures of a log before a fit: its channels, and what its input does without a model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..channels import Channel
from ..experiment import FloatArray
from ..logs.log import Column
from ..model_free import Views
from ..specification import quotient_unit
from .numbers import choose_scale, pretty_unit, scale_of, scaled
from .runs import envelope
from .style import (
    BAND,
    FAINT,
    INPUT,
    MEASURED,
    SETTINGS,
    SIMULATED,
    SMALL,
    dress,
    legend,
    load_matplotlib,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST = 12  # channels of one picture
_COHERENT = 0.6  # coherence from which on a frequency response says something


def plot_channels(
    title: str, channels: Sequence[tuple[Column, Channel]], time: FloatArray | None
) -> Figure:
    """Every channel over time, as recorded, one above the other.

    Parameters
    ----------
    title
        Name of the log.
    channels
        Columns with what they show; the first twelve are drawn.
    time : (n_rows,)
        [s]; ``None`` counts the rows.
    """
    from matplotlib.figure import Figure

    shown = channels[:_MOST]
    with load_matplotlib().rc_context(SETTINGS):
        figure = Figure(figsize=(8.5, 0.9 + 1.25 * max(len(shown), 1)), layout="constrained")
        rows = figure.subplots(max(len(shown), 1), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (column, channel) in zip(rows, shown, strict=False):
            x = np.arange(1.0, column.values.size + 1.0) if time is None else time
            axes.plot(*envelope(x, column.values), color=INPUT, linewidth=0.8)
            _mark(axes, channel, x)
            dress(axes, _titled(column))
            axes.margins(x=0.0)
        rows[-1].set_xlabel("row" if time is None else "time [s]")
        more = f" (first {_MOST} of {len(channels)} channels)" if len(channels) > _MOST else ""
        figure.suptitle(f"{title}{more}", x=0.01, ha="left", fontsize=11, parse_math=False)
    return figure


def _titled(column: Column) -> str:
    name = column.name or f"column #{column.index}"
    return f"{name} [{pretty_unit(column.unit)}]" if column.unit else name


def _mark(axes: Axes, channel: Channel, x: FloatArray) -> None:
    """Ends at which a channel is clipped, and where it is stuck."""
    for share, end in ((channel.clipped_low, channel.low), (channel.clipped_high, channel.high)):
        if share:
            axes.axhline(end, color=SIMULATED, linewidth=1.2, linestyle="--")
    if channel.stuck:
        last = min(channel.stuck_from + channel.stuck, x.size) - 1
        axes.axvspan(x[channel.stuck_from], x[last], color=SIMULATED, alpha=0.15, lw=0)


def plot_views(views: Views, recorded: Sequence[str] = ()) -> Figure:
    """Impulse and step response, frequency response with coherence, residual against input.

    ``recorded`` are the units of the log, which are preferred.
    """
    from matplotlib.figure import Figure

    with load_matplotlib().rc_context(SETTINGS):
        figure = Figure(figsize=(8.5, 8.0), layout="constrained")
        panels = figure.subplots(3, 2)
        _responses(panels[0], views, recorded)
        _frequencies((panels[1][0], panels[1][1], panels[2][0]), views, recorded)
        _residual(panels[2][1], views, recorded)
        kind = "the rate of " if views.response.integrates else ""
        low, high = (scaled(d, "s", recorded) for d in views.response.delay)
        figure.suptitle(
            f"What {views.role} does to {kind}{views.output}, without a model; dead time "
            f"{low} to {high}", x=0.01, ha="left", fontsize=11, parse_math=False,
        )  # fmt: skip
    return figure


def _responses(panels: Sequence[Axes], views: Views, recorded: Sequence[str]) -> None:
    unit = quotient_unit(views.unit, "s") if views.response.integrates else views.unit
    found, (total, half) = views.response, views.response.step_response
    (x, step), (impulse, summed) = (found.time, found.step), panels
    taps = views.model
    curves = [
        (impulse, "impulse response", quotient_unit(unit, "s"), x, found.taps / step,
         found.half_width / step, None if taps is None else taps / step),
        (summed, "step response", unit, x + step, total, half,
         None if taps is None else np.cumsum(taps)),
    ]  # fmt: skip
    t = choose_scale("s", float(x[-1]), recorded)
    for axes, name, si_unit, at, y, width, model in curves:
        s = scale_of([y], si_unit, recorded)
        low, high = (t.factor * end for end in found.delay)
        axes.axhline(0.0, color=FAINT, linewidth=0.7)
        axes.axvspan(low, high, color=MEASURED, alpha=0.3, lw=0, label="dead time (95 %)")
        axes.fill_between(t.factor * at, s.factor * (y - width), s.factor * (y + width),
                          color=BAND, alpha=0.45, lw=0, label="95 %")  # fmt: skip
        axes.plot(t.factor * at, s.factor * y, color=INPUT, linewidth=1.4, label="recorded")
        if model is not None:
            axes.plot(t.factor * at, s.factor * model, color=SIMULATED, linewidth=1.0,
                      label="model")  # fmt: skip
        axes.set_xlim(0.0, t.factor * float(x[-1]))
        axes.set_xlabel(t.label("time"))
        dress(axes, s.label(name))
    summed.legend(loc="best", fontsize=SMALL, frameon=False)


def _frequencies(panels: Sequence[Axes], views: Views, recorded: Sequence[str]) -> None:
    gain, phase, coherence = panels
    found, model = views.frequency, views.model_frequency
    s = scale_of([] if found is None else [found.magnitude], views.unit, recorded)
    dress(gain, s.label("gain"))
    dress(phase, "phase [°]")
    dress(coherence, "coherence: the input's share of the output")
    for axes in panels:
        axes.set_xlabel("frequency [Hz]")
    if found is None:
        gain.text(0.5, 0.5, "too short", transform=gain.transAxes, ha="center", color=FAINT)
        return
    sure = found.coherence >= _COHERENT
    f, half = found.frequency, 1.96 * np.minimum(found.relative, 5.0)
    for axes, y, spread in (
        (gain, s.factor * found.magnitude, s.factor * found.magnitude * half),
        (phase, np.degrees(found.phase), np.degrees(half)),
    ):
        low = np.maximum(y - spread, 1e-3 * y) if axes is gain else y - spread
        shown = np.where(sure, y, np.nan)
        axes.fill_between(f, low, y + spread, where=sure, color=BAND, alpha=0.45, lw=0)
        axes.plot(f, shown, color=INPUT, linewidth=1.2, marker=".", markersize=3)
    if model is not None:
        known = np.isin(model.frequency, f[sure])
        for axes, y in ((gain, s.factor * model.magnitude), (phase, np.degrees(model.phase))):
            axes.plot(model.frequency[known], y[known], color=SIMULATED, linewidth=1.0)
    coherence.plot(f, found.coherence, color=INPUT, linewidth=1.0)
    coherence.axhline(_COHERENT, color=FAINT, linewidth=0.7, linestyle="--")
    coherence.set_ylim(0.0, 1.03)
    gain.set_yscale("log")
    for axes in panels:
        axes.set_xscale("log")
        axes.set_xlim(float(f[0]), float(f[-1]))


def _residual(axes: Axes, views: Views, recorded: Sequence[str]) -> None:
    found = views.residual
    if found is None:
        dress(axes, "residual and input: no model was fitted")
        axes.set_axis_off()
        return
    dress(axes, "correlation of residual and input")
    axes.axhspan(-found.limit, found.limit, color=BAND, alpha=0.35, lw=0, label="chance (99 %)")
    t = choose_scale("s", float(found.lag[-1]), recorded)
    axes.vlines(t.factor * found.lag, 0.0, found.correlation, color=INPUT, linewidth=1.4)
    axes.axhline(0.0, color=FAINT, linewidth=0.7)
    most = max(1.5 * found.limit, 1.2 * float(np.abs(found.correlation).max()))
    axes.set_ylim(-most, most)
    axes.set_xlabel(t.label("lag of the residual"))
    legend(axes)


def inspection_page(title: str, figures: Sequence[tuple[str, Figure]]) -> str:
    """A page of pictures; title of each."""
    from .html import escape, pictures, whole_page
    from .reading import picture

    shown = [picture(figure, text, f"{text} of {title}") for text, figure in figures]
    return whole_page(title, [f"<h1>{escape(title)}</h1>", pictures(shown)])
