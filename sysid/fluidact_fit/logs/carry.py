"""Two columns or numbers of which one counts what the other has counted to its end.

Seconds and nanoseconds, seconds and frames, minutes and seconds: how far the lower one counts shows
where the upper one goes up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..experiment import FloatArray

_REGULAR = 0.9  # of the steps; others are gaps, or where it starts again


@dataclass(frozen=True)
class Carry:
    """Carry of a lower counter into a higher one, give or take ``spread``."""

    base: float
    spread: float

    def is_at(self, base: float) -> bool:
        """Return whether it may count up to that."""
        return abs(self.base - base) <= self.spread


def find_carry(upper: FloatArray, lower: FloatArray) -> Carry | None:
    """Return how far the lower of two numbers counts, ``None`` where that does not show.

    ``upper`` and ``lower`` are whole numbers of shape ``(n,)``. The lower one has to grow while the
    upper one stays, and to fall wherever that goes up by one, always as far.
    """
    up, steps = np.diff(upper), np.diff(lower)
    inside, across = steps[up == 0], steps[up == 1]
    regular = inside.size + across.size >= _REGULAR * up.size
    if not (regular and inside.size and across.size) or inside.min() < 0 or across.max() >= 0:
        return None
    usual = float(np.median(inside))
    bases = usual - across
    base = float(np.median(bases))
    uneven = max(float(np.abs(bases - base).max()), float(np.quantile(np.abs(inside - usual), 0.9)))
    spread = uneven + 0.5
    return Carry(base, spread) if usual > 0 and spread < 0.5 * base else None
