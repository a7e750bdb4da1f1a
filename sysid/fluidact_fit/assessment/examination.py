"""The examination of a finished fit: every test, in order, whichever estimator made the fit.

Its warnings, those given before, and the quality of the fit make the verdict (:mod:`.verdict`). To
test every fit for one more term, add it in :mod:`.terms`; to add another kind of test, add it here.
Thresholds stand in :mod:`.policy`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any

from ..errors import Notice
from ..family import Family, FamilyOptions, Solution, Variant
from ..outcome import Simulation
from .holds import find_other_holds
from .implausible import find_implausible, implausible_notices
from .independence import find_independent_samples
from .influence import (
    Outlier,
    find_deciding_samples,
    find_disagreeing_halves,
    find_outliers,
    measure_influence,
)
from .optimum import Optimum, make_optimum
from .residual_tests import (
    find_feedback,
    judge_channels,
    residual_to_noise,
    reversed_gains,
)
from .score_test import find_missing_response
from .sensitivity_to_given import find_conditional, find_reliance

_TESTS_OF_DERIVATIVES = {
    "independence": find_independent_samples,
    "parts": find_disagreeing_halves,
    "missing_response": find_missing_response,
    "given": find_reliance,
    "conditional": find_conditional,
}
_EXPLAINING = ("unmodelled-response", "halves-disagree")
_EXPLAINED = ("errors-change-slowly", "timing-matters")  # left out where one of those is given
_Add = Callable[[str, tuple[Any, list[Notice]]], None]


@dataclass(frozen=True)
class Examination:
    """Entries for the file, warnings, and outliers that are in the fit.

    ``outliers`` is ``None`` where one of them cannot be left out.
    """

    details: dict[str, Any]
    notices: list[Notice]
    outliers: list[Outlier] | None


def examine(
    family: Family[FamilyOptions],
    variant: Variant,
    solution: Solution[FamilyOptions],
    fitted: Sequence[Simulation],
    declared: Collection[str] = (),
) -> Examination:
    """Examine a finished fit.

    ``fitted`` are the runs simulated with the solution. ``declared`` are the roles whose hold the
    user has given: those are not questioned, unless the data contradict them.
    """
    details: dict[str, Any] = {}
    runs = [s.experiment for s in fitted]
    # first those that explain others: a number in another unit, a reversed column
    notices = implausible_notices(find_implausible(family, solution.options, variant, runs))
    notices += reversed_gains(variant, solution)

    def add(name: str, found: tuple[Any, list[Notice]]) -> None:
        if found[0] not in (None, {}):
            details[name] = found[0]
        notices.extend(found[1])

    timed = all(s.experiment.time.size for s in fitted)
    at = make_optimum(family, variant, solution, fitted)
    outliers: list[Outlier] | None = []
    if timed:
        if at is not None:
            add("intersample", find_other_holds(at, declared))
        add("cross_correlation", find_feedback(variant, solution, fitted, at))
        add("residual_to_noise", (residual_to_noise(family, solution, fitted), []))
    if at is not None:
        outliers = _examine_derivatives(at, add)
    add("channels", judge_channels(family, solution, fitted))
    if any(n.code in _EXPLAINING for n in notices):
        notices = [n for n in notices if n.code not in _EXPLAINED]
    return Examination(details, notices, outliers)


def _examine_derivatives(at: Optimum, add: _Add) -> list[Outlier] | None:
    """Run the tests that need derivatives; return the outliers as :class:`Examination` has them."""
    influence = measure_influence(at.jacobians, at.residuals, at.std_errors)
    add("influence", find_deciding_samples(at, influence))
    for name, test in _TESTS_OF_DERIVATIVES.items():
        add(name, test(at))
    return find_outliers(at, influence)
