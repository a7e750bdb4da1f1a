"""Covariance of unknowns that few samples cannot determine."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from fluidact_fit.estimation.converter_errors import _most_noise
from fluidact_fit.estimation.uncertainty import (
    covariance,
    enlarge,
    largest,
    score_covariance,
)


@pytest.mark.parametrize("samples", [1, 3, 4])
def test_fewer_samples_than_unknowns_determine_none_that_they_mix(samples: int) -> None:
    rng = np.random.default_rng(3)
    jacobian = rng.normal(size=(samples, 5))
    found = covariance([jacobian], [np.full(samples, 0.1)])
    assert np.isinf(np.diag(found.covariance)).all()


def test_an_unknown_that_the_samples_do_tell_keeps_its_variance() -> None:
    jacobian = np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])  # of three, the first alone
    found = covariance([jacobian], [np.array([0.1, -0.05])])
    variances = np.diag(found.covariance)
    # one degree of freedom: cost / (J'J)
    assert variances[0] == pytest.approx((0.1**2 + 0.05**2) / 5.0)
    assert np.isinf(variances[1:]).all()


@pytest.mark.parametrize("memory", [0.5, 0.9])
def test_independent_samples_are_those_of_the_autoregression(memory: float) -> None:
    n = 100_000
    rest = lfilter([1.0], [1.0, -memory], np.random.default_rng(5).normal(size=n))
    expected = n * (1.0 - memory**2) / (1.0 + memory**2)  # Bayley and Hammersley 1946
    # d(ln n_e) = -4 rho / (1 - rho^4) d(rho), where rho has a variance of (1 - rho^2) / n
    spread = 4.0 * memory / (1.0 - memory**4) * np.sqrt((1.0 - memory**2) / n)
    found = covariance([np.ones((n, 1))], [rest])
    assert found.independent == pytest.approx(expected, rel=4.0 * spread)


def test_white_residuals_are_as_many_as_they_are() -> None:
    white = np.random.default_rng(6).normal(size=5000)
    assert np.isinf(covariance([np.ones((5000, 1))], [white]).independent)


def test_a_run_of_which_nothing_is_described_adds_nothing() -> None:
    rng = np.random.default_rng(7)
    jacobian, rest = rng.normal(size=(200, 2)), rng.normal(size=200)
    alone = score_covariance([jacobian], [rest], [[slice(0, 200)]])
    empty = np.zeros((0, 2)), np.zeros(0), [slice(0, 0)]
    both = score_covariance(*([x, y] for x, y in zip((jacobian, rest, [slice(0, 200)]), empty)))
    np.testing.assert_array_equal(both.covariance, alone.covariance)


def _deviations(x: np.ndarray, step: float) -> np.ndarray:
    """Errors of a straight line through readings of a converter, in standard errors (rms)."""
    rng = np.random.default_rng(3)
    jacobian, found = np.column_stack((np.ones(x.size), x)), []
    for _ in range(200):
        truth = rng.uniform(1.0, 2.0, 2)  # another machine each time: the converter knows no chance
        exact = jacobian @ truth + 1e-3 * rng.standard_normal(x.size)
        y = step * np.round(exact / step)
        estimate = np.linalg.lstsq(jacobian, y)[0]
        u = covariance([jacobian], [y - jacobian @ estimate], readings=[(y, step)])
        found.append((estimate - truth) / np.sqrt(np.diag(u.covariance)))
    return np.asarray(np.sqrt(np.mean(np.square(found), axis=0)))


@pytest.mark.parametrize("step", [0.1, 0.3])
@pytest.mark.parametrize("levels", [[-1.0, -0.61, -0.2, 0.27, 0.6, 1.0], [-1.0, -0.3, 0.9]])
def test_levels_met_again_have_the_converter_error_again(levels: list[float], step: float) -> None:
    found = _deviations(np.repeat(np.tile(levels, 8), 20), step)
    assert np.all((found > 0.7) & (found < 1.2))


@pytest.mark.parametrize("step", [0.1, 0.3, 0.6])
def test_a_signal_that_crosses_the_codes_averages_the_converter_error(step: float) -> None:
    """Intervals were twice as wide as they had to be: 0.45 to 0.6 standard errors rms."""
    t = 0.01 * np.arange(1000)
    moving = np.sin(2.0 * np.pi * 0.7 * t) + 0.5 * np.sin(2.0 * np.pi * 0.31 * t + 1.0)
    found = _deviations(moving, step)
    assert np.all((found > 0.7) & (found < 1.2))


@pytest.mark.parametrize("noise", [0.1, 0.3, 0.6])
def test_the_longest_reading_bounds_the_noise(noise):
    rng = np.random.default_rng(4)
    signal = np.repeat(rng.uniform(0.0, 10.0, 8), 150) + noise * rng.standard_normal(1200)
    readings = [(0.5 * np.round(signal), 0.5)]
    bound = _most_noise(readings)
    assert 0.5 * noise < bound < 2.0 * 0.5 * max(noise, 0.13)


def test_a_level_on_an_edge_between_codes_is_not_averaged():
    """Noise of a twentieth of a code flips its readings; their mean is off by up to half a code."""
    rng = np.random.default_rng(5)
    errors, claimed = [], []
    for _ in range(100):
        levels = np.repeat([0.5 + 0.03 * rng.standard_normal(), 3.5 + rng.uniform(-0.5, 0.5)], 300)
        shaken = levels + 0.05 * rng.standard_normal(600) + 0.2 * rng.standard_normal(600)
        y = np.round(levels + 0.05 * rng.standard_normal(600))
        columns = np.column_stack((levels < 2.0, levels > 2.0)).astype(float)
        values = np.array([y[:300].mean(), y[300:].mean()])
        errors.append(values[0] - levels[0])
        r = y - columns @ values + shaken - levels  # noise of a regressor is in the residual
        found = covariance([columns], [r], readings=[(y, 1.0)])
        claimed.append(np.sqrt(found.covariance[0, 0]))
    assert np.median(claimed) > 0.5 * np.std(errors)


@pytest.mark.parametrize("shaken", [0.0, 0.2])
def test_steady_levels_are_read_wrong_however_noisy_a_regressor_is(shaken: float) -> None:
    """Noise of a speed hid the steps of a force in its residual: errors were 3 to 4 stated ones."""
    rng, step = np.random.default_rng(8), 0.05
    v = np.repeat(np.tile([0.02, 0.05, 0.1], 2), 150)
    columns, found = np.column_stack((np.ones(v.size), v)), []
    for _ in range(100):
        truth = np.array([2.4, 45.0]) * rng.uniform(0.8, 1.2, 2)
        force = columns @ truth + shaken * step * rng.standard_normal(v.size)
        y = step * np.round(force / step)
        estimate = np.linalg.lstsq(columns, y)[0]
        rest = y - columns @ estimate - truth[1] * 1e-3 * rng.standard_normal(v.size)
        u = covariance([columns], [rest], readings=[(y, step)])
        found.append((estimate - truth) / np.sqrt(np.diag(u.covariance)))
    size = np.sqrt(np.mean(np.square(found), axis=0))
    assert np.all((size > 0.6) & (size < 1.25))


def test_stretches_of_a_few_samples_have_errors_of_the_converter_too():
    rng = np.random.default_rng(6)
    sizes = [1, 2, 3, 4, 300]
    y = [np.round(rng.uniform(0.0, 5.0, n)) for n in sizes]
    rest = [rng.uniform(-0.5, 0.5, n) for n in sizes]
    found = covariance([np.ones((n, 1)) for n in sizes], rest, readings=[(r, 1.0) for r in y])
    assert 0.0 < found.covariance[0, 0] < np.inf


@pytest.mark.filterwarnings("error")
def test_a_covariance_grows_where_it_is_finite():
    found = enlarge(np.array([[1.0, 0.5], [0.5, np.inf]]), np.array([4.0, np.inf]))
    assert found.tolist() == [[4.0, 1.0], [1.0, np.inf]]


def test_errors_of_a_converter_are_correlated_as_they_are_and_not_as_noise_would_be():
    # a ramp tells one level to a hundredth of a code; how far a rest lies above it only the code of
    # that rest tells, and white noise would give the two a correlation of -0.7
    rng = np.random.default_rng(7)
    columns = np.repeat([[1.0, 0.0], [1.0, 1.0]], 400, axis=0)
    for _ in range(5):
        signal = np.concatenate((np.linspace(0.0, 40.0, 400), np.full(400, 20.0)))
        signal += rng.uniform() + np.repeat([0.0, rng.uniform()], 400)
        y = np.round(signal)
        rest = y - signal - columns @ np.linalg.lstsq(columns, y - signal, rcond=None)[0]
        v = covariance([columns], [rest], readings=[(y, 1.0)]).covariance
        assert abs(v[0, 1]) < 0.3 * np.sqrt(v[0, 0] * v[1, 1])


def test_the_largest_covariance_keeps_the_correlations_of_the_one_that_says_most():
    small = np.array([[1.0, 0.5], [0.5, 1.0]])
    large = np.array([[4.0, -1.5], [-1.5, 0.9]])
    found = largest([small, large])
    assert np.diag(found).tolist() == [4.0, 1.0]
    assert found[0, 1] == pytest.approx(-1.5 / np.sqrt(0.9))


def test_the_largest_covariance_has_what_one_candidate_takes_for_known() -> None:
    found = largest([np.diag([1.0, 1.0, 0.0]), np.diag([0.1, 0.1, 4.0])])
    assert np.diag(found).tolist() == [1.0, 1.0, 4.0]
