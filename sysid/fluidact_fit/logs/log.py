"""A log after reading: numbers by column, nothing converted yet."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, cast, get_args

import numpy as np
import numpy.typing as npt

from ..errors import Notice, UsageError
from ..experiment import FloatArray, Hold
from .exact import Exact

MIN_RUN = 3  # samples
_SHOWN = 8  # columns in a line
IntArray = npt.NDArray[np.integer[Any]]


Invalid = Literal["drop", "refuse"]


@dataclass(frozen=True)
class StepInput:
    """A role that was not recorded: constant but for one step.

    Attributes
    ----------
    start, end
        Value before and after the step [unit of the role, SI unless a unit is given].
    at
        Instant of the step on the run's own time [s].
    unit
        Unit of both values; ``None`` for that of the role.
    """

    start: float
    end: float
    at: float = 0.0
    unit: str | None = None


@dataclass(frozen=True)
class Column:
    """One column of a log, ``index`` counted from 1, as in ``#3``.

    ``header`` is as written, empty when there is none; ``name`` is the header without its unit.
    ``unit`` is that of the header or the units row, ``None`` without one. It is ``doubtful`` when
    it is one small letter behind an underscore (``valve_m``), which is believed only where it fits
    the role. ``values`` are as written, shape ``(n_rows,)``, NaN where a cell is not a finite
    number; ``bad`` has the text of such cells by row (the first few thousand). A ``sparse`` one was
    not sampled in every row: its NaN are no samples. A ``clock`` held dates or times of day, and
    holds seconds since the first sample, which was at ``since`` [ns]; of one that could not be read
    ``doubt`` says why, and below what to do. One that holds but the fraction of a second is
    ``part_of`` the column of that number, with which it was joined. ``also`` are the parts of a
    header that stood in several rows. ``exact`` has the differences of stamps with more digits than
    the values hold.
    """

    index: int
    header: str
    name: str
    unit: str | None
    doubtful: bool
    values: FloatArray
    bad: Mapping[int, str] = field(default_factory=dict)
    sparse: bool = False
    clock: bool = False
    doubt: str = ""
    part_of: int = 0
    also: tuple[str, ...] = ()
    exact: Exact | None = None
    since: int = 0

    @property
    def stamps(self) -> FloatArray:
        """Numbers to take differences of: the values, or those to the first, shape ``(n,)``."""
        return self.values if self.exact is None else self.exact.since

    @property
    def label(self) -> str:
        """Name of the column in messages: its header, or ``#3``."""
        return self.header or f"#{self.index}"


@dataclass(frozen=True)
class Dialect:
    """Dialect of a file; ``name`` is ``"delimited"`` or that of a recognised logger.

    Line numbers count from 1 and are ``None`` when absent; ``preamble`` is the number of lines
    before the header, or before the data without one. ``delimiter`` is ``" "`` for columns
    separated by white space. Lines of a ``serial`` log, of a terminal, may be cut or overprinted.
    """

    name: str
    encoding: str
    delimiter: str
    decimal: str
    preamble: int
    header_line: int | None
    units_line: int | None
    first_data_line: int
    serial: bool = False


@dataclass(frozen=True)
class Exclusion:
    """Exclusion from a log: from ``low`` to ``high`` of its ``kind``, both included.

    ``kind`` is ``run`` (counted from 1), ``time`` [s, on each run's own time], ``rows`` of the
    data (counted from 1) or ``lines`` of the file.
    """

    kind: str
    low: float
    high: float

    @property
    def text(self) -> str:
        """As it is given: ``time=3:3.5``."""
        if self.kind == "run":
            return f"run={self.low:.0f}"
        return f"{self.kind}={_ends(self.low, self.high)}"


@dataclass(frozen=True)
class Element:
    """Outcome of a channel, dataset or variable of a binary recording.

    ``fate`` is ``read``, ``converted`` or ``left out``; ``how`` says by what, or why.
    """

    name: str
    fate: str
    how: str


@dataclass(frozen=True)
class Account:
    """Account of every line of a file, or of every element of a binary recording.

    ``header_lines`` stand above the data: preamble, header, units and empty ones;
    ``blank_lines`` are the empty ones below. ``left_out`` has line and reason of every line with
    text that is neither. The four and ``data_rows`` make up ``total_lines``. ``elements`` are those
    of a recording that is no text.
    """

    total_lines: int
    header_lines: int
    data_rows: int
    blank_lines: int
    left_out: tuple[tuple[int, str], ...] = ()
    elements: tuple[Element, ...] = ()


@dataclass(frozen=True, repr=False)
class Log:
    """A log as recorded, with what the user said about it.

    Attributes
    ----------
    path, name, sha256
        Where it was, its file name, and the checksum of its bytes.
    columns
        All columns, raw.
    lines
        1-based source line of every row, shape ``(n_rows,)``.
    dialect
        How the file was written.
    account
        What every line of the file was taken for.
    notices
        What was noticed while reading.
    bindings, units, scales, steps, holds, turns
        Role to header, unit, factor, step, hold and what the column begins again after (as written,
        0 for never), as given by the user.
    elsewhere
        Roles of ``bindings`` whose column another log of the set holds and this one does not:
        where such a role is optional, it was not recorded here (see ``share_columns``).
    sample_time
        Given by the user [s], replaces a time column.
    window
        Part to use on each run's own time [s], ``None`` for an open side.
    exclude
        Runs, seconds and lines that are left out.
    from_name
        Role to where its constant, one of the ``steps``, stood in the name of the file.
    invalid
        What becomes of rows with a missing or non-numeric cell: ``"drop"`` or ``"refuse"``, as
        given by the user.
    places
        Of rows some of which were left out: where they stood, from 0, shape ``(n_rows,)``.
    written
        How the user said that the file is written: signs, lines, as options of the reader.
    disposable
        Whether nobody reads the columns once experiments were made of them, which then may take
        their memory.
    """

    path: Path
    name: str
    sha256: str
    columns: tuple[Column, ...]
    lines: IntArray
    dialect: Dialect
    account: Account
    notices: tuple[Notice, ...] = ()
    bindings: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    scales: Mapping[str, float] = field(default_factory=dict)
    steps: Mapping[str, StepInput] = field(default_factory=dict)
    holds: Mapping[str, str] = field(default_factory=dict)
    turns: Mapping[str, float] = field(default_factory=dict)
    sample_time: float | None = None
    window: tuple[float | None, float | None] | None = None
    exclude: tuple[Exclusion, ...] = ()
    from_name: Mapping[str, str] = field(default_factory=dict)
    elsewhere: frozenset[str] = frozenset()
    invalid: Invalid | None = None
    places: IntArray | None = None
    written: Mapping[str, str | int] = field(default_factory=dict)
    disposable: bool = False

    def __repr__(self) -> str:
        names = ", ".join(c.label for c in self.columns[:_SHOWN])
        more = f" and {len(self.columns) - _SHOWN} more" * (len(self.columns) > _SHOWN)
        return f"<Log {self.name}: {count_of(self.rows, 'row')} of {names}{more}>"

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self.lines.size)

    @property
    def window_text(self) -> str:
        """The window as on the command line: ``2:`` from 2 s on."""
        return _ends(*(self.window or ()))

    def where(self, row: int) -> str:
        """Return where a row stands, for messages: ``pot.csv, line 214``."""
        return f"{self.name}, line {int(self.lines[row])}"


def _ends(*ends: float | None) -> str:
    """Ends of a part, to the last digit; one that is open is empty."""
    known = (math.inf if x is None else float(x) for x in ends)
    return ":".join(repr(x).removesuffix(".0") if math.isfinite(x) else "" for x in known)


def name_lines(lines: Sequence[int] | IntArray, shown: int = 4) -> str:
    """Return ``line 7``, ``lines 7 and 9`` or ``lines 1, 2, 3, 4 and 12 more``."""
    texts = [str(int(line)) for line in lines[:shown]]
    more = len(lines) - len(texts)
    if more:
        return f"lines {', '.join(texts)} and {more} more"
    if len(texts) == 1:
        return f"line {texts[0]}"
    return f"lines {', '.join(texts[:-1])} and {texts[-1]}"


def name_columns(columns: Sequence[Column]) -> str:
    """Return ``#2, #3 and #4``, the numbers of columns for a message."""
    *others, last = (f"#{column.index}" for column in columns)
    return f"{', '.join(others)} and {last}" if others else last


def cut_last_line(name: str, line: int) -> Notice:
    """Return the notice of a line that was left out because the file ends within it."""
    return Notice(
        "cut-last-line",
        f"{name}, line {line}: the last line is cut short and was left out. "
        "The recording probably stopped while it was written.",
    )


def exclude_lines(lines: Sequence[int] | IntArray, shown: int = 3) -> str:
    """Return the options that leave out lines, ``--exclude lines=7 --exclude lines=9:12``."""
    numbers = np.asarray(lines, dtype=np.int64)
    blocks = np.split(numbers, np.flatnonzero(np.diff(numbers) != 1) + 1)
    ends = [f"{b[0]}:{b[-1]}" if b.size > 1 else f"{b[0]}" for b in blocks[:shown]]
    more = f" and so on for {count_of(len(blocks) - shown, 'more place')}"
    return " ".join(f"--exclude lines={end}" for end in ends) + more * (len(blocks) > shown)


def count_of(number: int, noun: str) -> str:
    """Return ``1 line`` or ``3 lines``."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def check_hold(role: str, hold: str | None) -> Hold | None:
    """Return a hold as given for a role; ``UsageError`` if it is none."""
    if hold is None or hold in get_args(Hold):
        return cast("Hold | None", hold)
    raise UsageError(
        f"'{hold}' is not a hold, as given for '{role}'.",
        remedy=f"Choose one of {', '.join(get_args(Hold))}.",
    )
