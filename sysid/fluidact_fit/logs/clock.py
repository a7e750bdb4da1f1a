"""Clock times and dates as a time column: seconds since the first sample."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import date
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from ..errors import Notice
from ..experiment import FloatArray
from .layout import Cut
from .log import IntArray, name_lines
from .stamps import SECOND, Stamp, is_bare_clock, is_date, is_stamp, read_stamp
from .timecode import read_fourth

_COMMA = re.compile(r"^([^,]*\d\d:\d\d:\d\d),(\d{3})(?=,)")
FILETIME = re.compile(r"\d{17,19}")  # units of 100 ns since 1601
_FRACTION = re.compile(r":\d\d[.,](\d{1,9})")
_LONGEST = 2**62  # what is counted in ns, 146 years
_DAY = 86_400 * SECOND
_UNDATED = 365 * _DAY  # that clocks without a date do not reach
_EPOCH = date(1970, 1, 1).toordinal()
_HOUR = 3_600 * SECOND
_SET_BACK = {
    _HOUR: "the clock goes back by an hour, as at the end of summer time",
    12 * _HOUR: "the clock goes back by half a day, as one of twelve hours does",
}


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


class Clocks(NamedTuple):
    """Columns of clock times by their index: seconds, shape ``(n_rows,)``, and notices.

    ``doubts`` say why a column was not read, and below what to do. ``since`` are the instants that
    the seconds count from [ns since 1970, or since midnight without a date]: one for all with a
    date, another one for all others.
    """

    seconds: dict[int, FloatArray]
    notices: tuple[Notice, ...] = ()
    doubts: Mapping[int, str] = MappingProxyType({})
    since: Mapping[int, int] = MappingProxyType({})


def read_clocks(
    columns: Mapping[int, Sequence[str]],
    clocks: Mapping[int, int | None],
    lines: IntArray,
    name: str,
) -> Clocks:
    """Turn columns of clock times into seconds since the first sample.

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
    Clocks
        Seconds, NaN where a cell is no clock time.
    """
    notices: list[Notice] = []
    found = {k: _read_column(columns, k, dates) for k, dates in clocks.items()}
    for k, column in found.items():
        if column.doubt:
            text = f"{name}: column #{k + 1} was not read: {column.doubt}"
            text = f"{text} {column.remedy}"
            notices.append(Notice("dates-doubtful" if column.dates else "clock-doubtful", text))
        if column.days:
            notices.append(
                Notice(
                    "clock-of-days",
                    f"{name}: column #{k + 1} ('{columns[k][0]}') was read as days, hours, minutes "
                    "and seconds, as its last number shows.",
                )
            )
    read = {k: column.instants for k, column in found.items()}
    first = {k: next((v for v in values if v is not None), None) for k, values in read.items()}
    begun = {k: v for k, v in first.items() if v is not None}
    out, begins = {}, {}
    for k, instants in read.items():
        dated = abs(begun.get(k, 0)) > _UNDATED
        alike = (v for v in begun.values() if (abs(v) > _UNDATED) == dated)
        begins[k] = origin = min(alike, default=0) if k in begun else 0
        values = [v if v is not None and abs(v - origin) < _LONGEST else None for v in instants]
        known = np.array([v is not None for v in values], dtype=np.bool_)
        since: IntArray = np.array([v - origin for v in values if v is not None], dtype=np.int64)
        turn = _HOUR if found[k].hourless else _DAY
        since = _go_on(since, turn, lines[known], name, notices)
        out[k] = np.full(len(values), np.nan)
        out[k][known] = since / SECOND
    doubts = {k: f"{c.doubt}\n{c.remedy}" for k, c in found.items() if c.doubt}
    return Clocks(out, tuple(notices), doubts, begins)


class _Instants(NamedTuple):
    """Instants of a column [ns], ``None`` where a cell is none; why none was read, and what to do;
    whether the ``dates`` are why. A clock that is ``hourless`` starts again with every hour.
    """

    instants: list[int | None]
    doubt: str = ""
    remedy: str = ""
    dates: bool = False
    days: bool = False
    hourless: bool = False


def _read_column(columns: Mapping[int, Sequence[str]], clock: int, dates: int | None) -> _Instants:
    cells: Sequence[str] = [cell.strip() for cell in columns[clock]]
    if _mostly([cell for cell in cells if cell], lambda cell: bool(FILETIME.fullmatch(cell))):
        return _Instants([100 * int(c) if FILETIME.fullmatch(c) else None for c in cells])
    if dates is not None:
        cells = [f"{day.strip()} {cell}" for day, cell in zip(columns[dates], cells)]
    stamps, days, doubt = read_fourth([read_stamp(cell) for cell in cells])
    known = [s for s in stamps if s is not None]
    remedy = "Export it in seconds, or give --sample-time SECONDS."
    if doubt:
        return _unread(cells, doubt, remedy)
    if len(zones := {s.zone for s in known if s.time is not None}) > 1:
        listed = ", ".join(sorted(zone or "none" for zone in zones))
        return _unread(cells, f"name several zones ({listed})", remedy)
    if len({s.hourless for s in known}) > 1:
        return _unread(cells, "have an hour in some rows and none in others", remedy)
    slashed = {s.slashed for s in known if s.slashed is not None}
    day_first = _day_first(slashed)
    if day_first is None:
        doubt = "may be day and month or month and day, and no row tells which"
        found = _unread(cells, doubt, "Export the dates as 2024-05-31.")
        return found._replace(dates=True)
    instants = [None if s is None else _instant(s, day_first) for s in stamps]
    if _drops_zeros(cells, instants):
        return _unread(cells, "may have lost zeros of the fraction: '.5' before '.10'", remedy)
    return _Instants(instants, days=days, hourless=any(s.hourless for s in known))


def _drops_zeros(cells: Sequence[str], instants: Sequence[int | None]) -> bool:
    """Return whether fractions of a second have fewer digits where they are small: 5 ms as ``.5``.

    The clock then goes back within a second.
    """
    digits = [len(found[1]) if (found := _FRACTION.search(cell)) else 0 for cell in cells]
    pairs = zip(pairwise(instants), pairwise(digits), strict=True)
    return any(
        a is not None and b is not None and 0 < a - b < SECOND and 0 < before < after
        for (a, b), (before, after) in pairs
    )


def _unread(cells: Sequence[str], doubt: str, remedy: str) -> _Instants:
    shown = next((cell for cell in cells if cell), "")
    return _Instants([None] * len(cells), f"its instants, as '{shown[:40]}', {doubt}.", remedy)


def _day_first(slashed: set[tuple[int, int, int]]) -> bool | None:
    """Return whether the day stands first in such dates, ``None`` where they do not tell."""
    if len(slashed) <= 1 and all(max(a, b) <= 12 for a, b, _ in slashed):
        return True  # any day is as good as another
    years = {year for *_, year in slashed}
    if max(years) - min(years) > 1 or len({(a, b) for a, b, _ in slashed}) < len(slashed):
        return None  # of 24-05-31 and 24-06-01 the year stands first
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
    days = 0 if day is None else day - _EPOCH
    return days * _DAY + (stamp.time or 0)


def _go_on(
    since: IntArray, turn: int, lines: IntArray, name: str, notices: list[Notice]
) -> IntArray:
    """Let a clock go on over midnight (or the hour), and over the hour it is put back in autumn.

    ``turn`` is what it shows before it starts again [ns].
    """
    steps = np.diff(since)
    forward = steps[steps > 0]
    usual = int(np.median(forward)) if forward.size else 0
    over = (steps < -turn // 2) & (since.max(initial=0) - since.min(initial=0) <= turn)
    if over.any():
        since = since + turn * np.concatenate(([0], np.cumsum(over)))
        where = f"{name}, {name_lines(lines[1:][over])}"
        what = "midnight" if turn == _DAY else "the hour"
        notices.append(
            Notice("clock-midnight", f"{where}: the clock passes {what} and was continued.")
        )
    for size, text in _SET_BACK.items():
        back = (steps < 0) & (np.abs(steps + size - usual) <= max(2 * usual, SECOND)) & ~over
        if back.any() and usual < size // 2:
            since = since + size * np.concatenate(([0], np.cumsum(back)))
            where = f"{name}, {name_lines(lines[1:][back])}"
            notices.append(Notice("clock-set-back", f"{where}: {text}, and was continued."))
    return since
