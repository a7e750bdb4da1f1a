"""Code of maps at the edges of what they describe: no pressure drop, one side only, flat curves."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import fluidact_fit as ff
from fluidact_fit.export.target import Arithmetic
from fluidact_fit.routines.evaluate import Machine

DATASETS = Path(__file__).parents[2] / "datasets"
Edited = Callable[..., Path]


@pytest.mark.parametrize("arithmetic", ["float32", "q15"])
@pytest.mark.parametrize("low", [-4e6, 0.0, 0.5])
def test_a_valve_without_a_pressure_drop(
    low: float, arithmetic: Arithmetic, edited: Edited, written_as_c: Any
) -> None:
    """A pump that is off for a second: all exports divided by zero, without a flag."""

    def change(document: dict[str, Any]) -> None:
        document["validity"]["pressure_drop"]["low"] = low

    block: Any = ff.load(edited("flow-map", change))
    assert written_as_c(block, arithmetic).self_test() == 0
    flow, _, at_reference = (Machine(routine) for routine in block.routines())
    drop = np.array([1e-3, 1.0, 100.0, 1e3, 1e6]) + max(low, 0.0)
    found, outside = flow(command=np.full(5, 5.0), pressure_drop=drop)
    at_once = float(block(5.0))
    assert found == pytest.approx(at_once * np.sqrt(drop / 3.5e6), rel=1e-12)
    assert not np.any(outside)
    asked, outside = at_reference(flow=np.full(5, 1e-5), pressure_drop=drop)
    assert np.all(np.isfinite(asked))
    assert outside.tolist() == (drop < 350.0).tolist()
    assert block.inverse(np.full(5, 1e-5), drop, clamp=True) == pytest.approx(
        block.inverse(asked, clamp=True)
    )
    assert block.inverse(1e-4, 0.0, clamp=True) == block.parameters["saturation_positive"]
    assert np.isfinite(block.inverse(0.0, 0.0))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("part", [slice(0, 600), slice(300, 1100)])
def test_a_valve_that_was_opened_to_one_side(
    sign: float, part: slice, tmp_path: Path, written_as_c: Any
) -> None:
    """A golden vector stood on the jump at the leakage: 18 of 30 self-tests failed."""
    table = pd.read_csv(DATASETS / "flow-map" / "trial1.csv").iloc[part]
    table = table[sign * table["u [V]"] >= 0.0]
    result = ff.fit("flow-map", table, columns={"command": "u [V]", "flow": "Q [l/min]"})
    result.save(tmp_path / "map.yaml")
    block = ff.load(tmp_path / "map.yaml", accept_not_identified=True)
    assert written_as_c(block, "float32").self_test() == 0


@pytest.mark.parametrize("curvature", [2.0, 3.0, 8.0, 30.0])
def test_a_curve_that_is_flat_all_over(curvature: float, edited: Edited, written_as_c: Any) -> None:
    """The place in its table was computed, and nobody read it: ``-Werror`` refused."""

    def change(document: dict[str, Any]) -> None:
        for entry in (document["parameters"]["curvature"], document["model"]["static"]):
            entry["value" if "value" in entry else "curvature"] = curvature
        document["parameters"]["curvature"]["ci95"] = [0.9 * curvature, 1.1 * curvature]
        document["derived"] = {}  # follows from the curvature

    block = ff.load(edited("hydraulic-motor", change))
    assert written_as_c(block, "q15").self_test() == 0


@pytest.mark.parametrize("family", ["force-map", "spring-cylinder"])
def test_a_motion_state_that_only_logs_write_is_refused(family: str) -> None:
    """The network took 2 for a number, and gave 51 % more force than unloading."""
    block: Any = ff.load(Path(__file__).parents[1] / "golden" / ff.__version__ / f"{family}.yaml")
    if family == "force-map":
        values = {n: 0.5 * (a + b) for n, a, b in zip(
            block.inputs, block.parameters["input_low"], block.parameters["input_high"],
            strict=True)}  # fmt: skip
        assert "direction" in values
        call = lambda state: block(**{**values, "direction": state})  # noqa: E731
    else:
        call = lambda state: block(2.0, 0.01, state)  # noqa: E731
    for state in (-1.0, 0.0, 1.0):
        assert np.isfinite(call(state))
    for state in (2.0, np.array([1.0, 2.0])):
        with pytest.raises(ff.UsageError, match="a motion state of 2"):
            call(state)


def test_a_sample_time_or_a_sample_that_is_no_number_is_refused() -> None:
    block: Any = ff.load(Path(__file__).parents[1] / "golden" / ff.__version__ / "valve.yaml")
    for wrong in ("a", None, [0.01], 0.0, np.inf):
        with pytest.raises(ff.UsageError, match="not a positive number"):
            block.with_sample_time(wrong)
    block = block.with_sample_time(np.float64(0.01))
    for wrong in (None, "1", np.ones(2)):
        with pytest.raises(ff.UsageError, match="is not a number"):
            block.step(wrong)
    block.step(np.float32(1.0))
