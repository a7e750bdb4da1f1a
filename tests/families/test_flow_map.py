"""Flow maps: exact inverse, intervals that hold the truth, refusals, routines, hysteresis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import fluidact_fit as ff
from dataset_fits import fit_dataset
from fluidact_fit.control import make_block
from fluidact_fit.demo import load_dataset
from fluidact_fit.errors import LogError, NotIdentifiedError
from fluidact_fit.experiment import FloatArray
from fluidact_fit.families.flow_map import FlowMapBlock, valve_command, valve_flow
from fluidact_fit.result import FitResult
from fluidact_fit.routines import Machine

TRUTH = {
    "dead_band_negative": -1.1, "dead_band_positive": 0.8, "gain_negative": 4.2e-5,
    "gain_positive": 5.0e-5, "curvature": 0.03, "leakage": 4.0e-6,
    "saturation_negative": -8.6, "saturation_positive": 9.0,
}  # fmt: skip


def by_hand(u: float, v: Mapping[str, float]) -> float:
    """The equation of the family, one sample at a time."""
    low, high, leak = v["dead_band_negative"], v["dead_band_positive"], v["leakage"]
    if low <= u <= high:
        return leak
    sign, edge, gain = (1, high, v["gain_positive"]) if u > high else (-1, -low, v["gain_negative"])
    x = min(abs(u), abs(v["saturation_positive" if sign > 0 else "saturation_negative"])) - edge
    fade = max(0.0, 1.0 - x / (edge + 2.0 * abs(leak) / gain))
    return sign * gain * x * (1.0 + v["curvature"] * x) + leak * fade


def ramp(
    seed: int = 0, n: int = 600, ends: tuple[float, float] = (-10.0, 10.0), noise: float = 1e-6,
    drop: bool = False, play: float = 0.0,
) -> dict[str, FloatArray]:  # fmt: skip
    rng = np.random.default_rng(seed)
    swing = 1.0 - np.abs(np.mod(2.0 * np.arange(n) / n, 2.0) - 1.0)
    u = np.round(ends[0] + (ends[1] - ends[0]) * swing, 3)
    seen, at = [], float(u[0])
    for value in u.tolist():
        at = min(max(at, value - 0.5 * play), value + 0.5 * play)
        seen.append(at)
    q = np.array([by_hand(x, TRUTH) for x in seen])
    out = {"time": 0.05 * np.arange(n), "command": u}
    if drop:
        out["pressure_drop"] = 3.5e6 * (1.0 + 0.3 * np.sin(np.arange(n) / 40.0))
        q = q * np.sqrt(out["pressure_drop"] / 3.5e6)
    return {**out, "flow": q + noise * rng.standard_normal(n)}


def codes(result: FitResult) -> set[str]:
    return {w.code for w in result.document.warnings} - {"unit-assumed"}


def block_of(result: FitResult) -> FlowMapBlock:
    block = make_block(result.document)
    assert isinstance(block, FlowMapBlock)
    return block


def test_the_map_is_its_equation() -> None:
    u = np.linspace(-10.0, 10.0, 801)
    expected = [by_hand(x, TRUTH) for x in u.tolist()]
    np.testing.assert_allclose(valve_flow(u, TRUTH), expected, rtol=1e-13, atol=1e-20)


sizes = st.floats(0.01, 1.0)


@given(sizes, sizes, sizes, sizes, st.floats(-0.04, 0.2), st.floats(-0.3, 0.3))
@settings(deadline=None, max_examples=80)
def test_a_map_is_monotone_and_its_inverse_undoes_it(
    low: float, high: float, down: float, up: float, bend: float, leak: float
) -> None:
    v = {
        "dead_band_negative": -low, "dead_band_positive": high, "gain_negative": down,
        "gain_positive": up, "curvature": bend, "leakage": leak * min(down, up),
        "saturation_negative": -9.0, "saturation_positive": 8.0,
    }  # fmt: skip
    u = np.linspace(-9.0, 8.0, 400)
    q = np.real(valve_flow(u, v))
    assert (np.diff(q) >= -1e-12).all()
    outside = (u < -low) | (u > high)
    np.testing.assert_allclose(valve_command(q, v)[outside], u[outside], atol=1e-9)
    inside = valve_command(v["leakage"], v)
    assert -low <= inside <= high


@pytest.mark.parametrize("drop", [False, True])
def test_intervals_hold_the_truth(drop: bool) -> None:
    held = count = 0
    options: dict[str, Any] = {"reference_pressure": 3.5e6} if drop else {}
    for seed in range(12):
        result = ff.fit("flow-map", ramp(seed, drop=drop), **options)
        assert result.verdict == "pass", codes(result)
        for name, truth in TRUTH.items():
            p = result.parameters[name]
            assert p.status == "estimated"
            low, high = p.ci95
            held, count = held + (low <= truth <= high), count + 1
    # 95 %, give or take four binomial standard deviations
    assert held / count > 0.95 - 4.0 * np.sqrt(0.95 * 0.05 / count)


def test_saturation_that_was_not_reached_is_not_identified_and_held() -> None:
    result = ff.fit("flow-map", ramp(ends=(-7.0, 10.0)))
    assert result.parameters["saturation_negative"].status == "not_identified"
    assert result.parameters["saturation_negative"].value == pytest.approx(-7.0, abs=0.05)
    assert result.parameters["saturation_positive"].status == "estimated"
    assert "not-identified" in codes(result)
    # the block works: beyond the data it stays at the last flow recorded
    assert block_of(result)(-9.0) == pytest.approx(block_of(result)(-7.0), rel=1e-2)


def test_a_side_that_was_never_crossed_is_refused_and_the_other_is_right() -> None:
    result = ff.fit("flow-map", ramp(ends=(0.0, 10.0), n=900))
    for name in ("dead_band_negative", "gain_negative", "saturation_negative"):
        assert result.parameters[name].status == "not_identified"
    for name in ("dead_band_positive", "gain_positive", "saturation_positive", "curvature"):
        p = result.parameters[name]
        assert abs(p.value - TRUTH[name]) < 4.0 * p.std_error, name
    block = block_of(result)
    assert block.inverse(block(5.0)) == pytest.approx(5.0)


def test_a_command_that_never_leaves_the_band_is_refused() -> None:
    with pytest.raises(NotIdentifiedError):
        ff.fit("flow-map", {**ramp(), "command": np.zeros(600)})


def test_a_command_with_a_live_zero_is_refused_by_name() -> None:
    log = ramp()
    log["command"] = 12e-3 + 0.8e-3 * log["command"]
    with pytest.raises(LogError, match="the flow has both signs, and the command only one"):
        ff.fit("flow-map", log, units={"command": "A"})
    rng = np.random.default_rng(0)
    noise = {**log, "flow": 1e-6 * rng.standard_normal(log["command"].size)}
    found = ff.fit("flow-map", noise, units={"command": "A"})  # of a valve that does not open
    assert found.document.parameters["gain_positive"].status == "not_identified"


def test_hysteresis_of_the_spool_is_said() -> None:
    assert "directions-differ" in codes(ff.fit("flow-map", ramp(play=0.3, n=1200)))
    assert "directions-differ" not in codes(ff.fit("flow-map", ramp(n=1200)))


def test_the_inverse_knows_the_pressure_drop_and_its_ends() -> None:
    result = ff.fit("flow-map", ramp(drop=True), reference_pressure=3.5e6)
    block = block_of(result)
    assert block.reference_pressure == 3.5e6
    for drop in (1.0e6, 3.5e6, -2.0e6):
        assert block.inverse(block(4.0, drop), drop) == pytest.approx(4.0)
    with pytest.raises(ValueError, match="saturations"):
        block.inverse(1.0)
    assert block.inverse(1.0, clamp=True) == pytest.approx(9.0, abs=0.02)


@pytest.mark.parametrize("drop", [False, True])
def test_routines_give_what_the_block_gives(drop: bool) -> None:
    result = ff.fit("flow-map", ramp(drop=drop))
    block, u = block_of(result), np.linspace(-8.0, 8.0, 41)
    forward, back, *scale = block.routines()
    for command in u.tolist():
        more = {"pressure_drop": 3.0e6} if drop else {}
        flow, outside = Machine(forward)(command=command, **more)
        assert not outside
        assert flow == pytest.approx(float(block(command, *more.values())), rel=1e-9, abs=1e-12)
        if scale:
            flow, _ = Machine(scale[0])(flow=flow, **more)
        if abs(command) > 1.2:
            assert Machine(back)(flow=flow)[0] == pytest.approx(command, abs=1e-6)


def test_a_leakage_that_is_given_widens_no_other_interval() -> None:
    """What is missed inside the dead band says nothing of the numbers beyond it."""
    free = fit_dataset("flow-map")
    held = {"leakage": free.parameters["leakage"].number}
    dataset = load_dataset("flow-map")
    known = ff.fit("flow-map", dataset.read(), **dataset.options, fixed=held)
    for name, q in free.parameters.items():
        if name not in held:
            assert known.parameters[name].std_error <= 1.1 * q.std_error, name  # type: ignore[operator]


def test_a_coarse_reading_of_the_flow_widens_the_leakage() -> None:
    """Within the band all readings share one rounding error: leakage was 12 errors off."""
    rng = np.random.default_rng(3)
    for share in (0.3, 0.45, 0.2, 0.05):
        truth, step = {**TRUTH, "leakage": share * 1e-5}, 3.3e-6
        n = 3000
        swing = 1.0 - np.abs(np.mod(4.0 * np.arange(n) / n, 2.0) - 1.0)
        u = -10.0 + 20.0 * swing
        q = np.array([by_hand(x, truth) for x in u.tolist()]) + 3e-7 * rng.standard_normal(n)
        log = {"time": 0.01 * np.arange(n), "command": u, "flow": step * np.round(q / step)}
        leakage = ff.fit_flow_map(log).parameters["leakage"]
        assert abs(leakage.number - truth["leakage"]) < 4.0 * leakage.std_error
        assert leakage.std_error < step
