"""Single samples that no machine produces are found; what a machine does is left alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fluidact_fit.logs.spikes import find_spikes

N = 400
STILL = np.zeros(N, dtype=bool)
T = np.arange(N) * 0.01
SMOOTH = np.sin(2.0 * np.pi * 0.7 * T)


@given(place=st.integers(0, N - 1), height=st.floats(2.0, 1e6), sign=st.sampled_from((-1.0, 1.0)))
def test_a_single_sample_far_away_is_found_wherever_it_is(place, height, sign):
    y = SMOOTH + 0.01 * np.random.default_rng(1).standard_normal(N)
    y[place] = y[place] + sign * height
    assert find_spikes(y, STILL).tolist() == [place]


@given(seed=st.integers(0, 10_000))
def test_noise_has_no_spikes(seed):
    rng = np.random.default_rng(seed)
    assert not find_spikes(rng.standard_normal(N), STILL).size
    assert not find_spikes(SMOOTH + 0.1 * rng.standard_normal(N), STILL).size


def test_several_spikes_of_different_height_are_found():
    y = SMOOTH.copy()
    y[[50, 200]] += [3.0, -40.0]
    assert find_spikes(y, STILL).tolist() == [50, 200]


@pytest.mark.parametrize("place", [0, 1, 37, N - 2])
def test_a_step_is_no_spike(place):
    y = np.where(np.arange(N) > place, 5.0, 0.0)
    moved = np.zeros(N, dtype=bool)
    moved[max(place - 1, 0) : place + 3] = True  # the input that made it
    assert not find_spikes(y, moved).size


def test_a_peak_that_an_input_explains_is_no_spike():
    y = SMOOTH.copy()
    y[100] += 10.0
    moved = STILL.copy()
    moved[98:103] = True
    assert not find_spikes(y, moved).size


def test_steps_of_a_counter_are_no_spikes():
    counts = np.floor(40.0 * SMOOTH)
    counts[200] += 1.0
    assert not find_spikes(counts, STILL).size


def test_a_peak_of_two_samples_is_left_alone():
    y = SMOOTH.copy()
    y[100:102] += 10.0
    assert not find_spikes(y, STILL).size


def test_no_input_moves_an_output_a_hundredfold() -> None:
    """The inlet moved with the spike: it stayed, and a third of the log was cut off instead."""
    y, moved = SMOOTH.copy(), STILL.copy()
    moved[[40, 41, 90, 91, 120, 121, 160, 161, 200, 201, 230, 231, 260, 261, 280, 281]] = True
    y[200] += 100.0 * np.ptp(SMOOTH)
    assert find_spikes(y, moved).tolist() == [200]
    moved[:198] = moved[204:] = False  # all that the input does: the answer to an impulse
    assert not find_spikes(y, moved).size
