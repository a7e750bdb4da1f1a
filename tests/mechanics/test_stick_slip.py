"""Event-solved stick-slip against brute force, closed forms and symmetries."""

import numpy as np
import pytest

from fluidact_fit.estimation.grid import make_grid
from fluidact_fit.estimation.inputs import piecewise
from fluidact_fit.experiment import Signal
from fluidact_fit.mechanics.stick_slip import Passes, StickSlip, simulate_stick_slip

# inertia, viscous, kinetic +/-, static +/-: an axis of the size of the thesis' drive, scaled to one
AXIS = (1.2, 0.9, 1.0, 0.8, 1.4, 1.1)
NAMES = (
    "viscous", "coulomb_positive", "coulomb_negative", "breakaway_positive", "breakaway_negative",
)  # fmt: skip


def parameters(values: tuple[float, ...] | np.ndarray = AXIS) -> StickSlip:
    inertia, *friction = np.array(values).reshape(len(AXIS), -1)
    return StickSlip.of(inertia, dict(zip(NAMES, friction)))


def torque(time: np.ndarray, values: np.ndarray, hold: str):
    return piecewise(Signal("torque", time, values, "N m", hold)), make_grid(time)


def brute_force(values: tuple[float, ...], time: np.ndarray, u, steps: int) -> np.ndarray:
    """Semi-implicit Euler on a grid a thousand times finer."""
    j, b, kp, kn, sp, sn = values
    out, p, v, stuck = [0.0], 0.0, 0.0, True
    for k in range(time.size - 1):
        h = (time[k + 1] - time[k]) / steps
        for i in range(steps):
            tau = u(time[k] + (i + 0.5) * h)
            if stuck:
                if -sn <= tau <= sp:
                    continue
                stuck, sign = False, 1.0 if tau > 0 else -1.0
            new = v + h / j * (tau - b * v - (kp if sign > 0 else -kn))
            if new * sign <= 0.0:
                v, stuck = 0.0, True
            else:
                p, v = p + 0.5 * h * (v + new), new
        out.append(p)
    return np.array(out)


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_against_brute_force(hold: str) -> None:
    time = np.arange(120) * 0.05
    values = 3.0 * np.sin(1.9 * time + 0.2) * np.exp(-0.1 * time)
    u, grid = torque(time, values, hold)
    motion = simulate_stick_slip(parameters(), Passes(u, grid))
    assert min(motion.breakaways) >= 1
    assert motion.stops >= 3

    def drive(t: float) -> float:
        return float(values[int(t / 0.05 + 1e-9)] if hold == "zoh" else np.interp(t, time, values))

    coarse = brute_force(AXIS, time, drive, 500)
    fine = brute_force(AXIS, time, drive, 1000)
    # the brute force converges with its step; the exact solution lies where it goes to
    limit = 2.0 * fine - coarse
    assert np.abs(motion.position[0] - limit).max() < 0.6 * np.abs(fine - coarse).max() + 1e-4


def test_constant_torque_in_closed_form() -> None:
    time = np.linspace(0.0, 2.0, 41)
    u, grid = torque(time, np.full(41, 2.0), "zoh")
    motion = simulate_stick_slip(parameters(), Passes(u, grid))
    j, b, kp = AXIS[:3]
    final = (2.0 - kp) / b
    want = final * (time - j / b * (1.0 - np.exp(-b / j * time)))
    np.testing.assert_allclose(motion.position[0], want, atol=1e-12)
    np.testing.assert_allclose(motion.velocity, final * (1.0 - np.exp(-b / j * time)), atol=1e-12)


def test_below_the_static_level_nothing_moves() -> None:
    time = np.arange(50) * 0.1
    u, grid = torque(time, 1.09 * np.sin(time), "foh")
    motion = simulate_stick_slip(parameters(), Passes(u, grid))
    assert np.all(motion.position == 0.0)
    assert motion.breakaways == (0, 0)


def test_without_viscous_friction() -> None:
    """b = 0 is a limit, not a division by zero."""
    time = np.linspace(0.0, 1.0, 21)
    u, grid = torque(time, np.full(21, 2.0), "zoh")
    p = simulate_stick_slip(parameters((1.2, 0.0, *AXIS[2:])), Passes(u, grid)).position[0]
    np.testing.assert_allclose(p, 0.5 * (2.0 - AXIS[2]) / 1.2 * time**2, atol=1e-12)


def test_mirrored_torque_mirrors_the_motion() -> None:
    time = np.arange(200) * 0.05
    values = 3.0 * np.sin(2.2 * time) + 0.5
    j, b, kp, kn, sp, sn = AXIS
    u, grid = torque(time, values, "foh")
    down, _ = torque(time, -values, "foh")
    one = simulate_stick_slip(parameters(), Passes(u, grid)).position
    other = simulate_stick_slip(parameters((j, b, kn, kp, sn, sp)), Passes(down, grid)).position
    np.testing.assert_allclose(other, -one, atol=1e-10)


@pytest.mark.parametrize("hold", ["zoh", "foh", "smooth"])
def test_derivatives_pass_through_the_events(hold: str) -> None:
    time = np.arange(160) * 0.05
    u, grid = torque(time, 3.0 * np.sin(1.9 * time + 0.2), hold)
    base = np.array(AXIS)
    rows = np.tile(base.astype(complex), (6, 1))
    rows[np.arange(6), np.arange(6)] += 1e-30j
    exact = np.imag(simulate_stick_slip(parameters(rows.T), Passes(u, grid)).position) / 1e-30
    for k in range(6):
        sides = []
        for sign in (1.0, -1.0):
            moved = base.copy()
            moved[k] += sign * 1e-6
            sides.append(simulate_stick_slip(parameters(tuple(moved)), Passes(u, grid)).position[0])
        np.testing.assert_allclose(exact[k], (sides[0] - sides[1]) / 2e-6, atol=3e-5)
    static = np.abs(exact[4:]).max()
    # a held torque jumps past the static level: where exactly it lies does not show
    assert static == 0.0 if hold == "zoh" else static > 0.0


def test_initial_speed_coasts_to_rest() -> None:
    time = np.linspace(0.0, 5.0, 101)
    u, grid = torque(time, np.zeros(101), "zoh")
    motion = simulate_stick_slip(parameters(), Passes(u, grid), initial_speed=2.0)
    j, b, kp = AXIS[:3]
    stop = j / b * np.log(1.0 + b * 2.0 / kp)
    travel = j / b * 2.0 - kp / b * stop
    assert motion.position[0, -1] == pytest.approx(travel, rel=1e-10)


def test_a_break_away_at_the_peak_of_the_torque_is_differentiated_over_a_small_change() -> None:
    """Where the torque only just reaches the level its slope is zero, and that was divided by."""
    time = np.linspace(0.0, 2.0, 201)
    values = 5.0 * np.sin(np.pi * time)
    u = piecewise(Signal("torque", time, values, "N m", "smooth"))
    peak = float(np.polynomial.Polynomial(u.coefficients[50])(0.0))
    level = peak * (1.0 - 1e-15) + 1e-30j
    law = parameters(np.array((0.2, 0.5, 1.0, 1.0, level, 9.0)))
    passes, _ = Passes.on_samples(Signal("torque", time, values, "N m", "smooth"), time)
    slope = np.imag(simulate_stick_slip(law, passes).position) / 1e-30
    assert 0.0 < np.abs(slope).max() < 1e3
