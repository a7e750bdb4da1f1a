"""Loggers with habits of their own: what the first lines of a log tell of its writer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

_PUTTY_MARK = "=~=~=~=~="


@dataclass(frozen=True)
class Hints:
    """Knowledge of a logger that the text alone does not show.

    Attributes
    ----------
    name
        For messages and ``inspect``.
    data_from
        Index (from 0) of the first line that can hold data, ``None`` when to be found.
    delimiter
        Known separator, ``None`` when to be found.
    serial
        Whether lines may be cut or overprinted.
    session_mark
        Text that begins a line the logger itself writes between data; such lines are no rows.
    first_header
        Name of the first column where its header is empty.
    """

    name: str
    data_from: int | None = None
    delimiter: str | None = None
    serial: bool = False
    session_mark: str = ""
    first_header: str = ""

    def is_session(self, line: str) -> bool:
        """Whether the logger itself wrote a line between data."""
        return bool(self.session_mark) and line.startswith(self.session_mark)


def recognise(lines: Sequence[str]) -> Hints:
    """Return what is known of the logger that wrote these first lines."""
    first = next((index for index, line in enumerate(lines) if line.strip()), None)
    if first is not None and lines[first].startswith(_PUTTY_MARK) and "PuTTY log" in lines[first]:
        # What a microcontroller printed: the terminal starts logging in the middle of a line,
        # and what was still in the buffer overprints the first lines, so that some lines hold
        # the pieces of two.
        return Hints("PuTTY log", first + 1, serial=True, session_mark=_PUTTY_MARK)
    if any(line.startswith("EPOS Studio Version") for line in lines[:20]):
        # Data recorder of maxon positioning controllers: ``key:;value`` lines, a header whose
        # first cell is empty, a row of units, and rows whose first column is time.
        return Hints("EPOS Studio recorder", delimiter=";", first_header="time")
    return Hints("delimited")
