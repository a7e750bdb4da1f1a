"""A file still describes the logs it was fitted to, and others of the same machine."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

DATASETS = Path(__file__).parents[2] / "datasets"


def test_a_file_fits_its_own_logs(trial: Any, here: Callable[..., Any]) -> None:
    done = here("check", trial.path, *trial.logs, "--json")
    assert done.status == 0, done.err
    found = json.loads(done.out)
    assert found["fits"] is True
    assert "not-compared" not in [notice["code"] for notice in found["notices"]]
    moved = {d["name"]: d["sigmas"] for d in found["drifts"] if d["sigmas"] >= 0.05}
    assert not moved, "the same samples are the same estimate"
    due = [entry["rmse"]["value"] for entry in trial.raw["fit"]["logs"]]
    assert [entry["rmse"] for entry in found["logs"]] == pytest.approx(due, rel=1e-9, abs=0.0)


def test_a_prediction_is_as_uncertain_as_the_parameters_of_the_file(
    here: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One log of a drive tells its static levels within 1 %: enough to stick a stroke away."""
    monkeypatch.chdir(tmp_path)
    one, other = (DATASETS / "ball-screw" / f"trial{k}.csv" for k in (1, 2))
    assert here("ball-screw", one, "-o", "drive.yaml", "-q").status == 0
    done = here("check", "drive.yaml", other, "--json")
    assert done.status == 0, done.err
    found = json.loads(done.out)
    assert "prediction-uncertain" in [notice["code"] for notice in found["notices"]]
    assert not any(d["moved"] for d in found["drifts"])
    changed = pd.read_csv(other)
    changed.iloc[:, 1] *= 1.05  # the torque constant: what is left of the drive differs by 5 %
    changed.to_csv("changed.csv", index=False)
    done = here("check", "drive.yaml", "changed.csv")
    assert done.status == 5
    assert "moved from" in done.err


@pytest.mark.parametrize(("header", "role", "remedy"), [
    ("F [kN]", "force", "'force=F'"), ("x [m]", "position", "'position=x'"),
    ("X2 [mm]", "position", "--column position=HEADER"),
])  # fmt: skip
def test_a_renamed_column_is_named_by_the_header_of_the_file(
    header: str, role: str, remedy: str, here: Callable[..., Any], tmp_path: Path
) -> None:
    """Another unit in the header may be right: it is not taken without a word."""
    text = (DATASETS / "hydrostatic/trial1.csv").read_text(encoding="utf-8")
    before = "F [N]" if role == "force" else "x [mm]"
    columns = ["--column=force=F [N]", "--column=position=x [mm]"]
    path = str(tmp_path / "h.yaml")
    assert here("hydrostatic", str(DATASETS / "hydrostatic/trial1.csv"), *columns, "-o", path
                ).status == 0  # fmt: skip
    other = tmp_path / "other.csv"
    other.write_text(text.replace(before, header, 1), encoding="utf-8")
    found = here("check", path, str(other))
    assert found.status == 3
    assert f"there is no column '{before}' for the role '{role}'" in found.err
    assert remedy in found.err
