"""Errors that wander below a louder white noise: no autoregression of few lags sees them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom
from studies.red_team.attacks import cylinder_friction as friction
from studies.red_team.attacks import input_noise

import fluidact_fit as ff
from fluidact_fit.assessment.independence import fewest_independent, wider_by_blocks
from fluidact_fit.estimation.uncertainty import covariance


def fit(seed: int, wander: float) -> ff.FitResult:
    """Two minutes of strokes, the load cell wandering with a correlation time of 10 s [N]."""
    rng = np.random.default_rng([41, seed])
    logs = []
    for r in friction.record(rng, law=friction.TRUTH, n=12_000):
        n, memory = r["force"].size, np.exp(-float(np.diff(r["time"][:2])[0]) / 10.0)
        driven = wander * np.sqrt(1.0 - memory**2) * rng.standard_normal(n)
        logs.append({**r, "force": r["force"] + lfilter([1.0], [1.0, -memory], driven)})
    return ff.fit("cylinder-friction", logs, mass=friction.MASS, offset="none")


def test_a_wandering_load_cell_is_named() -> None:
    """Levels 2 % off at 4 to 8 standard errors, PASS in 2 of 12."""
    for seed in range(4):
        assert "errors-change-slowly" in {n.code for n in fit(seed, 0.2).notices}


def test_white_noise_is_not() -> None:
    for seed in range(8):
        assert "errors-change-slowly" not in {n.code for n in fit(seed, 0.0).notices}


def test_noise_of_the_force_that_a_piston_adds_up_is_not() -> None:
    """The score is corrected and the residual whitened: 81 of 100 good files were warned of."""
    for seed in range(4):
        rng = np.random.default_rng([42, seed])
        found = ff.fit("hydrostatic", input_noise.hydrostatic(rng, noise=0.5))
        assert "errors-change-slowly" not in {n.code for n in found.notices}


def test_parameter_that_few_blocks_tell_of_is_not() -> None:
    """An edge crossed four times: 16 of 500 good hydrostatic files were warned of."""
    n, tries, wider = 4_800, 400, 0
    rng = np.random.default_rng(43)
    told = np.isin(np.arange(n) // 100, [3, 17, 18, 40])
    x = np.column_stack((np.ones(n), told * rng.standard_normal(n)))
    errors = np.sqrt(np.diag(np.linalg.inv(x.T @ x)))
    for _ in range(tries):
        wider += bool(np.any(wider_by_blocks([x], [rng.standard_normal(n)], errors) > 1.5))
    assert wider <= binom.ppf(0.999, tries, 0.005)


@pytest.mark.parametrize("memory", [0.9, 0.98])
def test_curve_that_took_the_slow_part_of_the_errors_hides_no_autocorrelation(memory) -> None:
    """600 rows worth six were taken for 60: a calibration 2 % off at 4.9 standard errors, PASS."""
    n, tries = 600, 200
    x = np.vander(1.0 - 2.0 * np.abs(np.mod(np.linspace(0.0, 1.5, n), 1.0) - 0.5), 6)
    rng = np.random.default_rng(8)
    expected = n * (1.0 - memory**2) / (1.0 + memory**2)  # Bayley and Hammersley 1946
    more, naively = 0, 0
    for _ in range(tries):
        errors = lfilter([1.0], [1.0, -memory], rng.standard_normal(n + 1000))[1000:]
        rest = errors - x @ np.linalg.lstsq(x, errors)[0]
        more += fewest_independent([x], [rest]) > expected
        naively += covariance([x], [rest]).independent > expected
    low, high = binom.interval(0.999, tries, 0.05)  # a limit of 95 %
    assert low <= more <= high
    assert naively > 0.75 * tries
