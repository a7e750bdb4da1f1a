"""Pictures of the replay: ours as lines, what the sources read off theirs in grey."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fluidact_fit.control.loop import LoopResponse
from fluidact_fit.report.style import (
    FAINT,
    INK,
    INPUT,
    LEFT_OUT,
    MEASURED,
    POINTS,
    SETTINGS,
    SIMULATED,
    dress,
    legend,
)

from . import force, hydrostatic, pneumatic
from .page import Runs

_WIDTH = 8.0  # inches
_COLOURS = (SIMULATED, INPUT, POINTS)
_SOURCE: dict[str, Any] = {"color": LEFT_OUT, "alpha": 0.45, "linewidth": 0.0}
_HELD: dict[str, Any] = {"color": MEASURED, "linewidth": 1.2, "drawstyle": "steps-post"}
_LINE: dict[str, Any] = {"color": FAINT, "linewidth": 1.0, "linestyle": "--"}


def draw(runs: Runs) -> Iterator[tuple[str, Figure]]:
    """Yield the pictures by the name of their file, to be saved at once."""
    with rc_context({**SETTINGS, "path.simplify_threshold": 0.2}):
        yield "replay-step", _step(runs.hydrostatic)
        yield "replay-triangle", _triangle(runs.hydrostatic.triangle)
        yield "replay-sine", _sine(runs.hydrostatic)
        yield "replay-insertion", _insertion(runs.hydrostatic)
        yield "replay-pneumatic", _pneumatic(runs.pneumatic)
        yield "replay-force", _force(runs.force)


def _panels(height: float, *heights: float) -> tuple[Figure, Sequence[Axes]]:
    """A column of panels over time."""
    figure = Figure(figsize=(_WIDTH, height), layout="constrained")
    panels = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights, squeeze=False)
    column: list[Axes] = panels[:, 0].tolist()
    for axes in column:
        dress(axes)
        axes.margins(x=0.0)
    column[-1].set_xlabel("time [s]")
    return figure, column


def _course(axes: Axes, r: LoopResponse, values: str, colour: str, label: str = "") -> None:
    """Output or error in millimetres."""
    axes.plot(r.time, 1e3 * getattr(r, values), color=colour, linewidth=1.2, label=label)
    axes.set_ylabel({"output": "position [mm]", "error": "error [mm]"}[values])


def _reference(axes: Axes, r: LoopResponse) -> None:
    axes.plot(r.time, 1e3 * r.reference, color=MEASURED, linewidth=1.2, label="reference")


def _step(runs: hydrostatic.Runs) -> Figure:
    figure, (axes,) = _panels(3.2, 1.0)
    target = 1e3 * hydrostatic.TARGET
    axes.axhline(target + 0.3, **_LINE, label="peak in the thesis")
    axes.axhline(target + 0.1, **_LINE | {"linestyle": ":"}, label="rest in the thesis")
    axes.plot(runs.step.time, 1e3 * runs.step.reference, **_HELD, label="reference")
    courses = (
        (runs.step, SIMULATED, "tolerance 1 mm/s"),
        (runs.coarse, INPUT, "tolerance 10 mm/s"),
        (runs.limit[0], POINTS, "gains as the thesis found its own"),
    )
    for r, colour, label in courses:
        _course(axes, r, "output", colour, label)
    axes.set_xlim(0.8, 2.5)
    legend(axes, columns=3)
    return figure


def _triangle(r: LoopResponse) -> Figure:
    figure, (top, bottom) = _panels(4.2, 2.0, 1.0)
    _reference(top, r)
    _course(top, r, "output", SIMULATED, "position")
    bottom.axhspan(-1.0, 1.0, **_SOURCE, label="error in the thesis")
    _course(bottom, r, "error", INPUT, "error")
    legend(top, bottom)
    return figure


def _sine(runs: hydrostatic.Runs) -> Figure:
    figure, (top, bottom) = _panels(4.2, 2.0, 1.0)
    _reference(top, runs.sine)
    for edge, label in ((0.6, "distance at which the thesis' rod broke away"), (-0.6, None)):
        bottom.axhspan(edge - 0.1, edge + 0.1, **_SOURCE, label=label)
    named = ((runs.plain, SIMULATED, "uncompensated"), (runs.sine, INPUT, "compensated"))
    for r, colour, label in named:
        _course(top, r, "output", colour, label)
        _course(bottom, r, "error", colour)
    legend(bottom, top)
    return figure


def _insertion(runs: hydrostatic.Runs) -> Figure:
    figure, (top, bottom) = _panels(4.8, 1.0, 1.6)
    at = runs.insertion.time[hydrostatic.puncture(runs.insertion)]
    held = 1e3 * runs.jolt.reference[-1]
    dress(top, "ramp of 7.5 mm/s")
    dress(bottom, "the same, the hand jolts by 0.7 mm at the puncture")
    bottom.axhline(held + 0.45, **_LINE, label="peak in the thesis")
    _course(top, runs.insertion, "error", SIMULATED)
    _reference(bottom, runs.jolt)
    _course(bottom, runs.jolt, "output", SIMULATED, "position")
    for axes in (top, bottom):
        axes.axvline(at, color=INK, linewidth=0.8, linestyle=":", label="puncture")
    top.set(xlim=(at - 0.3, at + 0.7), ylim=(0.0, 1.0))
    bottom.set_ylim(held - 3.5, held + 1.0)
    legend(bottom)
    return figure


def _pneumatic(runs: Sequence[pneumatic.Insertion]) -> Figure:
    figure, (top, bottom) = _panels(4.8, 2.0, 1.4)
    done = [(i, i.response) for i in runs if i.response is not None and not i.setting.differs]
    _reference(top, done[0][1])
    bottom.axhline(1.5, **_LINE, label="lag in the thesis, 8 bar")
    for (i, r), colour in zip(done, _COLOURS):
        _course(top, r, "output", colour, i.name)
        _course(bottom, r, "error", colour)
    top.set(xlim=(0.0, 4.5), ylim=(5.0, 50.0))
    bottom.set_ylim(-10.0, 10.0)
    legend(bottom, top, columns=3)
    return figure


def _force(runs: Mapping[force.Key, LoopResponse]) -> Figure:
    figure = Figure(figsize=(_WIDTH, 5.4), layout="constrained")
    each = figure.subplots(len(force.SOURCE), 1, sharex=True)
    for axes, (size, error) in zip(each, force.SOURCE.items(), strict=True):
        dress(axes, f"{size:g} N")
        axes.set(ylabel="force [N]", xlim=(0.05, 0.7), ylim=(0.85 * size, 1.12 * size))
        axes.axhline(size + error, **_LINE, label="rest in the paper, n_s = 1")
        for steps, colour in zip(force.STEPS, _COLOURS):
            r = runs[size, steps, "held"]
            axes.plot(r.time, r.output, color=colour, linewidth=1.2, label=f"n_s = {steps}")
        axes.plot(r.time, r.reference, **_HELD, label="reference")
    each[-1].set_xlabel("time [s]")
    legend(each[0])
    return figure
