"""Names and units of the columns: the lines above the first row."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple

from ..units import is_unit, looks_like_unit, parse_unit_from_header, same_dimension
from .layout import COMMENT, NUMBER, Cut, Hints, says_nothing, to_number
from .levels import groups, is_wordy, join_levels
from .stamps import names_time
from .start import holds_numbers, is_entry

_BRACKETED = re.compile(r"\[.*\]|\(.*\)")
_CLOCK_FORM = re.compile(r"[hmsdy]{1,4}([:./ -][hmsdyf0]{1,4})+", re.IGNORECASE)
_SAYS_UNIT = re.compile(r"units?\s*[:=]\s*", re.IGNORECASE)
_ALL_QUOTED = re.compile(r'\s*"(.*)"\s*')
_IN = re.compile(r"in\s+", re.IGNORECASE)
_RULING = re.compile(
    r"(?=.*(?:[=_-]{3}|:-|-:))[\s|+:=_-]+"
)  # between names and rows of a printed table
_NO_UNIT = {"", "-", "1", "none"}
_UNIT_ITSELF = {"unit", "units", "einheit", "einheiten", "unité", "unidad", "unità"}
_BROKEN = 40  # lines that a header with line breaks in its names may take
_LETTERS = 3  # of a unit below a single name
_ABOVE = 4  # lines with text in which names and units are looked for
_ROWS = 100  # of which the second cells are looked at


class Header(NamedTuple):
    """Indices of the lines of names and units, ``None`` when absent, and one text per column.

    ``levels`` are the indices of the other lines that have parts of the names, and ``parts`` these
    parts by column, from top to bottom, where a name has several. ``no_units`` are the indices of
    lines below the names that cannot be their units although each cell is one.
    """

    row: int | None
    units_row: int | None
    names: list[str]
    units: list[str]
    levels: tuple[int, ...] = ()
    parts: Mapping[int, tuple[str, ...]] = MappingProxyType({})
    no_units: tuple[int, ...] = ()

    @property
    def taken(self) -> set[int | None]:
        """The lines that it was taken from."""
        return {self.row, self.units_row, *self.levels, *self.no_units}


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
    Names may stand in several rows, those of groups of columns above those of the columns.
    """
    if hints.names:
        return Header(None, None, ["", *hints.names][-cut.width :], [""] * cut.width)
    nothing = Header(None, None, [""] * cut.width, [""] * cut.width)
    filled = [i for i in range(start - 1, -1, -1) if lines[i].strip()]
    above = [i for i in filled if not _RULING.fullmatch(lines[i])][:_ABOVE]
    rows: list[_Row] = []
    no_units: list[_Row] = []
    index_row = None
    if named is not None:
        found = _said_rows(lines, above, cut, named)
    elif hints.data_from is not None or not above:
        found = None
    else:
        counting = _counts_from_one(lines[start:], cut)
        rows = [_look_at(i, lines[i], cut, counting) for i in above]
        no_units = [r for r, names in pairwise(rows) if r.are_units and _contradict(r, names)]
        rows = [row for row in rows if row not in no_units]
        if _is_index_row(rows):
            index_row, *rows = rows
        found = (
            _pair(rows, cut)
            or _beside_names(rows, cut)
            or _below_names(rows)
            or _names_alone(rows, cut, index_row is not None)
        )
    if found is None:
        return nothing
    names, units = found
    said = names.cells
    if any(said) and not said[0]:
        said = [hints.first_header, *said[1:]]
    if units is None:
        alone = _are_units(said, 1.0)  # a header of units and nothing else has them
        unit_cells = [_clean_unit(cell) if alone else "" for cell in said]
        below: list[str] = []
    else:
        below = [cell if _is_name_beside(cell, units) else "" for cell in units.cells]
        unit_cells = [
            "" if b else _clean_unit(cell) for b, cell in zip(below, units.cells, strict=True)
        ]
    levels = _levels(names, rows)
    own = [said, below] if any(below) else [said]
    if units is not None and units.index < names.index:
        own.reverse()
    parts = join_levels([row.cells for row in levels], own)
    if index_row is not None:
        parts[0] = (index_row.cells[0],)
    whole = {k: " ".join(found) for k, found in parts.items()}
    return Header(
        row=names.index,
        units_row=None if units is None else units.index,
        names=[whole.get(k, cell) for k, cell in enumerate(said)],
        units=unit_cells,
        levels=tuple(r.index for r in (*levels, *([index_row] if index_row else []))),
        parts={k: found for k, found in parts.items() if len(found) > 1},
        no_units=tuple(row.index for row in no_units),
    )


def _is_name_beside(cell: str, row: _Row) -> bool:
    """Return whether a cell of a row with units is a part of a name.

    In a row of units that is a long word, several, or one without the brackets of the others.
    """
    if _clean_unit(cell).casefold() in _NO_UNIT or _is_unit(cell):
        return False
    bracketed = sum(map(bool, map(_BRACKETED.fullmatch, row.cells)))
    return not row.are_units or 2 * bracketed >= row.filled or is_wordy(cell)


def _counts_from_one(rows: Sequence[str], cut: Cut) -> bool:
    """Return whether the first cells of the rows go on with what began with a 1 above them."""
    firsts = [cells[0] for line in rows[:_ABOVE] if (cells := cut.split(line))]
    numbers = [to_number(c) for c in firsts if NUMBER[cut.decimal].match(c)][:2]
    if len(numbers) < 2:
        return False
    step = numbers[1] - numbers[0]
    return step > 0.0 and abs(numbers[0] - 1.0 - step) < 1e-6 * step


def _contradict(units: _Row, names: _Row) -> bool:
    """Return whether cells that are units cannot be those of the names above.

    A name says another unit itself, or is a time and the cells are one and the same other unit:
    words for what was not measured, as ``A``, are units as well.
    """
    said = [(parse_unit_from_header(n), _clean_unit(u)) for n, u in zip(names.cells, units.cells)]
    if not names.is_header:
        return False
    both = [(unit, u) for (name, unit), u in said if unit and name != unit]  # "in" may be a name
    both = [(unit, u) for unit, u in both if u.casefold() not in _NO_UNIT]
    own = any(is_unit(u) and not same_dimension(str(unit), u) for unit, u in both)
    timed = any(
        (names_time(name) or name.casefold() == "t") and is_unit(u) and not same_dimension(u, "s")
        for (name, _), u in said
        if u
    )
    return own or (timed and units.filled > 1 and units.distinct == 1)


def _is_index_row(rows: Sequence[_Row]) -> bool:
    """True if the lowest row names the first column alone, as pandas does below other names."""
    if len(rows) < 2 or len(rows[0].cells) < 2 or not rows[1].is_header:
        return False
    first, *rest = rows[0].cells
    return bool(first) and not any(rest) and not rows[0].are_units and all(rows[1].cells[1:])


def _levels(names: _Row, rows: Sequence[_Row]) -> list[_Row]:
    """Rows above the names that name groups of columns, from top to bottom.

    They repeat a name in the next column, or leave it empty where the names below are not
    distinct without it.
    """
    out: list[_Row] = []
    for row in reversed([r for r in rows if r.index < names.index]):
        out = [row, *out] if row.is_header and not row.is_mixed else []
    out = [r for r in out if not r.are_units]
    while out and not groups(out[0].cells, [r.cells for r in (*out[1:], names)]):
        out = out[1:]
    return out


def _beside_names(rows: Sequence[_Row], cut: Cut) -> tuple[_Row, _Row] | None:
    """Rows of names of which one has units for some columns: ``ms`` below ``Time``, or above."""
    if len(rows) < 2 or any(not row.is_header or row.is_mixed for row in rows[:2]):
        return None
    for names, units in (rows[1::-1], rows[:2]):
        both = [sum(map(_has_unit, row.cells)) for row in (names, units)]
        whole = cut.delimiter != " " and names.filled >= units.filled  # and no remark above
        if whole and 2 * both[1] > len(units.cells) and not both[0]:
            return names, units
        for name, cell in zip(names.cells, units.cells):
            unit = _clean_unit(cell)
            timed = (names_time(name) or name.casefold() in ("t", "x", "x-axis")) and is_unit(unit)
            bracketed = bool(name) and _BRACKETED.fullmatch(cell) and looks_like_unit(unit)
            if bracketed or (timed and looks_like_unit(cell) and same_dimension(unit, "s")):
                return names, units
    return None


def _below_names(rows: Sequence[_Row]) -> tuple[_Row, _Row] | None:
    """A row that leaves the first column empty, below one that names them all: it has units.

    So have few letters below the name of a single column. What is not understood is refused where
    the column is used.
    """
    if len(rows) < 2 or any(not row.is_header or row.is_mixed for row in rows[:2]):
        return None
    below, names = rows[:2]
    whole = names.distinct == names.filled == len(names.cells)
    first, *rest = below.cells
    few = any(rest) and not first and not any(map(is_wordy, rest))
    alone = not rest and len(first) <= _LETTERS and len(names.cells[0]) > len(first)
    return (names, replace(below, are_units=True)) if whole and (few or alone) else None


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
    seconds = [
        cells[1] for line in lines[start : start + _ROWS] if len(cells := cut.split(line)) > 1
    ]
    name, _ = parse_unit_from_header(found.names[0])
    if (names_time(name) or name.casefold() == "t") and not _increase(seconds, cut):
        return None  # the first column is the time, and the last one has no name
    return Header(found.row, None, ["", *found.names], ["", *found.units])


def _increase(cells: Sequence[str], cut: Cut) -> bool:
    if not all(map(cut.is_number, cells)):
        return True
    numbers = [to_number(cut.without_thousands(cell)) for cell in cells]
    return all(a < b for a, b in pairwise(numbers))


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


def _names_alone(rows: Sequence[_Row], cut: Cut, indexed: bool) -> tuple[_Row, _Row | None] | None:
    """The row of names right above the table, or that above damaged rows or a remark.

    One that repeats itself tells something else of the columns, if there is another above it, or
    names them within its groups: where it has units, or the index is named below (``indexed``).
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
    if names is not best and (indexed or any(_has_unit(cell) for cell in repeated)):
        return best, None
    if names is best or not all(map(_is_unit, repeated)):
        return names, None
    units = [cell if _is_unit(cell) else "" for cell in best.cells]
    return names, replace(best, cells=units)


def _has_unit(cell: str) -> bool:
    """Return whether a cell is a name with a unit."""
    name, unit = parse_unit_from_header(cell)
    return unit is not None and name != unit


def _most_distinct(nearest: _Row, others: Sequence[_Row]) -> _Row:
    """The nearest row that tells the columns apart, if it does not and says something else."""
    words = all(any(map(str.isalpha, cell)) for cell in nearest.cells if cell)
    if nearest.distinct == nearest.filled or not words:
        return nearest
    return max([nearest, *others], key=lambda row: row.distinct)


def _look_at(index: int, line: str, cut: Cut, counting: bool = False) -> _Row:
    named, mixed = header_cells(line, cut), holds_numbers(line, cut)
    if named is not None and all(map(says_nothing, filter(None, named))):
        return _Row(index, named, False, False, True)
    if named is not None:
        # No column is called by a number, but the unit of the first may be 1, or 10 ms.
        numbered = cut.is_value(named[0]) and not looks_like_unit(named[0])
        units = _are_units(named, 0.5) and (not numbered or (named[0] == "1" and not counting))
        return _Row(index, named, not cut.is_number(named[0]), units, mixed)
    cells: list[str] = []
    for text in (line, COMMENT.sub("", line)):
        cells = cut.split(text)
        said = len(cells) == 1 and _SAYS_UNIT.match(cells[0])  # of a block, not of its first column
        section = len(cells) == 1 and not looks_like_unit(_within(cells[0].strip()))  # "[Data]"
        short = 0 < len(cells) < cut.width and not said and not section
        if cut.delimiter != " " and short and _are_units(cells, 1.0):
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
            fits = names.filled + 1 >= units.filled and _less_units(names, units)
            if fits and (names.is_header or numbered):
                return names, units
        if k == 1 and rows[0].is_header and not rows[0].are_units and _are_units(units.cells, 1.0):
            return rows[0], units
    return None


def _less_units(names: _Row, units: _Row) -> bool:
    """True if the cells of names are not units as well, where ``in`` and ``min`` are no names."""
    return not names.are_units or (
        _are_units(units.cells, 1.0) and not _are_units(names.cells, 1.0)
    )


def _is_word(cell: str, cut: Cut) -> bool:
    return bool(cell) and not cut.is_value(cell)


def header_cells(line: str, cut: Cut) -> list[str] | None:
    """Return the cells of a header line, ``None`` when the line is not one."""
    width = cut.width
    other = replace(cut, decimal="." if cut.decimal == "," else ",")
    texts = [line, COMMENT.sub("", line)]
    if cut.delimiter != " " and (quoted := _ALL_QUOTED.fullmatch(line)):
        texts.append(quoted[1].replace('""', '"'))
    for text in texts:
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
        return [COMMENT.sub("", fields[0]), *fields[1:]]
    return None


def _is_lost(cell: str) -> bool:
    """Return whether nothing of a cell outlived its encoding."""
    return bool(cell) and set(cell) <= {"?", "\ufffd"}


def _merge_units(line: str, width: int) -> list[str]:
    """Cut a blank-separated header whose names or units hold blanks."""
    by_gap = re.split(r"\s{2,}|\t", line.strip())
    if len(by_gap) == width:
        return by_gap
    return re.findall(r'"[^"]*"|[^\s\[\(]+(?:\s*[\[\(][^\]\)]{0,99}[\]\)])?', line)


def _are_units(cells: Iterable[str], needed: float) -> bool:
    """Return whether the needed share of the cells with text are units, and one at least."""
    filled = [cell for cell in cells if _clean_unit(cell).casefold() not in _NO_UNIT]
    found = sum(map(_is_unit, filled))
    return found > 0 and found >= needed * len(filled)


def _is_unit(cell: str) -> bool:
    text = _without_words(cell.strip())
    if text and not any(map(str.isalnum, text)):
        return True  # "@@": no name, whatever it is
    inner = text.rpartition("(")[2].rstrip(") ")
    if text.endswith(")") and text[0] != "(" and parse_unit_from_header(text)[1] == inner:
        return False  # "t (ms)" is a name with its unit, and "bar (g)" a unit
    if re.fullmatch(r"[^\W\d_]+[*/][0-9.]+", text) and looks_like_unit(
        text.rstrip("*/.0123456789")
    ):
        return True  # "bar*10", to be refused
    return bool(_BRACKETED.fullmatch(text) or looks_like_unit(text) or _CLOCK_FORM.fullmatch(text))


def _without_words(text: str) -> str:
    """A unit without the words that say that it is one: ``unit: mm``, ``in mm``."""
    said = _SAYS_UNIT.match(text) or (None if looks_like_unit(text) else _IN.match(text))
    return text[said.end() :] if said else text


def _within(text: str) -> str:
    """A text without the brackets around all of it: not ``bar(g)``."""
    depth = 0
    for i, c in enumerate(text):
        depth += (c in "[(") - (c in "])")
        if depth == 0:
            return text[1:-1].strip() if 0 < i == len(text) - 1 else text
    return text


def _clean_unit(cell: str) -> str:
    text, inner = cell.strip(), _within(cell.strip())
    while inner != text:
        text, inner = inner, _within(inner)
    text = _without_words(text)
    return "" if text.casefold() in _UNIT_ITSELF else text
