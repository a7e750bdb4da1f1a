"""Numbers as people write them: in SI, or with a unit behind them."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from typing import Any

from ..errors import UnitError
from .conversion import conversion_factor, same_dimension

_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_DECIMAL_COMMA = re.compile(r"[+-]?[0-9]*,[0-9]+([eE][+-]?[0-9]+)?")
# Beyond these, squares and quotients of a quantity in SI leave the range of floating point.
_SMALLEST, _LARGEST = 1e-30, 1e30


def plausible(value: float) -> float:
    """Return a number of a size that a quantity can have in SI; ``ValueError`` for another."""
    if not abs(value) <= sys.float_info.max:  # an integer can be beyond it
        raise ValueError("not finite")
    if abs(value) > _LARGEST:
        raise ValueError(f"too large: nothing in SI is above {_LARGEST:.0e}")
    if 0.0 < abs(value) < _SMALLEST:
        raise ValueError(f"too small: nothing in SI but zero is below {_SMALLEST:.0e}")
    return value


def parse_number(text: str) -> float:
    """Return a finite number; scientific notation, never a decimal comma. Else ``ValueError``."""
    text = text.strip()
    if (comma := _DECIMAL_COMMA.match(text)) and _is_unit(text[comma.end() :].strip() or "m"):
        raise ValueError(f"'{text}' has a decimal comma; write {text.replace(',', '.')}")
    if not _NUMBER.fullmatch(text):
        raise ValueError(f"'{text}' is not a number" if text else "a number is missing")
    try:
        return plausible(float(text))
    except ValueError as error:
        raise ValueError(f"'{text}' is {error}") from None


@dataclass(frozen=True)
class NumberWithUnit:
    """A number with a unit, of which it is not known yet what SI unit is wanted."""

    number: float
    unit: str

    def __repr__(self) -> str:
        return f"{self.number:g} {self.unit}"

    def in_unit(self, si_unit: str) -> float:
        """The number in an SI unit; ``ValueError`` where the unit measures something else."""
        try:
            factor = conversion_factor(self.unit, si_unit)
        except UnitError as error:
            raise ValueError(error.what.rstrip(".")) from None
        return plausible(self.number * factor)


def parse_quantity(text: str) -> float | NumberWithUnit:
    """Return a number, or a number and the unit that stands behind it; else ``ValueError``."""
    found = _NUMBER.match(text.strip())
    unit = text.strip()[found.end() :].strip() if found else ""
    if found is None or not _is_unit(unit):
        return parse_number(text)
    return NumberWithUnit(parse_number(found[0]), unit)


def _is_unit(text: str) -> bool:
    """Return whether a text behind a number begins as a unit does."""
    return text[:1].isalpha() or text[:1] in tuple("°%µ")


def in_si(value: Any, *si_units: str) -> Any:
    """Return a number in the first of some SI units that its own unit measures the same as.

    Parameters
    ----------
    value
        Text as ``"50 bar"`` or ``"5e6"``, or what has been parsed. What is neither text nor has a
        unit comes back as it is.
    *si_units
        Without any, a unit is refused.

    Raises
    ------
    ValueError
        Saying what is wrong.
    """
    if isinstance(value, str):
        value = parse_quantity(value)
    if not isinstance(value, NumberWithUnit):
        return value
    plain = wrong = f"{value.number:g} {value.unit} has a unit, and this is a plain number"
    for unit in si_units:
        if unit == "1" and not same_dimension(value.unit, unit):
            wrong = plain  # a column of raw readings may be in anything, a number may not
            continue
        try:
            return value.in_unit(unit)
        except ValueError as error:
            wrong = str(error)
    raise ValueError(wrong)
