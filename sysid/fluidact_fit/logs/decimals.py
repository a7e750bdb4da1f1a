"""Decimal signs and signs between thousands: refused where a log does not tell them apart."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence

from ..errors import LogError
from .layout import Cut

_GROUPED = {sign: re.compile(rf"[+-]?[1-9]\d{{0,2}}{re.escape(sign)}\d{{3}}$") for sign in ".,"}
_BLANK = re.compile(r"[+-]?[1-9]\d{0,2}([ \u00a0\u202f]\d{3})+$")


def refuse_ambiguous(
    sample: Sequence[str], every: Callable[[], Iterable[str]], cut: Cut, name: str
) -> None:
    """Refuse a sign that may stand before decimals or between thousands.

    ``3,502`` is 3.502 or 3502. One cell tells for the whole log: ``0,5`` and ``12,25`` hold
    decimals. Where commas separate the columns a point is a decimal point. Lines of the
    ``sample`` are looked at first, ``every`` line of the file where they do not tell.

    Raises
    ------
    LogError
        With both readings.
    """
    doubtful = _doubtful(sample, cut, name)
    if doubtful is None or cut.delimiter == "," or _doubtful(every(), cut, name) is None:
        return
    whole = doubtful.replace(cut.decimal, "")
    raise _refusal(doubtful, whole, repr(cut.decimal), cut, name)


def _doubtful(lines: Iterable[str], cut: Cut, name: str) -> str | None:
    """A cell that can be read in two ways; ``None`` where another tells which it is."""
    found: str | None = None
    for line in lines:
        for cell in cut.split(line):
            if cut.delimiter != " " and _BLANK.match(cell):
                raise _refusal(cell, re.sub(r"\D", "", cell), "' '", cut, name, blank=True)
            if cut.decimal not in cell or not cut.is_number(cell):
                continue
            if not _GROUPED[cut.decimal].match(cell):
                return None
            found = found or cell
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
        f"'{cell}' may be {cell.replace(cut.decimal, '.')} or {whole}, and no cell of the log "
        "tells which.",
        where=name,
        expected=f"Expected one number with other than three digits behind the {sign}, such as "
        f"0{cut.decimal}5, to show that it stands before decimals.",
        remedy=f"Give --decimal {sign} or --thousands {sign}.",
    )
