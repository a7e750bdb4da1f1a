"""Proportional valve: second order after a held command."""

from __future__ import annotations

import numpy as np

from .signals import (
    LIMIT,
    SAMPLES,
    STEP,
    THESIS_RIG,
    make_steps,
    quantise,
    sample_instants,
    second_order,
)
from .writing import Array, Column, Dataset, Truth, scalar

VALVE = {
    "gain": Truth(9.0e4, "Pa/V", note="equation 20 has lost its numbers"),
    "natural_frequency": Truth(20.0, "rad/s", note="equation 20 has lost its numbers"),
    "damping_ratio": Truth(0.7, "1", note="equation 20 has lost its numbers"),
}


def simulate_valve(rng: np.random.Generator, trial: int) -> list[Array]:
    """Second order after the held command of a 100 Hz controller."""
    command = make_steps(rng, 1.0, 7.0, 2)
    omega, zeta = scalar(VALVE, "natural_frequency"), scalar(VALVE, "damping_ratio")
    pressure = 1e-5 * scalar(VALVE, "gain") * second_order(command, omega, zeta, STEP)
    measured = 0.03 + pressure + 0.01 * rng.standard_normal(SAMPLES)
    return [sample_instants(), command, quantise(measured, 10.0 / 2**12)]


DATASET = Dataset(
    "valve",
    "Proportional pressure valve: command and outlet pressure",
    THESIS_RIG,
    (20131, 3),
    simulate_valve,
    (
        Column("Zeit [s]", "time of the sample", 2),
        Column("Sollwert [V]", "command of the controller, held until the next sample", 2),
        Column("Druck [bar]", "outlet pressure by the valve's own sensor", 4),
    ),
    {"time": "Zeit [s]", "command": "Sollwert [V]", "outlet": "Druck [bar]"},
    VALVE,
    (
        LIMIT,
        "steps of the command between 1 V and 7 V, held for 0.3 s to 1.1 s (`zoh`)",
        "sensor noise 0.01 bar RMS, 12 bits over 10 bar, zero error 0.03 bar (invented)",
        "semicolons and decimal commas, as a German spreadsheet writes them",
    ),
    delimiter=";",
    decimal=",",
)
