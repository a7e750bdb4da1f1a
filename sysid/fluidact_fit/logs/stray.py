"""Detection of lines above a table that may be rows: in another form, damaged, or both.

Nothing of a log is left out in silence: what cannot be told from data is named, for somebody to
judge. A preamble says in words what its numbers are.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence

from .header import Header
from .layout import GROUPED, LONG_CELL, NUMBER, Cut, says_nothing
from .stamps import is_stamp
from .start import is_entry, looks_like_row

_ODD_SIGNS = re.compile(r"[^\d.,+\-eE]")
_DECIMAL = re.compile(r"\d[.,]\d\d")
_NO_NAME = re.compile(r"[\x00-\x08\x0e-\x1f{}\"<>|~`@!?$;,=]")


def find_stray(lines: Sequence[str], cut: Cut, header: Header, known: Collection[int]) -> set[int]:
    """Indices of lines above the table that may be rows.

    Parameters
    ----------
    lines
        All above the table.
    known
        Those that are known to look like rows. A date alone is none.
    """
    dates = {i for i, line in enumerate(lines) if is_stamp(line.strip(" \t;,"))}
    found = set(known) - dates
    if header.row is not None and _is_odd(header, lines, cut):
        found |= {header.row, *(i for i in range(header.row) if looks_like_row(lines[i], cut))}
    rest = set(range(len(lines))) - {header.row, header.units_row} - dates
    found |= {i for i in rest if _is_row_of_another_form(lines[i], cut)}
    found |= {
        i
        for i in rest
        if _is_mostly_digits(lines[i], cut.split(lines[i]), cut) or _is_list(lines[i], cut)
    }
    below = {i for i in rest if i >= min(found, default=len(lines))}  # what is damaged among them
    return found | {i for i in below if _was_row(lines[i])}


def is_damaged_row(line: str, cut: Cut) -> bool:
    """True if every cell would be a decimal number but for a sign or two, or its decimal sign.

    Or one is such a number, and the first begins with a digit, as no name does; or there are
    decimals and no letters, or signs that nobody writes among digits. What holds an instant is no
    such row.
    """
    cells = cut.split(line)
    if is_stamp(line.strip()) or any(map(is_stamp, cells)):
        return False
    if _DECIMAL.search(line) and not any(map(str.isalpha, line)):
        return True
    if _is_garbled(line) and holds_digits(line):
        return True
    numbered = any(cell[:1].isdigit() for cell in cells[:1])
    if numbered and any(_DECIMAL.search(cell) and _is_any_number(cell) for cell in cells):
        return True
    for cell in filter(None, cells):
        left = _ODD_SIGNS.sub("", cell)
        if len(cell) - len(left) > 2 or not (_DECIMAL.search(left) and _is_any_number(left)):
            return False
    return True


def holds_digits(line: str) -> bool:
    """Return whether a line has digits, and no more letters than these."""
    digits = sum(map(str.isdigit, line))
    return digits > 0 and digits >= sum(map(str.isalpha, line))


def _is_odd(header: Header, lines: Sequence[str], cut: Cut) -> bool:
    """Return whether names below a row may be one that was damaged.

    They hold signs that no name has, or begin with digits.
    """
    above = next((s for s in reversed(lines[: header.row]) if s.strip()), "")
    names = list(filter(None, header.names))
    row = looks_like_row(above, cut) or _is_row_of_another_form(above, cut)
    return row and any(_NO_NAME.search(name) or name[0].isdigit() for name in names)


def _is_row_of_another_form(line: str, cut: Cut) -> bool:
    """True if a line holds as many numbers as a row, and nothing else but what separates them.

    Or it has just as many cells, half of them numbers.
    """
    bare = line.replace('"', " ").replace("\u2212", "-").strip()
    if len(bare) > LONG_CELL * cut.width or is_stamp(bare):
        return False
    forms = []
    if cut.delimiter != ",":
        forms.append(r"[;|\t]|\s+")
    if cut.delimiter == "," or cut.decimal == ".":
        forms.append(r"[;|\t,]")
    rows = [[cell.strip(" ,") for cell in re.split(form, bare)] for form in forms]
    if cut.width == 1:
        return any(_begins_a_list(cells, line) for cells in rows)
    return any(_is_all_numbers(c, cut) or _is_mostly_digits(line, c, cut) for c in rows)


def _begins_a_list(cells: Sequence[str], line: str) -> bool:
    """Return whether half of several cells are numbers, the first among them."""
    numbers = list(map(_is_any_number, cells))
    return len(cells) > 1 and numbers[0] and 2 * sum(numbers) >= len(cells) and holds_digits(line)


def _is_all_numbers(cells: Sequence[str], cut: Cut) -> bool:
    """True if as many cells as a row has say a number, or that there is none, and no other."""
    values = [c for c in cells if not says_nothing(c)]
    gaps = sum(map(bool, cells)) - len(values)  # a cell that says that it has no number
    numbers = sum(map(_is_any_number, values))
    return 0 < numbers == len(values) and numbers + gaps >= cut.width


def _is_mostly_digits(line: str, cells: Sequence[str], cut: Cut) -> bool:
    """True if a line is cut as a row is, half of it numbers, and holds more digits than letters.

    "Key value" of a preamble is half a row of two.
    """
    if len(cells) != cut.width or cut.width < 2 or not holds_digits(line):
        return False
    numbers = sum(map(_is_any_number, cells))
    return 2 * numbers >= len(cells) and (cut.width > 2 or _is_any_number(cells[0]))


def _is_list(line: str, cut: Cut) -> bool:
    """True if half of the cells of a line are numbers, two at least, and decimals among them.

    However many cells a row has: where a recording changes its columns, the larger part is what
    stands above.
    """
    cells = cut.split(line)
    if not holds_digits(line) or is_entry(cells) or any(map(is_stamp, [line.strip(), *cells])):
        return False
    values = [c for c in cells if not says_nothing(c)]
    if any(c[0].isalpha() for c in values):
        return False  # "b1 = 2.0 1.5" says what they are
    numbers = [c for c in values if _is_any_number(c)]
    return 2 * len(numbers) >= max(len(values), 4) and any(map(_DECIMAL.search, numbers))


def _was_row(line: str) -> bool:
    """Return whether a line among rows may be one that was damaged."""
    begins = line.lstrip()[:1].isdigit()
    return begins or holds_digits(line) or _is_gap(line) or _is_garbled(line)


def _is_gap(line: str) -> bool:
    """Return whether a line says that it has no number, and nothing else."""
    return bool(line.strip()) and says_nothing(line.strip())


def _is_garbled(line: str) -> bool:
    """Return whether a line holds signs that nobody writes."""
    return not line.replace("\t", " ").isprintable()


def _is_any_number(text: str) -> bool:
    """True if a text is a number with either decimal sign, or with a sign between thousands."""
    return any(form.match(text) for form in (*NUMBER.values(), *GROUPED.values()))
