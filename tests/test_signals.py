"""Signals between their samples: where they turned."""

import numpy as np
import pytest

from fluidact_fit.signals import turns_between


@pytest.mark.parametrize("early", [0.1, 0.37, 0.5, 0.88])
def test_turns_between_samples_are_those_of_the_curve(early):
    """Of a triangle to rounding, of a sine to a thirtieth of what samples can miss."""
    t = np.arange(60) + 0.0
    triangle = np.abs((t + early) % 20.0 - 10.0)
    at, values = turns_between(t, triangle, 1e-9)
    extremes = np.round(values / 10.0) * 10.0
    assert set(extremes.tolist()) == {0.0, 10.0}
    assert np.abs(values - extremes).max() < 1e-4
    assert np.abs((at + early) % 10.0 - 5.0).min() > 4.9999
    sine = np.sin(0.3 * (t + early))
    _, values = turns_between(t, sine, 1e-9)
    assert np.abs(np.abs(values) - 1.0).max() < 0.3**2 / 8.0 / 30.0


@pytest.mark.parametrize("rows", [slice(8, 60), slice(60, 7, -1)])
def test_a_turn_one_row_from_an_end_is_found(rows):
    t = np.arange(60) + 0.0
    triangle = np.abs((t + 0.37) % 20.0 - 10.0)[rows]
    at, values = turns_between(t[: triangle.size], triangle, 1e-9)
    assert len(at) == 5
    assert np.abs(values - np.round(values / 10.0) * 10.0).max() < 1e-4


def test_noise_and_rests_have_no_turns_between_samples():
    t, rng = np.arange(5000.0), np.random.default_rng(2)
    assert turns_between(t, rng.standard_normal(t.size), 6.0)[0].size == 0
    rest = np.clip(np.abs(t % 40.0 - 20.0), 5.0, 15.0)
    assert turns_between(t, rest, 1e-9)[0].size == 0
