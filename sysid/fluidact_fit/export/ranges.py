"""Intervals of exact values with the errors of computed ones, in any arithmetic.

Every value carries its range and the largest error that the arithmetic can have given it. What
stands here hands on what operands carry, to the first order and beyond; what an arithmetic adds
after an operation is its own: :mod:`.rounding` for single precision, :mod:`.c.fixed_code` for
fixed point. The ranges of the arguments are cut into boxes, because the range of ``a - a`` over a
wide box is not zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..experiment import FloatArray
from ..routines import Routine
from ..routines.expression import Choose

_BOXES = {0: 1, 1: 4096, 2: 80, 3: 20, 4: 10}  # along each argument


@dataclass(frozen=True)
class Range:
    """Lowest and highest exact value, and largest error of the computed one; shape ``(boxes,)``.

    ``whole`` says that both are whole numbers, as those of a counter are.
    """

    low: FloatArray
    high: FloatArray
    error: FloatArray
    whole: bool = False

    @property
    def size(self) -> FloatArray:
        """Largest magnitude of the exact value."""
        return np.maximum(np.abs(self.low), np.abs(self.high))

    @property
    def reach(self) -> float:
        """Largest magnitude of the computed value over all boxes."""
        return float(np.max(self.size + self.error))

    def wider(self, error: float | FloatArray) -> Range:
        """After an operation that adds an error."""
        return replace(self, error=self.error + error, whole=False)

    def rounded(self, unit: float) -> Range:
        """After a last rounding of the computed value, relative to it.

        Whole numbers up to one over the unit need none.
        """
        if self.whole and self.reach <= 1.0 / unit:
            return self
        return self.wider(unit * (self.size + self.error))

    def hull(self) -> Range:
        """All boxes as one."""
        low, high, error = (
            np.array([float(end)]) for end in (self.low.min(), self.high.max(), self.error.max())
        )
        return Range(low, high, error, self.whole)


def plus(a: Range, b: Range) -> Range:
    """Sum."""
    return Range(a.low + b.low, a.high + b.high, a.error + b.error, a.whole and b.whole)


def minus(a: Range, b: Range) -> Range:
    """Difference."""
    return Range(a.low - b.high, a.high - b.low, a.error + b.error, a.whole and b.whole)


def times(a: Range, b: Range) -> Range:
    """Product."""
    ends = np.stack(np.broadcast_arrays(
        a.low * b.low, a.low * b.high, a.high * b.low, a.high * b.high))  # fmt: skip
    with np.errstate(invalid="ignore"):
        error = a.size * b.error + b.size * a.error + a.error * b.error
    error = np.where(np.isnan(error), np.inf, error)  # of an exact zero, or of no bound at all
    return Range(ends.min(axis=0), ends.max(axis=0), error, a.whole and b.whole)


def over(a: Range, b: Range) -> Range:
    """Quotient; without bounds where the divisor can be zero."""
    least = np.where(b.low > 0.0, b.low, np.where(b.high < 0.0, -b.high, 0.0)) - b.error
    with np.errstate(divide="ignore", invalid="ignore"):
        safe = np.where(least > 0.0, 1.0, np.inf)
        ends = np.stack(np.broadcast_arrays(
            a.low / b.low, a.low / b.high, a.high / b.low, a.high / b.high))  # fmt: skip
        low = np.where(least > 0.0, ends.min(axis=0), -np.inf)
        high = np.where(least > 0.0, ends.max(axis=0), np.inf)
        most = np.maximum(np.abs(low), np.abs(high))
        error = np.where(least > 0.0, (a.error + most * b.error) / np.abs(least), np.inf) * safe
    return Range(low, high, error)


def extreme(a: Range, b: Range, pick: str) -> Range:
    """Smaller (``min``) or larger one (``max``)."""
    better = np.minimum if pick == "min" else np.maximum
    low, high = better(a.low, b.low), better(a.high, b.high)
    a_below = a.high + a.error < b.low - b.error
    b_below = b.high + b.error < a.low - a.error
    only_a, only_b = (a_below, b_below) if pick == "min" else (b_below, a_below)
    error = np.select([only_a, only_b], [a.error, b.error], np.maximum(a.error, b.error))
    return Range(low, high, error, a.whole and b.whole)


def unary(function: str, x: Range) -> Range:
    """Function of one number."""
    if function == "neg":
        return Range(-x.high, -x.low, x.error, x.whole)
    if function == "abs":
        low = np.where((x.low <= 0.0) & (x.high >= 0.0), 0.0,
                       np.minimum(np.abs(x.low), np.abs(x.high)))  # fmt: skip
        return Range(low, x.size, x.error, x.whole)
    if function == "sqrt":
        low, high = np.sqrt(np.maximum(x.low, 0.0)), np.sqrt(np.maximum(x.high, 0.0))
        error = np.minimum(np.sqrt(x.error), x.error / np.maximum(low, 1e-300))
        return Range(low, high, error)
    with np.errstate(divide="ignore", over="ignore"):
        if function == "exp":
            low, high = np.exp(x.low), np.exp(x.high)
            return Range(low, high, high * np.expm1(x.error))
        least = np.maximum(x.low - x.error, 0.0)
        return Range(np.log(x.low), np.log(x.high), x.error / least)


def choose(e: Choose, sides: tuple[Range, Range], yes: Range, no: Range) -> Range:
    """One of two; where what is compared carries an error, also the other one."""
    relation = e.relation
    a, b = sides
    if relation in (">", ">="):
        a, b = b, a  # now it asks whether a lies below b
    slack = a.error + b.error
    strict = relation in ("<", ">")
    surely = a.high + slack < b.low if strict else a.high + slack <= b.low
    never = a.low - slack >= b.high if strict else a.low - slack > b.high
    jump = np.maximum(np.abs(yes.high - no.low), np.abs(no.high - yes.low))
    wrong = (slack > 0.0) & (not e.jumps)
    both = np.maximum(yes.error, no.error) + np.where(wrong, jump, 0.0)
    pick = [surely, never]
    return Range(
        np.select(pick, [yes.low, no.low], np.minimum(yes.low, no.low)),
        np.select(pick, [yes.high, no.high], np.maximum(yes.high, no.high)),
        np.select(pick, [yes.error, no.error], both),
        yes.whole and no.whole,
    )


def boxes(routine: Routine) -> dict[str, Range]:
    """Arguments in every combination of their parts; zero is an edge."""
    count = _BOXES.get(len(routine.arguments), 8)
    cuts = []
    for a in routine.arguments:
        edges = np.linspace(a.low, a.high, count + 1)
        if a.low < 0.0 < a.high:
            edges = np.unique(np.append(edges, 0.0))
        cuts.append((edges[:-1], edges[1:]))
    low = np.meshgrid(*(c[0] for c in cuts), indexing="ij")
    high = np.meshgrid(*(c[1] for c in cuts), indexing="ij")
    return {
        a.name: Range(x.ravel(), y.ravel(), np.zeros(x.size))
        for a, x, y in zip(routine.arguments, low, high)
    }
