"""The replay of the sources: what is said on its page of the loops."""

from __future__ import annotations

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def replay() -> ModuleType:
    import sys

    spec = spec_from_file_location("replay", ROOT / "studies" / "replay.py")
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules["replay"] = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_steady_error_of_a_force_step_is_the_overshoot_of_the_valve(replay: ModuleType) -> None:
    for size in (10.0, 50.0):
        found = replay.force_step(size, 1)
        assert found.steady_state_error == pytest.approx(-0.046 * size, rel=0.01)
        assert found.rise_time == pytest.approx(0.03, abs=0.005)


def test_smoothing_takes_the_error_away_as_the_paper_says(replay: ModuleType) -> None:
    plain, smooth = replay.force_step(50.0, 1), replay.force_step(50.0, 30)
    left = smooth.overshoot_target / plain.overshoot_target
    assert left == pytest.approx(1.0 - 0.881, abs=0.03)


def test_page_is_the_committed_one(replay: ModuleType) -> None:
    assert (ROOT / "docs" / "replay.md").read_text(encoding="utf-8") == replay.page()
