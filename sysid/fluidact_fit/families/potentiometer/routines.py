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
    constant,
    maximum,
    minimum,
    polynomial,
)
from .calibration import Calibration
from .rational_bezier import power_coefficients

_HALVINGS = 30
_LEAST_BAND = 1e-6  # of the readings: what is turned by less is beyond single precision
_BRANCHES = ("curve", "falling")
_CALLED = {"m": "position", "rad": "angle", "Pa": "pressure", "N": "force", "N m": "torque"}


def _curve(t: Expression, points: FloatArray, weights: FloatArray, name: str) -> Expression:
    """Position at the place ``t``: one rational Bezier curve by ascending powers."""
    w = weights / weights.max()
    above = power_coefficients(w * (points - points[0])).tolist()
    below = power_coefficients(w).tolist()
    ratio = polynomial(above, t, f"{name}_above") / polynomial(below, t, f"{name}_below")
    return ratio + constant(f"{name}_first", points[0])


def _value(c: Calibration, t: Expression, share: Expression | None) -> Expression:
    found = [_curve(t, p, w, name) for (p, w), name in zip(c.curves, _BRANCHES)]
    if share is None:
        return found[0]
    return found[1] + share * (found[0] - found[1])


def _place(c: Calibration, reading: Expression) -> Expression:
    """Place of a reading in its range."""
    return (reading - constant("first", c.low)) * constant("per_span", 1.0 / (c.high - c.low))


def called(unit: str) -> str:
    """Name of a quantity in a unit in a controller's code."""
    return _CALLED.get(unit, "value")


def _inverse(c: Calibration, unit: str, directions: Argument | None, output: str) -> Routine:
    name = called(output)
    article = "an" if name[0] in "aeiou" else "a"
    draft = Draft("reading_at", f"Reading at {article} {name}, by halving the range.", unit)
    ends = np.array([[p[0], p[-1]] for p, _ in c.curves])
    wanted = draft.argument(Argument(name, output, name, float(ends.min()), float(ends.max())))
    share = None if directions is None else 0.5 + 0.5 * draft.argument(directions)
    value = _value(c, Name("place"), share)
    place = draft.solve(
        Solve("place", 0.0, 1.0, (), value, wanted,
              bool(ends[0, 1] >= ends[0, 0]), _HALVINGS)
    )  # fmt: skip
    return draft.returns(place * constant("span", c.high - c.low) + constant("first", c.low))


def routines_of(c: Calibration, unit: str, output: str = "m") -> Sequence[Routine]:
    """Return the routines; ``unit`` is that of the reading, ``output`` that of the reference."""
    reading = Argument("reading", unit, "raw reading", c.low, c.high)
    directions = None
    if len(c.curves) > 1:
        directions = Argument("direction", "1", "1 rising, -1 falling, 0 between", -1.0, 1.0)
    name = called(output)
    draft = Draft(name, f"{name.capitalize()} of a reading.", output)
    t = draft.let("place", _place(c, draft.argument(reading)))
    share = None
    if directions is not None:
        share = draft.let("share", 0.5 + 0.5 * draft.argument(directions))
    found = [draft.returns(_value(c, t, share))]
    if directions is not None:
        found.append(_tracking(c, reading, output))
    if c.monotone:
        found.append(_inverse(c, unit, directions, output))
    return found


def _tracking(c: Calibration, reading: Argument, output: str) -> Routine:
    """Position where the direction is found from the readings themselves."""
    about = f"{called(output).capitalize()} of the next reading; the direction is kept."
    draft = Draft("step", about, output)
    x = draft.argument(reading)
    last, state, begun = draft.state("last"), draft.state("state"), draft.state("begun")
    moved = draft.let("moved", choose(begun, ">", 0.0, x - last, 0.0))
    band = max(c.dead_band, _LEAST_BAND * (c.high - c.low))
    change = moved * constant("per_half_dead_band", 2.0 / band)
    draft.put(state, minimum(maximum(state + change, -1.0), 1.0))
    draft.put(last, x)
    draft.put(begun, 1.0)
    t = draft.let("place", _place(c, x))
    return draft.returns(_value(c, t, draft.let("share", 0.5 + 0.5 * state)))
