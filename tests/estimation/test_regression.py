"""One estimator for balances: noisy columns, weak instruments, bad samples, bounds."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from scipy.stats import binom

from fluidact_fit.estimation.regression import Balance, Estimator, Regression, RegressionModel
from fluidact_fit.experiment import FloatArray

N, TRIES = 400, 150


def solve(
    columns: Mapping[str, FloatArray], target: FloatArray, **more: object
) -> Regression:  # fmt: skip
    """All columns are unknowns."""
    balance = Balance(columns, target, np.ones(target.size, dtype=bool), **more)  # type: ignore[arg-type]
    return Estimator(RegressionModel(lambda _: [balance]), list(columns)).solve()


def noisy(rng: np.random.Generator, size: float) -> tuple[float, float]:
    """A slope of 1 of a column with noise of 1, and its standard error."""
    speed = size * np.sin(np.arange(N) * 0.1)
    column, instrument = speed + rng.standard_normal(N), speed + rng.standard_normal(N)
    output = speed + 0.05 * rng.standard_normal(N)
    found = solve(
        {"slope": column}, output, instruments={"slope": instrument},
        noises=({"slope": np.ones(N)},),
    ).free  # fmt: skip
    return found.values["slope"], found.std_error("slope")


def test_intervals_hold_where_the_column_is_mostly_noise() -> None:
    rng = np.random.default_rng(4)
    found = np.array([noisy(rng, 0.9) for _ in range(TRIES)])
    off = np.abs(found[:, 0] - 1.0) / found[:, 1]  # none where refused
    assert np.sum(off <= 1.96) >= binom.ppf(0.001, TRIES, 0.95)
    assert np.sum(np.isfinite(found[:, 1])) > TRIES // 3


def test_instruments_of_nothing_but_noise_leave_everything_open() -> None:
    rng = np.random.default_rng(5)
    # above 37.4 by chance, chi-square of one degree: 1e-9, and variances are estimated
    finite = sum(np.isfinite(noisy(rng, 0.0)[1]) for _ in range(TRIES))
    assert finite <= binom.ppf(0.999, TRIES, 5e-3)


def test_few_are_picked_by_chance_where_nearly_all_is_refused() -> None:
    """Of those that chance picks the intervals hold too seldom: it must pick next to none."""
    rng = np.random.default_rng(9)
    assert sum(np.isfinite(noisy(rng, 0.5)[1]) for _ in range(TRIES)) <= 0.02 * TRIES


def test_strong_instruments_leave_the_standard_error_of_least_squares() -> None:
    rng = np.random.default_rng(6)
    slope, error = noisy(rng, 30.0)
    assert slope == pytest.approx(1.0, abs=4.0 * error)
    expected = np.hypot(1.0, 0.05) / (30.0 * np.sqrt(0.5 * N))
    assert error == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize("size", [0.05, 0.3])
def test_noise_without_an_instrument_is_in_the_interval(size: float) -> None:
    held, errors = 0, []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        speed = np.sin(np.arange(N) * 0.1)
        column = speed + size * rng.standard_normal(N)
        output = speed + 0.05 * rng.standard_normal(N)
        found = solve({"slope": column}, output, noises=({"slope": np.full(N, size)},)).free
        errors.append(found.std_error("slope"))
        held += abs(found.values["slope"] - 1.0) <= 1.96 * errors[-1]
    # least squares is size^2 / (0.5 + size^2) too small: 1 and 9 standard errors
    assert held >= binom.ppf(0.001, 40, 0.95)
    assert max(errors) < 1.5 * size**2 / (0.5 + size**2) + 0.01


def test_spikes_do_not_pull_and_are_counted() -> None:
    rng = np.random.default_rng(7)
    x = rng.standard_normal(N)
    y = 2.0 * x + 1.0 + 0.1 * rng.standard_normal(N)
    y[::50] += 100.0
    found = solve({"slope": x, "level": np.ones(N)}, y)
    assert found.spikes() == 8
    for name, value in (("slope", 2.0), ("level", 1.0)):
        assert found.free.values[name] == pytest.approx(value, abs=4.0 * found.free.std_error(name))
    # a hundredth of the samples says nothing, and no more is lost
    assert found.free.std_error("level") == pytest.approx(0.1 / np.sqrt(N), rel=0.2)


def test_normal_errors_are_solved_by_least_squares() -> None:
    rng = np.random.default_rng(8)
    x = rng.standard_normal(N)
    y = 2.0 * x + 0.1 * rng.standard_normal(N)
    found = solve({"slope": x}, y)
    assert found.spikes() == 0
    assert found.values["slope"] == pytest.approx(float(x @ y / (x @ x)), rel=1e-6)


def test_limits_hold_what_is_written_and_not_what_is_judged() -> None:
    rng = np.random.default_rng(10)
    x = rng.standard_normal(N)
    y = -0.5 * x + 3.0 + 0.01 * rng.standard_normal(N)
    balance = Balance({"slope": x, "level": np.ones(N)}, y, np.ones(N, dtype=bool))
    found = Estimator(
        RegressionModel(lambda _: [balance]), ["slope", "level"], limits={"slope": (0.0, np.inf)}
    ).solve()
    assert found.values["slope"] == 0.0
    assert found.values["level"] == pytest.approx(float(y.mean()), rel=1e-9)
    assert found.free.values["slope"] == pytest.approx(-0.5, abs=0.01)


def test_what_no_sample_feels_has_no_interval() -> None:
    rng = np.random.default_rng(11)
    x = rng.standard_normal(N)
    found = solve({"slope": x, "nothing": np.zeros(N)}, 2.0 * x + rng.standard_normal(N)).free
    assert not np.isfinite(found.std_error("nothing"))
    assert np.isfinite(found.std_error("slope"))
