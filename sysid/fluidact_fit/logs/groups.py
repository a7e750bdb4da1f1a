"""Columns with time bases of their own, as one table: every instant once, holes elsewhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import LogError
from ..experiment import BoolArray, FloatArray, IndexArray
from .layout import Group, Layout
from .log import IntArray

_OFTEN = 0.2  # share of empty cells that are no damage
_MOST_HOLES = 5000  # as many as are kept of cells that are no numbers


@dataclass(frozen=True)
class Merged:
    """Time and the columns of all groups, shape ``(n_instants,)`` each, their cells that are no
    numbers, the line of every instant, and the rows that hold no value."""

    values: tuple[FloatArray, ...]
    bad: tuple[dict[int, str], ...]
    lines: IntArray
    empty: IndexArray


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
) -> Merged:
    """Put the instants of all groups in order.

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
    held = [_rows_of(group, values, bad, lines, name) for group in layout.groups]
    times = [_instants(group, values, rows, lines) for group, rows in zip(layout.groups, held)]
    used = np.zeros(lines.size, dtype=np.bool_)
    for rows in held:
        used[rows] = True
    same = all(
        np.array_equal(rows, held[0]) and np.array_equal(time, times[0])
        for rows, time in zip(held, times)
    )
    places: list[IntArray]
    if same:
        instants, places = times[0], [np.arange(times[0].size)] * len(held)
    else:
        for group, rows, time in zip(layout.groups, held, times):
            _require_order(group, rows, time, lines, name)
        instants, places = united(times)
    line_of = np.zeros(instants.size, dtype=np.int64)
    for rows, place in zip(reversed(held), reversed(places)):
        line_of[place] = lines[rows]
    out, texts = [instants], [dict[int, str]()]
    for group, rows, place in zip(layout.groups, held, places):
        for column in group.columns:
            spread = np.full(instants.size, np.nan)
            spread[place] = values[column][rows]
            out.append(spread)
            texts.append(_holes(spread, bad[column], rows, place))
    return Merged(tuple(out), tuple(texts), line_of, np.flatnonzero(~used))


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


def _require_order(
    group: Group, rows: IndexArray, time: FloatArray, lines: IntArray, name: str
) -> None:
    back = np.flatnonzero(np.diff(time) <= 0)
    if back.size:
        raise LogError(
            f"the time of column #{group.columns[0] + 1} does not increase, and the columns of "
            "this log have times of their own.",
            where=f"{name}, line {int(lines[rows[back[0] + 1]])}",
            expected="Expected one recording, with time that increases in every group of columns.",
            remedy="Export every recording to a file of its own.",
        )


def _holes(
    spread: FloatArray, bad: Mapping[int, str], rows: IndexArray, place: IndexArray
) -> dict[int, str]:
    """Cells of a column that are no numbers by instant; empty text where it has no sample."""
    out = {int(i): "" for i in np.flatnonzero(np.isnan(spread))[:_MOST_HOLES]}
    texts = {row: text for row, text in bad.items() if text}
    if texts:
        at = dict(zip(rows.tolist(), place.tolist()))
        out |= {at[row]: text for row, text in texts.items() if row in at}
    return out
