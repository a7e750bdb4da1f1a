"""Where the table of a log begins: below a preamble, and above every row.

A preamble may hold numbers, and a table damaged lines. What looks like a row is believed to be
one wherever it stands; rows are not given up because a line between them is damaged.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from enum import Enum

from .layout import Cut

# Numbers and signs that separate them, whichever: a row that lost its separators.
_NUMBERS = re.compile(r"(?=.*\d)[\d\s.,;|+\-eE]+")
_DATE = re.compile(r"\d+-\d+-\d+")
_ENOUGH = 3  # rows one below the other that no preamble holds by accident


class _Kind(Enum):
    ROW = 1  # as many cells as a row, all of them numbers
    DAMAGED = 2  # numbers, but too few cells, too many, or text among them
    BLANK = 3
    TEXT = 4


def find_start(lines: Sequence[str], cut: Cut, complete: bool) -> int | None:
    """Return the index of the line where the table begins, ``None`` without one.

    ``complete`` says whether the lines are all there are.
    """
    main = _longest_run(lines, cut, complete)
    if main is None:
        return None
    kinds = [_kind(line, cut) for line in lines[:main]]
    return _take_in_damaged(lines, kinds, _first_row(lines, kinds, main, cut), cut)


def _longest_run(lines: Sequence[str], cut: Cut, complete: bool) -> int | None:
    """Return the first line of the first run of rows that is not tiny beside the longest one."""
    # "key value" looks like half a row of two, so two columns have to be numbers both, unless
    # that finds nothing (a date beside a number).
    for needed in (0.5,) if cut.width > 2 else (1.0, 0.5):
        runs: list[list[int]] = []  # first line and number of rows
        in_run = False
        for index, line in enumerate(lines):
            if not line.strip():
                continue
            is_row = cut.is_row(line, needed)
            if is_row and in_run:
                runs[-1][1] += 1
            elif is_row:
                runs.append([index, 1])
            in_run = is_row
        if runs and (complete or in_run or sum(runs[-1]) >= len(lines) - 50):
            longest = max(length for _, length in runs)
            return next(i for i, length in runs if length >= max(1, min(50, 0.2 * longest)))
    return None


def _kind(line: str, cut: Cut) -> _Kind:
    """What a line above the table is."""
    if not line.strip():
        return _Kind.BLANK
    if cut.is_row(line, 1.0):
        return _Kind.ROW
    cells = cut.split(line)
    as_wide = len(cells) in (cut.width, cut.width + 1)
    numbers = sum(map(cut.is_value if as_wide else cut.is_number, cells))
    if (numbers and as_wide) or 2 * numbers > len(cells) or _NUMBERS.fullmatch(line):
        return _Kind.DAMAGED
    return _Kind.TEXT


def _names_columns(line: str, cut: Cut) -> bool:
    """Whether a line of text has as many cells as a row."""
    return len(cut.split(line)) in (cut.width, cut.width + 1)


def _first_row(lines: Sequence[str], kinds: Sequence[_Kind], start: int, cut: Cut) -> int:
    """Return the first row that belongs to the table that has a row at ``start``.

    Rows above belong to it where only damaged or empty lines lie between, where a header stands
    right above them, and where there are so many that they are no accident: a log that starts
    again, with its header or without.
    """
    first, run, broken = start, 0, False
    for index in range(start - 1, -1, -1):
        kind = kinds[index]
        if kind is _Kind.ROW:
            run += 1
            if not broken or run >= _ENOUGH:
                first, broken = index, False
            continue
        if kind is _Kind.TEXT:
            if run and _names_columns(lines[index], cut):
                first = index + 1
            broken = True
        run = 0
    if run and cut.width > 2 and not _names_columns(lines[run], cut):
        return 0  # the very first lines; numbers above the names count columns
    return first


def _take_in_damaged(lines: Sequence[str], kinds: Sequence[_Kind], start: int, cut: Cut) -> int:
    """Return the start after giving back damaged rows that look like a header or a preamble.

    A line with numbers in it, below one that names the columns or at the top of the file, is a
    row: its text has to be named, not swallowed. So are several, whatever stands above them.
    """
    first = start
    for index in range(start - 1, -1, -1):
        if kinds[index] not in (_Kind.DAMAGED, _Kind.ROW):
            named = kinds[index] is _Kind.TEXT and _names_columns(lines[index], cut)
            return first if named or start - first >= _ENOUGH else start
        cells = cut.split(lines[index])
        numbers = sum(map(cut.is_value, cells))
        plain = _NUMBERS.fullmatch(lines[index]) and not _DATE.fullmatch(lines[index].strip())
        if index == 0 and (plain or 2 * numbers > len(cells)):
            return 0
        first = index
        if numbers == len(cells) > 1:
            start = index  # no preamble holds several numbers and nothing else
    return first if start - first >= _ENOUGH else start
