"""Clock times and dates as a time column: seconds since the first sample."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import date

import numpy as np

from ..errors import Notice
from ..experiment import FloatArray
from .layout import Cut
from .log import IntArray, name_lines
from .stamps import SECOND, Stamp, is_bare_clock, is_date, is_stamp, read_stamp

_COMMA = re.compile(r"^([^,]*\d\d:\d\d:\d\d),(\d{3})(?=,)")
_FILETIME = re.compile(r"\d{17,19}")  # units of 100 ns since 1601
_LONGEST = 2**62  # what is counted in ns, 146 years
_DAY = 86_400 * SECOND
_HOUR = 3_600 * SECOND


def find_clocks(rows: Sequence[Sequence[str]]) -> dict[int, int | None]:
    """Indices of the columns of clock times in some rows, each with that of its dates."""
    columns = list(zip(*rows))
    stamps = [k for k, cells in enumerate(columns) if _mostly(cells, is_stamp)]
    dates = [k for k in stamps if _mostly(columns[k], is_date)]
    out: dict[int, int | None] = {}
    for k in stamps:
        if k in dates:
            continue
        bare = _mostly(columns[k], is_bare_clock)
        out[k] = next((d for d in (k - 1, k + 1) if bare and d in dates), None)
    # Days alone are a time where there is nothing finer.
    return out or {k: None for k in dates if len(set(columns[k])) > 1}


def _mostly(cells: Sequence[str], is_so: Callable[[str], bool]) -> bool:
    return sum(map(is_so, cells)) > 0.6 * len(cells)


def join_fraction(lines: Sequence[str], cut: Cut) -> Cut:
    """Read ``12:00:00,123`` as one instant where commas separate the columns, too.

    Three digits behind every clock time are its milliseconds, if some begin with a nought.
    """
    if cut.delimiter != ",":
        return cut
    found = [_COMMA.match(line) for line in lines]
    parts = {m[2] for m in found if m is not None}
    if len(parts) < 3 or None in found or not any(part[0] == "0" for part in parts):
        return cut
    return replace(cut, width=cut.width - 1, tidy=_with_point)


def _with_point(line: str) -> str:
    return _COMMA.sub(r"\1.\2", line)


def read_clocks(
    columns: Mapping[int, Sequence[str]],
    clocks: Mapping[int, int | None],
    lines: IntArray,
    name: str,
) -> tuple[dict[int, FloatArray], list[Notice]]:
    """Turn columns of clock times into seconds since the first sample of them all.

    Parameters
    ----------
    columns
        Index to cells, ``n_rows`` each.
    clocks
        Index of a column of clock times to that of the column of its dates.
    lines
        Source line of every row, shape ``(n_rows,)``.
    name
        Name of the log, for notices.

    Returns
    -------
    tuple
        Index to seconds, shape ``(n_rows,)``, NaN where a cell is no clock time; and notices.
    """
    notices: list[Notice] = []
    read = {k: _nanoseconds(columns, k, dates, name, notices) for k, dates in clocks.items()}
    first = [next((v for v in values if v is not None), None) for values in read.values()]
    origin = min((v for v in first if v is not None), default=0)
    out = {}
    for k, found in read.items():
        values = [v if v is not None and abs(v - origin) < _LONGEST else None for v in found]
        known = np.array([v is not None for v in values], dtype=np.bool_)
        since: IntArray = np.array([v - origin for v in values if v is not None], dtype=np.int64)
        since = _go_on(since, lines[known], name, notices)
        out[k] = np.full(len(values), np.nan)
        out[k][known] = since / SECOND
    return out, notices


def _nanoseconds(
    columns: Mapping[int, Sequence[str]],
    clock: int,
    dates: int | None,
    name: str,
    notices: list[Notice],
) -> list[int | None]:
    """Instants of a column [ns], ``None`` where a cell is none."""
    cells: Sequence[str] = [cell.strip() for cell in columns[clock]]
    if _mostly([cell for cell in cells if cell], lambda cell: bool(_FILETIME.fullmatch(cell))):
        return [100 * int(cell) if _FILETIME.fullmatch(cell) else None for cell in cells]
    if dates is not None:
        cells = [f"{day.strip()} {cell}" for day, cell in zip(columns[dates], cells)]
    stamps = [read_stamp(cell) for cell in cells]
    slashed = {s.slashed for s in stamps if s is not None and s.slashed is not None}
    day_first = _day_first(slashed)
    if day_first is None:
        notices.append(
            Notice(
                "dates-doubtful",
                f"{name}: the dates of column #{clock + 1} ('{cells[0]}') may be day and month or "
                "month and day, and no row tells which; the column was not read. Export the "
                "dates as 2024-05-31.",
            )
        )
        return [None] * len(stamps)
    return [None if s is None else _instant(s, day_first) for s in stamps]


def _day_first(slashed: set[tuple[int, int, int]]) -> bool | None:
    """Whether the day stands first in such dates, ``None`` where they do not tell."""
    if len(slashed) <= 1 and all(max(a, b) <= 12 for a, b, _ in slashed):
        return True  # any day is as good as another
    orders = {True: [(y, b, a) for a, b, y in slashed], False: [(y, a, b) for a, b, y in slashed]}
    found = {order: _days(dates) for order, dates in orders.items()}
    known = [order for order, days in found.items() if days]
    if len(known) == 2:  # a log that passes midnight goes on with the next day
        known = [o for o in known if max(found[o]) - min(found[o]) == len(slashed) - 1]
    return known[0] if len(known) == 1 else None


def _days(dates: Sequence[tuple[int, int, int]]) -> list[int]:
    """Numbers of some days, nothing where one of them does not exist."""
    try:
        return [date(*d).toordinal() for d in dates]
    except ValueError:
        return []


def _instant(stamp: Stamp, day_first: bool) -> int | None:
    day = stamp.day
    if stamp.slashed is not None:
        a, b, year = stamp.slashed
        try:
            day = date(year, *((b, a) if day_first else (a, b))).toordinal()
        except ValueError:
            return None
    return (day or 0) * _DAY + (stamp.time or 0)


def _go_on(since: IntArray, lines: IntArray, name: str, notices: list[Notice]) -> IntArray:
    """Let a clock go on over midnight, and over the hour it is put back in autumn."""
    steps = np.diff(since)
    forward = steps[steps > 0]
    usual = int(np.median(forward)) if forward.size else 0
    midnight = (steps < -_DAY // 2) & (since.max(initial=0) - since.min(initial=0) <= _DAY)
    back = np.abs(steps + _HOUR - usual) <= max(2 * usual, SECOND)
    if midnight.any():
        since = since + _DAY * np.concatenate(([0], np.cumsum(midnight)))
        where = f"{name}, {name_lines(lines[1:][midnight])}"
        notices.append(
            Notice("clock-midnight", f"{where}: the clock passes midnight and was continued.")
        )
    back &= ~midnight
    if back.any():
        since = since + _HOUR * np.concatenate(([0], np.cumsum(back)))
        where = f"{name}, {name_lines(lines[1:][back])}"
        text = "the clock goes back by an hour, as at the end of summer time, and was continued"
        notices.append(Notice("clock-set-back", f"{where}: {text}."))
    return since
