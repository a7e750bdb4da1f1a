"""From a parameter file to the design of the next experiment."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING

from ..families import get_family
from .dynamic import design_dynamic
from .positions import design_positions
from .result import Design, Limits
from .strokes import design_strokes
from .task import make_task

if TYPE_CHECKING:
    from ..parameters import ParameterDocument


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
        Range of the driving role and of the output [SI]; what the file's logs covered.
    rate
        Steepest slope of the driving role [SI/s]; no limit.
    duration, sample_time
        [s]; those of the file's longest log.
    criterion
        ``"worst"`` (the largest relative standard error), ``"determinant"`` (the volume
        of the confidence ellipsoid), or the name of one parameter.
    seed
        For the random shapes.
    progress
        Called with a line of text now and then.

    Returns
    -------
    Design

    Raises
    ------
    ParameterFileError
        When the file is not valid.
    UsageError
        When a limit or the criterion cannot be, or the family cannot be designed for.
    NotIdentifiedError
        When no excitation within the limits determines the parameters.
    """
    from ..parameters import ParameterDocument, read_document

    if not isinstance(document, ParameterDocument):
        document = read_document(document)
    family = get_family(document.family)
    variant = next((v for v in family.variants if v.name == document.variant), family.variants[0])
    given = Limits(amplitude or (0.0, 0.0), rate, stroke, duration or 0.0, sample_time or 0.0)
    task = make_task(
        document, family, variant, given, criterion, seed, progress or (lambda message: None)
    )
    if task.drive.hold is not None:
        return design_dynamic(task)
    if task.drive.name in ("velocity", "position"):
        return design_strokes(task)
    return design_positions(task)
