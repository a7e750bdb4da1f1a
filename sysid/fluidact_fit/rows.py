"""Rows of long records: blocks that stay in the cache, and rows that are repeated."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Array = npt.NDArray[Any]  # real, or complex where derivatives are taken by complex steps

BLOCK_ROWS = 1 << 15  # of a block: what is made of it stays in the cache
LONG = 200_000  # samples, beyond which a part of a record is looked at where that tells as much


def blocks(rows: int) -> Iterator[slice]:
    """Cut a record into blocks; a record no longer than one, or an empty one, is one."""
    for begin in range(0, max(rows, 1), BLOCK_ROWS):
        yield slice(begin, min(begin + BLOCK_ROWS, rows))


def middle_of(samples: int, most: int = LONG) -> slice:
    """The middle of a long series, which shows its autocorrelation as well as the whole."""
    begin = max((samples - most) // 2, 0)
    return slice(begin, min(begin + most, samples))


def evenly(first: float, step: float, count: int) -> FloatArray:
    """``first + k step``, shape ``(count,)``."""
    return first + np.arange(count, dtype=np.float64) * step


def repeated(value: float, count: int) -> FloatArray:
    """One value again and again, shape ``(count,)``; it is kept once."""
    return np.broadcast_to(np.float64(value), count)


def square_sum(values: FloatArray) -> float:
    """Sum of the squares of values of shape ``(n,)``."""
    return float(values @ values)


def side_by_side(*columns: Array) -> Array:
    """Columns ``(n,)`` or ``(n, k)`` beside each other; each of them lies in one piece.

    Tables of few columns are written so in a third of the time that whole rows take. Where a
    single table has columns, it is not copied.
    """
    tables = [x.T if x.ndim > 1 else x[None] for x in columns]
    filled = [x for x in tables if len(x)] or tables[:1]
    return filled[0].T if len(filled) == 1 else np.concatenate(filled).T
