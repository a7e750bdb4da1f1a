"""Names and units of the columns: the lines above the first row."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

from ..units import looks_like_unit
from .layout import Cut, Hints
from .start import holds_numbers, is_entry

_COMMENT = re.compile(r"^\s*(#+|%+|//+|;)\s*")
_BRACKETED = re.compile(r"\[.*\]|\(.*\)")
_CLOCK_FORM = re.compile(r"[hmsdy]{1,4}([:./ -][hmsdyf0]{1,4})+", re.IGNORECASE)
_SAYS_UNIT = re.compile(r"units?\s*[:=]\s*", re.IGNORECASE)
_RULING = re.compile(r"[\s|+:=_-]*[=_-]{3}[\s|+:=_-]*")  # between names and rows of a printed table
_NO_UNIT = {"", "-", "1", "none"}
_BROKEN = 40  # lines that a header with line breaks in its names may take
_ABOVE = 4  # lines with text in which names and units are looked for


class Header(NamedTuple):
    """Indices of the lines of names and units, ``None`` when absent, and one text per column."""

    row: int | None
    units_row: int | None
    names: list[str]
    units: list[str]


@dataclass(frozen=True)
class _Row:
    """A line above the table: its index and cells, whether they can be names, or are units.

    ``is_mixed`` says whether there are numbers among them.
    """

    index: int
    cells: list[str]
    is_header: bool
    are_units: bool
    is_mixed: bool

    @property
    def filled(self) -> int:
        return sum(map(bool, self.cells))

    @property
    def distinct(self) -> int:
        return len(set(filter(None, self.cells)))


def find_header(
    lines: Sequence[str], start: int, cut: Cut, hints: Hints, named: int | None
) -> Header:
    """Look for names and units above the first row; the ``named`` line (from 1) has the names.

    Units stand below the names, or above them. A row is one of units where all its cells are, or
    where at least half are and another row has the names: the other cells are then units, too.
    """
    if hints.names:
        return Header(None, None, ["", *hints.names][-cut.width :], [""] * cut.width)
    nothing = Header(None, None, [""] * cut.width, [""] * cut.width)
    filled = [i for i in range(start - 1, -1, -1) if lines[i].strip()]
    above = [i for i in filled if not _RULING.fullmatch(lines[i])][:_ABOVE]
    if named is not None:
        found = _said_rows(lines, above, cut, named)
    elif hints.data_from is not None or not above:
        found = None
    else:
        rows = [_look_at(i, lines[i], cut) for i in above]
        found = _pair(rows, cut) or _names_alone(rows, cut)
    if found is None:
        return nothing
    names, units = found
    said = names.cells
    if any(said) and not said[0]:
        said = [hints.first_header, *said[1:]]
    if units is None:
        alone = _are_units(said, 1.0)  # a header of units and nothing else has them
        units_alone = [_clean_unit(cell) if alone else "" for cell in said]
        return Header(names.index, None, said, units_alone)
    return Header(names.index, units.index, said, [_clean_unit(cell) for cell in units.cells])


def join_quoted(lines: Sequence[str], start: int, cut: Cut) -> Sequence[str]:
    """The lines with a header that has line breaks between its quotes on the first of them."""
    for first in range(max(start - _BROKEN, 0), start):
        if lines[first].count('"') % 2 == 0:
            continue
        for last in range(first + 1, start):
            text = " ".join(lines[first : last + 1])
            if text.count('"') % 2 == 0 and len(cut.split(text)) == cut.width > 1:
                rest = [""] * (last - first)
                return [*lines[:first], text, *rest, *lines[last + 1 :]]
    return lines


def name_rows(lines: Sequence[str], start: int, cut: Cut, named: int | None) -> Header | None:
    """Names of one column less, where the first has names of the rows, or counts them."""
    firsts = [cells[0] for line in lines[start : start + _ABOVE] if (cells := cut.split(line))]
    counts = [int(cell) for cell in firsts if re.fullmatch(r"\d{1,9}", cell, re.ASCII)]
    counted = len(counts) == len(firsts) and all(b == a + 1 for a, b in pairwise(counts))
    named_rows = not any(map(cut.is_value, firsts)) or counted
    if cut.width < 3 or len(firsts) < 2 or not named_rows:
        return None
    rest = replace(cut, width=cut.width - 1)
    found = find_header(lines, start, rest, Hints(""), named)
    if found.row is None or found.units_row is not None:
        return None
    return Header(found.row, None, ["", *found.names], ["", *found.units])


def _said_rows(
    lines: Sequence[str], above: Sequence[int], cut: Cut, named: int
) -> tuple[_Row, _Row | None] | None:
    """The rows of names, which the user named, and of units below it, ``None`` without a name."""
    line = lines[named - 1] if named <= len(lines) else ""
    names = _look_at(named - 1, line, cut)
    if not any(_is_word(cell, cut) for cell in names.cells):
        return None
    below = (_look_at(i, lines[i], cut) for i in reversed(above) if i >= named)
    return names, next((row for row in below if row.are_units), None)


def _names_alone(rows: Sequence[_Row], cut: Cut) -> tuple[_Row, _Row | None] | None:
    """The row of names right above the table, or that above damaged rows or a remark.

    One that repeats itself tells something else of the columns, if there is another above it.
    """
    whole = next((row for row in rows if not row.is_mixed), rows[0])
    best = whole if whole.is_header else rows[0]
    certain = cut.delimiter != " " and cut.width > 2
    if not rows[0].is_header and certain and not best.cells and len(rows) > 1:
        best = rows[1] if rows[1].distinct == cut.width and not rows[1].is_mixed else best
    names = _most_distinct(best, [row for row in rows if row.is_header and not row.is_mixed])
    if not names.is_header:
        return None
    repeated = {cell for cell in best.cells if cell and best.cells.count(cell) > 1}
    if names is best or not all(map(_is_unit, repeated)):
        return names, None
    units = [cell if _is_unit(cell) else "" for cell in best.cells]
    return names, replace(best, cells=units)


def _most_distinct(nearest: _Row, others: Sequence[_Row]) -> _Row:
    """The nearest row that tells the columns apart, if it does not and says something else."""
    words = all(any(map(str.isalpha, cell)) for cell in nearest.cells if cell)
    if nearest.distinct == nearest.filled or not words:
        return nearest
    return max([nearest, *others], key=lambda row: row.distinct)


def _look_at(index: int, line: str, cut: Cut) -> _Row:
    named, mixed = header_cells(line, cut), holds_numbers(line, cut)
    if named is not None:
        # No column is called by a number, but the unit of the first may be 1.
        return _Row(index, named, not cut.is_number(named[0]), _are_units(named, 0.5), mixed)
    cells: list[str] = []
    for text in (line, _COMMENT.sub("", line)):
        cells = cut.split(text)
        if cut.delimiter != " " and 0 < len(cells) < cut.width and _are_units(cells, 1.0):
            # Empty cells at the end were not written.
            return _Row(index, cells + [""] * (cut.width - len(cells)), False, True, mixed)
    while len(cells) > cut.width and not cells[-1]:
        cells.pop()
    return _Row(index, cells if len(cells) == cut.width else [], False, False, mixed)


def _pair(rows: Sequence[_Row], cut: Cut) -> tuple[_Row, _Row] | None:
    """Return the rows of names and units, ``None`` when there are not both."""
    for k, units in enumerate(rows[:2]):
        if not units.are_units:
            continue
        for near in rows[k + 1 : k + 3]:
            names = _most_distinct(near, [r for r in rows[k + 1 : k + 3] if r.is_header])
            # Oscilloscopes number their channels ("x-axis,1,2"): only units tell that from a row.
            numbered = names is rows[k + 1] and bool(names.cells) and _is_word(names.cells[0], cut)
            # The column of time may have a unit and no name.
            fits = names.filled + 1 >= units.filled and not names.are_units
            if fits and (names.is_header or numbered):
                return names, units
        if k == 1 and rows[0].is_header and not rows[0].are_units and _are_units(units.cells, 1.0):
            return rows[0], units
    return None


def _is_word(cell: str, cut: Cut) -> bool:
    return bool(cell) and not cut.is_value(cell)


def header_cells(line: str, cut: Cut) -> list[str] | None:
    """Return the cells of a header line, ``None`` when the line is not one."""
    width = cut.width
    other = replace(cut, decimal="." if cut.decimal == "," else ",")
    for text in (line, _COMMENT.sub("", line)):
        fields = cut.split(text)
        if cut.delimiter == " " and len(fields) != width:
            fields = _merge_units(text, width)
        if len(fields) > width and not any(fields[width:]):
            fields = fields[:width]
        if len(fields) != width or not any(fields):
            continue
        numbers = [cut.is_value(c) or other.is_value(c) or _is_lost(c) for c in fields]
        if sum(numbers) > 0.5 * width or is_entry(fields):
            return None
        return [_COMMENT.sub("", fields[0]), *fields[1:]]
    return None


def _is_lost(cell: str) -> bool:
    """Whether nothing of a cell outlived its encoding."""
    return bool(cell) and set(cell) <= {"?", "\ufffd"}


def _merge_units(line: str, width: int) -> list[str]:
    """Cut a blank-separated header whose names or units hold blanks."""
    by_gap = re.split(r"\s{2,}|\t", line.strip())
    if len(by_gap) == width:
        return by_gap
    return re.findall(r'"[^"]*"|[^\s\[\(]+(?:\s*[\[\(][^\]\)]*[\]\)])?', line)


def _are_units(cells: Iterable[str], needed: float) -> bool:
    """Whether the needed share of the cells with text are units, and one at least."""
    filled = [cell for cell in cells if _clean_unit(cell).casefold() not in _NO_UNIT]
    found = sum(map(_is_unit, filled))
    return found > 0 and found >= needed * len(filled)


def _is_unit(cell: str) -> bool:
    text = _SAYS_UNIT.sub("", cell.strip(), count=1)
    return bool(_BRACKETED.fullmatch(text) or looks_like_unit(text) or _CLOCK_FORM.fullmatch(text))


def _clean_unit(cell: str) -> str:
    text = cell.strip().strip("[]()").strip()
    said = _SAYS_UNIT.match(text)
    return text[said.end() :] if said else text
