"""Detection of where the table of a log begins, and of lines above it that look like rows.

Lines come in blocks: numbers here, text there. The table begins with the first block that can
hardly be of a preamble; what looks like a row above that is named, for somebody to judge.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from .layout import SAMPLE, Cut, says_nothing

# Numbers and signs that separate them, whichever: a row that lost its separators.
_NUMBERS = re.compile(r"(?=.*\d)[\d\s.,;|+\-eE]+")
_DATE = re.compile(r"\s*\d+-\d+-\d+\s*")
_SOME = 0.2
_ENOUGH = 3  # rows one below the other that no preamble holds by accident


class Start(NamedTuple):
    """Index of the first line of the table, and those of lines above that look like rows.

    ``entries`` are lines of a preamble right above the first line that are written as rows are.
    """

    first: int
    stray: tuple[int, ...]
    entries: tuple[int, ...] = ()


class _Block(NamedTuple):
    """Indices of consecutive lines with numbers: all, rows, and those of nothing but numbers."""

    lines: list[int]
    rows: list[int]
    plain: list[int]


def find_start(lines: Sequence[str], cut: Cut, complete: bool) -> Start | None:
    """Return where the table begins, ``None`` without one.

    ``complete`` says whether the lines are all there are.
    """
    # "key value" looks like half a row of two, so two columns have to be numbers both, unless
    # that finds nothing (a date beside a number).
    for needed in (0.5,) if cut.width > 2 else (1.0, 0.5):
        blocks = _blocks(lines, cut, needed)
        if any(b.rows for b in blocks) and (complete or blocks[-1].lines[-1] >= len(lines) - 50):
            return _choose(lines, blocks, cut)
    return None


def _blocks(lines: Sequence[str], cut: Cut, needed: float) -> list[_Block]:
    """Return the blocks; rows have at least the ``needed`` share of numbers."""
    blocks: list[_Block] = []
    inside = False
    for index, line in enumerate(lines):
        if not line.strip():
            continue
        whole = cut.is_row(line, 1.0)  # as most lines are, and then they are all the rest too
        is_row = whole or cut.is_row(line, needed)
        plain = whole or _is_plain(line)
        if (is_row or plain) and not inside:
            blocks.append(_Block([], [], []))
        inside = is_row or plain or (inside and holds_numbers(line, cut))
        if inside:
            block = blocks[-1]
            block.lines.append(index)
            block.rows.extend([index] * is_row)
            block.plain.extend([index] * plain)
    return blocks


def _is_plain(line: str) -> bool:
    """Return whether a line that is no whole row holds nothing but numbers, however separated."""
    return bool(_NUMBERS.fullmatch(line) and not _DATE.fullmatch(line))


def holds_numbers(line: str, cut: Cut) -> bool:
    """True if half of the cells of a line are numbers, or one where it is as wide as a row."""
    cells = cut.split(line)
    wide = _is_wide(cells, cut) and any(map(cut.is_value, cells)) and not is_entry(cells)
    return wide or 0 < 2 * sum(map(cut.is_number, cells)) >= len(cells)


def looks_like_row(line: str, cut: Cut) -> bool:
    """True if a line begins with a number, as those of a preamble do not, or holds mostly such.

    "Key value" of a preamble is half a row of two.
    """
    cells = cut.split(line)
    values = list(map(cut.is_value, cells))
    many = 2 * sum(values) > len(cells) - (len(cells) == cut.width > 2)
    return values[:1] == [True] or (_is_wide(cells, cut) and many and not is_entry(cells))


def is_entry(cells: Sequence[str]) -> bool:
    """Return whether a key stands before what is said of it: ``type: matrix``."""
    keys = [cell.endswith(":") for cell in cells]
    return any(keys[:-1]) and not all(keys)


def _is_wide(cells: Sequence[str], cut: Cut) -> bool:
    return len(cells) in (cut.width, cut.width + 1)


def _choose(lines: Sequence[str], blocks: Sequence[_Block], cut: Cut) -> Start:
    """Begin with the first block that is no preamble, and name the lines of those above it.

    That is one of several rows, one below a line that names the columns, and one at the top of the
    file, unless names stand below it: numbers above the names count the columns.
    """
    longest = max(blocks, key=lambda b: len(b.rows))
    worded = _worded(lines, longest, cut)
    enough = min(_ENOUGH, 0.2 * len(longest.rows))
    numbers_only = 2 * len(longest.plain) > len(longest.rows)  # a date with text is then no row
    stray: list[int] = []
    for block in blocks:
        above = next((s for s in reversed(lines[: block.lines[0]]) if s.strip()), "")
        below = next((s for s in lines[block.lines[-1] + 1 :] if s.strip()), "")
        at_top = not above and cut.width > 2 and not _names_columns(below, cut)
        certain = block.plain and (at_top or _names_columns(above, cut))
        usual = block.plain or not numbers_only or len(block.rows) >= _ENOUGH
        usual = usual and any(_words(lines[i], cut) <= worded for i in block.rows)
        if block.rows and (certain or (usual and len(block.rows) >= enough)):
            first = _below_entries(lines, block, worded, cut)
            return Start(first, tuple(stray), tuple(i for i in block.lines if i < first))
        stray += [i for i in block.lines if block.plain and i >= block.plain[0]]
    raise AssertionError("the longest block is one of several rows")


def _worded(lines: Sequence[str], block: _Block, cut: Cut) -> set[int]:
    """Columns that hold words in some of the rows, as a preamble does before its numbers."""
    rows = block.rows[:SAMPLE]
    counts = Counter(column for i in rows for column in _words(lines[i], cut))
    return {column for column, count in counts.items() if count > _SOME * len(rows)}


def _words(line: str, cut: Cut) -> set[int]:
    """Columns in which a line holds a word: more letters than digits, and one of them first."""
    return {
        column
        for column, cell in enumerate(cut.split(line))
        if cell[:1].isalpha()
        and 2 * sum(map(str.isalpha, cell)) > sum(map(str.isalnum, cell))
        and not says_nothing(cell)
    }


def _below_entries(lines: Sequence[str], block: _Block, worded: set[int], cut: Cut) -> int:
    """First line of a block without the entries of a preamble, which an empty line ends."""
    first = block.lines[0]
    for before, index in zip(block.lines, block.lines[1:]):
        if _words(lines[before], cut) <= worded:
            break
        if index > before + 1:
            first = index
    return first


def _names_columns(line: str, cut: Cut) -> bool:
    """Return whether a line without numbers has as many cells as a row."""
    cells = cut.split(line)
    return _is_wide(cells, cut) and not any(map(cut.is_value, cells))
