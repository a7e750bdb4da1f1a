"""Intervals of two-stage least squares whose instruments say little."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from fluidact_fit.estimation.uncertainty import covariance
from fluidact_fit.estimation.weak_instruments import reachable_variances

N, TRIES = 400, 300


def estimate(rng: np.random.Generator, size: float) -> tuple[float, float, float]:
    """A slope of 1, its standard error as usual, and that of the values that are possible."""
    speed = size * np.sin(np.arange(N) * 0.1)
    column, instrument = speed + rng.standard_normal(N), speed + rng.standard_normal(N)
    output = speed + 0.05 * rng.standard_normal(N)
    projected = instrument * (instrument @ column) / (instrument @ instrument)
    slope = float(projected @ output / (projected @ projected))
    residual = output - column * slope
    found = covariance([projected[:, None]], [residual])
    reach = reachable_variances(
        column[:, None], projected[:, None], residual, np.diag(found.covariance), found.degrees
    )
    return slope, float(np.sqrt(found.covariance[0, 0])), float(np.sqrt(reach[0]))


def test_intervals_hold_where_the_column_is_mostly_noise() -> None:
    rng = np.random.default_rng(4)
    found = np.array([estimate(rng, 0.9) for _ in range(TRIES)])
    off = np.abs(found[:, 0] - 1.0)[:, None] / found[:, 1:]  # none where refused
    usual, reaching = np.sum(off <= 1.96, axis=0)
    assert reaching >= binom.ppf(0.001, TRIES, 0.95)  # the farther end on both sides: or more
    assert usual < reaching
    assert np.sum(np.isfinite(found[:, 2])) > TRIES // 3


def test_instruments_of_nothing_but_noise_leave_everything_open() -> None:
    rng = np.random.default_rng(5)
    found = [estimate(rng, 0.0) for _ in range(TRIES)]
    # above 37.4 by chance, chi-square of one degree: 1e-9, and variances are estimated
    assert sum(np.isfinite(reach) for *_, reach in found) <= binom.ppf(0.999, TRIES, 5e-3)


def test_few_are_picked_by_chance_where_nearly_all_is_refused() -> None:
    """Of those that chance picks the intervals hold too seldom: it must pick next to none."""
    rng = np.random.default_rng(9)
    found = [estimate(rng, 0.5) for _ in range(TRIES)]
    assert sum(np.isfinite(reach) for *_, reach in found) <= 0.02 * TRIES


def test_strong_instruments_leave_the_standard_error_as_it_is() -> None:
    slope, usual, reach = estimate(np.random.default_rng(6), 30.0)
    assert slope == pytest.approx(1.0, abs=4.0 * usual)
    assert reach == pytest.approx(usual, rel=0.1)


def test_a_column_without_noise_needs_no_instrument() -> None:
    x = np.random.default_rng(7).standard_normal((N, 2))
    rest = np.random.default_rng(8).standard_normal(N)
    assert reachable_variances(x, x, rest, np.ones(2), N).tolist() == [0.0, 0.0]
