"""Where the table of a log begins, and which lines above it look as if they were rows.

Lines come in blocks: numbers here, text there. The table begins with the first block that can
hardly be of a preamble; what looks like a row above that is named, for somebody to judge.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

from .layout import Cut

# Numbers and signs that separate them, whichever: a row that lost its separators.
_NUMBERS = re.compile(r"(?=.*\d)[\d\s.,;|+\-eE]+")
_DATE = re.compile(r"\s*\d+-\d+-\d+\s*")
_ENOUGH = 3  # rows one below the other that no preamble holds by accident


class Start(NamedTuple):
    """Index of the first line of the table, and those of lines above that look like rows."""

    first: int
    stray: tuple[int, ...]


class _Kind(Enum):
    ROW = 1  # as many cells as a row, all of them numbers
    NUMBERS = 2  # numbers and nothing else, but too few cells or too many
    MIXED = 3  # text and numbers: a row, a header, or a line of a preamble
    TEXT = 4


class _Block(NamedTuple):
    """Indices of consecutive lines with numbers: all of them, those that are rows, by kind."""

    lines: list[int]
    rows: list[int]
    kinds: list[_Kind]

    @property
    def whole(self) -> list[int]:
        """The lines from the first one of nothing but numbers."""
        first = next((k for k, kind in enumerate(self.kinds) if kind is not _Kind.MIXED), None)
        return [] if first is None else self.lines[first:]


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
        kind, is_row = _kind(line, cut), cut.is_row(line, needed)
        begins = is_row or kind in (_Kind.ROW, _Kind.NUMBERS)
        if begins and not inside:
            blocks.append(_Block([], [], []))
        inside = begins or (inside and kind is _Kind.MIXED)
        if inside:
            blocks[-1].lines.append(index)
            blocks[-1].kinds.append(kind)
            if is_row:
                blocks[-1].rows.append(index)
    return blocks


def _kind(line: str, cut: Cut) -> _Kind:
    """What a line with text is."""
    if cut.is_row(line, 1.0):
        return _Kind.ROW
    if _NUMBERS.fullmatch(line) and not _DATE.fullmatch(line):
        return _Kind.NUMBERS
    return _Kind.MIXED if holds_numbers(line, cut) else _Kind.TEXT


def holds_numbers(line: str, cut: Cut) -> bool:
    """Whether half of the cells of a line are numbers, or one where it is as wide as a row."""
    cells = cut.split(line)
    wide = _is_wide(cells, cut) and any(map(cut.is_value, cells))
    return wide or 0 < 2 * sum(map(cut.is_number, cells)) >= len(cells)


def mostly_numbers(line: str, cut: Cut) -> bool:
    """Whether more than half of the cells of a line are numbers."""
    cells = cut.split(line)
    return 2 * sum(map(cut.is_number, cells)) > len(cells)


def _is_wide(cells: Sequence[str], cut: Cut) -> bool:
    return len(cells) in (cut.width, cut.width + 1)


def _choose(lines: Sequence[str], blocks: Sequence[_Block], cut: Cut) -> Start:
    """Begin with the first block that is no preamble, and name the lines of those above it.

    That is one of several rows, one below a line that names the columns, and one at the top of the
    file, unless names stand below it: numbers above the names count the columns.
    """
    enough = min(_ENOUGH, 0.2 * max(len(b.rows) for b in blocks))
    stray: list[int] = []
    for block in blocks:
        above = next((s for s in reversed(lines[: block.lines[0]]) if s.strip()), "")
        below = next((s for s in lines[block.lines[-1] + 1 :] if s.strip()), "")
        at_top = not above and cut.width > 2 and not _names_columns(below, cut)
        certain = _Kind.ROW in block.kinds and (at_top or _names_columns(above, cut))
        if certain or len(block.rows) >= max(1, enough):
            return Start(block.lines[0], tuple(stray))
        stray += block.whole
    raise AssertionError("the longest block is one of several rows")


def _names_columns(line: str, cut: Cut) -> bool:
    """Whether a line without numbers has as many cells as a row."""
    cells = cut.split(line)
    return _is_wide(cells, cut) and not any(map(cut.is_value, cells))
