"""Distinct readings of a record, and what was measured at each of them.

A converter gives few distinct readings, however many samples there are. How many of them a
reading has, their mean reference and its scatter say all that a curve can learn from them: for
any curve ``f``, ``sum (y - f)^2 = scatter + count (mean - f)^2``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from ...experiment import FloatArray

_PART = 1 << 22  # rows that are looked at at once


@dataclass(frozen=True)
class Readings:
    """Distinct readings in order, all of shape ``(m,)``.

    ``count`` says how many samples a ``reading`` has [its unit], ``mean`` is that of their
    reference [m] and ``scatter`` the sum of the squares of what they are beside it [m^2].
    """

    reading: FloatArray
    count: FloatArray
    mean: FloatArray
    scatter: FloatArray

    @classmethod
    def of(cls, reading: FloatArray, reference: FloatArray) -> Self:
        """Those of samples, shape ``(n,)`` [unit of the reading], [m].

        Parts are merged when they have grown alike, so that none is merged often.
        """
        tables: list[Self] = []
        for begin in range(0, reading.size, _PART):
            x, y = reading[begin : begin + _PART], reference[begin : begin + _PART]
            one, none = (np.broadcast_to(v, x.shape) for v in (1.0, 0.0))
            distinct, key = group(x)
            tables.append(cls(distinct, *_joined(key, one, y, none)))
            while len(tables) > 1 and tables[-2].reading.size < 2 * tables[-1].reading.size:
                last = tables.pop()
                tables[-1] = tables[-1].with_those(last)
        return reduce(cls.with_those, reversed(tables))

    def with_those(self, other: Self) -> Self:
        """Readings of two parts of a record as those of both."""
        pairs = list(zip(vars(self).values(), vars(other).values(), strict=True))
        reading, *values = (np.concatenate(both) for both in pairs)
        order = np.argsort(reading, kind="stable")  # quick, as both are in order
        reading = reading[order]
        new = np.append(True, reading[1:] > reading[:-1])
        key = np.empty(order.size, dtype=np.intp)
        key[order] = np.cumsum(new) - 1
        return type(self)(reading[new], *_joined(key, *values))


def _joined(
    key: npt.NDArray[np.intp], count: FloatArray, mean: FloatArray, scatter: FloatArray
) -> Iterator[FloatArray]:
    """Count, mean and scatter of all that share a key."""
    counts = np.asarray(np.bincount(key, count), dtype=float)
    means = np.asarray(np.bincount(key, count * mean) / counts)
    beside = mean - means[key]
    beside *= beside
    beside *= count
    beside += scatter
    yield from (counts, means, np.asarray(np.bincount(key, beside), dtype=float))


def group(values: npt.NDArray[Any]) -> tuple[FloatArray, npt.NDArray[np.intp]]:
    """Distinct values in order, and which of them each value is.

    Hashed: sorting the many equal readings of a converter takes several times longer.
    """
    from pandas import factorize

    key, distinct = factorize(values, sort=True)
    return distinct, key
