"""The replay of the sources: what is said on its page of the loops."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]


def load(name: str) -> ModuleType:
    """A module of ``studies/replay``, which stands beside the package."""
    sys.path.insert(0, str(ROOT))
    try:
        return import_module(f"studies.replay.{name}")
    finally:
        sys.path.remove(str(ROOT))


force, page, pictures = load("force"), load("page"), load("pictures")


@pytest.fixture(scope="module")
def runs() -> Any:
    return page.run()


def test_steady_error_of_a_force_step_is_the_overshoot_of_the_valve() -> None:
    for size in (10.0, 50.0):
        found = force.metrics(force.force_step(size, 1))
        assert found.steady_state_error == pytest.approx(-0.046 * size, rel=0.01)
        assert found.rise_time == pytest.approx(0.03, abs=0.005)


def test_smoothing_takes_the_error_away_as_the_paper_says() -> None:
    plain, smooth = (force.metrics(force.force_step(50.0, steps)) for steps in (1, 30))
    left = smooth.overshoot_target / plain.overshoot_target
    assert left == pytest.approx(1.0 - 0.881, abs=0.03)


@pytest.mark.slow
def test_page_is_the_committed_one(runs: Any) -> None:
    assert (ROOT / "docs" / "evidence" / "replay.md").read_text(encoding="utf-8") == page.page(runs)


@pytest.mark.slow
def test_every_picture_is_drawn_committed_and_shown(runs: Any) -> None:
    drawn = {f"{name}.svg": figure for name, figure in pictures.draw(runs)}
    folder = ROOT / "docs" / "evidence" / "pictures"
    assert {p.name for p in folder.glob("replay-*")} == {*drawn}
    text = page.page(runs)
    for name, figure in drawn.items():
        assert f"](pictures/{name})" in text
        assert (folder / name).stat().st_size < 60_000
        for axes in figure.axes:
            assert axes.get_xlabel() or axes is not figure.axes[-1]
            assert axes.get_ylabel()
            assert max(line.get_xydata().shape[0] for line in axes.lines) > 100
