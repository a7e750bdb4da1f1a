"""What a sine as input must not hide or feign: spikes of the output, feedback."""

import numpy as np

from fluidact_fit.assessment.diagnosis import _cross_correlation
from fluidact_fit.experiment import Experiment, Signal
from fluidact_fit.families import get_family
from fluidact_fit.logs.spikes import replace_spikes
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
    codes = [n.code for n in _cross_correlation(VARIANT, [closed])[1]]
    assert codes == ["closed-loop"]
    # a residual made of the input, which goes both ways: nobody fed anything back
    missed = 0.3 * np.convolve(own, [0.5, 0.5, 0.6, 0.6, 0.5], "same") + 0.1 * noise
    opened = Simulation(experiment(own, missed), zero, missed)
    assert _cross_correlation(VARIANT, [opened])[1] == []
