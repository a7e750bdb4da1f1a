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

from ..control import read_document
from ..parameter_table import recorded_units
from ..parameters import ParameterDocument
from ..specification import quotient_unit
from .command import design_command
from .points import design_points, speed_and_place
from .result import NOT_GIVEN, Candidate, Design, Forecast, Limits
from .strokes import design_strokes
from .task import Task

__all__ = ["Candidate", "Design", "Forecast", "Limits", "design", "limit_units"]


def limit_units(document: ParameterDocument) -> dict[str, str]:
    """Return the SI units of ``amplitude``, ``rate`` and ``stroke`` for a machine."""
    task = Task(document, Limits(NOT_GIVEN, None, None, 0.0, 0.0), "worst", 0, lambda _: None)
    drive, output = task.drive, task.output
    if task.excitation.kind == "strokes":
        drive, output = speed_and_place(task)
    return {
        "amplitude": drive.unit,
        "rate": quotient_unit(drive.unit, "s"),
        "stroke": output.unit,
    }


def design(
    document: ParameterDocument | str | os.PathLike[str],
    *,
    amplitude: tuple[float, float] | None = None,
    rate: float | None = None,
    stroke: tuple[float, float] | None = None,
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
        Range of the driving role and of the output [SI]; default: what the file's logs covered.
    rate
        Largest slope of the driving role [SI/s]; default: no limit.
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
    given = Limits(amplitude or NOT_GIVEN, rate, stroke, duration or 0.0, sample_time or 0.0)
    task = Task(document, given, criterion, seed, progress or (lambda message: None))
    task.check()
    kinds = {"command": design_command, "strokes": design_strokes, "points": design_points}
    found = kinds[task.excitation.kind](task)
    return replace(found, inputs=inputs, recorded_units=recorded_units(document))
