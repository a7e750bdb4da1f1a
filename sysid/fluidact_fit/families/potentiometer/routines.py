"""A calibration as a controller runs it: two polynomials and a division."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...experiment import FloatArray
from ...routines import (
    Argument,
    Draft,
    Expression,
    Name,
    Routine,
    Solve,
    choose,
    maximum,
    minimum,
    polynomial,
)
from .calibration import Calibration
from .rational_bezier import power_coefficients

_HALVINGS = 30


def _curve(t: Expression, points: FloatArray, weights: FloatArray) -> Expression:
    """Position at the place ``t``: one rational Bezier curve by ascending powers."""
    w = weights / weights.max()
    above = power_coefficients(w * (points - points[0])).tolist()
    return polynomial(above, t) / polynomial(power_coefficients(w).tolist(), t) + float(points[0])


def _value(c: Calibration, t: Expression, share: Expression | None) -> Expression:
    found = [_curve(t, p, w) for p, w in c.curves]
    if share is None:
        return found[0]
    return found[1] + share * (found[0] - found[1])


def _inverse(c: Calibration, unit: str, directions: Argument | None) -> Routine:
    draft = Draft("reading_at", "Reading at a position, by halving the range.", unit)
    ends = np.array([[p[0], p[-1]] for p, _ in c.curves])
    wanted = draft.argument(
        Argument("position", "m", "position", float(ends.min()), float(ends.max()))
    )
    share = None if directions is None else 0.5 + 0.5 * draft.argument(directions)
    value = _value(c, Name("place"), share)
    place = draft.solve(
        Solve("place", 0.0, 1.0, (), value, wanted,
              bool(ends[0, 1] >= ends[0, 0]), _HALVINGS)
    )  # fmt: skip
    return draft.returns(place * (c.high - c.low) + c.low)


def routines_of(c: Calibration, unit: str) -> Sequence[Routine]:
    """Return the routines; ``unit`` is that of the reading."""
    reading = Argument("reading", unit, "raw reading", c.low, c.high)
    directions = None
    if len(c.curves) > 1:
        directions = Argument("direction", "1", "1 rising, -1 falling, 0 between", -1.0, 1.0)
    draft = Draft("position", "Position of a reading.", "m")
    t = draft.let("place", (draft.argument(reading) - c.low) * (1.0 / (c.high - c.low)))
    share = None
    if directions is not None:
        share = draft.let("share", 0.5 + 0.5 * draft.argument(directions))
    found = [draft.returns(_value(c, t, share))]
    if directions is not None:
        found.append(_tracking(c, reading))
    if c.monotone:
        found.append(_inverse(c, unit, directions))
    return found


def _tracking(c: Calibration, reading: Argument) -> Routine:
    """Position where the direction is found from the readings themselves."""
    draft = Draft("step", "Position of the next reading; the direction is kept.", "m")
    x = draft.argument(reading)
    last, state, begun = draft.state("last"), draft.state("state"), draft.state("begun")
    moved = draft.let("moved", choose(begun, ">", 0.5, x - last, 0.0))
    change = moved * (2.0 / max(c.dead_band, 1e-300))
    draft.put(state, minimum(maximum(state + change, -1.0), 1.0))
    draft.put(last, x)
    draft.put(begun, 1.0)
    t = draft.let("place", (x - c.low) * (1.0 / (c.high - c.low)))
    return draft.returns(_value(c, t, draft.let("share", 0.5 + 0.5 * state)))
