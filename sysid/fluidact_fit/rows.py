"""Rows of long records that are not kept: they are made where they are asked for.

A record of 10^8 samples takes 0.8 GB for every array as long as it. Its instants, what a model
leaves of its output and the derivatives of it can be made again whenever some rows of them are
needed, block by block. What stands for them here takes slices like an array and is turned into one
by whatever else numpy does with it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from numpy.lib.mixins import NDArrayOperatorsMixin

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Array = npt.NDArray[Any]  # real, or complex where derivatives are taken by complex steps

BLOCK_ROWS = 1 << 15  # of a block: what is made of it stays in the cache
LONG = 1 << 20  # rows up to which a record is kept as an array; far more than a block
_SAMPLED = 32  # of so many blocks one suggests a bound
MOST_KEPT = 1 << 27  # numbers of a table that is slow to make, up to which it is kept
FEW_KEPT = 1 << 24  # of one that is made fast, and of which there are two at a time


def blocks(rows: int) -> Iterator[slice]:
    """Cut a record into blocks; a record no longer than one, or an empty one, is one."""
    for begin in range(0, max(rows, 1), BLOCK_ROWS):
        yield slice(begin, min(begin + BLOCK_ROWS, rows))


def is_long(rows: int) -> bool:
    """Return whether a record is too long for what can be made again to be kept."""
    return rows > LONG


def may_keep(numbers: int) -> bool:
    """Return whether a table of that many numbers may be kept although it can be made again."""
    return numbers <= MOST_KEPT


def may_keep_aside(numbers: int) -> bool:
    """Return whether so many may be kept that are made again nearly as fast."""
    return numbers <= FEW_KEPT


class Rows(NDArrayOperatorsMixin):
    """Stand-in for an array of many rows.

    ``cut(begin, end)`` makes some consecutive rows. A slice of few rows is an array, one of many
    stands for them in turn; a single row, or some columns, are as of an array.

    Parameters
    ----------
    shape
        Of the array, ``(n,)`` or ``(n, columns)``.
    """

    def __init__(
        self, shape: tuple[int, ...], cut: Callable[[int, int], Array], dtype: npt.DTypeLike = float
    ) -> None:
        self.shape, self.dtype, self.cut = shape, np.dtype(dtype), cut
        self.known: dict[str, Any] = {}  # what was computed of all rows

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    @property
    def size(self) -> int:
        """Number of numbers."""
        return int(np.prod(self.shape, dtype=np.int64))

    def __len__(self) -> int:
        return self.shape[0]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(np.asarray(self), name)  # whatever else an array has

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> Array:
        out = np.empty(self.shape, self.dtype if dtype is None else dtype, order="F")
        for at in blocks(len(self)):
            out[at] = self.cut(at.start, at.stop)
        return out

    def __reduce__(self) -> str | tuple[Any, ...]:
        return np.asarray(self).__reduce__()  # what makes the rows is not to be stored

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **how: Any) -> Any:
        whole = (np.asarray(x) if isinstance(x, Rows) else x for x in inputs)
        return getattr(ufunc, method)(*whole, **how)

    def __getitem__(self, at: Any) -> Any:
        if isinstance(at, tuple):
            rows, columns = at
            return self.mapped(lambda x: x[:, columns])[rows]
        if isinstance(at, int | np.integer):
            begin = range(len(self))[at]
            return self.cut(begin, begin + 1)[0]
        if isinstance(at, slice) and at.step in (None, 1):
            begin, end, _ = at.indices(len(self))
            return self._part(begin, max(begin, end))
        if isinstance(at, list | np.ndarray) and np.asarray(at).dtype.kind in "iu":
            found = [self[int(k)] for k in at] if np.size(at) < BLOCK_ROWS else np.asarray(self)[at]
            return np.array(found, dtype=self.dtype).reshape(np.shape(at) + self.shape[1:])
        return np.asarray(self)[at]

    def _part(self, begin: int, end: int) -> Array:
        if not is_long(end - begin):
            return self.cut(begin, end)
        shape = (end - begin, *self.shape[1:])
        return stand_in(Rows(shape, lambda a, b: self.cut(begin + a, begin + b), self.dtype))

    def mapped(self, change: Callable[[Array], Array]) -> Array:
        """Return the rows after ``change``, which takes and returns rows."""
        one = change(self.cut(0, min(1, len(self))))
        shape = (len(self), *one.shape[1:])
        return stand_in(Rows(shape, lambda a, b: change(self.cut(a, b)), one.dtype))


class _Even(Rows):
    """``first + k step`` from ``k = begin`` on; ``step`` is positive."""

    def __init__(self, first: float, step: float, begin: int, end: int) -> None:
        whole = isinstance(first, int) and isinstance(step, int)
        self.first, self.step, self.begin = first, step, begin
        super().__init__((end - begin,), self._cut, np.int64 if whole else np.float64)

    def _cut(self, begin: int, end: int) -> Array:
        out = np.arange(self.begin + begin, self.begin + end, dtype=self.dtype)
        if self.step != 1:
            out *= self.step
        out += self.first
        return out

    def _part(self, begin: int, end: int) -> Array:
        if not is_long(end - begin):
            return self._cut(begin, end)
        return stand_in(_Even(self.first, self.step, self.begin + begin, self.begin + end))

    def __getitem__(self, at: Any) -> Any:
        if isinstance(at, np.ndarray) and at.dtype.kind in "iu":
            k = np.where(at < 0, at + len(self), at)
            return (self.begin + k).astype(self.dtype) * self.step + self.first
        return super().__getitem__(at)

    def _at(self, k: Array) -> Array:
        """Values at some places, and infinities beyond the ends."""
        inside = (self.begin + np.clip(k, 0, len(self) - 1)).astype(self.dtype)
        found = inside * self.step + self.first
        return np.where(k < 0, -np.inf, np.where(k >= len(self), np.inf, found))

    def searchsorted(self, v: npt.ArrayLike, side: str = "left", sorter: None = None) -> Any:
        """As of an array; only places near the computed one are looked at."""
        wanted = np.asarray(v, dtype=np.float64)
        near = np.floor((wanted - self.first) / self.step) - self.begin
        k = np.clip(near, -1, len(self)).astype(np.int64)
        before = np.less if side == "left" else np.less_equal
        found = sum((before(self._at(k + j), wanted) for j in range(-1, 3)), start=k - 1)
        out = np.clip(found, 0, len(self))
        return out if wanted.ndim else int(out)


def stand_in(rows: Rows) -> Array:
    """Rows in the place of an array; numpy takes them for one."""
    return cast("Array", rows)


def is_kept(values: Array) -> bool:
    """Return whether an array is one."""
    return not isinstance(values, Rows)


def remembered(values: Array) -> dict[str, Any]:
    """Return the cache of what was computed over all rows of an array that is not kept."""
    return cast("Rows", values).known


def is_even(values: Array) -> bool:
    """Return whether values stand for an arithmetic sequence."""
    return isinstance(values, _Even)


def part_of(values: Array, begin: int, end: int) -> Array:
    """Some consecutive values; of an arithmetic sequence none is made yet."""
    if isinstance(values, _Even):
        return stand_in(_Even(values.first, values.step, values.begin + begin, values.begin + end))
    return values[begin:end]


def made(shape: tuple[int, ...], cut: Callable[[int, int], Array]) -> Array:
    """Rows as ``cut(begin, end)`` makes them; an array where they are few."""
    return stand_in(Rows(shape, cut)) if is_long(shape[0]) else cut(0, shape[0])


def evenly(first: float, step: float, count: int) -> FloatArray:
    """``first + k step``, shape ``(count,)``; of many they are made where they are asked for."""
    rows = _Even(float(first), float(step), 0, count)
    return stand_in(rows) if is_long(count) else rows.cut(0, count)


def counted(begin: int, end: int) -> npt.NDArray[np.integer[Any]]:
    """Whole numbers from one up to another; of many they are made where they are asked for."""
    rows = _Even(begin, 1, 0, max(end - begin, 0))
    return stand_in(rows) if is_long(end - begin) else np.arange(begin, end, dtype=np.int64)


def by_rows(change: Callable[..., Array], *tables: Array) -> Array:
    """Apply a function row by row to tables of equal length; results of long ones are not kept.

    It is an array where all tables are arrays, unless they are longer than what is kept.
    """
    n = len(tables[0])
    if not is_long(n) and all(map(is_kept, tables)):
        return change(*tables)
    shape = change(*(t[:1] for t in tables)).shape[1:]
    return stand_in(Rows((n, *shape), lambda a, b: change(*(t[a:b] for t in tables))))


class Streamed:
    """Consecutive tables as rows; they are made from the beginning for what lies further back.

    Those that follow one another are asked for by most: of these none is made twice.

    Parameters
    ----------
    make
        ``make()``: an iterator over consecutive tables, ``(m, columns)`` each.
    """

    def __init__(self, make: Callable[[], Iterator[Array]]) -> None:
        self._make = make
        self._restart()

    def _restart(self) -> None:
        self._tables, self._end = self._make(), 0
        self._last: list[tuple[int, Array]] = []  # with their first rows; a slice may begin before

    def cut(self, begin: int, end: int) -> Array:
        """Some rows."""
        if self._last and begin < self._last[0][0]:
            self._restart()
        while self._end <= begin or not self._last:
            self._advance()
        parts = [(first, table) for first, table in self._last if first + len(table) > begin]
        while self._end < end:
            parts.append(self._advance())
        some = [table[max(begin - first, 0) : max(end - first, 0)] for first, table in parts]
        return some[0] if len(some) == 1 else np.concatenate(some)

    def _advance(self) -> tuple[int, Array]:
        table = next(self._tables)
        made = self._end, table
        self._last, self._end = [*self._last[-1:], made], self._end + len(table)
        return made


def is_repeated(values: Array) -> bool:
    """Return whether an array stands for one row again and again."""
    return values.shape[0] > 1 and values.strides[0] == 0


def repeated(row: Array, count: int) -> Array:
    """One row again and again, shape ``(count, ...)``; it is kept once."""
    return np.broadcast_to(row, (count, *np.shape(row)))


def square_sum(values: FloatArray) -> float:
    """Sum of the squares of values of shape ``(n,)``."""
    if isinstance(values, Rows):
        if "squares" not in values.known:
            parts = (values[at] for at in blocks(len(values)))
            values.known["squares"] = sum(float(part @ part) for part in parts)
        return float(values.known["squares"])
    return float(values @ values)


def side_by_side(*columns: Array) -> Array:
    """Columns ``(n,)`` or ``(n, k)`` beside each other; each of them lies in one piece.

    Tables of few columns are written so in a third of the time that whole rows take.
    """
    return np.concatenate([x.T if x.ndim > 1 else x[None] for x in columns]).T


def upper_quantile(parts: Sequence[FloatArray], share: float) -> float:
    """Quantile of all values of some records, shape ``(n_i,)``, of which few lie above it.

    Of long records only those above a bound are gathered, which some of their blocks suggest.
    """
    if all(map(is_kept, parts)):
        return float(np.quantile(np.concatenate(parts), share))
    every = [(p, at) for p in parts for at in blocks(len(p))]
    some = np.concatenate([p[at] for p, at in every[::_SAMPLED]])
    count = sum(map(len, parts))
    place = (count - 1) * share
    for lower in (2.0, 8.0, np.inf):  # times as many as are wanted
        bound = np.quantile(some, max(1.0 - lower * (1.0 - share), 0.0))
        bound = bound if np.isfinite(lower) else -np.inf
        above = np.sort(np.concatenate([x[x >= bound] for x in (p[at] for p, at in every)]))
        first = int(place) - (count - above.size)  # of those above it
        if first >= 0:
            break
    low, high = above[first], above[min(first + 1, above.size - 1)]
    return float(low + (place - int(place)) * (high - low))


def median_of(parts: Callable[[], Iterator[FloatArray]]) -> float:
    """Median of all numbers of parts that are made as often as they are asked for; NaN of NaN.

    Only those near it are gathered, where they are many: within bounds that some parts suggest.
    """
    count = 0
    for part in parts():
        if np.isnan(part).any():
            return float("nan")
        count += part.size
    some = np.concatenate([p for k, p in enumerate(parts()) if k % _SAMPLED == 0])
    middle = (count - 1) // 2, count // 2
    for aside in (0.02, 0.2, np.inf):  # of all numbers
        low, high = -np.inf, np.inf
        if np.isfinite(aside):
            low, high = np.quantile(some, (0.5 - aside, 0.5 + aside))
        below, near = 0, list[FloatArray]()
        for part in parts():
            below += int(np.count_nonzero(part < low))
            near.append(part[(part >= low) & (part <= high)])
        found = np.sort(np.concatenate(near))
        if below <= middle[0] and middle[1] < below + found.size:
            break
    return float(np.mean([found[k - below] for k in middle]))


def ends_of(values: FloatArray) -> tuple[float, float]:
    """Smallest and largest value, shape ``(n,)``."""
    if is_kept(values):
        return float(values.min()), float(values.max())
    ends = [ends_of(values[at]) for at in blocks(len(values))]
    return min(low for low, _ in ends), max(high for _, high in ends)
