"""What a controller holds: the same members for every family, and the numbers of ``simulate``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff


def mark_not_identified(trial: Any, path: Path) -> tuple[Path, str] | None:
    """A file with a parameter that was not identified, and its name.

    Where the fit has none, one that has its neutral value is declared so; failing that, any
    that has a neutral value.
    """
    neutral = {s.name: s.neutral for s in trial.variant.parameters if s.neutral is not None}
    entries = {
        name: entry
        for name, entry in trial.raw["parameters"].items()
        if name in neutral and isinstance(entry["value"], float)
    }
    if not entries:
        return None
    order = ("not_identified", "fixed", "estimated")
    name = min(
        entries,
        key=lambda n: (order.index(entries[n]["status"]), entries[n]["value"] != neutral[n]),
    )

    def change(raw: dict[str, Any]) -> None:
        entry = raw["parameters"][name]
        raw["parameters"][name] = {
            "value": entry["value"], "unit": entry["unit"], "status": "not_identified",
        }  # fmt: skip
        raw["derived"] = {}  # their errors follow from the covariance
        part = raw.get("covariance", {"order": []})
        if name in part["order"]:
            gone = part["order"].index(name)
            del part["order"][gone], part["matrix"][gone]
            for row in part["matrix"]:
                del row[gone]

    return trial.edit(path, change), name


def test_a_value_that_was_not_identified_needs_an_explicit_word(trial: Any, tmp_path: Path) -> None:
    made = mark_not_identified(trial, tmp_path / "open.yaml")
    if made is None:
        pytest.skip("every parameter of the family is identified or there is no file")
    path, name = made
    block = ff.load(path)
    assert name in block.not_identified
    with pytest.raises(ff.NotIdentifiedError, match=name):
        block.parameters[name]
    for word in (True, [name]):
        block = ff.load(path, accept_not_identified=word)
        assert name in block.not_identified
        assert math.isfinite(block.parameters[name])


def test_every_block_has_the_same_members(trial: Any) -> None:
    block, raw = ff.load(trial.path), trial.raw
    assert block.family == trial.family
    assert block.verdict == raw["fit"]["verdict"]
    open_ones = {n for n, p in raw["parameters"].items() if p["status"] == "not_identified"}
    assert set(block.not_identified) == open_ones
    for name, entry in raw["parameters"].items():
        if name not in open_ones:
            assert block.parameters[name] == entry["value"]
    assert block.offset == raw["model"].get("output_offset", 0.0)
    block.reset()


def test_a_block_knows_the_range_of_its_data(trial: Any) -> None:
    block, covered = ff.load(trial.path), trial.raw["validity"]
    assert set(block.validity) == set(covered)
    for role, due in covered.items():
        low, high = due["low"], due["high"]
        assert (block.validity[role].low, block.validity[role].high) == (low, high)
        assert block.validity[role].unit == due["unit"]
        assert not block.outside(role, 0.5 * (low + high))
        assert block.outside(role, high + (high - low) + 1.0)
        assert block.outside(role, math.nan)
    with pytest.raises(ff.UsageError, match="no-such-role"):
        block.outside("no-such-role", 0.0)


def test_a_block_is_readable(trial: Any) -> None:
    text = repr(ff.load(trial.path))
    assert trial.family in text
    assert len(text) < 300
    assert " at 0x" not in text


def from_rest(trial: Any, folder: Path) -> Any:
    """The first log simulated without its output."""
    from fluidact_fit.simulation import simulate_logs

    log = trial.drop_output(trial.logs[0], folder / "inputs.csv")
    (run,) = simulate_logs(trial.document, trial.read([log]))
    return run


def assert_same(found: Any, due: Any) -> None:
    """Compare two outputs, to a billionth of their range."""
    due = np.asarray(due)
    np.testing.assert_allclose(
        found, due, rtol=0.0, atol=1e-9 * float(np.nanmax(due) - np.nanmin(due))
    )


def test_block_and_simulate_give_the_same_numbers(trial: Any, tmp_path: Path) -> None:
    run = from_rest(trial, tmp_path)
    assert np.isfinite(run.simulated).any()
    block = ff.load(trial.path, accept_not_identified=True)
    assert_same(block.predict(run.experiment), run.simulated)


def test_a_dynamic_block_simulates_a_record(trial: Any, tmp_path: Path) -> None:
    block = ff.load(trial.path, accept_not_identified=True)
    if not (
        hasattr(block, "simulate_samples") and hasattr(block, "input") and len(trial.inputs) == 1
    ):
        pytest.skip("not a dynamic block of one input")
    run = from_rest(trial, tmp_path)
    signal = run.experiment.signals[block.input.role]
    assert signal.hold in ("zoh", "foh", "smooth")
    assert_same(block.simulate(signal.values, signal.time, hold=signal.hold), run.simulated)


def test_a_static_block_is_called_with_arrays(trial: Any, tmp_path: Path) -> None:
    block = ff.load(trial.path, accept_not_identified=True)
    if "time" in trial.columns or len(trial.inputs) != 1:
        pytest.skip("not a static map of one input")
    run = from_rest(trial, tmp_path)
    assert_same(block(run.experiment[trial.inputs[0]]), run.simulated)
