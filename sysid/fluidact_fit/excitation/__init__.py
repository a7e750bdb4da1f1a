"""Design of the next recording: the excitation that best determines the least certain parameter.

    M = J' J / sigma^2,   std_error = sqrt(diag(M^-1))

``J`` is the derivative of the output by the parameters at the values of a parameter file,
``sigma`` the rmse of its fit. Candidates of several shapes within the stated limits are
simulated, the best by Fisher's information [1]_ are improved one number at a time. The
prediction is as good as the file: it takes the values, the white noise and the model of
the file as true.

References
----------
.. [1] G. Goodwin, R. Payne, Dynamic System Identification: Experiment Design and Data
   Analysis, 1977, chapter 6.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ..arguments import number_in_si, pair_in_si, require, require_given, shown
from ..control import read_document
from ..parameter_table import recorded_units
from ..parameters import ParameterDocument
from ..specification import quotient_unit
from .command import design_command
from .points import design_points, speed_and_place
from .result import NOT_GIVEN, Candidate, Design, Forecast, Limits
from .strokes import design_strokes
from .task import Task

__all__ = ["Candidate", "Design", "Forecast", "Limits", "design"]


def _limits_in_si(task: Task, amplitude: Any, rate: Any, stroke: Any) -> Limits:
    """The limits of a task with those that were given (``UsageError`` for what is none)."""
    drive, output = task.drive.unit, task.output.unit
    if task.excitation.kind == "strokes":
        drive, output = (role.unit for role in speed_and_place(task))
    slope = [quotient_unit(drive, "s")]

    def pair(name: str, value: Any, unit: str) -> tuple[float, float] | None:
        return None if value is None else pair_in_si(f"{name}={shown(value)}", value, [unit])

    return replace(
        task.given,
        amplitude=pair("--amplitude", amplitude, drive) or NOT_GIVEN,
        rate=None if rate is None else number_in_si(f"--rate={shown(rate)}", rate, slope),
        stroke=pair("--stroke", stroke, output),
    )


def design(
    document: ParameterDocument | str | os.PathLike[str],
    *,
    amplitude: tuple[float | str, float | str] | None = None,
    rate: float | str | None = None,
    stroke: tuple[float | str, float | str] | None = None,
    duration: float | str | None = None,
    sample_time: float | str | None = None,
    criterion: str = "worst",
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Design:
    """Design the next experiment for the machine that a parameter file describes.

    Parameters
    ----------
    document
        Parameter file, or what was read from it.
    amplitude, stroke
        Range of the driving role and of the output, in SI or as text with a unit; default: what
        the file's logs covered.
    rate
        Largest slope of the driving role [SI/s], likewise; default: no limit.
    duration, sample_time
        [s], likewise; default: those of the file's longest log.
    criterion
        ``"worst"`` (the largest relative standard error), ``"determinant"`` (the volume
        of the confidence ellipsoid), or the name of one parameter.
    seed
        Seed of the random shapes.
    progress
        Called with progress messages.

    Returns
    -------
    Design

    Raises
    ------
    ParameterFileError
        When the file is not valid.
    UsageError
        When a limit or the criterion is impossible, or no experiment can be designed.
    NotIdentifiedError
        When no excitation within the limits determines the parameters.
    """
    inputs: tuple[str, ...] = ()
    require("text", criterion=criterion)
    require("seed", seed=seed)
    require_given("function", progress=progress)
    duration, sample_time = (
        number_in_si(f"--{name}={shown(value)}", value or 0.0, ["s"])
        for name, value in (("duration", duration), ("sample-time", sample_time))
    )
    if not isinstance(document, ParameterDocument):
        require("path", document=document)
        inputs = (os.path.abspath(document),)
        document = read_document(document)
    limits = Limits(NOT_GIVEN, None, None, duration, sample_time)
    task = Task(document, limits, criterion, seed, progress or (lambda message: None))
    if any(limit is not None for limit in (amplitude, rate, stroke)):
        task = replace(task, given=_limits_in_si(task, amplitude, rate, stroke))
    task.check()
    kinds = {"command": design_command, "strokes": design_strokes, "points": design_points}
    found = kinds[task.excitation.kind](task)
    return replace(found, inputs=inputs, recorded_units=recorded_units(document))
