"""Convert a unit to SI, or say why it cannot be converted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..errors import UnitError, closest
from .reading import (
    FOR_PINT,
    SCALE,
    STANDARD,
    is_expression,
    is_known_unit,
    is_unit,
    pint_registry,
    read_unit,
)
from .spelling import LONGEST, normalise_unit, split_reference
from .table import NUMBER, QUANTITIES, TABLE

# The force that the name of a mass may mean.
_FORCES = {"lb": "lbf", "kg": "kgf", "g": "gf", "t": "tf", "oz": "ozf"}


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
    text, _ = split_reference(normalise_unit(unit))
    if not is_expression(text) or not is_known_unit(text):
        return None
    registry, _ = pint_registry()
    base = (1.0 * registry.parse_units(FOR_PINT.get(text, text))).to_base_units()
    powers = {name: power for name, power in base.unit_items() if name != "count"}
    if any(power != int(power) for power in powers.values()):
        return None
    return float(base.magnitude), {name: int(powers[name]) for name in sorted(powers)}


def same_dimension(a: str, b: str) -> bool:
    """Return whether two units measure the same quantity; false when one is unknown."""
    return is_known_unit(a) and is_unit(b) and read_unit(a).what == read_unit(b).what


def dimension_name(unit: str) -> str:
    """Return what a unit measures, for messages: ``"a force"``."""
    found = read_unit(unit)
    if found.fault:
        return "unknown"
    return found.what if found.what in (*QUANTITIES, SCALE, STANDARD) else "another quantity"


def conversion_factor(
    unit: str, si_unit: str, where: str = "", role: str = "ROLE", others: Sequence[str] = ()
) -> float:
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
    where, role
        File and column, and what the option calls it, for the message.
    others
        SI units of other quantities that would do as well, for the message.

    Returns
    -------
    float
        Factor [si_unit/unit].

    Raises
    ------
    UnitError
        When the unit is unknown, has an offset or measures another quantity.
    """
    found, wanted = read_unit(unit), read_unit(si_unit)
    if wanted.fault:
        raise UnitError(f"unit '{si_unit}' is not known.", where=where)
    if found.what == SCALE:
        raise UnitError(
            f"unit '{unit}' has an offset and cannot be converted by a factor.",
            where=where,
            remedy="Convert the column to an absolute scale first.",
        )
    if wanted.what == NUMBER:
        return found.factor if found.what == NUMBER and "%" in normalise_unit(unit) else 1.0
    if found.fault:
        likely = closest(unit, (u for u in TABLE if read_unit(u).what == wanted.what))
        raise UnitError(
            f"unit {_shown(unit)} {found.fault.replace('ROLE', role)}",
            where=where,
            expected=f"Expected {dimension_name(si_unit)} such as '{si_unit}'.",
            remedy=(f"Did you mean '{likely}'? " if likely and not found.means_unit else "")
            + f"Name the unit with --unit {role}=UNIT, for example '{likely or si_unit}'.",
        )
    if found.what != wanted.what:
        raise _wrong_quantity(unit, si_unit, where, role, others)
    return found.factor / wanted.factor


def unit_doubt(unit: str) -> str:
    """Say that a unit is not read, whatever its quantity, with the nearest one; else nothing."""
    found = read_unit(unit)
    if not found.fault:
        return ""
    if found.means_unit:
        return f"unit {_shown(unit)} {found.fault.rstrip('.')}"
    likely = closest(unit, TABLE)
    return f"unit {_shown(unit)} is not known" + (f": did you mean '{likely}'?" if likely else "")


def _quantity(si_unit: str) -> str:
    return f"{dimension_name(si_unit)} such as '{si_unit}'"


def _shown(unit: str) -> str:
    return f"'{unit}'" if len(unit) <= LONGEST else f"'{unit[: LONGEST - 3]}...'"


def _wrong_quantity(
    unit: str, si_unit: str, where: str, role: str, others: Sequence[str]
) -> UnitError:
    """The error for a unit that measures something else than the role does."""
    expected = f"Expected {_quantity(si_unit)}."
    if known := [_quantity(u) for u in others if u != "1"]:
        *most, last = (_quantity(si_unit), *known)
        expected = f"Expected {', '.join(most)} or {last}."
    if normalise_unit(unit) == "%":
        return UnitError(
            f"unit '{unit}' is a plain number.",
            where=where,
            expected=expected,
            remedy=f"Say of what: --unit {role}='% of RATED {si_unit}', where RATED is the value "
            f"at 100 %; or --scale {role}=FACTOR with RATED/100 and --unit {role}='{si_unit}'.",
        )
    if dimension_name(unit) == STANDARD:
        return UnitError(
            f"unit '{unit}' counts gas by the volume that it fills at a standard state (such as "
            "0 °C and 1.01325 bar): it says how much gas flows, and how many m3/s that is in the "
            "line depends on the pressure and the temperature there.",
            where=where,
            expected=expected,
            remedy="Convert the column with the standard state of the meter, V = V_n (p_n / p) "
            "(T / T_n) in absolute pressures and kelvins; or, where a role may be a plain number, "
            f"give --unit {role}='1' to take the readings as they are.",
        )
    if (force := _FORCES.get(normalise_unit(unit))) and same_dimension(si_unit, "N"):
        return UnitError(
            f"unit '{unit}' is a mass.",
            where=where,
            expected=expected,
            remedy=f"If the force is in '{force}', give --unit {role}={force}.",
        )
    return UnitError(
        f"unit '{unit}' is {dimension_name(unit)}.",
        where=where,
        expected=expected,
        remedy=(
            f"Choose another column, name its unit with --unit {role}=UNIT, or, where the column "
            f"is a raw sensor value, give --scale {role}=FACTOR and --unit {role}={si_unit}."
        ),
    )
