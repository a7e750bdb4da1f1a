"""Networks: exact Jacobians, training, and regions that are all there."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fluidact_fit.estimation.network import (
    Activation,
    Chords,
    Cost,
    Network,
    Training,
    huber_cost,
    propagate_back,
    samples_last,
    search,
    train_from,
    write_derivatives,
)
from fluidact_fit.experiment import FloatArray
from fluidact_fit.families.force_map.certificates import activation_regions


def make_network(sizes: tuple[int, ...], activation: Activation = "relu", seed: int = 0) -> Network:
    rng = np.random.default_rng(seed)
    weights = tuple(rng.standard_normal((b, a)) for a, b in pairwise(sizes))
    return Network(weights, tuple(rng.standard_normal(n) for n in sizes[1:]), activation)


def derivatives(net: Network, x: FloatArray, factors: FloatArray) -> FloatArray:
    layers, out = net.layer_inputs(samples_last(x)), np.empty((net.parameters, x.shape[0]))
    write_derivatives(propagate_back(net, layers, factors), layers, out)
    return out


@pytest.mark.parametrize("sizes", [(3, 5, 1), (4, 7, 1), (2, 4, 3, 1)])
@pytest.mark.parametrize("activation", ["relu", "tanh"])
@pytest.mark.parametrize("sharpness", [np.inf, 4.0])
def test_jacobian_is_exact(
    sizes: tuple[int, ...], activation: Activation, sharpness: float
) -> None:
    net = replace(make_network(sizes, activation), sharpness=sharpness)
    x = np.random.default_rng(1).standard_normal((40, sizes[0]))
    factors = np.linspace(0.5, 2.0, 40)
    jacobian = derivatives(net, x, factors)
    p, step = net.vector(), 1e-6
    for k in range(p.size):
        e = step * (np.arange(p.size) == k)
        numeric = (net.from_vector(p + e)(x) - net.from_vector(p - e)(x)) / (2.0 * step)
        assert np.allclose(jacobian[k], factors * numeric, atol=1e-6)


def test_papers_networks_have_26_and_43_parameters() -> None:
    assert make_network((3, 5, 1)).parameters == 26
    assert make_network((4, 7, 1)).parameters == 43


def test_training_finds_the_network_that_made_the_data() -> None:
    true = make_network((2, 3, 1), seed=4)
    rng = np.random.default_rng(2)
    x = rng.uniform(-2.0, 2.0, (2000, 2))
    y = true(x)
    found = search(x, y / y.std(), Training((3,), decay=1e-9), np.random.default_rng(0))
    error = y.std() * found[0].network(x) - y
    assert np.sqrt(np.mean(error**2)) < 0.02 * y.std()


def test_training_is_deterministic() -> None:
    x = np.random.default_rng(0).uniform(-1.0, 1.0, (500, 2))
    y = np.abs(x[:, 0]) + x[:, 1]
    one, two = (search(x, y, Training((4,)), np.random.default_rng(5))[0].network for _ in "ab")
    assert np.array_equal(one.vector(), two.vector())


def test_spikes_do_not_pull() -> None:
    rng = np.random.default_rng(0)
    x = rng.uniform(-1.0, 1.0, (3000, 1))
    clean = np.maximum(x[:, 0], 0.0)
    y = clean + 0.01 * rng.standard_normal(3000)
    y[::100] += 20.0
    found = search(x, y, Training((2,)), np.random.default_rng(0))
    assert np.sqrt(np.mean((found[0].network(x) - clean) ** 2)) < 0.05


def chord_cost(chords: Chords, net: Network) -> float:
    deviation = sum(share * net(x) for share, x in zip(chords.shares, chords.points))
    return chords.strength * float(np.mean(np.square(deviation)))


def cost_at(net: Network, x: FloatArray, y: FloatArray, cost: Cost) -> float:
    return train_from(net, x, y, cost, iterations=0).cost


def test_chords_measure_the_deviation_from_a_straight_line() -> None:
    x = np.random.default_rng(0).uniform(-1.0, 1.0, (300, 2))
    bent = Network((np.array([[1.0, 0.0]]), np.array([[1.0]])), (np.zeros(1), np.zeros(1)))
    chords = Chords.along(x, 0, 2.0)
    low, between, high = chords.points[:, :, 0]
    line = np.maximum(high, 0.0) * (between - low) / (high - low)
    expected = 2.0 * np.mean((np.maximum(between, 0.0) - line) ** 2)
    y = bent(x)
    assert cost_at(bent, x, y, Cost(chords=chords)) == pytest.approx(expected, rel=1e-12)
    other = Cost(chords=Chords.along(x, 1, 2.0))
    assert cost_at(bent, x, y, other) == pytest.approx(0.0, abs=1e-20)


def test_chords_straighten_one_input_only() -> None:
    x = np.random.default_rng(0).uniform(-1.0, 1.0, (2000, 2))
    y = np.abs(x[:, 0]) + np.abs(x[:, 1])
    start = search(x, y, Training((6,)), np.random.default_rng(0))[0].network
    chords = Chords.along(x, 0, 100.0)
    found = train_from(start, x, y, Cost(1e-6, chords=chords))
    assert chord_cost(chords, found.network) < 1e-2 < chord_cost(chords, start)
    rest = y - found.network(x)
    assert rest.std() == pytest.approx(np.abs(x[:, 0]).std(), rel=0.1)
    cost = np.mean(rest**2) + 1e-6 * sum((w**2).sum() for w in found.network.weights)
    assert found.cost == pytest.approx(cost + chord_cost(chords, found.network), rel=1e-9)


@pytest.mark.parametrize("limit", [np.inf, 0.3])
def test_one_step_is_that_of_the_written_out_normal_equations(limit: float) -> None:
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-1.0, 1.0, (6000, 2)), rng.standard_normal(6000)  # two blocks of rows
    net = make_network((2, 3, 1), "tanh")
    chords = Chords.along(x, 1, 0.5)

    def slopes_at(z: FloatArray) -> FloatArray:
        return derivatives(net, z, np.ones(z.shape[0])).T

    p, residual, slopes = net.vector(), y - net(x), slopes_at(x)
    weight = np.minimum(1.0, limit / np.abs(residual))
    parts = list(zip(chords.shares, chords.points))
    bend, bent = sum(s * net(z) for s, z in parts), sum(s[:, None] * slopes_at(z) for s, z in parts)
    strength = 0.5 * y.size / np.size(bend)
    ridge = 6000 * 1e-3 * np.array([1, 1, 1, 1, 1, 1, 0, 0, 0, 1, 1, 1, 0])  # none of biases
    matrix = (slopes.T * weight) @ slopes + strength * np.transpose(bent) @ bent + np.diag(ridge)
    gradient = slopes.T @ (weight * residual) - strength * np.transpose(bent) @ bend - ridge * p
    step = np.linalg.solve(matrix + 1e-2 * np.diag(np.diag(matrix)), gradient)
    found = train_from(net, x, y, Cost(1e-3, limit, chords), iterations=1)
    assert found.iterations == 1
    np.testing.assert_allclose(found.network.vector() - p, step, rtol=1e-4, atol=1e-5)


def test_huber_cost_is_smooth_at_the_limit() -> None:
    assert huber_cost(np.array([1.0]), 1.0) == 1.0
    assert huber_cost(np.array([3.0]), 1.0) == 5.0


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 8), st.integers(1, 3))
def test_regions_are_all_there_and_their_bound_is_exact(seed: int, units: int, inputs: int) -> None:
    net = make_network((inputs, units, 1), seed=seed)
    low, high = -np.ones(inputs), 1.5 * np.ones(inputs)
    regions = activation_regions(net, low, high)
    patterns = {r.pattern for r in regions}
    assert len(patterns) == len(regions) <= 2**units
    x = np.random.default_rng(seed).uniform(low, high, (4000, inputs))
    z = x @ net.weights[0].T + net.biases[0]
    clear = np.abs(z).min(axis=1) > 1e-6
    assert {tuple(row) for row in (z[clear] > 0.0).tolist()} <= patterns
    for r in regions:
        inside = net.weights[0] @ r.inside + net.biases[0]
        assert tuple((inside > 0.0).tolist()) == r.pattern
        step = 1e-7 * np.eye(inputs)
        numeric = (net(r.inside + step) - net(r.inside - step)) / 2e-7
        assert np.allclose(numeric, r.gradient, atol=1e-5) or np.abs(inside).min() < 1e-6


def test_an_input_that_is_held_is_held() -> None:
    net = make_network((3, 6, 1))
    low, high = np.array([-1.0, -1.0, 0.3]), np.array([1.0, 1.0, 0.3])
    assert all(r.inside[2] == 0.3 for r in activation_regions(net, low, high))


def test_regions_of_other_networks_are_refused() -> None:
    with pytest.raises(ValueError, match="one hidden layer"):
        activation_regions(make_network((2, 3, 1), "tanh"), -np.ones(2), np.ones(2))
