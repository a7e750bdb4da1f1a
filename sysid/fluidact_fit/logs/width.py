"""Number of columns of a table whose header and rows differ in it.

The last columns may be empty in every row, as one for comments is: they are named, and their cells
may not even be written. Otherwise names that do not fit the cells are refused: nobody knows which
name is whose.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from ..errors import LogError
from ..units import SUFFIXES, looks_like_unit, parse_unit_from_header
from .layout import COMMENT, Cut, count_filled, says_nothing
from .log import count_of
from .stamps import is_time_name

_COMMAS = re.compile(r"\s*-?\d+,\d+\s*")
_DECIMAL_COMMA = re.compile(r"\s*(?:-?\d+,0\d+|-0,\d+)\s*")
_LONGEST_HEADER = 4000  # characters
_ROWS = 50  # that are looked at
_BRACKETED = re.compile(r"\[[^\]]*\]|\([^)]*\)")
_ABOVE = 3  # lines with text in which the names are looked for


def fit_header(lines: Sequence[str], start: int, body: Sequence[str], cut: Cut) -> tuple[Cut, int]:
    """The cut with as many columns as the header names, and how many of the last may be missing.

    Parameters
    ----------
    lines, start
        All lines, and the index of the first row.
    body
        Rows of the table.
    cut
        How they are cut.
    """
    if cut.delimiter == " " or cut.tidy is not None or cut.lead:
        return cut, 0
    cells = cut.width + cut.trailing
    rows = [row for row in map(cut.split, body) if len(row) >= cut.width]
    filled = max((count_filled(row) for row in rows), default=cells)
    for index in _above(lines, start):
        names = _names(lines[index], cut)
        count = len(names)
        if any(map(_is_unit, names)) and _is_longer(lines, start, index, cut, cells):
            continue  # where the last has no unit, the row of units is shorter than that of names
        if count == cut.width:
            return cut, 0
        longer = cut.width < count and any(len(row) == count for row in rows)
        if (names and filled <= count <= cells) or (names and longer):
            usual = min(filled, cut.width)
            trailing = cells > count
            return replace(cut, width=count, trailing=trailing), max(count - usual, 0)
    return cut, 0


def _is_unit(cell: str) -> bool:
    return bool(_BRACKETED.fullmatch(cell)) or looks_like_unit(cell)


def _is_longer(lines: Sequence[str], start: int, index: int, cut: Cut, cells: int) -> bool:
    """Return whether a row of names above another one, below which they are, has more of them."""
    above = [i for i in _above(lines, start) if i < index]
    return any(cut.width < len(_names(lines[i], cut)) <= cells for i in above[:1])


def refuse_other_names(lines: Sequence[str], start: int, cut: Cut, name: str) -> None:
    """Refuse a header right above the table whose names are more or fewer than the columns."""
    index = next(iter(_above(lines, start)), None)
    if cut.tidy is not None or index is None:
        return
    names, fewest = _names(lines[index], cut), 2
    if cut.delimiter == " ":  # where words of a remark may be as many as they like, but units not
        names, fewest = [cell for cell in cut.split(lines[index]) if cell], 1
        if not all(map(looks_like_unit, names)):
            return
    _refuse_commas(lines, start, index, cut, name)
    if len(names) < fewest or len(names) == cut.width:
        return
    parsed = [parse_unit_from_header(cell) for cell in names]
    units = sum(unit is not None for _, unit in parsed)
    timed = any(is_time_name(text) for text, _ in parsed)
    if not (timed or 2 * units >= len(names) or cut.delimiter == " "):
        return
    remedy = (
        "Correct the header (a separator within a name stands between quotes), or give "
        f"--skip-rows {index + 1} and name the columns by their numbers, --column ROLE=#N."
    )
    if cut.delimiter == "," and 0 <= 2 * len(names) - cut.width < len(names):
        remedy = (
            "The comma seems to separate columns and decimals alike, and nothing tells which is "
            "which: export the file with semicolons, or with decimal points."
        )
    raise LogError(
        f"{count_of(len(names), 'name')} above rows of {count_of(cut.width, 'cell')}: "
        f"{', '.join(names)[:120]}.",
        where=f"{name}, line {index + 1}",
        expected="Expected one name for every column.",
        remedy=remedy,
    )


def _refuse_commas(lines: Sequence[str], start: int, index: int, cut: Cut, name: str) -> None:
    """Refuse rows of ``13638,95`` below a single name: a column of decimals, or two of numbers."""
    names = [cell for cell in cut.split(lines[index]) if cell]
    rows = [line for line in lines[start : start + _ROWS] if line.strip()]
    named = len(names) == 1 and (_is_name(names[0], cut) or looks_like_unit(names[0]))
    if not named or not all(map(_COMMAS.fullmatch, rows)):
        return
    raise LogError(
        f"1 name above rows such as '{rows[0].strip()[:40]}', which may be one column or two.",
        where=f"{name}, line {index + 1}",
        expected="Expected one name for every column.",
        remedy="If the comma stands before decimals, give --decimal ','; if it separates, correct "
        f"the header, or give --skip-rows {index + 1}.",
    )


def refuse_units_above(lines: Sequence[str], start: int, cut: Cut, name: str) -> None:
    """Refuse a table without a header above which stand units of its columns, in another form.

    ``time(ms),force(kN)`` above rows with semicolons, ``# 1: time [ms]``. What has a unit behind a
    number is no name.
    """
    text = "\n".join(lines[i] for i in reversed(_above(lines, start)))[-_LONGEST_HEADER:]
    words = re.split(r"[\s;,|/:_()\[\]{}]+", text)
    units = [
        word
        for before, word in pairwise(words)
        if word in SUFFIXES and not before[:1].isdigit() and (len(word) > 1 or f"[{word}]" in text)
    ]
    if len(units) < 2 or 2 * len(units) < cut.width:
        return
    raise LogError(
        f"there is no header, but units stand above the first row: {', '.join(units[:4])}.",
        where=f"{name}, line {start + 1}",
        expected="Expected one name for every column, and the same separator in all lines.",
        remedy=f"Write the header so, or give --skip-rows {start} and name columns and units, "
        "--column ROLE=#N --unit ROLE=UNIT.",
    )


def refuse_decimal_commas(lines: Sequence[str], start: int, name: str) -> None:
    """Refuse rows of ``0,05`` and ``-0,5``: no second column counts with zeros before its digits.

    They are decimals of a single column, cut in two.
    """
    rows = [line for line in lines[start : start + _ROWS] if line.strip()]
    if not (all(map(_COMMAS.fullmatch, rows)) and any(map(_DECIMAL_COMMA.fullmatch, rows))):
        return
    raise LogError(
        f"rows such as '{rows[0].strip()[:40]}' may be one column or two.",
        where=f"{name}, line {start + 1}",
        expected="Expected another sign between columns than before decimals.",
        remedy="If the comma stands before decimals, give --decimal ','; if it separates, give "
        "--delimiter ','.",
    )


def _above(lines: Sequence[str], start: int) -> list[int]:
    """Indices of the nearest lines with text above the table."""
    return [i for i in range(start - 1, -1, -1) if lines[i].strip()][:_ABOVE]


def _names(line: str, cut: Cut) -> list[str]:
    """The cells of a line of names without empty ones at its end; empty for other lines."""
    cells = cut.split(COMMENT.sub("", line))
    cells = cells[: count_filled(cells)]
    words = [cell for cell in cells if cell]
    if len(words) < 2 or not all(_is_name(cell, cut) for cell in words):
        return []
    return cells


def _is_name(cell: str, cut: Cut) -> bool:
    return any(map(str.isalpha, cell)) and not says_nothing(cell) and not cut.is_value(cell)
