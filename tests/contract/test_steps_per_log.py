"""Logs whose input was not recorded, each with a step of its own: fit, check, simulate."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.logs import StepInput
from fluidact_fit_cli.main import run

TRUTH = {"gain": 0.6e5, "time_constant": 0.08, "dead_time": 0.0147}
STEPS = ((0.0, 5.0, 0.2), (1.0, 8.0, 0.3), (6.0, 2.0, 0.15))  # V, V, s


def outlet(step: tuple[float, float, float], seed: int) -> np.ndarray:
    """Time and far pressure after a step of the command, in closed form, with noise."""
    start, end, at = step
    t = 0.005 * np.arange(200)
    past = np.maximum(t - at - TRUTH["dead_time"], 0.0)
    level = start + (end - start) * (1.0 - np.exp(-past / TRUTH["time_constant"]))
    noise = 300.0 * np.random.default_rng(seed).standard_normal(t.size)
    return np.column_stack((t, TRUTH["gain"] * level + 1e5 + noise))


@pytest.fixture
def logs(tmp_path: Path) -> list[str]:
    paths = []
    for k, step in enumerate(STEPS):
        path = tmp_path / f"run{k}.csv"
        np.savetxt(path, outlet(step, k), "%.8g", ",", header="time [s],outlet [Pa]", comments="")
        paths.append(str(path))
    return paths


def given(step: tuple[float, float, float], log: str = "") -> list[str]:
    start, end, at = step
    return ["--step", f"{log}command={start:g}:{end:g}@{at:g}"]


OWN = [*given(STEPS[0]), *given(STEPS[1], "run1.csv:"), *given(STEPS[2], "*2.csv:")]


def test_each_log_has_its_own_step_in_fit_check_and_simulate(
    logs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(tmp_path / "hose.yaml")
    assert run(["line", *logs, *OWN, "-o", file]) == 0
    document = ff.load(file).document
    for name, true in TRUTH.items():
        found = document.parameters[name]
        assert abs(found.value - true) < 4.0 * found.std_error, name
    assert document.parameters["gain"].unit == "Pa/V"
    kept = [log.columns["command"].step for log in document.provenance.logs]
    assert [(s.start, s.end, s.at) for s in kept if s] == list(STEPS)
    assert run(["check", file, *logs]) == 0
    capsys.readouterr()
    assert run(["simulate", file, logs[2]]) == 0
    rows = capsys.readouterr().out.splitlines()
    simulated = [float(row.split(",")[-1]) for row in rows[1:]]
    assert simulated[-1] - simulated[0] == pytest.approx(-4.0 * TRUTH["gain"], rel=2e-3)


def test_a_new_log_needs_its_step(
    logs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, new = str(tmp_path / "hose.yaml"), tmp_path / "new.csv"
    assert run(["line", *logs, *OWN, "-o", file]) == 0
    table = outlet((2.0, 9.0, 0.1), 9)
    np.savetxt(new, table, "%.8g", ",", header="time [s],outlet [Pa]", comments="")
    assert run(["check", file, str(new)]) == 2
    said = capsys.readouterr().err
    assert "each with a step of its own" in said
    assert "--step command=FROM:TO; of one log of several, --step 'new.csv:command=" in said
    assert run(["check", file, str(new), *given((2.0, 9.0, 0.1))]) == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (given(STEPS[0], "run9.csv:"), "--step 'run9.csv:command' names a log that is not"),
        (["--step", "run0.csv:comand=0:1"], "Did you mean 'command'?"),
        (["--step", "run0.csv:command=1"], "has no colon"),
        ([*given(STEPS[0]), *given(STEPS[1])], "'command' was given twice"),
    ],
)
def test_what_is_not_understood_is_refused(
    logs: list[str], words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["line", *logs, *words]) == 2
    assert said in capsys.readouterr().err


def test_intervals_cover(tmp_path: Path) -> None:
    """Of 15 repetitions with 3 numbers each: 95 %, give or take 7 %."""
    z = []
    for seed in range(15):
        logs = []
        for k, step in enumerate(STEPS):
            t, y = outlet(step, 100 + 3 * seed + k).T
            log = ff.read_log({"time": t, "outlet": y}, steps={"command": StepInput(*step)})
            logs.append(log)
        found = ff.fit("line", logs).parameters
        z += [(found[n].value - v) / found[n].std_error for n, v in TRUTH.items()]  # type: ignore[operator]
    assert 0.86 <= np.mean(np.abs(z) < 1.96) <= 1.0
    assert 0.75 < np.std(z) < 1.3
