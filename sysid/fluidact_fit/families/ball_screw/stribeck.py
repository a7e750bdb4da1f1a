"""Fall of friction from the static to the kinetic level: its search, and when no log shows it.

The speed of the curve is one more unknown of the position. It is sought on a grid after the static
levels, which are found as if friction fell at once; from then on it is fitted with the others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...estimation.problem import Unknown
from ...estimation.results import Refusal, Solved
from ...estimation.stribeck import EXPONENT, another_fall
from ...estimation.uncertainty import t_quantile
from ...experiment import Experiment, FloatArray
from ...family import FamilyOptions, Quantity, Request, Simulate, UnmodelledEffect
from .model import (
    BREAKAWAY,
    SIDES,
    SPEED,
    Axis,
    increments,
    leading_parts,
)
from .start import Stage, fastest, follow

_GRID = (0.003, 0.01, 0.03, 0.1, 0.3)  # of the fastest motion, where the search begins
_RANGE = (1e-4, 1.0)  # of the fastest motion, in which it goes on
_SEARCHED = 10_000  # samples of every log that the grid looks at
_LEAST_EXCESS = 0.2  # of the kinetic level, by which a static one begins above it
_FASTEST = 0.7  # of the fastest motion, below which the kinetic level shows
_KNOWN = 0.7  # of its own value, to which the speed has to be known


def with_curve(stage: Stage, request: Request[FamilyOptions]) -> Stage:
    """The stage with the speed of the curve among its unknowns, where a grid fits best."""
    axis, top = stage.axis, fastest(stage.experiments, stage.axis)
    low, high = request.bounds.get(SPEED, (_RANGE[0] * top, _RANGE[1] * top))
    names = (*stage.names, SPEED)
    unknowns = {**stage.unknowns, SPEED: Unknown(SPEED, low, high, 0.1 * top)}
    lively = sorted(stage.experiments, key=lambda e: -float(np.ptp(e[axis.motion])))[:2]
    part = leading_parts(lively, _SEARCHED)
    searched = replace(stage, experiments=part, names=names, unknowns=unknowns)
    least = {
        BREAKAWAY[s]: (1.0 + _LEAST_EXCESS) * stage.start[f"coulomb_{s}"]
        for s in stage.open_sides()
    }
    begin = {**stage.start, **{n: max(x, stage.start[n]) for n, x in least.items()}}
    speeds = [request.start[SPEED]] if SPEED in request.start else [r * top for r in _GRID]
    best, start = np.inf, stage.start
    for speed in speeds:
        first = searched.at({**begin, SPEED: float(np.clip(speed, low, high))})
        found, ended = first.solve(increments(part, axis), max_iterations=6)
        if found.cost < best:
            best, start = found.cost, ended.start
    return replace(stage, names=names, unknowns=unknowns, start=start)


def fall_of(axis: Axis, values: Mapping[str, float]) -> UnmodelledEffect:
    """Another fall of friction; the derivative goes through the events."""

    def response(
        experiments: Sequence[Experiment], simulate: Simulate
    ) -> list[dict[str, FloatArray]]:
        out = []
        for e in experiments:
            model, _, begun = follow(e, axis, values)
            _, by = model.slopes(0, {**begun, EXPONENT: 2.0}, [EXPONENT])
            out.append({axis.motion: -by[0]})
        return out

    return another_fall(response)


def undetermined(found: Solved, top: float, unit: str, level_unit: str) -> Refusal | None:
    """The speed of the curve, where the logs do not show it; ``top`` is the fastest motion.

    A fall that is not beyond doubt has a speed by chance only, whatever its own interval says.
    """
    if SPEED in found.refused:
        return found.refused[SPEED]
    if SPEED not in found.names:
        return None
    speed, half = found.values[SPEED], found.half_width(SPEED)
    t = t_quantile(0.975, found.degrees)
    falls = [(q.number, t * float(np.asarray(q.std_error))) for q in _falls(found, level_unit)]
    if falls and all(fall <= doubt for fall, doubt in falls):
        fall, doubt = max(falls)
        return Refusal(
            SPEED, "static friction is not above the kinetic one beyond doubt "
            f"({fall:.2g} ± {doubt:.2g} {level_unit})."
        )  # fmt: skip
    seen = f"{speed:.2g} ± {half:.2g} {unit}, the logs move at up to {top:.2g} {unit}"
    if not half < _KNOWN * speed:
        reason = f"friction that falls at once when the axis moves explains them as well ({seen})."
    elif not speed < _FASTEST * top:
        reason = f"the axis never moves so fast that only kinetic friction is left ({seen})."
    else:
        return None
    return Refusal(SPEED, reason)


def _falls(found: Solved, unit: str) -> list[Quantity]:
    """Excess of each estimated static level above its kinetic one [``unit``]."""
    sides = [s for s in SIDES if BREAKAWAY[s] in found.names]

    def function(v: Mapping[str, Any]) -> dict[str, Any]:
        return {s: v[BREAKAWAY[s]] - v[f"coulomb_{s}"] for s in sides}

    return list(found.derive(dict.fromkeys(sides, unit), function).values())


def without_level(stage: Stage) -> Refusal | None:
    """The speed of the curve, where no static level is known from which friction could fall."""
    reasons = [r.reason for r in stage.refusals if r.parameter in BREAKAWAY.values()]
    if len(reasons) < len(BREAKAWAY):
        return None
    return Refusal(SPEED, f"no static level is known from which friction could fall: {reasons[-1]}")
