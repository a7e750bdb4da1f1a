"""How lines of a log are cut into cells, and where its table is."""

from __future__ import annotations

import contextlib
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass

NUMBER = {
    decimal: re.compile(rf"[+-]?(\d+({sign}\d*)?|{sign}\d+)([eEdD][+-]?\d+)?$", re.ASCII)
    for decimal, sign in ((".", r"\."), (",", ","))
}
NO_VALUE = {"", "nan", "inf", "-inf", "+inf", "na", "n/a", "null", "none", "-"}


@dataclass(frozen=True)
class Hints:
    """Knowledge of a logger that the text alone does not show; ``name`` is for messages.

    ``data_from`` is the index of the first line that can hold data and ``delimiter`` the separator,
    each ``None`` when to be found. Lines of a ``serial`` log may be cut or overprinted. Lines that
    begin with ``session_mark`` are the logger's own, between data. ``first_header`` is the name of
    the first column where its header is empty. Empty cells of ``sparse`` columns are no samples:
    what was not sampled then.
    """

    name: str
    data_from: int | None = None
    delimiter: str | None = None
    serial: bool = False
    session_mark: str = ""
    first_header: str = ""
    sparse: bool = False

    def is_session(self, line: str) -> bool:
        """Whether the logger itself wrote a line between data."""
        return bool(self.session_mark) and line.startswith(self.session_mark)


@dataclass(frozen=True)
class Written:
    """What the user says about how a log is written; ``None`` where it is to be found.

    ``decimal``, ``thousands`` and ``delimiter`` are signs; ``skip_rows`` lines at the top are not
    looked at; ``header_row`` is the line of the header, from 1.
    """

    decimal: str | None = None
    thousands: str | None = None
    delimiter: str | None = None
    skip_rows: int = 0
    header_row: int | None = None


@dataclass(frozen=True)
class Cut:
    """How lines are cut into cells; ``delimiter`` and ``decimal`` as in `Dialect`.

    ``width`` is the number of columns, ``trailing`` whether rows end with one more separator,
    ``thousands`` the sign between groups of three digits, empty without one. ``lead`` cells stand
    before those of the first column, and are not looked at.
    """

    delimiter: str
    decimal: str
    width: int
    trailing: bool
    thousands: str
    lead: int

    def split(self, line: str) -> list[str]:
        """Split a line into stripped fields; an empty line has none."""
        return split_cells(line, self.delimiter)[self.lead :]

    def is_number(self, text: str) -> bool:
        """Return whether a cell is a finite number in the log's own notation."""
        return NUMBER[self.decimal].match(self.without_thousands(text)) is not None

    def without_thousands(self, text: str) -> str:
        """The text of a number without the signs between its groups of three digits."""
        if not self.thousands or self.thousands not in text:
            return text
        whole, sign, rest = text.partition(self.decimal)
        if not re.fullmatch(rf"[+-]?\d{{1,3}}({re.escape(self.thousands)}\d{{3}})+", whole):
            return text
        return whole.replace(self.thousands, "") + sign + rest

    def is_row(self, line: str, needed: float) -> bool:
        """Return whether a line has as many fields as a row, the needed share of them numbers."""
        fields = self.split(line)
        if len(fields) == self.width + 1 and not fields[-1]:
            fields = fields[:-1]
        if len(fields) != self.width:
            return False
        values = [f for f in fields if f.casefold() not in NO_VALUE]
        return sum(map(self.is_number, values)) >= max(1, needed * len(values))


@dataclass(frozen=True)
class Layout(Cut):
    """Where the table is and how to split it.

    Rows are indices of lines, from 0, ``None`` when absent; ``headers`` and ``units`` have one
    entry per column, empty text when absent. ``again`` are the lines of both, which loggers
    repeat where they start again.
    """

    first_row: int
    hints: Hints
    header_row: int | None
    units_row: int | None
    headers: Sequence[str]
    units: Sequence[str]
    again: frozenset[str]


def split_cells(line: str, delimiter: str) -> list[str]:
    """Split a line into stripped fields."""
    if delimiter == " ":
        return line.split()
    fields = line.split(delimiter)
    if '"' in line:
        with contextlib.suppress(csv.Error):
            fields = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    return [field.strip() for field in fields]
