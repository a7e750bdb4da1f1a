"""A time in two columns: whole seconds or a clock in one, parts of a second in another."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..errors import Notice
from ..experiment import BoolArray, FloatArray
from .counters import find_carry
from .log import Column, IntArray, Log

_WHOLE = "secs|sec|seconds|second|s"
_PARTS = {
    10**9: r"nsecs|nsec|nanose[ckg]\w*|nanos|ns",
    10**6: "usecs|usec|mi[ck]rose[ckg]\\w*|micros|us|\u00b5s|\u03bcs",
    10**3: r"msecs|msec|mill?ise[ckg]\w*|millis|ms",
}
_NAMED = re.compile(
    rf"(?P<of>.*?)[\W_]*(?<![^\W_])(?:(?P<whole>{_WHOLE})|"
    + "|".join(f"(?P<p{base}>{names})" for base, names in _PARTS.items())
    + r")[\W_]{0,3}",
    re.I,
)
_SECOND = 10**9  # ns
_LATEST = 2**33  # s, as int64 counts them in ns: the year 2242
_LONGEST = 200  # characters of a header that is looked at


def with_joined_time(log: Log) -> Log:
    """The log with every time of two columns in that of its seconds, counted from the first.

    Computed with whole numbers: nothing of a nanosecond is lost.
    """
    pairs = [p for p in _pairs(log.columns) if _belong_together(*p)]
    if not pairs:
        return log
    columns, notices = list(log.columns), []
    origin = int(min(_nanoseconds(*pair).min() for pair in pairs))
    for whole, part, base in pairs:
        seconds = np.full(whole.values.size, np.nan)
        seconds[_filled(whole, part)] = (_nanoseconds(whole, part, base) - origin) / _SECOND
        columns[whole.index - 1] = replace(
            whole, values=seconds, unit="s", clock=True, since=origin
        )
        columns[part.index - 1] = replace(part, part_of=whole.index)
        notices.append(
            Notice(
                "time-joined",
                f"{log.name}: columns #{whole.index} '{whole.header}' and #{part.index} "
                f"'{part.header}' are seconds and their fraction (1/{base}); they were joined to "
                f"one time, that of #{whole.index}.",
            )
        )
    return replace(log, columns=tuple(columns), notices=(*log.notices, *notices))


def _nanoseconds(whole: Column, part: Column, base: int) -> IntArray:
    """Instants of the rows that hold both numbers [ns]."""
    at = _filled(whole, part)
    seconds, rest = (c.values[at].astype(np.int64) for c in (whole, part))
    return seconds * _SECOND + rest * (_SECOND // base)


def _filled(whole: Column, part: Column) -> BoolArray:
    return np.isfinite(whole.values) & np.isfinite(part.values)


def _pairs(columns: Sequence[Column]) -> Iterator[tuple[Column, Column, int]]:
    """Columns that are called seconds, and a part of a second, of one thing."""
    clocks = [c for c in columns if c.clock and not c.doubt]
    whole: dict[str, list[Column]] = {}
    parts: dict[str, list[tuple[Column, int]]] = {}
    for column in columns:
        found = _NAMED.fullmatch(column.header) if len(column.header) < _LONGEST else None
        if found is None or column.clock:
            continue
        of = found["of"].casefold()
        if found["whole"]:
            whole.setdefault(of, []).append(column)
        else:
            base = next(base for base in _PARTS if found[f"p{base}"])
            parts.setdefault(of, []).append((column, base))
    for of in whole:
        if len(whole[of]) == len(parts.get(of, [])) == 1:
            yield whole[of][0], *parts[of][0]
    beside = [(part, base) for found in parts.values() for part, base in found]
    beside = [
        (part, base) for part, base in beside if any(part.index == c.index + 1 for c in clocks)
    ]
    if not whole and len(clocks) == len(beside) == 1:
        yield clocks[0], *beside[0]  # a clock of whole seconds, and their milliseconds


def _belong_together(whole: Column, part: Column, base: int) -> bool:
    """True if two columns are whole numbers, the second one a part of what the first counts."""
    if not all(map(_is_whole, (whole.values, part.values))):
        return False
    if np.nanmin(part.values) < 0 or np.nanmax(part.values) >= base:
        return False
    if np.nanmax(np.abs(whole.values)) > _LATEST:
        return False
    at = _filled(whole, part)
    upper, lower = whole.values[at], part.values[at]
    carry = find_carry(upper, lower)
    grows = np.diff(upper) * base + np.diff(lower)
    fits = not whole.clock if carry is None else carry.is_at(base)  # a clock may tell all itself
    return fits and bool(np.mean(grows > 0) > 0.5)


def _is_whole(values: FloatArray) -> bool:
    known = values[np.isfinite(values)]
    return known.size > 2 and bool(np.all(known == np.round(known)))
