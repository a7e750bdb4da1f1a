"""Tables for people: numbers with the digits they deserve, as text and as HTML."""

from __future__ import annotations

import html
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from .units import after_number, display_unit

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


def format_estimate(value: float, spread: float | None) -> str:
    """Return a number with its standard error, both to the second digit of the error."""
    error = f" ± {format_spread(spread)}" if spread and math.isfinite(spread) else ""
    return format_number(value, spread) + error


def format_quantity(value: float, unit: str, recorded: Sequence[str] = (), digits: int = 4) -> str:
    """Return a value in SI as people read it, with its unit: see :func:`.units.display_unit`."""
    shown = display_unit(unit, abs(value), recorded)
    return f"{value * shown.factor:.{digits}g}{after_number(shown.unit)}"


def percent_text(value: float | None, form: str = ".2f") -> str:
    """A percentage for people: beyond a thousand its digits say nothing; ``-`` for none.

    One short of 100 is never rounded to it, but a change (``form`` begins with a sign) is.
    """
    if value is None:
        return "-"
    if abs(value) > _MOST_PERCENT:
        return f"{'over ' if value > 0.0 else 'below -'}{_MOST_PERCENT} %"
    text, digits = f"{value:{form}}", 5
    if float(text) == 0.0:
        text = f"{0.0:{form}}"  # not -0.00
    while form[0] != "+" and value < 100.0 <= float(text) and digits < 16:
        text, digits = f"{value:.{digits}g}", digits + 1
    return f"{text} %"


def probability_text(p: float) -> str:
    """Return a p value for people; one below 1e-4 is as good as zero."""
    return f"p = {p:.2g}" if p >= 1e-4 else "p < 0.0001"


@dataclass(frozen=True, repr=False)
class Table:
    """Cells of text under a heading: ``print`` aligns them, a notebook shows them as HTML.

    Columns without an entry are not shown.

    Attributes
    ----------
    head
        Titles of the columns.
    rows
        Cells, as many in each as there are titles.
    right
        Columns that are aligned to the right, counted from 0.
    drop
        Columns that a narrow terminal does without, the first one first.
    """

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    right: tuple[int, ...] = ()
    drop: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def filled(self) -> list[int]:
        """Columns with an entry; the first one always."""
        return [i for i in range(len(self.head)) if i == 0 or any(row[i] for row in self.rows)]

    def __repr__(self) -> str:
        every = (self.head, *self.rows)
        widths = {i: max(len(row[i]) for row in every) for i in self.filled}
        lines = []
        for row in every:
            cells = (
                row[i].rjust(width) if i in self.right else row[i].ljust(width)
                for i, width in widths.items()
            )
            lines.append("  ".join(cells).rstrip())
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        head = "".join(self._cell("th", i, self.head[i]) for i in self.filled)
        rows = ("".join(self._cell("td", i, row[i]) for i in self.filled) for row in self.rows)
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"

    def _cell(self, tag: str, column: int, text: str) -> str:
        side = "right" if column in self.right else "left"
        style = _CELL.format(side, "nowrap" if len(text) <= _NARROW else "normal")
        return f'<{tag} style="{style}">{html.escape(text)}</{tag}>'


class Shown(ABC):
    """A result that people read: tables and paragraphs, as text and in notebooks."""

    @abstractmethod
    def parts(self) -> Sequence[Table | str]:
        """Return tables and paragraphs in the order in which they are read."""

    def summary(self) -> str:
        """Return all parts as text."""
        return "\n\n".join(str(part) for part in self.parts() if part)

    def __str__(self) -> str:
        return self.summary()

    def _repr_html_(self) -> str:
        """The same for notebooks."""
        return "".join(
            part._repr_html_()
            if isinstance(part, Table)
            else f"<p>{html.escape(part).replace(chr(10), '<br>')}</p>"
            for part in self.parts()
            if part
        )
