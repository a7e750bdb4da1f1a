"""Exact sampling against brute force, limit cases and symmetries."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.signal import lsim

from fluidact_fit.estimation.grid import make_grid
from fluidact_fit.estimation.inputs import (
    PiecewiseInput,
    apply_dead_zone,
    beyond_dead_zone,
    choose_hold,
    is_smooth,
    piecewise,
)
from fluidact_fit.estimation.linear import forced_response, free_response, transition
from fluidact_fit.estimation.recursion import scan
from fluidact_fit.experiment import Signal
from fluidact_fit.rows import BLOCK_ROWS

RNG = np.random.default_rng(4)


def oscillator(wn: float, zeta: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    a = wn * np.array([[0.0, 1.0], [-1.0, -2.0 * zeta]])
    return a, np.array([0.0, wn]), np.array([1.0, 0.0])


def signal(time: np.ndarray, values: np.ndarray, hold: str) -> Signal:
    return Signal("u", time, values, "1", hold, float(values[0]))


@pytest.mark.parametrize("h", [0.0, 1e-9, 0.01, 3.0])
@pytest.mark.parametrize("zeta", [0.3, 1.0, 4.0])
def test_transition_is_the_matrix_exponential(h: float, zeta: float) -> None:
    a, b, _ = oscillator(7.0, zeta)
    phi, gamma = transition(a, b, np.array([h]), 1)
    big = np.zeros((4, 4))
    big[:2, :2], big[:2, 2], big[2, 3] = a * h, b * h, 1.0
    want = expm(big)
    assert gamma is not None
    np.testing.assert_allclose(phi[0], want[:2, :2], atol=1e-13)
    np.testing.assert_allclose(gamma[0], want[:2, 2:], atol=1e-13)


def test_transition_passes_zero_stiffness_without_a_seam() -> None:
    """The poles of m x'' + c x' + k x meet the origin as k vanishes; nothing jumps there."""

    def response(k: float) -> np.ndarray:
        a = np.array([[0.0, 1.0], [-k, -3.0]])
        phi, gamma = transition(a, np.array([0.0, 1.0]), np.array([0.5]), 1)
        return np.concatenate((phi.ravel(), gamma.ravel()))

    slope = (response(1e-4) - response(-1e-4)) / 2e-4
    np.testing.assert_allclose(response(0.0) + 1e-4 * slope, response(1e-4), atol=1e-9)


@pytest.mark.parametrize("varying", [False, True])
@pytest.mark.parametrize("m", [1, 2, 7, 100, 1001])
def test_scan_is_the_plain_recursion(m: int, varying: bool) -> None:
    phi = RNG.normal(size=(m, 2, 2)) * 0.5 if varying else RNG.normal(size=(2, 2)) * 0.5
    forcing, x = RNG.normal(size=(m, 2)), RNG.normal(size=2)
    want = [x]
    for k in range(m):
        want.append((phi[k] if varying else phi) @ want[-1] + forcing[k])
    got = np.concatenate([states for _, states in scan(phi, forcing.__getitem__, x, m)])
    np.testing.assert_allclose(got, want, atol=1e-9)


@pytest.mark.parametrize("hold", ["zoh", "foh"])
@pytest.mark.parametrize("zeta", [0.4, 1.0, 2.5])
def test_forced_response_agrees_with_a_fine_simulation(hold: str, zeta: float) -> None:
    time = np.arange(60) * 0.02
    values = RNG.normal(size=60)
    a, b, c = oscillator(25.0, zeta)
    got = forced_response(a, b, c, piecewise(signal(time, values, hold)), time)
    fine = np.arange(59 * 400 + 1) * 0.02 / 400
    held = values[np.minimum((fine / 0.02 + 1e-9).astype(int), 59)]
    u = held if hold == "zoh" else np.interp(fine, time, values)
    system = (a, b[:, None], c[None, :], np.zeros((1, 1)))
    _, y, _ = lsim(system, u, fine, interp=hold != "zoh")
    np.testing.assert_allclose(got, y[::400], atol=2e-6 if hold == "zoh" else 1e-9)


@given(
    dead_time=st.floats(0.0, 0.3),
    jitter=st.lists(st.floats(0.004, 0.05), min_size=20, max_size=40),
    hold=st.sampled_from(["zoh", "foh"]),
)
@settings(max_examples=40, deadline=None)
def test_dead_time_of_any_fraction_and_uneven_sampling(
    dead_time: float, jitter: list[float], hold: str
) -> None:
    """A delayed answer is the undelayed one read earlier, wherever the samples lie."""
    time = np.cumsum(jitter)
    values = np.sin(np.arange(time.size) ** 1.3)
    u = piecewise(signal(time, values, hold))
    a, b, c = oscillator(12.0, 0.6)
    delayed = forced_response(a, b, c, u, time, dead_time=dead_time)
    direct = forced_response(a, b, c, u, time - dead_time)
    np.testing.assert_allclose(delayed, direct, atol=1e-10)


def test_derivatives_by_complex_steps_are_exact() -> None:
    time = np.arange(200) * 0.01
    u = piecewise(signal(time, np.sin(3 * time) * 5.0, "smooth"))

    def y(m: complex, edge: complex, dead_time: complex) -> np.ndarray:
        a = np.array([[0.0, 1.0], [0.0, -20.0 / m]])
        moved = apply_dead_zone(u, -1.0, edge)
        b, c = np.array([0.0, 1.0 / m]), np.array([1.0, 0.0])
        return forced_response(a, b, c, moved, time, dead_time=dead_time)

    at = (2.0, 0.7, 0.0123)
    for k in range(3):
        up, down, turned = list(at), list(at), list(at)
        up[k] += 1e-6
        down[k] -= 1e-6
        turned[k] += 1e-30j
        exact = np.imag(y(*turned)) / 1e-30
        differences = (y(*up) - y(*down)) / 2e-6
        assert np.abs(exact).max() > 0.0
        np.testing.assert_allclose(exact, differences, atol=1e-6 * np.abs(exact).max() + 1e-9)


def test_dead_zone_kinks_lie_between_the_samples() -> None:
    """The answer to a ramp through an edge is known in closed form."""
    time = np.array([0.0, 1.0, 2.0])
    ramp = piecewise(signal(time, np.array([0.0, 1.0, 2.0]), "foh"))
    a, b, c = np.array([[0.0]]), np.array([1.0]), np.array([1.0])
    y = forced_response(a, b, c, apply_dead_zone(ramp, -1.0, 0.4), time)
    np.testing.assert_allclose(y, [0.0, 0.5 * 0.6**2, 0.5 * 1.6**2], atol=1e-14)
    mirrored = piecewise(signal(time, -np.array([0.0, 1.0, 2.0]), "foh"))
    z = forced_response(a, b, c, apply_dead_zone(mirrored, -0.4, 1.0), time)
    np.testing.assert_allclose(z, -y, atol=1e-14)


def test_free_response_of_a_fast_system_ends() -> None:
    a, _, c = oscillator(50.0, 0.7)
    grid = make_grid(np.arange(100_000) * 0.01)
    y = free_response(a, c, grid, range(2))
    assert y.shape == (2, 100_000)
    np.testing.assert_allclose(y[0, :3], [c @ expm(a * 0.01 * k) @ [1, 0] for k in range(3)])
    assert np.abs(y[:, 20_000:]).max() < 1e-12
    assert not y[:, BLOCK_ROWS + 1 :].any()


def test_rounded_time_stamps_are_one_grid() -> None:
    grid = make_grid(np.round(np.arange(1000) * 0.001, 12))
    assert grid.distinct.size == 1


@pytest.mark.parametrize(
    ("values", "smooth"),
    [
        (np.sin(np.arange(400) * 0.12), True),
        (np.sin(np.arange(400) * 0.3) + 0.01 * RNG.normal(size=400), True),
        (np.interp(np.arange(400), np.arange(0, 401, 20), RNG.normal(size=21)), False),
        (
            np.interp(np.arange(400), np.arange(0, 401, 20), 9.0 * RNG.normal(size=21))
            + 0.1 * RNG.normal(size=400),
            False,
        ),
        (np.sin(np.arange(400) * 0.12) + 0.1 * RNG.normal(size=400), True),
        (np.sin(np.arange(400) * 0.02) + 0.1 * RNG.normal(size=400), True),
        (RNG.normal(size=400), False),
    ],
)
def test_only_smooth_signals_are_taken_for_smooth(values: np.ndarray, smooth: bool) -> None:
    s = signal(np.arange(400) * 0.01, values, "auto")
    assert is_smooth([s]) is smooth
    assert choose_hold([s]) == ("smooth" if smooth else "foh")


def test_levels_are_held() -> None:
    """Two or many, noise or not; what moves, or climbs the steps of a converter, is not."""
    square = (np.sin(np.arange(400) * 0.05) > 0.0).astype(float)
    wander = np.sin(np.arange(400) * 0.05)
    noise = np.random.default_rng(3).normal(size=400)
    many = np.repeat(np.random.default_rng(4).normal(size=20), 20)
    idle = np.where(np.arange(400) < 250, 0.0, np.sin((np.arange(400) - 250) * 0.05))
    alike = np.repeat(
        np.cumsum(
            np.sign(noise[:40]) * (1.0 + 2.0 * (noise[40:80] > 0.0) + 0.5 * np.abs(noise[80:120]))
        ),
        10,
    )
    held = [square, square + (np.arange(400) > 390), square + 0.005 * noise, many,
            many + 0.01 * noise, np.repeat(np.arange(10.0), 40), alike]  # fmt: skip
    moved = [wander, wander + 0.01 * noise, np.round(wander * 20) / 20, idle, noise,
             np.round(np.round(wander * 20) / 20 * 0.977, 3),
             np.interp(np.arange(400), np.arange(0, 401, 20), noise[:21])]  # fmt: skip
    for values in held:
        halves = [signal(np.arange(200) * 0.01, v, "auto") for v in (values[:200], values[200:])]
        assert choose_hold(halves) == "zoh"
    for values in moved:
        assert choose_hold([signal(np.arange(400) * 0.01, values, "auto")]) != "zoh"


def test_a_smooth_curve_does_not_leave_its_range_in_a_gap() -> None:
    time = np.arange(400) * 0.01
    kept = (time < 1.4) | (time > 2.3)
    u = piecewise(signal(time[kept], np.sin(2.0 * time[kept]), "smooth"))
    k = int(np.flatnonzero(np.diff(u.nodes) > 0.5)[0])
    np.testing.assert_array_equal(u.coefficients[k, 2:], 0.0)
    end = np.polyval(u.coefficients[k, ::-1], u.nodes[k + 1] - u.nodes[k])
    assert end == pytest.approx(u.coefficients[k + 1, 0])


def test_a_cubic_reproduces_a_smooth_force_between_samples() -> None:
    """Straight lines clip the peaks of a smooth signal; that is what biases an inertia."""
    time = np.arange(300) * 0.01
    fine = np.arange(299 * 50 + 1) * 0.01 / 50
    a, b, c = np.array([[0.0, 1.0], [0.0, -30.0]]), np.array([0.0, 1.0]), np.array([1.0, 0.0])
    truth = lsim((a, b[:, None], c[None, :], np.zeros((1, 1))), np.sin(25 * fine), fine)[1][::50]
    errors = {}
    for hold in ("foh", "smooth"):
        u = piecewise(signal(time, np.sin(25 * time), hold))
        errors[hold] = np.abs(forced_response(a, b, c, u, time) - truth).max()
    assert errors["smooth"] < 0.1 * errors["foh"]


def test_input_before_its_first_node_is_zero() -> None:
    u = PiecewiseInput(np.array([1.0]), np.array([[2.0]]))
    a, b, c = np.array([[-1.0]]), np.array([1.0]), np.array([1.0])
    y = forced_response(a, b, c, u, np.array([0.0, 1.0, 2.0]))
    np.testing.assert_allclose(y, [0.0, 0.0, 2.0 * (1.0 - np.exp(-1.0))], atol=1e-14)


def test_an_edge_of_zero_may_be_moved_across() -> None:
    """As differences do that ask what hangs on it."""
    u = np.array([-2.0, -0.5, 0.7, 3.0])
    moved = [beyond_dead_zone(u, by, 0.0) for by in (-1e-6, 1e-6)]
    slope = (moved[1] - moved[0]) / 2e-6
    np.testing.assert_allclose(slope, [-1.0, -1.0, 0.0, 0.0], atol=1e-9)
    exact = np.imag(beyond_dead_zone(u, 1e-30j, 0.0)) / 1e-30
    np.testing.assert_allclose(exact, [-1.0, -1.0, 0.0, 0.0])
