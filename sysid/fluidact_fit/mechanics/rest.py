"""A drive at rest: when a torque leaves the static band, and where a function becomes positive."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable

import numpy as np

from ..estimation.inputs import PiecewiseInput
from ..experiment import FloatArray

_ITERATIONS = 100  # of which few are needed
_ROUNDING = 2e-16  # of the values at the ends, which no iteration gets nearer to zero


def value_of(coefficients: FloatArray, offset: float) -> float:
    """Value of a polynomial with rising powers."""
    total = 0.0
    for c in reversed(coefficients.tolist()):
        total = total * offset + c
    return total


def slope_of(coefficients: FloatArray, offset: float) -> float:
    """Slope of a polynomial with rising powers."""
    return value_of(coefficients[1:] * np.arange(1, coefficients.size), offset)


class StaticBand:
    """Static levels against a torque: a drive rests while the torque lies between them.

    Parameters
    ----------
    torque
        Piecewise polynomial.
    positive, negative
        Static levels, magnitudes [N m or N].
    """

    def __init__(self, torque: PiecewiseInput, positive: float, negative: float) -> None:
        self.time, self.torque = torque.nodes, torque.coefficients
        self.upper, self.lower = max(positive, 0.0), -max(negative, 0.0)
        # intervals in which the torque leaves the band somewhere
        start = self.torque[:, 0]
        end = start if self.torque.shape[1] == 1 else np.append(start[1:], start[-1])
        high, low = np.maximum(start, end), np.minimum(start, end)
        self._hot: list[int] = np.flatnonzero((high > self.upper) | (low < self.lower)).tolist()

    def way(self, torque: float) -> int:
        """Direction in which a torque breaks the drive away; 0: it rests."""
        return int(torque > self.upper) - int(torque < self.lower)

    def leave(self, node: int, offset: float) -> tuple[int, float, int] | None:
        """Next break-away from an offset [s] behind a node: interval, offset and direction."""
        for k in range(bisect_left(self._hot, node), len(self._hot)):
            j = self._hot[k]
            if j >= self.time.size - 1:
                return None
            found = self._leave(j, offset if j == node else 0.0)
            if found is not None:
                return j, *found
        return None

    def _leave(self, j: int, begin: float) -> tuple[float, int] | None:
        """Find where the torque leaves the band inside interval ``j``, and in which direction."""
        c = self.torque[j]
        if way := self.way(value_of(c, begin)):
            return begin, way
        if c.size == 1:
            return None
        step = float(self.time[j + 1] - self.time[j])
        way = self.way(value_of(c, step))
        if not way:
            return None
        level = self.upper if way > 0 else self.lower
        if c.size == 2:
            return float((level - c[0]) / c[1]), way
        return rising_zero(lambda o: way * (value_of(c, o) - level), begin, step), way


def rising_zero(function: Callable[[float], float], low: float, high: float) -> float:
    """Find where a function becomes positive; an end where it already is, or does not.

    False position after Anderson and Bjoerck. Values that are rounding beside those at the ends
    are as good as zero.
    """
    kept, at = low, high
    before, value = function(kept), function(at)
    if before >= 0.0:
        return low
    if value <= 0.0:
        return high
    finest, rounding = 1e-15 * abs(high), _ROUNDING * max(-before, value)
    for _ in range(_ITERATIONS):
        if abs(value) <= rounding or abs(at - kept) <= finest:
            break
        after = at - value * (at - kept) / (value - before)
        now = function(after)
        if (now < 0.0) != (value < 0.0):
            kept, before = at, value
        else:  # the same end again: the other one counts less
            share = 1.0 - now / value
            before *= share if share > 0.0 else 0.5
        at, value = after, now
    return at
