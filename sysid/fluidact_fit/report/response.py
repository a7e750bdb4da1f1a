"""Picture of a closed-loop response."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ..experiment import FloatArray
from .style import BAND, INPUT, MEASURED, RESIDUAL, SETTINGS, SIMULATED, load_matplotlib

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_response(
    time: FloatArray, reference: FloatArray, output: FloatArray, label: str,
    commands: Mapping[str, FloatArray], band: tuple[FloatArray, FloatArray] | None = None,
) -> Figure:  # fmt: skip
    """Output against its reference, the error, and the commands, over time.

    Parameters
    ----------
    time, reference, output : (n,)
    label
        What the output is, with its unit.
    commands
        What each command is, with its unit, to values ``(n,)``.
    band
        Lower and upper edge of the middle 90 % of drawn machines.
    """
    from matplotlib.figure import Figure

    with load_matplotlib().rc_context(SETTINGS):
        figure = Figure(figsize=(8.0, 7.5), layout="constrained")
        top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 2))
        if band is not None:
            top.fill_between(time, *band, color=BAND, alpha=0.5, label="90 % of drawn machines")
            middle.fill_between(
                time, reference - band[1], reference - band[0], color=BAND, alpha=0.5
            )
        top.plot(time, reference, color=MEASURED, label="reference")
        top.plot(time, output, color=SIMULATED, label="output")
        top.set_ylabel(label)
        top.legend(loc="best", frameon=False)
        middle.plot(time, reference - output, color=RESIDUAL)
        middle.axhline(0.0, color=MEASURED, linewidth=0.8)
        middle.set_ylabel(f"error, {label}")
        colours = (INPUT, SIMULATED)
        for colour, (name, values) in zip(colours, commands.items()):
            bottom.step(time, values, where="post", color=colour, label=name)
        bottom.legend(loc="best", frameon=False)
        bottom.set_xlabel("time [s]")
    return figure
