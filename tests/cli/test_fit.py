"""Fits from the command line: files, standard output and error, statuses, determinism."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit import read_document

Run = Callable[..., Any]
Log = Callable[..., Path]


def without_time(text: str) -> str:
    return re.sub(r"created: .*", "", text)


def test_fit_writes_the_truth_and_says_so(here: Run, valve: Log, inside: Path) -> None:
    done = here("valve", valve("a.csv"), valve("b.csv", seed=2))
    assert done.status == 0, done.err
    assert "written to valve.yaml" in done.out
    assert "95 % interval" in done.out
    assert "PASS" in done.out
    assert "warning" not in done.err  # on a slow machine there is a line of progress
    document = read_document(inside / "valve.yaml")
    low, high = document.parameters["gain"].ci95  # type: ignore[misc]
    assert low < 1000.0 < high  # type: ignore[operator]
    assert [log.file for log in document.fit.logs] == ["a.csv", "b.csv"]
    assert [p.name for p in inside.glob(".*")] == []


def test_existing_file_is_kept_unless_forced(here: Run, valve: Log, inside: Path) -> None:
    target = inside / "valve.yaml"
    target.write_text("mine\n")
    done = here("valve", valve())
    assert done.status == 2
    assert "--force" in done.err
    assert target.read_text() == "mine\n"
    assert here("valve", valve(), "-f").status == 0
    assert read_document(target).family == "valve"


def test_an_existing_file_is_kept(here: Run, valve: Log, inside: Path) -> None:
    (inside / "valve.yaml").write_text("mine\n")
    done = here("valve", valve())
    assert done.status == 2
    assert done.err.startswith("error: valve.yaml already exists; not overwritten.\n  Give --force")


def test_an_existing_file_hides_no_mistake_in_a_log(here: Run, valve: Log, inside: Path) -> None:
    (inside / "valve.yaml").write_text("mine\n")
    log = valve()
    log.write_text(log.read_text().replace("outlet", "p"))
    for name, told in ((log, "no column is named 'outlet'"), ("none.csv", "none.csv: ")):
        done = here("valve", name)
        assert done.status == 3
        assert told in done.err.splitlines()[0]
        assert "Besides, valve.yaml already exists" in done.err


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["-o", "-"], "--json"),
        (["-o", "nowhere/v.yaml"], "directory"),
        (["-o", "."], "directory"),
        (["-o", ""], "file name"),
        (["-o", "valve.csv", "-f"], "would be overwritten"),
        (["--plot", "v.png", "--report", "v.html", "-o", "v.html"], "both name"),
        (["--validate", "valve.csv"], "twice"),
    ],
)
def test_impossible_outputs(
    options: list[str], told: str, here: Run, valve: Log, inside: Path
) -> None:
    log = valve("valve.csv").read_bytes()
    done = here("valve", "valve.csv", *options)
    assert (done.status, done.out) == (2, "")
    assert told in done.err
    assert [p.name for p in inside.iterdir()] == ["valve.csv"]
    assert (inside / "valve.csv").read_bytes() == log


def test_json_is_all_that_stands_on_standard_output(apart: Run, valve: Log, inside: Path) -> None:
    valve()
    done = apart("valve", "valve.csv", "--json", "-v", "--unit", "time=s", cwd=inside)
    assert done.status == 0
    document = json.loads(done.out)
    assert document["family"] == "valve"
    assert document["provenance"]["logs"][0]["file"] == "valve.csv"
    assert not (inside / "valve.yaml").exists()
    done = apart("valve", "valve.csv", "--json", "-o", "v.yaml", cwd=inside)
    printed, kept = json.loads(done.out), read_document(inside / "v.yaml").to_dict()
    # the file keeps the short ones of the details that are printed
    assert kept["fit"].pop("details").items() <= printed["fit"].pop("details").items()
    assert printed == kept


def test_same_command_same_file(apart: Run, valve: Log, inside: Path) -> None:
    valve()
    texts = []
    for _ in range(2):
        assert apart("valve", "valve.csv", "-f", "--seed", "3", cwd=inside).status == 0
        texts.append(without_time((inside / "valve.yaml").read_text()))
    assert texts[0] == texts[1]


def test_no_folder_of_this_machine_in_the_file(here: Run, valve: Log, inside: Path) -> None:
    here("valve", valve("my log.csv"), "-o", inside / "v.yaml", "--unit=outlet=Pa")
    text = (inside / "v.yaml").read_text()
    assert str(inside) not in text
    command = read_document(inside / "v.yaml").provenance.command
    assert command == "fluidact-fit valve 'my log.csv' -o v.yaml --unit=outlet=Pa"


def test_strict(here: Run, valve: Log, inside: Path) -> None:
    log = valve()
    done = here("valve", log, "--unit", "command=mV", "--strict")
    assert (done.status, done.out) == (4, "")
    assert "error: 1 warning under --strict; nothing was written:\n" in done.err
    assert "unit-overridden" in done.err
    assert not (inside / "valve.yaml").exists()
    log.write_text(log.read_text().replace(" [V]", ""))
    done = here("valve", log, "--strict")  # an assumed unit is a note
    assert done.status == 4
    assert "error: 1 note under --strict; nothing was written:\n" in done.err
    done = here("valve", log)
    assert done.status == 0
    assert "\nnote (unit-assumed): valve.csv: " in "\n" + done.err
    assert here("valve", log, "-fq").err == ""


def test_failed_verdict(here: Run, valve: Log, inside: Path) -> None:
    log = valve()
    fixed = ["--fix", "gain=1", "--fix", "natural_frequency=20", "--fix", "damping_ratio=5"]
    done = here("valve", log, *fixed)
    assert (done.status, done.out) == (4, ""), done.err
    assert "FAIL" in done.err
    assert "--accept-failed" in done.err
    assert "poor-fit" in done.err
    assert not (inside / "valve.yaml").exists()
    assert here("valve", log, *fixed, "--accept-failed").status == 0
    document = read_document(inside / "valve.yaml")
    assert document.accepted_failed is True
    assert document.fit.verdict == "fail"
    assert document.parameters["damping_ratio"].status == "fixed"


def test_quiet_and_verbose(here: Run, valve: Log, inside: Path) -> None:
    log = valve()
    done = here("valve", log, "-q")
    assert (done.status, done.out, done.err) == (0, "", "")
    done = here("valve", log, "-vf")
    assert "reading" in done.err
    assert "frequency" in done.out
    stages = re.findall(r"^\[[0-9.]+ s\] (.+)$", done.err, re.MULTILINE)
    assert stages == ["reading", "fitting", "searching for a start", "fitting", "examining the fit",
                      "writing"]  # fmt: skip
    total, parts = re.search(r"^([0-9.]+) s in all: (.+)$", done.err, re.MULTILINE).groups()
    taken = {name: float(s) for name, s in re.findall(r"([a-z ]+?) ([0-9.]+)(?:, |$)", parts)}
    assert set(taken) == set(stages)
    assert list(taken.values()) == sorted(taken.values(), reverse=True)
    assert sum(taken.values()) == pytest.approx(float(total), abs=0.05 * len(taken) + 0.1)


def test_every_reading_option(here: Run, valve: Log, inside: Path) -> None:
    """The same numbers however they are told: no header, raw units, a flipped sign."""
    log = valve()
    here("valve", log, "-o", "a.yaml", "--window", ":2.5")
    rows = [line.split(",") for line in log.read_text().splitlines()[1:]]
    other = inside / "raw.csv"
    other.write_text("".join(f"{-1000 * float(u):.9g};{float(y) / 1e5:.12g}\n" for _, u, y in rows))
    done = here(
        "valve", other, "-o", "b.yaml", "--column", "command=#1", "--column", "outlet=#2",
        "--unit", "command=mV", "--unit", "outlet=bar", "--scale", "command=-1",
        "--sample-time", "0.01", "--window", ":2.5", "--hold", "command=zoh",
    )  # fmt: skip
    assert done.status == 0, done.err
    a, b = (read_document(inside / n).parameters["gain"].value for n in ("a.yaml", "b.yaml"))
    assert a == pytest.approx(b, rel=1e-6)


def _write_step_response(path: Path) -> None:
    """The outlet of a line whose inlet steps from -1 to 2 bar at 0.1 s, and no inlet."""
    time = 0.01 * np.arange(200)
    outlet = np.where(time > 0.1, 3e5 * (1 - np.exp(-(time - 0.1) / 0.2)), 0.0)
    outlet += np.random.default_rng(0).normal(size=200)
    rows = [f"{t:.4f},{y:.9g}" for t, y in zip(time, outlet)]
    path.write_text("\n".join(["time [s],outlet [Pa]", *rows]) + "\n")


def test_step_that_was_not_recorded(here: Run, inside: Path) -> None:
    _write_step_response(inside / "s.csv")
    done = here("line", "s.csv", "--step", "inlet=-1:2@0.1", "--unit", "inlet=bar")
    assert done.status == 0, done.err
    document = read_document(inside / "line.yaml")
    assert document.parameters["gain"].value == pytest.approx(1.0, rel=1e-3)
    assert document.parameters["time_constant"].value == pytest.approx(0.2, rel=1e-3)


@pytest.mark.parametrize(
    ("steps", "status", "words"),
    [
        (["inlet=-1:2bar@100ms"], 0, ""),
        (["inlet=-1bar:2 bar@0.1", "--window", "0:900 ms"], 0, ""),
        (["inlet=-1bar:2@0.1"], 2, "give one unit, behind 2"),
        (["inlet=-1:2bar@0.1", "--unit", "inlet=kPa"], 0, ""),
        (["inlet=-1:2mm@0.1"], 3, "mm"),
    ],
)
def test_step_may_have_a_unit(
    here: Run, inside: Path, steps: list[str], status: int, words: str
) -> None:
    _write_step_response(inside / "s.csv")
    done = here("line", "s.csv", "--step", *steps)
    assert done.status == status, done.err
    assert words in done.err
    if not status:
        found = read_document(inside / "line.yaml")
        assert found.parameters["gain"].value == pytest.approx(1.0, rel=0.02)


def test_validation_is_judged_and_not_fitted(here: Run, valve: Log, inside: Path) -> None:
    assert here("valve", valve("a.csv"), "-o", "alone.yaml").status == 0
    other = valve("b.csv", gain=1500.0, seed=5)
    done = here("valve", "a.csv", "--validate", other, "-o", "judged.yaml")
    assert re.search(r"^b\.csv +validated +[0-9.]+ %", done.out, re.MULTILINE)
    alone, judged = read_document("alone.yaml"), read_document("judged.yaml")
    assert alone.values() == judged.values()
    assert judged.validation[0].fit_percent < 90.0  # type: ignore[operator]
    assert (alone.fit.verdict, judged.fit.verdict) == ("pass", "warn")
    (said,) = (n.message for n in judged.warnings if n.code == "validation-missed")
    assert said.startswith("b.csv: the model misses the output by ")
    done = here("valve", "a.csv", "--validate", valve("c.csv", seed=6), "-o", "right.yaml")
    assert read_document("right.yaml").fit.verdict == "pass"


def test_many_missed_logs_are_one_warning(here: Run, valve: Log, inside: Path) -> None:
    others = [valve(f"b{k}.csv", gain=1300.0 + 100.0 * k) for k in range(7)]
    given = [word for other in others for word in ("--validate", other)]
    assert here("valve", valve("a.csv"), *given, "-o", "judged.yaml").status == 0
    found = read_document("judged.yaml").warnings
    (said,) = (n.message for n in found if n.code == "validation-missed")
    assert "b4.csv and 2 more: the model misses" in said
    assert "RMS (b6.csv)" in said


def test_controller_sample_time(here: Run, valve: Log, inside: Path) -> None:
    assert here("valve", valve(), "--controller-sample-time", "2e-3").status == 0
    assert read_document("valve.yaml").model["discrete"]["sample_time"] == 0.002


def test_pictures_are_written_with_the_file_or_not_at_all(
    here: Run, valve: Log, inside: Path
) -> None:
    pytest.importorskip("fluidact_fit.report.figure", exc_type=ImportError)
    log = valve()
    extra = ["--plot", "v.png", "--report", "v.html"]
    assert here("valve", log, *extra, "--strict", "--fix", "gain=1").status == 4
    assert [p.name for p in inside.iterdir()] == ["valve.csv"]
    done = here("valve", log, *extra)
    assert done.status == 0, done.err
    assert sorted(p.suffix for p in inside.iterdir()) == [".csv", ".html", ".png", ".yaml"]
    assert (inside / "v.png").read_bytes().startswith(b"\x89PNG")


def test_a_failing_write_leaves_nothing_new(
    here: Run, valve: Log, inside: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import os

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    (inside / "valve.yaml").write_text("mine\n")
    log = valve()
    monkeypatch.setattr(os, "replace", full)
    done = here("valve", log, "-f")
    assert done.status == 3
    assert "No space left" in done.err
    assert (inside / "valve.yaml").read_text() == "mine\n"
    assert sorted(p.name for p in inside.iterdir()) == ["valve.csv", "valve.yaml"]


def cylinder_log(path: Path, pressure: str) -> Path:
    """Plateaus of a cylinder whose valve meters chamber 1 or 2: exact flows, one pressure."""
    gain, area, supply, step = 5e-9, {"p1": 2e-4, "p2": 1e-4}[pressure], 4e6, 2e-3
    command = np.repeat([1.0, -1.0, 2.0, -2.0, 3.0, -3.0], 300)
    level = 1.5e6
    fed = (command > 0.0) == (pressure == "p1")
    drop = np.where(fed, supply - level, level)
    position = 0.1 + np.concatenate(
        ([0.0], np.cumsum(gain * command * np.sqrt(drop) / area * step))
    )
    noise = np.random.default_rng(len(path.name)).standard_normal((2, command.size))
    table = [step * np.arange(command.size), command, position[:-1] + 1e-5 * noise[0]]
    np.savetxt(path, np.column_stack((*table, level + 1e3 * noise[1])), delimiter=",",
               header=f"t,u,y,{pressure}", comments="")  # fmt: skip
    return path


CYLINDER = (
    "--column", "time=t", "--column", "command=u", "--column", "position=y",
    "--column", "pressure_1=p1", "--column", "pressure_2=p2",
    "--area-1", "2e-4", "--area-2", "1e-4", "--supply-pressure", "4e6",
)  # fmt: skip


def test_some_logs_may_lack_the_column_of_an_optional_role(here: Run, inside: Path) -> None:
    one, two = cylinder_log(inside / "a.csv", "p1"), cylinder_log(inside / "bb.csv", "p2")
    done = here("hydraulic-cylinder", one, two, *CYLINDER)
    assert done.status == 0, done.err
    document = read_document(inside / "hydraulic-cylinder.yaml")
    for name in ("valve_gain_1", "valve_gain_2"):
        assert document.parameters[name].value == pytest.approx(5e-9, rel=0.02)
    recorded = [set(log.columns) for log in document.provenance.logs]
    assert ["pressure_1" in r for r in recorded] == [True, False]
    assert ["pressure_2" in r for r in recorded] == [False, True]


def test_a_column_that_no_log_has_is_named(here: Run, inside: Path) -> None:
    one = cylinder_log(inside / "a.csv", "p1")
    done = here("hydraulic-cylinder", one, *CYLINDER)
    assert done.status == 3
    assert "a.csv: there is no column 'p2' for the role 'pressure_2'" in done.err
    assert not (inside / "hydraulic-cylinder.yaml").exists()


def test_the_log_without_any_of_two_alternatives_is_named(here: Run, inside: Path) -> None:
    one, two = cylinder_log(inside / "a.csv", "p1"), cylinder_log(inside / "bb.csv", "p2")
    bare = inside / "bare.csv"
    bare.write_text("\n".join(line.rsplit(",", 1)[0] for line in one.read_text().splitlines()))
    done = here("hydraulic-cylinder", one, two, bare, *CYLINDER)
    assert done.status == 3
    assert "bare.csv: neither chamber's pressure was recorded" in done.err
    text = two.read_text().replace("t,u,y", "t,u,x")
    two.write_text(text)
    done = here("hydraulic-cylinder", one, two, *CYLINDER)
    assert done.status == 3
    assert "bb.csv: there is no column 'y' for the role 'position'" in done.err


def test_a_judged_log_of_the_other_chamber_is_refused(here: Run, inside: Path) -> None:
    one, two = cylinder_log(inside / "a.csv", "p1"), cylinder_log(inside / "bb.csv", "p2")
    done = here("hydraulic-cylinder", one, *CYLINDER, "--validate", two)
    assert done.status == 3
    assert "bb.csv: it holds pressure_2, and the model has the valve gain of chamber 1" in done.err


SHARED = Path(__file__).parents[3] / "shared" / "data" / "hydcyl"


@pytest.mark.skipif(not SHARED.is_dir(), reason="recorded logs are not beside this checkout")
def test_real_logs_of_either_pressure(here: Run, inside: Path) -> None:
    columns = {"time": "t_s", "command": "u_valve_V", "position": "x_m",
               "pressure_1": "pA_Pa", "pressure_2": "pB_Pa"}  # fmt: skip
    given = [w for role, header in columns.items() for w in ("--column", f"{role}={header}")]
    given += ["--area-1", "2.0106e-4", "--area-2", "1.2252e-4", "--supply-pressure", "4.45e6"]
    done = here("hydraulic-cylinder", *sorted(SHARED.glob("p*.csv")), *given)
    assert done.status == 0, done.err
    document = read_document(inside / "hydraulic-cylinder.yaml")
    low, high = document.derived["valve_gain_1_extending"].ci95  # type: ignore[misc]
    assert 5.5e-9 < low < high < 5.8e-9  # type: ignore[operator]
    assert 60.0 < document.derived["friction_extending"].value < 72.0  # type: ignore[operator]
    assert -83.0 < document.derived["friction_retracting"].value < -71.0  # type: ignore[operator]
    columns = {"time": "t_s", "position": "x_m", "pressure": "pA_Pa", "pressure_2": "pB_Pa"}
    friction = [w for role, header in columns.items() for w in ("--column", f"{role}={header}")]
    friction += ["--area", "2.0106e-4", "--area-2", "1.2252e-4"]
    done = here("cylinder-friction", *sorted(SHARED.glob("p?_2V_s1.csv")), *friction)
    assert done.status == 3
    assert "pB_2V_s1.csv: there is no column 'pA_Pa' for the role 'pressure'" in done.err


def test_fit_leaves_a_family_that_describes_poorly_to_people(here: Run, inside: Path) -> None:
    rng = np.random.default_rng(3)
    a = np.cumsum(rng.normal(size=400))
    table = np.column_stack([a, 0.5 * a + rng.normal(0.0, 6.0, 400)])
    np.savetxt(inside / "two.csv", table, delimiter=",", comments="",
               header="Druck Ventil [bar],Druck Kammer [bar]")  # fmt: skip
    done = here("fit", "two.csv", "-o", "two.yaml")
    assert done.status == 2
    assert "--sample-time SECONDS" in done.err
    offered = [line for line in done.err.splitlines() if "two.csv" in line and "--column" in line]
    assert offered
    assert all(line.count(" -o two.yaml") == line.count(" -o ") == 1 for line in offered)
    assert not (inside / "two.yaml").exists()


def test_fit_refuses_an_existing_file_before_it_looks_for_a_family(
    here: Run, valve: Log, inside: Path
) -> None:
    valve()
    (inside / "mine.yaml").write_text("mine")
    done = here("fit", "valve.csv", "-o", "mine.yaml")
    assert done.status == 2
    assert "mine.yaml already exists" in done.err
    assert "family-found" not in done.err


def test_fit_without_a_family_fits_the_chosen_one_once(
    here: Run, valve: Log, inside: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The trial that chose the family was thrown away, and the logs were read and fitted again."""
    import fluidact_fit.advice.trial
    import fluidact_fit.fitting

    tried: list[str] = []

    def counted(family: str, *args: Any, **how: Any) -> Any:
        tried.append(family)
        return original(family, *args, **how)

    original = fluidact_fit.fitting.fit
    log = valve()
    with monkeypatch.context() as counting:
        for module in (fluidact_fit.fitting, fluidact_fit.advice.trial):
            counting.setattr(module, "fit", counted)
        done = here("fit", log, "-o", "found.yaml")
    assert done.status == 0, done.err
    assert tried.count("valve") == 1
    document = ff.read_document("found.yaml")
    assert document.provenance.command is not None
    assert document.provenance.command.startswith("fluidact-fit valve")
    again = here(*shlex.split(document.provenance.command)[1:], "-f")
    assert again.status == 0, again.err
    assert ff.read_document("found.yaml").parameters == document.parameters


def test_columns_that_units_and_names_tell_are_proposed(here: Run, inside: Path) -> None:
    (inside / "sieve.csv").write_text(
        "Zeit [s];Sollwert [V];Druck [bar]\n"
        + "".join(f"{0.01 * k:.2f};{k // 20 % 2};{k % 7}\n" for k in range(100)),
        encoding="utf-8",
    )
    done = here("valve", "sieve.csv")
    assert done.status == 3
    assert "Did you mean --column 'command=Sollwert [V]' --column 'outlet=Druck [bar]'?" in done.err


def test_columns_that_nothing_tells_are_not_guessed(here: Run, inside: Path) -> None:
    rows = "".join(f"{0.01 * k:.2f},{k // 20 % 2},{k % 7}\n" for k in range(100))
    (inside / "plain.csv").write_text("time,a,b\n" + rows, encoding="utf-8")
    done = here("valve", "plain.csv")
    assert done.status == 3
    assert "Did you mean" not in done.err


def test_a_step_of_one_log_says_nothing_of_the_units_of_others(here: Run, inside: Path) -> None:
    time = 0.01 * np.arange(300)
    rng = np.random.default_rng(3)
    tables = []
    for size in (5.0, 3.0):
        outlet = 2e4 * size * np.where(time > 0.1, 1 - np.exp(-(time - 0.1) / 0.2), 0.0)
        tables.append((size * (time > 0.1), outlet + rng.normal(size=300)))
    first = (f"{t:.2f},{y:.9g}" for t, y in zip(time, tables[0][1]))
    second = (f"{t:.2f},{1e3 * u:g},{y:.9g}" for t, u, y in zip(time, *tables[1]))
    Path("s1.csv").write_text("\n".join(["time [s],outlet [Pa]", *first]) + "\n")
    Path("s2.csv").write_text("\n".join(["time [s],command [mV],outlet [Pa]", *second]) + "\n")
    done = here("line", "s1.csv", "s2.csv", "--step", "s1.csv:command=0:5V@0.1")
    assert done.status == 0, done.err
    found = read_document("line.yaml")
    assert found.parameters["gain"].value == pytest.approx(2e4, rel=0.01)


def test_what_is_wrong_with_a_log_is_told_beside_a_file_that_exists(
    here: Run, inside: Path
) -> None:
    Path("plain.csv").write_text("time,a,b\n" + "".join(f"{k},1,2\n" for k in range(30)))
    Path("line.yaml").write_text("kept\n")
    done = here("line", "plain.csv")
    assert done.status == 3
    assert "no column is named" in done.err
    assert "line.yaml" in done.err
    assert Path("line.yaml").read_text() == "kept\n"


def test_a_window_of_a_log_without_roles_hides_no_missing_column(here: Run, inside: Path) -> None:
    Path("plain.csv").write_text("a,b,c\n" + "".join(f"{k},1,2\n" for k in range(30)))
    done = here("line", "plain.csv", "--window", "0:1")
    assert done.status == 3
    assert "no column is named 'time', 'inlet' and 'outlet'" in done.err


def test_the_columns_of_all_logs_are_those_of_the_recorded_command(here: Run, inside: Path) -> None:
    """The number of a column in the first log is that of another one in the second."""
    import pandas as pd

    folder = Path(__file__).parents[2] / "datasets" / "line"
    order = ["t (ms)", "inlet (bar)", "outlet (bar)", "spare (bar)"]
    for name, trial, columns in (("a", 1, order), ("b", 2, [*order[:2], *order[:1:-1]])):
        table = pd.read_csv(folder / f"trial{trial}.csv")
        table.columns = order[:3]
        table["spare (bar)"] = 0.9 * table["outlet (bar)"] + 0.3
        table[columns].to_csv(f"{name}.csv", index=False)
    done = here("fit", "a.csv", "b.csv", "-o", "found.yaml")
    assert done.status == 0, done.err
    found = read_document("found.yaml")
    headers = [source.columns["outlet"].header for source in found.provenance.logs]
    assert headers == ["outlet (bar)", "outlet (bar)"]


def test_an_estimate_at_the_end_of_its_bounds_is_named(here: Run, inside: Path) -> None:
    _write_step_response(inside / "s.csv")
    step = ["--step", "inlet=-1:2bar@0.1"]
    done = here("line", "s.csv", *step, "--bounds", "time_constant=10ms:150ms")
    assert "at-given-bound" in done.err
    done = here("line", "s.csv", *step, "--bounds", "time_constant=10ms:1s", "-f")
    assert "at-given-bound" not in done.err
    # a wide range is not reached by what is many standard errors away from its end
    done = here("line", "s.csv", *step, "--bounds", "time_constant=0:1e6", "-f")
    assert "at-given-bound" not in done.err


def test_noise_of_a_family_that_takes_none_is_refused_for_that_reason(
    here: Run, inside: Path
) -> None:
    (inside / "a.csv").write_text("time,force,velocity\n0,1,1\n1,2,2\n")
    done = here("cylinder-friction", "a.csv", "--noise", "velocity=1")
    assert done.status == 2
    assert "--noise is not used by cylinder-friction" in done.err


def test_rows_that_only_a_person_may_leave_out_are_not_left_out_unasked(
    here: Run, valve: Log, inside: Path
) -> None:
    lines = Path(valve()).read_text().splitlines()
    time, _, outlet = lines[40].split(",")
    lines[40] = f"{time},,{outlet}"
    (inside / "gap.csv").write_text("\n".join(lines))
    done = here("fit", "gap.csv", "-o", "gap.yaml")
    assert done.status == 2
    assert "line 41: column 'command [V]' is empty" in done.err
    assert "--invalid=drop" in done.err
    assert not (inside / "gap.yaml").exists()
    suggested = here("inspect", "gap.csv").out.splitlines()[-1].split()
    assert here(*suggested[1:]).status == 0


def test_a_unit_that_is_not_known_is_named_with_the_nearest(
    here: Run, valve: Log, inside: Path
) -> None:
    text = Path(valve()).read_text()
    (inside / "typo.csv").write_text(text.replace("outlet [Pa]", "p [brr]").replace("command", "u"))
    for command in ("inspect", "fit"):
        done = here(command, "typo.csv")
        assert "unit 'brr' is not known: did you mean 'bar'?" in done.out + done.err


def test_logs_whose_units_differ_are_named_by_what_both_have(here: Run, inside: Path) -> None:
    """The second log has its pressure in kPa, and the header of the first is not in it."""
    import pandas as pd

    folder = Path(__file__).parents[2] / "datasets" / "line"
    for name, trial, factor, unit in (("a", 1, 1.0, "bar"), ("b", 2, 100.0, "kPa")):
        table = pd.read_csv(folder / f"trial{trial}.csv")
        table.columns = ["t [ms]", f"p1 inlet [{unit}]", f"p2 outlet [{unit}]"]
        table.iloc[:, 1:] *= factor
        table.to_csv(f"{name}.csv", index=False)
    done = here("fit", "a.csv", "b.csv", "-o", "found.yaml")
    assert done.status == 0, done.err
    assert "outlet=p2 outlet'" in done.err
    together = read_document("found.yaml").parameters["time_constant"].value
    assert here("fit", "a.csv", "-o", "alone.yaml").status == 0
    assert together == pytest.approx(
        read_document("alone.yaml").parameters["time_constant"].value, rel=0.05
    )
    named = ["--column", "inlet=p1 inlet [bar]", "--column", "outlet=p2 outlet [bar]"]
    done = here("line", "a.csv", "b.csv", *named)
    assert done.status == 3
    assert "--column 'inlet=p1 inlet' takes both, each in its own unit" in done.err


def test_a_value_that_the_logs_contradict_is_named(here: Run, valve: Log) -> None:
    """A gain of zero was a lack of steps in the log."""
    done = here("valve", valve(), "--fix", "gain=0")
    assert done.status == 4
    assert "Or these logs contradict --fix gain=0: try without." in done.err


def test_a_value_in_the_wrong_unit_is_named_where_the_fit_fails(here: Run, valve: Log) -> None:
    """Nothing is refused, but the model describes nothing."""
    done = here("valve", valve(), "--fix", "natural_frequency=0.085")
    assert done.status == 4
    assert "contradict --fix natural_frequency=0.085" in done.err


def test_fit_names_a_unit_that_it_does_not_know(here: Run, inside: Path) -> None:
    rng = np.random.default_rng(1)
    table = np.column_stack([np.arange(300) * 0.01, rng.normal(size=300), rng.normal(size=300)])
    np.savetxt(
        inside / "psi.csv", table, delimiter=",", comments="", header="t [s],p1 [bar],p2 [baar]"
    )
    done = here("fit", "psi.csv")
    assert done.status != 0
    assert "unit 'baar' is not known: did you mean 'bar'?" in done.err


def test_fit_asks_for_the_areas_of_the_family_that_every_column_is_for(
    here: Run, inside: Path
) -> None:
    """A part of the columns fitted a spring cylinder, badly, and its file was written."""
    rng = np.random.default_rng(4)
    time = np.arange(2000) * 0.005
    position = 100.0 + 80.0 * np.sin(time)
    table = np.column_stack([
        time, position, 5.0 + 0.8 * np.sign(np.cos(time)) + rng.normal(0.0, 0.01, 2000),
        8.0 + 0.1 * np.sin(3.0 * time), 0.2 + 0.1 * np.sin(7.0 * time),
    ])  # fmt: skip
    np.savetxt(inside / "rod.csv", table, delimiter=";", comments="",
               header="Zeit [s];Weg [mm];Druck A [bar];Druck B [bar];Kraft [kN]")  # fmt: skip
    done = here("fit", "rod.csv")
    assert done.status == 2
    assert "--area=M2 --area-2=M2" in done.err
    assert "cylinder-friction rod.csv" in done.err
    assert not list(inside.glob("*.yaml"))
