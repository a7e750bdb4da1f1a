"""What a sine as input must not hide or feign: spikes of the output, feedback."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lfilter

import fluidact_fit as ff
from fluidact_fit.assessment.residual_tests import find_feedback
from fluidact_fit.experiment import Experiment, Signal
from fluidact_fit.families import get_family
from fluidact_fit.family import NoiseLevel, NoiseModel, Plant, Simulated, Solution
from fluidact_fit.logs.spikes import _left_when_removed, replace_spikes
from fluidact_fit.outcome import Simulation

VARIANT = get_family("ball-screw").variants[0]


def experiment(u: np.ndarray, y: np.ndarray) -> Experiment:
    t = np.arange(u.size) * 0.01
    signals = {
        "torque": Signal("torque", t, u, "N m", "zoh"),
        "angle": Signal("angle", t, y, "rad"),
    }
    return Experiment("log", 0, t, signals, 0.01, True)


def solution(later: int = 1, noisy: bool = False) -> Solution:
    """A model whose output is the input of so many samples before."""

    def simulate(plant: Plant, runs: list[Experiment]) -> list[Simulated]:
        return [Simulated(np.concatenate((np.zeros(later), e["torque"]))[: e.samples])
                for e in runs]  # fmt: skip

    inputs = {"torque": NoiseLevel(1.0)} if noisy else {}
    noise = NoiseModel(np.zeros((0, 0)), inputs=inputs)
    options = get_family("ball-screw").options_type()
    return Solution(VARIANT, {}, (), [], noise, options, simulate, True)


@pytest.mark.parametrize("noisy", [False, True])
def test_a_regulator_at_constant_set_point_is_feedback_within_the_sample(noisy: bool) -> None:
    """Gain 2, 0.4 s and 0.1 s under a gain of 3 gave a gain of 0.35 +- 0.01, without a word."""
    rng = np.random.default_rng(7)
    y, u, disturbed = np.zeros(3000), np.zeros(3000), 0.0
    for k in range(11, 3000):
        disturbed = 0.95 * disturbed + 0.03 * rng.standard_normal()
        y[k] = 0.975 * y[k - 1] + 0.05 * u[k - 11] + 0.03 * rng.standard_normal()
        u[k] = -3.0 * (y[k] + disturbed)
    measured = -u / 3.0
    run = Simulation(experiment(u, measured), np.zeros(3000), measured)
    said = find_feedback(VARIANT, solution(noisy=noisy), [run])[1]
    assert [n.code for n in said] == ["closed-loop"]
    assert "in the same sample" in said[0].message
    # of a model that answers within the sample the same may be what the model lacks
    assert not find_feedback(VARIANT, solution(later=0, noisy=noisy), [run])[1]


def test_a_channel_that_the_model_does_not_use_is_no_feedback() -> None:
    """A map of force and direction was said to be biased by the position, in closed loop."""
    rng = np.random.default_rng(9)
    missed = rng.standard_normal(3000)
    beside = Simulation(experiment(missed, missed), np.zeros(3000), missed)
    later = experiment(np.append(0.0, missed[:-1]) + 0.5 * rng.standard_normal(3000), missed)
    for run in (beside, Simulation(later, np.zeros(3000), missed)):
        assert find_feedback(VARIANT, solution(), [run])[1]
        assert not find_feedback(VARIANT, solution(later=3000), [run])[1]


def test_a_motion_state_is_asked_within_its_range() -> None:
    """At 1 it was asked what 3 does, which is loading as well: nothing within the sample."""
    rng = np.random.default_rng(10)
    state = np.sign(rng.standard_normal(3000))

    def simulate(plant: Plant[Any], runs: Sequence[Experiment]) -> list[Simulated]:
        loading = [np.where(e["torque"] > 0.0, 1.0, -1.0) for e in runs]
        return [Simulated(x + np.append(0.0, x[:-1])) for x in loading]

    missed = 0.5 * state + 0.1 * rng.standard_normal(3000)
    run = Simulation(experiment(state, missed), np.zeros(3000), missed)
    map_of_state = replace(solution(), simulate_near=simulate)
    assert not find_feedback(VARIANT, map_of_state, [run])[1]


def test_noise_of_an_input_is_no_feedback() -> None:
    rng = np.random.default_rng(8)
    exact, noise = np.cumsum(rng.standard_normal(3000)), rng.standard_normal(3000)
    missed = -np.append(0.0, noise[:-1]) + 0.1 * rng.standard_normal(3000)
    run = Simulation(experiment(exact + noise, missed), np.zeros(3000), missed)
    for noisy in (False, True):
        assert not find_feedback(VARIANT, solution(noisy=noisy), [run])[1]


def test_noise_of_a_ramp_is_no_feedback_of_a_map() -> None:
    """Whitening the ramp spreads its noise over later samples: six of six maps were warned of."""
    rng = np.random.default_rng(3)
    exact, noise = np.abs(np.arange(2000) % 500 - 250.0), 0.5 * rng.standard_normal(2000)
    missed = -noise + 0.1 * rng.standard_normal(2000)
    run = Simulation(experiment(exact + noise, missed), np.zeros(2000), missed)
    assert not find_feedback(VARIANT, solution(later=0, noisy=False), [run])[1]


@pytest.mark.parametrize("memory", [0.0, 0.95])
def test_feedback_is_warned_of_where_it_moves_a_parameter(memory: float) -> None:
    """White noise comes back through a held command and biases nothing, a disturbance does."""
    rng = np.random.default_rng(0)
    step, rows, frequency, damping = 0.01, 3000, 10.0, 0.5
    rates = np.array([[0.0, 1.0, 0.0], [-(frequency**2), -2.0 * damping * frequency, frequency**2]])
    advance = expm(step * np.vstack((rates, np.zeros(3))))[:2]
    place, disturbance = np.zeros(2), 0.0
    time, command, outlet = step * np.arange(rows), np.empty(rows), np.empty(rows)
    for k in range(rows):
        disturbance = memory * disturbance + 0.05 * rng.standard_normal()
        outlet[k] = place[0] + disturbance
        command[k] = 1.5 * (0.5 * np.sign(np.sin(1.3 * time[k])) - outlet[k])
        place = advance @ np.append(place, command[k])
    found = ff.fit("valve", {"time": time, "command": command, "outlet": outlet})
    entries = found.document.fit.details["cross_correlation"]
    assert entries["command"]["input_follows_residual"] < 1e-5
    codes = {n.code for n in found.document.warnings}
    assert ("closed-loop" in codes) == (memory > 0.0)


def test_a_sine_does_not_hide_a_spike_of_the_output() -> None:
    t = np.arange(500) * 0.01
    y = np.sin(3.0 * t)
    spoiled = y.copy()
    spoiled[200] = 40.0
    found, notices = replace_spikes(experiment(np.cos(7.0 * t), spoiled), VARIANT)
    assert [n.code for n in notices] == ["spikes"]
    assert np.abs(found["angle"] - y).max() < 0.01


def test_feedback_is_said_where_the_input_answers_and_not_where_the_model_misses() -> None:
    rng = np.random.default_rng(2)
    noise, own = rng.standard_normal(2000), rng.standard_normal(2000)
    zero = np.zeros(2000)
    answering = own - 0.8 * np.append(0.0, noise[:-1])
    closed = Simulation(experiment(answering, noise), zero, noise)
    codes = [n.code for n in find_feedback(VARIANT, solution(), [closed])[1]]
    assert codes == ["closed-loop"]
    # a lag that the model lacks: what is missed follows the chirp, and the chirp what is missed
    t = np.arange(1000) * 0.01
    chirp = 6e-3 * np.sin(2 * np.pi * (0.2 * t + 0.15 * t**2))
    missed = lfilter([0.1], [1.0, -0.9], chirp) - chirp
    missed = missed / missed.std() + 0.1 * rng.uniform(-0.5, 0.5, 1000)
    opened = Simulation(experiment(chirp, missed), 0.0 * missed, missed)
    table, said = find_feedback(VARIANT, solution(), [opened])
    assert table["torque"]["input_follows_residual"] < 1e-5
    assert said == []


def test_what_is_left_when_spikes_are_gone_is_the_largest_other_jump() -> None:
    rng = np.random.default_rng(4)
    for _ in range(200):
        values = rng.standard_normal(rng.integers(20, 60))
        order = rng.permutation(values.size)[: rng.integers(1, 8)]
        left = _left_when_removed(values, order)
        for m in range(order.size):
            gone = set(order[: m + 1])
            pairs = [k for k in range(values.size - 1) if not {k, k + 1} & gone]
            due = max((abs(values[k + 1] - values[k]) for k in pairs), default=0.0)
            assert left[m] == due
