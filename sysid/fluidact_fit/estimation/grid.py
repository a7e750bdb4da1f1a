"""Instants of a log: their steps, grouped into distinct lengths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..experiment import FloatArray

SAME_STEP = 1e-9  # steps closer than this share of the median step count as equal


@dataclass(frozen=True)
class Grid:
    """Steps between instants, grouped into distinct lengths.

    ``distinct`` has shape ``(g,)`` [s] and ``which`` shape ``(m,)``: step ``j`` has the
    length ``distinct[which[j]]``. Real log times are a grid plus rounding noise, so
    lengths within a billionth of the median are one.
    """

    instants: FloatArray
    distinct: FloatArray
    which: npt.NDArray[np.integer[Any]]

    @property
    def unit(self) -> float:
        """A typical step [s]."""
        if self.distinct.size < 2:
            return float(self.distinct[0]) if self.distinct.size else 1.0
        return float(np.median(self.distinct))


def group(lengths: FloatArray, unit: float) -> tuple[FloatArray, npt.NDArray[np.integer[Any]]]:
    """Group lengths that agree within a billionth of ``unit``; shapes as in `Grid`."""
    if lengths.size == 0:
        return np.zeros(0), np.zeros(0, dtype=np.intp)
    low, high = lengths.min(), lengths.max()
    if high - low <= SAME_STEP * unit:
        return np.array([lengths.mean()]), _all_first(lengths.size)
    _, first, which = np.unique(
        np.rint(lengths / (SAME_STEP * unit)), return_index=True, return_inverse=True
    )
    return lengths[first], which.astype(np.min_scalar_type(first.size))


def _all_first(count: int) -> npt.NDArray[np.integer[Any]]:
    """Of a grid of equal steps, without the memory for it."""
    return np.broadcast_to(np.intp(0), count)


def make_grid(instants: FloatArray) -> Grid:
    """Group the steps of a sequence of instants, shape ``(m + 1,)`` [s]."""
    steps = np.diff(instants)
    mean = float(instants[-1] - instants[0]) / max(steps.size, 1)
    if steps.size and float(np.ptp(steps)) <= 1e-6 * mean:
        # a snapped log: what is left is the rounding of t0 + k Ts
        return Grid(instants, np.array([mean]), _all_first(steps.size))
    distinct, which = group(steps, float(np.median(steps)) if steps.size else 1.0)
    return Grid(instants, distinct, which)
