"""Clocks of four numbers, ``12:00:00:15``: what the last one counts shows in the whole column.

It may be a fraction of a second, frames of a video, or seconds behind days, hours and minutes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from .counters import find_carry
from .stamps import SECOND, Stamp

_FRAMES = 24, 25, 30, 50
_PARTS = {1_000: SECOND // 1_000, 1_000_000: SECOND // 1_000_000}
_Numbers = tuple[str, ...]


class Reading(NamedTuple):
    """Stamps whose ``time`` is final, and whether days come first; or why they cannot be read."""

    stamps: list[Stamp | None]
    days: bool = False
    doubt: str = ""


def read_fourth(stamps: Sequence[Stamp | None]) -> Reading:
    """Read the fourth numbers of a column of stamps; those without one are as they were."""
    numbers = [s.fourth for s in stamps if s is not None and s.fourth is not None]
    if not numbers:
        return Reading(list(stamps))
    fractions = any(n[4] for n in numbers)
    widths = {len(n[3]) for n in numbers}
    counted = np.array([[int(x or 0) for x in n[:4]] for n in numbers], dtype=np.float64).T
    first, second, third, last = counted
    carry = find_carry(np.cumsum(np.mod(np.diff(third, prepend=third[0]), 60.0)), last)
    if len(widths) == 1 and not fractions and (min(widths) >= 3 or last.max() >= 60):
        return _each(stamps, _fraction)  # digits that are filled up stand behind a point
    dated = any(s is not None and (s.day is not None or s.slashed is not None) for s in stamps)
    in_days = not dated and second.max() <= 23 and third.max() <= 59 and last.max() <= 59
    in_days = in_days and (carry is None or carry.is_at(60))
    # frames are counted up to 60 as well, but their hours have two digits
    widths_of_first = {len(n[0]) for n in numbers}
    rolled = (np.diff(first) == 1) & (second[:-1] == 23) & (second[1:] == 0)
    said = fractions or widths_of_first == {3} or bool(rolled.any())
    said = said or (carry is not None and 1 in widths_of_first)
    if in_days and said:
        return Reading(_each(stamps, _in_days).stamps, days=True)
    if fractions:
        return Reading([], doubt="are not times of day")
    if last.max() >= 100:
        size = next((size for base, size in _PARTS.items() if last.max() < base), 0)
        if size:
            return _each(stamps, lambda n: (None, _clock(*n[:3]) + int(n[3]) * size))
    if carry is not None and carry.is_at(100) and widths == {2}:
        return _each(stamps, _fraction)
    frames = [str(base) for base in _FRAMES if carry is not None and carry.is_at(base)]
    if frames:
        doubt = f"end with frames, {' or '.join(frames)} to a second, of a length that is not told"
        return Reading([], doubt=doubt)
    doubt = "may be days, hours, minutes and seconds, or hours, minutes, seconds and frames"
    return Reading([], doubt=f"{doubt} or a fraction")


def _each(
    stamps: Sequence[Stamp | None], read: Callable[[_Numbers], tuple[int | None, int]]
) -> Reading:
    """Stamps with day and time as they are read from their numbers."""
    out: list[Stamp | None] = []
    for stamp in stamps:
        if stamp is not None and stamp.fourth is not None:
            day, time = read(stamp.fourth)
            ahead = stamp.time - _clock(*stamp.fourth[:3]) if stamp.time is not None else 0
            stamp = stamp._replace(day=stamp.day if day is None else day, time=time + ahead)
        out.append(stamp)
    return Reading(out)


def _clock(hour: str, minute: str, second: str) -> int:
    return ((int(hour) * 60 + int(minute)) * 60 + int(second)) * SECOND


def _fraction(numbers: _Numbers) -> tuple[int | None, int]:
    return None, _clock(*numbers[:3]) + int(numbers[3][:9].ljust(9, "0"))


def _in_days(numbers: _Numbers) -> tuple[int | None, int]:
    part = int((numbers[4] or "0")[:9].ljust(9, "0"))
    return int(numbers[0]), _clock(*numbers[1:4]) + part
