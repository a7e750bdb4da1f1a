"""Logs that were each recorded at a constant of their own are checked at that constant."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.check import check_logs

Run = Callable[..., Any]
PLACES = {"a": 0.0, "b": 20.0, "c": 40.0}  # mm
COLUMNS = {"pressure": "p (Pa)", "force": "force (N)"}


def spring_log(
    path: Path, millimetres: float, seed: int, *, preload: float = 3.0, stiffness: float = 500.0
) -> Path:
    """Pressure up and down at one position: 2 cm2, a spring, friction of 2 N."""
    t = np.arange(600) * 0.02
    pressure = 2e5 - 1.5e5 * np.cos(2.0 * np.pi * t / 6.0)
    friction = 2.0 * np.sign(np.gradient(pressure))
    force = 2e-4 * pressure - stiffness * 1e-3 * millimetres - preload - friction
    force += np.random.default_rng(seed).normal(0.0, 0.1, t.size)
    table = np.column_stack([t, pressure, force])
    np.savetxt(path, table, fmt="%.8g", delimiter=",", header="time (s),p (Pa),force (N)",
               comments="")  # fmt: skip
    return path


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory, contract_run: Run) -> Path:
    """A folder with the fit of three logs at three positions."""
    folder = tmp_path_factory.mktemp("constants")
    logs = [spring_log(folder / f"{n}1.csv", x, k) for k, (n, x) in enumerate(PLACES.items())]
    said = [w for n, x in PLACES.items() for w in ("--set", f"{n}*:position={x:g} mm")]
    done = contract_run("spring-cylinder", *logs, "--column", "pressure=#2", "--column", "force=#3",
                        *said, "-q", "-o", folder / "rig.yaml")  # fmt: skip
    assert done.status == 0, done.err
    return folder


@pytest.fixture(scope="module")
def contract_run() -> Run:
    from .conftest import run_here

    return run_here


def checked(run: Run, *args: object) -> tuple[Any, dict[str, Any]]:
    done = run("check", *args, "--json")
    return done, json.loads(done.out) if done.out else {}


@pytest.mark.parametrize("name", PLACES)
def test_a_fitted_log_is_checked_at_its_own_constant(name: str, here: Run, rig: Path) -> None:
    done, found = checked(here, rig / "rig.yaml", rig / f"{name}1.csv")
    assert done.status == 0, done.err
    assert found["logs"][0]["samples"] > 400
    assert found["logs"][0]["rmse"] == pytest.approx(0.1, rel=0.2)
    assert "stiffness" not in [d["name"] for d in found["drifts"]]
    assert {"preload", "area"} <= {d["name"] for d in found["drifts"]}


def test_all_logs_together_compare_every_parameter(here: Run, rig: Path) -> None:
    done, found = checked(here, rig / "rig.yaml", *(rig / f"{n}1.csv" for n in PLACES))
    assert done.status == 0, done.err
    assert "stiffness" in [d["name"] for d in found["drifts"]]


def test_a_log_is_known_by_its_content(here: Run, rig: Path, tmp_path: Path) -> None:
    shutil.copy(rig / "c1.csv", tmp_path / "a-new-name.csv")
    done, _ = checked(here, rig / "rig.yaml", tmp_path / "a-new-name.csv")
    assert done.status == 0, done.err
    simulated = here("simulate", rig / "rig.yaml", tmp_path / "a-new-name.csv")
    assert simulated.status == 0, simulated.err
    assert ",0.04," in simulated.out.splitlines()[1]


@pytest.mark.parametrize("command", ["check", "simulate"])
def test_another_log_needs_its_constant(command: str, here: Run, rig: Path, tmp_path: Path) -> None:
    log = spring_log(tmp_path / "a2.csv", 0.0, 7)
    done = here(command, rig / "rig.yaml", log)
    assert (done.status, done.out) == (2, "")
    for word in ("a2.csv", "position", "a1.csv 0 mm", "c1.csv 40 mm", "--set"):
        assert word in done.err, done.err
    assert here(command, rig / "rig.yaml", log, "--set", "b*:position=20 mm").status == 2
    for said in ("position=0 mm", "a*:position=0 mm", "a2.csv:position=0"):
        done = here(command, rig / "rig.yaml", log, "--set", said)
        assert done.status == 0, done.err


def test_each_of_several_new_logs_has_its_own(here: Run, rig: Path, tmp_path: Path) -> None:
    logs = [spring_log(tmp_path / "x.csv", 10.0, 8), spring_log(tmp_path / "y.csv", 30.0, 9)]
    said = ["--set", "x*:position=10 mm", "--set", "y*:position=3 cm"]
    done, found = checked(here, rig / "rig.yaml", *logs, *said)
    assert done.status == 0, done.err
    assert "stiffness" in [d["name"] for d in found["drifts"]], "two positions tell it"


def test_a_log_with_the_column_follows_the_column(here: Run, rig: Path, tmp_path: Path) -> None:
    log = spring_log(tmp_path / "with.csv", 20.0, 10)
    head, *rows = log.read_text().splitlines()
    log.write_text("\n".join([head + ",position (mm)", *(row + ",20" for row in rows)]) + "\n")
    done, _ = checked(here, rig / "rig.yaml", log)
    assert done.status == 0, done.err


@pytest.mark.parametrize("change", [{"preload": 13.0}, {"stiffness": 700.0}, {"preload": 3.5}])
def test_a_machine_that_changed_is_found_at_one_position(
    change: dict[str, float], here: Run, rig: Path, tmp_path: Path
) -> None:
    log = spring_log(tmp_path / "c2.csv", 40.0, 11, **change)
    done, found = checked(here, rig / "rig.yaml", log, "--set", "position=40 mm")
    assert done.status == 5, done.out
    assert "preload moved" in done.err
    assert "with stiffness as in the file" in done.err
    assert found["logs"][0]["samples"] > 400, "a force that is off everywhere is no spike"


def test_in_python(rig: Path, tmp_path: Path) -> None:
    logs = [ff.read_log(rig / f"{n}1.csv", columns=COLUMNS, constants={"position": f"{x} mm"})
            for n, x in PLACES.items()]  # fmt: skip
    result = ff.fit("spring-cylinder", logs)
    assert result.simulate(rig / "c1.csv")[0].rmse == pytest.approx(0.1, rel=0.2)
    log = spring_log(tmp_path / "a2.csv", 0.0, 7)
    with pytest.raises(ff.UsageError, match="constants"):
        result.simulate(log)
    given = ff.read_log(log, constants={"position": "0 mm"})
    assert check_logs(result.document, [given]).fits
