"""Logs of the PuTTY terminal: what a microcontroller printed, from mid-line on.

The terminal starts logging in the middle of a line, and what was still in the buffer
overprints the first lines, so some lines hold the pieces of two.
"""

from __future__ import annotations

from collections.abc import Sequence

from .hints import Hints

_MARK = "=~=~=~=~="


def recognise(lines: Sequence[str]) -> Hints | None:
    """Return hints when the first line is PuTTY's banner."""
    for index, line in enumerate(lines):
        if not line.strip():
            continue
        if line.startswith(_MARK) and "PuTTY log" in line:
            return Hints("PuTTY log", data_from=index + 1, serial=True, session_mark=_MARK)
        break
    return None
