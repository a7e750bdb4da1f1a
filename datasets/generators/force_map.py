"""Single-acting pneumatic cylinder with hysteresis, position by position.

Imitates the experiments of "Data-Driven Feedforward Force Control of a Single-Acting Pneumatic
Cylinder with a Nonlinear Hysteresis Characteristic" (Actuators 14, 162, 2025): six positions to
train on, four staggered ones to test, 0 to 60 N in steps of 1 N, 10-bit position, 100 Hz. The
paper gives no parameters of the cylinder: those are invented.
"""

from __future__ import annotations

import math

import numpy as np

from .signals import FORCE_PAPER, STEP
from .writing import Array, Column, Dataset, Truth, scalar

POSITIONS = (
    (1.3, 11.6, 21.3),
    (6.5, 16.6, 26.9),
    (4.2, 13.6, 23.2, 26.5),
)  # mm: trials 1 and 2 train, trial 3 tests
HELD = 4  # samples per step of 1 N
CYCLES = 2
SLACK = 1.0  # N short after a cycle: the rod leaves the sensor, as the paper's figure 12B shows
INNER = 100  # steps of integration per sample: 0.1 ms
ADC = 60.0 / 1023.0  # mm: 10 bits over the potentiometer's 60 mm
COLUMNS = (
    Column("t [s]", "time of the sample", 2),
    Column("u [V]", "command of the pressure valve, held until the next sample", 3),
    Column("x [mm]", "position of the piston rod", 3),
    Column("F [N]", "force sensor at the rod", 2),
)
ROLES = {"time": "t [s]", "command": "u [V]", "position": "x [mm]", "force": "F [N]"}

PHYSICS = {
    "valve_gain": Truth(9.0e4, "Pa/V"),
    "area": Truth(2.01e-4, "m2", note="bore of 16 mm"),
    "stiffness": Truth(300.0, "N/m"),
    "stiffening": Truth(4000.0, "N/m2", note="the paper says that the spring is nonlinear"),
    "preload": Truth(5.0, "N"),
    "coulomb": Truth(
        6.0,
        "N",
        note="both ways, at the retracted end and without pressure; makes an ideal command miss "
        "by 5 N at a reversal, as the paper's figure 12 shows",
    ),
    "coulomb_per_position": Truth(12.0, "N/m"),
    "coulomb_per_pressure_force": Truth(0.004, "1"),
    "creep": Truth(
        3.3e-5,
        "m",
        note="distance in which the seal's friction reverses with the motion: 95 % after the "
        "paper's 0.1 mm",
    ),
    "mass": Truth(0.06, "kg", note="piston and rod"),
    "viscous": Truth(20.0, "N s/m"),
    "contact_damping": Truth(80.0, "N s/m"),
    "contact_stiffness": Truth(1.5e5, "N/m"),
    "valve_lag": Truth(0.004, "s"),
    "force_noise": Truth(0.05, "N"),
}


def value(name: str) -> float:
    """A number of the simulated cylinder."""
    return scalar(PHYSICS, name)


def spring(x: Array | float) -> Array | float:
    """Force of the stiffening return spring [N]."""
    return value("preload") + value("stiffness") * x + value("stiffening") * x * x


def friction(x: float, push: float) -> float:
    """Coulomb level at a position and pressure force [N]."""
    level = value("coulomb") + value("coulomb_per_position") * x
    return level + value("coulomb_per_pressure_force") * push


def staircase() -> Array:
    """Wanted force: 0 to 60 N and back in steps of 1 N; the rod leaves the sensor [N]."""
    up = np.arange(0.0, 61.0)
    cycle = np.concatenate((up[1:], up[-2::-1], [-SLACK]))
    return np.repeat(np.concatenate(([0.0], *([cycle] * CYCLES))), HELD)


def integrate(command: Array, x0: float) -> tuple[Array, Array]:
    """Rod and force sensor while the valve follows the command.

    ``m dv/dt = push - spring(x) - stiction - viscous v - force``, with the seal as a bristle
    (Dahl): ``d stiction = (sign(v) level - stiction) |dx| / creep``. The rod presses on the
    sensor at ``x0`` and leaves it when the pressure no longer carries the spring.

    Returns
    -------
    position [m], force [N]
        Shapes ``(n,)``, at the end of each sample.
    """
    p = {name: t.value for name, t in PHYSICS.items()}
    gain, step = p["valve_gain"] * p["area"], STEP / INNER
    keep = math.exp(-step / p["valve_lag"])
    push = float(spring(x0)) - friction(x0, float(spring(x0)))
    x, v, stiction, rows = x0, 0.0, -friction(x0, push), []
    for u in command.tolist():
        force = 0.0
        for _ in range(INNER):
            push = gain * u + (push - gain * u) * keep
            depth = x - x0
            force = max(p["contact_stiffness"] * depth + p["contact_damping"] * v, 0.0)
            force = force if depth > 0.0 else 0.0
            total = push - float(spring(x)) - stiction - p["viscous"] * v - force
            v += step * total / p["mass"]
            moved = step * v
            x += moved
            goal = math.copysign(friction(x, push), moved)
            stiction = goal + (stiction - goal) * math.exp(-abs(moved) / p["creep"])
            if x < 0.0:  # the retracted end
                x, v = 0.0, 0.0
        rows.append((x, force))
    position, measured = (np.array(c) for c in zip(*rows))
    return position, measured


def simulate_position(rng: np.random.Generator, x0: float) -> list[Array]:
    """Command, position and force at one position of the force sensor."""
    wanted = staircase()
    gain, commands, state = value("valve_gain") * value("area"), [], 1.0
    for k, target in enumerate(wanted.tolist()):
        if k and target != wanted[k - 1]:
            state = 1.0 if target > wanted[k - 1] else -1.0
        x = x0 + target / value("contact_stiffness")
        need = target + float(spring(x))
        ideal = (need + state * friction(x, need)) / gain
        commands.append(round(ideal + 0.004 * float(rng.standard_normal()) * (k % HELD == 0), 3))
    command = np.array(commands)
    position, force = integrate(command, x0)
    counts = np.round(1e3 * position / ADC + 0.2 * rng.standard_normal(position.size))
    noise = value("force_noise") * rng.standard_normal(position.size)
    return [command, counts * ADC, np.round((force + noise) / 0.01) * 0.01]


def simulate_map(rng: np.random.Generator, trial: int) -> list[Array]:
    """All positions of a trial, one after the other."""
    parts = [simulate_position(rng, 1e-3 * x) for x in POSITIONS[trial]]
    columns = [np.concatenate(c) for c in zip(*parts)]
    return [STEP * np.arange(columns[0].size, dtype=np.float64), *columns]


DATASET = Dataset(
    "force-map",
    "Single-acting pneumatic cylinder: command, position and force with hysteresis",
    f"the rig of the {FORCE_PAPER}",
    (20251, 1),
    simulate_map,
    COLUMNS,
    ROLES,
    {},
    (
        "100 Hz; six positions to train on (trial 1: 1.3, 11.6, 21.3 mm; trial 2: 6.5, 16.6, "
        "26.9 mm), four staggered ones to test (trial 3: 4.2, 13.6, 23.2, 26.5 mm), as in "
        "the paper",
        "force 0 to 60 N and back in steps of 1 N (paper), 40 ms each, twice (invented; the "
        "paper repeats it five times)",
        "position by a 10-bit converter over 60 mm (paper) with 0.2 counts RMS noise; force "
        "with 0.05 N RMS noise in steps of 0.01 N (invented)",
        "after a reversal the friction of the seal changes sign gradually, within 0.1 mm, and "
        "between two cycles the rod leaves the sensor and meets it again: the two transient "
        "waves of the paper's figure 12. A command that knows spring and friction misses the "
        "force by up to 5 N there, by 0.9 N RMS over all",
    ),
    physics=PHYSICS,
)
