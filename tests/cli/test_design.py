"""``fluidact-fit design``: files, tables, errors."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

Run = Callable[..., Any]
Log = Callable[..., Path]


@pytest.fixture
def params(here: Run, valve: Log, inside: Path) -> Path:
    """A parameter file of a valve."""
    done = here("valve", valve("trial.csv"))
    assert done.status == 0, done.err
    return inside / "valve.yaml"


def test_writes_a_table_that_a_controller_can_play(here: Run, params: Path, tmp_path: Path) -> None:
    out = tmp_path / "next.csv"
    done = here("design", "valve", "--from", str(params), "-o", str(out), "--duration", "0.5")
    assert done.status == 0, done.err
    assert out.read_text(encoding="utf-8").startswith("time [s],command [V]\n")
    assert "damping_ratio" in done.out
    assert "binding limits: amplitude" in done.out
    again = here("design", "valve", "--from", str(params), "-o", str(out))
    assert again.status == 2
    assert "--force" in again.err


def test_json_holds_the_prediction(here: Run, params: Path) -> None:
    done = here("design", "valve", "--from", str(params), "--duration", "0.5", "--json")
    found = json.loads(done.out)
    assert found["family"] == "valve"
    assert found["limits"]["duration"] == 0.5
    assert {"name", "present", "predicted", "ratio"} <= set(found["parameters"][0])


def test_limits_reach_the_design(here: Run, params: Path, tmp_path: Path) -> None:
    out = tmp_path / "next.csv"
    done = here("design", "valve", "--from", str(params), "-o", str(out), "--duration", "1",
                    "--amplitude", "1:2", "--criterion", "gain", "-v")  # fmt: skip
    assert done.status == 0, done.err
    levels = [float(line.split(",")[1]) for line in out.read_text().splitlines()[1:]]
    assert 1.0 <= min(levels) < max(levels) <= 2.0
    assert "best of each shape" in done.out


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["line"], 2, "family valve, not line"),
        (["valv"], 2, "Did you mean 'valve'"),
        (
            ["valve", "--criterion", "mass"],
            2,
            "names the criterion 'mass', which does not exist here",
        ),
        (["valve", "--amplitude", "3:1"], 2, "not below"),
        (["valve", "--amplitude", "-1:1 bar"], 2, "Give a number in V"),
        (["valve", "--rate", "-3"], 2, "above zero"),
        (["valve", "--duration", "0.01"], 2, "samples"),
    ],
)
def test_wrong_use_is_explained(
    here: Run, params: Path, arguments: list[str], status: int, words: str
) -> None:
    done = here("design", *arguments, "--from", str(params))
    assert done.status == status
    assert words in done.err
    assert "Traceback" not in done.err


def test_the_family_may_be_left_to_the_file(here: Run, params: Path) -> None:
    with_family = here("design", "valve", "--from", str(params), "--duration", "0.5", "--json")
    assert here("design", str(params), "--duration", "0.5", "--json").out == with_family.out
    missing = here("design", "valve")
    assert missing.status == 2
    assert "design valve --from FILE.yaml" in missing.err
    absent = here("design", "vlve.yaml")
    assert absent.status == 3
    assert "vlve.yaml" in absent.err


def test_a_file_that_cannot_be_read_is_named(here: Run, tmp_path: Path) -> None:
    broken = tmp_path / "broken.yaml"
    broken.write_text("format: something else\n", encoding="utf-8")
    done = here("design", "valve", "--from", str(broken))
    assert done.status == 3
    assert "broken.yaml" in done.err


def test_limits_may_have_units(here: Run, params: Path) -> None:
    given = ["--from", str(params), "--duration", "500 ms", "--json"]
    done = here("design", "valve", *given, "--amplitude", "500mV:2.5V", "--rate", "0.1 V/ms",
                "--stroke=-1bar:100bar")  # fmt: skip
    assert done.status == 0, done.err
    limits = json.loads(done.out)["limits"]
    assert limits["amplitude"] == [0.5, 2.5]
    assert limits["rate"] == pytest.approx(100.0)
    assert limits["stroke"] == [-1e5, 1e7]
    assert limits["duration"] == 0.5


def test_an_output_that_cannot_stay_in_its_range_is_named(here: Run, params: Path) -> None:
    done = here("design", "valve", "--from", str(params), "--amplitude", "100:200 V")
    assert done.status == 4
    assert "outlet leaves its range of" in done.err
    assert "--stroke LOW:HIGH" in done.err


def test_speeds_of_a_position_are_those_given(here: Run, inside: Path) -> None:
    """The range of a position says nothing of speeds, and ``--amplitude`` is one of speeds."""
    log = Path(__file__).parents[2] / "datasets" / "cylinder-friction" / "trial1.csv"
    rows = [line.rpartition(",")[0] for line in log.read_text(encoding="utf-8").splitlines()]
    Path("place.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    done = here("cylinder-friction", "place.csv", "-o", "friction.yaml",
                "--column", "force=F", "--column", "position=x")  # fmt: skip
    assert done.status == 0, done.err
    done = here("design", "cylinder-friction", "--from", "friction.yaml", "-o", "next.csv",
                "--amplitude=-30:40mm/s")  # fmt: skip
    assert done.status == 0, done.err
    table = np.loadtxt("next.csv", delimiter=",", skiprows=1)
    assert table[:, 1].min() == pytest.approx(-0.03, rel=0.2)
    assert table[:, 1].max() == pytest.approx(0.04, rel=0.2)
