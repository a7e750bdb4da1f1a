"""A logger that started again with other columns: refused, as one table cannot hold both."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise

from ..errors import LogError
from ..units import looks_like_unit, parse_unit_from_header
from .layout import LONG_CELL, Cut, Layout, says_nothing
from .log import count_of
from .stamps import is_time_name

_SAME = "Expected the same columns from the first to the last row."
_ONE = r"(?:channel|kanal|canal|voie|variable|signal|sensor|trace|curve|kurve)"
_CHANNEL = re.compile(rf"(?:\w+\.)?{_ONE}(?: ?name)?")
_SEPARATOR = re.compile(r"(\s*[:;=,|\t]\s*)")
_NAMED = re.compile(rf"{_ONE}(\s+)\S+$", re.IGNORECASE)
_IDENTIFIER = re.compile(r"\[[^\]\s]+\]|(?=\D*[._])[^\W\d][\w.]*")  # [p_far], GVL.p
_WORDS = re.compile(r"[^\W\d_]+")
_OF_DATE = re.compile(
    r"(mon|tue|wed|thu|fri|sat|sun|mo|di|mi|do|fr|sa|so|jan|feb|mar|mär|apr|may|mai|jun|jul|aug|sep"
    r"|oct|okt|nov|dec|dez)[a-zä]*|am|pm|t|z|utc|cest|cet|gmt"
)
_MANY = 3  # rows of another width one below the other that no preamble holds by accident
_SHARE = 0.01


def refuse_other_header(
    cells: Sequence[str], layout: Layout, line: int, name: str, *, apart: bool = False
) -> None:
    """Refuse a second header whose names or units are not those of the first.

    What stands below it would be read under the names above, or without a name. A row of words is a
    header where it names one of the same columns again, a time, or has units, or where an empty
    line sets it ``apart``; one of units where the first header has one.
    """
    if not _are_words(cells, layout):
        return
    texts = [cell.strip() for cell in cells]
    known = list(layout.headers)
    distinct = all(texts) and len(set(texts)) == len(texts) > 1
    if layout.units_row is not None and all(map(looks_like_unit, texts)):
        known = list(layout.units)
    elif not (_names_columns(texts, known) or (apart and distinct) or _alike(texts, known)):
        return
    pairs = enumerate(zip(texts, known), start=1)
    other = [
        f"column #{k} is '{new}', above it is '{old}'" for k, (new, old) in pairs if new != old
    ]
    if not other or layout.hints.serial:
        return
    if layout.header_row is None:
        raise LogError(
            f"names of the columns below the first rows: {', '.join(texts)[:120]}.",
            where=f"{name}, line {line}",
            expected="Expected them above the first row.",
            remedy=_remedy(line),
        )
    more = f", and {len(other) - 3} more" if len(other) > 3 else ""
    raise LogError(
        f"a second header that differs from the first: {'; '.join(other[:3])}{more}.",
        where=f"{name}, line {line}",
        expected=_SAME,
        remedy=_remedy(line),
    )


def _alike(texts: Sequence[str], known: Sequence[str]) -> bool:
    """Return whether names stand in the same places, and others are empty."""
    places = [list(map(bool, row)) for row in (texts, known)]
    return places[0] == places[1] and not all(places[0])


def refuse_other_blocks(
    lines: Sequence[str], ragged: Sequence[tuple[int, int]], last: int, layout: Layout, name: str
) -> None:
    """Refuse a block below the first one that does not go on with it.

    Its rows have another number of columns, or it is called otherwise: ``Channel 2``, where
    ``Channel 1`` stands above the first one. A run that is numbered or dated goes on.

    Parameters
    ----------
    lines
        All lines of the file.
    ragged
        Line (from 1) and number of fields of those that are no rows, or rows of words.
    last
        Line of the last row.
    layout, name
        Where the table is, and the name of the log.
    """
    if layout.hints.serial or layout.groups:
        return
    _refuse_other_rows(lines, [r for r in ragged if r[0] > last], layout, name)
    for (number, fields), below in pairwise(ragged):
        if below == (number + 1, fields) and fields not in (1, layout.width):
            _refuse_names_above_row(lines, number, layout, name)
    labels: dict[str, tuple[str, str]] = {}
    for index, line in enumerate(lines[: layout.first_row]):
        if index in (layout.header_row, layout.units_row):
            continue
        key, value = _label(line)
        labels.setdefault(key, (value, line.strip()))
    for number, _ in ragged:
        key, value = _label(lines[number - 1])
        before, written = labels.get(key, (None, ""))
        channel = _CHANNEL.fullmatch(key) is not None
        if number > last or (before is None and not channel) or not key or before == value:
            continue
        if channel or _letters(value) != _letters(before or ""):
            above = f"it is '{written[:80]}'" if before else "nothing like it stands"
            raise LogError(
                f"a second block begins here: '{lines[number - 1].strip()[:80]}'; above the first "
                f"one {above}.",
                where=f"{name}, line {number}",
                expected="Expected one table, whose columns stand side by side.",
                remedy="Export the channels side by side, or cut the file in parts and give each "
                "block as a log of its own.",
            )


def _refuse_other_rows(
    lines: Sequence[str], ragged: Sequence[tuple[int, int]], layout: Layout, name: str
) -> None:
    """Refuse several rows of another width below the last row: a table of its own."""
    before, length, first = (0, 0), 0, 0
    for number, fields in ragged:
        row = fields not in (0, layout.width) and _is_row(layout.split(lines[number - 1]), layout)
        goes_on = (number - 1, fields) == before
        if row and not (goes_on and length):
            first = number - goes_on  # with the names above
        length = row * (length * goes_on + 1)
        before = number, fields
        if length == _MANY:
            raise _change(fields, layout.width, first, name)


def _refuse_names_above_row(lines: Sequence[str], number: int, layout: Layout, name: str) -> None:
    """Refuse a line of names, some of them known, and a row below it with a cell for each."""
    names, row = (layout.split(line) for line in lines[number - 1 : number + 1])
    if _is_row(row, layout) and _are_words(names, layout) and _names_columns(names, layout.headers):
        raise _change(len(names), layout.width, number, name)


def _label(line: str) -> tuple[str, str]:
    """Split a line into its label and the rest, both without separators: ``channel`` and ``2``."""
    words = line.strip().strip("#%;,|\t ")
    if len(words) > LONG_CELL:
        return "", ""
    if _IDENTIFIER.fullmatch(words) and not _CHANNEL.match(words.casefold()):
        return "a name", words  # of what is recorded below it
    found = _SEPARATOR.search(words) or _NAMED.match(words)
    digits = "".join(filter(str.isdigit, words))
    key, value = (words[: found.start(1)], words[found.end(1) :]) if found else (words, digits)
    key = "".join(c for c in key.casefold() if not c.isdigit()).strip(" .:_-")
    return key, value.strip(" ;,|\t")


def _letters(text: str) -> str:
    """The words of a text in order, without the names of months and days among them."""
    return " ".join(w for w in _WORDS.findall(text.casefold()) if not _OF_DATE.fullmatch(w))


def refuse_other_width(line: str, number: int, layout: Layout, name: str) -> None:
    """Refuse a line of names where the rows get another number of columns."""
    cells = layout.split(line)
    if layout.header_row is None or not _are_words(cells, layout) or len(cells) < 2:
        return
    if _names_columns(cells, layout.headers):
        raise _change(len(cells), layout.width, number, name)


def refuse_rows_above(lines: Sequence[str], layout: Layout, rows: int, name: str) -> None:
    """Refuse to leave out a table of another width that stands above the one that is read."""
    counts = [len(cells) for i in layout.stray if _is_row(cells := layout.split(lines[i]), layout)]
    others = [count for count in counts if count != layout.width]
    if len(others) < _MANY or len(others) <= _SHARE * (rows + len(others)):
        return
    first = layout.first_row if layout.header_row is None else layout.header_row
    raise _change(layout.width, others[-1], first + 1, name)


def _change(width: int, before: int, line: int, name: str) -> LogError:
    return LogError(
        f"the columns change: {count_of(width, 'column')} from here on, {before} above.",
        where=f"{name}, line {line}",
        expected=_SAME,
        remedy=_remedy(line),
    )


def _remedy(line: int) -> str:
    return (
        "Cut the file in two there, and give both parts as logs of their own; "
        f"--header-row {line} reads what stands below and nothing else."
    )


def _is_row(cells: Sequence[str], cut: Cut) -> bool:
    return len(cells) > 1 and all(map(cut.is_value, cells))


def _are_words(cells: Sequence[str], cut: Cut) -> bool:
    """Return whether every cell with text is a word, and there are some."""
    texts = [cell.strip() for cell in cells if cell.strip()]
    return bool(texts) and all(
        any(map(str.isalpha, text)) and not says_nothing(text) and not cut.is_value(text)
        for text in texts
    )


def _names_columns(cells: Sequence[str], headers: Sequence[str]) -> bool:
    """Return whether words name a column that a header has, too, or most of them have units."""
    named = [parse_unit_from_header(text.strip()) for text in cells]
    known = {parse_unit_from_header(text)[0].casefold() for text in headers} - {""}
    if any(is_time_name(name) for name, _ in named[:1]):
        return True
    units = sum(unit is not None for _, unit in named)
    return bool(known & {name.casefold() for name, _ in named}) or 2 * units > len(named)
