"""Decimal signs and signs between thousands: refused where a log does not tell them apart."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from ..errors import LogError
from .layout import ALIKE, BLANKS, GROUPED, NUMBER, Cut

_GROUPED = {sign: re.compile(rf"[+-]?[1-9]\d{{0,2}}{re.escape(sign)}\d{{3}}$") for sign in ".,"}
_SURE = 1000  # cells that tell; no more are looked at
_FEW = 0.1  # of the cells that tell: damaged ones


def find_thousands(sample: Iterable[str], every: Callable[[], Iterable[str]], cut: Cut) -> str:
    """The sign between thousands where cells hold both signs, as ``3.500,25``; empty without one.

    Every such cell of the ``sample`` has to agree, and no cell of ``every`` line may have the sign
    before decimals.
    """
    grouped = GROUPED[cut.decimal]
    cells = (cell for line in sample for cell in cut.split(line))
    written = {found["sign"] for cell in cells if (found := grouped.match(cell))}
    signs = {next((s for s, alike in ALIKE.items() if sign in alike), sign) for sign in written}
    if len(signs) != 1:
        return ""
    sign = signs.pop()
    if sign not in NUMBER:
        return sign
    told = any(
        sign in cell and NUMBER[sign].match(cell) and not _GROUPED[sign].match(cell)
        for line in every()
        for cell in cut.split(line)
    )
    return "" if told else sign


def refuse_ambiguous(
    sample: Sequence[str], every: Callable[[], Iterable[str]], cut: Cut, name: str
) -> None:
    """Refuse a sign that may stand before decimals or between thousands.

    ``3,502`` is 3.502 or 3502. One cell tells for the whole log: ``0,5`` and ``12,25`` hold
    decimals, unless more of them say the same of the other sign. Where commas separate the columns
    a point is a decimal point, and a comma between quotes may be either. Lines of the ``sample``
    are looked at first, ``every`` line of the file where they do not tell.

    Where one sign stands before decimals in some columns and the other one in others, every column
    has to tell for itself.

    Raises
    ------
    LogError
        With both readings.
    """
    first = _tally(sample, cut, name)
    if not first.open or (cut.delimiter == "," and cut.decimal == "."):
        return
    doubtful = _tally(every(), cut, name).doubtful
    if doubtful is not None:
        whole = doubtful.replace(cut.decimal, "")
        raise _refusal(doubtful, whole, repr(cut.decimal), cut, name)


def refuse_commas_for_both(
    names: Sequence[str], sample: Iterable[str], cut: Cut, name: str
) -> None:
    """Refuse whole numbers between commas, twice as many as there are names for them."""
    if cut.delimiter != "," or len(names) < 2 or not all(names):
        return
    rows = [cells for line in sample if len(cells := cut.split(line)) == cut.width]
    if not all(cell.lstrip("+-").isdigit() for row in rows for cell in row):
        return
    raise LogError(
        f"{cut.width} numbers in a row and {len(names)} names: a comma stands between the columns "
        "and before decimals.",
        where=name,
        expected="Expected decimal points, or another sign between the columns.",
        remedy="Export it again with semicolons or tabs between the columns; --skip-rows reads "
        "the numbers as they stand.",
    )


@dataclass
class _Tally:
    """Cells that tell what a sign means: decimals behind it by column, and behind the other one.

    ``grouped`` are the first cells of columns that may have it between thousands.
    """

    certain: Counter[int] = field(default_factory=Counter)
    grouped: dict[int, str] = field(default_factory=dict)
    sure: int = 0
    against: int = 0

    @property
    def both(self) -> bool:
        """Return whether both signs stand before decimals, and not in a damaged cell alone."""
        return self.against > _FEW * self.sure

    @property
    def doubtful(self) -> str | None:
        """A cell that can be read in two ways; ``None`` where others tell which it is."""
        if self.sure <= self.against:
            return next(iter(self.grouped.values()), None)
        alone = (cell for k, cell in self.grouped.items() if not self.certain[k])
        return next(alone, None) if self.both else None

    @property
    def open(self) -> bool:
        """Return whether other lines may hold a cell that these do not tell."""
        return self.doubtful is not None or (self.both and self.sure > 0)


def _tally(lines: Iterable[str], cut: Cut, name: str) -> _Tally:
    found = _Tally()
    other = "," if cut.decimal == "." else "."
    for line in lines:
        for column, cell in enumerate(cut.split(line)):
            if found.sure <= found.against and cut.delimiter != " " and BLANKS.match(cell):
                raise _refusal(cell, re.sub(r"\D", "", cell), "' '", cut, name, blank=True)
            if other in cell and other != cut.delimiter:
                found.against += bool(NUMBER[other].match(cell) and not _GROUPED[other].match(cell))
            elif cut.decimal in cell and cut.is_number(cell):
                if _GROUPED[cut.decimal].match(cell):
                    found.grouped.setdefault(column, cell)
                else:
                    found.certain[column] += 1
                    found.sure += 1
        if found.sure - found.against >= _SURE and not found.both:
            break
    return found


def _refusal(
    cell: str, whole: str, sign: str, cut: Cut, name: str, blank: bool = False
) -> LogError:
    if blank:
        return LogError(
            f"'{cell}' holds a blank: it may be {whole}, or two numbers.",
            where=name,
            expected="Expected numbers without a sign between thousands.",
            remedy="Give --thousands ' ' if it separates thousands, or --delimiter.",
        )
    return LogError(
        f"'{cell}' may be {cell.replace(cut.decimal, '.')} or {whole}, and the other cells of "
        "the log do not tell which.",
        where=name,
        expected=f"Expected one number with other than three digits behind the {sign}, such as "
        f"0{cut.decimal}5, to show that it stands before decimals.",
        remedy=f"Give --decimal {sign} or --thousands {sign}.",
    )
