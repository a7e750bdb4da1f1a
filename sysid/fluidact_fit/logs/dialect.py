"""Detect how a log is written: separator, decimal sign, where the numbers begin.

The separator is judged in the middle and at the end of the file, because the beginning
may be sixty lines of prose with numbers in it. The table begins at the first line from
which lines keep looking like those.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from ..errors import LogError
from ..units import is_unit
from . import controldesk
from .decimals import refuse_ambiguous
from .layout import NO_VALUE, NUMBER, Cut, Hints, Layout, Written, split_cells
from .source import Source
from .start import find_start

MAX_COLUMNS = 4096

_NUMBER_COMMA_STRICT = re.compile(r"[+-]?(\d+(,\d+)?)([eEdD][+-]?\d+)?$")
# Separator and decimal sign; of equally good ones the first wins.
_CANDIDATES = [(d, s) for d in "\t;,| " for s in ".," if (d, s) != (",", ",")]
_PUTTY_MARK = "=~=~=~=~="
_SAMPLE = 120
_HEAD = 1000
_COMMENT = re.compile(r"^\s*(#+|%+|//+|;)\s*")


def find_layout(source: Source, written: Written) -> Layout:
    """Find separator, decimal sign, first row and header; ``LogError`` without a table."""
    if (found := controldesk.lay_out(source)) is not None:
        return found
    head, body, complete = _sample_lines(source)
    hints = _recognise(head[:40])
    if written.delimiter is not None:
        hints = replace(hints, delimiter=written.delimiter)
    skipped = max(written.skip_rows, written.header_row or 0)
    if complete and skipped:
        body = [line for line in head[skipped:] if line.strip()] or body
    body = [line for line in body if not hints.is_session(line)]
    cut = _choose_cut(body, hints, written, source.name)
    if written.decimal is None and not cut.thousands:
        refuse_ambiguous(body, source.lines, cut, source.name)
    start = hints.data_from
    if start is None or start < skipped:
        start = find_start(_hidden(head, skipped), cut, complete)
        if start is None and not complete:
            head = source.lines()
            start = find_start(_hidden(head, skipped), cut, complete=True)
        if start is None:
            raise _no_table(source.name)
    return _lay_out(_hidden(head, written.skip_rows), start, cut, hints, written.header_row)


def _hidden(lines: Sequence[str], first: int) -> Sequence[str]:
    """The lines with the first few empty, so that their numbers stay what they are."""
    return [""] * min(first, len(lines)) + list(lines[first:]) if first else lines


def _recognise(lines: Sequence[str]) -> Hints:
    """Return what is known of the logger that wrote these first lines."""
    first = next((index for index, line in enumerate(lines) if line.strip()), None)
    if first is not None and lines[first].startswith(_PUTTY_MARK) and "PuTTY log" in lines[first]:
        # What a microcontroller printed: the terminal starts logging in the middle of a line,
        # and what was still in the buffer overprints the first lines, so that some lines hold
        # the pieces of two.
        return Hints("PuTTY log", first + 1, serial=True, session_mark=_PUTTY_MARK)
    if any(line.startswith("EPOS Studio Version") for line in lines[:20]):
        # Data recorder of maxon positioning controllers: ``key:;value`` lines, a header whose
        # first cell is empty, a row of units, and rows whose first column is time.
        return Hints("EPOS Studio recorder", delimiter=";", first_header="time")
    return Hints("delimited")


def _sample_lines(source: Source) -> tuple[list[str], list[str], bool]:
    """Return the first lines, a sample of what the table looks like, and whether that is all."""
    data = source.data
    limit = 1 << 18
    head = data[:limit].decode(errors="replace").split("\n")
    complete = len(data) <= limit and len(head) <= _HEAD
    if len(data) > limit:
        head = head[:-1] or head
    _refuse_wide(head, source.name)
    if complete:
        filled = [line for line in head if line.strip()]
        # The last line may be cut, the first lines may be a preamble.
        middle = len(filled) // 2
        half = filled[middle:-1] if len(filled) - middle > 2 else filled[-2:] or filled
        return head, filled[middle : middle + _SAMPLE] + half[-2 * _SAMPLE :], True
    body: list[str] = []
    for part in (0.35, 0.6, 0.85, 1.0):
        end = int(len(data) * part)
        piece = data[max(0, end - (1 << 14)) : end].decode(errors="replace").split("\n")[1:-1]
        body.extend([line for line in piece if line.strip()][-_SAMPLE:])
    _refuse_wide(body, source.name)
    return head[:_HEAD], body, False


def _refuse_wide(lines: Sequence[str], name: str) -> None:
    """Refuse absurdly wide tables before they cost minutes."""
    for number, line in enumerate(lines, start=1):
        if len(line) <= MAX_COLUMNS:
            continue
        widest = max(max(line.count(sign) for sign in "\t;,| "), line.count(",") // 2)
        if widest > MAX_COLUMNS:
            raise LogError(
                f"about {widest + 1} columns.",
                where=f"{name}, line {number}",
                expected=f"Expected one row per sample and at most {MAX_COLUMNS} columns.",
                remedy="Transpose the table, or export only the columns that are needed.",
            )


def _choose_cut(body: Sequence[str], hints: Hints, written: Written, name: str) -> Cut:
    """Return the cut under which most cells are numbers."""
    best, chosen = _best_cut(body, hints, written)
    for last in (12, 6, 3):
        if best >= 0.6 or len(body) <= last:
            break
        # A few rows below a long preamble: only the end of the file shows the table.
        score, cut = _best_cut(body[-last:], hints, written)
        if score > best:
            best, chosen = score, cut
    if chosen is None or best < 0.15:
        raise _no_table(name)
    return chosen


def _best_cut(body: Sequence[str], hints: Hints, written: Written) -> tuple[float, Cut | None]:
    """Return the best score in [0, 1] and the cut that reached it."""
    best, chosen = 0.0, None
    tabbed = _has_tabs(body)
    for delimiter, decimal in _candidates(hints.delimiter):
        if written.decimal not in (None, decimal) or written.thousands in (decimal, delimiter):
            continue
        if tabbed and delimiter == " ":
            continue
        rated = _rate_cut(body, delimiter, decimal, written.thousands or "")
        if rated is None:
            continue
        score, cut = rated
        # A decimal comma must earn its place: "1;2" reads the same either way.
        score = round(score, 2) - (0.005 if decimal == "," else 0)
        if chosen is None or score > best:
            best, chosen = score, cut
    return best, chosen


def _candidates(delimiter: str | None) -> list[tuple[str, str]]:
    """Separators and decimal signs to try, with a given separator only that."""
    if delimiter is None:
        return _CANDIDATES
    return [(delimiter, sign) for sign in ".," if sign != delimiter]


def _has_tabs(body: Sequence[str]) -> bool:
    """Whether tabs separate the columns: blanks are then part of a cell, as in ``4 004``."""
    counts = Counter(line.count("\t") for line in body)
    usual, share = counts.most_common(1)[0] if counts else (0, 0)
    return usual > 0 and share > 0.8 * len(body)


def _rate_cut(
    body: Sequence[str], delimiter: str, decimal: str, thousands: str
) -> tuple[float, Cut] | None:
    """Return a score in [0, 1] and the cut with its usual number of columns."""
    rows = [split_cells(line, delimiter) for line in body]
    if not rows:
        return None
    counts = Counter(len(row) for row in rows)
    count, share = counts.most_common(1)[0]
    usual = [row for row in rows if len(row) == count]
    trailing = count > 1 and all(not row[-1] for row in usual)
    width = count - 1 if trailing else count
    if trailing:
        share += counts[width]
    pattern = NUMBER["."] if decimal == "." else _NUMBER_COMMA_STRICT
    cut = Cut(delimiter, decimal, width, trailing, thousands, lead=0)
    cells = [cell for row in usual for cell in row[:width] if cell.casefold() not in NO_VALUE]
    if not cells:
        return None
    plain = map(cut.without_thousands, cells)
    numeric = sum(pattern.match(cell) is not None for cell in plain) / len(cells)
    score = numeric * share / len(rows)
    if width == 1:
        # One column is the last resort: "1,5" is two columns before it is one.
        score *= 0.9
    return score, cut


def _no_table(name: str) -> LogError:
    return LogError(
        "no table of numbers was found.",
        where=name,
        expected="Expected rows of numbers separated by commas, semicolons, tabs or blanks.",
        remedy="Open the file in an editor, and export it again as CSV if it is something else.",
    )


def _lay_out(lines: Sequence[str], start: int, cut: Cut, hints: Hints, named: int | None) -> Layout:
    """Look for a header and a row of units above the first row, or take the ``named`` line."""
    header_row = units_row = None
    headers = units = [""] * cut.width
    above = [i for i in range(start - 1, -1, -1) if lines[i].strip()][:2]
    if named is not None:
        above = [i for i in above if i >= named - 1]
    cells = [_header_cells(lines[i], cut) for i in above]
    if hints.data_from is None and cells and cells[0] is not None:
        header_row, headers = above[0], cells[0]
        if len(cells) > 1 and cells[1] is not None and _are_units(headers):
            units_row, units = header_row, [_clean_unit(cell) for cell in headers]
            header_row, headers = above[1], cells[1]
        if any(headers) and not headers[0]:
            headers[0] = hints.first_header
    return Layout(
        **vars(cut),
        first_row=start,
        hints=hints,
        header_row=header_row,
        units_row=units_row,
        headers=headers,
        units=units,
        again=frozenset(lines[i] for i in (header_row, units_row) if i is not None),
    )


def _header_cells(line: str, cut: Cut) -> list[str] | None:
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
        if sum(map(cut.is_number, fields)) > 0.5 * width:
            return None
        return [_COMMENT.sub("", fields[0]), *fields[1:]]
    return None


def _merge_units(line: str, width: int) -> list[str]:
    """Cut a blank-separated header whose names or units hold blanks."""
    by_gap = re.split(r"\s{2,}|\t", line.strip())
    if len(by_gap) == width:
        return by_gap
    return re.findall(r'"[^"]*"|[^\s\[\(]+(?:\s*[\[\(][^\]\)]*[\]\)])?', line)


def _are_units(cells: Sequence[str]) -> bool:
    filled = [_clean_unit(cell) for cell in cells if _clean_unit(cell)]
    return bool(filled) and all(is_unit(cell) for cell in filled)


def _clean_unit(cell: str) -> str:
    return cell.strip().strip("[]()").strip()
