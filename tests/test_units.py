"""Units: the table against pint, headers, and messages."""

from __future__ import annotations

import math
import subprocess
import sys

import pytest

from fluidact_fit import units
from fluidact_fit.errors import UnitError


@pytest.mark.parametrize("unit", sorted(units.TABLE))
def test_table_agrees_with_pint(unit: str) -> None:
    factor, signature = units.TABLE[unit]
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
        ("barg", "Pa", 1e5),
        ("bar(a)", "Pa", 1e5),
        ("kPa abs", "Pa", 1e3),
        ("PSIG", "Pa", 6894.757293168361),
        ("gpm", "m^3/s", 6.30901964e-5),
        ("lpm", "m3/s", 1e-3 / 60),
        ("L/min", "m3/s", 1e-3 / 60),
        ("kp/cm2", "Pa", 98066.5),
        ("at", "Pa", 98066.5),
        ("Torr", "Pa", 133.32236842105263),
        ("mmHg", "Pa", 133.322387415),
        ("cmH2O", "Pa", 98.0665),
        ("mmH2O", "Pa", 9.80665),
        ("inH2O", "Pa", 249.08891),
        ("kgf", "N", 9.80665),
        ("oz in", "N m", 7.0615518e-3),
        ("ozf·in", "N m", 7.0615518e-3),
        ("in·lb", "N m", 0.1129848290276167),
        ("in-lb", "N m", 0.1129848290276167),
        ("mil", "m", 2.54e-5),
        ("thou", "m", 2.54e-5),
        ("grad", "rad", math.pi / 200),
        ("turns", "rad", 2 * math.pi),
        ("1/min", "rad/s", math.pi / 30),
        ("% of 9.84 mN m", "N m", 9.84e-5),
        ("% of 9,84 mNm", "N m", 9.84e-5),
        ("percent of 2 kN", "N", 20.0),
        ("Milliseconds", "s", 1e-3),
        ("mS", "s", 1e-3),
        ("Second", "s", 1.0),
        ("Minutes", "s", 60.0),
        ("MPA", "Pa", 1e6),
        ("psid", "Pa", 6894.757293168361),
        ("kg/cm²", "Pa", 98066.5),
        ("lbs/in^2", "Pa", 6894.757293168361),
        ("cmH₂O", "Pa", 98.0665),
        ("cfm", "m^3/s", 4.719474432e-4),
        ("min-1", "rad/s", math.pi / 30),
        ("VDC", "V", 1.0),
        ("KN", "N", 1e3),
    ],
)
def test_factors(unit: str, si: str, factor: float) -> None:
    assert units.conversion_factor(unit, si) == pytest.approx(factor, rel=1e-8)


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
        ("%", "N m", ["% of RATED N m", "RATED/100"]),
        ("9^9^9", "N", ["'9^9^9' is not written as a unit", "small powers"]),
        ("m" * 1000, "N", ["mmm...'", "not written as a unit"]),
        ("NL/min", "m3/s", ["standard state", "pressure and the temperature", "--unit ROLE='1'"]),
        ("Nl/min", "m3/s", ["standard state"]),
        ("slpm", "m3/s", ["standard state"]),
        ("Nm3/h", "m3/s", ["standard state"]),
    ],
)
def test_refusals_name_both_sides(unit: str, si: str, words: list[str]) -> None:
    with pytest.raises(UnitError) as error:
        units.conversion_factor(unit, si, "a.csv, column 'x'")
    assert str(error.value).startswith("a.csv, column 'x': ")
    for word in words:  # the remedy is in the words of the command line, its text in Python's
        assert word in f"{error.value}\n{error.value.remedy}"


@pytest.mark.parametrize(
    ("unit", "si"), [("Mm", "m"), ("Ms", "s"), ("MV", "V"), ("Mm/s", "m/s"), ("nl/min", "m^3/s")]
)
def test_a_slip_of_a_prefix_is_no_unit(unit: str, si: str) -> None:
    """A stroke in 'Mm' made a mass of 5e-8 kg, PASS."""
    with pytest.raises(UnitError, match="taken for a slip"):
        units.conversion_factor(unit, si)


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
        ("mm", "mm", "mm"),
        ("rpm", "rpm", "rpm"),
        ("V", "V", "V"),
        ("barg", "barg", "barg"),
        ("p_barg", "p", "barg"),
        ("p (bara)", "p", "bara"),
        ("q (slpm)", "q", "slpm"),
        ("M [% of 9.84 mN m]", "M", "% of 9.84 mN m"),
        ("M (% of 9.84 mN m)", "M", "% of 9.84 mN m"),
        ("t", "t", None),
        ("counts", "counts", None),
        ("Force (left)", "Force (left)", None),
        ("Force (act)", "Force (act)", None),
        ("Force (1)", "Force (1)", None),
        ("flow (m^3/s)", "flow", "m^3/s"),
        ("pos [wobble]", "pos", "wobble"),
        ("pos []", "pos", None),
        ("Zeit / ms", "Zeit", "ms"),
        ("t/ms", "t", "ms"),
        ("v / m/s", "v", "m/s"),
        ("Flow l/min", "Flow", "l/min"),
        ("Inlet, psi", "Inlet", "psi"),
        ("Inlet, psi (LGR S/N: 1)", "Inlet", "psi"),
        ("time in ms", "time", "ms"),
        ("Input 1 PSI", "Input 1", "PSI"),
        ("p （bar）", "p", "bar"),
        ("p {bar}", "p", "bar"),
        ("t_ns", "t", "ns"),
        ("pos (Mm)", "pos", "Mm"),
        ("counts/rev", "counts/rev", None),
        ("motor turn", "motor turn", None),
        ("valve second", "valve second", None),
        ("x min", "x min", None),
        ("chamber A", "chamber A", None),
        ("Date, time", "Date, time", None),
        ("", "", None),
    ],
)
def test_headers(header: str, name: str, unit: str | None) -> None:
    assert units.parse_unit_from_header(header) == (name, unit)


def test_a_header_of_blanks_takes_no_time() -> None:
    """Its blanks were tried in all ways to split them, which took minutes."""
    long = "x" + " " * 200_000 + "m]"
    assert units.parse_unit_from_header(long) == (long, None)


def test_doubtful_suffixes() -> None:
    assert units.is_doubtful_suffix("valve_m")
    assert units.is_doubtful_suffix("t_s")
    assert not units.is_doubtful_suffix("pos_mm")
    assert not units.is_doubtful_suffix("x [m]")
    assert units.is_doubtful_suffix("V")
    assert units.is_doubtful_suffix("min")
    assert not units.is_doubtful_suffix("ms")


@pytest.mark.parametrize(
    ("unit", "reference"),
    [("barg", "gauge"), ("bara", "absolute"), ("psia", "absolute"), ("kPa(g)", "gauge"),
     ("Bar rel", "gauge"), ("bar, gauge", "gauge"), ("bar abs.", "absolute"), ("barÜ", "gauge"),
     ("ata", "absolute"), ("bar", ""), ("Pag", "gauge"), ("mN", ""), ("nonsense", "")],
)  # fmt: skip
def test_what_a_pressure_is_counted_from(unit: str, reference: str) -> None:
    assert units.pressure_reference(unit) == reference


def test_dimensions() -> None:
    assert units.same_dimension("mm", "in")
    assert not units.same_dimension("mm", "s")
    assert not units.same_dimension("mm", "nonsense")
    assert not units.same_dimension("degC", "m")
    assert units.is_known_unit("psi")
    assert not units.is_known_unit("degC")
    assert units.is_unit("degC")
    assert units.is_unit("slpm")
    assert not units.is_unit("wobble")
    assert not units.is_known_unit("import os")


@pytest.mark.parametrize(
    "text",
    [
        "9^9^9",
        "m^9^9^9",
        "(m^9)^9",
        "m^99999",
        "m^\u0663",
        "((m))",
        "(m",
        "m/",
        "m^9.9",
        "2**99999999",
        "__import__('os')",
        "m;s",
    ],
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


@pytest.mark.parametrize(
    ("unit", "factor", "powers"),
    [
        ("V", 1.0, {"kilogram": 1, "meter": 2, "second": -3, "ampere": -1}),
        ("kN s/m", 1e3, {"kilogram": 1, "second": -1}),
        ("1/(m/s)", 1.0, {"meter": -1, "second": 1}),
        ("rad/s2", 1.0, {"radian": 1, "second": -2}),
        ("1", 1.0, {}),
    ],
)
def test_base_units(unit: str, factor: float, powers: dict[str, int]) -> None:
    assert units.base_units(unit) == (factor, powers)


@pytest.mark.parametrize("unit", ["degC", "m3/(s V Pa^0.5)", "no unit", "x" * 1000, "__import__"])
def test_what_has_no_whole_powers_of_base_units(unit: str) -> None:
    assert units.base_units(unit) is None
