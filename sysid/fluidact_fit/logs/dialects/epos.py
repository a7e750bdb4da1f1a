"""Exports of the data recorder of EPOS Studio (maxon positioning controllers).

A block of ``key:;value`` lines, then a header whose first cell is empty, a row of units
and rows separated by semicolons. The first column is time.
"""

from __future__ import annotations

from collections.abc import Sequence

from .hints import Hints


def recognise(lines: Sequence[str]) -> Hints | None:
    """Return hints when the first lines name EPOS Studio."""
    if any(line.startswith("EPOS Studio Version") for line in lines[:20]):
        return Hints("EPOS Studio recorder", delimiter=";", rename=_name_time)
    return None


def _name_time(headers: Sequence[str]) -> list[str]:
    names = list(headers)
    if names and not names[0].strip():
        names[0] = "time"
    return names
