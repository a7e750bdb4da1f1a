"""Cells that are dates or times of day."""

from __future__ import annotations

import re
from datetime import date
from typing import NamedTuple

# Two digits of a year stand before a time of day; alone they may be a time (12.10.45).
_YEAR = r"\d{4}|\d\d(?=\s+\d+:)"
_DATE = (
    r"(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})"
    r"|(?P<oy>\d{4})-(?P<od>\d{3})"  # the day of the year
    rf"|(?P<dd>\d{{1,2}})\.(?P<dm>\d{{1,2}})\.(?P<dy>{_YEAR})"
    rf"|(?P<a>\d{{1,2}})[/-](?P<b>\d{{1,2}})[/-](?P<c>{_YEAR})"
    rf"|(?P<nd>\d{{1,2}})[- ](?P<nm>[A-Za-zä]{{3}})[- ](?P<ny>{_YEAR})"
    r"|(?P<days>\d+) days?"
)
_CLOCK = (
    r"(?P<hour>\d{1,3}):(?P<minute>\d{1,2})"
    r"(?::(?P<second>\d{1,2})(?:[:;](?P<fourth>\d{1,9}))?)?(?:[.,](?P<part>\d+))?"
    r"(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?"
)
_ZONE = r"Z|[+-]\d\d(?::?\d\d)?(?:\[[\w/+-]+\])?|[A-Z]{3,4}|[A-Z]\w+/[A-Z]\w+"
_STAMP = re.compile(rf"(?:{_DATE})?(?:(?:^|T|\s+){_CLOCK})?\s*(?P<zone>{_ZONE})?", re.ASCII)
# 20240501T115641.250, 20240501115641
_DIGITS = re.compile(r"^((?:19|20)\d\d)(\d\d)(\d\d)[T_ ]?(\d\d)(\d\d)(\d\d)(?!\d)", re.ASCII)
# Two numbers, of hours and minutes or of minutes and seconds.
PAIR = re.compile(r"\d{1,3}:\d\d", re.ASCII)
SECOND = 10**9
_MONTHS = {
    "jan": 1, "feb": 2, "mar": 3, "apr": 4, "may": 5, "jun": 6, "jul": 7, "aug": 8, "sep": 9,
    "oct": 10, "nov": 11, "dec": 12, "mär": 3, "mai": 5, "okt": 10, "dez": 12,
}  # fmt: skip
# How long since the start: 0.01 sec of MATLAB, PT1M0.5S of ISO 8601, T#1m_500ms of IEC 61131-3
_DURATION = re.compile(
    r"\d+(?:\.\d*)? (?:ms|s|sec|min|hr)"
    r"|(?i:(?:L?T(?:IME)?#|P(?=\d+D|T))(?P<minus>-?)(?:T?\d+(?:\.\d*)?(?:[mun]?s|[dhm])_?)+)",
    re.ASCII,
)
_PARTS = re.compile(r"(\d+(?:\.\d*)?) ?(ms|us|ns|sec|s|min|m|hr|h|d)", re.IGNORECASE)
_SIZES = {"ns": 1, "us": 10**3, "ms": 10**6, "s": SECOND, "m": 60 * SECOND, "h": 3600 * SECOND}
_SIZES |= {"sec": SECOND, "min": 60 * SECOND, "hr": 3600 * SECOND, "d": 86_400 * SECOND}
# Dates and times of day of IEC 61131-3: DT#2024-05-31-12:00:00.5, TOD#12:00:00, D#2024-05-31
_LITERAL = re.compile(
    r"(?i:L?DT|DATE_AND_TIME|L?TOD|TIME_OF_DAY|L?D|DATE)#(\d+-\d+-\d+)?-?(\d+:.*)?", re.ASCII
)

_TIME_NAME = re.compile(
    r"time|zeit|temps|tiempo|stamp|clock|elapsed|seconds|millis|micros|\b(?:date|datum|fecha)\b",
    re.I,
)
# What columns of time are called and no others, as far as is known.
_TIME_NAMES = frozenset({
    "t", "time", "times", "time stamp", "timestamp", "timestamps", "elapsed",
    "x value", "elapsed time", "time elapsed", "rel time", "relative time", "abs time",
    "absolute time", "run time", "log time", "sample time", "recording time", "system time",
    "time axis", "stamp", "ts", "simtime", "sim time", "simulation time", "row times", "rowtimes",
    "tout", "t out", "tsim", "datetime", "date time", "date/time", "sec", "secs", "second",
    "seconds", "msec", "millis", "milliseconds", "micros", "microseconds", "clock",
    "zeit", "zeiten", "zeitstempel", "zeitpunkt", "zeitachse", "uhrzeit", "messzeit", "laufzeit",
    "relativzeit", "abs zeit", "sek", "sekunde", "sekunden", "millisekunden",
    "temps", "horodatage", "secondes", "tiempo", "tiempos", "segundos", "tempo", "tempi",
    "secondi", "tijd", "tid", "czas", "\u65f6\u95f4", "\u6642\u9593", "\u6642\u523b",
})  # fmt: skip


class Stamp(NamedTuple):
    """Days since the year 1 (``None`` without a date) and time of day [ns].

    ``slashed`` are the two numbers of a date that may be day and month or month and day. ``zone``
    is its name, ``UTC`` where it says how far it is from that. A clock that is ``hourless`` shows
    minutes and seconds. With a ``fourth`` number of the clock, what the numbers mean is for the
    whole column to tell, and ``time`` is that of the first three as hours, minutes and seconds.
    """

    day: int | None
    time: int | None
    slashed: tuple[int, int, int] | None
    zone: str = ""
    hourless: bool = False
    fourth: tuple[str, ...] | None = None


def names_time(header: str) -> bool:
    """Return whether a column is called as columns of time are."""
    return _TIME_NAME.search(header) is not None


def is_time_name(name: str) -> bool:
    """Return whether a name, without a unit, is that of columns of time and of no others."""
    return " ".join(name.casefold().replace("_", " ").replace("-", " ").split()) in _TIME_NAMES


def is_stamp(text: str) -> bool:
    """Return whether a cell is a date, a time of day with seconds, both, or a duration."""
    if not text[:1].isdigit():
        return ("#" in text or text[:1] in ("P", "p")) and read_stamp(text) is not None
    long = len(text) >= 7 or ":" in text or _DURATION.fullmatch(text) is not None
    return long and read_stamp(text) is not None


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
    text = _DIGITS.sub(r"\1-\2-\3 \4:\5:\6", text)
    if (literal := _LITERAL.fullmatch(text)) is not None:
        text = " ".join(filter(None, literal.groups()))
    found = _STAMP.fullmatch(text)
    if found is None:
        since = _duration(text)
        return None if since is None else Stamp(None, since, None)
    slashed = None if found["a"] is None else (int(found["a"]), int(found["b"]), _year(found["c"]))
    try:
        day = _day(found)
    except (ValueError, KeyError):
        return None
    dated, zone = day is not None or slashed is not None, found["zone"]
    if found["hour"] is None:
        alone = dated and zone is None and found["oy"] is None  # "2024-123" may be any number
        return Stamp(day, None, slashed) if alone else None
    time = _time(found, dated)
    if time is None:
        return None
    numbers = (found["hour"], found["minute"], found["second"], found["fourth"], found["part"])
    return Stamp(
        day,
        time - _offset(zone),
        slashed,
        zone=_name_of(zone),
        hourless=found["second"] is None and not dated,
        fourth=None if found["fourth"] is None else tuple(n or "" for n in numbers),
    )


def _duration(text: str) -> int | None:
    """How long since the start [ns], ``None`` for other text."""
    found = _DURATION.fullmatch(text)
    parts = [] if found is None else _PARTS.findall(text)
    sizes = [_SIZES[unit.casefold()] for _, unit in parts]
    if found is None or sizes != sorted(set(sizes), reverse=True):
        return None
    since = sum(round(float(number) * size) for (number, _), size in zip(parts, sizes))
    return -since if found["minus"] else since


def _day(found: re.Match[str]) -> int | None:
    """Days since the year 1, ``None`` without a date that tells; ``ValueError``, ``KeyError``."""
    if found["y"] is not None:
        return date(int(found["y"]), int(found["m"]), int(found["d"])).toordinal()
    if found["oy"] is not None:
        first, number = date(int(found["oy"]), 1, 1), int(found["od"])
        if not 1 <= number <= 366:
            raise ValueError(number)
        return first.toordinal() + number - 1
    if found["dy"] is not None:
        return date(_year(found["dy"]), int(found["dm"]), int(found["dd"])).toordinal()
    if found["nm"] is not None:
        month = _MONTHS[found["nm"].casefold()]
        return date(_year(found["ny"]), month, int(found["nd"])).toordinal()
    return int(found["days"]) if found["days"] is not None else None


def _time(found: re.Match[str], dated: bool) -> int | None:
    """Time of day [ns], without a fourth number; ``None`` where it is none."""
    hour, minute, second = (int(found[k] or 0) for k in ("hour", "minute", "second"))
    part = int((found["part"] or "0")[:9].ljust(9, "0"))
    short = len(found["minute"]) < 2 or len(found["second"] or "00") < 2
    if found["second"] is None:
        if found["part"] is not None and not dated and not short:  # minutes and seconds
            return (hour * 60 + minute) * SECOND + part if minute <= 59 else None
        if not dated or found["part"] is not None:
            return None  # "12:30" may be a ratio, or minutes and seconds
    if short and found["fourth"] is None:
        return None
    if found["half"]:
        hour = hour % 12 + 12 * (found["half"] in "pP")
    if (dated and hour > 24) or minute > 59 or second > 60:
        return None
    time = ((hour * 60 + minute) * 60 + second) * SECOND
    return time if found["fourth"] is not None else time + part


def _year(digits: str) -> int:
    return int(digits) + (2000 if len(digits) == 2 else 0)


def _name_of(zone: str | None) -> str:
    """Name of a zone, ``UTC`` where the instant is known from it, empty without one."""
    return "UTC" if zone in ("Z", "GMT") or (zone or "")[:1] in ("+", "-") else zone or ""


def _offset(zone: str | None) -> int:
    """Offset of a zone ahead of UTC [ns], where it says so."""
    if zone is None or zone[0] not in "+-":
        return 0
    minutes = zone[3:].partition("[")[0].lstrip(":")
    size = (int(zone[1:3]) * 60 + int(minutes or 0)) * 60 * SECOND
    return -size if zone[0] == "-" else size
