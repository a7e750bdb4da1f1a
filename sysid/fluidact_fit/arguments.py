"""Arguments of calls from Python: what is of another kind is refused before anything is done."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from numbers import Integral, Real
from typing import Any

from .errors import UsageError

_LONGEST = 60  # characters of a value that is shown as it was written


def is_truth(value: Any) -> bool:
    """Return whether a value is ``True`` or ``False``."""
    of_numpy = getattr(value, "shape", None) == () and str(value.dtype) == "bool"  # not imported
    return isinstance(value, bool) or of_numpy


def is_number(value: Any) -> bool:
    """Return whether a value is a real number that a float can hold; a truth value is none."""
    large = isinstance(value, Integral) and abs(int(value)) > sys.float_info.max
    return isinstance(value, Real) and not is_truth(value) and not large


def _is_whole(value: Any) -> bool:
    return isinstance(value, Integral) and not is_truth(value)


def _is_path(value: Any) -> bool:
    return isinstance(value, str | os.PathLike)


# kind: the test for it, what it is called, and what to do
_KINDS: dict[str, tuple[Callable[[Any], bool], str, str]] = {
    "truth": (is_truth, "not True or False", "Give one of the two."),
    "number": (is_number, "not a number", "Give a number; times in seconds."),
    "whole": (_is_whole, "not a whole number", "Give a whole number."),
    "text": (lambda v: isinstance(v, str), "not text", "Give it as text, in quotes."),
    "path": (_is_path, "not a file name", "Give a path as text or as a Path."),
    "mapping": (
        lambda v: isinstance(v, Mapping) and all(isinstance(name, str) for name in v),
        "not a mapping of name to value",
        "Give a dict, with names as text.",
    ),
    "function": (callable, "not a function", "Give a function that takes a message."),
}


def require(kind: str, **given: Any) -> None:
    """Refuse arguments that are not of a kind (``UsageError``); ``None`` is none of any kind."""
    holds, words, remedy = _KINDS[kind]
    for name, value in given.items():
        if not holds(value):
            raise UsageError(f"{name}={shown(value)} is {words}.", remedy=remedy)


def shown(value: Any) -> str:
    """A value for a message: as it is written, or its type where that is long."""
    try:
        text = repr(value)
    except ValueError:  # an integer of more digits than Python prints
        text = ""
    short = 0 < len(text) <= _LONGEST and "\n" not in text
    return text if short else f"<{type(value).__name__}>"
