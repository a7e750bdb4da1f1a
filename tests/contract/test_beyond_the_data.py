"""What a loaded model does with inputs that its data never held, and with none at all."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.block import SteppedBlock

Run = Callable[..., Any]


def far_of(block: Any) -> float:
    known = block.validity[block.input.role]
    return float(known.high + 100.0 * max(known.high - known.low, abs(known.high)))


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf")])
def test_a_sample_that_is_no_number_leaves_the_state_alone(trial: Any, bad: float) -> None:
    block, twin = (ff.load(trial.path, accept_not_identified=True) for _ in range(2))
    if not hasattr(block, "step"):
        pytest.skip("a static map")
    known = block.validity[block.input.role]
    inputs = np.linspace(known.low, known.high, 7).tolist()
    for value in inputs:
        assert block.step(value) == twin.step(value)  # type: ignore[attr-defined]
        with pytest.raises(ValueError, match=block.input.role):
            block.step(bad)
    assert isinstance(block, SteppedBlock) or trial.family == "potentiometer"


def test_an_input_beyond_the_data_is_told_once(trial: Any) -> None:
    block: Any = ff.load(trial.path, accept_not_identified=True)
    known, far = block.validity[block.input.role], far_of(block)
    middle = 0.5 * (known.low + known.high)
    if hasattr(block, "step"):
        use = block.step
    elif trial.family == "force-map":
        others = {n: 0.5 * (block.validity[n].low + block.validity[n].high)
                  for n in block.inputs if n in block.validity}  # fmt: skip
        more = {"direction": 1} if "direction" in block.inputs else {}

        def use(value: float) -> Any:
            return block(**{**others, **more, block.input.role: value})
    else:
        pytest.skip("covered below")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        use(middle)
    with pytest.warns(ff.ExtrapolationWarning, match=block.input.role):
        use(far)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        use(far)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_static_maps_tell_it_too(trial: Any, sign: float) -> None:
    block: Any = ff.load(trial.path, accept_not_identified=True)
    role = {"hydraulic-motor": "command", "potentiometer": "reading"}.get(trial.family)
    if role is None:
        pytest.skip("no map of one input")
    with pytest.warns(ff.ExtrapolationWarning, match=role):
        block(sign * far_of(block))


def test_simulate_warns_of_inputs_beyond_the_data(trial: Any, here: Run, tmp_path: Path) -> None:
    document = trial.document
    if trial.family not in ("valve", "line", "hydrostatic", "ball-screw"):
        pytest.skip("no input that steps")
    role = trial.variant.driving[0].name
    known = document.validity[role]
    time = ("--duration", 1, "--sample-time", 0.01)
    done = here("simulate", trial.path, "--input", f"{role}={known.low}:{known.high}", *time)
    assert (done.status, "beyond-validity" in done.err) == (0, False), done.err
    done = here("simulate", trial.path, "--input", f"{role}=0:{100.0 * known.high}", *time)
    assert done.status == 0
    assert "beyond-validity" in done.err
    assert here("simulate", trial.path, "--input", f"{role}=0:{100.0 * known.high}", *time,
                "-q").err == ""  # fmt: skip


def test_own_logs_are_not_beyond(trial: Any, here: Run) -> None:
    done = here("check", trial.path, *trial.logs, "--json")
    assert "beyond-validity" not in [n["code"] for n in json.loads(done.out)["notices"]]


def test_a_failed_fit_is_saved_on_request_only(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(1e5, 3e5, 200), 20)
    white = rng.normal(0.0, 3e5, 4001)
    # twice what the inlet moves, and not the noise of a sensor: it lasts
    log = {"time [s]": np.arange(4000) * 0.01, "inlet [Pa]": u,
           "outlet [Pa]": u + white[1:] + 0.6 * white[:-1]}  # fmt: skip
    result = ff.fit("line", log, fixed={"time_constant": 0.05, "dead_time": 0.0})
    assert result.verdict == "fail"
    path = tmp_path / "line.yaml"
    with pytest.raises(ff.StrictError, match="accept_failed=True"):
        result.save(path)
    assert not path.exists()
    result.save(path, accept_failed=True)
    assert ff.read_document(path).accepted_failed is True
    with pytest.raises(ff.StrictError):
        ff.load(path)
