"""What a sine as input must not hide or feign: spikes of the output, feedback."""

import numpy as np
from scipy.signal import lfilter

from fluidact_fit.assessment.diagnosis import _cross_correlation
from fluidact_fit.experiment import Experiment, Signal
from fluidact_fit.families import get_family
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
    codes = [n.code for n in _cross_correlation(VARIANT, [closed], ())[1]]
    assert codes == ["closed-loop"]
    # a lag that the model lacks: what is missed follows the chirp, and the chirp what is missed
    t = np.arange(1000) * 0.01
    chirp = 6e-3 * np.sin(2 * np.pi * (0.2 * t + 0.15 * t**2))
    missed = lfilter([0.1], [1.0, -0.9], chirp) - chirp
    missed = missed / missed.std() + 0.1 * rng.uniform(-0.5, 0.5, 1000)
    opened = Simulation(experiment(chirp, missed), 0.0 * missed, missed)
    table, said = _cross_correlation(VARIANT, [opened], ())
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
