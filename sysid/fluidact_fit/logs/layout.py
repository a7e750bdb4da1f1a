"""Cutting of log lines into cells, and the place of the table."""

from __future__ import annotations

import contextlib
import csv
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from ..errors import Notice
from .stamps import is_stamp

NUMBER = {
    decimal: re.compile(rf"([+-] *)?(\d+({sign}\d*)?|{sign}\d+)([eEdD][+-]?\d+)?$", re.ASCII)
    for decimal, sign in ((".", r"\."), (",", ","))
}
# Signs between thousands that are one sign, however it is written.
ALIKE = {" ": " \u00a0\u202f\u2009", "'": "'\u2019"}
# With signs between thousands, and a decimal sign that tells them apart.
GROUPED = {
    decimal: re.compile(
        rf"[+-]?\d{{1,3}}(?P<sign>[{other}{''.join(ALIKE.values())}])\d{{3}}((?P=sign)\d{{3}})*"
        rf"{re.escape(decimal)}\d+$",
        re.ASCII,
    )
    for decimal, other in ((".", ","), (",", "."))
}
# Whole numbers with a sign between thousands that is not that before decimals.
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}([.,'\u2019])\d{3}(\1\d{3})*$", re.ASCII)
BLANKS = re.compile(r"[+-]?[1-9]\d{0,2}([ \u00a0\u202f]\d{3})+$")  # between thousands
_QUOTED = re.compile(r'"([^"]*)"|([^\s"]+)')
COMMENT = re.compile(r"^\s*(#+|%+|//+|;)\s*")  # before names of columns
SAMPLE = 200  # rows or cells that show how a table is written
LONG_CELL = 200  # characters, beyond which a search in it could take long
# what is written where there is no number; a truth value is none, and no name of a column
_NO_VALUE = {
    "", "nan", "inf", "-inf", "+inf", "na", "n/a", "null", "none", "true", "false",
    "n.a.", "n. a.", "k.a.", "k. a.", "n.d.", "n.v.", "s/d",
    "#value!", "#n/a", "#div/0!", "#ref!", "#name?", "#num!", "#null!",
    "#wert!", "#nv", "#bezug!", "#zahl!", "#valeur!", "#nombre!", "#nom?",
}  # fmt: skip
_SIGNS = re.compile(r"[*?~]+|#{2,}|-{1,4}")


def to_number(text: str) -> float:
    """The value of a cell that `NUMBER` matches; ``1.0D+00`` is how Fortran writes 1."""
    return float(re.sub("[dD]", "e", text.replace(",", ".").replace(" ", "")))


def number_of(text: str) -> float | None:
    """The value of a number in a header, with either decimal sign; ``None`` for other text."""
    return to_number(text) if any(form.match(text) for form in NUMBER.values()) else None


def decimal_of(text: str, delimiter: str, otherwise: str = ".") -> str:
    """The sign before decimals that more numbers of a text have; ``otherwise`` where none does."""
    commas, points = text.count(","), text.count(".")
    if delimiter == ",":
        return "."
    return otherwise if commas == points else "," if commas > points else "."


def count_filled(cells: Sequence[str]) -> int:
    """Number of cells without the empty ones at the end."""
    return max((k for k, cell in enumerate(cells, start=1) if cell), default=0)


def says_nothing(cell: str) -> bool:
    """True if a cell is empty, or says that there is no number: ``n/a``, ``#REF!``, ``***``."""
    return cell.casefold() in _NO_VALUE or _SIGNS.fullmatch(cell) is not None


@dataclass(frozen=True)
class Hints:
    """Knowledge of a logger that the text alone does not show; ``name`` is for messages.

    ``data_from`` is the index of the first line that can hold data and ``delimiter`` the separator,
    each ``None`` when to be found. Lines of a ``serial`` log may be cut or overprinted. Lines that
    begin with ``session_mark`` are the logger's own, between data. ``first_header`` is the name of
    the first column where its header is empty. Empty cells of ``sparse`` columns are no samples:
    what was not sampled then. ``names`` are those that stand in every row.
    """

    name: str
    data_from: int | None = None
    delimiter: str | None = None
    serial: bool = False
    session_mark: str = ""
    first_header: str = ""
    sparse: bool = False
    names: tuple[str, ...] = ()

    def is_session(self, line: str) -> bool:
        """Return whether the logger itself wrote a line between data."""
        return bool(self.session_mark) and line.startswith(self.session_mark)


@dataclass(frozen=True)
class Written:
    """User's description of a log's layout; ``None`` where it is to be detected.

    ``decimal``, ``thousands`` and ``delimiter`` are signs; ``skip_rows`` lines at the top are not
    looked at; ``header_row`` is the line of the header, from 1. Where ``cells`` were written as
    text to be read, the signs are not the user's.
    """

    decimal: str | None = None
    thousands: str | None = None
    delimiter: str | None = None
    skip_rows: int = 0
    header_row: int | None = None
    cells: bool = False

    @property
    def given(self) -> dict[str, str | int]:
        """What the user has said, as options of the reader."""
        others = ("cells", "decimal", "thousands", "delimiter") if self.cells else ()
        return {name: v for name, v in vars(self).items() if v and name not in others}


@dataclass(frozen=True)
class Cut:
    """Rule that cuts lines into cells; ``delimiter`` and ``decimal`` as in `Dialect`.

    ``width`` is the number of columns, ``trailing`` whether rows end with one more separator,
    ``thousands`` the sign between groups of three digits, empty without one. ``lead`` cells stand
    before those of the first column, and are not looked at. ``tidy`` strips from a line what its
    logger writes around the cells, and returns ``None`` for a line that is not of that form.
    ``behind`` are the units behind the numbers, by column.
    """

    delimiter: str
    decimal: str
    width: int
    trailing: bool = field(default=False, kw_only=True)
    thousands: str = field(default="", kw_only=True)
    lead: int = field(default=0, kw_only=True)
    tidy: Callable[[str], str | None] | None = field(default=None, kw_only=True)
    behind: tuple[str, ...] = field(default=(), kw_only=True)

    @property
    def is_simple(self) -> bool:
        """Return whether what stands between the separators is a cell as it is."""
        return not (self.lead or self.tidy or self.behind)

    def split(self, line: str) -> list[str]:
        """Split a line into stripped fields; an empty line has none, nor one not of the form."""
        tidied = self.tidy(line) if self.tidy else line
        cells = [] if tidied is None else split_cells(tidied, self.delimiter)[self.lead :]
        for k, unit in enumerate(self.behind[: len(cells)]):
            number = cells[k].removesuffix(unit).rstrip()
            if number[-1:].isdigit():
                cells[k] = number
        return cells

    def is_number(self, text: str) -> bool:
        """Return whether a cell is a finite number in the log's own notation."""
        return NUMBER[self.decimal].match(self.without_thousands(text)) is not None

    def is_value(self, text: str) -> bool:
        """Return whether a cell is a number, or an instant on a clock."""
        return self.is_number(text) or is_stamp(text)

    def without_thousands(self, text: str) -> str:
        """The text of a number without the signs between its groups of three digits."""
        if not self.thousands:
            return text
        whole, sign, rest = text.partition(self.decimal)
        between = f"[{re.escape(ALIKE.get(self.thousands, self.thousands))}]"
        if not re.fullmatch(rf"[+-]?\d{{1,3}}({between}\d{{3}})+", whole, re.ASCII):
            return text
        return re.sub(between, "", whole) + sign + rest

    def is_row(self, line: str, needed: float) -> bool:
        """Return whether a line has as many fields as a row, the needed share of them numbers."""
        fields = self.split(line)
        if len(fields) == self.width + 1 and not fields[-1]:
            fields = fields[:-1]
        if len(fields) != self.width:
            return False
        if not self.thousands and all(map(NUMBER[self.decimal].match, fields)):
            return True  # as most lines are
        values = [f for f in fields if not says_nothing(f)]
        return sum(map(self.is_value, values)) >= max(1, needed * len(values))


@dataclass(frozen=True)
class Counted:
    """Instants that were not written: from a line on (from 1), the first one and the step."""

    line: int
    start: float
    step: float


@dataclass(frozen=True)
class Group:
    """Indices of the columns of one time base: that of its instants, or how to count them."""

    columns: tuple[int, ...]
    time: int | None
    counted: tuple[Counted, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Layout(Cut):
    """Place of the table and rule for splitting it.

    Rows are indices of lines, from 0, ``None`` when absent; ``headers`` and ``units`` have one
    entry per column, empty text when absent. ``again`` are the lines of both, which loggers
    repeat where they start again. ``skipped`` has the lines, from 1, that are no data, each with
    the reason, and ``notices`` what was noticed. ``stray`` are the indices of lines above the table
    that look like rows.

    As many as ``optional`` cells may be missing at the end of a row. ``parts`` are those of names
    that have several, by column. ``clocks`` are the indices of the columns of clock times, each
    with that of the column of its dates. With ``groups`` the columns have time bases of their own:
    headers and units are then those of one time and of the columns of all groups, and a group may
    end before the others.
    """

    first_row: int
    hints: Hints
    header_row: int | None = None
    units_row: int | None = None
    headers: Sequence[str]
    units: Sequence[str]
    again: frozenset[str] = frozenset()
    clocks: Mapping[int, int | None] = field(default_factory=dict)
    groups: tuple[Group, ...] = ()
    skipped: Mapping[int, str] = field(default_factory=dict)
    notices: tuple[Notice, ...] = ()
    stray: tuple[int, ...] = ()
    optional: int = 0
    parts: Mapping[int, tuple[str, ...]] = field(default_factory=dict)

    @property
    def needed(self) -> int:
        """Number of cells of a row in which every group has a sample."""
        return max((g.columns[-1] + 1 for g in self.groups), default=self.width)


def split_cells(line: str, delimiter: str) -> list[str]:
    """Split a line into stripped fields."""
    if delimiter == " ":
        return [a or b for a, b in _QUOTED.findall(line)] if '"' in line else line.split()
    fields = line.split(delimiter)
    if '"' in line:
        with contextlib.suppress(csv.Error):
            fields = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    return [text.strip() for text in fields]
