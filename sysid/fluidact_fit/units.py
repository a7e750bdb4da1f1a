"""Units in and out.

Everything inside the package is SI; this module is the door. Common units are looked
up in a table, because importing pint costs a quarter of a second; everything else, and
the tests of the table, ask pint.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import Any

from .errors import UnitError

# Exponents of metre, kilogram, second, ampere and radian. The radian counts here although
# SI calls it dimensionless: "counts" or "Hz" must not pass for an angle or a speed in rad/s.
Signature = tuple[float, float, float, float, float]

_ONE: Signature = (0, 0, 0, 0, 0)
_LENGTH: Signature = (1, 0, 0, 0, 0)
_AREA: Signature = (2, 0, 0, 0, 0)
_VOLUME: Signature = (3, 0, 0, 0, 0)
_MASS: Signature = (0, 1, 0, 0, 0)
_TIME: Signature = (0, 0, 1, 0, 0)
_FREQUENCY: Signature = (0, 0, -1, 0, 0)
_FORCE: Signature = (1, 1, -2, 0, 0)
_TORQUE: Signature = (2, 1, -2, 0, 0)
_PRESSURE: Signature = (-1, 1, -2, 0, 0)
_VOLTAGE: Signature = (2, 1, -3, -1, 0)
_CURRENT: Signature = (0, 0, 0, 1, 0)
_ANGLE: Signature = (0, 0, 0, 0, 1)
_ANGULAR_SPEED: Signature = (0, 0, -1, 0, 1)
_ANGULAR_ACCELERATION: Signature = (0, 0, -2, 0, 1)
_SPEED: Signature = (1, 0, -1, 0, 0)
_ACCELERATION: Signature = (1, 0, -2, 0, 0)
_FLOW: Signature = (3, 0, -1, 0, 0)

_DIMENSION_NAMES: dict[Signature, str] = {
    _ONE: "a plain number",
    _LENGTH: "a length",
    _AREA: "an area",
    _VOLUME: "a volume",
    _MASS: "a mass",
    _TIME: "a time",
    _FREQUENCY: "a frequency",
    _FORCE: "a force",
    _TORQUE: "a torque",
    _PRESSURE: "a pressure",
    _VOLTAGE: "a voltage",
    _CURRENT: "a current",
    _ANGLE: "an angle",
    _ANGULAR_SPEED: "an angular speed",
    _ANGULAR_ACCELERATION: "an angular acceleration",
    _SPEED: "a speed",
    _ACCELERATION: "an acceleration",
    _FLOW: "a volume flow",
    (-1, 1, -1, 0, 0): "a dynamic viscosity",
    (0, 1, -1, 0, 0): "a linear damping",
    (0, 1, -2, 0, 0): "a stiffness",
    (2, 1, 0, 0, 0): "a moment of inertia",
    (2, 1, -3, 0, 0): "a power",
}

# Unit -> (factor to SI, signature).
_TABLE: dict[str, tuple[float, Signature]] = {
    "1": (1.0, _ONE),
    "-": (1.0, _ONE),
    "count": (1.0, _ONE),
    "counts": (1.0, _ONE),
    "%": (0.01, _ONE),
    "s": (1.0, _TIME),
    "sec": (1.0, _TIME),
    "ms": (1e-3, _TIME),
    "us": (1e-6, _TIME),
    "ns": (1e-9, _TIME),
    "min": (60.0, _TIME),
    "h": (3600.0, _TIME),
    "m": (1.0, _LENGTH),
    "dm": (0.1, _LENGTH),
    "cm": (1e-2, _LENGTH),
    "mm": (1e-3, _LENGTH),
    "um": (1e-6, _LENGTH),
    "in": (0.0254, _LENGTH),
    "inch": (0.0254, _LENGTH),
    "m^2": (1.0, _AREA),
    "cm^2": (1e-4, _AREA),
    "mm^2": (1e-6, _AREA),
    "m^3": (1.0, _VOLUME),
    "cm^3": (1e-6, _VOLUME),
    "mm^3": (1e-9, _VOLUME),
    "l": (1e-3, _VOLUME),
    "kg": (1.0, _MASS),
    "g": (1e-3, _MASS),
    "Hz": (1.0, _FREQUENCY),
    "1/s": (1.0, _FREQUENCY),
    "kHz": (1e3, _FREQUENCY),
    "N": (1.0, _FORCE),
    "kN": (1e3, _FORCE),
    "mN": (1e-3, _FORCE),
    "lbf": (4.4482216152605, _FORCE),
    "N m": (1.0, _TORQUE),
    "Nm": (1.0, _TORQUE),
    "mN m": (1e-3, _TORQUE),
    "mNm": (1e-3, _TORQUE),
    "kN m": (1e3, _TORQUE),
    "kNm": (1e3, _TORQUE),
    "Ncm": (1e-2, _TORQUE),
    "Pa": (1.0, _PRESSURE),
    "hPa": (1e2, _PRESSURE),
    "kPa": (1e3, _PRESSURE),
    "MPa": (1e6, _PRESSURE),
    "bar": (1e5, _PRESSURE),
    "mbar": (1e2, _PRESSURE),
    "psi": (6894.757293168361, _PRESSURE),
    "V": (1.0, _VOLTAGE),
    "mV": (1e-3, _VOLTAGE),
    "A": (1.0, _CURRENT),
    "mA": (1e-3, _CURRENT),
    "rad": (1.0, _ANGLE),
    "mrad": (1e-3, _ANGLE),
    "deg": (math.pi / 180, _ANGLE),
    "rev": (2 * math.pi, _ANGLE),
    "rad/s": (1.0, _ANGULAR_SPEED),
    "deg/s": (math.pi / 180, _ANGULAR_SPEED),
    "rpm": (2 * math.pi / 60, _ANGULAR_SPEED),
    "rev/s": (2 * math.pi, _ANGULAR_SPEED),
    "rad/s^2": (1.0, _ANGULAR_ACCELERATION),
    "m/s": (1.0, _SPEED),
    "cm/s": (1e-2, _SPEED),
    "mm/s": (1e-3, _SPEED),
    "m/s^2": (1.0, _ACCELERATION),
    "m^3/s": (1.0, _FLOW),
    "l/min": (1e-3 / 60, _FLOW),
}

# Spellings that loggers use. Left: after normalisation; right: an entry of the table.
_ALIASES: dict[str, str] = {
    "": "1",
    "Nmm": "mN m",
    "N.m": "N m",
    "N*m": "N m",
    "mN*m": "mN m",
    "percent": "%",
    "pct": "%",
    "secs": "s",
    "seconds": "s",
    "second": "s",
    "msec": "ms",
    "usec": "us",
    "volt": "V",
    "volts": "V",
    "degrees": "deg",
    "L": "l",
    "L/min": "l/min",
    "lpm": "l/min",
    "1/min": "rpm",
    "U/min": "rpm",
    "rev/min": "rpm",
    "r/min": "rpm",
    "raw": "1",
    "LSB": "1",
    "lsb": "1",
    "digit": "1",
    "digits": "1",
    "ADC": "1",
    "none": "1",
}

# Case may be ignored only where no other unit is meant by another case (not: mPa, MPa).
_ANY_CASE = {"bar", "mbar", "psi", "rpm", "kpa", "deg", "rad", "sec", "volt", "volts", "percent"}

# Spellings pint does not know.
_FOR_PINT = {"-": "dimensionless", "1": "dimensionless", "%": "percent", "Nm": "N*m"}
_FOR_PINT |= {"mNm": "mN*m", "kNm": "kN*m", "Ncm": "N*cm", "in": "inch", "sec": "s"}
_FOR_PINT |= {"Nmm": "N*mm", "counts": "count"}

# Suffixes that mean a unit behind an underscore. ``A``, ``a``, ``in``, ``g`` and ``min``
# are not among them: ``p_A``, ``p_in``, ``motor_a`` and ``x_min`` are names.
_SUFFIXES = {
    "rad_s": "rad/s",
    "deg_s": "deg/s",
    "mm_s": "mm/s",
    "m_s": "m/s",
    **{u: u for u in ("s", "ms", "us", "m", "mm", "cm", "um", "N", "kN", "mN", "Nm", "mNm")},
    **{u: u for u in ("Pa", "kPa", "MPa", "bar", "mbar", "psi", "V", "mV", "mA", "kg")},
    **{u: u for u in ("rad", "deg", "rpm")},
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
    if text not in _TABLE and text.casefold() in _ANY_CASE:
        text = {"kpa": "kPa"}.get(text.casefold(), text.casefold())
    return _ALIASES.get(text, text)


@lru_cache(maxsize=1)
def _registry() -> Any:
    """Return pint's registry; imported on first need because that is slow."""
    import pint

    return pint.UnitRegistry()


def _ask_pint(text: str) -> tuple[float, Signature] | None:
    """Return factor and signature from pint, ``None`` when it does not know the unit.

    Raises
    ------
    UnitError
        When the unit has an offset (a temperature scale): a factor cannot convert it.
    """
    registry = _registry()
    expression = re.sub(r"\brev\b", "revolution", _FOR_PINT.get(text, text))
    if not expression.isprintable() or len(expression) > 60:
        return None
    try:
        quantity = registry.parse_units(expression)
        definition = 1.0 * quantity
        if not definition._is_multiplicative:
            raise UnitError(
                f"unit '{text}' has an offset and cannot be converted by a factor.",
                remedy="Convert the column to an absolute scale first.",
            )
        base = definition.to_base_units()
    except UnitError:
        raise
    except Exception:  # pint raises whatever its tokenizer meets: anything means "unknown"
        return None
    order = ("meter", "kilogram", "second", "ampere", "radian")
    parts = dict(base.unit_items())
    parts.pop("count", None)
    if set(parts) - set(order):
        # Candela, kelvin, byte: known, but no role can ask for them. Their dimension is
        # told apart by an exponent nothing else has.
        return float(base.magnitude), (math.nan, 0, 0, 0, 0)
    exponents = [float(parts.get(name, 0)) for name in order]
    return float(base.magnitude), (
        exponents[0],
        exponents[1],
        exponents[2],
        exponents[3],
        exponents[4],
    )


@lru_cache(maxsize=512)
def _look_up(unit: str) -> tuple[float, Signature] | None:
    """Return factor and signature of a unit, ``None`` when nobody knows it."""
    text = normalise_unit(unit)
    return _TABLE[text] if text in _TABLE else _ask_pint(text)


def is_known_unit(unit: str) -> bool:
    """Return whether a unit can be converted by a factor."""
    try:
        return _look_up(unit) is not None
    except UnitError:
        return False


def same_dimension(a: str, b: str) -> bool:
    """Return whether two units measure the same quantity; false when one is unknown."""
    try:
        first, second = _look_up(a), _look_up(b)
    except UnitError:
        return False
    return first is not None and second is not None and first[1] == second[1]


def dimension_name(unit: str) -> str:
    """Return what a unit measures, for messages: ``"a force"``."""
    found = _look_up(unit)
    if found is None:
        return "unknown"
    return _DIMENSION_NAMES.get(found[1], "another quantity")


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
    try:
        found = _look_up(unit)
    except UnitError as error:
        raise UnitError(error.what, where=where, remedy=error.remedy) from None
    wanted = _look_up(si_unit)
    if wanted is None:
        raise UnitError(f"unit '{si_unit}' is not known.", where=where)
    if wanted[1] == _ONE:
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
    text = header.strip()
    return (
        text.rpartition("_")[2] in _DOUBTFUL_SUFFIXES
        and parse_unit_from_header(text)[1] == text.rpartition("_")[2]
    )


def _is_unit_in_round_brackets(text: str) -> bool:
    """Return whether text in round brackets is a unit and not a remark."""
    unit = normalise_unit(text)
    if not unit or unit == "1":
        return text.strip() in {"counts", "raw", "ADC", "-"}
    # pint reads many remarks as units ("act" is an attocarat), so a word has to be in the
    # table; an expression with an operator may be anything pint knows.
    return unit in _TABLE or (bool(re.search(r"[/*^ ]", unit)) and is_known_unit(unit))
