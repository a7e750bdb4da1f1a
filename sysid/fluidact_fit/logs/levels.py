"""Names in several rows: those of groups of columns above those of the columns."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

_LONG = 10  # letters of one word, of which no unit has as many


def groups(upper: Sequence[str], below: Sequence[Sequence[str]]) -> bool:
    """Return whether a row has the names of groups of the columns that the rows below it name.

    It repeats a name for the next column, or the names below are distinct with its names only.
    """
    if len(set(filter(None, upper))) < 2:
        return False
    if _repeats(upper):
        return True
    names = list(zip(*below, strict=True))
    whole = list(zip(_filled(upper), *below, strict=True))
    return len(set(names)) < len(names) == len(set(whole))


def join_levels(
    levels: Sequence[Sequence[str]], rows: Sequence[Sequence[str]]
) -> dict[int, tuple[str, ...]]:
    """The parts of every name from top to bottom, each once.

    ``levels`` name groups of columns, ``rows`` the columns.
    """
    spread = [row if _repeats(row) else _filled(row) for row in levels]
    out = {}
    for column, cells in enumerate(zip(*spread, *rows, strict=True)):
        parts = [cell for cell in cells if cell and not cell.startswith("Unnamed: ")]
        out[column] = tuple(dict.fromkeys(parts))
    return out


def is_wordy(cell: str) -> bool:
    """Return whether a cell is a long word, or several, as no unit is."""
    words = [word for word in cell.split() if word.isalpha() and len(word) > 1]
    return len(words) > 1 or any(len(word) > _LONG for word in words)


def _repeats(cells: Sequence[str]) -> bool:
    return any(a == b != "" for a, b in pairwise(cells))


def _filled(cells: Sequence[str]) -> list[str]:
    """Cells with each empty one like the one before it, as merged cells are written."""
    out: list[str] = []
    for cell in cells:
        out.append(cell or (out[-1] if out else ""))
    return out
