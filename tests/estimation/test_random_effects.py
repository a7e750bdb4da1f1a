"""Spread between units: recovery, coverage of its intervals, outliers, limits."""

from __future__ import annotations

import numpy as np
import pytest

from fluidact_fit.estimation.random_effects import Spread, estimate_spread

RUNS = 300


def _units(rng: np.random.Generator, between: float, number: int) -> tuple[np.ndarray, np.ndarray]:
    errors = rng.uniform(0.3, 1.5, number)
    values = 10.0 + between * rng.standard_normal(number) + errors * rng.standard_normal(number)
    return values, errors


def _spread(values: np.ndarray, errors: np.ndarray) -> Spread:
    found = estimate_spread(values, errors)
    assert found is not None
    return found


@pytest.mark.parametrize(("between", "number"), [(0.0, 30), (0.5, 30), (2.0, 8)])
def test_intervals_hold_the_truth(between: float, number: int) -> None:
    rng = np.random.default_rng(5)
    found = [_spread(*_units(rng, between, number)) for _ in range(RUNS)]
    mean = np.mean([f.mean_ci95[0] <= 10.0 <= f.mean_ci95[1] for f in found])
    spread = np.mean([f.between_ci95[0] <= between <= f.between_ci95[1] for f in found])
    slack = 3.5 * np.sqrt(0.95 * 0.05 / RUNS)
    assert mean > 0.95 - slack
    assert spread > 0.95 - slack
    # at most one set in twenty holds an outlier by chance
    assert np.mean([f.outlier.any() for f in found]) < 0.05 + slack


def test_the_spread_is_that_between_units_alone() -> None:
    found = _spread(*_units(np.random.default_rng(6), 1.0, 3000))
    # the information of tau from n units with these errors is below that without any errors
    assert found.between == pytest.approx(1.0, abs=0.08)
    assert np.std(_units(np.random.default_rng(6), 1.0, 3000)[0]) > 1.3


def test_outliers_are_found_although_many_hide_each_other() -> None:
    rng = np.random.default_rng(7)
    values, errors = _units(rng, 1.0, 1000)
    values[:20] += 12.0
    found = _spread(values, errors)
    assert found.outlier[:20].all()
    assert found.outlier[20:].sum() <= 1
    assert found.between == pytest.approx(1.0, abs=0.15)


def test_a_unit_is_judged_by_its_own_uncertainty() -> None:
    rng = np.random.default_rng(8)
    values, errors = _units(rng, 0.0, 200)
    errors[0], values[0] = 40.0, 60.0  # far away, and poorly determined
    errors[1], values[1] = 0.01, 11.0  # within the others, and sharply determined
    found = _spread(values, errors)
    assert not found.outlier[0]
    assert abs(found.deviation[1]) > abs(found.deviation[0])


def test_any_unit_of_measurement_gives_the_same() -> None:
    values, errors = _units(np.random.default_rng(9), 0.7, 40)
    one, other = _spread(values, errors), _spread(1e-9 * values, 1e-9 * errors)
    assert other.between == pytest.approx(1e-9 * one.between, rel=1e-6)
    assert other.mean == pytest.approx(1e-9 * one.mean, rel=1e-9)


def test_two_units_say_nothing_of_their_spread() -> None:
    assert estimate_spread(np.array([1.0, 2.0]), np.array([0.1, 0.1])) is None


def test_units_without_scatter_have_no_spread() -> None:
    found = _spread(np.full(5, 3.0), np.full(5, 0.1))
    assert found.between == 0.0
    assert found.between_ci95[0] == 0.0
    assert found.mean == 3.0
