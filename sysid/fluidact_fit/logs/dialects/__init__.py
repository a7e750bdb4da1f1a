"""Loggers with habits of their own: one module each, listed here."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from . import epos, putty
from .hints import Hints

Recognise = Callable[[Sequence[str]], Hints | None]

DIALECTS: tuple[Recognise, ...] = (putty.recognise, epos.recognise)


def recognise(lines: Sequence[str]) -> Hints:
    """Return what is known of the logger that wrote these first lines."""
    for candidate in DIALECTS:
        if (hints := candidate(lines)) is not None:
            return hints
    return Hints("delimited")


__all__ = ["DIALECTS", "Hints", "Recognise", "recognise"]
