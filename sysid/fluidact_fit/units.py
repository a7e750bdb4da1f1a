"""Units in and out.

Everything inside the package is SI; units are converted here. Common units are looked
up in a table, because importing pint costs a quarter of a second; everything else, and
the tests of the table, ask pint.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import Any

from .errors import UnitError

# What is measured, and the common units of it with their factors to SI (the first one).
# The radian counts here although SI calls it dimensionless: "counts" or "Hz" must not pass
# for an angle or a speed in rad/s.
_QUANTITIES: dict[str, dict[str, float]] = {
    "a plain number": {"1": 1.0, "%": 0.01},
    "a time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "a length": {"m": 1.0, "dm": 0.1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "inch": 0.0254},
    "an area": {"m^2": 1.0, "cm^2": 1e-4, "mm^2": 1e-6},
    "a volume": {"m^3": 1.0, "cm^3": 1e-6, "mm^3": 1e-9, "l": 1e-3},
    "a mass": {"kg": 1.0, "g": 1e-3},
    "a frequency": {"Hz": 1.0, "1/s": 1.0, "kHz": 1e3},
    "a force": {"N": 1.0, "kN": 1e3, "mN": 1e-3, "lbf": 4.4482216152605},
    "a torque": {"N m": 1.0, "mN m": 1e-3, "kN m": 1e3, "N cm": 1e-2},
    "a pressure": {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "mbar": 1e2}
    | {"psi": 6894.757293168361},
    "a voltage": {"V": 1.0, "mV": 1e-3},
    "a current": {"A": 1.0, "mA": 1e-3},
    "an angle": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "rev": 2 * math.pi},
    "an angular speed": {"rad/s": 1.0, "deg/s": math.pi / 180, "rev/s": 2 * math.pi}
    | {"rpm": math.pi / 30},
    "an angular acceleration": {"rad/s^2": 1.0},
    "a speed": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "an acceleration": {"m/s^2": 1.0},
    "a volume flow": {"m^3/s": 1.0, "l/min": 1e-3 / 60},
    "a dynamic viscosity": {"Pa s": 1.0},
    "a linear damping": {"N s/m": 1.0},
    "a stiffness": {"N/m": 1.0},
    "a moment of inertia": {"kg m^2": 1.0},
    "a power": {"W": 1.0},
}
_NUMBER, _SCALE = "a plain number", "a scale with an offset"
_TABLE = {unit: (size, what) for what, units in _QUANTITIES.items() for unit, size in units.items()}

# Other spellings, as loggers and people use them; each is looked up after normalisation.
_SPELLINGS = {
    "1": ("", "-", "count", "counts", "raw", "LSB", "lsb", "digit", "digits", "ADC", "none"),
    "%": ("percent", "pct"),
    "s": ("sec", "secs", "second", "seconds"),
    "ms": ("msec",),
    "us": ("usec",),
    "inch": ("in",),
    "l": ("L",),
    "l/min": ("L/min", "lpm"),
    "N m": ("Nm", "N.m", "N*m"),
    "mN m": ("mNm", "mN*m", "Nmm"),
    "kN m": ("kNm",),
    "N cm": ("Ncm",),
    "V": ("volt", "volts"),
    "deg": ("degrees",),
    "rpm": ("1/min", "U/min", "rev/min", "r/min"),
}
_ALIASES = {spelling: unit for unit, several in _SPELLINGS.items() for spelling in several}

# Case may be ignored only where no other unit is meant by another case (not: mPa, MPa).
_ANY_CASE = {u: u for u in ("bar", "mbar", "psi", "rpm", "deg", "rad", "volt", "volts", "percent")}
_ANY_CASE |= {"kpa": "kPa", "sec": "s"}

_TEMPERATURES = {"degC", "degF", "K"}

# What may be asked of pint: names with small powers, products and quotients. Its own grammar
# computes what it reads, and 9^9^9 takes forever.
_EXPRESSION = re.compile(r"(?:(?:(?:[^\W\d_]\w*|%)(?:\^-?\d(?:\.\d)?)?|1)(?![\w^%])|[*/ .()])+")
_LONGEST = 60
_FOR_PINT = {"1": "dimensionless"}

# Suffixes that mean a unit behind an underscore. ``A``, ``a``, ``in``, ``g`` and ``min``
# are not among them: ``p_A``, ``p_in``, ``motor_a`` and ``x_min`` are names.
_SUFFIXES = {
    unit.replace("/", "_"): unit
    for units in (
        "rad/s deg/s mm/s m/s s ms us m mm cm um N kN mN Nm mNm",
        "Pa kPa MPa bar mbar psi V mV mA kg rad deg rpm",
    )
    for unit in units.split()
}
# One small letter may as well be an index (``valve_m``): believed only where it fits the role.
_DOUBTFUL_SUFFIXES = {"s", "m"}

_BRACKETED = re.compile(r"^(?P<name>.*?)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*)\))$")


def normalise_unit(unit: str) -> str:
    """Return a unit in the spelling of the table: ``µ`` as ``u``, ``m²`` and ``m2`` as ``m^2``."""
    text = unit.strip()
    for written, meant in (("µ", "u"), ("μ", "u"), ("²", "^2"), ("³", "^3")):
        text = text.replace(written, meant)
    text = text.replace("°", "deg").replace("·", " ").replace("⋅", " ").replace("**", "^")
    text = re.sub(r"\s*([/*^])\s*", r"\1", re.sub(r"\s+", " ", text))
    # "m2", "s2": an exponent that lost its caret. "1/s" and "1" stay as they are.
    text = re.sub(r"(?<=[A-Za-z])([23])\b", r"^\1", text)
    if text not in _TABLE:
        text = _ANY_CASE.get(text.casefold(), text)
    return _ALIASES.get(text, text)


@lru_cache(maxsize=1)
def _registry() -> tuple[Any, dict[Any, str]]:
    """Return pint's registry and the names of dimensions; slow, so only on first need."""
    import pint

    registry = pint.UnitRegistry()
    registry.define("@alias revolution = rev")
    first = {what: next(iter(units)) for what, units in _QUANTITIES.items()}
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
    text = normalise_unit(unit)
    return _TABLE[text] if text in _TABLE else _ask_pint(text)


def after_number(unit: str) -> str:
    """A unit as it follows a number in a text: behind a space, nothing for a plain number."""
    return "" if unit == "1" else f" {unit}"


def as_share(change: float, value: float) -> str:
    """A change in percent of a value, as it follows the change in a text; nothing of zero."""
    return f" ({100.0 * change / abs(value):+.1f} %)" if value else ""


def is_known_unit(unit: str) -> bool:
    """Return whether a unit can be converted by a factor."""
    found = _look_up(unit)
    return found is not None and found[1] != _SCALE


def same_dimension(a: str, b: str) -> bool:
    """Return whether two units measure the same quantity; false when one is unknown."""
    first, second = _look_up(a), _look_up(b)
    return is_known_unit(a) and first is not None and second is not None and first[1] == second[1]


def dimension_name(unit: str) -> str:
    """Return what a unit measures, for messages: ``"a force"``."""
    found = _look_up(unit)
    if found is None:
        return "unknown"
    return found[1] if found[1] in (*_QUANTITIES, _SCALE) else "another quantity"


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
    if found is not None and found[1] == _SCALE:
        raise UnitError(
            f"unit '{unit}' has an offset and cannot be converted by a factor.",
            where=where,
            remedy="Convert the column to an absolute scale first.",
        )
    if wanted is None:
        raise UnitError(f"unit '{si_unit}' is not known.", where=where)
    if wanted[1] == _NUMBER:
        return 0.01 if found is not None and normalise_unit(unit) == "%" else 1.0
    if found is None:
        raise UnitError(
            f"unit '{unit}' is not known.",
            where=where,
            expected=f"Expected {dimension_name(si_unit)} such as '{si_unit}'.",
            remedy=f"Name the unit with --unit ROLE=UNIT, for example '{si_unit}'.",
        )
    if found[1] != wanted[1]:
        raise UnitError(
            f"unit '{unit}' is {dimension_name(unit)}.",
            where=where,
            expected=f"Expected {dimension_name(si_unit)} such as '{si_unit}'.",
            remedy=(
                "Choose another column, name its unit with --unit ROLE=UNIT, or, where the "
                f"column is a raw sensor value, give --scale ROLE=FACTOR and --unit ROLE={si_unit}."
            ),
        )
    return found[0] / wanted[0]


def parse_unit_from_header(header: str) -> tuple[str, str | None]:
    """Split a header into name and unit.

    ``pos [mm]``, ``pos (mm)`` and ``pos_mm`` are a position in millimetres. Square
    brackets always hold a unit; round ones only when the text is one (``Force (left)`` is
    a name); behind an underscore only a short, case-sensitive list counts.

    Returns
    -------
    tuple
        Name, and unit or ``None``.
    """
    text = header.strip()
    if match := _BRACKETED.match(text):
        name = match["name"].strip()
        if match["square"] is not None:
            return name, match["square"].strip() or None
        if name and _is_unit_in_round_brackets(match["round"]):
            return name, match["round"].strip()
        return text, None
    for suffix, unit in _SUFFIXES.items():
        name = text.removesuffix(f"_{suffix}")
        if name != text and name.strip("_"):
            return name, unit
    return text, None


def is_doubtful_suffix(header: str) -> bool:
    """Return whether the unit was read from one small letter behind an underscore."""
    suffix = header.strip().rpartition("_")[2]
    return suffix in _DOUBTFUL_SUFFIXES and parse_unit_from_header(header)[1] == suffix


def looks_like_unit(text: str) -> bool:
    """Return whether text that may as well be a name is a unit, one with an offset included.

    Words have to be in the table: pint takes many a name for a unit.
    """
    unit = normalise_unit(text)
    if unit in _TEMPERATURES or (unit in _TABLE and unit != "1"):
        return True
    return bool(re.search(r"[/*^]", unit)) and "(" not in unit and is_known_unit(unit)


def _is_unit_in_round_brackets(text: str) -> bool:
    """Return whether text in round brackets is a unit and not a remark."""
    unit = normalise_unit(text)
    if not unit or unit == "1":
        return text.strip() in {"counts", "raw", "ADC", "-"}
    # pint reads many remarks as units ("act" is an attocarat), so a word has to be in the
    # table; an expression with an operator may be anything pint knows.
    return unit in _TABLE or (bool(re.search(r"[/*^ ]", unit)) and is_known_unit(unit))
