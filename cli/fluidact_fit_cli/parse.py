"""The small languages of option values: ``ROLE=FROM:TO@T``, ``START:END``, numbers."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from fluidact_fit.errors import closest
from fluidact_fit.families import family_names
from fluidact_fit.units.quantities import (
    NumberWithUnit,
    in_si,
    parse_number,
    parse_quantity,
)

if TYPE_CHECKING:
    ParamType = click.ParamType[Any]
else:
    ParamType = click.ParamType  # not generic before click 8.4


def _in_one_unit(
    start: float | NumberWithUnit | None, end: float | NumberWithUnit | None
) -> tuple[Any, Any]:
    """A pair in which a start without a unit has that of the end."""
    if isinstance(start, float) and isinstance(end, NumberWithUnit):
        start = NumberWithUnit(start, end.unit)
    return start, end


def parse_quantities(text: str) -> tuple[float | NumberWithUnit, float | NumberWithUnit]:
    """Return ``LOW:HIGH``, numbers in SI or with a unit; one behind both is that of both."""
    low, high = _in_one_unit(*map(parse_quantity, _split(text)))
    if isinstance(low, float) and isinstance(high, float):
        return parse_range(text)
    return low, high


def parse_seconds(text: str) -> float:
    """Return a time above zero [s]."""
    if (value := in_si(text, "s")) <= 0.0:
        raise ValueError(f"'{text}' is not above zero")
    return value


def parse_positive(text: str) -> float:
    """Return a number above zero."""
    if (value := parse_number(text)) <= 0.0:
        raise ValueError(f"'{text}' is not above zero")
    return value


def parse_turn(text: str) -> float:
    """Return a number above zero, or zero for ``none``."""
    return 0.0 if text.strip() == "none" else parse_positive(text)


def parse_count(text: str) -> int:
    """Return a whole number above zero."""
    if not re.fullmatch("[0-9]{1,9}", text.strip()) or not int(text):
        raise ValueError(f"'{text}' is not a whole number above zero")
    return int(text)


def parse_sign(text: str) -> str:
    """Return one sign, which may be named: ``tab`` or ``blank``."""
    sign = {"tab": "\t", "\\t": "\t", "blank": " ", "space": " "}.get(text.casefold(), text)
    if len(sign) != 1:
        raise ValueError(f"'{text}' is not one sign")
    return sign


def parse_factor(text: str) -> float:
    """Return a number that is not zero."""
    if (value := parse_number(text)) == 0.0:
        raise ValueError("a factor of zero would erase the column")
    return value


def _split(text: str) -> tuple[str, str]:
    before, colon, after = text.partition(":")
    if not colon:
        raise ValueError(f"'{text}' has no colon")
    return before.strip(), after.strip()


def parse_range(text: str) -> tuple[float, float]:
    """Return ``LOW:HIGH`` in increasing order."""
    low, high = map(parse_number, _split(text))
    if low >= high:
        raise ValueError(f"{low:g} is not below {high:g}")
    return low, high


def parse_window(text: str) -> tuple[float | None, float | None]:
    """Return ``START:END`` [s]; a side that is empty is ``None``.

    A unit behind ``END`` is that of both, unless ``START`` has its own.
    """
    sides = _split(text)
    if not any(sides):
        raise ValueError("both sides are empty")
    ends = _in_one_unit(*(parse_quantity(side) if side else None for side in sides))
    low, high = (x.in_unit("s") if isinstance(x, NumberWithUnit) else x for x in ends)
    if low is not None and high is not None and low >= high:
        raise ValueError(f"{low:g} is not before {high:g}")
    return low, high


def parse_step(text: str) -> tuple[float, float, float, str | None]:
    """Return ``FROM:TO[@T]`` as both values, ``T`` [s] and the unit behind the values, if any.

    ``T`` may have a unit of its own, and is 0 where it is left out.
    """
    start, rest = _split(text)
    end, at, instant = rest.partition("@")
    values = parse_quantity(start), parse_quantity(end)
    units = [v.unit for v in values if isinstance(v, NumberWithUnit)]
    if units and (isinstance(values[1], float) or len(set(units)) > 1):
        raise ValueError(f"'{start}:{end}': give one unit, behind {end or 'the second value'}")
    low, high = (v.number if isinstance(v, NumberWithUnit) else v for v in values)
    return low, high, in_si(instant, "s") if at else 0.0, units[0] if units else None


def parse_family(text: str) -> str:
    """Return the name of a model family."""
    if text not in family_names():
        close = closest(text, family_names())
        hint = f", and '{close}' is the nearest name" if close else ""
        raise ValueError(f"'{text}' is no model family{hint}")
    return text


def parse_hold(text: str) -> str:
    """Return the name of a hold."""
    if text not in ("zoh", "foh", "smooth", "auto"):
        raise ValueError(f"'{text}' is not a hold; choose zoh, foh, smooth or auto")
    return text


def parse_text(text: str) -> str:
    """Return text that is not empty."""
    if not text.strip():
        raise ValueError("the value is empty")
    return text.strip()


def assigned(parse: Callable[[str], Any]) -> Callable[[str], tuple[str, Any]]:
    """``KEY=VALUE`` with a value in a small language, as key and value."""

    def parse_both(text: str) -> tuple[str, Any]:
        key, sign, value = text.partition("=")
        if not sign:
            raise ValueError("there is no '='")
        if not key.strip():
            raise ValueError("there is nothing before the '='")
        return key.strip(), parse(value)

    return parse_both


class Parsed(ParamType):
    """A value in a small language, as ``START:END``; an error shows this form and an example.

    ``parse`` turns text into the value and raises ``ValueError``; ``expected`` says in words what
    may be given where the form does not.
    """

    def __init__(
        self, form: str, example: str, parse: Callable[[str], Any], expected: str = ""
    ) -> None:
        self.name = form
        self.expected = expected or form
        self.example = example
        self.parse = parse

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Parse text; anything else has been parsed before."""
        if not isinstance(value, str):
            return value
        try:
            return self.parse(value)
        except ValueError as error:
            why = str(error)
            what = why if why.startswith(f"'{value}'") else f"'{value}': {why}"
            text = f"{what}.\nExpected {self.expected}, for example {self.example}"
            raise click.BadParameter(text, ctx=ctx, param=param) from None

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """The form, as written."""
        return self.name


def collect(ctx: click.Context, param: click.Parameter, value: Any) -> dict[str, Any]:
    """Turn repeated ``KEY=VALUE`` options into a mapping; a key given twice is refused."""
    found: dict[str, Any] = {}
    for key, content in value:
        if key in found:
            raise click.BadParameter(
                f"'{key}' was given twice. Keep one of them.", ctx=ctx, param=param
            )
        found[key] = content
    return found
