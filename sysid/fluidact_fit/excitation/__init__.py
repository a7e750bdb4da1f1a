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

from ..control import read_document
from ..errors import UsageError
from ..parameter_table import recorded_units
from ..parameters import ParameterDocument
from ..specification import quotient_unit
from ..units.quantities import in_si
from .command import design_command
from .points import design_points, speed_and_place
from .result import NOT_GIVEN, Candidate, Design, Forecast, Limits
from .strokes import design_strokes
from .task import Task

__all__ = ["Candidate", "Design", "Forecast", "Limits", "design"]


def _limits_in_si(task: Task, amplitude: Any, rate: Any, stroke: Any) -> Limits:
    """The limits of a task with those that were given (``UsageError`` for a wrong unit)."""
    drive, output = task.drive.unit, task.output.unit
    if task.excitation.kind == "strokes":
        drive, output = (role.unit for role in speed_and_place(task))
    return replace(
        task.given,
        amplitude=_in_si("--amplitude", amplitude, drive) or NOT_GIVEN,
        rate=_in_si("--rate", rate, quotient_unit(drive, "s")),
        stroke=_in_si("--stroke", stroke, output),
    )


def _in_si(option: str, value: Any, unit: str) -> Any:
    """A limit, or both ends of one, in SI (``UsageError``)."""
    if isinstance(value, tuple | list):
        return tuple(_in_si(option, end, unit) for end in value)
    try:
        return in_si(value, unit)
    except ValueError as error:
        raise UsageError(
            f"{option}={value}: {error}.",
            remedy=f"Give a number in {unit}, or with a unit of the same quantity.",
        ) from None


def design(
    document: ParameterDocument | str | os.PathLike[str],
    *,
    amplitude: tuple[float | str, float | str] | None = None,
    rate: float | str | None = None,
    stroke: tuple[float | str, float | str] | None = None,
    duration: float | None = None,
    sample_time: float | None = None,
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
        [s]; default: those of the file's longest log.
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
    if not isinstance(document, ParameterDocument):
        inputs = (os.path.abspath(document),)
        document = read_document(document)
    limits = Limits(NOT_GIVEN, None, None, duration or 0.0, sample_time or 0.0)
    task = Task(document, limits, criterion, seed, progress or (lambda message: None))
    if any(limit is not None for limit in (amplitude, rate, stroke)):
        task = replace(task, given=_limits_in_si(task, amplitude, rate, stroke))
    task.check()
    kinds = {"command": design_command, "strokes": design_strokes, "points": design_points}
    found = kinds[task.excitation.kind](task)
    return replace(found, inputs=inputs, recorded_units=recorded_units(document))
