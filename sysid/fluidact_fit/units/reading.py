"""Read a unit: what it measures, and the factor to SI; or why it is not read.

One function reads the unit of a header, of a row of units, of a file's attribute and of
``--unit``: what one of them takes, the others take. Common units are looked up in a table, because
importing pint costs a quarter of a second; products and quotients of them are left to pint, which
is asked for no other name.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import Any, NamedTuple

from .spelling import LONGEST, NAME, normalise_unit, plain_powers, split_reference
from .table import ALIASES, AMBIGUOUS, ATOMS, QUANTITIES, STANDARD_FLOW, TABLE, UNREAD
from .words import fold

# What no factor converts to SI, although it is a unit.
SCALE, STANDARD = "a scale with an offset", "a flow of gas at a standard state"

# What may be asked of pint: names with small powers, as products and quotients, with one level
# of brackets. Its own grammar computes what it reads, and 9^9^9 takes forever.
_POWER = r"(?:\^-?(?:[1-9]|0\.5))?"
_FACTOR = rf"(?:1|%|{NAME}){_POWER}"
_GROUP = rf"\({_FACTOR}(?:[ .*/]{_FACTOR})*\)(?:\^-?[1-3])?"
_EXPRESSION = re.compile(rf"(?:{_FACTOR}|{_GROUP})(?:[ .*/](?:{_FACTOR}|{_GROUP}))*")
FOR_PINT = {"1": "dimensionless"}

# Motor controllers record in percent of what the motor is rated for.
_RATED = re.compile(
    r"(?:%|percent|Prozent) (?:of|von) (?P<size>[0-9]+(?:[.,][0-9]+)?(?:[eE][+-]?[0-9]{1,2})?) ?"
    r"(?P<unit>[^\d\s].*)"
)
# A size before a unit: "1/100 bar", "0,01 mm", "1e-3 mm", "10^-3 mm", "10 ms", "10ms".
_NUMERAL = r"[0-9]{1,9}(?:[.,][0-9]{1,9})?(?:[eE][+-]?[0-9]{1,2}|\^-?[0-9]{1,2})?"
_SIZED = re.compile(
    rf"(?P<number>{_NUMERAL})(?:/(?P<parts>[0-9]{{1,9}}))?(?:[ *]| ?\* ?)?(?P<unit>[^\d\s*/^.,].*)"
)
_TENTH = re.compile(r"0?[.,]0*1|1[eE]-[0-9]{1,2}|10\^-[0-9]{1,2}|1(?:[.,]0)?|1/[0-9]{1,9}")
# What a prefix makes of a unit, and the units that a slip of it is looked for in: "Mm", "nl", "Ms".
_PREFIXES = {
    "M": "a million", "G": "a billion", "T": "10^12", "k": "a thousand", "h": "a hundred",
    "da": "ten", "d": "a tenth", "c": "a hundredth", "m": "a thousandth", "u": "a millionth",
    "n": "a billionth", "p": "10^-12", "f": "10^-15",
}  # fmt: skip
_SLIPPED = re.compile(
    rf"(?P<prefix>{'|'.join(_PREFIXES)})(?P<unit>s|sec|m|g|N|Pa|bar|V|A|W|Hz|l|L|rad|deg|psi)"
)
_CASELESS: dict[str, str] = {}
for _unit in (*ALIASES, *TABLE):
    if len(_unit) > 1 and ALIASES.get(_unit) != "1":
        _CASELESS[fold(_unit)] = ALIASES.get(_unit, _unit)


class Reading(NamedTuple):
    """Factor to SI and what is measured; or the ``fault`` for which a text is not read.

    ``means_unit`` says whether a unit is written there all the same.
    """

    factor: float
    what: str
    fault: str = ""
    means_unit: bool = True


def pressure_reference(unit: str) -> str:
    """Reference of a pressure: ``"gauge"``, ``"absolute"``, or nothing if not stated."""
    sized = sized_unit(unit)
    return split_reference(normalise_unit(sized["unit"] if sized else unit))[1]


def sized_unit(text: str) -> re.Match[str] | None:
    """The number and the unit of a text that has both, ``None`` of any other."""
    return _SIZED.fullmatch(plain_powers(" ".join(text.split())))


@lru_cache(maxsize=1)
def pint_registry() -> tuple[Any, dict[Any, str]]:
    """Return pint's registry and the names of dimensions; slow, so only on first need."""
    import pint

    registry = pint.UnitRegistry()
    registry.define("@alias revolution = rev")
    registry.define("psf = force_pound / foot ** 2")
    first = {what: next(iter(units)) for what, units in QUANTITIES.items()}
    si = {what: registry.parse_units(FOR_PINT.get(unit, unit)) for what, unit in first.items()}
    return registry, {_dimension((1.0 * unit).to_base_units()): what for what, unit in si.items()}


def _dimension(quantity: Any) -> frozenset[tuple[str, float]]:
    # Not pint's own dimensionality, which takes the radian for a number.
    items = quantity.unit_items()
    return frozenset((name, float(power)) for name, power in items if name != "count")


def is_expression(text: str) -> bool:
    """Return whether a text is a product of names and powers, which pint may be asked of."""
    return len(text) <= LONGEST and (text in FOR_PINT or bool(_EXPRESSION.fullmatch(text)))


def _ask_pint(text: str) -> tuple[float, str] | None:
    """Return the factor to SI and what is measured, ``None`` for what is not in the list."""
    if not is_expression(text) or not ATOMS.issuperset(re.findall(NAME, text)):
        return None
    registry, names = pint_registry()
    try:
        quantity = 1.0 * registry.parse_units(FOR_PINT.get(text, text.replace("%", "percent")))
        if not quantity._is_multiplicative:
            return math.nan, SCALE
        base = quantity.to_base_units()
    except Exception:  # pint raises whatever its tokenizer meets: anything means "unknown"
        return None
    dimension = _dimension(base)
    return float(base.magnitude), names.get(dimension, str(sorted(dimension)))


@lru_cache(maxsize=512)
def read_unit(unit: str) -> Reading:
    """Read a unit, whoever wrote it: a header, a row of units, a file's attribute, a user."""
    if len(unit) > LONGEST:
        return _not_read("is not written as a unit: it is too long.", False)
    text = " ".join(unit.split())
    if rated := _RATED.fullmatch(text):
        of = read_unit(rated["unit"])
        return of._replace(factor=0.01 * float(rated["size"].replace(",", ".")) * of.factor)
    if sized := sized_unit(text):
        return _read_sized(sized)
    text, _ = split_reference(normalise_unit(unit))
    if text in TABLE:
        return Reading(*TABLE[text])
    if STANDARD_FLOW.fullmatch(text):
        return Reading(math.nan, STANDARD)
    found = _ask_pint(text)
    return _why_not(unit, text) if found is None else Reading(*found)


def _read_sized(sized: re.Match[str]) -> Reading:
    """A unit behind the size of one step of it; refused where that may be the range of a sensor."""
    unit, number, parts = sized["unit"], sized["number"], sized["parts"]
    found = read_unit(unit)
    if found.fault:
        return found
    size = float(number.replace(",", ".").replace("10^", "1e"))
    whole = f"{number}/{parts}" if parts else number
    if (parts and not int(parts)) or not size or not math.isfinite(size):
        return _not_read("is not written as a unit: its number is none.")
    size /= int(parts or 1)
    if found.what != "a time" and not _TENTH.fullmatch(whole):
        return _not_read(
            f"may mean values in steps of {whole} {unit}, or in {unit} where {whole} is a range or "
            f"a number of the channel; give --unit ROLE={unit}, with --scale ROLE={size:g} in the "
            "first case."
        )
    return found._replace(factor=size * found.factor)


def _not_read(fault: str, means_unit: bool = True) -> Reading:
    return Reading(math.nan, "", fault, means_unit)


def _why_not(unit: str, text: str) -> Reading:
    """Explain why a text is not read as a unit, if all its unknown parts resemble known ones."""
    names = re.findall(NAME, text)
    unknown = [name for name in names if name not in ATOMS]
    faults = [_fault_of(name) for name in unknown]
    whole = _fault_of(unit.strip()) or _fault_of(text)
    if whole or (faults and all(faults) and is_expression(text)):
        return _not_read(whole or faults[0])
    if likely := _CASELESS.get(fold(text)) or _CASELESS.get(fold(unit.strip())):
        return _not_read(f"is not known in this case: {likely!r}?")
    if not is_expression(text):
        words = "is not written as a unit: names with small powers, their products and quotients."
        return _not_read(words, False)
    return _not_read("is not known.", False)


def _fault_of(name: str) -> str:
    """Explain why a name that is surely a unit is not read; empty for any other."""
    if choices := AMBIGUOUS.get(fold(name)):
        return f"is not clear: it may be {choices}."
    if fold(name) in UNREAD:
        return "is not supported."
    if slip := _SLIPPED.fullmatch(name):
        size = _PREFIXES[slip["prefix"]]
        return f"is taken for a slip: it would be {size} of {slip['unit']!r}."
    return ""


def is_share(unit: str) -> bool:
    """Return whether a unit is percent, of whatever is rated or of nothing in particular."""
    return normalise_unit(unit).startswith("%")


def without_size(unit: str) -> str:
    """A unit without the size of a step before it: ``bar`` of ``1/100 bar``."""
    sized = sized_unit(unit)
    return sized["unit"] if sized else unit


def after_number(unit: str) -> str:
    """A unit as it follows a number in a text: behind a space, nothing for a plain number."""
    return "" if unit == "1" else f" {unit}"


def as_time(seconds: float) -> str:
    """A time in the unit in which it is easily read: ``14.6 s``, ``20 ms``, ``50 us``."""
    size = abs(seconds) or 1.0
    factor, unit = next(((f, u) for f, u in ((1.0, "s"), (1e3, "ms")) if size * f >= 1.0),
                        (1e6, "us"))  # fmt: skip
    digits = 3 if size < 1e3 else len(str(int(size)))
    return f"{seconds * factor:.{digits}g} {unit}"


def as_share(change: float, value: float) -> str:
    """A change in percent of a value, as it follows the change in a text; nothing of zero."""
    return f" ({100.0 * change / abs(value):+.1f} %)" if value else ""


def is_unit(text: str) -> bool:
    """Return whether a text is a unit at all, one that no factor converts included."""
    return not read_unit(text).fault


def is_known_unit(unit: str) -> bool:
    """Return whether a unit can be converted by a factor."""
    return math.isfinite(read_unit(unit).factor)


def means_unit(text: str) -> bool:
    """Return whether a text is a unit, or surely one that is not read (``kn``, ``400 bar``)."""
    return read_unit(text).means_unit


def is_common_unit(text: str) -> bool:
    """Return whether a text is a unit of the table, a plain number aside, or counts gas."""
    if sized := sized_unit(text):
        text = sized["unit"]
    unit, _ = split_reference(normalise_unit(text))
    return (unit in TABLE and unit != "1") or bool(STANDARD_FLOW.fullmatch(unit))
