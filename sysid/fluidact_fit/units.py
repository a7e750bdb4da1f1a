"""Units in and out.

Everything inside the package is SI; units are converted here. Common units are looked
up in a table, because importing pint costs a quarter of a second; everything else, and
the tests of the table, ask pint.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from .errors import UnitError
from .unit_table import (
    ALIASES,
    ANY_CASE,
    DOUBTFUL_HEADERS,
    DOUBTFUL_SUFFIXES,
    GAUGE,
    LAST_WORDS,
    NUMBER,
    QUANTITIES,
    REFERENCED,
    SLIPPED,
    STANDARD_FLOW,
    SUFFIXES,
    TABLE,
)

# What no factor converts to SI, although it is a unit.
_SCALE, _STANDARD = "a scale with an offset", "a flow of gas at a standard state"

_TEMPERATURES = {"degC", "degF", "K"}

_LETTERS = str.maketrans({"µ": "u", "μ": "u", "²": "^2", "³": "^3", "₂": "2", "₃": "3"})
_WIDE = str.maketrans("［］【】（）", "[][]()")
# A name and its unit: "Zeit / ms", "Inlet, psi", "time in ms"; where no sign says so, the unit may
# be a part of the name: "t/ms", "Input 1 PSI".
_MARKED = re.compile(r"(?P<name>.*\S)(?: / |, ?| in )(?P<unit>\S.*)")
_BARE = (
    re.compile(r"(?P<name>[^\W\d]+)/(?P<unit>\S+)"),
    re.compile(r"(?P<name>.*\S) (?P<unit>\S{2,})"),
)

# What may be asked of pint: names with small powers, as products and quotients, with one level
# of brackets. Its own grammar computes what it reads, and 9^9^9 takes forever.
_POWER = r"(?:\^-?(?:[1-9]|0\.5))?"
_FACTOR = rf"(?:1|%|[^\W\d_]\w*){_POWER}"
_GROUP = rf"\({_FACTOR}(?:[ .*/]{_FACTOR})*\)(?:\^-?[1-3])?"
_EXPRESSION = re.compile(rf"(?:{_FACTOR}|{_GROUP})(?:[ .*/](?:{_FACTOR}|{_GROUP}))*")
_LONGEST = 60
_FOR_PINT = {"1": "dimensionless"}

# Motor controllers record in percent of what the motor is rated for.
_RATED = re.compile(
    r"(?:%|percent) (?:of|von) (?P<size>[0-9]+(?:[.,][0-9]+)?(?:[eE][+-]?[0-9]{1,2})?) ?"
    r"(?P<unit>[^\d\s].*)"
)


def normalise_unit(unit: str) -> str:
    """Return a unit in the spelling of the table: ``µ`` as ``u``, ``m²`` and ``m2`` as ``m^2``."""
    text = unit.strip()
    text = text.translate(_LETTERS)
    text = text.replace("°", "deg").replace("·", " ").replace("⋅", " ").replace("**", "^")
    text = re.sub(r"\s*([/*^])\s*", r"\1", re.sub(r"\s+", " ", text))
    text = re.sub(r"(?<=[A-Za-z])-(?=[A-Za-z])", " ", text)  # in-lb
    text = re.sub(r"(?<=[^\W_])\.(?=[^\W\d_])", " ", text)  # kg.m2
    # "m2", "s2": an exponent that lost its caret. "1/s" and "1" stay as they are.
    text = re.sub(r"(?<=[A-Za-z])([23])\b", r"^\1", text)
    if text not in TABLE:
        text = ANY_CASE.get(text.casefold(), text)
    return ALIASES.get(text, text)


def _split_reference(text: str) -> tuple[str, str]:
    """Return a unit of pressure without what it is counted from, and that."""
    match = REFERENCED.fullmatch(text)
    if match is None:
        return text, ""
    letter = (match["inside"] or match["behind"]).casefold()
    return normalise_unit(match["unit"]), "gauge" if letter in GAUGE else "absolute"


def pressure_reference(unit: str) -> str:
    """What a pressure is counted from: ``"gauge"``, ``"absolute"``, or nothing where unsaid."""
    return _split_reference(normalise_unit(unit))[1]


@lru_cache(maxsize=1)
def _registry() -> tuple[Any, dict[Any, str]]:
    """Return pint's registry and the names of dimensions; slow, so only on first need."""
    import pint

    registry = pint.UnitRegistry()
    registry.define("@alias revolution = rev")
    registry.define("kp = kilogram_force")
    first = {what: next(iter(units)) for what, units in QUANTITIES.items()}
    si = {what: registry.parse_units(_FOR_PINT.get(unit, unit)) for what, unit in first.items()}
    return registry, {_dimension((1.0 * unit).to_base_units()): what for what, unit in si.items()}


def _dimension(quantity: Any) -> frozenset[tuple[str, float]]:
    # Not pint's own dimensionality, which takes the radian for a number.
    items = quantity.unit_items()
    return frozenset((name, float(power)) for name, power in items if name != "count")


def _ask_pint(text: str) -> tuple[float, str] | None:
    """Return the factor to SI and what is measured, ``None`` for what pint does not know."""
    if len(text) > _LONGEST or not (text in _FOR_PINT or _EXPRESSION.fullmatch(text)):
        return None
    registry, names = _registry()
    try:
        quantity = 1.0 * registry.parse_units(_FOR_PINT.get(text, text.replace("%", "percent")))
        if not quantity._is_multiplicative:
            return math.nan, _SCALE
        base = quantity.to_base_units()
    except Exception:  # pint raises whatever its tokenizer meets: anything means "unknown"
        return None
    dimension = _dimension(base)
    return float(base.magnitude), names.get(dimension, str(sorted(dimension)))


@lru_cache(maxsize=512)
def _look_up(unit: str) -> tuple[float, str] | None:
    """Return the factor to SI and what is measured, ``None`` when the unit is unknown."""
    if len(unit) > _LONGEST:
        return None
    if rated := _RATED.fullmatch(" ".join(unit.split())):
        found = _look_up(rated["unit"])
        return found and (0.01 * float(rated["size"].replace(",", ".")) * found[0], found[1])
    text, _ = _split_reference(normalise_unit(unit))
    if text in TABLE:
        return TABLE[text]
    if SLIPPED.search(text):
        return None
    return (math.nan, _STANDARD) if STANDARD_FLOW.fullmatch(text) else _ask_pint(text)


def is_share(unit: str) -> bool:
    """Return whether a unit is percent, of whatever is rated or of nothing in particular."""
    return normalise_unit(unit).startswith("%")


def after_number(unit: str) -> str:
    """A unit as it follows a number in a text: behind a space, nothing for a plain number."""
    return "" if unit == "1" else f" {unit}"


def as_share(change: float, value: float) -> str:
    """A change in percent of a value, as it follows the change in a text; nothing of zero."""
    return f" ({100.0 * change / abs(value):+.1f} %)" if value else ""


def is_unit(text: str) -> bool:
    """Return whether a text is a unit at all, one that no factor converts included."""
    return _look_up(text) is not None


def is_known_unit(unit: str) -> bool:
    """Return whether a unit can be converted by a factor."""
    found = _look_up(unit)
    return found is not None and math.isfinite(found[0])


def base_units(unit: str) -> tuple[float, Mapping[str, int]] | None:
    """Return the factor to SI and the powers of its base units.

    Examples
    --------
    >>> base_units("kN s/m")
    (1000.0, {'kilogram': 1, 'second': -1})

    Returns
    -------
    tuple or None
        ``None`` where no factor converts the unit, or a power is not whole.
    """
    text, _ = _split_reference(normalise_unit(unit))
    if len(text) > _LONGEST or not (text in _FOR_PINT or _EXPRESSION.fullmatch(text)):
        return None
    if not is_known_unit(text):
        return None
    registry, _ = _registry()
    base = (1.0 * registry.parse_units(_FOR_PINT.get(text, text))).to_base_units()
    powers = {name: power for name, power in base.unit_items() if name != "count"}
    if any(power != int(power) for power in powers.values()):
        return None
    return float(base.magnitude), {name: int(powers[name]) for name in sorted(powers)}


def same_dimension(a: str, b: str) -> bool:
    """Return whether two units measure the same quantity; false when one is unknown."""
    first, second = _look_up(a), _look_up(b)
    return is_known_unit(a) and first is not None and second is not None and first[1] == second[1]


def dimension_name(unit: str) -> str:
    """Return what a unit measures, for messages: ``"a force"``."""
    found = _look_up(unit)
    if found is None:
        return "unknown"
    return found[1] if found[1] in (*QUANTITIES, _SCALE, _STANDARD) else "another quantity"


def conversion_factor(unit: str, si_unit: str, where: str = "") -> float:
    """Return the factor that turns a value in ``unit`` into ``si_unit``.

    A target of ``"1"`` stands for raw readings: it takes any unit as it is (a
    potentiometer may be read in counts, volts or millivolts, and the controller will read
    it the same way); only ``%`` becomes a fraction.

    Parameters
    ----------
    unit
        As a header or user wrote it, for example ``"mm"``.
    si_unit
        The unit wanted, for example ``"m"``.
    where
        File and column, for the message.

    Returns
    -------
    float
        Factor [si_unit/unit].

    Raises
    ------
    UnitError
        When the unit is unknown, has an offset or measures another quantity.
    """
    found, wanted = _look_up(unit), _look_up(si_unit)
    if wanted is None:
        raise UnitError(f"unit '{si_unit}' is not known.", where=where)
    if found is not None and found[1] == _SCALE:
        raise UnitError(
            f"unit '{unit}' has an offset and cannot be converted by a factor.",
            where=where,
            remedy="Convert the column to an absolute scale first.",
        )
    if wanted[1] == NUMBER:
        return 0.01 if found is not None and normalise_unit(unit) == "%" else 1.0
    if found is None:
        raise _unknown(unit, si_unit, where)
    if found[1] != wanted[1]:
        raise _wrong_quantity(unit, si_unit, where)
    return found[0] / wanted[0]


def _shown(unit: str) -> str:
    return f"'{unit}'" if len(unit) <= _LONGEST else f"'{unit[: _LONGEST - 3]}...'"


def _unknown(unit: str, si_unit: str, where: str) -> UnitError:
    text = normalise_unit(unit)
    what = "is not known."
    if slipped := SLIPPED.search(text):
        size = "a million" if slipped[0][0] == "M" else "a billionth"
        what = f"is taken for a slip: it would be {size} of {slipped[0][1:]!r}."
    elif len(unit) > _LONGEST or not _EXPRESSION.fullmatch(text):
        what = "is not written as a unit: names with small powers, their products and quotients."
    return UnitError(
        f"unit {_shown(unit)} {what}",
        where=where,
        expected=f"Expected {dimension_name(si_unit)} such as '{si_unit}'.",
        remedy=f"Name the unit with --unit ROLE=UNIT, for example '{si_unit}'.",
    )


def _wrong_quantity(unit: str, si_unit: str, where: str) -> UnitError:
    """The error for a unit that measures something else than the role does."""
    expected = f"Expected {dimension_name(si_unit)} such as '{si_unit}'."
    if normalise_unit(unit) == "%":
        return UnitError(
            f"unit '{unit}' is a plain number.",
            where=where,
            expected=expected,
            remedy=f"Say of what: --unit ROLE='% of RATED {si_unit}', where RATED is the value at "
            f"100 %; or --scale ROLE=FACTOR with RATED/100 and --unit ROLE='{si_unit}'.",
        )
    if dimension_name(unit) == _STANDARD:
        return UnitError(
            f"unit '{unit}' counts gas by the volume that it fills at a standard state (such as "
            "0 °C and 1.01325 bar): it says how much gas flows, and how many m3/s that is in the "
            "line depends on the pressure and the temperature there.",
            where=where,
            expected=expected,
            remedy="Convert the column with the standard state of the meter, V = V_n (p_n / p) "
            "(T / T_n) in absolute pressures and kelvins; or, where a role may be a plain number, "
            "give --unit ROLE='1' to take the readings as they are.",
        )
    return UnitError(
        f"unit '{unit}' is {dimension_name(unit)}.",
        where=where,
        expected=expected,
        remedy=(
            "Choose another column, name its unit with --unit ROLE=UNIT, or, where the "
            f"column is a raw sensor value, give --scale ROLE=FACTOR and --unit ROLE={si_unit}."
        ),
    )


def parse_unit_from_header(header: str) -> tuple[str, str | None]:
    """Split a header into name and unit.

    ``pos [mm]``, ``pos (mm)``, ``pos / mm``, ``pos, mm``, ``pos in mm``, ``pos mm`` and ``pos_mm``
    are a position in millimetres. Square brackets always hold a unit; other ways of writing
    one only when the text is a common one (``Force (left)`` is a name), and behind an underscore
    only a short, case-sensitive list counts. A header that is nothing but a common unit (``ms``,
    ``rpm``) is name and unit at once.

    Returns
    -------
    tuple
        Name, and unit or ``None``.
    """
    text = header.strip().translate(_WIDE)
    for opening, closing in ("[]", "()", "{}", "<>"):
        name, found, unit = text.removesuffix(closing).rpartition(opening)
        if not found or not text.endswith(closing) or closing in unit:
            continue
        name = name.strip()
        if opening == "[":
            return name, unit.strip() or None
        if name and _is_unit_in_round_brackets(unit):
            return name, unit.strip()
        # "Inlet, psi (LGR S/N: 1)": a remark
        behind = _unit_behind(name) if opening == "(" else None
        return behind or (text, None)
    for suffix, unit in SUFFIXES.items():
        name = text.removesuffix(f"_{suffix}")
        if name != text and name.strip("_"):
            return name, unit
    return (text, text) if _is_common_unit(text) else _unit_behind(text) or (text, None)


def _unit_behind(text: str) -> tuple[str, str] | None:
    """Name and unit of a header that ends in a common unit without brackets."""
    found = _MARKED.fullmatch(text)
    if found and _is_common_unit(found["unit"]):
        return found["name"], found["unit"]
    for form in _BARE:
        found = form.fullmatch(text)
        if found is None or not _is_common_unit(found["unit"]):
            continue
        # "m/s", "counts/rev" and "N m" are units as they stand
        part = found["unit"] in DOUBTFUL_HEADERS | LAST_WORDS
        if not part and normalise_unit(found["name"]) not in TABLE:
            return found["name"], found["unit"]
    return None


def is_doubtful_suffix(header: str) -> bool:
    """Return whether what was read as a unit may as well be a name or an index.

    One small letter behind an underscore, or a header of one letter or an English word.
    """
    text = header.strip()
    if text in DOUBTFUL_HEADERS:
        return True
    suffix = text.rpartition("_")[2]
    return suffix in DOUBTFUL_SUFFIXES and parse_unit_from_header(header)[1] == suffix


def looks_like_unit(text: str) -> bool:
    """Return whether text that may as well be a name is a unit, one with an offset included.

    Words have to be in the table: pint takes many a name for a unit.
    """
    unit = normalise_unit(text)
    if unit in _TEMPERATURES or _is_common_unit(text):
        return True
    return bool(re.search(r"[/*^]", unit)) and "(" not in unit and is_unit(text)


def _is_common_unit(text: str) -> bool:
    """Return whether a word is a unit of the table, a plain number aside, or counts gas."""
    unit, _ = _split_reference(normalise_unit(text))
    return (unit in TABLE and unit != "1") or bool(STANDARD_FLOW.fullmatch(unit))


def _is_unit_in_round_brackets(text: str) -> bool:
    """Return whether text in round brackets is a unit and not a remark."""
    unit = normalise_unit(text)
    if not unit or unit == "1":
        return text.strip() in {"counts", "raw", "ADC", "-"}
    if SLIPPED.fullmatch(unit):
        return True  # to be refused: taken for a remark it would be SI
    # pint reads many remarks as units ("act" is an attocarat), so a word has to be in the
    # table; an expression with an operator may be anything pint knows.
    return _is_common_unit(text) or (bool(re.search(r"[/*^ ]", unit)) and is_unit(text))
