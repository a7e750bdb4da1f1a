"""Refusals, parameters with intervals, and derived numbers of a fit of named parameters.

Every such fit ends here, however it was solved: by nonlinear search, regression or flow balances.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, TypeVar

import numpy as np

from ..errors import Notice, NotIdentifiedError
from ..experiment import FloatArray
from ..specification import ParameterSpec, Quantity, propagate
from ..units import after_number
from .profile_likelihood import Interval
from .uncertainty import t_quantile

S = TypeVar("S")
ANYTHING = 10.0  # relative half-width from which an interval is unbounded in practice
FEW_INDEPENDENT = 8.0  # independent samples per unknown, with fewer of which intervals fail


@dataclass(frozen=True)
class Refusal:
    """A parameter that the data cannot determine, and the reason.

    ``hold`` is the value at which it is held while the others are fitted, and which is written; the
    neutral value of its specification when ``None``. ``remedy`` replaces that of the specification
    where more of the same data would not help.
    """

    parameter: str
    reason: str
    hold: float | None = None
    remedy: str = ""

    def value(self, spec: ParameterSpec) -> float:
        """Value at which the parameter is held [SI]."""
        return float(self.hold if self.hold is not None else spec.neutral or 0.0) + 0.0  # no -0


def held_by(refusals: Iterable[Refusal]) -> dict[str, float]:
    """Values at which refused parameters are held, by name; 0 where nothing else is said."""
    return {r.parameter: float(r.hold or 0.0) for r in refusals}


def undetermined_error(spec: ParameterSpec, reason: str, remedy: str = "") -> NotIdentifiedError:
    """Error of a parameter that the data cannot determine; ``remedy`` replaces the usual one."""
    return NotIdentifiedError(
        f"the data cannot determine {spec.name}: {reason}",
        expected="Nothing was written.",
        remedy=remedy or spec.remedy,
    )


def refuse(spec: ParameterSpec, reason: str, written: str = "", remedy: str = "") -> Notice:
    """Make the warning for a parameter that is written without having been measured.

    ``written`` is the text of the value in the file where that is not the neutral one, ``remedy``
    replaces that of the specification.

    Raises
    ------
    NotIdentifiedError
        When the parameter has no neutral value to write.
    """
    if spec.neutral is None:
        raise undetermined_error(spec, reason, remedy)
    return Notice(
        "not-identified",
        f"{spec.name} cannot be determined from these data: {reason} "
        f"It is written as {written or f'{spec.neutral:g}{after_number(spec.unit)}'}, status "
        f"not_identified. {remedy or spec.remedy}",
    )


def _refusal_notice(refusal: Refusal, spec: ParameterSpec) -> Notice:
    written = f"{refusal.value(spec):.4g}{after_number(spec.unit)}"
    return refuse(spec, refusal.reason, written, refusal.remedy)


@dataclass(frozen=True)
class Determined(Generic[S]):
    """The last of a series of fits: the solution, the refusals by name, and their warnings."""

    solution: S
    refused: Mapping[str, Refusal]
    notices: list[Notice]


def determine(
    solve: Callable[[Mapping[str, float]], S],
    undetermined: Callable[[S], Sequence[Refusal]],
    specs: Mapping[str, ParameterSpec],
    *,
    fixed: Mapping[str, float],
    refusals: Sequence[Refusal] = (),
) -> Determined[S]:
    """Fit, refuse what the data cannot determine, and fit the rest again.

    Parameters
    ----------
    solve
        ``solve(held)`` fits everything but the parameters held at the given values [SI].
    undetermined
        Returns the parameters that a solution leaves undetermined: the most doubtful one, or
        several that belong together; empty when there are none.
    refusals
        Parameters known beforehand to be undetermined.

    Raises
    ------
    NotIdentifiedError
        When a parameter without a neutral value is undetermined.
    """
    refused = {r.parameter: r for r in refusals if r.parameter not in fixed}
    notices = [_refusal_notice(r, specs[r.parameter]) for r in refused.values()]
    while True:
        held = {n: r.value(specs[n]) for n, r in refused.items()}
        solution = solve({**held, **fixed})
        found = [r for r in undetermined(solution) if r.parameter not in refused]
        if not found:
            return Determined(solution, refused, notices)
        for r in found:
            notices.append(_refusal_notice(r, specs[r.parameter]))
            refused[r.parameter] = r


@dataclass(frozen=True)
class Solved:
    """Named values of a finished fit with their covariance, whichever solver found them.

    Attributes
    ----------
    values
        Every parameter, fixed and refused ones included [SI].
    names, covariance, degrees
        Values that were estimated, their covariance ``(p, p)`` and its degrees of freedom. Nuisance
        values of single logs, which are not parameters, may be among them.
    fixed, refused
        Values that the user fixed, and parameters that the data cannot determine.
    intervals
        Intervals that do not follow from the covariance.
    independent
        Number of independent samples that would show the size of the errors as well as the
        residuals did; infinite where those are white, or were not examined.
    """

    values: Mapping[str, float]
    names: tuple[str, ...]
    covariance: FloatArray
    degrees: int
    fixed: Mapping[str, float] = field(default_factory=dict)
    refused: Mapping[str, Refusal] = field(default_factory=dict)
    intervals: Mapping[str, Interval] = field(default_factory=dict)
    independent: float = np.inf

    def std_error(self, name: str) -> float:
        """Standard error of an estimated value."""
        k = self.names.index(name)
        return float(np.sqrt(max(self.covariance[k, k], 0.0)))

    def half_width(self, name: str) -> float:
        """Half-width of the 95 % interval of an estimated value."""
        return t_quantile(0.975, self.degrees) * self.std_error(name)

    def renamed(self, source: Mapping[str, str]) -> Solved:
        """Return the fit by other names: ``source`` maps each to the name it has here.

        Several names can stand for one value, such as two levels that are taken to be equal.
        """
        names = tuple(n for n, s in source.items() if s in self.names)
        rows = [self.names.index(source[n]) for n in names]
        values = {n: self.values[s] for n, s in source.items()}
        matrix = self.covariance[np.ix_(rows, rows)]
        return replace(self, values=values, names=names, covariance=matrix)

    def quantities(
        self, specs: Sequence[ParameterSpec], units: Mapping[str, str] | None = None
    ) -> tuple[dict[str, Quantity], tuple[str, ...], FloatArray]:
        """Return the parameters with intervals, the order of the covariance, and the covariance.

        Intervals are cut at the physical range: for a friction level ``[-1, 5]`` N means the same
        as ``[0, 5]`` N. ``units`` are those of the roles, on which some units depend.
        """
        out: dict[str, Quantity] = {}
        for spec in specs:
            if spec.name in self.values:
                out[spec.name] = self._quantity(spec, spec.unit_for(units or {}))
        # nuisance values of single logs stay behind: their rows are dropped, not conditioned on
        kept = [k for k, name in enumerate(self.names) if name in out]
        order = tuple(self.names[k] for k in kept)
        matrix = self.covariance[np.ix_(kept, kept)]
        return out, order, 0.5 * (matrix + matrix.T)  # symmetric in spite of rounding

    def _quantity(self, spec: ParameterSpec, unit: str) -> Quantity:
        name, value = spec.name, float(self.values[spec.name])
        if name in self.fixed:
            return Quantity(value, unit, "fixed")
        if name in self.refused:
            return Quantity(self.refused[name].value(spec), unit, "not_identified")
        error = self.std_error(name)
        found = self.intervals.get(name)
        if found is None:
            half = self.half_width(name)
            found = Interval(value - half, value + half, "wald")
        ends = [max(found.low, spec.minimum), min(found.high, spec.maximum)]
        return Quantity(value, unit, "estimated", error, ends, found.method)

    def derive(
        self,
        units: Mapping[str, str],
        function: Callable[[Mapping[str, Any]], Mapping[str, Any]],
    ) -> dict[str, Quantity]:
        """Compute derived numbers, with standard errors by the delta method.

        ``function`` is analytic in its values (see :func:`.propagate`); ``units`` are those of its
        results, by name.
        """
        found = propagate(function, self.values, self.names, self.covariance)
        return {
            key: Quantity(value, units[key], "derived", error)
            for key, (value, error) in found.items()
        }


def _interval(value: float, half: float, spec: ParameterSpec) -> str:
    """Describe a 95 % interval that is too wide."""
    unit = "" if spec.ratio else after_number(spec.unit)
    if half > ANYTHING * abs(value):
        return "anything: its 95 % interval is unbounded in practice"
    return f"{value:.3g} ± {half:.2g}{unit} (95 %), too wide to be useful"


def find_uninformative(
    solved: Solved,
    specs: Mapping[str, ParameterSpec],
    max_half_widths: Mapping[str, float],
) -> list[Refusal]:
    """Refuse the parameter with the least informative interval, if that interval is useless.

    ``max_half_widths`` holds the half-widths beyond which a 95 % interval is useless, by name; the
    parameter's own value where it is not listed, infinity for never.
    """
    worst, excess = "", 1.0
    for name in solved.names:
        if name not in specs:
            continue  # a nuisance value is not reported
        width = max_half_widths.get(name, max(abs(solved.values[name]), 1e-300))
        if not np.isfinite(width):
            continue
        half = solved.half_width(name)
        if not np.isfinite(half):
            return [Refusal(name, "the output does not depend on it anywhere in the logs.")]
        if half > width * excess:
            excess, worst = half / width, name
    if not worst:
        return []
    could_be = _interval(solved.values[worst], solved.half_width(worst), specs[worst])
    if solved.independent > FEW_INDEPENDENT * len(solved.names):
        return [Refusal(worst, f"it could be {could_be}.")]
    return [
        Refusal(
            worst,
            f"it could be {could_be}. The model misses the output by errors that change so slowly "
            f"that they are worth only about {max(solved.independent, 1.0):.0f} independent "
            "samples: something in the machine or a sensor is not in the model.",
            remedy="Look for another gain in the other direction, a leak, a drift or an offset: "
            "fit each direction, or a part of the logs, by itself (--window, --exclude). An output "
            "that accumulates what is missing, such as a position, shows less than its rate.",
        )
    ]
