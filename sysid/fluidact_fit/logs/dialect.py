"""Detect how a log is written: separator, decimal sign, where the numbers begin.

The separator is judged in the middle and at the end of the file, because the beginning
may be sixty lines of prose with numbers in it. The table begins at the first line from
which lines keep looking like those.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import LogError
from ..units import is_known_unit
from .dialects import Hints, recognise
from .source import Source

MAX_COLUMNS = 4096

_NUMBER = {
    decimal: re.compile(rf"[+-]?(\d+({sign}\d*)?|{sign}\d+)([eEdD][+-]?\d+)?$")
    for decimal, sign in ((".", r"\."), (",", ","))
}
_NUMBER_COMMA_STRICT = re.compile(r"[+-]?(\d+(,\d+)?)([eEdD][+-]?\d+)?$")
_CANDIDATES = tuple((d, s) for d in ("\t", ";", ",", "|", " ") for s in (".", ","))
_NO_VALUE = {"", "nan", "inf", "-inf", "+inf", "na", "n/a", "null", "none", "-"}
_SAMPLE = 120
_HEAD = 1000
_COMMENT = re.compile(r"^\s*(#+|%+|//+|;)\s*")


@dataclass(frozen=True)
class Layout:
    """Where the table is and how to split it.

    Attributes
    ----------
    delimiter, decimal
        As in `Dialect`.
    width
        Number of columns.
    trailing
        Whether rows end with one more separator.
    first_row
        Index (from 0) of the first line of the table.
    header_row, units_row
        Indices, ``None`` when absent.
    headers, units
        One entry per column; empty text when absent.
    hints
        What is known of the logger.
    """

    delimiter: str
    decimal: str
    width: int
    trailing: bool
    first_row: int
    header_row: int | None
    units_row: int | None
    headers: tuple[str, ...]
    units: tuple[str, ...]
    hints: Hints


def split_line(line: str, delimiter: str) -> list[str]:
    """Split a line into stripped fields; an empty line has none."""
    if delimiter == " ":
        return line.split()
    if '"' in line:
        try:
            fields = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
        except csv.Error:
            fields = line.split(delimiter)
    else:
        fields = line.split(delimiter)
    return [field.strip() for field in fields]


def is_number(text: str, decimal: str = ".") -> bool:
    """Return whether a cell is a finite number in the log's own notation."""
    return _NUMBER[decimal].match(text) is not None


def find_layout(source: Source) -> Layout:
    """Find separator, decimal sign, first row and header.

    Raises
    ------
    LogError
        When the file holds no table of numbers, or one with too many columns.
    """
    lines = _sampled_lines(source)
    hints = recognise(lines.head[:40])
    body = [line for line in lines.body if not _is_session(line, hints)]
    delimiter, decimal, width, trailing = _choose_cut(body, hints, source.name)
    start = hints.data_from
    if start is None:
        start = _find_start(lines.head, delimiter, decimal, width, lines.complete)
        if start is None and not lines.complete:
            everything = source.data.decode().split("\n")
            start = _find_start(everything, delimiter, decimal, width, True)
            lines = _Lines(everything, lines.body, True)
        if start is None:
            raise _no_table(source.name)
        start = _reach_up(lines.head, start, delimiter, decimal, width)
    header_row, units_row, headers, units = _find_header(
        lines.head, start, delimiter, decimal, width, hints
    )
    return Layout(
        delimiter,
        decimal,
        width,
        trailing,
        start,
        header_row,
        units_row,
        tuple(hints.rename(headers)) if any(headers) else tuple(headers),
        tuple(units),
        hints,
    )


@dataclass(frozen=True)
class _Lines:
    """The first lines of a file and a sample of what its table looks like."""

    head: list[str]
    body: list[str]
    complete: bool


def _sampled_lines(source: Source) -> _Lines:
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
        sample = filled[middle : middle + _SAMPLE] + half[-2 * _SAMPLE :]
        return _Lines(head, sample, True)
    body: list[str] = []
    for part in (0.35, 0.6, 0.85, 1.0):
        end = int(len(data) * part)
        piece = data[max(0, end - (1 << 14)) : end].decode(errors="replace").split("\n")[1:-1]
        body.extend([line for line in piece if line.strip()][-_SAMPLE:])
    _refuse_wide(body, source.name)
    return _Lines(head[:_HEAD], body, False)


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


def _is_session(line: str, hints: Hints) -> bool:
    return hints.session_mark is not None and line.startswith(hints.session_mark)


def _choose_cut(body: Sequence[str], hints: Hints, name: str) -> tuple[str, str, int, bool]:
    """Return the separator and decimal sign under which most cells are numbers."""
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


def _best_cut(body: Sequence[str], hints: Hints) -> tuple[float, tuple[str, str, int, bool] | None]:
    """Return the best score in [0, 1] and the split that reached it."""
    best: tuple[float, int] = (0.0, 0)
    chosen: tuple[str, str, int, bool] | None = None
    for order, (delimiter, decimal) in enumerate(_CANDIDATES):
        if hints.delimiter not in (None, delimiter) or (delimiter, decimal) == (",", ","):
            continue
        rated = _rate_cut(body, delimiter, decimal)
        if rated is None:
            continue
        score, width, trailing = rated
        # A decimal comma must earn its place: "1;2" reads the same either way.
        rank = (round(score, 2) - (0.005 if decimal == "," else 0), -order)
        if chosen is None or rank > best:
            best, chosen = rank, (delimiter, decimal, width, trailing)
    return best[0], chosen


def _rate_cut(body: Sequence[str], delimiter: str, decimal: str) -> tuple[float, int, bool] | None:
    """Return a score in [0, 1], the number of columns and whether rows end with a separator."""
    rows = [split_line(line, delimiter) for line in body]
    if not rows:
        return None
    counts = Counter(len(row) for row in rows)
    count, share = counts.most_common(1)[0]
    usual = [row for row in rows if len(row) == count]
    trailing = count > 1 and all(not row[-1] for row in usual)
    width = count - 1 if trailing else count
    if trailing:
        share += sum(len(row) == width for row in rows)
    pattern = _NUMBER["."] if decimal == "." else _NUMBER_COMMA_STRICT
    cells = [cell for row in usual for cell in row[:width] if cell.casefold() not in _NO_VALUE]
    if not cells:
        return None
    numeric = sum(pattern.match(cell) is not None for cell in cells) / len(cells)
    score = numeric * share / len(rows)
    if width == 1:
        # One column is the last resort: "1,5" is two columns before it is one.
        score *= 0.9
    return score, width, trailing


def _no_table(name: str) -> LogError:
    return LogError(
        "no table of numbers was found.",
        where=name,
        expected="Expected rows of numbers separated by commas, semicolons, tabs or blanks.",
        remedy="Open the file in an editor, and export it again as CSV if it is something else.",
    )


def _looks_like_row(line: str, delimiter: str, decimal: str, width: int, needed: float) -> bool:
    fields = split_line(line, delimiter)
    if len(fields) == width + 1 and not fields[-1]:
        fields = fields[:-1]
    if len(fields) != width:
        return False
    values = [f for f in fields if f.casefold() not in _NO_VALUE]
    numbers = sum(is_number(f, decimal) for f in values)
    return numbers >= max(1, needed * len(values))


def _find_start(
    lines: Sequence[str], delimiter: str, decimal: str, width: int, complete: bool
) -> int | None:
    """Return the index of the line where the table begins.

    Runs of lines that look like rows are compared: the table is the first run that is not
    tiny beside the longest one, so that a few numbers in the preamble do not count, and
    text inside the table is found later and named instead of being taken for a preamble.
    """
    # "key value" looks like half a row of two, so two columns have to be numbers both, unless
    # that finds nothing (a date beside a number).
    for needed in (0.5,) if width > 2 else (1.0, 0.5):
        start = _first_run(lines, delimiter, decimal, width, complete, needed)
        if start is not None:
            return start
    return None


def _first_run(
    lines: Sequence[str],
    delimiter: str,
    decimal: str,
    width: int,
    complete: bool,
    needed: float,
) -> int | None:
    """Return where the first run begins that is not tiny beside the longest."""
    runs: list[list[int]] = []
    open_run = False
    for index, line in enumerate(lines):
        if not line.strip():
            continue
        if _looks_like_row(line, delimiter, decimal, width, needed):
            if open_run:
                runs[-1][1] += 1
            else:
                runs.append([index, 1])
            open_run = True
        else:
            open_run = False
    if not runs:
        return None
    if not complete and not open_run and runs[-1][0] + runs[-1][1] < len(lines) - 50:
        return None
    longest = max(length for _, length in runs)
    return next(start for start, length in runs if length >= max(1, min(50, 0.2 * longest)))


def _reach_up(lines: Sequence[str], start: int, delimiter: str, decimal: str, width: int) -> int:
    """Return the start after giving back rows whose bad cells made them look like a header.

    A line with numbers in it, below a line without any, is a row and not the header: its
    text has to be named, not swallowed.
    """
    first = start
    for index in range(start - 1, max(-1, start - 12), -1):
        fields = split_line(lines[index], delimiter)
        if len(fields) not in (width, width + 1):
            break
        if not any(is_number(field, decimal) for field in fields):
            return first
        first = index
    return start


def _find_header(
    lines: Sequence[str], start: int, delimiter: str, decimal: str, width: int, hints: Hints
) -> tuple[int | None, int | None, list[str], list[str]]:
    """Return rows and cells of header and units above the table."""
    none = [""] * width
    above = [i for i in range(start - 1, -1, -1) if lines[i].strip()][:3]
    if not above or hints.data_from is not None:
        return None, None, none, none
    cells = [_header_cells(lines[i], delimiter, decimal, width) for i in above]
    if cells[0] is None:
        return None, None, none, none
    second = cells[1] if len(cells) > 1 else None
    if second is not None and _are_units(cells[0]):
        return above[1], above[0], second, [_clean_unit(cell) for cell in cells[0]]
    return above[0], None, cells[0], none


def _header_cells(line: str, delimiter: str, decimal: str, width: int) -> list[str] | None:
    """Return the cells of a header line, ``None`` when the line is not one."""
    for text in (line, _COMMENT.sub("", line)):
        fields = split_line(text, delimiter)
        if delimiter == " " and len(fields) != width:
            fields = _merge_units(text, width)
        if len(fields) > width and not any(fields[width:]):
            fields = fields[:width]
        if len(fields) != width or not any(fields):
            continue
        if sum(is_number(field, decimal) for field in fields) > 0.5 * width:
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
