"""Names and units of the columns: the lines above the first row."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ..units import looks_like_unit
from .layout import Cut, Hints
from .start import holds_numbers

_COMMENT = re.compile(r"^\s*(#+|%+|//+|;)\s*")
_BRACKETED = re.compile(r"\[.*\]|\(.*\)")
_CLOCK_FORM = re.compile(r"[hmsdy]{1,4}([:./ -][hmsdyf0]{1,4})+", re.IGNORECASE)
_NO_UNIT = {"", "-", "1", "none"}
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


def find_header(
    lines: Sequence[str], start: int, cut: Cut, hints: Hints, named: int | None
) -> Header:
    """Look for names and units above the first row, from the ``named`` line on (from 1) if given.

    Units stand below the names, or above them. A row is one of units where all its cells are, or
    where at least half are and another row has the names: the other cells are then units, too.
    """
    if hints.names:
        return Header(None, None, ["", *hints.names][-cut.width :], [""] * cut.width)
    nothing = Header(None, None, [""] * cut.width, [""] * cut.width)
    above = [i for i in range(start - 1, -1, -1) if lines[i].strip()][:_ABOVE]
    if named is not None:
        above = [i for i in above if i >= named - 1]
    if hints.data_from is not None or not above:
        return nothing
    rows = [_look_at(i, lines[i], cut) for i in above]
    names, units = _pair(rows, cut) or (_below_damage(rows), None)
    if not names.is_header and units is None:
        return nothing
    said = names.cells
    if any(said) and not said[0]:
        said = [hints.first_header, *said[1:]]
    if units is None:
        alone = _are_units(said, 1.0)  # a header of units and nothing else has them
        units_alone = [_clean_unit(cell) if alone else "" for cell in said]
        return Header(names.index, None, said, units_alone)
    return Header(names.index, units.index, said, [_clean_unit(cell) for cell in units.cells])


def _below_damage(rows: Sequence[_Row]) -> _Row:
    """Return the row right above the table, or the header above damaged rows."""
    whole = next((row for row in rows if not row.is_mixed), rows[0])
    return whole if whole.is_header else rows[0]


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
        for names in rows[k + 1 : k + 3]:
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
    for text in (line, _COMMENT.sub("", line)):
        fields = cut.split(text)
        if cut.delimiter == " " and len(fields) != width:
            fields = _merge_units(text, width)
        if len(fields) > width and not any(fields[width:]):
            fields = fields[:width]
        if len(fields) != width or not any(fields):
            continue
        if sum(map(cut.is_value, fields)) > 0.5 * width:
            return None
        return [_COMMENT.sub("", fields[0]), *fields[1:]]
    return None


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
    text = cell.strip()
    return bool(_BRACKETED.fullmatch(text) or looks_like_unit(text) or _CLOCK_FORM.fullmatch(text))


def _clean_unit(cell: str) -> str:
    return cell.strip().strip("[]()").strip()
