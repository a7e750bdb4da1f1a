"""Hydrostatic transmission: dead zone, mass and damping, moved by hand."""

from __future__ import annotations

import numpy as np

from .signals import (
    FINE,
    LIMIT,
    SAMPLES,
    STEP,
    THESIS,
    THESIS_RIG,
    fine_instants,
    lag_of_straight_lines,
    quantise,
    sample_instants,
)
from .writing import Array, Column, Dataset, Truth, scalar

HYDROSTATIC = {
    "mass": Truth(53.7, "kg", THESIS),
    "damping": Truth(1720.5, "N s/m", THESIS),
    "dead_zone_negative": Truth(-3.0, "N", note="lost in the only copy of the thesis (figure 18)"),
    "dead_zone_positive": Truth(1.2, "N", note="lost in the only copy of the thesis (figure 18)"),
}


def hand_force(rng: np.random.Generator, time: Array) -> Array:
    """Force of a hand within +-12 N: six sines of 0.1 Hz to 2 Hz that fade in [N]."""
    frequency = np.array([0.13, 0.31, 0.52, 0.83, 1.27, 1.9]) * rng.uniform(0.9, 1.1, 6)
    phase = rng.uniform(0.0, 2.0 * np.pi, 6)
    total = np.zeros_like(time)
    for f, p in zip(frequency, phase):
        total += f**-0.4 * np.sin(2.0 * np.pi * f * time + p)
    total *= 1.0 - np.exp(-((time / 0.3) ** 2))
    return 12.0 / float(np.abs(total).max()) * total


def simulate_hydrostatic(rng: np.random.Generator, trial: int) -> list[Array]:
    """Dead zone, mass and damping; exact for a force on straight lines of 0.1 ms."""
    force = hand_force(rng, fine_instants())
    low, high = (scalar(HYDROSTATIC, f"dead_zone_{s}") for s in ("negative", "positive"))
    net = np.maximum(force - high, 0.0) + np.minimum(force - low, 0.0)
    damping = scalar(HYDROSTATIC, "damping")
    tau = scalar(HYDROSTATIC, "mass") / damping
    speed = lag_of_straight_lines(net / damping, tau)
    # m v + c x = integral of the net force
    h = STEP / FINE
    impulse = np.concatenate(([0.0], np.cumsum(0.5 * h * (net[1:] + net[:-1]))))
    position = (impulse / damping - tau * speed)[::FINE]
    measured_force = force[::FINE] + 0.02 * rng.standard_normal(SAMPLES)
    measured = 0.025 + position + 10e-6 * rng.standard_normal(SAMPLES)
    return [
        sample_instants(),
        quantise(measured_force, 100.0 / 2**16),
        1e3 * quantise(measured, 55e-3 / 2**16),
    ]


DATASET = Dataset(
    "hydrostatic",
    "Hydrostatic transmission moved by hand: force and position",
    THESIS_RIG,
    (20131, 2),
    simulate_hydrostatic,
    (
        Column("t [s]", "time of the sample", 2),
        Column("F [N]", "load cell on the piston", 4),
        Column("x [mm]", "position sensor of the piston", 4),
    ),
    {"time": "t [s]", "force": "F [N]", "position": "x [mm]"},
    HYDROSTATIC,
    (
        LIMIT,
        "hand force within +-12 N: six sines of 0.1 Hz to 2 Hz; it is not held between the "
        "samples (`auto`)",
        "load cell 0.02 N RMS noise, 16 bits over 100 N; position 10 um RMS noise, 16 bits "
        "over 55 mm (noise and bits invented)",
        "two lines of 2.36 m, 2.5 mm inner diameter (thesis); starts at rest",
    ),
)
