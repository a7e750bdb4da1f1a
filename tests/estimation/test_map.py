"""Static maps: folds, the choice of a candidate, positions, spikes, and what a fit leaves."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from fluidact_fit.estimation.map import (
    MapRows,
    cross_validate,
    direction_notices,
    excess_tail,
    find_misfit,
    find_uncertainty,
    fit_map,
    fold_squares,
    interior_folds,
    lone_samples,
    position_edges,
    smallest_sufficient,
    widest_gap,
)
from fluidact_fit.experiment import BoolArray, FloatArray


@dataclass(frozen=True)
class Exponential:
    """``a exp(b x)``, ``b`` not positive."""

    bounds: tuple[FloatArray, FloatArray] = (np.full(2, -np.inf), np.array([np.inf, 0.0]))
    linear: BoolArray = field(default_factory=lambda: np.array([True, False]))

    def value(self, theta: FloatArray, x: FloatArray) -> FloatArray:
        return np.asarray(theta[0] * np.exp(theta[1] * x[:, 0]))

    def slopes(self, theta: FloatArray, x: FloatArray) -> FloatArray:
        one = np.exp(theta[1] * x[:, 0])
        return np.column_stack((one, theta[0] * one * x[:, 0]))


def rows_of(rate: float, noise: float, n: int = 200, seed: int = 0) -> MapRows:
    x = np.linspace(0.0, 2.0, n)
    y = 3.0 * np.exp(rate * x) + noise * np.random.default_rng(seed).standard_normal(n)
    return MapRows(x[:, None], y, np.ones(n))


def test_a_map_is_fitted_and_its_intervals_hold_the_truth() -> None:
    held = 0
    for seed in range(60):
        rows = rows_of(-0.7, 0.05, seed=seed)
        found = fit_map(
            Exponential(), rows, [np.array([1.0, -2.0]), np.array([5.0, -0.1])], apart=True
        )
        spread = find_uncertainty([rows.slopes(found)], [rows.residual(found)], None, False)
        error = np.sqrt(np.diag(spread.covariance))
        held += int(np.sum(np.abs(found.theta - [3.0, -0.7]) < 1.96 * error))
        assert found.tried == 2
        assert found.agreeing == 2
        assert found.free.all()
    assert 0.87 <= held / 120 <= 1.0


def test_a_bound_declares_what_a_map_may_be() -> None:
    found = fit_map(Exponential(), rows_of(0.5, 0.01), [np.array([1.0, -1.0])])
    assert found.theta[1] == 0.0
    assert found.free.tolist() == [True, False]


def test_a_row_that_stands_for_several_counts_as_many() -> None:
    one = rows_of(-0.7, 0.3)
    twice = MapRows(np.repeat(one.x, 2, axis=0), np.repeat(one.y, 2), np.ones(400))
    merged = MapRows(one.x, one.y, np.full(200, 2.0))
    start = [np.array([1.0, -1.0])]
    first, second = (fit_map(Exponential(), r, start) for r in (twice, merged))
    np.testing.assert_allclose(first.theta, second.theta, rtol=1e-9)
    assert twice.squares(first) == pytest.approx(merged.squares(second))


def test_rows_that_are_held_out_are_not_fitted_and_outermost_ones_stay() -> None:
    labels = np.repeat(np.arange(6), 10)
    folds = interior_folds(labels, np.arange(1, 5), 3, seed=1)
    assert (folds[labels == 0] == -1).all()
    assert (folds[labels == 5] == -1).all()
    assert set(folds.tolist()) == {-1, 0, 1, 2}
    assert all(np.unique(folds[labels == k]).size == 1 for k in range(6))

    def predict(rest: BoolArray, held: BoolArray, fold: int) -> FloatArray:
        assert not np.any(rest & held)
        return np.full(int(held.sum()), float(fold))

    error = cross_validate(folds, predict)
    assert np.isnan(error[folds == -1]).all()
    np.testing.assert_allclose(fold_squares(error, folds), [0.0, 1.0, 4.0])


def test_the_simplest_within_one_standard_error_is_sufficient() -> None:
    best = np.array([1.0, 1.2, 0.8, 1.0])
    assert smallest_sufficient([best + 1.0, best + 0.05, best]) == 1
    assert smallest_sufficient([best + 1.0, best + 0.5, best]) == 2
    assert smallest_sufficient([np.zeros(4), np.zeros(4)]) == 0


def test_an_unknown_that_explains_nothing_is_no_surprise() -> None:
    assert excess_tail(1.0, 1.0, 1, 100, 3) == 1.0
    assert excess_tail(101.0, 100.0, 1, 103, 3) == pytest.approx(0.32, abs=0.01)  # F(1, 100) = 1
    assert excess_tail(120.0, 100.0, 1, 103, 3) < 1e-4


def test_positions_are_told_from_a_sweep() -> None:
    rng = np.random.default_rng(0)
    places = np.repeat([0.0, 1.0, 2.0, 4.0], 30) + 1e-3 * rng.standard_normal(120)
    edges = position_edges(places, 120)
    assert edges is not None
    np.testing.assert_allclose(edges, [0.5, 1.5, 3.0], atol=0.01)
    assert position_edges(rng.uniform(0.0, 1.0, 300), 300) is None
    assert widest_gap(np.append(np.linspace(0, 1, 20), np.linspace(3, 4, 20))) == (1.0, 3.0)
    assert widest_gap(np.linspace(0, 1, 20)) is None


def test_a_spike_stands_alone_and_a_misfit_does_not() -> None:
    y = np.sin(np.arange(300) / 20.0)
    residual = 0.01 * np.random.default_rng(1).standard_normal(300)
    y, residual = y + residual, residual.copy()
    for at in (slice(100, 101), slice(200, 230)):
        y[at] += 2.0
        residual[at] += 2.0
    found = lone_samples(y, residual, np.ones(300, dtype=bool))
    assert np.flatnonzero(found).tolist() == [100]


def test_errors_that_go_on_for_a_while_are_no_misfit() -> None:
    rng = np.random.default_rng(3)
    x = np.abs(np.mod(np.arange(4000) / 500.0, 2.0) - 1.0)
    slow = np.convolve(rng.standard_normal(4029), np.ones(30), "valid")
    for shape, seen in ((0.0 * x, False), (6.0 * np.sin(9.0 * x), True)):
        misfit = find_misfit(x, shape + slow, 2, None)
        assert misfit is not None
        assert misfit.is_sure == seen


def test_positions_that_are_missed_and_directions_that_differ_are_seen() -> None:
    rng = np.random.default_rng(2)
    x = np.abs(np.mod(np.arange(800) / 100.0, 2.0) - 1.0)
    noise = 0.01 * rng.standard_normal(800)
    for shape, seen in ((0.0 * x, False), (0.05 * np.sin(9.0 * x), True)):
        misfit = find_misfit(x, shape + noise, 2, None)
        assert misfit is not None
        assert (misfit.probability < 1e-6) == seen
    rising = (np.gradient(x) > 0.0).astype(float)
    columns = np.column_stack((np.ones(800), x))
    for width, seen in ((0.0, False), (0.03, True)):
        residual = noise + width * rising
        said = list(direction_notices(
            ("output", "inputs", ""), "", "{:.6f}".format, 1e-3, [columns], [residual], [rising]
        ))  # fmt: skip
        assert len(said) == seen
        if seen:  # within 4 standard errors
            assert float(said[0].message.split()[3]) == pytest.approx(width, abs=3e-3)
