"""Curves of one number in fixed point: tables of int16 with straight lines between the entries.

A number in fixed point has at most 65,536 values, so that a table is made and its largest error is
found by going through all of them. Where the curve jumps or has a corner, at a comparison that
turns out the other way, one piece ends and the next begins.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ...experiment import FloatArray
from ...routines.evaluate import RELATIONS, value_of
from ...routines.expression import Binary, Choose, Expression, Unary, walk
from ..ranges import Range

Integers = npt.NDArray[np.int64]

WANTED = 2.0**-12  # of the range of a curve: error between the entries of a table
_CELLS = 256  # of a piece at most
_PIECES = 10


class NotFixed(Exception):
    """A routine that this fixed-point arithmetic cannot hold; the text says why."""


@dataclass(frozen=True)
class Piece:
    """Straight lines from ``first`` on, ``2**shift`` mantissas apart, at some entry of the table.

    ``shift`` is -1 for a single entry.
    """

    first: int
    last: int
    shift: int
    start: int
    cells: int


@dataclass(frozen=True)
class Table:
    """A curve over mantissas from the first of its pieces to the last.

    Attributes
    ----------
    entries
        Mantissas of the curve.
    exponent
        ``entries * 2**exponent`` are values.
    values
        The exact curve at every mantissa.
    error
        Largest difference of what the C code computes, over all mantissas.
    """

    pieces: tuple[Piece, ...]
    entries: tuple[int, ...]
    exponent: int
    values: FloatArray
    error: float


def exponent_for(reach: float, bits: int = 15) -> int:
    """Smallest ``e`` where ``reach`` rounds to at most ``2**bits - 1`` units of ``2**e``."""
    if reach == 0.0:
        return -bits
    e = int(np.frexp(reach)[1]) - bits
    return e + 1 if round(reach / 2.0**e) > 2**bits - 1 else e


def turns(
    expressions: Sequence[Expression], names: Mapping[str, FloatArray], size: int
) -> set[int]:
    """Places of ``size`` where a comparison turns out the other way than at the place before."""
    found: set[int] = set()
    for e in {p for whole in expressions for p in walk(whole)}:
        match e:
            case Choose():
                a, b, relation = e.a, e.b, e.relation
                holds = RELATIONS[relation](value_of(a, names), value_of(b, names))
            case Binary() if e.function in ("min", "max"):
                holds = np.less(value_of(e.a, names), value_of(e.b, names))
            case Unary() if e.function == "abs":
                holds = np.less(value_of(e.x, names), 0.0)
            case _:
                continue
        here = np.broadcast_to(holds, size)
        found.update((np.flatnonzero(here[1:] != here[:-1]) + 1).tolist())
    return found


def tabulate(first: int, values: FloatArray, corners: set[int], wanted: float = WANTED) -> Table:
    """Table of a curve whose value at the mantissa ``first + k`` is ``values[k]``."""
    ends = sorted(corners) if len(corners) < _PIECES else []
    limits = [0, *ends, values.size]
    allowed = wanted * float(np.ptp(values))
    nodes: list[float] = []
    pieces = []
    for start, stop in pairwise(limits):
        shift, heights = _nodes(values[start:stop], allowed, float(np.abs(values).max()))
        cells = len(heights) - 1
        pieces.append(Piece(first + start, first + stop - 1, shift, len(nodes), cells))
        nodes += heights
    exponent = exponent_for(float(np.abs(nodes).max()))
    entries = np.round(np.array(nodes) / 2.0**exponent).astype(np.int64)
    found = np.concatenate([_read(entries, p) for p in pieces])
    error = float(np.abs(found * 2.0**exponent - values).max())
    return Table(tuple(pieces), tuple(entries.tolist()), exponent, values, error)


def _nodes(values: FloatArray, allowed: float, largest: float) -> tuple[int, list[float]]:
    """Shift and heights of the fewest cells that are good enough; the last may end beyond."""
    span = values.size - 1
    if span == 0 or np.ptp(values) == 0.0:
        return -1, [float(values[0])]
    best = (np.inf, 1, [0.0])
    for shift in range(min(span.bit_length(), 16), -1, -1):
        step = 2**shift
        cells = span // step + 1
        if cells > _CELLS:
            break
        heights = values[::step].tolist()
        inside = max(span - (cells - 1) * step, 1)  # the last cell goes on beyond the curve
        heights.append(heights[-1] + (float(values[-1]) - heights[-1]) * step / inside)
        heights, off = _centred(values, heights, step)
        steepest = float(np.abs(np.diff(heights)).max())
        if shift > 0 and steepest > 0.999 * max(largest, float(np.abs(heights).max())):
            continue  # a difference of two entries has to be an int16
        if off < best[0]:
            best = (off, shift, heights)
        if off <= allowed:
            break
    if not np.isfinite(best[0]):
        raise NotFixed("a curve in it is too steep for a table")
    return best[1], best[2]


def _centred(values: FloatArray, heights: list[float], step: int) -> tuple[list[float], float]:
    """Heights moved so that a curve bends to both sides of its chords, and what is left."""
    place = np.arange(values.size)
    off = values - np.interp(place, np.arange(len(heights)) * step, heights)
    cells = place[::step]
    middle = 0.5 * (np.maximum.reduceat(off, cells) + np.minimum.reduceat(off, cells))
    moved = heights + 0.5 * (np.append(middle[0], middle) + np.append(middle, middle[-1]))
    left = values - np.interp(place, np.arange(len(heights)) * step, moved)
    return moved.tolist(), float(np.abs(left).max())


def _read(entries: Integers, p: Piece) -> Integers:
    """Compute as the C code of :meth:`.Sheet.lookup` does, for every mantissa of a piece."""
    u = np.arange(p.last - p.first + 1, dtype=np.int64)
    if p.shift < 0:
        return np.full(u.size, entries[p.start])
    cell = u >> p.shift
    part = (u << (16 - p.shift)) & 0xFFFF
    low, above = entries[p.start + cell], entries[p.start + cell + 1]
    return np.asarray(low + (((above - low) * part + 0x8000) >> 16))


def range_of(table: Table, place: Range, unit: float) -> Range:
    """Range of a table's curve over the boxes, with what an error of the place does to it."""
    first = table.pieces[0].first
    last = table.values.size - 1
    start = np.clip(np.floor(place.low / unit).astype(np.int64) - first, 0, last)
    stop = np.clip(np.ceil(place.high / unit).astype(np.int64) - first, 0, last)
    lows, highs = [table.values], [table.values]  # over windows of 1, 2, 4 ... places
    while 2 ** len(lows) <= table.values.size:
        half = 2 ** (len(lows) - 1)
        lows.append(np.minimum(lows[-1][:-half], lows[-1][half:]))
        highs.append(np.maximum(highs[-1][:-half], highs[-1][half:]))

    def extremes(start: Integers, stop: Integers) -> tuple[FloatArray, FloatArray]:
        level = np.floor(np.log2(stop - start + 1.0)).astype(int)
        low, high = np.empty(start.shape), np.empty(start.shape)
        for k in np.unique(level):
            at = level == k
            left, right = start[at], stop[at] - 2**k + 1
            low[at] = np.minimum(lows[k][left], lows[k][right])
            high[at] = np.maximum(highs[k][left], highs[k][right])
        return low, high

    low, high = extremes(start, stop)
    error = np.full(low.shape, table.error)
    off = place.error
    if off.max() > 0.0:
        reach = np.ceil(off / unit).astype(np.int64)
        wide = extremes(np.clip(start - reach, 0, last), np.clip(stop + reach, 0, last))
        places = np.arange(last + 1)
        most = int(reach.max())
        around = extremes(np.clip(places - most, 0, last), np.clip(places + most, 0, last))
        steepest = float(np.max(np.maximum(around[1] - table.values, table.values - around[0])))
        error = error + np.minimum(steepest, wide[1] - wide[0])
    return Range(low, high, error)
