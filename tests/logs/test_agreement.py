"""Units that contradict each other: header and option, two roles, two logs, gauge and absolute."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.errors import UnitError
from fluidact_fit.family import Role
from fluidact_fit.logs import experiments, read_log
from fluidact_fit.logs.columns import bind_role

LINE = ff.get_family("line").variants[0]


def write(path: Path, header: str, *scales: float, zeros: tuple[float, float] = (0, 0)) -> Path:
    """A step down a line, in pascals divided by the scales; ``zeros`` are read at no pressure."""
    t = np.arange(0.0, 2.0, 0.005)
    inlet = np.where(t > 0.5, 3e5, 1e5)
    outlet = 1e5 + 2e5 * (1.0 - np.exp(-np.clip(t - 0.515, 0.0, None) / 0.05))
    outlet += np.random.default_rng(0).normal(0.0, 300.0, t.size)
    signals = zip((t, inlet, outlet), scales or (1.0, 1.0, 1.0), (0.0, *zeros))
    columns = [c / s + zero for c, s, zero in signals]
    np.savetxt(path, np.column_stack(columns), "%.9g", ",", header=header, comments="")
    return path


def codes(log: ff.Log) -> dict[str, str]:
    return {n.code: n.message for n in experiments(log, LINE)[1]}


def test_a_header_that_is_a_unit_gives_the_unit(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "ms,bar,p_out (bar)", 1e-3, 1e5, 1e5)
    columns = {"time": "ms", "inlet": "bar", "outlet": "p_out"}
    (run,), said = experiments(read_log(path, columns=columns), LINE)
    assert run.time[-1] == pytest.approx(1.995)
    assert run["inlet"][0] == pytest.approx(1e5)
    assert "unit-assumed" not in {n.code for n in said}


def test_the_option_wins_over_a_header_that_is_a_unit(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "ms,inlet [Pa],outlet [Pa]", 1e-6, 1.0, 1.0)
    log = read_log(path, columns={"time": "ms"}, units={"time": "us"})
    (run,), said = experiments(log, LINE)
    assert run.time[-1] == pytest.approx(1.995)
    assert "1 us is 0.001 ms" in {n.code: n.message for n in said}["unit-overridden"]


def test_a_header_of_one_letter_may_be_a_name(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "time [s],s,m")
    log = read_log(path, columns={"position": "s", "height": "m"})
    bound = [bind_role(log, Role(name, "m", "")) for name in ("position", "height")]
    assert [b is not None and b.assumed for b in bound] == [True, False]
    other = read_log(write(tmp_path / "b.csv", "time [s],rpm,m"), columns={"position": "rpm"})
    with pytest.raises(UnitError, match="'rpm' is an angular speed"):
        bind_role(other, Role("position", "m", ""))


def test_a_contradicted_header_is_warned_of(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "time [s],inlet (bar),outlet (bar)", 1.0, 1e5, 1e5)
    message = codes(read_log(path, units={"inlet": "psi"}))["unit-overridden"]
    for words in ("'inlet (bar)' says bar", "--unit inlet=psi", "1 psi is 0.0689476 bar"):
        assert words in message


@pytest.mark.parametrize("scale", [1.0, -1.0])  # a sign is no sensor's gain
def test_a_header_of_another_quantity_is_warned_of(scale: float, tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "time [s],inlet (mm),outlet (bar)", 1.0, 1e5, 1e5)
    log = read_log(path, units={"inlet": "bar"}, scales={"inlet": scale})
    message = codes(log)["unit-overridden"]
    assert "bar is a pressure and mm a length" in message


@pytest.mark.parametrize(
    ("header", "unit", "scale"),
    [
        ("inlet [Bar]", "bar", 1.0),
        ("inlet [kN/m2]", "kPa", -1.0),
        ("inlet [mbar]", "bar", 1e-3),  # the factor says the same as the units
        ("inlet [V]", "bar", 2.5),  # a sensor's gain
        ("inlet [wobble]", "bar", 1.0),
        ("inlet [bar]", "barg", 1.0),
        ("inlet [%]", "% of 10 bar", 1.0),
        ("inlet", "bar", 1.0),
    ],
)
def test_what_contradicts_nothing_is_not_warned_of(
    header: str, unit: str, scale: float, tmp_path: Path
) -> None:
    path = write(tmp_path / "a.csv", f"time [s],{header},outlet [Pa]")
    log = read_log(path, columns={"inlet": "#2"}, units={"inlet": unit}, scales={"inlet": scale})
    assert "unit-overridden" not in codes(log)


def test_a_plain_number_stands_for_what_cannot_be_converted(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "time [s],inlet [slpm],outlet [counts]")
    with pytest.raises(UnitError, match="standard state"):
        experiments(read_log(path), LINE)
    assert "unit-overridden" not in codes(read_log(path, units={"inlet": "1"}))


@pytest.mark.parametrize("zeros", [(0.0, 0.0), (0.5, -0.2)])
def test_transducer_voltages_of_a_line_give_the_parameters_of_its_pressures(
    zeros: tuple[float, float], tmp_path: Path
) -> None:
    pascals = ff.fit("line", write(tmp_path / "p.csv", "time [s],inlet [Pa],outlet [Pa]"))
    path = write(tmp_path / "v.csv", "time [s],inlet [V],outlet [V]", 1, 1e5, 1e5, zeros=zeros)
    volts = ff.fit("line", path)
    for name, found in pascals.parameters.items():
        assert volts.parameters[name].number == pytest.approx(found.number, rel=1e-6)
        assert volts.parameters[name].unit == found.unit
        assert volts.parameters[name].std_error == pytest.approx(found.std_error, rel=1e-4)
    assert volts.document.validity["inlet"].unit == "V"
    volts.save(tmp_path / "line.yaml")
    assert ff.load(tmp_path / "line.yaml").parameters["gain"] == volts.parameters["gain"].value


def test_a_file_in_volts_refuses_a_log_in_pascals(tmp_path: Path) -> None:
    found = ff.fit("line", write(tmp_path / "v.csv", "time [s],inlet [V],outlet [V]", 1, 1e5, 1e5))
    pressures = write(tmp_path / "p.csv", "time [s],inlet [Pa],outlet [Pa]")
    other = read_log(pressures, units={"inlet": "Pa", "outlet": "Pa"})
    with pytest.raises(UnitError, match=r"'inlet' in Pa \(p.csv\) is a pressure, and 'inlet' in V"):
        found.simulate(other)


def test_a_file_in_gauge_pressures_refuses_absolute_ones(tmp_path: Path) -> None:
    gauge = write(tmp_path / "g.csv", "time [s],inlet [barg],outlet [barg]", 1, 1e5, 1e5)
    found = ff.fit("line", gauge)
    found.simulate(gauge)
    found.simulate(write(tmp_path / "p.csv", "time [s],inlet [bar],outlet [bar]", 1, 1e5, 1e5))
    other = read_log(write(tmp_path / "a.csv", "time [s],in [bara],out [bara]", 1, 1e5, 1e5),
                     columns={"inlet": "in", "outlet": "out"})  # fmt: skip
    with pytest.raises(UnitError, match=r"the parameter file\) is counted from the atmosphere"):
        found.simulate(other)


@pytest.mark.parametrize("header", ["time [s],inlet [V],outlet [Pa]", "time [s],inlet [V],outlet"])
def test_a_line_in_two_quantities_is_refused(header: str, tmp_path: Path) -> None:
    with pytest.raises(UnitError) as error:
        ff.fit("line", write(tmp_path / "a.csv", header))
    assert str(error.value).startswith("a.csv: 'inlet' in V is a voltage, and 'outlet' in Pa")
    assert "--unit outlet=V" in error.value.remedy


def test_logs_in_two_quantities_are_refused(tmp_path: Path) -> None:
    one = write(tmp_path / "p.csv", "time [s],inlet [Pa],outlet [Pa]")
    two = write(tmp_path / "v.csv", "time [s],inlet [V],outlet [V]", 1.0, 1e5, 1e5)
    with pytest.raises(UnitError, match=r"p.csv, v.csv: 'inlet' in Pa \(p.csv\)"):
        ff.fit("line", [one, two])


def test_gauge_beside_absolute_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "time [s],inlet [barg],outlet [bara]", 1.0, 1e5, 1e5)
    with pytest.raises(UnitError) as error:
        ff.fit("line", path)
    for words in ("'inlet' in barg", "'outlet' in bara", "1.013 bar", "Subtract the pressure"):
        assert words in error.value.text
    # whose offset is free, and which says so
    said = ff.fit("line", read_log(path, units={"outlet": "bar"})).document.warnings
    assert {w.code for w in said} <= {"beginning-left-out"}


def test_gauge_in_one_log_and_absolute_in_another_is_refused(tmp_path: Path) -> None:
    one = write(tmp_path / "g.csv", "time [s],inlet [psig],outlet [psig]", 1.0, 6895.0, 6895.0)
    two = write(tmp_path / "a.csv", "time [s],inlet [psia],outlet [psia]", 1.0, 6895.0, 6895.0)
    with pytest.raises(UnitError, match="counted from the atmosphere"):
        ff.fit("line", [one, two])
    assert ff.fit("line", two).parameters["gain"].number == pytest.approx(1.0, abs=0.01)


def test_an_absolute_pressure_is_warned_of_where_the_model_counts_from_the_atmosphere(
    tmp_path: Path,
) -> None:
    path = write(tmp_path / "a.csv", "time [s],pressure [bara],position [m]")
    twice = {"force": "position", "position": "position"}
    log = read_log(path, columns=twice, units={"force": "N"}, scales={"force": 2.0})
    variant = next(v for v in ff.get_family("spring-cylinder").variants if v.name == "pressure")
    said = {n.code: n.message for n in experiments(log, variant)[1]}
    assert "'pressure' is in bara" in said["absolute-pressure"]
    assert "absolute-pressure" not in codes(
        read_log(write(tmp_path / "b.csv", "time [s],inlet [bara],outlet [bara]"))
    )


def test_a_column_that_was_given_to_a_role_is_no_other_one(tmp_path: Path) -> None:
    """``velocity [rpm]`` was taken for the speed of a piston too, and refused for its unit."""
    path = write(tmp_path / "r.csv", "time [s],torque [N m],velocity [rpm]")
    speed, turning = Role("velocity", "m/s", "speed"), Role("angular_velocity", "rad/s", "speed")
    log = read_log(path, columns={"angular_velocity": "velocity [rpm]"})
    bound = bind_role(log, turning)
    assert bound is not None
    assert bound.column.name == "velocity"
    assert bind_role(log, speed) is None
