"""What a refused fit could be asked instead: a structure of the family that describes the logs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from .assessment.policy import FIT_WEAK
from .document_assembly import FitContext
from .errors import FluidactError, NotIdentifiedError
from .estimation.price import counting
from .experiment import Experiment
from .family import Family, FamilyOptions, Request, Variant
from .outcome import agreement
from .tables import percent_text


def with_other_structure(
    error: NotIdentifiedError,
    family: Family[FamilyOptions],
    variant: Variant,
    experiments: Sequence[Experiment],
    request: Request[FamilyOptions],
) -> NotIdentifiedError:
    """Return the refusal of a fit with the one option that describes these samples, if any does.

    A model that lacks a term may depend on its parameters nowhere: a mass shows nowhere where a
    spring was left out. What to record would be the wrong remedy. Structures that the family
    declares for this (:class:`.Structure`) and that differ in one option are fitted to the samples.
    """
    found = max(_fits(family, variant, experiments, request), default=None)
    if found is None:
        return error
    percent, option = found
    return NotIdentifiedError(
        error.what, where=error.where, expected=error.expected, option=option,
        remedy=f"Try {option}: a model with it describes these logs (fit {percent_text(percent)})."
        f"\nOtherwise: {error.remedy}",
    )  # fmt: skip


def _fits(
    family: Family[FamilyOptions],
    variant: Variant,
    experiments: Sequence[Experiment],
    request: Request[FamilyOptions],
) -> Iterator[tuple[float, str]]:
    """How well structures one option away describe the samples [%], with that option."""
    for structure in family.structures:
        now = {name: getattr(request.options, name.replace("-", "_")) for name in structure.options}
        changed = {n: value for n, value in structure.options.items() if value != now[n]}
        if len(changed) != 1 or not structure.instead:
            continue
        ((name, value),) = changed.items()
        option = f"--{name}={value}"
        request.progress(f"trying {option}")
        options = replace(request.options, **{name.replace("-", "_"): value})
        other = replace(request, options=options)
        try:
            with counting(sum(e.samples for e in experiments)), np.errstate(all="ignore"):
                solution = family.estimate(variant, experiments, other)
            fitted = FitContext(family, variant, (), (), experiments, other, solution).fitted
        except (FluidactError, ArithmeticError, np.linalg.LinAlgError):
            continue
        percent = agreement(fitted).fit_percent
        if percent >= FIT_WEAK:
            yield percent, option
