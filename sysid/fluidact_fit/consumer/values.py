"""Numbers of a controller's code against those of a parameter file, as far as their digits say."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..experiment import FloatArray

_LITERAL = (
    r"(?:0[xX][\da-fA-F]++\.?[\da-fA-F]*+(?:[pP][-+]?\d++)?"
    r"|(?:\d++(?:'\d++)*+\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?)"
)
_PART = re.compile(
    rf"\s*+(?:(?P<number>[-+]?\s*+{_LITERAL})(?:[fF](?:16|32|64)|[dD]|[fFlLuU]{{0,3}})(?![\w.'])"
    r"\s*+(?=[{}(),]|\Z)|[{}(),])"
)
_CAST = re.compile(r"\(\s*+(?:const\s++)?(?:long\s++)?(?:double|float|[a-z]\w*_[tT])\s*+\)")
_SIGNED = re.compile(r"-\s*+\(([^()]*+)\)")
_DIGIT = re.compile(r"(?<![\w.])\.?\d")
_LOOSEST = 0.01  # of a value: a literal of few digits does not excuse more
_SINGLE = 2.0**-23  # relative: the literal may be read in single precision


class Literal(NamedTuple):
    """A number as it is written, and half of what its last digit stands for."""

    value: float
    half: float


def literals_in(text: str) -> list[Literal] | None:
    """Return the numbers of a constant or of a list of them; ``None`` where it is computed.

    Casts and brackets around one are understood, and whole numbers in hexadecimal or octal.
    """
    text, at, found = _SIGNED.sub(r"-\1", _CAST.sub("", text)).strip(), 0, list[Literal]()
    while at < len(text):
        part = _PART.match(text, at)
        if part is None:
            return None
        if part["number"]:
            found.append(_literal("".join(part["number"].split())))
        at = part.end()
    return found or None


def is_computed(text: str) -> bool:
    """Return whether a value holds numbers of its own that are not its value."""
    return literals_in(text) is None and _DIGIT.search(text) is not None


def _literal(text: str) -> Literal:
    text = text.replace("'", "")
    if "x" in text.lower():
        return Literal(float.fromhex(text), 0.0)
    if re.fullmatch(r"[-+]?0[0-7]+", text):
        return Literal(float(int(text, 8)), 0.0)
    mantissa, _, exponent = text.lower().partition("e")
    _, point, digits = mantissa.partition(".")
    power = int(exponent or 0)
    exact = not point and not exponent
    half = 0.0 if exact or abs(power) > 300 else 0.5 * 10.0 ** (power - len(digits))
    return Literal(float(text), half)


def differing(numbers: FloatArray, literals: Sequence[Literal]) -> int | None:
    """Return the place of the first number that a literal does not round to.

    Parameters
    ----------
    numbers : (n,)
        Those of the file in the unit of the literals.
    literals
        As many as there are numbers.
    """
    values, halves = np.array(literals).T
    allowed = np.minimum(halves, _LOOSEST * np.abs(numbers)) + _SINGLE * np.abs(numbers)
    wrong = ~(np.abs(values - numbers) <= allowed)
    return int(wrong.argmax()) if wrong.any() else None
