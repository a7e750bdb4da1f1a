"""A file still describes the logs it was fitted to."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest


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
