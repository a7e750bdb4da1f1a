"""A logger that started again with other columns: refused, as one table cannot hold both."""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import LogError
from ..units import looks_like_unit, parse_unit_from_header
from .layout import Cut, Layout, says_nothing
from .log import count_of

_SAME = "Expected the same columns from the first to the last row."
_MANY = 3  # rows of another width one below the other that no preamble holds by accident
_SHARE = 0.01


def refuse_other_header(cells: Sequence[str], layout: Layout, line: int, name: str) -> None:
    """Refuse a second header whose names or units are not those of the first.

    What stands below it would be read under the names above. A row of words is a header where it
    names one of the same columns again, or has units; one of units where the first header has one.
    """
    if layout.header_row is None or not _are_words(cells, layout):
        return
    texts = [cell.strip() for cell in cells]
    known = list(layout.headers)
    if layout.units_row is not None and all(map(looks_like_unit, texts)):
        known = list(layout.units)
    elif not _names_columns(texts, known):
        return
    pairs = enumerate(zip(texts, known), start=1)
    other = [
        f"column #{k} is '{new}', above it is '{old}'" for k, (new, old) in pairs if new != old
    ]
    if not other:
        return
    more = f", and {len(other) - 3} more" if len(other) > 3 else ""
    raise LogError(
        f"a second header that differs from the first: {'; '.join(other[:3])}{more}.",
        where=f"{name}, line {line}",
        expected=_SAME,
        remedy=_remedy(line),
    )


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
    """Whether every cell with text is a word, and there are some."""
    texts = [cell.strip() for cell in cells if cell.strip()]
    return bool(texts) and all(
        any(map(str.isalpha, text)) and not says_nothing(text) and not cut.is_value(text)
        for text in texts
    )


def _names_columns(cells: Sequence[str], headers: Sequence[str]) -> bool:
    """Whether words name a column that a header has, too, or most of them have units."""
    named = [parse_unit_from_header(text.strip()) for text in cells]
    known = {parse_unit_from_header(text)[0].casefold() for text in headers} - {""}
    units = sum(unit is not None for _, unit in named)
    return bool(known & {name.casefold() for name, _ in named}) or 2 * units > len(named)
