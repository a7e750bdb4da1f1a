"""From a parameter file to the design of the next experiment."""

from __future__ import annotations

import os
from collections.abc import Callable

from ..control import read_document
from ..families import get_family
from ..parameters.document import ParameterDocument
from .command import design_command
from .points import design_points
from .result import Design, Limits
from .strokes import design_strokes
from .task import make_task


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
    if not isinstance(document, ParameterDocument):
        document = read_document(document)
    given = Limits(amplitude or (0.0, 0.0), rate, stroke, duration or 0.0, sample_time or 0.0)
    say = progress or (lambda message: None)
    task = make_task(document, get_family(document.family), given, criterion, seed, say)
    kinds = {"command": design_command, "strokes": design_strokes, "points": design_points}
    return kinds[task.excitation.kind](task)
