"""From what was fitted to what stands in the file: static levels in place of excesses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...errors import Notice
from ...estimation.parametric import Fitted
from ...estimation.results import Solved, refuse
from ...experiment import FloatArray
from ...family import ParameterSpec, Quantity, Variant
from .brackets import Bracket
from .model import BREAKAWAY, EXCESS, SIDES, Axis


def excess_specs(variant: Variant) -> list[ParameterSpec]:
    """Specifications of the excesses, by which the fit knows the static levels."""
    return [replace(variant.parameter(BREAKAWAY[s]), name=EXCESS[s]) for s in SIDES]


def in_levels(fitted: Fitted) -> Fitted:
    """Turn ``excess`` into ``breakaway = coulomb + excess``; covariance and slopes follow."""
    level = {EXCESS[s]: BREAKAWAY[s] for s in SIDES}
    values = {n: v for n, v in fitted.values.items() if n not in level}
    turn = np.eye(len(fitted.names))
    for s in SIDES:
        if EXCESS[s] not in fitted.values:
            continue
        values[BREAKAWAY[s]] = fitted.values[f"coulomb_{s}"] + fitted.values[EXCESS[s]]
        if {EXCESS[s], f"coulomb_{s}"} <= set(fitted.names):
            turn[fitted.names.index(EXCESS[s]), fitted.names.index(f"coulomb_{s}")] = 1.0
    back = np.linalg.inv(turn)
    refusals = [replace(r, parameter=level.get(n, n)) for n, r in fitted.refused.items()]
    return replace(
        fitted,
        names=tuple(level.get(n, n) for n in fitted.names),
        values=values,
        refused={r.parameter: r for r in refusals},
        covariance=turn @ fitted.covariance @ turn.T,
        solution=replace(fitted.solution, jacobian=[j @ back for j in fitted.solution.jacobian]),
    )


@dataclass(frozen=True)
class Reported:
    """A finished fit as it stands in the file.

    Attributes
    ----------
    fitted
        In terms of the static levels.
    brackets
        Levels that were not fitted but lie between two commanded ones.
    withstood
        Strongest push [SI] in the directions in which no log ever moves.
    """

    variant: Variant
    fitted: Fitted
    brackets: Mapping[str, Bracket]
    withstood: Mapping[str, float]

    @property
    def solved(self) -> Solved:
        """Values and covariance, brackets among the estimates."""
        s, found = self.fitted, self.brackets
        size = len(s.names)
        covariance = np.diag([0.0] * size + [b.std_error**2 for b in found.values()])
        covariance[:size, :size] = s.covariance
        return replace(
            s,
            names=(*s.names, *found),
            covariance=covariance,
            fixed={n: v for n, v in s.fixed.items() if n not in found},
            intervals={**s.intervals, **{n: b.interval for n, b in found.items()}},
        )

    def specs(self) -> list[ParameterSpec]:
        """Parameters of the file; a static level that is not known has one all the same.

        The kinetic level is the least that it can be, and where nothing ever moved, the
        strongest push that the axis withstood.
        """
        neutral = {
            BREAKAWAY[s]: max(self.fitted.values[f"coulomb_{s}"], self.withstood.get(s, 0.0))
            for s in SIDES
        }
        return [
            replace(spec, neutral=neutral.get(spec.name, spec.neutral))
            for spec in self.variant.parameters
        ]

    def quantities(self) -> tuple[dict[str, Quantity], tuple[str, ...], FloatArray]:
        """Parameters with intervals; covariance and its order."""
        return self.solved.quantities(self.specs())

    def notices(self) -> list[Notice]:
        """What was refused, in the words of the file."""
        written = dict.fromkeys(BREAKAWAY.values(), "the kinetic level")
        for s, push in self.withstood.items():
            if push > 0.0:
                written[BREAKAWAY[s]] = "the strongest push that the axis withstood"
        return [
            refuse(self.variant.parameter(n), r.reason, written.get(n, ""))
            for n, r in self.fitted.refused.items()
        ]

    def derived(self, axis: Axis) -> dict[str, Quantity]:
        """Offset and mean of the kinetic levels, and the time constant of coasting."""
        unit = self.variant.role(axis.drive).unit
        coasts = self.fitted.values.get("viscous", 0.0) > 0.0

        def function(v: Mapping[str, Any]) -> dict[str, Any]:
            out = {
                "coulomb_mean": 0.5 * (v["coulomb_positive"] + v["coulomb_negative"]),
                "coulomb_offset": 0.5 * (v["coulomb_positive"] - v["coulomb_negative"]),
            }
            return {**out, "time_constant": v[axis.inertia] / v["viscous"]} if coasts else out

        units = {"coulomb_mean": unit, "coulomb_offset": unit, "time_constant": "s"}
        return self.solved.derive(units, function)
