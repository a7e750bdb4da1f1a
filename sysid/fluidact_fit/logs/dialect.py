"""Detect how a log is written: separator, decimal sign, where the numbers begin.

The separator is judged in the middle and at the end of the file, because the beginning
may be sixty lines of prose with numbers in it. The table begins at the first line from
which lines keep looking like those.
"""

from __future__ import annotations

import contextlib
import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import LogError
from ..units import is_known_unit
from .source import Source

MAX_COLUMNS = 4096

_NUMBER = {
    decimal: re.compile(rf"[+-]?(\d+({sign}\d*)?|{sign}\d+)([eEdD][+-]?\d+)?$")
    for decimal, sign in ((".", r"\."), (",", ","))
}
_NUMBER_COMMA_STRICT = re.compile(r"[+-]?(\d+(,\d+)?)([eEdD][+-]?\d+)?$")
# Separator and decimal sign; of equally good ones the first wins.
_CANDIDATES = [(d, s) for d in "\t;,| " for s in ".," if (d, s) != (",", ",")]
_NO_VALUE = {"", "nan", "inf", "-inf", "+inf", "na", "n/a", "null", "none", "-"}
_PUTTY_MARK = "=~=~=~=~="
_SAMPLE = 120
_HEAD = 1000
_COMMENT = re.compile(r"^\s*(#+|%+|//+|;)\s*")


@dataclass(frozen=True)
class Hints:
    """Knowledge of a logger that the text alone does not show; ``name`` is for messages.

    ``data_from`` is the index of the first line that can hold data and ``delimiter`` the separator,
    each ``None`` when to be found. Lines of a ``serial`` log may be cut or overprinted. Lines that
    begin with ``session_mark`` are the logger's own, between data. ``first_header`` is the name of
    the first column where its header is empty.
    """

    name: str
    data_from: int | None = None
    delimiter: str | None = None
    serial: bool = False
    session_mark: str = ""
    first_header: str = ""

    def is_session(self, line: str) -> bool:
        """Whether the logger itself wrote a line between data."""
        return bool(self.session_mark) and line.startswith(self.session_mark)


@dataclass(frozen=True)
class Cut:
    """How lines are cut into cells; ``delimiter`` and ``decimal`` as in `Dialect`.

    ``width`` is the number of columns, ``trailing`` whether rows end with one more separator.
    """

    delimiter: str
    decimal: str
    width: int
    trailing: bool

    def split(self, line: str) -> list[str]:
        """Split a line into stripped fields; an empty line has none."""
        return _split(line, self.delimiter)

    def is_number(self, text: str) -> bool:
        """Return whether a cell is a finite number in the log's own notation."""
        return _NUMBER[self.decimal].match(text) is not None

    def is_row(self, line: str, needed: float) -> bool:
        """Return whether a line has as many fields as a row, the needed share of them numbers."""
        fields = self.split(line)
        if len(fields) == self.width + 1 and not fields[-1]:
            fields = fields[:-1]
        if len(fields) != self.width:
            return False
        values = [f for f in fields if f.casefold() not in _NO_VALUE]
        return sum(map(self.is_number, values)) >= max(1, needed * len(values))


@dataclass(frozen=True)
class Layout(Cut):
    """Where the table is and how to split it.

    Rows are indices of lines, from 0, ``None`` when absent; ``headers`` and ``units`` have one
    entry per column, empty text when absent.
    """

    first_row: int
    hints: Hints
    header_row: int | None
    units_row: int | None
    headers: Sequence[str]
    units: Sequence[str]


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    fields = line.split(delimiter)
    if '"' in line:
        with contextlib.suppress(csv.Error):
            fields = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    return [field.strip() for field in fields]


def find_layout(source: Source) -> Layout:
    """Find separator, decimal sign, first row and header; ``LogError`` without a table."""
    head, body, complete = _sample_lines(source)
    hints = _recognise(head[:40])
    cut = _choose_cut([line for line in body if not hints.is_session(line)], hints, source.name)
    start = hints.data_from
    if start is None:
        start = _find_start(head, cut, complete)
        if start is None and not complete:
            head = source.data.decode().split("\n")
            start = _find_start(head, cut, complete=True)
        if start is None:
            raise _no_table(source.name)
        start = _reach_up(head, start, cut)
    return _lay_out(head, start, cut, hints)


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


def _choose_cut(body: Sequence[str], hints: Hints, name: str) -> Cut:
    """Return the cut under which most cells are numbers."""
    best, chosen = _best_cut(body, hints)
    for last in (12, 6, 3):
        if best >= 0.6 or len(body) <= last:
            break
        # A few rows below a long preamble: only the end of the file shows the table.
        score, cut = _best_cut(body[-last:], hints)
        if score > best:
            best, chosen = score, cut
    if chosen is None or best < 0.15:
        raise _no_table(name)
    return chosen


def _best_cut(body: Sequence[str], hints: Hints) -> tuple[float, Cut | None]:
    """Return the best score in [0, 1] and the cut that reached it."""
    best, chosen = 0.0, None
    for delimiter, decimal in _CANDIDATES:
        if hints.delimiter not in (None, delimiter):
            continue
        rated = _rate_cut(body, delimiter, decimal)
        if rated is None:
            continue
        score, cut = rated
        # A decimal comma must earn its place: "1;2" reads the same either way.
        score = round(score, 2) - (0.005 if decimal == "," else 0)
        if chosen is None or score > best:
            best, chosen = score, cut
    return best, chosen


def _rate_cut(body: Sequence[str], delimiter: str, decimal: str) -> tuple[float, Cut] | None:
    """Return a score in [0, 1] and the cut with its usual number of columns."""
    rows = [_split(line, delimiter) for line in body]
    if not rows:
        return None
    counts = Counter(len(row) for row in rows)
    count, share = counts.most_common(1)[0]
    usual = [row for row in rows if len(row) == count]
    trailing = count > 1 and all(not row[-1] for row in usual)
    width = count - 1 if trailing else count
    if trailing:
        share += counts[width]
    pattern = _NUMBER["."] if decimal == "." else _NUMBER_COMMA_STRICT
    cells = [cell for row in usual for cell in row[:width] if cell.casefold() not in _NO_VALUE]
    if not cells:
        return None
    numeric = sum(pattern.match(cell) is not None for cell in cells) / len(cells)
    score = numeric * share / len(rows)
    if width == 1:
        # One column is the last resort: "1,5" is two columns before it is one.
        score *= 0.9
    return score, Cut(delimiter, decimal, width, trailing)


def _no_table(name: str) -> LogError:
    return LogError(
        "no table of numbers was found.",
        where=name,
        expected="Expected rows of numbers separated by commas, semicolons, tabs or blanks.",
        remedy="Open the file in an editor, and export it again as CSV if it is something else.",
    )


def _find_start(lines: Sequence[str], cut: Cut, complete: bool) -> int | None:
    """Return the index of the line where the table begins.

    Runs of lines that look like rows are compared: the table is the first run that is not
    tiny beside the longest one, so that a few numbers in the preamble do not count, and
    text inside the table is found later and named instead of being taken for a preamble.
    """
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


def _reach_up(lines: Sequence[str], start: int, cut: Cut) -> int:
    """Return the start after giving back rows whose bad cells made them look like a header.

    A line with numbers in it, below a line without any, is a row and not the header: its
    text has to be named, not swallowed.
    """
    first = start
    for index in range(start - 1, max(-1, start - 12), -1):
        fields = cut.split(lines[index])
        if len(fields) not in (cut.width, cut.width + 1):
            break
        if not any(map(cut.is_number, fields)):
            return first
        first = index
    return start


def _lay_out(lines: Sequence[str], start: int, cut: Cut, hints: Hints) -> Layout:
    """Look for a header and a row of units above the first row."""
    header_row = units_row = None
    headers = units = [""] * cut.width
    above = [i for i in range(start - 1, -1, -1) if lines[i].strip()][:2]
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
    return bool(filled) and all(is_known_unit(cell) for cell in filled)


def _clean_unit(cell: str) -> str:
    return cell.strip().strip("[]()").strip()
