"""Columns with time bases of their own, as one table: every instant once, holes elsewhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import LogError
from ..experiment import BoolArray, FloatArray, IndexArray
from ..formats.sink import KEPT
from .layout import Counted, Group, Layout
from .log import IntArray

_OFTEN = 0.2  # share of empty cells that are no damage


@dataclass(frozen=True)
class Base:
    """Columns of one time base: instants, numbers and other cells of every column, and lines.

    Shape ``(n,)`` each; ``label`` is what messages call its time.
    """

    label: str
    instants: FloatArray
    values: Sequence[FloatArray]
    bad: Sequence[Mapping[int, str]]
    lines: IntArray


@dataclass(frozen=True)
class United:
    """Time and the columns of all bases, shape ``(n_instants,)`` each, their cells that are no
    numbers, and the line of every instant."""

    values: tuple[FloatArray, ...]
    bad: tuple[dict[int, str], ...]
    lines: IntArray


def sparse_columns(
    values: Sequence[FloatArray], bad: Sequence[Mapping[int, str]]
) -> frozenset[int]:
    """Columns with cells that are empty because nothing was sampled then, by their indices.

    Those that are often empty and hold nothing else but numbers, and those that are empty only
    where one of these is not: columns of different rasters, in rows of one time.
    """
    holes = {
        k: np.isnan(column)
        for k, column in enumerate(values)
        if bad[k] and not any(bad[k].values()) and np.isfinite(column).sum() > 1
    }
    often = {k for k, empty in holes.items() if empty.mean() >= _OFTEN}
    if not often:
        return frozenset()
    elsewhere = np.logical_or.reduce([~holes[k] for k in often])
    return frozenset(k for k, empty in holes.items() if k in often or elsewhere[empty].all())


def group_columns(names: Sequence[str], key: str) -> list[Group]:
    """Groups of a header that has the ``key`` above every column of time."""
    starts = [i for i, name in enumerate(names) if name == key]
    ends = [*starts[1:], len(names)]
    return [Group(tuple(range(a + 1, b)), a) for a, b in zip(starts, ends)]


def counted_groups(columns: Sequence[int], counted: Sequence[tuple[Counted, ...]]) -> list[Group]:
    """Groups of the columns whose instants are counted alike."""
    alike: dict[tuple[Counted, ...], list[int]] = {}
    for column, parts in zip(columns, counted, strict=True):
        alike.setdefault(parts, []).append(column)
    return [Group(tuple(members), None, parts) for parts, members in alike.items()]


def complete(fields: list[str], layout: Layout) -> list[str] | None:
    """A row of groups some of which have ended: filled up, ``None`` where a group is broken."""
    if len(fields) == layout.width:
        return fields
    ends = {0, *(group.columns[-1] + 1 for group in layout.groups)}
    filled = len(fields)
    while filled and not fields[filled - 1].strip():
        filled -= 1
    short = len(fields) < max(ends) and not ends & {filled, len(fields)}
    if short or len(fields) > layout.width:
        return None
    return fields + [""] * (layout.width - len(fields))


def merge(
    values: Sequence[FloatArray],
    bad: Sequence[Mapping[int, str]],
    lines: IntArray,
    layout: Layout,
    name: str,
) -> tuple[United, IndexArray]:
    """Put the instants of all groups in order; also returns the rows that hold no value.

    Parameters
    ----------
    values, bad
        Numbers and other cells of every column, shape ``(n_rows,)``.
    lines
        Source line of every row, shape ``(n_rows,)``.
    layout
        Its groups.
    name
        Name of the log, for messages.

    Raises
    ------
    LogError
        When a time is missing, or goes back where there are several.
    """
    used = np.zeros(lines.size, dtype=np.bool_)
    bases = []
    for group in layout.groups:
        rows = _rows_of(group, values, bad, lines, name)
        used[rows] = True
        place = {row: k for k, row in enumerate(rows.tolist())}
        bases.append(
            Base(
                f"column #{group.columns[0] + 1}",
                _instants(group, values, rows, lines),
                [values[c][rows] for c in group.columns],
                [{place[r]: t for r, t in bad[c].items() if r in place} for c in group.columns],
                lines[rows],
            )
        )
    return unite(bases, name), np.flatnonzero(~used)


def unite(bases: Sequence[Base], name: str) -> United:
    """Put columns of several time bases over every instant of theirs.

    Raises
    ------
    LogError
        When a time does not increase, unless it is that of all columns.
    """
    times, lines = [b.instants for b in bases], [b.lines for b in bases]
    places: list[IntArray] = [np.arange(times[0].size)] * len(bases)
    instants = times[0]
    if not all(np.array_equal(x, each[0]) for each in (times, lines) for x in each):
        for base in bases:
            require_order(base, name)
        instants, places = united(times)
    line_of = np.zeros(instants.size, dtype=np.int64)
    for base, place in zip(reversed(bases), reversed(places)):
        line_of[place] = base.lines
    values, texts = [instants], [dict[int, str]()]
    for base, place in zip(bases, places):
        for column, bad in zip(base.values, base.bad):
            spread = np.full(instants.size, np.nan)
            spread[place] = column
            values.append(spread)
            holes = np.flatnonzero(np.isnan(spread))[:KEPT].tolist()
            found = {int(place[row]): text for row, text in bad.items() if text}
            texts.append(dict.fromkeys(holes, "") | found)
    return United(tuple(values), tuple(texts), line_of)


def united(times: Sequence[FloatArray]) -> tuple[FloatArray, list[IndexArray]]:
    """Instants of several time bases, each once and in order, and the places of every base."""
    instants = np.unique(np.concatenate(times))
    return instants, [np.searchsorted(instants, time) for time in times]


def _rows_of(
    group: Group,
    values: Sequence[FloatArray],
    bad: Sequence[Mapping[int, str]],
    lines: IntArray,
    name: str,
) -> IndexArray:
    """Rows in which a group holds anything; refused where their time is missing."""
    held: BoolArray = np.zeros(lines.size, dtype=np.bool_)
    for column in group.columns:
        held |= np.isfinite(values[column])
        held[[row for row, text in bad[column].items() if text]] = True
    if group.time is None:
        return np.flatnonzero(held)
    timed = np.isfinite(values[group.time])
    if (held & ~timed).any():
        row = int(np.flatnonzero(held & ~timed)[0])
        raise LogError(
            f"column #{group.time + 1}, a time, holds '{bad[group.time].get(row, '')[:60]}'.",
            where=f"{name}, line {int(lines[row])}",
            expected=f"Expected the instant of columns #{group.time + 2} to "
            f"#{group.columns[-1] + 1}.",
            remedy="Export the recording again, or remove the line.",
        )
    return np.flatnonzero(timed)


def _instants(
    group: Group, values: Sequence[FloatArray], rows: IndexArray, lines: IntArray
) -> FloatArray:
    """Instants of the rows of a group, counted where they were not written."""
    if group.time is not None:
        return values[group.time][rows]
    begins = [part.line for part in group.counted]
    part = np.searchsorted(begins, lines[rows], side="right") - 1
    count = np.arange(rows.size) - np.searchsorted(part, part)
    start, step = (
        np.array([getattr(c, k) for c in group.counted])[part] for k in ("start", "step")
    )
    return np.round(start + count * step, 12)


def require_order(base: Base, name: str) -> None:
    """Refuse a base whose time does not increase (``LogError``)."""
    back = np.flatnonzero(~(np.diff(base.instants) > 0.0))
    if back.size:
        raise LogError(
            f"the time of {base.label} does not increase, and the columns of this log have times "
            "of their own.",
            where=f"{name}, line {int(base.lines[back[0] + 1])}",
            expected="Expected one recording, with time that increases in every group of columns.",
            remedy="Export every recording to a file of its own, or correct or remove the line.",
        )
