"""Detect how a log is written: separator, decimal sign, where the numbers begin.

The separator is judged in the middle and at the end of the file, because the beginning
may be sixty lines of prose with numbers in it. The table begins at the first line from
which lines keep looking like those.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

from ..errors import LogError, Notice
from ..formats.sink import MOST_COLUMNS
from ..units import looks_like_unit, parse_unit_from_header, same_dimension
from . import controldesk, labchart, labview, oscilloscopes, serial, twincat
from .clock import find_clocks, join_fraction
from .decimals import find_thousands, refuse_ambiguous, refuse_commas_for_both
from .header import Header, find_header, join_quoted, name_rows
from .layout import (
    BLANKS,
    GROUPED,
    LONG_CELL,
    NUMBER,
    Cut,
    Hints,
    Layout,
    Written,
    says_nothing,
    split_cells,
)
from .log import count_of, name_lines
from .source import Source
from .stamps import is_stamp
from .start import Start, find_start, holds_numbers, looks_like_row
from .stray import find_stray, holds_digits, is_damaged_row
from .width import fit_header, refuse_decimal_commas, refuse_other_names, refuse_units_above

_NUMBER_COMMA_STRICT = re.compile(r"([+-] *)?(\d+(,\d+)?)([eEdD][+-]?\d+)?$")
# Separator and decimal sign; of equally good ones the first wins.
_CANDIDATES = [(d, s) for d in "\t;,| " for s in ".," if (d, s) != (",", ",")] + [(",", ",")]
_QUOTED_COMMA = re.compile(r'"[^",]*\d,[^"]*"')  # a comma that does not separate columns
# numbers in one cell, or a word and one
_SEVERAL = re.compile(
    r"""(([\d.,+'"/_\u2212-]|\d[eEdD][+-]?\d)+\s*[\t;| ](.*[\t;| ])?|\w+\s*[\t;|])"""
    r"""\s*[\d.,+-]+([eEdD][+-]?\d+)?$"""
)
_CUT_WRONG = 0.1
# separators between digits that no number holds, and where blanks separate more commas than one,
# or one at the end
_LIST = re.compile(r".*\d\s*[\t;|]\s*[+-]?\.?\d")
_COMMAS = re.compile(r".*\d,([^,]*\d[^,]*,|$)")
_QUOTED_IN = re.compile(r'.*\d.*"|.*".*\d')  # quotes beside digits, which were around other cells
_LIST_WRONG = 1.0
_QUOTED_LINE = re.compile(r'\s*"([^"]*)"\s*')
# a number and the unit behind it, up to what separates cells
_BEHIND = re.compile(
    r"""(?<![^\s;,|"])([+-]?[\d.,][\d.,'eE+-]{0,40}(?<=\d)) ?"""
    r"""((?:[^\W\d_]|[%°])[^\s;,|"]{0,20}+(?: [AD]C)?)(?=\s*(?:[;,|\t"]|$))"""
)
_WORD = re.compile(r"\s*[^\W\d_]{3}")
_GAP = 3  # lines without numbers among damaged rows
_PUTTY_MARK = "=~=~=~=~="
_SAMPLE = 120
_HEAD = 1000


def find_layout(source: Source, written: Written) -> Layout:
    """Find separator, decimal sign, first row and header; ``LogError`` without a table."""
    if (found := _known_layout(source, written)) is not None:
        return found
    head, body, complete = _sample_lines(source)
    hints = _recognise(head[:40])
    if written.delimiter is not None:
        hints = replace(hints, delimiter=written.delimiter)
    skipped = max(written.skip_rows, written.header_row or 0)
    if complete and skipped:
        body = [line for line in head[skipped:] if line.strip()] or body
    body = [line for line in body if not hints.is_session(line)]
    capture = serial.recognise(body)
    behind = None if capture is not None else _cut_before_units(body, hints, written, source.name)
    if capture is not None:
        hints = replace(
            hints,
            name=hints.name if hints.serial else "serial capture",
            serial=True,
            delimiter="\t" if capture.names else hints.delimiter,
            names=capture.names,
        )
        cut = capture.around(_choose_cut(capture.values(body), hints, written, source.name))
    elif behind is not None:
        cut = behind
    elif 2 * sum(map(bool, map(_is_quoted_row, body))) > len(body):
        body = list(map(_unquoted, body))
        cut = _choose_cut(body, hints, written, source.name)
        cut = replace(join_fraction(body, cut), tidy=_unquoted)
    else:
        cut = join_fraction(body, _choose_cut(body, hints, written, source.name))
    if written.thousands is None:
        cut = replace(cut, thousands=find_thousands(body, source.lines, cut))
    if written.decimal is None and not cut.thousands:
        refuse_ambiguous(body, source.lines, cut, source.name)
    start = None if hints.data_from is None else Start(hints.data_from, ())
    if start is None and capture is not None and capture.names:
        whole = (i for i, line in enumerate(head[skipped:], start=skipped) if cut.split(line))
        first = next(whole, None)  # its form tells a row, however many of its cells are words
        start = None if first is None else Start(first, ())
    if start is None or start.first < skipped:
        start = find_start(_hidden(head, skipped), cut, complete)
        if start is None and not complete:
            head = source.lines()
            start = find_start(_hidden(head, skipped), cut, complete=True)
        if start is None:
            raise _no_table(source.name, written, skipped)
    if cut.width == 1 and complete and not any(map(str.strip, head[start.first + 1 :])):
        raise _no_table(source.name, written, skipped)  # one number is none
    visible = _hidden(head, written.skip_rows)
    layout = _lay_out(visible, body, start, cut, hints, written, source.name)
    layout = _with_units_behind(layout)
    return replace(layout, notices=(*layout.notices, *_stray_notice(layout, source.name)))


def _known_layout(source: Source, written: Written) -> Layout | None:
    """The layout of a logger that writes more than a table, unless the user says where that is."""
    if written.delimiter is not None or written.skip_rows or written.header_row is not None:
        return None
    return (
        controldesk.lay_out(source)
        or twincat.lay_out(source, written)
        or labview.lay_out(source, written)
        or labchart.lay_out(source, written)
        or oscilloscopes.lay_out(source)
    )


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
        if len(line) <= MOST_COLUMNS:
            continue
        widest = max(max(line.count(sign) for sign in "\t;,| "), line.count(",") // 2)
        if widest > MOST_COLUMNS:
            raise LogError(
                f"about {widest + 1} columns.",
                where=f"{name}, line {number}",
                expected=f"Expected one row per sample and at most {MOST_COLUMNS} columns.",
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
        raise _no_table(name, written)
    return chosen


def _best_cut(body: Sequence[str], hints: Hints, written: Written) -> tuple[float, Cut | None]:
    """Return the best score in [0, 1] and the cut that reached it."""
    best, chosen, place = 0.0, None, 0
    tabbed = _has_tabs(body)
    alike: set[str] = set()  # decimal signs tried with a separator that no line holds
    quoted = any(map(_QUOTED_COMMA.search, body))
    candidates = _candidates(hints.delimiter)
    absent = {d for d, _ in candidates if d != " " and not any(d in line for line in body)}
    # a separator that no line holds leaves one column, which is never the best there can be
    for at in sorted(range(len(candidates)), key=lambda k: candidates[k][0] in absent):
        delimiter, decimal = candidates[at]
        if written.decimal not in (None, decimal) or written.thousands == decimal:
            continue
        if delimiter in (decimal, written.thousands) and not quoted:
            continue
        if tabbed and delimiter == " ":
            continue
        if delimiter in absent:
            if decimal in alike:
                continue
            alike.add(decimal)
        rated = _rate_cut(body, delimiter, decimal, written.thousands or "")
        if rated is None:
            continue
        score, cut = rated
        # A decimal comma must earn its place: "1;2" reads the same either way.
        score = round(score, 2) - (0.005 if decimal == "," else 0)
        if chosen is None or score > best or (score == best and at < place):
            best, chosen, place = score, cut, at
        if best >= 1.0:  # nothing can be better
            break
    return best, chosen


def _candidates(delimiter: str | None) -> list[tuple[str, str]]:
    """Separators and decimal signs to try, with a given separator only that."""
    if delimiter is None:
        return _CANDIDATES
    return [(delimiter, sign) for sign in ".,"]


def _cut_before_units(body: Sequence[str], hints: Hints, written: Written, name: str) -> Cut | None:
    """The cut of lines with units behind the numbers; ``None`` without, or of durations alone.

    The unit of a column stands behind most of its cells: another one, or none, is an exception.
    """
    bare = [_BEHIND.sub(lambda m: m[1] if looks_like_unit(m[2]) else m[0], line) for line in body]
    if bare == list(body):
        return None
    cut = _choose_cut(bare, hints, written, name)
    rows = [row[: cut.width] for line in body if len(row := cut.split(line)) >= cut.width]
    units = tuple(map(_usual_unit, zip(*rows)))
    stated = list(filter(None, units))
    if 2 * len(rows) <= len(body) or all(same_dimension(unit, "s") for unit in stated):
        return None  # between blanks a unit is a cell of its own
    return replace(cut, behind=units)


def _usual_unit(cells: Sequence[str]) -> str:
    """The unit behind most of the numbers of a column, empty without one.

    Durations are instants, whatever their unit.
    """
    filled = [cell for cell in cells if not says_nothing(cell)]
    found = Counter(m[2] for cell in filled if (m := _BEHIND.search(cell)))
    if all(map(is_stamp, filled)):
        return ""
    unit, count = max(found.items(), key=lambda pair: pair[1], default=("", 0))
    return unit if 2 * count > len(filled) and looks_like_unit(unit) else ""


def _with_units_behind(layout: Layout) -> Layout:
    """The layout with the units that stand behind the numbers; two of a column are not read."""
    units = list(layout.units)
    for k, unit in enumerate(layout.behind):
        if unit:
            stated = {units[k], parse_unit_from_header(layout.headers[k])[1]} - {"", None, unit}
            units[k] = " or ".join([*map(str, stated), unit])
    return replace(layout, units=units)


def _is_quoted_row(line: str) -> bool:
    """Return whether all of a line stands in one pair of quotes, with a separator in it twice."""
    found = _QUOTED_LINE.fullmatch(line)
    return found is not None and any(found[1].count(sign) > 1 for sign in "\t;,|")


def _unquoted(line: str) -> str:
    """A line without the quotes around all of it."""
    found = _QUOTED_LINE.fullmatch(line)
    return found[1] if found else line


def _has_tabs(body: Sequence[str]) -> bool:
    """Return whether tabs separate the columns: blanks are then part of a cell, as in ``4 004``."""
    counts = Counter(line.strip().count("\t") for line in body)
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
    # of two that are as usual the larger: a row that is cut too little is one cell
    count, share = max(counts.items(), key=lambda found: (found[1], found[0]))
    usual = [row for row in rows if len(row) == count]
    trailing = count > 1 and all(not row[-1] for row in usual)
    width = count - 1 if trailing else count
    if trailing:
        share += counts[width]
    # Bars around the rows of a printed table
    lead = int(trailing and delimiter == "|" and width > 1 and all(not row[0] for row in usual))
    width -= lead
    pattern = NUMBER["."] if decimal == "." else _NUMBER_COMMA_STRICT
    cut = Cut(delimiter, decimal, width, trailing=trailing, thousands=thousands, lead=lead)
    cells = [cell for row in usual for cell in row[lead:][:width] if not says_nothing(cell)]
    if not cells:
        return None
    plain = [cut.without_thousands(cell) for cell in cells]
    if 5 * sum(cell in ",;|" for cell in plain) > len(plain):
        return None  # "1","2" between blanks: what separates is a cell of its own
    grouped = GROUPED[decimal]  # both signs in one cell say which is which
    others = [c for c in plain if not (pattern.match(c) or is_stamp(c) or grouped.match(c))]
    score = (1.0 - len(others) / len(cells)) * share / len(rows)
    # Of two cuts that are as good, the one whose cells hold other separators is wrong.
    score -= sum(_is_cut_wrong(c, delimiter) for c in others if len(c) < LONG_CELL) / len(cells)
    columns = zip(*(row[lead:][:width] for row in usual), strict=True)
    if others and any(
        all(_several(c) and not (BLANKS.match(c) or grouped.match(c)) for c in column)
        for column in columns
    ):
        score *= 0.5  # a column of nothing but several numbers a cell: 4 050 903 may be one
    if delimiter not in "\t " and 2 * sum(line.endswith("\t") for line in body) > len(body):
        score -= 0.01  # tabs at the ends, which belong to no cell, separate as well
    if width == 1:
        # One column is the last resort: "1,5" is two columns before it is one.
        score *= 0.9
    return score, cut


def _is_cut_wrong(cell: str, delimiter: str) -> float:
    """Score the mistake of taking a text for one cell, which may be several numbers."""
    if _LIST.match(cell) or (delimiter == " " and _COMMAS.match(cell)) or _QUOTED_IN.match(cell):
        return _LIST_WRONG
    return _CUT_WRONG if _several(cell) else 0.0


def _several(cell: str) -> bool:
    """Return whether a cell holds more numbers than one."""
    return len(cell) < LONG_CELL and not is_stamp(cell) and _SEVERAL.match(cell) is not None


def _no_table(name: str, written: Written, skipped: int = 0) -> LogError:
    signs = [(f"--{n}", v) for n, v in written.given.items() if isinstance(v, str)]
    listed = " and ".join(f"{option} {sign!r}" for option, sign in signs)
    remedy = "Open the file in an editor, and export it again as CSV if it is something else."
    if signs:
        options = " and ".join(option for option, _ in signs)
        remedy = f"Leave {options} out, or name the sign that is in the file."
    return LogError(
        "no table of numbers was found"
        + (f" below line {skipped}" if skipped else "")
        + (f" with {listed}." if listed else "."),
        where=name,
        expected="Expected rows of numbers separated by commas, semicolons, tabs or blanks.",
        remedy=remedy,
    )


def _no_header(line: str, named: int, cut: Cut, name: str) -> LogError:
    """Explain why the line that the user named holds no column names."""
    cells = cut.split(line)
    if len(cells) == cut.width and any(cells):
        found = "it holds numbers"
    else:
        found = f"it has {count_of(len(cells), 'cell')} where the rows have {cut.width}"
    return LogError(
        f"this line cannot be the header of --header-row {named}: {found}.",
        where=f"{name}, line {named}",
        expected="Expected one name for every column.",
        remedy="Name another line, or give --skip-rows with the number of lines above the table.",
    )


def _lay_out(
    lines: Sequence[str],
    body: Sequence[str],
    found: Start,
    cut: Cut,
    hints: Hints,
    written: Written,
    name: str,
) -> Layout:
    """Put together what was found: the columns of clock times, names and units among it."""
    clocks = find_clocks([row for line in body if len(row := cut.split(line)) >= cut.width])
    start, stray, named = found.first, set(found.stray), written.header_row
    as_written = lines
    optional = 0
    if named is None and not hints.names:
        cut, optional = fit_header(join_quoted(lines, start, cut), start, body, cut)
    lines = _without_entries(join_quoted(lines, start, cut), found, named)
    header = find_header(lines, start, cut, hints, named)
    if named is None and header.row is not None and is_damaged_row(lines[header.row], cut):
        rows = {i for i in range(start) if lines[i].strip() and is_damaged_row(lines[i], cut)}
        stray |= rows
        hidden = ["" if i in rows else line for i, line in enumerate(lines)]
        header = find_header(hidden, start, cut, hints, named)
    if header.row is None:
        dates = [k for k in clocks.values() if k is not None]
        header = _fewer_names(lines, start, cut, hints, named, dates) or header
    if named is not None and header.row is None:
        raise _no_header(lines[named - 1] if named <= len(lines) else "", named, cut, name)
    if header.row is None and cut.width % 2 == 0:
        half = find_header(lines, start, replace(cut, width=cut.width // 2), hints, named)
        refuse_commas_for_both(half.names, body, cut, name)
    if named is None and not (hints.names or hints.serial):
        nearest = next((i for i in range(start - 1, -1, -1) if lines[i].strip()), None)
        if header.row is None or nearest not in header.taken:
            refuse_other_names(lines, start, cut, name)
        if header.row is None:
            refuse_units_above(lines, start, cut, name)
    if cut.delimiter == "," and cut.width == 2 and written.delimiter is None:
        refuse_decimal_commas(lines, start, name)
    if hints.serial and header.row is None:
        # What stands above the first whole line is a part of one, and is to be named.
        start = next((i for i in range(start) if lines[i].strip()), start)
        start = max(start, hints.data_from or 0)
    damaged = _damaged(lines, start, cut, header)
    if header.row is None:
        top = min((i for i in damaged if looks_like_row(lines[i], cut)), default=start)
        # what is left of a row may be a number that is none, such as 1_000
        stray |= {i for i in range(top, start) if i in damaged or holds_digits(lines[i])}
    else:
        start = min(damaged, default=start)
    stray |= set(header.no_units)
    if named is None:
        stray = find_stray(lines[:start], cut, header, stray)
    names, units = header.names, header.units
    for k in clocks:
        units[k] = "s"
        if not names[k] or is_stamp(names[k]):
            names[k] = "clock" if any(map(_is_time, names)) else "time"
    of_header = {i for i in (header.row, header.units_row, *header.levels) if i is not None}
    return Layout(
        **vars(cut),
        first_row=start,
        hints=hints,
        header_row=header.row,
        units_row=header.units_row,
        headers=names,
        units=units,
        again=frozenset(as_written[i] for i in of_header),
        clocks=clocks,
        stray=tuple(i for i in sorted(stray - (of_header - {header.row})) if i < start),
        parts=header.parts,
        optional=optional,
    )


def _without_entries(lines: Sequence[str], found: Start, named: int | None) -> Sequence[str]:
    """The lines without the entries of a preamble right above the table.

    What stands above these names them, and no columns, unless it is ``named``.
    """
    if not found.entries:
        return lines
    hidden = ["" if i in found.entries else line for i, line in enumerate(lines)]
    return hidden if named is not None else _hidden(hidden, found.entries[-1] + 1)


def _fewer_names(
    lines: Sequence[str], start: int, cut: Cut, hints: Hints, named: int | None, dates: list[int]
) -> Header | None:
    """A header with fewer names than columns, ``None`` without one."""
    if dates and cut.delimiter == " ":
        # A blank separates day and time, too: one name stands for both.
        header = find_header(lines, start, replace(cut, width=cut.width - 1), hints, named)
        header.names.insert(dates[0], "")
        header.units.insert(dates[0], "")
        return header
    return None if hints.names else name_rows(lines, start, cut, named)


def _damaged(lines: Sequence[str], start: int, cut: Cut, header: Header) -> list[int]:
    """Return the lines with numbers right above the table that are not of the header."""
    found: list[int] = []
    others = 0
    for index in range(start - 1, -1, -1):
        if not lines[index].strip():
            continue
        words = _WORD.match(lines[index]) and not holds_digits(lines[index])
        cells = cut.split(lines[index])
        empty = len(cells) == cut.width and "" not in cells and all(map(says_nothing, cells))
        empty = empty and cells[0][0] != "-"  # neither a rule, nor units of what has none
        if (holds_numbers(lines[index], cut) or empty) and not words and index not in header[:2]:
            found.append(index)
        elif header.row is None and others < _GAP:
            others += 1
        else:
            break
    return found


def _stray_notice(layout: Layout, name: str) -> Iterator[Notice]:
    """Name the lines above the table that look like rows."""
    if layout.stray:
        yield Notice(
            "rows-above-table",
            f"{name}: {count_of(len(layout.stray), 'line')} above the table with numbers left out "
            f"({name_lines([i + 1 for i in layout.stray])}). If they are rows, correct them; "
            "--header-row says where the header is.",
        )


def _is_time(header: str) -> bool:
    """Return whether a header names the time, or has a unit of it."""
    name, unit = parse_unit_from_header(header)
    return name.casefold() in ("time", "t") or (unit is not None and same_dimension(unit, "s"))
