"""Picture of a closed-loop response."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..block import Port
from ..experiment import FloatArray
from .numbers import scale_of
from .style import (
    BAND,
    FAINT,
    INPUT,
    MEASURED,
    RESIDUAL,
    SETTINGS,
    SIMULATED,
    dress,
    legend,
    load_matplotlib,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_response(
    time: FloatArray, reference: FloatArray, output: FloatArray, controlled: Port,
    commands: Sequence[tuple[Port, FloatArray]], band: tuple[FloatArray, FloatArray] | None = None,
) -> Figure:  # fmt: skip
    """Output against its reference, the error, and the commands, over time.

    Parameters
    ----------
    time, reference, output : (n,)
        [s], and the unit of ``controlled``.
    controlled
        What the output is.
    commands
        Each command with its values ``(n,)``, held from each sample on; all of one unit.
    band
        Lower and upper edge of the middle 90 % of drawn machines.
    """
    from matplotlib.figure import Figure

    y, e = (scale_of(v, controlled.unit) for v in ([reference, output], [reference - output]))
    u = scale_of([values for _, values in commands], commands[0][0].unit)
    with load_matplotlib().rc_context(SETTINGS):
        figure = Figure(figsize=(8.0, 7.5), layout="constrained")
        top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 2))
        for axes in (top, middle, bottom):
            dress(axes)
            axes.margins(x=0.0)
        if band is not None:
            low, high = band
            top.fill_between(time, y.factor * low, y.factor * high, color=BAND, alpha=0.5,
                             label="90 % of drawn machines")  # fmt: skip
            middle.fill_between(time, e.factor * (reference - high), e.factor * (reference - low),
                                color=BAND, alpha=0.5)  # fmt: skip
        top.plot(time, y.factor * reference, color=MEASURED, label="reference")
        top.plot(time, y.factor * output, color=SIMULATED, label="output")
        middle.plot(time, e.factor * (reference - output), color=RESIDUAL)
        middle.axhline(0.0, color=FAINT, linewidth=0.7)
        for colour, (port, values) in zip((INPUT, SIMULATED), commands):
            bottom.step(time, u.factor * values, where="post", color=colour, label=port.role)
        top.set_ylabel(y.label(controlled.role))
        middle.set_ylabel(e.label("error"))
        bottom.set_ylabel(u.label("command" if len(commands) > 1 else commands[0][0].role))
        bottom.set_xlabel("time [s]")
        legend(top)
        if len(commands) > 1:
            legend(bottom)
        figure.align_ylabels([top, middle, bottom])
    return figure
