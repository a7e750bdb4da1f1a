"""Arguments of calls from Python: what is of another kind is refused before anything is done."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from numbers import Integral, Real
from typing import Any

from .errors import UsageError
from .units.quantities import NumberWithUnit, in_si, parse_quantity, plausible

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
    "seed": (lambda v: _is_whole(v) and v >= 0, "not a whole number from 0", "Give one."),
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


def require_given(kind: str, **given: Any) -> None:
    """Refuse arguments that are not of a kind, as :func:`require` does; ``None`` says nothing."""
    require(kind, **{name: value for name, value in given.items() if value is not None})


def number_in_si(what: str, value: Any, units: Sequence[str]) -> float:
    """A finite number, or text with its unit, in the first of some SI units that it measures.

    ``UsageError``, which begins with ``what``, for anything else.
    """
    try:
        quantity = parse_quantity(value) if isinstance(value, str) else value
        if isinstance(quantity, NumberWithUnit) and not units:
            quantity = quantity.number  # of a name that does not exist: the family refuses it
        number = in_si(quantity, *units)
        if is_truth(number):
            raise TypeError("a truth value")
        return float(plausible(number))
    except (TypeError, ValueError) as error:
        why = f": {error}" if isinstance(value, str | NumberWithUnit) else " is not a number"
        if isinstance(value, float | int):
            why = f" is {error}"
        raise UsageError(
            f"{what}{why}.",
            remedy=f"Give a number in {' or '.join(dict.fromkeys(units)) or 'SI'}, or with a unit "
            "of the same quantity.",
        ) from None


def pair_in_si(what: str, value: Any, units: Sequence[str]) -> tuple[float, float]:
    """A lower and an upper end in SI, each as :func:`number_in_si` takes it (``UsageError``)."""
    if isinstance(value, str) or not hasattr(value, "__len__") or len(value) != 2:
        raise UsageError(
            f"{what} is not a pair of numbers.",
            remedy="Give the lower and the upper end, in SI or as text with its unit.",
        )
    ends = list(value)
    low, high = (number_in_si(what, end, units) for end in ends)
    if not low < high:
        raise UsageError(f"{what}: {shown(ends[0])} is not below {shown(ends[1])}.")
    return low, high


def shown(value: Any) -> str:
    """A value for a message: as it is written, or its type where that is long."""
    try:
        text = repr(value)
    except ValueError:  # an integer of more digits than Python prints
        text = ""
    short = 0 < len(text) <= _LONGEST and "\n" not in text
    return text if short else f"<{type(value).__name__}>"
