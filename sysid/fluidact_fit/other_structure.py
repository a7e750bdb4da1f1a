"""What a refused fit could be asked instead: a structure of the family that describes the logs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .assessment.policy import FIT_WEAK
from .document_assembly import FitContext
from .errors import FluidactError
from .estimation.budget import counting
from .experiment import Experiment
from .family import Family, FamilyOptions, Request, Variant
from .outcome import agreement
from .tables import percent_text


class OtherStructure(NamedTuple):
    """A structure one option away, and how well it describes the samples [%]."""

    fit_percent: float
    option: str

    @property
    def remedy(self) -> str:
        """What to do, as refusals say it."""
        percent = percent_text(self.fit_percent)
        return f"Try {self.option}: a model with it describes these logs (fit {percent})."


def find_other_structure(
    family: Family[FamilyOptions],
    variant: Variant,
    experiments: Sequence[Experiment],
    request: Request[FamilyOptions],
) -> OtherStructure | None:
    """Return the structure one option away that describes the samples of a refused fit best.

    A model that lacks a term may depend on its parameters nowhere: a mass shows nowhere where a
    spring was left out. What to record would be the wrong remedy. Structures that the family
    declares for this (:class:`.Structure`) and that differ in one option are fitted to the
    samples; ``None`` where none describes them.
    """
    return max(_fits(family, variant, experiments, request), default=None)


def _fits(
    family: Family[FamilyOptions],
    variant: Variant,
    experiments: Sequence[Experiment],
    request: Request[FamilyOptions],
) -> Iterator[OtherStructure]:
    """Structures one option away that describe the samples."""
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
            yield OtherStructure(percent, option)
