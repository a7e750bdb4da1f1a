"""Innovations of an autoregression from rest plus white noise, against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import freqz, lfilter

from fluidact_fit.estimation.whitening import Whitening, autoregression_from_rest, causal_filter


def spread(a: list[float], drive: float, white: float, n: int) -> np.ndarray:
    """Covariance by brute force: every shock sent through the recursion."""
    through = np.eye(n)
    for k in range(n):
        for i, c in enumerate(a):
            if k > i:
                through[k] += c * through[k - 1 - i]
    return drive**2 * through @ through.T + white**2 * np.eye(n)


@pytest.mark.parametrize("a", [[1.0], [1.73, -0.73], [0.5, 0.2, -0.1]])
@pytest.mark.parametrize("white", [0.3, 20.0])
def test_innovations_are_those_of_the_dense_covariance(a: list[float], white: float) -> None:
    n = 500  # longer than the stretch with gains of its own
    filtered = Whitening(np.array(a), 1.0, white)
    full = spread(a, 1.0, white, n)
    rows = np.random.default_rng(1).standard_normal((n, 2))
    exact = np.linalg.solve(np.linalg.cholesky(full), rows)
    np.testing.assert_allclose(filtered.filter(rows), exact, atol=2e-2)
    np.testing.assert_allclose(filtered.filter(rows[:, 0]), exact[:, 0], atol=2e-2)
    assert filtered.logarithm(n) == pytest.approx(np.linalg.slogdet(full)[1], abs=0.1)


def test_an_integrated_noise_keeps_its_unit_root() -> None:
    rng = np.random.default_rng(2)
    series = [np.cumsum(0.2 * rng.standard_normal(800)) for _ in range(4)]
    a, drive = autoregression_from_rest(series, 3)
    assert a.sum() == pytest.approx(1.0, abs=0.01)
    assert drive == pytest.approx(0.2, rel=0.05)
    assert autoregression_from_rest([np.zeros(9)], 2)[1] == 0.0


def test_a_causal_filter_has_the_gains_asked_for_and_no_needless_delay() -> None:
    power = 0.01 + 0.99 / (1.0 + (np.arange(129) / 20.0) ** 4)
    taps = causal_filter(power, 128)
    _, gains = freqz(taps, worN=np.linspace(0.0, np.pi, 129))
    np.testing.assert_allclose(np.abs(gains) ** 2, power, rtol=0.01)
    assert np.all(np.abs(np.roots(taps)) < 1.0)  # zeros inside the circle: none has less delay


def test_innovations_are_focused_column_by_column() -> None:
    rows = np.random.default_rng(3).standard_normal((400, 2))
    plain = Whitening(np.array([0.9]), 1.0, 0.2)
    taps = np.array([1.0, 0.5, -0.2])
    focused = Whitening(np.array([0.9]), 1.0, 0.2, taps)
    expected = lfilter(taps, [1.0], plain.filter(rows), axis=0)
    np.testing.assert_allclose(focused.filter(rows), expected, atol=1e-12)
    np.testing.assert_allclose(focused.filter(rows[:, 1]), expected[:, 1], atol=1e-12)
