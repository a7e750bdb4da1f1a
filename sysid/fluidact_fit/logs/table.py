"""From text to columns of numbers.

Large tables of nothing but numbers go through pyarrow's parser. Everything else, small files
included (importing it costs more than reading them), is read line by line, which can report
irregular lines.
"""

from __future__ import annotations

import re
from codecs import BOM_UTF8
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import LogError, Notice
from ..experiment import FloatArray, is_finite
from ..formats.sink import KEPT
from .clock import Clocks, read_clocks
from .exact import Exact, loses, of_cells
from .groups import complete, merge
from .layout import NUMBER, Layout, to_number
from .log import IntArray, count_of, cut_last_line, name_lines
from .restart import refuse_other_blocks, refuse_other_header, refuse_other_width, refuse_rows_above
from .source import Source
from .statistics import begins_with_statistic, find_statistics

FAST_FROM_BYTES = 6_000_000
RAGGED_SHARE = 0.01
_REMARK = re.compile(r"\s*(#|%|//)\s*[^\W\d]|[\x00-\x1f]++\s*+$")  # of words, or an end mark
_SEPARATED = re.compile(r"(?<=\S)[\s,;|]+(?=\S)")
_LISTED = re.compile(r"\d\s*[;|\t]\s*[+-]?\.?\d")
RAGGED_SHARE_SERIAL = 0.5
_AGAIN = "header again"
_FEW = 0.1  # of the cells of a column may be written unlike the others


@dataclass(frozen=True)
class Table:
    """Numbers by column.

    ``values`` has one array per column, shape ``(n_rows,)``, NaN where a cell is not a finite
    number; ``bad`` has the text of these cells by row. ``lines`` is the 1-based source line of
    every row, ``left_out`` those that are no rows with the reason, ``notices`` says so in words.
    ``data_lines`` lines hold the rows: several in a line where columns have their own times.
    ``doubts`` say why columns of clock times were not read, and ``exact`` has the differences of
    stamps with more digits than the values hold, by index. Clock times count from the instants
    ``since`` [ns], by index.
    """

    values: tuple[FloatArray, ...]
    bad: tuple[dict[int, str], ...]
    lines: IntArray
    left_out: tuple[tuple[int, str], ...]
    notices: tuple[Notice, ...]
    data_lines: int
    doubts: Mapping[int, str] = field(default_factory=dict)
    exact: Mapping[int, Exact] = field(default_factory=dict)
    since: Mapping[int, int] = field(default_factory=dict)


def read_table(source: Source, layout: Layout) -> Table:
    """Read the table; ``LogError`` when it has no rows, or too many irregular ones."""
    offset = 0
    for _ in range(layout.first_row):
        offset = source.data.find(b"\n", offset) + 1
    table = None
    if len(source.data) - offset >= FAST_FROM_BYTES:
        table = _read_fast(source, layout, offset)
    if table is None:
        table = _read_careful(source, layout, offset)
    if layout.stray:
        above = source.data[:offset].decode(errors="replace").split("\n")
        refuse_rows_above(above, layout, table.data_lines, source.name)
    return table


def _read_fast(source: Source, layout: Layout, offset: int) -> Table | None:
    """Read a table of nothing but numbers and empty cells in one go; ``None`` for any other."""
    if layout.tidy or layout.behind or layout.clocks or layout.groups or layout.skipped:
        return None
    data, end = source.data, len(source.data)
    if any(data.find(line.encode(), offset) >= 0 for line in layout.again):
        return None
    while end > offset and data[end - 1] in b"\n\t ":
        end -= 1
    if data.startswith(BOM_UTF8, offset):
        return None  # it would be passed over
    rows = source.line_ends - layout.first_row - data.count(b"\n", end) + 1
    first = max(data.rfind(b"\n", 0, max(end - 4096, 0)) + 1, offset)
    tail = data[first:end].decode(errors="replace").split("\n")
    if _is_cut(tail[-1], tail[-40:-1], layout, not data.endswith(b"\n")):
        return None
    text = data if data[end:] in (b"", b"\n") else data[:end]
    if layout.delimiter == " ":
        text, offset = _single_blanks(text[offset:]), 0
    columns = _parse_numbers(text, offset, layout, rows)
    if columns is None:
        return None
    lines = np.arange(layout.first_row + 1, layout.first_row + 1 + rows)
    holes = [np.isnan(column) for column in columns]
    if np.logical_and.reduce(holes).any():
        return None  # an empty line is no row
    bad = tuple(dict.fromkeys(np.flatnonzero(empty)[:KEPT].tolist(), "") for empty in holes)
    exact: dict[int, Exact] = {}
    top = [layout.split(line) for line in text[offset:][:4096].decode(errors="replace").split("\n")]
    for k, column in enumerate(columns):
        cells = [row[k] for row in top[:-1] if len(row) > k]
        if loses(cells, column[: len(cells)], layout.decimal):
            parts = _open(text, offset, layout, "string", [k])
            found = of_cells([c for part in parts for c in part[0].to_pylist()], column, layout)
            exact |= {k: found} if found else {}
    return Table(tuple(columns), bad, lines, (), layout.notices, rows, exact=exact)


def _single_blanks(text: bytes) -> bytes:
    """Lines with one blank between two cells, where any number of blanks and tabs may stand."""
    text = text.replace(b"\t", b" ")
    while b"  " in text:
        text = text.replace(b"  ", b" ")
    return text.replace(b"\n ", b"\n").replace(b" \n", b"\n").strip(b" ")


def _parse_numbers(data: bytes, offset: int, layout: Layout, rows: int) -> list[FloatArray] | None:
    """Read a table of numbers and empty cells, NaN; ``None`` where it holds anything else.

    Block by block into the columns: there is no second copy of them.
    """
    columns = [np.empty(rows) for _ in range(layout.width)]
    begin = 0
    try:
        for batch in _open(data, offset, layout, "double", range(layout.width + layout.trailing)):
            end = begin + batch.num_rows
            for column, cells in zip(columns, batch.columns):
                whole = cells.fill_null(0.0) if cells.null_count else cells
                # as bytes: its own conversion imports pandas, which takes as long as the reading
                column[begin:end] = np.frombuffer(whole.buffers()[1])[whole.offset :][: len(whole)]
                if not is_finite(column[begin:end]):
                    return None  # words for no number
                if cells.null_count:
                    column[begin:end][np.array(cells.is_null().to_pylist())] = np.nan
            begin = end
    except ValueError:  # what is no number, or more rows than there are lines
        return None
    return columns if begin == rows else None


def _open(data: bytes, offset: int, layout: Layout, kind: str, columns: Sequence[int]) -> Any:
    """Some columns of a table of a ``kind``, in batches."""
    import pyarrow as pa
    from pyarrow import csv

    names = [str(k) for k in range(layout.lead + layout.width + layout.trailing)]
    types = dict.fromkeys(names, pa.type_for_alias(kind))
    if layout.trailing:
        types[names[-1]] = pa.null()  # nothing stands behind the last separator
    return csv.open_csv(
        pa.BufferReader(pa.py_buffer(data).slice(offset)),
        read_options=csv.ReadOptions(use_threads=False, column_names=names),
        parse_options=csv.ParseOptions(
            delimiter=layout.delimiter, quote_char=False, ignore_empty_lines=False
        ),
        convert_options=csv.ConvertOptions(
            column_types=types, include_columns=[names[layout.lead + k] for k in columns],
            null_values=[""], decimal_point=layout.decimal,
        ),
    )  # fmt: skip


def _read_careful(source: Source, layout: Layout, offset: int) -> Table:
    """Read line by line, leaving out lines with the wrong number of fields."""
    text = source.data[offset:].decode(errors="replace")
    split = _split_rows(text, layout)
    rows, lines, ragged = split.rows, split.lines, split.ragged
    notices, cut = [], 0
    filled = text.rstrip("\n ")  # blanks below the last line do not make it the last but one
    tail, ends_open = filled.rsplit("\n", 41), "\n" not in text[len(filled) :]
    if split.ends_with_data and _is_cut(tail[-1], tail[-41:-1], layout, ends_open):
        if ragged and ragged[-1][0] > lines[-1]:
            cut, _ = ragged.pop()
        else:
            cut = lines.pop()
            rows.pop()
        notices.append(cut_last_line(source.name, cut))
    worded = [
        (n, len(row))
        for n, row in zip(lines, rows)
        if row[0][:1].isalpha() and not any(layout.is_value(cell.strip()) for cell in row)
    ]
    whole = source.lines() if ragged or worded else []
    others = sorted({*ragged, *worded})
    refuse_other_blocks(whole, others, max(lines, default=0), layout, source.name)
    first = whole[ragged[0][0] - 1] if ragged else ""
    notices += _judge_ragged(source.name, layout, split, first)
    if not rows:
        raise LogError(
            "the table holds no complete row.",
            where=source.name,
            expected=f"Expected rows of {count_of(layout.width, 'column')}.",
            remedy="Record the log again.",
        )
    if split.statistics:
        notices.append(_statistics_notice(source.name, split.statistics))
    if again := [line for line, why in split.others.items() if why == _AGAIN]:
        notices.append(
            Notice(
                "header-again",
                f"{source.name}: the header is repeated on {name_lines(again)}; a new run "
                "begins where the time starts over.",
            )
        )
    left_out = [
        (n, "text" if n in split.remarks else count_of(found, "field") if found else "broken")
        for n, found in ragged
    ]
    left_out += [*split.others.items(), *([(cut, "cut short")] if cut else [])]
    return _with_numbers(source.name, layout, split, left_out, [*layout.notices, *notices])


def _statistics_notice(name: str, found: Mapping[int, str]) -> Notice:
    words = list(dict.fromkeys(found.values()))
    more = ", ..." if len(words) > 6 else ""
    return Notice(
        "statistics-rows",
        f"{name}: {count_of(len(found), 'row')} with statistics of the others left out "
        f"({name_lines(list(found))}: {', '.join(word[:20] for word in words[:6])}{more}).",
    )


def _with_numbers(
    name: str,
    layout: Layout,
    split: _Lines,
    left_out: list[tuple[int, str]],
    notices: list[Notice],
) -> Table:
    """Turn the cells of the rows into numbers, and their clocks and groups into one time."""
    columns = list(zip(*split.rows))
    lines: IntArray = np.array(split.lines, dtype=np.int64)
    read = [
        (np.empty(0), {}) if k in layout.clocks else _to_numbers(cells, layout)
        for k, cells in enumerate(columns)
    ]
    clocks = Clocks({})
    if layout.clocks:
        clocks = read_clocks(dict(enumerate(columns)), layout.clocks, lines, name)
        notices += clocks.notices
        for k, seconds in clocks.seconds.items():
            wrong = np.flatnonzero(np.isnan(seconds))
            read[k] = seconds, {int(row): columns[k][row].strip() for row in wrong}
    values, bad = tuple(v for v, _ in read), tuple(b for _, b in read)
    for other in sorted(set(_cut_otherwise(bad, lines.size))):
        for k, texts in enumerate(columns):
            values[k][other], bad[k][other] = np.nan, texts[other].strip()
    taken = split.taken
    for row in np.flatnonzero(np.logical_and.reduce([np.isnan(v) for v in values])):
        line = int(lines[row])
        apart = line > lines[0] and line - 1 not in taken
        refuse_other_header(split.rows[row], layout, line, name, apart=apart)
    data_lines = int(lines.size)
    if layout.groups:
        merged, empty = merge(values, bad, lines, layout, name)
        left_out += [(int(n), "empty cells") for n in lines[empty]]
        data_lines -= empty.size
        values, bad, lines = merged.values, merged.bad, merged.lines
    exact: dict[int, Exact] = {}
    if not layout.groups:
        cells = enumerate(zip(columns, values))
        found = {k: of_cells(c, v, layout) for k, (c, v) in cells if k not in layout.clocks}
        exact = {k: differences for k, differences in found.items() if differences}
    out = tuple(sorted(left_out))
    said = tuple(notices)
    return Table(values, bad, lines, out, said, data_lines, clocks.doubts, exact, clocks.since)


def _cut_otherwise(bad: Sequence[Mapping[int, str]], rows: int) -> Iterator[int]:
    """Rows that another sign separates: where it stands in a cell, the others are no cells either.

    ``43,500`` may be two cells, and then ``891|48,055`` is not 891|48 and 55.
    """
    for texts in bad:
        if 2 * len(texts) < rows:  # else it is a column of words
            yield from (row for row, text in texts.items() if _LISTED.search(text))


@dataclass(frozen=True)
class _Lines:
    """Lines of a table: cells and line of every row, line and number of fields where that is
    wrong, which of these are remarks in words, other lines with what they are, and words for the
    statistics among them."""

    rows: list[list[str]]
    lines: list[int]
    ragged: list[tuple[int, int]]
    remarks: set[int]
    others: dict[int, str]
    statistics: dict[int, str]

    @property
    def taken(self) -> set[int]:
        """The lines with text."""
        return {*self.lines, *(n for n, _ in self.ragged), *self.others}

    @property
    def ends_with_data(self) -> bool:
        """Return whether the last line is a row, whole or not, and there are others."""
        return bool(self.rows) and max(self.others, default=0) < self.lines[-1]


def _split_rows(text: str, layout: Layout) -> _Lines:
    """Sort the lines of a table."""
    out = _Lines([], [], [], set(), {}, {})
    rows, lines, ragged = out.rows, out.lines, out.ragged
    short: dict[int, int] = {}  # rows of groups that have ended, and their number of cells
    width, delimiter, needed = layout.width, layout.delimiter, layout.needed
    simple = '"' not in text and delimiter != " " and layout.is_simple
    for number, line in enumerate(text.split("\n"), start=layout.first_row + 1):
        if not line or line.isspace():
            continue
        why = _AGAIN if line in layout.again else layout.skipped.get(number)
        why = "written by the logger itself" if layout.hints.is_session(line) else why
        if why:
            out.others[number] = why
            continue
        fields = line.split(delimiter) if simple else layout.split(line)
        while len(fields) > width and not fields[-1].strip():
            fields.pop()  # a separator too many at the end of the line
        if width == 1 and fields and _SEPARATED.search(line) and not layout.is_value(fields[0]):
            fields = _SEPARATED.split(line)  # no separator of one column is known
        if 0 < width - len(fields) <= layout.optional:
            fields = fields + [""] * (width - len(fields))
        filled = complete(fields, layout) if layout.groups else fields
        if filled is not None and len(filled) == width:
            rows.append(filled)
            lines.append(number)
        else:
            ragged.append((number, len(fields)))
            if _is_remark(line, layout):
                out.remarks.add(number)
        if len(fields) < needed and filled is not None:
            short[number] = len(fields)
    if short:
        _leave_out_broken(out, short, layout)
    if rows and not layout.groups and not layout.hints.serial:
        found = find_statistics(rows, text, layout)
        out.statistics.update((lines[k], word) for k, word in sorted(found.items()))
        out.others.update(dict.fromkeys(out.statistics, "statistics"))
        kept = [k for k in range(len(rows)) if k not in found]
        if found:
            rows[:], lines[:] = [rows[k] for k in kept], [lines[k] for k in kept]
    return out


def _leave_out_broken(out: _Lines, short: Mapping[int, int], layout: Layout) -> None:
    """Leave out rows that end early although the next ones do not: no group ended there."""
    longest, before, kept = 0, -1, []
    segments = np.array(sorted(layout.skipped))
    passed = np.searchsorted(segments, out.lines)
    for k in range(len(out.lines) - 1, -1, -1):
        line = out.lines[k]
        if passed[k] != before:
            longest, before = 0, passed[k]  # another segment: its groups begin anew
        if short.get(line, layout.needed) < longest:
            out.ragged.append((line, short[line]))
            continue
        longest = short.get(line, layout.needed)
        kept.append(k)
    kept.reverse()
    out.rows[:], out.lines[:] = [out.rows[k] for k in kept], [out.lines[k] for k in kept]
    out.ragged.sort()


def _to_numbers(cells: Sequence[str], layout: Layout) -> tuple[FloatArray, dict[int, str]]:
    """Convert a column of text; shape ``(n_rows,)`` and the cells that are no number."""
    texts = cells
    if layout.thousands:
        texts = cells = _ungroup(cells, layout)
    if layout.decimal == ",":
        # A point is then no decimal sign: "1.234" may well mean a thousand.
        texts = [cell.replace(".", "?").replace(",", ".") for cell in cells]
    try:
        values = np.array([float(text) for text in texts], dtype=np.float64)
        plain = "".join(texts)  # Python reads digits of any script, and 1_000
        if np.isfinite(values).all() and plain.isascii() and "_" not in plain:
            return values, {}
    except ValueError:
        pass
    values = np.full(len(cells), np.nan)
    filled = [row for row, cell in enumerate(cells) if cell and not cell.isspace()]
    if 0 < len(filled) < len(cells):
        values[filled], texts_at = _to_numbers([cells[row] for row in filled], layout)
        empty = np.setdiff1d(np.arange(len(cells)), filled)[:KEPT]
        bad = dict.fromkeys(empty.tolist(), "") | {filled[k]: t for k, t in texts_at.items()}
        return values, dict(sorted(bad.items()))
    bad = {}
    for row, cell in enumerate(cells):
        text = cell.strip()
        if NUMBER[layout.decimal].match(text):
            values[row] = to_number(text)
        if not np.isfinite(values[row]):
            values[row] = np.nan
            if text or len(bad) < KEPT:
                bad[row] = text
    return values, bad


def _ungroup(cells: Sequence[str], layout: Layout) -> list[str]:
    """A column without signs between thousands; a cell that may be read in two ways as it is.

    Where all others have decimals, a lone ``632.000`` of a column of ``632,000`` may be either.
    """
    plain = [layout.without_thousands(cell.strip()) for cell in cells]
    if layout.thousands not in NUMBER:
        return plain
    whole = [k for k, cell in enumerate(cells) if layout.decimal not in cell and cell.strip()]
    doubtful = all(plain[k] != cells[k].strip() for k in whole)
    if doubtful and len(whole) < _FEW * len(cells):
        for k in whole:
            plain[k] = cells[k]
    return plain


def _is_cut(line: str, before: Sequence[str], layout: Layout, ends_open: bool) -> bool:
    """Return whether the last line of a file was cut.

    Too few fields are a cut; so is, in a file without a final line end, an empty or
    unfinished last cell, or fewer decimals than all lines before agree on.
    """
    if _is_remark(line, layout):
        return False
    fields = layout.split(line)
    if layout.groups:
        return complete(fields, layout) is None and len(fields) < layout.width
    if layout.trailing and len(fields) > layout.width:
        return False
    if 0 < len(fields) < layout.width - layout.optional:
        return True
    if not ends_open or layout.trailing or len(fields) != layout.width:
        return False
    others = map(layout.split, filter(str.strip, before))
    cells = [other[-1] for other in others if len(other) == layout.width]
    if not cells or not all(map(layout.is_number, cells)):
        return False
    if not layout.is_number(fields[-1]):
        return True
    last, *decimals = (len(c.partition(layout.decimal)[2]) for c in (fields[-1], *cells))
    return len(cells) >= 5 and len(set(decimals)) == 1 and last < decimals[0]


def _is_remark(line: str, layout: Layout) -> bool:
    """True if a line says something in words, or marks the end of the file; terminals aside."""
    if layout.hints.serial:
        return False
    letters, digits = sum(map(str.isalpha, line)), sum(map(str.isdigit, line))
    words = letters > max(digits, 2) and not any(map(layout.is_value, layout.split(line)))
    rule = not letters and not digits
    return words or rule or bool(_REMARK.match(line)) or begins_with_statistic(line)


def _judge_ragged(name: str, layout: Layout, split: _Lines, first: str) -> list[Notice]:
    """Warn of few lines with the wrong number of fields, refuse many.

    ``first`` is the text of the first one. Remarks below the last row are no rows that were lost.
    """
    ragged, rows = split.ragged, len(split.rows)
    if not ragged:
        return []
    serial = layout.hints.serial
    allowed = RAGGED_SHARE_SERIAL if serial else RAGGED_SHARE
    last = split.lines[-1] if split.lines else 0
    counted = [(n, found) for n, found in ragged if n < last or n not in split.remarks]
    if len(counted) > allowed * (rows + len(counted)):
        refuse_other_width(first, ragged[0][0], layout, name)
        line, found = counted[0]
        raise LogError(
            f"{count_of(found, 'field')} where the table has {count_of(layout.width, 'column')}"
            + (f" ({len(counted)} such lines)." if len(counted) > 1 else "."),
            where=f"{name}, line {line}",
            expected=f"Expected {count_of(layout.width, 'field')} on every line.",
            remedy=f"Correct or remove {'these lines' if len(counted) > 1 else 'the line'}, or "
            "check that the file holds one table only.",
        )
    partial = [n for n, _ in ragged if n not in split.remarks]
    cause = "as terminals do when they start mid-line" if serial else "partly written lines"
    return [
        Notice(
            "partial-lines",
            f"{name}: {count_of(len(lines), 'line')} {what} left out ({name_lines(lines)}{why}).",
        )
        for lines, what, why in (
            (partial, "with the wrong number of fields", f"; {cause}"),
            (sorted(split.remarks), "of text", ""),
        )
        if lines
    ]
