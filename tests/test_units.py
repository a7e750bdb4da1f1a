"""Units: the table against pint, headers, and messages."""

from __future__ import annotations

import math
import re
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fluidact_fit import units
from fluidact_fit.errors import UnitError
from fluidact_fit.logs.header import _clean_unit
from fluidact_fit.units import display_unit, headers, reading, unit_doubt
from fluidact_fit.units.quantities import in_si
from fluidact_fit.units.table import ALIASES, AMBIGUOUS, ATOMS, TABLE, UNREAD
from fluidact_fit.units.words import WORDS


@pytest.mark.parametrize("unit", sorted(TABLE))
def test_table_agrees_with_pint(unit: str) -> None:
    factor, signature = TABLE[unit]
    registry, names = reading.pint_registry()
    asked = (1.0 * registry.parse_units({"1": ""}.get(unit, unit))).to_base_units()
    assert asked.magnitude == pytest.approx(factor, rel=1e-12)
    assert names[reading._dimension(asked)] == signature


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
        ("gon", "rad", math.pi / 200),
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
        ("t/s", "t", "s"),
        ("t/h", "t", "h"),
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
        ("M2", "M2", None),
        ("V2", "V2", None),
        ("in2", "in2", None),
        ("bar2", "bar2", None),
        ("m2", "m2", "m2"),
        ("dm3", "dm3", "dm3"),
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

    monkeypatch.setattr(reading, "pint_registry", refuse)
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
    ("seconds", "text"),
    [(14.6, "14.6 s"), (14_600.0, "14600 s"), (0.0147, "14.7 ms"), (-5e-5, "-50 us"), (0.0, "0 s")],
)
def test_times_are_told_in_a_unit_of_their_size(seconds: float, text: str) -> None:
    assert units.as_time(seconds) == text


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


# ------------------------------------------------- what is written is read, or refused, never SI


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [
        ("daN", "N", 10.0),
        ("kip", "N", 4448.2216152605),
        ("KIPS", "N", 4448.2216152605),
        ("psf", "Pa", 47.88025898033584),
        ("metre", "m", 1.0),
        ("millimeter", "m", 1e-3),
        ("Millimeter", "m", 1e-3),
        ("millimètres", "m", 1e-3),
        ("milímetros", "m", 1e-3),
        ("millimetri", "m", 1e-3),
        ("毫米", "m", 1e-3),
        ("㎜", "m", 1e-3),
        ("Mikrometer", "m", 1e-6),
        ("pulgadas", "m", 0.0254),
        ("Sekunden", "s", 1.0),
        ("secondes", "s", 1.0),
        ("segundos", "s", 1.0),
        ("secondi", "s", 1.0),
        ("Millisekunden", "s", 1e-3),
        ("秒", "s", 1.0),
        ("Std", "s", None),
        ("Umdrehungen pro Minute", "rad/s", math.pi / 30),
        ("U/min", "rad/s", math.pi / 30),
        ("tr/min", "rad/s", math.pi / 30),
        ("giri/min", "rad/s", math.pi / 30),
        ("r.p.m.", "rad/s", math.pi / 30),
        ("转/分", "rad/s", math.pi / 30),
        ("min⁻¹", "rad/s", math.pi / 30),
        ("grados", "rad", math.pi / 180),
        ("º", "rad", math.pi / 180),
        ("Newtonmeter", "N m", 1.0),
        ("Newton-metre", "N m", 1.0),
        ("N·m/rad", "N m/rad", 1.0),
        ("rad/Nm", "rad/(N m)", 1.0),
        ("牛", "N", 1.0),
        ("兆帕", "Pa", 1e6),
        ("巴", "Pa", 1e5),
        ("伏", "V", 1.0),
        ("m s-1", "m/s", 1.0),
        ("metres per second", "m/s", 1.0),
        ("daN/cm²", "Pa", 1e5),
        ("升/分", "m^3/s", 1e-3 / 60),
        ("imp gal/min", "m^3/s", 4.54609e-3 / 60),
        ("UK gpm", "m^3/s", 4.54609e-3 / 60),
        ("US gal/min", "m^3/s", 3.785411784e-3 / 60),
        ("1/100 bar", "Pa", 1e3),
        ("0,01 mm", "m", 1e-5),
        ("10^-3 mm", "m", 1e-6),
        ("10⁻³ mm", "m", 1e-6),
        ("1/10°", "rad", math.pi / 1800),
        ("1/4096 rev", "rad", 2 * math.pi / 4096),
        ("10 ms", "s", 1e-2),
        ("100ns", "s", 1e-7),
        ("%FS", "1", 0.01),
        ("mVolt", "V", 1e-3),
        ("kNewton", "N", 1e3),
        ("milliamps", "A", 1e-3),
        ("mm Hg", "Pa", 133.322387415),
        ("in. H2O", "Pa", 249.08891),
        ("1/10 %", "1", 1e-3),
    ],
)  # fmt: skip
def test_units_of_the_field(unit: str, si: str, factor: float | None) -> None:
    if factor is None:
        with pytest.raises(UnitError, match="not known"):
            units.conversion_factor(unit, si)
    else:
        assert units.conversion_factor(unit, si) == pytest.approx(factor, rel=1e-9)


@pytest.mark.parametrize(
    ("unit", "si", "words"),
    [
        ("Grad", "rad", "deg.*gon"),
        ("grad", "rad", "deg.*gon"),
        ("Grad/s", "rad/s", "deg.*gon"),
        ("kn", "N", "'kN' or a knot"),
        ("mpa", "Pa", "'MPa'"),
        ("mPa", "Pa", "slip"),
        ("MM", "m", "'mm'"),
        ("nN", "N", "slip"),
        ("lb", "N", "is a mass"),
        ("lbs", "N", "is a mass"),
        ("kg", "N", "is a mass"),
        ("lb", "N m", "is a mass"),
        ("tons", "N", "not clear"),
        ("hp", "W", "not clear"),
        ("400 bar", "Pa", "range"),
        ("100 bar", "Pa", "range"),
        ("2 mm", "m", "range"),
        ("1.000 mm", "m", "range"),
        ("mm*10", "m", "not written as a unit"),
        ("attocarat", "kg", "not known"),
        ("furlong", "m", "not supported"),
        ("mNewton", "N", "not known"),
        ("thousandths", "m", "not supported"),
        ("0-10 V", "V", "not written as a unit"),
    ],
)
def test_what_is_doubtful_is_refused(unit: str, si: str, words: str) -> None:
    with pytest.raises(UnitError, match=words) as error:
        units.conversion_factor(unit, si, "a.csv, column 'x'")
    assert "--unit ROLE=" in f"{error.value}\n{error.value.remedy}"


def test_the_force_that_the_name_of_a_mass_may_mean() -> None:
    with pytest.raises(UnitError) as error:
        units.conversion_factor("lbs", "N")
    assert error.value.remedy == "If the force is in 'lbf', give --unit ROLE=lbf."


SHAPES = ("x [{}]", "x ({})", "x {{{}}}", "x<{}>", "x （{}）", "x【{}】", "[{}] x",
          "x [{}] filtered", "x ({}) (left)", "x / {}", "x, {}", "x in {}", "x: {}", "x {}",
          "x_{}")  # fmt: skip
# Without brackets a word may be a part of the name, and is then no unit, or one for its role only.
_NAMES = headers._PARTS | headers._DOUBTFUL_HEADERS | headers._NO_SUFFIXES | {"imperial_gallon"}


def _may_be_a_name(text: str) -> bool:
    plain = reading.read_unit(text).what == "a plain number"
    short = len(text) < 3 and text.isascii()
    return plain or short or text in _NAMES or text.startswith("in ")


@pytest.mark.parametrize("shape", SHAPES)
def test_a_header_takes_what_the_option_takes_and_the_reverse(shape: str) -> None:
    """One text has one meaning, wherever it stands; what is refused here is refused there."""
    texts = {*TABLE, *ALIASES, *ATOMS, *WORDS, *AMBIGUOUS, *UNREAD} - {"", "1", "none", "-", "t"}
    texts |= {f"{a}/{b}" for a in ("mm", "kN", "Newton", "lb") for b in ("s", "min", "mm", "m^2")}
    texts |= {f"{n} {u}" for n in ("1/100", "0,01", "1e-3", "10") for u in ("bar", "ms", "N m")}
    if not re.search(r"[\[(<（【]|\{\{", shape):
        texts = {text for text in texts if not _may_be_a_name(text)}
    for text in sorted(texts):
        said = reading.read_unit(text)
        unit = units.parse_unit_from_header(shape.format(text))[1]
        assert unit is not None, text
        found = reading.read_unit(unit)
        alike = found.what == said.what and found.factor == pytest.approx(said.factor, nan_ok=True)
        assert alike or (said.fault and found.fault), text


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("F (lb)", "F", "lb"),
        ("F (kn)", "F", "kn"),
        ("F (zzz)", "F", "zzz"),
        ("F/kn", "F", "kn"),
        ("F/lb", "F", "lb"),
        ("force_kn", "force", "kn"),
        ("force_lb", "force", "lb"),
        ("force kip", "force", "kip"),
        ("v_mm/s", "v", "mm/s"),
        ("n 1/min", "n", "1/min"),
        ("n_1/min", "n", "1/min"),
        ("q in l / min", "q", "l / min"),
        ("v / (m/s)", "v", "m/s"),
        ("p (bar(g))", "p", "bar(g)"),
        ("p bar(g)", "p", "bar(g)"),
        ("p [bar] (abs)", "p", "bar(abs)"),
        ("p [bar] filtered", "p filtered", "bar"),
        ("p [bar] (psi)", "p [bar]", "bar or psi"),
        ("F [N] [kN]", "F [N]", "N or kN"),
        ("(mm) pos", "pos", "mm"),
        ("chamber (A) [bar]", "chamber (A)", "bar"),
        ("p (in bar)", "p", "bar"),
        ("p (unit: bar)", "p", "bar"),
        ("p in 1/100 bar", "p", "1/100 bar"),
        ("t / 10 ms", "t", "10 ms"),
        ("t_10ms", "t", "10ms"),
        ("x_0.01mm", "x", "0.01mm"),
        ("Weg / 1/100 mm", "Weg", "1/100 mm"),
        ("Weg/0.01mm", "Weg", "0.01mm"),
        ("x 0,1 bar", "x", "0,1 bar"),
        ("p 1/100 [bar]", "p", "1/100 bar"),
        ("p x10 [bar]", "p x10", "x10 bar"),
        ("q imp gal/min", "q", "imp gal/min"),
        ("p (400 bar)", "p", "400 bar"),
        ("p (0-10 V)", "p", "0-10 V"),
        ("p (bar, filtered)", "p", "bar, filtered"),
        ("x (milimeter)", "x", "milimeter"),
        ("x (millimiter)", "x", "millimiter"),
        ("x (\ufffdm)", "x", "\ufffdm"),
        ("angle (Inkremente)", "angle", "Inkremente"),
        ("time_min", "time", "min"),
        ("Zeit h", "Zeit", "h"),
        ("pos_in", "pos", "in"),
        ("Grad", "Grad", "Grad"),
        ("pressure (valve side)", "pressure (valve side)", None),
        ("F (measured)", "F (measured)", None),
        ("speed (filtered)", "speed (filtered)", None),
        ("position (encoder 1)", "position (encoder 1)", None),
        ("p (rod)", "p (rod)", None),
        ("p (B)", "p (B)", None),
        ("F (ist)", "F (ist)", None),
        ("F (AI0)", "F (AI0)", None),
        ("x(t)", "x(t)", None),
        ("V(out)", "V(out)", None),
        ("position[0]", "position[0]", None),
        ("压力（阀侧）", "压力(阀侧)", None),
        ("pressure, filtered", "pressure, filtered", None),
        ("pressure in chamber", "pressure in chamber", None),
        ("pump HP", "pump HP", None),
        ("u_kp", "u_kp", None),
        ("p_A/B", "p_A/B", None),
        ("Input 2 PSI", "Input 2", "PSI"),
        ("p_bar_1", "p_1", "bar"),
        ("p (in bra)", "p", "in bra"),
        ("p (in chamber)", "p (in chamber)", None),
        ("F kN left", "F left", "kN"),
        ("p1_bar_abs", "p1", "bar_abs"),
        ("x_m_1", "x_m_1", None),
        ("mm_pos", "mm_pos", None),
        ("p (in. H2O)", "p", "in. H2O"),
        ("x (thousandths)", "x", "thousandths"),
        ("n (cycles/min)", "n", "cycles/min"),
        ("n (U/s)", "n", "U/s"),
        ("pressure (valve/side)", "pressure (valve/side)", None),
    ],
)
def test_what_is_written_as_a_unit_and_what_is_a_remark(
    header: str, name: str, unit: str | None
) -> None:
    assert units.parse_unit_from_header(header) == (name, unit)


@pytest.mark.parametrize("header", ["(a" * 40_000, "(a)" * 30_000, "a, " * 30_000, "a_" * 50_000,
                                    "x [" + "a" * 90_000 + "]", "1" * 90_000 + " bar"])  # fmt: skip
def test_a_long_header_is_looked_at_once(header: str) -> None:
    unit = units.parse_unit_from_header(header)[1]
    assert unit is None or reading.read_unit(unit).fault or len(unit) < 60


@pytest.mark.parametrize("text", ["m2/" * 30 + "s", "µ" * 61, "bar " * 20 + "m2"])
def test_a_text_too_long_for_a_unit_is_left_alone(text: str) -> None:
    assert units.normalise_unit(f" {text} ") == text
    assert not units.looks_like_unit(text)
    assert units.normalise_unit(" " * 70 + "m2" + " " * 70) == "m^2"


@pytest.mark.parametrize(
    ("cell", "unit"),
    [("[mm]", "mm"), ("bar(g)", "bar(g)"), ("(bar(g))", "bar(g)"), ("[(mm)]", "mm"), ("[]", ""),
     ("Unit: mm", "mm"), ("N/(m/s)", "N/(m/s)"), ("(N/(m/s))", "N/(m/s)"), ("", "")],
)  # fmt: skip
def test_a_cell_of_a_row_of_units(cell: str, unit: str) -> None:
    assert _clean_unit(cell) == unit


def test_a_capital_prefix_is_no_milli() -> None:
    assert units.conversion_factor("MBAR", "Pa") == 100.0
    for slip in ("Mbar", "MBar"):
        with pytest.raises(UnitError):
            units.conversion_factor(slip, "Pa")


def test_words_of_a_remark_are_not_multiplied() -> None:
    """'t in Sekunden' was tonnes times inches times seconds."""
    assert units.parse_unit_from_header("t in Sekunden") == ("t", "Sekunden")
    assert units.parse_unit_from_header("p_1 in daN/cm2") == ("p_1", "daN/cm2")


@pytest.mark.parametrize(("si_unit", "size", "recorded", "shown"), [
    ("s", 0.0123, [], "12.3 ms"),
    ("s", 14.6, [], "14.6 s"),
    ("s", 0.12, ["ms"], "120 ms"),
    ("s", 14.6, ["ms"], "14.6 s"),  # never 1.46e+04 ms
    ("m/s", 0.012, ["ms", "mm"], "12 mm/s"),  # a picture had 0.012 mm/ms
    ("s", 9.99, ["ms"], "9.99 s"),
    ("Pa", 1e9, ["bar"], "1 GPa"),
    ("Pa", 0.0, ["bar (abs)"], "0 bar"),
    ("m3/s/V", 4.2e-5, ["V", "l/min"], "2.52 l/min/V"),
    ("N s/m", 1720.0, ["mm/s", "N"], "1.72 N/(mm/s)"),
    ("N m s/rad", 1e-5, ["mN m", "deg"], "10 µN m s/rad"),
    ("kg m2", 1.171e-6, [], "11.71 g cm2"),
    ("m3/(s V Pa^0.5)", 2.1e-8, ["bar", "V"], "2.1e-08 m3/(s V Pa^0.5)"),
    ("1", 1e-9, ["%", "counts"], "1e-09 1"),
    ("V", 0.02, ["% of 10 V"], "20 mV"),
])  # fmt: skip
def test_values_are_shown_in_a_unit_that_suits_them(
    si_unit: str, size: float, recorded: list[str], shown: str
) -> None:
    found = display_unit(si_unit, size, recorded)
    assert f"{size * found.factor:.5g} {found.unit}" == shown


@pytest.mark.parametrize(
    ("unit", "si_unit", "meant"),
    [("bra", "Pa", "bar"), ("rmp", "rad/s", "rpm"), ("kNn", "N", "kN")],
)
def test_a_misspelt_unit_is_answered_with_the_one_of_that_quantity(
    unit: str, si_unit: str, meant: str
) -> None:
    with pytest.raises(UnitError, match=f"Did you mean '{meant}'"):
        units.conversion_factor(unit, si_unit)


# ------------------------------------------------------------------------- numbers of people


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("50 bar", "Pa", 5e6), ("4.91cm2", "m2", 4.91e-4), ("-3e-1 mm", "m", -3e-4),
        ("12", "s", 12.0), (" .5 ms ", "s", 5e-4), ("25 %", "1", 0.25), ("90°", "rad", math.pi / 2),
        (7.5, "kg", 7.5), (None, "kg", None),
    ],
)  # fmt: skip
def test_a_number_may_have_a_unit(text: object, unit: str, value: object) -> None:
    assert in_si(text, unit) == (pytest.approx(value) if value is not None else None)


@pytest.mark.parametrize(
    ("text", "units", "why"),
    [
        ("50 bar", ("m",), "pressure"), ("50 brr", ("Pa",), "not known"), ("", ("Pa",), "missing"),
        ("1,5 bar", ("Pa",), "decimal comma"), ("bar", ("Pa",), "not a number"),
        ("1e300 km", ("m",), "too large"), ("5 kg", (), "plain number"), ("1 2", ("m",), "not a"),
    ],
)  # fmt: skip
def test_what_is_no_number_of_the_quantity_is_refused(
    text: str, units: tuple[str, ...], why: str
) -> None:
    with pytest.raises(ValueError, match=why):
        in_si(text, *units)


def test_the_first_unit_of_the_same_quantity_is_taken() -> None:
    assert in_si("3 l/min", "m3/s", "m/s") == pytest.approx(5e-5)
    assert in_si("30 mm/s", "m3/s", "m/s") == pytest.approx(0.03)


@given(number=st.floats(-1e6, 1e6).filter(lambda x: x == 0.0 or abs(x) > 1e-6))
def test_a_written_number_reads_back(number: float) -> None:
    assert in_si(f"{number!r} mm", "m") == pytest.approx(1e-3 * number, rel=1e-12, abs=0.0)


@pytest.mark.parametrize(
    ("unit", "said"),
    [("brr", "did you mean 'bar'?"), ("mmm", "did you mean 'mm'?"), ("bar", ""), ("counts", ""),
     ("Grad", "('deg') or gon ('gon')")],
)  # fmt: skip
def test_only_a_unit_that_nobody_uses_or_that_is_not_clear_is_doubted(unit: str, said: str) -> None:
    assert unit_doubt(unit).endswith(said)
    assert bool(unit_doubt(unit)) is bool(said)


@pytest.mark.parametrize(
    ("header", "found"),
    [
        ("Strom I/mA", ("Strom I", "mA")), ("Druck p1/bar", ("Druck p1", "bar")),
        ("Ansteuerung U/V", ("Ansteuerung U", "V")), ("Kraft F/kN", ("Kraft F", "kN")),
        ("Position x/y", ("Position x/y", None)), ("Kanal A/D", ("Kanal A/D", None)),
        ("speed m/s", ("speed", "m/s")), ("Drehzahl tr/mn", ("Drehzahl", "tr/mn")),
    ],
)  # fmt: skip
def test_a_symbol_stands_between_a_name_and_its_unit(
    header: str, found: tuple[str, str | None]
) -> None:
    """As DIN 1313 writes a quantity over its unit."""
    assert units.parse_unit_from_header(header) == found
