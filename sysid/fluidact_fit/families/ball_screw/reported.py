"""From what was fitted to what stands in the file: static levels in place of excesses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ...errors import Notice
from ...estimation.named_model import Values
from ...estimation.parametric import Fitted
from ...estimation.profile_likelihood import Interval
from ...estimation.results import Refusal, Solved, refuse
from ...family import ParameterSpec, Quantity, Variant
from .brackets import Bracket
from .model import BREAKAWAY, EXCESS, SIDES


def in_levels(fitted: Fitted) -> Fitted:
    """Turn ``excess`` into ``breakaway = coulomb + excess``; covariance and slopes follow."""
    level = {EXCESS[s]: BREAKAWAY[s] for s in SIDES}
    # what was held high enough to rest is written as nothing
    neutral = {n: float(fitted.specs[n].neutral or 0.0) for n in fitted.refused}
    known = {**fitted.values, **neutral}
    values = {n: v for n, v in known.items() if n not in level}
    turn = np.eye(len(fitted.names))
    for s in SIDES:
        kinetic, excess = f"coulomb_{s}", EXCESS[s]
        if excess in known:
            values[BREAKAWAY[s]] = known[kinetic] + known[excess]
        if {excess, kinetic} <= set(fitted.names):
            turn[fitted.names.index(excess), fitted.names.index(kinetic)] = 1.0
    back = np.linalg.inv(turn)
    # what was held in the fit is an excess, or high enough to rest; the file has its own table
    refusals = [replace(r, parameter=level.get(n, n), hold=None) for n, r in fitted.refused.items()]
    return replace(
        fitted,
        names=tuple(level.get(n, n) for n in fitted.names),
        values=values,
        refused={r.parameter: r for r in refusals},
        covariance=turn @ fitted.covariance @ turn.T,
        solution=replace(fitted.solution, jacobian=[j @ back for j in fitted.solution.jacobian]),
    )


def with_brackets(solved: Solved, brackets: Mapping[str, Bracket]) -> Solved:
    """Bracketed levels, which were held in the fit, among the estimates."""
    size = len(solved.names)
    found = {n: Interval(b.low, b.high, "bracket") for n, b in brackets.items()}
    covariance = np.diag([0.0] * size + [b.std_error**2 for b in brackets.values()])
    covariance[:size, :size] = solved.covariance
    return replace(
        solved,
        names=(*solved.names, *brackets),
        covariance=covariance,
        fixed={n: v for n, v in solved.fixed.items() if n not in brackets},
        intervals={**solved.intervals, **found},
    )


def specs_of_file(
    variant: Variant, values: Mapping[str, float], resting: Mapping[str, float]
) -> list[ParameterSpec]:
    """Parameters of the file; a static level that is not known has one all the same.

    The kinetic level is the least that it can be, and where nothing ever moved, the
    strongest push that the axis withstood (``resting``, by direction).
    """
    neutral = {BREAKAWAY[s]: max(values[f"coulomb_{s}"], resting.get(s, 0.0)) for s in SIDES}
    return [
        replace(spec, neutral=neutral.get(spec.name, spec.neutral)) for spec in variant.parameters
    ]


def refusal_notices(
    variant: Variant, refused: Mapping[str, Refusal], resting: Mapping[str, float]
) -> list[Notice]:
    """What was refused, in the words of the file."""
    written = dict.fromkeys(BREAKAWAY.values(), "the kinetic level")
    for s, push in resting.items():
        if push > 0.0:
            written[BREAKAWAY[s]] = "the strongest push that the axis withstood"
    return [refuse(variant.parameter(n), r.reason, written.get(n, "")) for n, r in refused.items()]


def derived_numbers(solved: Solved, inertia: str, unit: str) -> dict[str, Quantity]:
    """Offset and mean of the kinetic levels [``unit``], and the time constant of coasting."""
    coasts = solved.values.get("viscous", 0.0) > 0.0

    def function(v: Values) -> Values:
        forward, backward = (v[f"coulomb_{s}"] for s in SIDES)
        levels = {
            "coulomb_mean": 0.5 * (forward + backward),
            "coulomb_offset": 0.5 * (forward - backward),
        }
        return {**levels, "time_constant": v[inertia] / v["viscous"]} if coasts else levels

    units = {"coulomb_mean": unit, "coulomb_offset": unit, "time_constant": "s"}
    return solved.derive(units, function)
