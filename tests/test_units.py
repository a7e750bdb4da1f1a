"""Units: the table against pint, headers, and messages."""

from __future__ import annotations

import math
import subprocess
import sys

import pytest

from fluidact_fit import units
from fluidact_fit.errors import UnitError


@pytest.mark.parametrize("unit", sorted(units._TABLE))
def test_table_agrees_with_pint(unit: str) -> None:
    factor, signature = units._TABLE[unit]
    asked = units._ask_pint(unit)
    assert asked is not None
    assert asked[0] == pytest.approx(factor, rel=1e-12)
    assert asked[1] == signature


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [
        ("mm", "m", 1e-3),
        ("µs", "s", 1e-6),
        ("rpm", "rad/s", math.pi / 30),
        ("°", "rad", math.pi / 180),
        ("mm²", "m2", 1e-6),
        ("N·m", "N m", 1.0),
        ("mN*m", "N m", 1e-3),
        ("Bar", "Pa", 1e5),
        ("kN/m2", "Pa", 1e3),
        ("ft", "m", 0.3048),
        ("m/s2", "m/s^2", 1.0),
        ("N s/m", "N s/m", 1.0),
        ("V", "1", 1.0),
        ("mV", "1", 1.0),
        ("no such unit", "1", 1.0),
        ("%", "1", 0.01),
        ("counts", "1", 1.0),
    ],
)
def test_factors(unit: str, si: str, factor: float) -> None:
    assert units.conversion_factor(unit, si) == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "si", "words"),
    [
        ("mm", "N", ["'mm' is a length", "a force", "--unit"]),
        ("%", "N m", ["a plain number", "a torque", "--scale"]),
        ("Hz", "rad/s", ["a frequency", "an angular speed"]),
        ("counts", "rad", ["a plain number", "an angle"]),
        ("furlongish", "m", ["not known", "a length"]),
        ("degC", "m", ["offset"]),
        ("K", "m", ["another quantity", "a length"]),
    ],
)
def test_refusals_name_both_sides(unit: str, si: str, words: list[str]) -> None:
    with pytest.raises(UnitError) as error:
        units.conversion_factor(unit, si, "a.csv, column 'x'")
    assert str(error.value).startswith("a.csv, column 'x': ")
    for word in words:  # the remedy is in the words of the command line, its text in Python's
        assert word in f"{error.value}\n{error.value.remedy}"


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("pos [mm]", "pos", "mm"),
        ("pos(mm)", "pos", "mm"),
        ("pos (mm)", "pos", "mm"),
        ("pos_mm", "pos", "mm"),
        ("t_s", "t", "s"),
        ("u_valve_V", "u_valve", "V"),
        ("force_N", "force", "N"),
        ("v_rad_s", "v", "rad/s"),
        ("torque [N m]", "torque", "N m"),
        ("pos_x", "pos_x", None),
        ("motor_a", "motor_a", None),
        ("p_A", "p_A", None),
        ("p_in", "p_in", None),
        ("x_min", "x_min", None),
        ("force_n", "force_n", None),
        ("_mm", "_mm", None),
        ("mm", "mm", None),
        ("Force (left)", "Force (left)", None),
        ("Force (act)", "Force (act)", None),
        ("Force (1)", "Force (1)", None),
        ("flow (m^3/s)", "flow", "m^3/s"),
        ("pos [wobble]", "pos", "wobble"),
        ("pos []", "pos", None),
        ("", "", None),
    ],
)
def test_headers(header: str, name: str, unit: str | None) -> None:
    assert units.parse_unit_from_header(header) == (name, unit)


def test_doubtful_suffixes() -> None:
    assert units.is_doubtful_suffix("valve_m")
    assert units.is_doubtful_suffix("t_s")
    assert not units.is_doubtful_suffix("pos_mm")
    assert not units.is_doubtful_suffix("x [m]")


def test_dimensions() -> None:
    assert units.same_dimension("mm", "in")
    assert not units.same_dimension("mm", "s")
    assert not units.same_dimension("mm", "nonsense")
    assert not units.same_dimension("degC", "m")
    assert units.is_known_unit("psi")
    assert not units.is_known_unit("degC")
    assert not units.is_known_unit("import os")


@pytest.mark.parametrize(
    "text", ["9^9^9", "m^9^9^9", "(m^9)^9", "m^99999", "2**99999999", "__import__('os')", "m;s"]
)
def test_pint_is_not_asked_to_compute(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> None:
        raise AssertionError(text)

    monkeypatch.setattr(units, "_registry", refuse)
    assert not units.is_known_unit(text)


@pytest.mark.parametrize("unit", ["m3/(s V Pa^0.5)", "N/(m/s)", "kg.m2", "N m s^-1", "%/s", "kΩ"])
def test_expressions_are_known(unit: str) -> None:
    assert units.is_known_unit(unit)


def test_common_units_do_not_import_pint() -> None:
    code = (
        "import sys; from fluidact_fit.units import conversion_factor as c;"
        "c('mm', 'm'); c('N m', 'N m'); c('°', 'rad'); assert 'pint' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("change", "value", "text"),
    [(3.0, -2.0, " (+150.0 %)"), (-0.1, 10.0, " (-1.0 %)"), (1.0, 0.0, "")],
)
def test_a_change_of_nothing_has_no_share(change: float, value: float, text: str) -> None:
    """A friction at its bound of zero that differs by halves ended in a traceback."""
    assert units.as_share(change, value) == text
