"""Cells that are dates or times of day."""

from __future__ import annotations

import re
from datetime import date
from typing import NamedTuple

# Two digits of a year stand before a time of day; alone they may be a time (12.10.45).
_YEAR = r"\d{4}|\d\d(?=\s+\d+:)"
_DATE = (
    r"(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})"
    rf"|(?P<dd>\d{{1,2}})\.(?P<dm>\d{{1,2}})\.(?P<dy>{_YEAR})"
    rf"|(?P<a>\d{{1,2}})[/-](?P<b>\d{{1,2}})[/-](?P<c>{_YEAR})"
    rf"|(?P<nd>\d{{1,2}})[- ](?P<nm>[A-Za-zä]{{3}})[- ](?P<ny>{_YEAR})"
    r"|(?P<days>\d+) days?"
)
_CLOCK = (
    r"(?P<hour>\d{1,3}):(?P<minute>\d\d)(?::(?P<second>\d\d)(?:[.,:](?P<part>\d+))?)?"
    r"(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?"
)
_STAMP = re.compile(
    rf"(?:{_DATE})?(?:(?:^|T|\s+){_CLOCK})?\s*(?P<zone>Z|UTC|[+-]\d\d:?\d\d)?", re.ASCII
)
SECOND = 10**9
_MONTHS = {
    "jan": 1, "feb": 2, "mar": 3, "apr": 4, "may": 5, "jun": 6, "jul": 7, "aug": 8, "sep": 9,
    "oct": 10, "nov": 11, "dec": 12, "mär": 3, "mai": 5, "okt": 10, "dez": 12,
}  # fmt: skip
# How long since the start, as MATLAB writes it: 0.01 sec
_DURATION = re.compile(r"(?P<size>\d+(?:\.\d*)?) (?P<unit>ms|s|sec|min|hr)", re.ASCII)
_SIZES = {"ms": SECOND // 1000, "s": SECOND, "sec": SECOND, "min": 60 * SECOND, "hr": 3600 * SECOND}


class Stamp(NamedTuple):
    """Days since the year 1 (``None`` without a date) and time of day [ns].

    ``slashed`` are the two numbers of a date that may be day and month or month and day.
    """

    day: int | None
    time: int | None
    slashed: tuple[int, int, int] | None


def is_stamp(text: str) -> bool:
    """Return whether a cell is a date, a time of day with seconds, both, or a duration."""
    long = len(text) >= 7 or _DURATION.fullmatch(text) is not None
    return long and text[0].isdigit() and read_stamp(text) is not None


def is_date(text: str) -> bool:
    """Return whether a cell is a date without a time of day."""
    stamp = read_stamp(text)
    return stamp is not None and stamp.time is None


def is_bare_clock(text: str) -> bool:
    """Return whether a cell is a time of day without a date."""
    stamp = read_stamp(text)
    return stamp is not None and stamp.day is None and stamp.slashed is None


def read_stamp(text: str) -> Stamp | None:
    """Return what a cell says, ``None`` where it is no date and no time of day."""
    found = _STAMP.fullmatch(text)
    if found is None:
        since = _DURATION.fullmatch(text)
        return since and Stamp(None, round(float(since["size"]) * _SIZES[since["unit"]]), None)
    slashed = None if found["a"] is None else (int(found["a"]), int(found["b"]), _year(found["c"]))
    day = None
    try:
        if found["y"] is not None:
            day = date(int(found["y"]), int(found["m"]), int(found["d"])).toordinal()
        elif found["dy"] is not None:
            day = date(_year(found["dy"]), int(found["dm"]), int(found["dd"])).toordinal()
        elif found["nm"] is not None:
            day = date(
                _year(found["ny"]), _MONTHS[found["nm"].casefold()], int(found["nd"])
            ).toordinal()
        elif found["days"] is not None:
            day = int(found["days"])
    except (ValueError, KeyError):
        return None
    dated = day is not None or slashed is not None
    if found["hour"] is None:
        return Stamp(day, None, slashed) if dated and found["zone"] is None else None
    if found["second"] is None and not dated:
        return None  # "12:30" may be a ratio, or minutes and seconds
    hour, minute, second = (int(found[k] or 0) for k in ("hour", "minute", "second"))
    if found["half"]:
        hour = hour % 12 + 12 * (found["half"] in "pP")
    if (dated and hour > 24) or minute > 59 or second > 60:
        return None
    part = int((found["part"] or "0")[:9].ljust(9, "0"))
    time = ((hour * 60 + minute) * 60 + second) * SECOND + part
    return Stamp(day, time - _offset(found["zone"]), slashed)


def _year(digits: str) -> int:
    return int(digits) + (2000 if len(digits) == 2 else 0)


def _offset(zone: str | None) -> int:
    """How far a zone is ahead of UTC [ns]."""
    if zone is None or zone[0] in "ZU":
        return 0
    size = (int(zone[1:3]) * 60 + int(zone[-2:])) * 60 * SECOND
    return -size if zone[0] == "-" else size
