"""The study of predictions: its own machine and the machine of the loop are the same."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

import fluidact_fit as ff
from fluidact_fit.control.closed_loop import simulate_loop

ROOT = Path(__file__).parents[2]


def load() -> ModuleType:
    """The study, which stands beside the package."""
    sys.path.insert(0, str(ROOT))
    try:
        return import_module("studies.prediction")
    finally:
        sys.path.remove(str(ROOT))


def test_the_loop_is_that_of_a_simulator_of_its_own() -> None:
    """With the parameters of the file as the truth; the force stays within its logs."""
    study = load()
    block = ff.load(ROOT / "tests" / "golden" / "0.1.0" / "hydrostatic.yaml")
    known = block.document.validity["force"]
    wide = block.document.model_copy(
        update={"validity": {"force": known.model_copy(update={"low": -60.0, "high": 60.0})}}
    )
    loop = simulate_loop([wide], study.CONTROLLER, "triangle", duration=study.DURATION)
    gains = {e.key: e.value for e in loop.numbers}
    found = study.true_errors(block.numbers(), gains["proportional"], gains["derivative"])
    assert found["largest_error"] > 1e-4
    for name, value in found.items():
        assert getattr(loop.tracking, name) == pytest.approx(value, rel=1e-9)
