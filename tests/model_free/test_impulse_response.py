"""Responses without a model, against systems whose response is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from fluidact_fit.experiment import FloatArray
from fluidact_fit.model_free import (
    cross_correlation,
    frequency_response,
    impulse_response,
    respond_alike,
)

STEP = 0.01  # s
DELAY = 7  # samples
OMEGA, ZETA, GAIN = 25.0, 0.4, 2.0


def discrete(integrates: bool = False) -> tuple[FloatArray, FloatArray]:
    """Numerator and denominator of the sampled second-order system behind its dead time."""
    den = [1.0, OMEGA, 0.0] if integrates else [1.0, 2.0 * ZETA * OMEGA, OMEGA**2]
    num = [3.0 * OMEGA] if integrates else [GAIN * OMEGA**2]
    b, a, _ = cont2discrete((num, den), STEP, "zoh")
    return np.r_[np.zeros(DELAY), b.ravel()], a


def record(seed: int, noise: float = 0.1, *, integrates: bool = False, samples: int = 1500,
           colour: float = 0.0) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Coloured input and output of it with noise, white unless ``colour``."""
    rng = np.random.default_rng(seed)
    u = lfilter([0.3], [1.0, -0.7], rng.standard_normal(samples))
    e = lfilter([1.0], [1.0, -colour], rng.standard_normal(samples))
    return u, lfilter(*discrete(integrates), u) + noise * e


def true_steps(n: int, *, integrates: bool = False) -> FloatArray:
    impulse = lfilter(*discrete(integrates), np.r_[1.0, np.zeros(n - 1)])
    return impulse / STEP if integrates else np.cumsum(impulse)


@pytest.mark.parametrize(
    ("noise", "integrates", "colour"),
    [(0.1, False, 0.0), (0.4, False, 0.0), (0.1, False, 0.9), (0.02, True, 0.0)],
)
def test_bands_hold_as_often_as_they_say(noise: float, integrates: bool, colour: float) -> None:
    held = []
    for seed in range(10):
        found = impulse_response([record(seed, noise, integrates=integrates, colour=colour)], STEP)
        assert found is not None
        assert found.integrates is integrates
        total, half = found.step_response
        assert found.step == STEP
        held.append(np.mean(np.abs(total - true_steps(total.size, integrates=integrates)) < half))
        # seven samples, and one more before a held input shows
        assert found.delay[0] <= DELAY * STEP <= found.delay[1] + 1e-9
    assert 0.88 < np.mean(held) <= 1.0


def test_a_slow_system_is_seen_over_its_whole_length() -> None:
    u, _ = record(3, samples=6000)
    y = lfilter([0.0, 0.01], [1.0, -0.99], u)  # a time constant of a hundred samples
    found = impulse_response([(u, y + 0.01 * np.random.default_rng(1).standard_normal(6000))], STEP)
    assert found is not None
    assert found.step > STEP
    assert not found.integrates
    assert found.step_response[0][-1] == pytest.approx(1.0, abs=0.05)


def test_several_runs_count_together_and_none_is_no_answer() -> None:
    runs = [record(seed, samples=500) for seed in range(3)]
    one, all_three = impulse_response(runs[:1], STEP), impulse_response(runs, STEP)
    assert one is not None
    assert all_three is not None
    assert all_three.step_response[1].mean() < one.step_response[1].mean()
    assert impulse_response([(np.ones(500), np.arange(500.0))], STEP) is None
    assert impulse_response([(np.arange(20.0), np.arange(20.0))], STEP) is None


def test_a_model_is_estimated_alike() -> None:
    u, y = record(5)
    found = impulse_response([(u, y)], STEP)
    assert found is not None
    np.testing.assert_allclose(respond_alike(found, [(u, y)]), found.taps, atol=1e-9)
    right = respond_alike(found, [(u, lfilter(*discrete(), u))])
    assert np.mean(np.abs(right - found.taps) < found.half_width) > 0.9
    early = respond_alike(found, [(u, np.r_[lfilter(*discrete(), u)[5:], np.zeros(5)])])
    assert np.max(np.abs(early - found.taps) / found.half_width) > 5.0


def test_frequency_response_against_the_transfer_function() -> None:
    runs = [record(seed, 0.05, samples=4000) for seed in range(2)]
    found = frequency_response(runs, STEP)
    assert found is not None
    z = np.exp(-2j * np.pi * found.frequency * STEP)
    b, a = discrete()
    true = np.polyval(b[::-1], z) / np.polyval(a[::-1], z)
    slow = (found.frequency > 0.5) & (found.frequency < 5.0)
    assert found.coherence[slow].min() > 0.9
    off = np.abs(found.magnitude - np.abs(true))[slow] / (found.relative * found.magnitude)[slow]
    assert np.mean(off < 2.5) > 0.8


def test_a_residual_that_follows_its_input_is_beyond_chance() -> None:
    rng = np.random.default_rng(88)
    u, _ = record(8)
    coloured = lfilter([1.0], [1.0, -0.9], rng.standard_normal(u.size))
    apart = cross_correlation([u], [coloured], STEP)
    assert apart is not None
    assert np.mean(np.abs(apart.correlation) > apart.limit) < 0.1
    led = cross_correlation([u], [coloured + np.r_[np.zeros(4), u[:-4]]], STEP)
    assert led is not None
    assert led.lag[np.argmax(np.abs(led.correlation))] == pytest.approx(4 * STEP)
    assert np.abs(led.correlation).max() > led.limit
