"""``check``, ``simulate`` and ``inspect``."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.presentation import weak_file

Run = Callable[..., Any]
Log = Callable[..., Path]


@pytest.fixture
def fitted(here: Run, valve: Log, inside: Path) -> Path:
    """A parameter file whose log had other headers and units."""
    log = valve("raw.csv")
    text = log.read_text().replace("command [V]", "Soll").replace("outlet [Pa]", "Ist")
    log.write_text(text)
    done = here(
        "valve", log, "--column", "command=Soll", "--column", "outlet=Ist", "--scale", "outlet=0.5",
        "--unit", "outlet=mbar", "--unit", "command=V",
    )  # fmt: skip
    assert done.status == 0, done.err
    return inside / "valve.yaml"


def rename(log: Path) -> Path:
    text = log.read_text().replace("command [V]", "Soll").replace("outlet [Pa]", "Ist")
    log.write_text(text)
    return log


def test_same_machine_passes(here: Run, fitted: Path, valve: Log) -> None:
    done = here("check", fitted, rename(valve("today.csv", seed=9)))
    assert done.status == 0, done.err
    assert "still fits" in done.out
    assert "gain" in done.out


def test_a_file_that_failed_describes_no_log(here: Run, fitted: Path, valve: Log) -> None:
    """It passed: the limit is twice its own poor rmse."""
    fitted.write_text(fitted.read_text().replace("verdict: pass", "verdict: fail"))
    log = rename(valve("today.csv", seed=9))
    done = here("check", fitted, log)
    assert done.status == 5
    assert "the file has the verdict FAIL" in done.err
    done = here("simulate", fitted, log)
    assert done.status == 0
    assert "warning (weak-file): the parameter file has the verdict FAIL." in done.err


def test_check_and_export_name_a_weak_file(here: Run, inside: Path, valve: Log) -> None:
    kept = Path(__file__).parents[1] / "golden" / ff.__version__ / "valve.yaml"
    text = kept.read_text(encoding="utf-8")
    assert "verdict: pass" in text
    (inside / "sound.yaml").write_text(text)
    (inside / "weak.yaml").write_text(text.replace("verdict: pass", "verdict: warn"))
    done = here("export", "sound.yaml", "weak.yaml", "--to", "json")
    assert done.status == 0, done.err
    assert [line for line in done.err.splitlines() if "weak-file" in line] == [
        "warning (weak-file): weak.yaml has the verdict WARN."
    ]
    document = ff.read_document("weak.yaml")
    (notice,) = weak_file(document)
    assert notice.message.startswith("the parameter file has the verdict WARN.")
    log = Path(__file__).parents[2] / "datasets/valve/trial1.csv"
    columns = {"time": "#1", "command": "#2", "outlet": "#3"}
    assert notice in ff.check(document, log, columns=columns).notices
    assert weak_file(ff.read_document("sound.yaml")) == []


def test_changed_machine_fails_and_names_what_changed(here: Run, fitted: Path, valve: Log) -> None:
    log = rename(valve("today.csv", gain=1200.0, seed=9))
    done = here("check", fitted, log, "--json")
    assert done.status == 5
    found = json.loads(done.out)
    assert found["fits"] is False
    moved = {d["name"]: d for d in found["drifts"]}
    assert moved["gain"]["moved"]
    assert moved["gain"]["percent"] == pytest.approx(20.0, abs=1.0)
    assert not moved["natural_frequency"]["moved"]
    assert "gain moved from" in done.err
    assert "rmse" in done.err
    assert "fit again" in done.err


def test_columns_may_be_named_anew(here: Run, fitted: Path, valve: Log) -> None:
    log = valve("other.csv", seed=9)
    done = here("check", fitted, log, "--scale", "outlet=50", "--unit", "outlet=Pa")
    assert done.status == 0, done.err


def test_a_log_that_shows_little_is_still_simulated(here: Run, fitted: Path, valve: Log) -> None:
    log = rename(valve("rest.csv"))
    head, *rows = log.read_text().splitlines()
    log.write_text("\n".join([head, *(f"{i / 100},0,{i % 3 - 1}" for i in range(len(rows)))]))
    done = here("check", fitted, log)
    assert done.status == 0, done.err
    assert "not-compared" in done.err


def test_output_is_required_to_check(here: Run, fitted: Path, inside: Path) -> None:
    log = inside / "inputs.csv"
    log.write_text("time [s],Soll\n" + "".join(f"{i / 100},{i % 2}\n" for i in range(50)))
    done = here("check", fitted, log)
    assert done.status == 3
    assert "inputs.csv" in done.err
    assert "outlet" in done.err


@pytest.mark.parametrize("command", ["check", "simulate"])
def test_broken_parameter_file(command: str, here: Run, inside: Path, valve: Log) -> None:
    log = valve()
    (inside / "p.yaml").write_text("format: something\n")
    for name in ("p.yaml", "nowhere.yaml", "valve.csv", "."):
        done = here(command, name, log)
        assert done.status == 3, done
        assert name in done.err
        assert done.out == ""
        assert "Traceback" not in done.err


def test_simulate_writes_inputs_measured_and_simulated(
    here: Run, fitted: Path, valve: Log, inside: Path
) -> None:
    log = rename(valve("today.csv", seed=9))
    done = here("simulate", fitted, log)
    assert done.status == 0
    head, *rows = done.out.splitlines()
    assert head == "time [s],command [V],outlet [Pa],outlet_simulated [Pa]"
    table = np.array([row.split(",") for row in rows], dtype=float)
    assert np.std(table[:, 3] - table[:, 2]) < 150.0  # noise of 2 mbar times 0.5, in Pa
    assert here("simulate", fitted, log, "-o", "s.csv").status == 0
    assert (inside / "s.csv").read_text() == done.out
    assert here("simulate", fitted, log, "-o", "s.csv").status == 2
    assert here("simulate", fitted, log, "-o", "today.csv", "-f").status == 2


def test_simulate_from_inputs_alone(here: Run, fitted: Path, inside: Path) -> None:
    log = inside / "inputs.csv"
    log.write_text("time [s],Soll\n" + "".join(f"{i / 100},2\n" for i in range(300)))
    done = here("simulate", fitted, log)
    assert done.status == 0, done.err
    assert done.out.splitlines()[0] == "time [s],command [V],outlet_simulated [Pa]"
    done = here("simulate", fitted, log, "--step", "command=0:2@1")
    last = float(done.out.splitlines()[-1].split(",")[-1])
    assert last == pytest.approx(2 * 1000 * 100 * 0.5, rel=1e-2)


def test_simulate_without_a_log(here: Run, fitted: Path) -> None:
    time = ["--duration", "3", "--sample-time", "0.01"]
    done = here("simulate", fitted, "--input", "command=0:2000@1", "--unit", "command=mV", *time)
    assert done.status == 0, done.err
    table = np.array([row.split(",") for row in done.out.splitlines()[1:]], dtype=float)
    assert table.shape == (301, 3)
    offset = ff.read_document(fitted).model["output_offset"]  # where the sensor idles
    assert table[:100, 2] == pytest.approx(offset, abs=1e-9)
    assert table[-1, 2] == pytest.approx(1e5, rel=1e-2)


@pytest.mark.parametrize(
    ("args", "told"),
    [
        ([], "give a LOG"),
        (["--input", "command=0:1"], "--duration"),
        (["--input", "comand=0:1", "--duration", "1", "--sample-time", "0.1"], "'command'"),
        (["--input", "command=0:1", "--duration", "1", "--sample-time", "1e-9"], "samples"),
        (["--input", "time=0:1", "--duration", "1", "--sample-time", "0.1"], "one of command"),
        (["--input", "command=0:1@9", "--duration", "1", "--sample-time", "0.1"], "after the end"),
        (["raw.csv", "--input", "command=0:1"], "--step"),
    ],
)
def test_simulate_needs_inputs(args: list[str], told: str, here: Run, fitted: Path) -> None:
    done = here("simulate", fitted, *args)
    assert (done.status, done.out) == (2, ""), done
    assert told in done.err


def test_inspect(here: Run, valve: Log, inside: Path) -> None:
    log = valve()
    done = here("inspect", log)
    assert done.status == 0
    for word in ("valve.csv", "320 rows", "command", "outlet", "every 0.01 s"):
        assert word in done.out
    found = json.loads(here("inspect", log, "--json").out)
    assert [c["name"] for c in found["columns"]] == ["time", "command", "outlet"]
    done = here("inspect", log, "--family", "valve")
    assert done.status == 0
    assert "usable for valve" in done.out
    assert here("inspect", log, "--family", "ball-screw").status == 3
    assert here("inspect", "nowhere.csv").status == 3
    done = here("inspect", log, "--column", "force=F")
    assert done.status == 3
    assert "valve.csv" in done.err


def test_demo_reaches_its_function(
    here: Run, inside: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    demo = pytest.importorskip("fluidact_fit.demo")

    def run_demo(directory: Path, echo: Callable[[str], None], **shown: object) -> int:
        echo(f"into {directory}")
        return 4

    monkeypatch.setattr(demo, "run_demo", run_demo)
    done = here("demo", "here")
    assert (done.status, done.out) == (4, "into here\n")


def test_an_output_in_another_quantity_than_the_file_is_refused(
    here: Run, valve: Log, inside: Path
) -> None:
    log = valve()
    assert here("valve", log, "-q").status == 0
    for command in ("check", "simulate"):
        done = here(command, "valve.yaml", log, "--unit", "outlet=V")
        assert (done.status, done.out) == (3, "")
        assert "'outlet' in V (valve.csv) is a voltage" in done.err
        assert "--unit outlet=Pa" in done.err
        assert "no longer fits" not in done.err


def test_a_step_in_another_quantity_is_refused(here: Run, fitted: str) -> None:
    """0 to 2 bar were taken for 0 to 2 V."""
    time = ["--duration", "1", "--sample-time", "0.01"]
    done = here("simulate", fitted, "--input", "command=0:2bar@100ms", *time)
    assert done.status == 2
    assert "--input command: bar is a pressure" in done.err
    assert "numbers in V" in done.err


def test_logs_are_read_as_those_of_the_fit_were(here: Run, valve: Log, inside: Path) -> None:
    """Fitted with --skip-rows and --decimal, and not readable for check and simulate."""
    lines = valve().read_text(encoding="utf-8").splitlines()
    table = [line.replace(",", ";").replace(".", ",") for line in lines]
    text = "\n".join(["LabVIEW Measurement", "Writer;x", "", *table]) + "\n"
    (inside / "bench.csv").write_text(text, encoding="utf-8")
    words = ("--skip-rows", "3", "--decimal", ",", "-o", "bench.yaml")
    assert here("inspect", "bench.csv").status == 3
    assert here("valve", "bench.csv", *words).status == 0
    checked = here("check", "bench.yaml", "bench.csv")
    assert checked.status == 0, checked.err
    assert "read with --decimal , --skip-rows 3, as the logs of the fit were" in checked.err
    assert here("simulate", "bench.yaml", "bench.csv").status == 0
    (inside / "none.csv").write_text("nothing\n", encoding="utf-8")
    failed = here("check", "bench.yaml", "none.csv")
    assert failed.status == 3
    assert "none.csv" in failed.err


def test_a_log_in_which_nothing_happens_confirms_nothing(
    here: Run, valve: Log, inside: Path
) -> None:
    """A fifth of a second at rest "still fits"."""
    valve()
    assert here("valve", "valve.csv", "-o", "v.yaml").status == 0
    time = np.arange(200) * 0.001
    rng = np.random.default_rng(1)
    table = np.column_stack([time, np.zeros(200), rng.normal(0.0, 1.0, 200)])
    np.savetxt(
        "still.csv", table, delimiter=",", comments="", header="time [s],command [V],outlet [Pa]"
    )
    done = here("check", "v.yaml", "still.csv")
    assert done.status == 0
    assert "too little to confirm it" in done.out
    assert "still fits" not in done.out


def test_a_log_below_the_noise_of_the_file_confirms_nothing(here: Run, inside: Path) -> None:
    """In bar without a unit in its header it is taken for pascals, and the model "still fits"."""
    datasets = Path(__file__).parents[2] / "datasets" / "line"
    done = here("fit", datasets / "trial1.csv", "-o", "line.yaml")
    assert done.status == 0, done.err
    lines = (datasets / "trial2.csv").read_text(encoding="utf-8").splitlines()
    Path("plain.csv").write_text("\n".join(["t (ms),a,b", *lines[1:]]) + "\n", encoding="utf-8")
    done = here("check", "line.yaml", "plain.csv", "--column", "inlet=a", "--column", "outlet=b")
    assert "show too little to confirm it" in done.out + done.err
    done = here("check", "line.yaml", datasets / "trial2.csv")
    assert "the model still fits" in done.out + done.err
