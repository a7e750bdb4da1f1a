"""Plants against brute force, closed forms and each other."""

from __future__ import annotations

from collections.abc import Callable
from math import exp, pi
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

import fluidact_fit as ff
from fluidact_fit.block import Port
from fluidact_fit.control.closed_loop import ClosedLoop
from fluidact_fit.control.controllers import Gains, PDController, Travel
from fluidact_fit.control.loop import LoopResponse
from fluidact_fit.control.metrics import tracking_metrics
from fluidact_fit.control.plants.drive import (
    Drive,
    DrivePlant,
    behind_screw,
    rigid_line,
)
from fluidact_fit.control.plants.force import ForcePlant
from fluidact_fit.control.plants.hydraulic import HydraulicPlant
from fluidact_fit.control.plants.linear import Chain, make_chain
from fluidact_fit.control.plants.pneumatic import Chamber, Cylinder, PneumaticPlant
from fluidact_fit.families.transfer.block import TransferFunction
from fluidact_fit.mechanics.friction_law import FrictionLaw
from fluidact_fit.mechanics.hybrid import first_negative
from fluidact_fit.mechanics.hydraulic_cylinder import GRAY_NAMES, HydraulicMachine
from fluidact_fit.mechanics.tissue import Tissue

FORCE, PLACE = Port("force", "N"), Port("position", "m")
LAW = FrictionLaw(2.0, 1.5, 8.0, 6.0, 3.0, 2.5)


def drive_plant(
    law: FrictionLaw = LAW, step: float = 0.01, tissue: Tissue | None = None, **more: float
) -> DrivePlant:
    return DrivePlant(Drive(0.8, law, **more), FORCE, PLACE, step, tissue)


def euler(
    force: np.ndarray, law: FrictionLaw, mass: float, hold: float, step: float,
    stiffness: float = 0.0,
) -> np.ndarray:  # fmt: skip
    """Positions at the samples by steps of ``step``, sticking where the velocity changes sign."""
    x, v, out = 0.0, 0.0, []
    for f in force.tolist():
        out.append(x)
        for _ in range(round(hold / step)):
            net = f - stiffness * x
            if v == 0.0:
                if -law.breakaway_negative <= net <= law.breakaway_positive:
                    continue
                s = 1.0 if net > 0.0 else -1.0
            else:
                s = 1.0 if v > 0.0 else -1.0
            level = law.coulomb_positive if s > 0.0 else -law.coulomb_negative
            rate = law.viscous_positive if s > 0.0 else law.viscous_negative
            new = v + step * (net - level - rate * v) / mass
            x += step * 0.5 * (v + new)
            v = 0.0 if new * s < 0.0 else new
    return np.array(out)


def follow(plant: DrivePlant, force: np.ndarray) -> np.ndarray:
    plant.reset()
    out = []
    for f in force.tolist():
        out.append(plant.measure()["position"])
        plant.advance([f])
    return np.array(out)


@pytest.mark.parametrize("stiffness", [0.0, 900.0])
def test_stick_slip_equals_fine_euler_steps(stiffness: float) -> None:
    force = 12.0 * np.sin(np.arange(40) * 0.4) * np.random.default_rng(1).uniform(0.2, 1.0, 40)
    plant = drive_plant(stiffness=stiffness)
    exact = follow(plant, force)
    assert plant.body.events > 3
    errors = [
        np.abs(euler(force, LAW, 0.8, 0.01, step, stiffness) - exact).max() for step in (1e-5, 1e-6)
    ]
    assert np.abs(exact).max() > 1e-3
    assert errors[1] < 1e-4 * np.abs(exact).max()
    assert errors[1] < 0.2 * errors[0]  # what is left is the error of the Euler steps


def test_free_drive_equals_the_block_of_the_family(write: Callable[..., Path]) -> None:
    """Two ways to the same motion: power series with guards, and the block's closed form."""
    block = ff.load(write("ball-screw"))
    law = FrictionLaw.of(block.numbers())
    drive = Drive(block.parameters["inertia"], law)
    plant = DrivePlant(drive, block.input, block.output, 0.01)
    torque = 6e-3 * np.random.default_rng(3).uniform(-1.0, 1.0, 400)
    block.reset()
    plant.reset()
    ours, theirs = [], []
    for value in torque.tolist():
        ours.append(plant.measure()["angle"])
        theirs.append(block.step(value))
        plant.advance([value])
    np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-9 * np.abs(theirs).max())


@pytest.mark.filterwarnings("ignore::fluidact_fit.errors.ExtrapolationWarning")
@pytest.mark.parametrize("stiffness", [None, 800.0])
def test_a_line_equals_the_block_of_the_family(
    stiffness: float | None, write: Callable[..., Path]
) -> None:
    """Its dead zone is no dry friction: within it, the line coasts."""
    block = ff.load(write("hydrostatic"))
    values = {**block.numbers(), **({"stiffness": stiffness} if stiffness else {})}
    plant = DrivePlant(rigid_line(values), block.input, block.output, 0.01)
    force = 8.0 * np.random.default_rng(3).uniform(-1.0, 1.0, 400)
    if stiffness is None:
        wanted = np.array([block.step(value) for value in force.tolist()])
    else:
        through = np.array([block.actuate(value) for value in force.tolist()])
        m = values["mass"]
        a = np.array([[0.0, 1.0], [-stiffness / m, -values["damping"] / m]])
        system = a, np.array([[0.0], [1.0 / m]]), np.eye(2)[:1], np.zeros((1, 1))
        wanted = dlsim(cont2discrete(system, 0.01), through)[1][:, 0]
    np.testing.assert_allclose(follow(plant, force), wanted, atol=1e-9 * np.ptp(wanted))


def test_a_force_beyond_the_logs_is_taken_at_the_end_of_its_range() -> None:
    inside, beyond = (
        DrivePlant(Drive(0.8, LAW), FORCE, PLACE, 0.01, limits=(-4.0, 5.0)) for _ in range(2)
    )
    for force in (5.0, -4.0):
        inside.advance([force])
        beyond.advance([1e3 * force])
    assert beyond.measure() == inside.measure()


def test_series_is_the_exact_solution_of_a_held_force() -> None:
    law = FrictionLaw(0.0, 0.0, 8.0, 8.0)
    plant = drive_plant(law)
    plant.advance([4.0])
    tau, t = 0.8 / 8.0, 0.01
    expected = 4.0 / 8.0 * (t - tau * (1.0 - exp(-t / tau)))
    assert plant.measure()["position"] == pytest.approx(expected, rel=1e-12)


def test_rest_is_kept_up_to_the_static_level_and_no_further() -> None:
    plant = drive_plant()
    for force in (3.0, -2.5):
        plant.reset()
        plant.advance([force])
        assert plant.measure()["position"] == 0.0
        plant.advance([force * (1.0 + 1e-9)])
        assert plant.measure()["position"] * force > 0.0


@pytest.mark.parametrize(
    ("coefficients", "root"),
    [
        ([1.0, -2.0], 0.5),
        ([0.26, -1.0, 1.0], None),  # least value 0.01
        ([0.24, -1.0, 1.0], 0.4),
        ([0.0, 1.0, -2.0], 0.5),  # begins at zero and rises
        ([1.0, 1.0, 1.0], None),
        ([-1.0, 5.0], 0.0),
    ],
)
def test_first_root_of_a_polynomial(coefficients: list[float], root: float | None) -> None:
    found = first_negative(np.array(coefficients))
    assert found == (None if root is None else pytest.approx(root, abs=1e-12))


def test_two_roots_close_together_are_not_missed() -> None:
    middle, half = 0.3217, 1e-6
    p = np.array([middle**2 - half**2, -2.0 * middle, 1.0])
    assert first_negative(p) == pytest.approx(middle - half, abs=1e-9)


def test_screw_and_line_are_the_mass_of_equation_11() -> None:
    values = {
        "inertia": 11.71e-7, "viscous": 0.0, "coulomb_positive": 2e-3, "coulomb_negative": 1.6e-3,
        "breakaway_positive": 2.9e-3, "breakaway_negative": 1.9e-3,
    }  # fmt: skip
    line = rigid_line({"mass": 53.7, "damping": 1720.5, "dead_zone_positive": 1.0})
    r, h = 2.0 * pi * 4.4 / 1e-3, 0.056e-3
    drive = behind_screw(values, line, h, r)
    # torque that accelerates at 1 m/s2 from rest: J r + h m, and friction
    assert drive.mass / drive.leverage == pytest.approx(11.71e-7 * r + h * 53.7)
    assert drive.viscous / drive.leverage == pytest.approx(h * 1720.5)
    assert drive.static == pytest.approx((2.9e-3 + h, 1.9e-3))
    assert drive.friction.coulomb_negative / drive.leverage == pytest.approx(1.6e-3)


@pytest.mark.parametrize("stiffness", [0.0, 3000.0])
def test_screw_and_line_are_one_body_with_the_dead_zone_between(stiffness: float) -> None:
    """Both equations of motion, ``J' a + b v + C + h F = T`` and ``m a + R = D(F)``, by Euler."""
    values = {
        "inertia": 11.71e-7, "viscous": 2e-6, "coulomb_positive": 2e-3, "coulomb_negative": 1.6e-3,
        "breakaway_positive": 2.9e-3, "breakaway_negative": 1.9e-3,
    }  # fmt: skip
    low, high, mass, damping = -30.0, 12.0, 53.7, 1720.5
    line = rigid_line(
        {"mass": mass, "damping": damping, "dead_zone_negative": low, "dead_zone_positive": high,
         "stiffness": stiffness}
    )  # fmt: skip
    r, h = 2.0 * pi * 4.4 / 1e-3, 0.056e-3
    plant = DrivePlant(behind_screw(values, line, h, r), Port("torque", "N m"), PLACE, 0.01)
    torque = 0.02 * np.sin(np.arange(80) * 0.2) * np.random.default_rng(0).uniform(0.2, 1.0, 80)
    exact = follow(plant, torque)
    inertia, viscous = values["inertia"] * r, values["viscous"] * r

    def acceleration(t: float, x: float, v: float, way: float) -> float:
        level = values["coulomb_positive"] if way > 0.0 else -values["coulomb_negative"]
        load = stiffness * x + damping * v
        within = -load / mass
        force = (t - viscous * v - level - inertia * within) / h
        if low <= force <= high:
            return within
        edge = high if force > high else low
        return (t - viscous * v - level - h * (load + edge)) / (inertia + h * mass)

    def leaves(t: float, x: float) -> float:
        load = stiffness * x
        back, forth = (high, high) if load > 0 else (low, low) if load < 0 else (low, high)
        if t > h * (load + forth) + values["breakaway_positive"]:
            return 1.0
        return -1.0 if t < h * (load + back) - values["breakaway_negative"] else 0.0

    x = v = 0.0
    brute = []
    for t in torque.tolist():
        brute.append(x)
        for _ in range(1000):
            way = float(np.sign(v)) or leaves(t, x)
            if way:
                new = v + 1e-5 * acceleration(t, x, v, way)
                x, v = x + 0.5e-5 * (v + new), 0.0 if new * way < 0.0 else new
    assert plant.body.events > 5
    np.testing.assert_allclose(exact, brute, atol=4e-4 * np.ptp(exact))


def test_puncture_lets_go_at_the_puncture_force_and_energy_is_kept() -> None:
    """Without friction, kinetic energy is lost to two springs: the torn one and the weak one."""
    tissue = Tissue(0.01, 1000.0, 5.0, residual_stiffness=50.0)
    plant = DrivePlant(Drive(0.5, FrictionLaw(0.0, 0.0)), FORCE, PLACE, 1e-3, tissue)
    plant.body.reset(np.array([0.0, 0.4, 0.0, 1.0]))
    largest = 0.0
    for _ in range(80):
        plant.advance([0.0])
        largest = max(largest, plant.measure()["resistance"])
    depth = 5.0 / 1000.0
    assert plant.body.contact == "within"
    assert 4.5 < largest <= 5.0
    x, v = plant.body.state[:2]
    work = 0.5 * 1000.0 * depth**2 + 0.5 * 50.0 * ((x - 0.01) ** 2 - depth**2)
    assert 0.25 * v * v == pytest.approx(0.25 * 0.4**2 - work, rel=1e-9)


def test_tissue_that_is_not_punctured_throws_the_needle_back_and_lets_it_go() -> None:
    tissue = Tissue(0.01, 1000.0, 50.0, damping=3.0)
    plant = DrivePlant(Drive(0.5, FrictionLaw(0.0, 0.0)), FORCE, PLACE, 1e-3, tissue)
    plant.body.reset(np.array([0.0, 0.4, 0.0, 1.0]))
    pulls = []
    for _ in range(200):
        plant.advance([0.0])
        pulls.append(plant.measure()["resistance"])
    assert min(pulls) == 0.0
    assert plant.body.contact == "off"
    assert -0.4 < plant.body.state[1] < -0.2


def chain(dead_time: float = 0.0147) -> Chain:
    valve = TransferFunction((900.0,), (1.0, 42.0, 900.0), 0.0)
    line = TransferFunction((0.95,), (0.04, 1.0), dead_time)
    return make_chain([valve, line])


def test_chain_has_the_product_of_the_responses() -> None:
    s = 7.0j
    found = chain()
    n = found.b.size
    value = found.c @ np.linalg.solve(s * np.eye(n) - found.a, found.b)
    assert value == pytest.approx(900.0 / (s * s + 42.0 * s + 900.0) * 0.95 / (0.04 * s + 1.0))
    assert found.gain == pytest.approx(0.95)


def pneumatic(volume: float | None = None, total: float = 8e5) -> PneumaticPlant:
    chambers = (Chamber(chain(), 4e-4, volume=volume), Chamber(chain(), 3.5e-4, volume=volume))
    cylinder = Cylinder(
        0.14, FrictionLaw(2.4, 2.4, 45.0, 45.0), chambers, 101325.0, total
    )  # fmt: skip
    return PneumaticPlant(cylinder, Port("command", "Pa"), 0.01)


def test_pneumatic_cylinder_rests_until_the_delayed_pressure_comes() -> None:
    plant = pneumatic()
    plant.reset(0.02)
    one, two = plant.cylinder.rest()
    assert one + two == pytest.approx(8e5)
    assert one * 4e-4 - two * 3.5e-4 == pytest.approx(101325.0 * 0.5e-4)
    command = [(one + 5e4) / 0.95, (two - 5e4) / 0.95]
    plant.advance(command)
    assert plant.measure()["pressure_1"] == pytest.approx(one, rel=1e-9)
    for _ in range(3):
        plant.advance(command)
    assert plant.measure()["pressure_1"] > one * 1.001
    for _ in range(300):
        plant.advance(command)
    speed = (5e4 * 7.5e-4 - 2.4) / 45.0
    assert plant.measure()["speed"] == pytest.approx(speed, rel=1e-6)


def test_gas_of_a_given_volume_is_a_spring() -> None:
    """Pushed by tissue that was there before, against closed valves, it gives way by F / k."""
    plant = pneumatic(volume=3e-5, total=6e5)
    plant.reset(0.0)
    a = plant._actuator()
    n = plant._inputs.start
    pressed = -a[:n, 1]
    stiffness = plant._drive()[:n] @ pressed
    one, two = plant.cylinder.rest()
    assert stiffness == pytest.approx(one * (4e-4) ** 2 / 3e-5 + two * (3.5e-4) ** 2 / 3e-5)


def test_response_in_z_is_what_the_plant_does() -> None:
    """The sampled response of a stable chain, from its pulse response by stepping."""
    plant = pneumatic()
    law = FrictionLaw(0.0, 0.0, 45.0, 45.0)
    plant = PneumaticPlant(
        Cylinder(0.14, law, plant.cylinder.chambers, 0.0, 8e5), Port("command", "Pa"), 0.01
    )
    plant.reset()
    rest = plant.body.state[plant._inputs].copy()
    places = []
    for k in range(600):
        places.append(plant.measure()["position"])
        plant.advance(rest + np.array([1000.0 * (k == 0), 0.0]))
    z = np.exp(0.05 + 0.3j)
    found = sum(p * z**-k for k, p in enumerate(places)) / 1000.0
    tail = places[-1] * z**-600.0 / (1.0 - 1.0 / z) / 1000.0
    assert plant.linear()[0][0].response(complex(z)) == pytest.approx(found + tail, rel=1e-6)


def test_force_goes_along_the_branches_and_rests_between_them() -> None:
    def branches(u: float) -> tuple[float, float]:
        return 20.0 * u - 5.0 - 3.0, 20.0 * u - 5.0 + 2.0

    plant = ForcePlant(branches, make_chain([]), Port("command", "V"), 0.01)
    seen = []
    for u in (2.0, 1.9, 1.8, 1.5, 1.7, 1.8):
        plant.advance([u])
        seen.append(plant.measure()["force"])
    assert seen == pytest.approx([32.0, 32.0, 32.0, 27.0, 27.0, 28.0])


def test_the_drive_of_a_force_has_its_unit() -> None:
    plant = ForcePlant(lambda u: (u, u), make_chain([]), Port("command", "V"), 0.01,
                       drive_unit="Pa")  # fmt: skip
    one = np.zeros(2)
    measured = {"force": one, "position": one, "drive": one}
    response = LoopResponse(np.arange(2) * 0.01, one, one, one[:, None], measured)
    controller = PDController(Gains(1.0, 0.0), Travel("force"), 0.01)
    loop = ClosedLoop(
        plant, controller, response, (), 0, None, tracking_metrics(one, one), None
    )  # fmt: skip
    assert loop.to_csv().splitlines()[0] == (
        "time [s],reference [N],command [V],force [N],position [m],drive [Pa]"
    )


def test_overshoot_of_the_pressure_stays_in_the_force() -> None:
    """The turning point lies inside a sample; the peak of a second-order step is known."""
    zeta, w = 0.3, 60.0
    supply = make_chain([TransferFunction((w * w,), (1.0, 2.0 * zeta * w, w * w), 0.0)])

    def branches(u: float) -> tuple[float, float]:
        return 10.0 * u - 50.0, 10.0 * u + 50.0

    plant = ForcePlant(branches, supply, Port("command", "V"), 0.01)
    for _ in range(200):
        plant.advance([10.0])
    peak = 10.0 * (1.0 + exp(-pi * zeta / np.sqrt(1.0 - zeta**2)))
    assert plant.force == pytest.approx(10.0 * peak - 50.0, rel=1e-9)


def test_friction_that_rises_at_low_speed_sets_the_steady_speed() -> None:
    """``u = b v + F_c + F_s exp(-(v / v_s)^2)``, and above the static level of both it moves."""
    law = FrictionLaw(1.0, 0.5, 2.0, 2.0, stribeck=0.5, stribeck_speed=1.0)
    plant = DrivePlant(Drive(1.0, law), FORCE, PLACE, 0.01)
    plant.reset()
    for force, kinetic in ((3.0, 1.0), (-2.0, -0.5)):
        for _ in range(1500):
            plant.advance([force])
        v = plant.measure()["speed"]
        assert v * force > 0.0
        rise = np.sign(v) * 0.5 * np.exp(-(v**2))
        assert force == pytest.approx(2.0 * v + kinetic + rise, rel=1e-6)
    for _ in range(1500):
        plant.advance([0.9])
    assert plant.measure()["speed"] == 0.0
    plant.advance([1.49])
    assert plant.measure()["speed"] == 0.0
    plant.advance([1.51])
    assert plant.measure()["speed"] > 0.0


CYLINDER = HydraulicMachine(4.9e-4, 2.4e-4, 1.2e-4, 1.0e-4, 14.5, 5e6, 0.0)


def hydraulic(coulomb: float = 0.0, viscous: float = 0.0) -> HydraulicPlant:
    """A cylinder without losses in its lines."""
    values = {
        **dict.fromkeys(GRAY_NAMES, 0.0), "valve_gain_1": 6e-9, "valve_gain_2": 3e-9,
        "bulk_modulus": 1e9, "coulomb": coulomb, "viscous": viscous,
    }  # fmt: skip
    return HydraulicPlant(CYLINDER, values, Port("command", "V"), 0.005)


def test_hydraulic_cylinder_moves_as_the_oil_makes_it() -> None:
    """Steady motion in closed form: pressures that the orifices leave, and viscous friction."""
    plant = hydraulic(viscous=600.0)
    plant.reset(0.01)
    for _ in range(400):
        plant.advance([1.0])
    seen = plant.measure()
    (area_1, area_2), v = (CYLINDER.area(i) for i in (1, 2)), seen["speed"]
    in_drop, out_drop = (area_1 * v / 6e-9) ** 2, (area_2 * v / 3e-9) ** 2
    assert seen["pressure_1"] == pytest.approx(5e6 - in_drop, rel=1e-4)
    assert seen["pressure_2"] == pytest.approx(out_drop, rel=1e-4)
    assert (5e6 - in_drop) * area_1 - out_drop * area_2 == pytest.approx(600.0 * v, rel=1e-3)
    assert v > 0.01


def test_hydraulic_stick_slip_equals_smaller_steps() -> None:
    """With steps of a tenth, the same motion: events are solved for in both."""
    places = []
    for factor in (1, 10):
        plant = hydraulic(coulomb=300.0, viscous=600.0)
        plant.steps *= factor
        plant.reset(0.01)
        seen = []
        for k in range(60):
            plant.advance([0.4 * np.sin(0.3 * k)])
            seen.append(plant.measure()["position"])
        places.append(np.array(seen))
    assert np.ptp(places[1]) > 1e-4
    np.testing.assert_allclose(places[0], places[1], atol=1e-5 * np.ptp(places[1]))


def test_hydraulic_piston_rests_within_its_friction() -> None:
    plant = hydraulic(coulomb=300.0)
    plant.reset(0.01)
    plant.advance([0.001])
    assert plant.measure()["position"] == 0.01
    assert plant.measure()["pressure_1"] > CYLINDER.at_rest(0.01)[0]
