"""What inspect suggests is what a fit does next."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
from studies.advice import suggest_for

import fluidact_fit as ff
from fluidact_fit.advice import Suggestion, is_clear, suggest
from fluidact_fit.assessment import leads
from fluidact_fit_cli.main import run


@pytest.mark.parametrize("family", ["line", "hydrostatic", "cylinder-friction", "potentiometer"])
def test_a_disguised_log_is_of_its_family(family: str) -> None:
    found = suggest_for(family, 77)
    assert found.first == family
    assert found.columns
    assert found.alike


def bench(folder: Path, header: str = "Zeit [ms];p1 [bar];p2 [bar]") -> Path:
    """A line of 0.12 s behind a dead time of 20 ms, inlet first."""
    rng = np.random.default_rng(4)
    t = 0.01 * np.arange(600)
    inlet = np.repeat(rng.uniform(1.0, 5.0, 12), 50)
    outlet, y = np.empty(t.size), inlet[0]
    for k in range(t.size):
        outlet[k] = y
        y = inlet[max(k - 2, 0)] + (y - inlet[max(k - 2, 0)]) * np.exp(-0.01 / 0.12)
    outlet += 0.01 * rng.standard_normal(t.size)
    path = folder / "bench.csv"
    table = np.column_stack([1e3 * t, outlet, inlet])  # the outlet stands first
    np.savetxt(path, table, delimiter=";", header=header, comments="", fmt="%.6g")
    return path


@pytest.mark.parametrize("names", ["p1 p2", "p2 p", "p p2", "pressure sensor", "sensor druck"])
def test_what_leads_is_the_input(tmp_path: Path, names: str) -> None:
    """A name that suits either role did not leave the order to the log, and none was tried."""
    header = "t [ms];{} [bar];{} [bar]".format(*names.split())
    (found,) = suggest([ff.read_log(bench(tmp_path, header))], ["bench.csv"], "line")
    assert dict(found.columns) == {"inlet": "#3", "outlet": "#2"}
    assert found.verdict == "pass"
    assert not found.unsure


def test_the_letters_of_a_textbook_are_input_and_output(tmp_path: Path) -> None:
    """``y`` was a position alone, and a pressure of that name in no family."""
    path = bench(tmp_path, "t;y;u")
    rows = np.loadtxt(path, delimiter=";", skiprows=1) * (1e-3, 1e5, 1.0)
    np.savetxt(path, rows, delimiter=";", header="t;y;u", comments="", fmt="%.6g")
    found = suggest([ff.read_log(path)], ["bench.csv"], trial=False)
    columns = {s.family: dict(s.columns) for s in found}
    assert columns["valve"] == {"command": "#3", "outlet": "#2"}


@pytest.mark.parametrize("name", ["Date", "Datum", "fecha"])
def test_days_of_a_spreadsheet_are_suggested_as_the_time(tmp_path: Path, name: str) -> None:
    """They were no time, and a calibration of the date was suggested."""
    path = bench(tmp_path)
    rows = np.loadtxt(path, delimiter=";", skiprows=1)
    rows[:, 0] = 45418.0 + rows[:, 0] / 86.4e6
    header = f"{name};p1 [bar];p2 [bar]"
    np.savetxt(path, rows, delimiter=";", header=header, comments="", fmt=["%.10f", "%.6g", "%.6g"])
    (found,) = suggest([ff.read_log(path)], ["bench.csv"], "line")
    assert f"--column time={name}" in found.command
    assert found.verdict == "pass"


def test_a_role_that_is_named_leaves_the_families_that_have_it(tmp_path: Path) -> None:
    path = bench(tmp_path, "t [s];a [bar];b [bar]")
    log = ff.read_log(path, columns={"pressure": "a [bar]"})
    assert "line" not in {s.family for s in suggest([log], ["bench.csv"], trial=False)}
    log = ff.read_log(path, columns={"inlet": "b [bar]"})
    (found,) = suggest([log], ["bench.csv"], trial=False)
    assert (found.family, dict(found.columns)) == ("line", {"inlet": "#3", "outlet": "#2"})
    assert "--column 'inlet=b [bar]' --column 'outlet=a [bar]'" in found.command


def test_columns_that_could_be_exchanged_are_no_clear_case(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    table = np.column_stack([np.arange(400) * 0.01, rng.normal(size=(400, 2))])
    path = tmp_path / "log.csv"
    np.savetxt(path, table, delimiter=",", header="time [s],a [bar],b [bar]", comments="")
    found = suggest([ff.read_log(path)], ["log.csv"])
    assert not is_clear(found)


def test_order_in_time() -> None:
    u = np.random.default_rng(0).standard_normal(400)
    late = np.r_[np.zeros(3), u[:-3]]
    assert leads(u, late) is True
    assert leads(late, u) is False
    assert leads(u, u[::-1].copy()) is None
    assert leads(u[:20], late[:20]) is None


def test_the_suggested_command_runs_as_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    bench(tmp_path, "Zeit [ms];Druck far [bar];Druck in [bar]")
    assert run(["inspect", "bench.csv"]) == 0
    command = capsys.readouterr().out.splitlines()[-1].strip()
    name, *words = shlex.split(command)
    assert name == "fluidact-fit"
    assert run(words) == 0, capsys.readouterr().err
    assert ff.read_document("line.yaml").parameters["time_constant"].value == pytest.approx(
        0.12, abs=0.005
    )


def test_fit_finds_the_family_and_writes_the_command_that_does_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    bench(tmp_path)
    assert run(["fit", "bench.csv"]) == 0
    said = capsys.readouterr()
    assert "note (family-found): fluidact-fit line bench.csv" in said.err
    document = ff.read_document("line.yaml")
    name, *words = shlex.split(document.provenance.command)
    assert (name, words[0]) == ("fluidact-fit", "line")
    assert run([*words, "-f"]) == 0
    again = ff.read_document("line.yaml")
    assert again.parameters == document.parameters
    assert run(["fit", "bench.csv"]) == 2  # kept


def test_fit_asks_for_what_no_log_tells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    log = Path(__file__).parents[1] / "datasets" / "hydraulic-cylinder" / "trial1.csv"
    assert run(["fit", str(log)]) == 2
    assert "--area-1" in capsys.readouterr().err
    assert run(["inspect", str(log), "--json"]) == 0
    (first, *_) = json.loads(capsys.readouterr().out)["suggestions"]
    assert first["family"] == "hydraulic-cylinder"
    assert "--area-1 NUMBER" in first["command"]
    assert "'command=u [V]'" in first["powershell"]


def test_a_refusal_names_the_log_of_several(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    text = bench(tmp_path).read_text(encoding="utf-8")
    (tmp_path / "other.csv").write_text(text.replace("p1", "p3"), encoding="utf-8")
    words = ["bench.csv", "other.csv", "--column", "inlet=p1", "--column", "outlet=p2"]
    for command in ("fit", "inspect"):
        run([command, *words])
        told = capsys.readouterr()
        assert "other.csv: there is no column 'p1'" in told.out + told.err


def test_without_a_trial_nothing_is_fitted(tmp_path: Path) -> None:
    (found,) = suggest([ff.read_log(bench(tmp_path))], ["bench.csv"], "line", trial=False)
    assert found.verdict == ""
    assert found.fit_percent is None


def test_a_column_called_torque_commands_nothing(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    u = np.repeat(rng.uniform(-50.0, 50.0, 12), 50)
    table = np.column_stack([0.01 * np.arange(600), u, 4.0 * u + rng.normal(size=600)])
    path = tmp_path / "drive.csv"
    np.savetxt(path, table, delimiter=",", comments="",
               header="time [s],Torque actual value [%],Velocity actual value [rpm]")  # fmt: skip
    found = suggest([ff.read_log(path)], ["drive.csv"], trial=False)
    assert "hydraulic-motor" not in {s.family for s in found}


def suggestions_for(
    tmp_path: Path, columns: list[np.ndarray], header: str = ""
) -> list[Suggestion]:
    path = tmp_path / "log.csv"
    np.savetxt(path, np.column_stack(columns), delimiter=",", comments="", header=header)
    return suggest([ff.read_log(path)], ["log.csv"], trial=False)


def test_torque_in_percent_asks_for_the_rated_torque(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the recorder of an EPOS controller writes it."""
    rng = np.random.default_rng(1)
    speed = np.repeat(rng.uniform(-50.0, 50.0, 12), 50)
    columns = [0.01 * np.arange(600), speed, 10.0 * np.sign(speed) + rng.normal(size=600)]
    (found,) = suggestions_for(
        tmp_path, columns, "time [s],Velocity actual [rpm],Torque actual [%]"
    )
    assert (found.family, dict(found.columns)) == (
        "cylinder-friction", {"torque": "#3", "angular_velocity": "#2"}
    )  # fmt: skip
    assert found.asked == ("--unit 'torque=% of RATED N m'",)
    assert "--unit 'torque=% of RATED N m'" in found.command
    monkeypatch.chdir(tmp_path)
    assert run([*shlex.split(found.command.replace("RATED", "0.00984"))[1:], "-q"]) == 0


def test_columns_without_names_and_units_are_listed_as_candidates(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    columns = [0.01 * np.arange(600), *rng.normal(size=(3, 600))]
    found = suggestions_for(tmp_path, columns)
    friction = next(s for s in found if s.family == "cylinder-friction")
    assert friction.candidates == {"force": ("#2", "#3", "#4"), "position": ("#2", "#3", "#4")}
    assert friction.basis == "Neither names nor units tell what #2, #3 and #4 are."
    assert "--column force=#N" in friction.command.replace("'", "")
    assert "--unit force=UNIT" in friction.command
    assert not is_clear(found)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_of_a_raw_reading_and_its_computed_copy_the_copy_is_taken(
    tmp_path: Path, order: tuple[int, int]
) -> None:
    """The voltage was kept and the position dropped, if it stood behind it."""
    t = 0.01 * np.arange(400)
    volts = 2.5 + np.sin(0.7 * t) + 1e-3 * np.random.default_rng(2).standard_normal(t.size)
    columns, names = (volts, 12.0 * volts), ("sensor [V]", "x [mm]")
    path = tmp_path / "log.csv"
    np.savetxt(path, np.column_stack([t, *(columns[k] for k in order)]), delimiter=",",
               header=",".join(["time [s]", *(names[k] for k in order)]), comments="")  # fmt: skip
    families = {s.family for s in suggest([ff.read_log(path)], ["log.csv"], trial=False)}
    assert "backlash" not in families  # it would fit the formula
    (found,) = suggest([ff.read_log(path)], ["log.csv"], "hydrostatic", trial=False)
    assert dict(found.columns) == {"position": f"#{2 + order.index(1)}"}


def test_a_unit_that_is_known_leaves_the_other_columns(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    columns = [0.01 * np.arange(600), *rng.normal(size=(3, 600))]
    (first, *_) = suggestions_for(tmp_path, columns, "time [s],a [m/s],b,c")
    assert (first.family, first.columns["velocity"]) == ("cylinder-friction", "#2")
    assert set(first.candidates.values()) == {("#3", "#4")}


def test_trial_fits_order_the_families_of_two_plain_numbers(tmp_path: Path) -> None:
    """A staircase behind a dead zone: a motor, and no linear valve."""
    rng = np.random.default_rng(1)
    stairs = np.repeat(np.r_[np.arange(12.0), 12.0 - np.arange(12.0)], 50)
    steady = np.maximum(stairs - 3.0, 0.0) * 0.5
    speed = np.empty(stairs.size)
    speed[0] = steady[0]
    for k in range(1, stairs.size):
        speed[k] = speed[k - 1] + (1.0 - np.exp(-0.02 / 0.07)) * (steady[k - 1] - speed[k - 1])
    table = np.column_stack([0.02 * np.arange(stairs.size), stairs, speed])
    table[:, 2] += 0.005 * rng.standard_normal(stairs.size)
    path = tmp_path / "motor.csv"
    np.savetxt(path, table, delimiter=",", fmt="%.5f")
    found = suggest([ff.read_log(path)], ["motor.csv"])
    assert found[0].family == "hydraulic-motor"
    assert found[0].verdict in ("pass", "warn")
    assert not is_clear(found)


@pytest.mark.parametrize("names", ["Druck A,Druck B", "Kammer 1,Kammer 2", "p_A,p_B"])
def test_chambers_are_told_by_number_or_letter(names: str) -> None:
    rng = np.random.default_rng(2)
    first, second = names.split(",")
    columns = {"t [s]": 0.001 * np.arange(500), "Ventil [V]": rng.normal(size=500)}
    columns |= {f"{second} [bar]": rng.normal(size=500), f"{first} [bar]": rng.normal(size=500)}
    columns |= {"Weg [mm]": rng.normal(size=500)}
    found = suggest([ff.read_log(columns)], ["messung.csv"], "hydraulic-cylinder", trial=False)
    assert found[0].columns["pressure_1"] == "#4"
    assert found[0].columns["pressure_2"] == "#3"
