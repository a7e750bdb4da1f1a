"""Pneumatic cylinder moved by hand: Coulomb and viscous friction."""

from __future__ import annotations

import numpy as np

from .signals import LIMIT, SAMPLES, THESIS, THESIS_RIG, quantise, sample_instants
from .writing import Array, Column, Dataset, Truth, scalar

CYLINDER = {
    "viscous": Truth(45.0, "N s/m", THESIS),
    "coulomb_positive": Truth(2.4, "N", THESIS),
    "coulomb_negative": Truth(2.4, "N", THESIS),
}
CYLINDER_MASS = 0.140  # kg, published: 80 g piston and 60 g load cell


def simulate_cylinder(rng: np.random.Generator, trial: int) -> list[Array]:
    """Piston moved by hand, slow, medium and fast; the motion is given in closed form."""
    t = sample_instants()
    base, size = ((0.4, 0.014), (1.0, 0.016), (2.2, 0.018))[trial]
    frequency = base * np.array([1.0, 0.37, 1.61]) * rng.uniform(0.95, 1.05, 3)
    phase = rng.uniform(0.0, 2.0 * np.pi, 3)
    share = size * np.array([1.0, 0.5, 0.25])
    omega = 2.0 * np.pi * frequency[:, None]
    angle = omega * t + phase[:, None]
    position = (share[:, None] * np.sin(angle)).sum(0)
    speed = (share[:, None] * omega * np.cos(angle)).sum(0)
    acceleration = (-share[:, None] * omega**2 * np.sin(angle)).sum(0)
    coulomb = np.where(
        speed > 0.0, scalar(CYLINDER, "coulomb_positive"), -scalar(CYLINDER, "coulomb_negative")
    )
    force = CYLINDER_MASS * acceleration + scalar(CYLINDER, "viscous") * speed + coulomb
    measured_force = force + 0.1 * rng.standard_normal(SAMPLES)
    measured_position = 0.0275 + position + 10e-6 * rng.standard_normal(SAMPLES)
    measured_speed = speed + 1e-3 * rng.standard_normal(SAMPLES)
    return [
        t,
        quantise(measured_force, 100.0 / 2**16),
        1e3 * quantise(measured_position, 55e-3 / 2**16),
        1e3 * measured_speed,
    ]


DATASET = Dataset(
    "cylinder-friction",
    "Pneumatic cylinder moved by hand: force, position and velocity",
    THESIS_RIG,
    (20131, 5),
    simulate_cylinder,
    (
        Column("t [s]", "time of the sample", 2),
        Column("F [N]", "load cell between hand and piston", 4),
        Column("x [mm]", "position sensor of the piston", 4),
        Column("v [mm/s]", "velocity of the piston", 3),
    ),
    {"time": "t [s]", "force": "F [N]", "velocity": "v [mm/s]"},
    CYLINDER,
    (
        LIMIT,
        "open chambers; trials 1, 2, 3: slow, medium and fast strokes, up to about 0.4 m/s "
        "as in the thesis' figure 43",
        "moving mass 0.140 kg (80 g piston, 60 g load cell, thesis)",
        "load cell 0.1 N RMS noise, 16 bits over 100 N; position 10 um RMS, velocity "
        "1 mm/s RMS (invented)",
    ),
    {"mass": CYLINDER_MASS},
)
