"""What the routines of controllers are made of: arguments, filtered rates, limits, what is kept."""

from __future__ import annotations

from math import isfinite

import numpy as np

from ...routines import (
    Argument,
    Draft,
    Expression,
    Filter,
    Name,
    Routine,
    choose,
    constant,
    maximum,
    minimum,
)
from ...routines.routine import as_matrix
from ..filters import butterworth
from .base import Travel


def arguments(travel: Travel) -> tuple[Argument, Argument]:
    """Arguments of the controller; the ranges only exclude what cannot be true."""
    (low, high), role, unit = travel.reach, travel.role, travel.unit
    return (
        Argument("wanted", unit, f"wanted {role}", low, high, recorded=False),
        Argument(role, unit, f"measured {role}", low, high, recorded=False, measured=True),
    )


def rate(draft: Draft, name: str, value: Expression, cutoff: float, period: float) -> Name:
    """Rate of change of a value: difference, then the filter in the form of a state space."""
    last, begun = draft.state(f"{name}_last"), draft.state(f"{name}_begun")
    now = draft.let(f"{name}_of", value)
    before = draft.let(f"{name}_before", choose(begun, ">", 0.0, last, now))
    change = (now - before) * constant("per_sample_time", 1.0 / period)
    draft.put(last, now)
    draft.put(begun, 1.0)
    draft.interrupt(begun, 0.0)  # the next reading is a first one again
    b, a = butterworth(cutoff, period)
    matrix = np.array([[-a[1], 1.0], [-a[2], 0.0]])  # the transposed direct form
    return draft.filter(
        Filter(
            name, as_matrix(matrix - np.eye(2)), tuple((b[1:] - a[1:] * b[0]).tolist()),
            (0.0, 0.0), (1.0, 0.0), 0, change, float(b[0]),
        )
    )  # fmt: skip


def returned(draft: Draft, value: Expression, begins: float) -> Routine:
    """Keep what is returned, for calls that have nothing to compute from."""
    given = draft.state("given", begins)
    draft.put(given, value)
    return draft.returns(given)


def limited(value: Expression, limits: tuple[float, float]) -> Expression:
    """A value within limits, of which either may be infinite."""
    low, high = limits
    value = maximum(value, constant("lowest", low)) if isfinite(low) else value
    return minimum(value, constant("highest", high)) if isfinite(high) else value
