"""Tables for people: numbers with the digits they deserve, as text and as HTML."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass

_CELL = "padding:0.1em 0.6em;text-align:{};white-space:{};vertical-align:top"
_MOST_PERCENT = 1000
_NARROW = 40  # characters of a cell that is never broken


def format_number(value: float, spread: float | None = None) -> str:
    """Return a number with as many digits as its standard error (two digits) leaves it."""
    if value == 0.0:
        return "0"
    if spread is None or not math.isfinite(spread) or spread <= 0.0 or not math.isfinite(value):
        return f"{value:.6g}"
    size = max(abs(value), spread)
    decimals = 1 - math.floor(math.log10(spread))
    if 1e-4 <= size < 1e7:
        return f"{value:.{min(max(decimals, 0), 15)}f}"
    digits = math.floor(math.log10(size)) + decimals
    return f"{value:.{min(max(digits, 0), 15)}e}"


def format_spread(spread: float | None) -> str:
    """Return a standard error with two digits."""
    return "" if spread is None else format_number(spread, spread)


def format_interval(ends: Sequence[float] | None, spread: float | None) -> str:
    """Return a confidence interval with the digits of the standard error."""
    if ends is None:
        return ""
    return f"[{format_number(ends[0], spread)}, {format_number(ends[1], spread)}]"


def percent_text(value: float | None, form: str = ".2f") -> str:
    """A percentage for people: beyond a thousand its digits say nothing; ``-`` for none.

    One short of 100 is never rounded to it.
    """
    if value is None:
        return "-"
    if abs(value) > _MOST_PERCENT:
        return f"{'over ' if value > 0.0 else 'below -'}{_MOST_PERCENT} %"
    text, digits = f"{value:{form}}", 5
    if float(text) == 0.0:
        text = f"{0.0:{form}}"  # not -0.00
    while value < 100.0 <= float(text) and digits < 16:
        text, digits = f"{value:.{digits}g}", digits + 1
    return f"{text} %"


@dataclass(frozen=True, repr=False)
class Table:
    """Cells of text under a heading: ``print`` aligns them, a notebook shows them as HTML.

    Attributes
    ----------
    head
        Titles of the columns.
    rows
        Cells, as many in each as there are titles.
    right
        Columns that are aligned to the right, counted from 0.
    """

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    right: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.rows)

    def __repr__(self) -> str:
        columns = list(zip(self.head, *self.rows))
        widths = [max(map(len, cells)) for cells in columns]
        lines = []
        for row in (self.head, *self.rows):
            cells = (
                cell.rjust(width) if i in self.right else cell.ljust(width)
                for i, (cell, width) in enumerate(zip(row, widths))
            )
            lines.append("  ".join(cells).rstrip())
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        head = "".join(self._cell("th", i, text) for i, text in enumerate(self.head))
        rows = (
            "".join(self._cell("td", i, text) for i, text in enumerate(row)) for row in self.rows
        )
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"

    def _cell(self, tag: str, column: int, text: str) -> str:
        side = "right" if column in self.right else "left"
        style = _CELL.format(side, "nowrap" if len(text) <= _NARROW else "normal")
        return f'<{tag} style="{style}">{html.escape(text)}</{tag}>'
