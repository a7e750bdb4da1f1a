"""Cubic pieces through samples, against SciPy's spline and cubics that they have to reproduce."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from fluidact_fit.estimation.spline import FEWEST, cubic_pieces


@pytest.mark.parametrize("samples", [FEWEST, 5, 400])
@pytest.mark.parametrize("jitter", [0.0, 0.45])
def test_pieces_are_those_of_a_not_a_knot_spline(samples: int, jitter: float) -> None:
    rng = np.random.default_rng(samples)
    time = 3.0 + 0.01 * (np.arange(samples) + jitter * rng.uniform(-1.0, 1.0, samples))
    values = rng.standard_normal(samples)
    expected = CubicSpline(time, values).c[::-1].T
    scale = np.abs(expected).max(axis=0)
    np.testing.assert_allclose(cubic_pieces(time, values) / scale, expected / scale, atol=1e-11)


def test_a_cubic_is_reproduced_and_its_samples_stay_as_they_are() -> None:
    time = np.array([0.0, 0.3, 0.4, 1.0, 1.7])
    values = 1.0 - 2.0 * time + time**3
    kept = time.copy(), values.copy()
    pieces = cubic_pieces(time, values)
    np.testing.assert_allclose(pieces[:, 3], 1.0, rtol=1e-10)
    np.testing.assert_allclose(pieces[:, 1], -2.0 + 3.0 * time[:-1] ** 2, atol=1e-10)
    np.testing.assert_array_equal((time, values), kept)
