"""Controllers, filters, margins and metrics against closed forms."""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, pi, sqrt
from typing import Any

import numpy as np
import pytest

from fluidact_fit.block import Port
from fluidact_fit.control.controllers import (
    FeedforwardForceController,
    Gains,
    ImpedanceController,
    PDController,
    Smoothing,
    Travel,
)
from fluidact_fit.control.controllers.impedance import Impedance, KnownFriction, Pressures
from fluidact_fit.control.controllers.pd import StaticFriction
from fluidact_fit.control.filters import butterworth
from fluidact_fit.control.loop import run_loop
from fluidact_fit.control.margins import loop_margins
from fluidact_fit.control.metrics import step_metrics, tracking_metrics
from fluidact_fit.control.plants.drive import Drive, DrivePlant
from fluidact_fit.control.references import Reference, SampledReference
from fluidact_fit.errors import UsageError
from fluidact_fit.mechanics.friction_law import FrictionLaw
from fluidact_fit.routines import Argument, Draft, Machine

MASS, DAMPING = 53.7, 1720.5


def line_plant(step: float, coulomb: float = 0.0, static: float = 0.0) -> DrivePlant:
    law = FrictionLaw(coulomb, coulomb, DAMPING, DAMPING, static, static)
    return DrivePlant(Drive(MASS, law), Port("force", "N"), Port("position", "m"), step)


def test_filter_is_that_of_scipy_and_loses_3_db_at_its_cutoff() -> None:
    from scipy.signal import butter

    ours, below = butterworth(10.0, 0.01)
    numerator, denominator = butter(2, 10.0, fs=100.0)
    np.testing.assert_allclose(ours, numerator, rtol=1e-12)
    np.testing.assert_allclose(below, denominator, rtol=1e-12)
    assert abs(low_pass(10.0, np.exp(2j * pi * 0.1))) == pytest.approx(1.0 / sqrt(2.0))


def low_pass(cutoff: float, z: complex) -> complex:
    b, a = butterworth(cutoff, 0.01)
    return complex(b @ z ** -np.arange(3.0) / (a @ z ** -np.arange(3.0)))


@pytest.mark.parametrize("cutoff", [0.0, 50.0, float("nan")])
def test_filter_refuses_a_frequency_it_cannot_cut(cutoff: float) -> None:
    with pytest.raises(UsageError, match="Hz"):
        butterworth(cutoff, 0.01)


def test_rate_of_a_ramp() -> None:
    loop = PDController(Gains(0.0, 1.0), Travel("position"), 0.01)
    seen = [loop.step({"position": 0.0}, 5.0 + 0.3 * k)[0] for k in range(200)]
    assert seen[0] == 0.0
    assert seen[-1] == pytest.approx(30.0, rel=1e-9)


def test_a_controller_steps_as_its_linear_system_says() -> None:
    """The routine that is exported, and the state space of which margins are made."""
    loop = PDController(Gains(40.0, 3.0), Travel("position"), 0.01, cutoff=5.0)
    loop.step({"position": 0.0}, 0.0)
    pulse = [loop.step({"position": 0.0}, float(k == 0))[0] for k in range(600)]
    z = np.exp(0.4j)
    found = sum(p * z**-k for k, p in enumerate(pulse))
    assert found == pytest.approx(complex(loop.linear().response(z)[0]), rel=1e-9)
    rate = low_pass(5.0, z) * (1.0 - 1.0 / z) / 0.01
    assert found == pytest.approx(40.0 + 3.0 * rate, rel=1e-9)


def test_gains_follow_the_equations_of_the_thesis() -> None:
    lever = 1.0 / 0.056e-3
    for gains in (
        Gains.for_ramp(MASS, DAMPING, lever, slope=0.005, error=1e-4, damping_ratio=1.2),
        Gains.for_bandwidth(MASS, DAMPING, lever, bandwidth=6.4, damping_ratio=1.2),
        Gains.with_damping(MASS, DAMPING, lever, proportional=4.0, damping_ratio=1.2),
    ):
        k_p, k_d = gains.proportional * lever, gains.derivative * lever
        assert (DAMPING + k_d) / (2.0 * sqrt(MASS * k_p)) == pytest.approx(1.2)
    ramp = Gains.for_ramp(MASS, DAMPING, lever, slope=0.005, error=1e-4, damping_ratio=1.2)
    assert 0.005 * DAMPING / (ramp.proportional * lever) == pytest.approx(1e-4)


def test_a_derivative_gain_is_not_negative() -> None:
    gains = Gains.for_bandwidth(MASS, DAMPING, 1.0, bandwidth=1.0, damping_ratio=0.1)
    assert gains.derivative == 0.0


def test_loop_without_friction_is_the_second_order_response() -> None:
    """Equation 12 with K_d = 0, sampled so fast that the hold is of no account."""
    step, k_p = 1e-4, 6e4
    loop = PDController(Gains(k_p, 0.0), Travel("position"), step)
    found = run_loop(line_plant(step), loop, Reference("step", size=1e-3), 0.4, 0.0)
    w, zeta = sqrt(k_p / MASS), DAMPING / (2.0 * sqrt(MASS * k_p))
    damped = w * sqrt(1.0 - zeta**2)
    t = found.time
    expected = 1.0 - np.exp(-zeta * w * t) * (
        np.cos(damped * t) + zeta * w / damped * np.sin(damped * t)
    )
    np.testing.assert_allclose(found.output, 1e-3 * expected, atol=1e-3 * 2e-3)
    metrics = step_metrics(t, found.output, 1e-3, final=1e-3)
    assert metrics.overshoot == pytest.approx(
        100.0 * exp(-pi * zeta / sqrt(1.0 - zeta**2)), rel=5e-3
    )


def test_derivative_on_the_error_damps_as_equation_16_says() -> None:
    """With a filter far above the loop, the response has the zero and the damping of (12)."""
    step, k_p, k_d = 1e-4, 6e4, 900.0
    loop = PDController(Gains(k_p, k_d), Travel("position"), step, cutoff=1500.0)
    found = run_loop(line_plant(step), loop, Reference("step", size=1e-3, at=step), 0.3, 0.0)
    from scipy.signal import lti
    from scipy.signal import step as response

    t = found.time[1:] - step
    _, y = response(lti([k_d, k_p], [MASS, DAMPING + k_d, k_p]), T=t)
    np.testing.assert_allclose(found.output[1:], 1e-3 * y, atol=1e-3 * 1e-2)


def test_ramp_leaves_the_error_of_equation_15() -> None:
    step, k_p = 0.01, 2e4
    loop = PDController(Gains(k_p, 0.0), Travel("position"), step)
    ramp = Reference("ramp-insertion", size=1.0, speed=0.005)
    found = run_loop(line_plant(step), loop, ramp, 4.0, 0.0)
    assert found.error[-1] == pytest.approx(0.005 * DAMPING / k_p, rel=1e-6)


def test_coulomb_friction_adds_its_level_to_the_ramp_error() -> None:
    step, k_p, level = 0.01, 2e4, 12.0
    loop = PDController(Gains(k_p, 0.0), Travel("position"), step)
    ramp = Reference("ramp-insertion", size=1.0, speed=0.005)
    found = run_loop(line_plant(step, level), loop, ramp, 6.0, 0.0)
    assert found.error[-1] == pytest.approx((0.005 * DAMPING + level) / k_p, rel=1e-6)


def test_static_friction_stops_short_and_compensation_goes_on() -> None:
    """A step of less than F_s / K_p does nothing unless friction is compensated."""
    step, k_p, level = 0.01, 2e4, 20.0
    size = 0.5 * level / k_p
    friction = StaticFriction(level * 1.001, level * 1.001, 1e-4)
    for compensation, moves in ((StaticFriction(), False), (friction, True)):
        loop = PDController(Gains(k_p, 0.0), Travel("position"), step, compensation)
        plant = line_plant(step, 0.6 * level, level)
        found = run_loop(plant, loop, Reference("step", size=size), 1.0, 0.0)
        assert bool(found.output[-1] > 0.2 * size) is moves


@pytest.mark.parametrize(
    ("error", "speed", "expected"),
    [(1.0, 0.0, 2.9), (-1.0, 0.0, -1.9), (0.0, 0.0, 0.0), (1.0, 0.1, 0.0), (-1.0, -0.2, 0.0)],
)
def test_compensation_is_equations_17_and_18(error: float, speed: float, expected: float) -> None:
    """At a speed that has lasted, with no gain but that of the compensation."""
    loop = PDController(Gains(0.0, 0.0), Travel("position"), 0.01, StaticFriction(2.9, 1.9, 0.1))
    for k in range(200):
        place = 1.01 * speed * 0.01 * k
        found = loop.step({"position": place}, place + error)
    assert found == (expected,)


def test_margins_of_a_loop_that_is_known() -> None:
    """Raised by its gain margin, the loop keeps oscillating; at half that it settles."""
    step, k_p = 0.01, 2e4
    margins = loop_margins(
        line_plant(step), PDController(Gains(k_p, 0.0), Travel("position"), step)
    )
    assert margins.gain > 1.0
    rates = {}
    for factor in (0.9, 1.0, 1.1):
        gains = Gains(k_p * margins.gain * factor, 0.0)
        loop = PDController(gains, Travel("position"), step)
        found = run_loop(line_plant(step), loop, Reference("step", size=1e-3), 6.0, 0.0)
        size = np.abs(found.error)
        rates[factor] = size[-100:].max() / size[200:300].max()
    assert rates[0.9] < 0.5
    assert rates[1.0] == pytest.approx(1.0, abs=0.02)
    assert rates[1.1] > 2.0
    # without a hold the phase margin of K / (s (M s + B)) is 90 - atan(w M / B), less w T / 2
    w = 2.0 * pi * margins.phase_frequency
    expected = 90.0 - np.degrees(np.arctan(w * MASS / DAMPING) + 0.5 * w * step)
    assert margins.phase == pytest.approx(expected, abs=0.2)


@pytest.mark.parametrize("dead_time", [0.0, 0.004, 0.01, 0.0537])
@pytest.mark.parametrize("bandwidth", [3.0, 40.0, 300.0])
def test_the_largest_pole_is_how_fast_a_loop_grows_or_fades(
    bandwidth: float, dead_time: float
) -> None:
    """Also where |L| > 1 at every frequency, so that there is no phase margin to say so."""
    step = 0.01
    plant = DrivePlant(
        Drive(MASS, FrictionLaw(0.0, 0.0), damping=DAMPING, dead_time=dead_time),
        Port("force", "N"), Port("position", "m"), step,
    )  # fmt: skip
    gains = Gains.for_bandwidth(MASS, DAMPING, 1.0, bandwidth=bandwidth, damping_ratio=0.9)
    loop = PDController(gains, Travel("position"), step)
    margins = loop_margins(plant, loop)
    plant.reset(1e-3)
    loop.reset()
    sizes = []
    for _ in range(400):
        measured = plant.measure()
        (command,) = loop.step(measured, 0.0)
        plant.advance([command])
        sizes.append(float(np.hypot(*plant.body.state[:2])))
        if not 1e-12 < sizes[-1] < 1e30:
            break
    logs = np.log(np.array(sizes[len(sizes) // 3 :]))
    growth = float(np.polyfit(np.arange(logs.size), logs, 1)[0])
    radius = margins.spectral_radius
    assert margins.stable == (radius < 1.0) == (growth < 0.0) == (not margins.warning)
    assert growth == pytest.approx(np.log(radius), rel=0.12, abs=0.02)
    if bandwidth == 300.0 and dead_time == 0.0:
        assert radius == pytest.approx(159.0, rel=0.02)
        assert margins.phase == np.inf


def test_gains_say_what_they_come_to() -> None:
    gains = Gains.for_bandwidth(MASS, DAMPING, 1.0, bandwidth=1.0, damping_ratio=0.8)
    assert gains.derivative == 0.0
    assert gains.natural_frequency == pytest.approx(1.0)
    assert gains.damping_ratio == pytest.approx(DAMPING / (2.0 * MASS * 2.0 * pi))
    with pytest.raises(UsageError, match="no viscous friction"):
        Gains.for_ramp(MASS, 0.0, 1.0, slope=0.005, error=1e-4, damping_ratio=0.8)


def test_pressures_have_the_set_sum_and_give_the_force() -> None:
    pressures = Pressures((4.0e-4, 3.4e-4), 8e5, 101325.0)
    loop = ImpedanceController(Impedance(1200.0, 0.0), pressures, 0.01)
    one, two = loop.step({"position": 0.0}, 0.01)
    assert one + two == pytest.approx(8e5)
    assert one * 4.0e-4 - two * 3.4e-4 - 101325.0 * 0.6e-4 == pytest.approx(12.0)


def test_impedance_is_a_spring_against_a_held_rod() -> None:
    controller = ImpedanceController(
        Impedance.with_damping_ratio(0.14, 4000.0, 1.0),
        Pressures((4.0e-4, 3.4e-4), 8e5, 0.0, (2.0, 4.0), (100.0, 0.0)),
        0.01,
        KnownFriction(45.0, 2.4, 2.4, 1e-3),
    )
    for _ in range(50):
        u_1, u_2 = controller.step({"position": 0.01}, 0.0125)
    p_1, p_2 = 2.0 * u_1 + 100.0, 4.0 * u_2
    assert p_1 * 4.0e-4 - p_2 * 3.4e-4 == pytest.approx(4000.0 * 0.0025)
    assert p_1 + p_2 == pytest.approx(8e5)


@pytest.mark.parametrize(("speed", "due"), [(0.1, 6.9), (-0.1, -6.5), (0.005, 0.225)])
def test_friction_that_is_known_has_the_sign_of_a_speed_beyond_the_tolerance(
    speed: float, due: float
) -> None:
    """The force of a rod that moves steadily, without stiffness to speak of."""
    pressures, friction = Pressures((4.0e-4, 3.4e-4), 8e5, 0.0), KnownFriction(45.0, 2.4, 2.0, 0.01)
    loop = ImpedanceController(Impedance(1e-9, 0.0), pressures, 0.01, friction)
    for k in range(300):
        one, two = loop.step({"position": speed * 0.01 * k}, 0.0)
    assert one * 4.0e-4 - two * 3.4e-4 == pytest.approx(due, rel=1e-6)


def force_controller(smoothing: Smoothing) -> FeedforwardForceController:
    """With ``u = (F + 2 s + 100 x) / 10``."""
    draft = Draft("command_for", "A map.", "V")
    force, place, state = (
        draft.argument(Argument(name, "1", "made up", -1e3, 1e3))
        for name in ("force", "position", "direction")
    )
    command = (force + 2.0 * state + 100.0 * place) * 0.1
    target = Argument("target", "V", "what command_for gives", -1e3, 1e3)
    return FeedforwardForceController(draft.returns(command), target, 0.01, smoothing)


def commands_for(smoothing: Smoothing, wanted: Sequence[float]) -> list[float]:
    """Commands without the hysteresis of the map; a force of 10 wants 1."""
    loop = force_controller(smoothing)
    return [loop.step({"position": -0.02}, force)[0] for force in wanted]


def test_held_smoothing_is_a_straight_line() -> None:
    found = commands_for(Smoothing(10), [50.0] * 12)
    assert found == pytest.approx([0.5 * min(i, 10) for i in range(1, 13)])
    # down again it begins from where it is; unloading wants 0.4 less
    assert commands_for(Smoothing(10), [50.0] * 12 + [4.0])[-1] == pytest.approx(4.5)


def test_recursive_smoothing_is_half_way_long_before_half_time() -> None:
    seen = np.array(commands_for(Smoothing(30, "recursive"), [10.0] * 30))
    rest = np.cumprod(1.0 - np.arange(1, 31) / 30.0)
    np.testing.assert_allclose(seen, 1.0 - rest, atol=1e-12)
    assert int(np.argmax(seen >= 0.98)) + 1 == 14
    assert seen[-1] == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("reading", ["held", "recursive"])
def test_one_step_of_smoothing_is_none(reading: Any) -> None:
    assert commands_for(Smoothing(1, reading), [30.0]) == pytest.approx([3.0])


def test_motion_state_is_held() -> None:
    machine = Machine(force_controller(Smoothing(1)).routines()[0])
    found = [float(machine(wanted=v)[0]) for v in (1.0, 1.0, 0.5, 0.5, 0.6)]
    assert found == [1.0, 1.0, -1.0, -1.0, 1.0]


def test_force_controller_asks_the_branch_of_its_motion_state() -> None:
    controller, at = force_controller(Smoothing(2)), {"position": 0.1}
    assert controller.step(at, 28.0) == pytest.approx((2.0,))  # half of 4.0
    assert controller.step(at, 28.0) == pytest.approx((4.0,))
    assert controller.step(at, 22.0) == pytest.approx((3.5,))  # half-way to 3.0
    assert controller.step(at, 22.0) == pytest.approx((3.0,))


def test_what_no_solver_resolves_is_none() -> None:
    t = np.linspace(0.0, 10.0, 1001)
    y = 3.0 * (1.0 - np.exp(-8.0 * t)) * (1.0 + 1e-14 * np.sin(40.0 * t))
    found = step_metrics(t, y, 3.0)
    assert (found.overshoot, found.overshoot_target, found.steady_state_error) == (0.0, 0.0, 0.0)
    real = step_metrics(t, y + 3e-7 * np.exp(-((t - 8.0) ** 2)), 3.0)
    assert real.overshoot_target == pytest.approx(1e-5, rel=1e-3)
    assert tracking_metrics(y + 1e-15, y).final_error == 0.0
    assert tracking_metrics(y + 1e-6, y).final_error == pytest.approx(1e-6)


def test_step_metrics_of_a_response_that_is_known() -> None:
    t = np.linspace(0.0, 10.0, 2001)
    y = 2.0 + 0.96 * (1.0 - np.exp(-(t - 1.0))) * (t > 1.0)
    found = step_metrics(t, y, 3.0, at=1.0, window=0.01)
    assert found.initial == 2.0
    assert found.rise_time == pytest.approx(np.log(9.0), rel=1e-3)
    assert found.steady_state_error == pytest.approx(0.04, abs=2e-4)
    assert found.settling_time is None  # 4 % off the target for ever
    assert found.settling_time_final == pytest.approx(np.log(50.0), rel=5e-3)
    assert found.overshoot == pytest.approx(0.0, abs=0.05)
    assert found.overshoot_target == 0.0


def test_overshoot_is_told_apart_and_a_step_down_is_no_different() -> None:
    t = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    y = np.array([0.0, 5.0, 12.0, 11.0, 11.0])
    for way in (1.0, -1.0):
        found = step_metrics(t, way * y, way * 10.0, band=0.15, final=way * 11.0)
        assert found.overshoot == pytest.approx(100.0 / 11.0)
        assert found.overshoot_target == pytest.approx(20.0)
        assert found.steady_state_error == pytest.approx(-way)
        assert found.peak_time == 2.0
        # 10 to 90 % of 11 along the lines: 1.1 at 0.22 s, 9.9 at 1.7 s
        assert found.rise_time == pytest.approx(1.7 - 0.22)
        assert found.settling_time == pytest.approx(2.5)


def test_a_step_that_is_none_is_refused() -> None:
    with pytest.raises(UsageError, match="no step"):
        step_metrics(np.array([0.0, 1.0]), np.zeros(2), 0.0)


def test_tracking_metrics() -> None:
    found = tracking_metrics(np.array([1.0, 2.0, 3.0]), np.array([1.0, 1.0, 5.0]))
    assert found.rms_error == pytest.approx(sqrt(5.0 / 3.0))
    assert (found.largest_error, found.final_error) == (2.0, -2.0)


def test_references_go_where_they_say() -> None:
    t = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 6.0])
    triangle = Reference("triangle", start=1.0, size=2.0, speed=1.0, at=1.0)
    assert triangle(t).tolist() == [1.0, 1.0, 2.0, 3.0, 2.0, 2.0]
    down = Reference("ramp-insertion", size=-2.0, speed=1.0, at=1.0)
    assert down(t).tolist() == [0.0, 0.0, -1.0, -2.0, -2.0, -2.0]
    assert Reference("step", size=3.0, at=2.0)(t).tolist() == [0.0, 0.0, 3.0, 3.0, 3.0, 3.0]
    sine = Reference("sine", start=1.0, size=2.0, frequency=0.25, at=1.0)
    np.testing.assert_allclose(sine(t), [1.0, 1.0, 3.0, 1.0, -1.0, 3.0], atol=1e-12)
    sampled = SampledReference(np.array([1.0, 3.0]), np.array([0.0, 4.0]))
    assert sampled(t).tolist() == [0.0, 0.0, 2.0, 4.0, 4.0, 4.0]


def test_a_loop_that_runs_away_is_ended() -> None:
    step = 0.01
    loop = PDController(Gains(1e12, 0.0), Travel("position"), step)
    with pytest.raises(UsageError, match="runs away"):
        run_loop(line_plant(step), loop, Reference("step", size=1.0), 100.0, 0.0)
