"""Speed and acceleration of a recorded position."""

from __future__ import annotations

import numpy as np
import pytest

from fluidact_fit.mechanics.local_motion import local_motion


def test_a_parabola_is_differentiated_exactly() -> None:
    t = np.arange(50) * 0.01
    speed, acceleration = local_motion(t, 1.0 + 2.0 * t - 3.0 * t**2, 0.0, 1.0)
    inner = np.isfinite(speed)
    assert inner.sum() == 46
    assert speed[inner] == pytest.approx((2.0 - 6.0 * t)[inner])
    assert acceleration[inner] == pytest.approx(-6.0, abs=1e-6)


def test_parabolas_are_as_long_as_the_noise_asks_for() -> None:
    rng, t, noise = np.random.default_rng(3), np.arange(20_000) * 0.01, 1e-3
    speed, _ = local_motion(t, noise * rng.standard_normal(t.size), noise, 0.01)
    assert 0.004 < float(np.nanstd(speed)) < 0.01
    _, acceleration = local_motion(t, noise * rng.standard_normal(t.size), noise, np.inf, 0.1)
    assert 0.03 < float(np.nanstd(acceleration)) < 0.1


def test_nothing_is_said_across_lost_samples_nor_of_too_few() -> None:
    t = np.concatenate((np.arange(30), np.arange(35, 70))) * 0.01
    speed, _ = local_motion(t, t, 0.0, 1.0)
    assert np.isnan(speed[28:32]).all()
    assert np.isfinite(speed[2:28]).all()
    assert np.isnan(local_motion(t[:3], t[:3], 0.0, 1.0)[0]).all()
