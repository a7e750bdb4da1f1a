"""Single-acting pneumatic cylinder on a moving stage: equations 1 to 6 exactly."""

from __future__ import annotations

import numpy as np

from .force_map import COLUMNS, ROLES
from .signals import FORCE_PAPER, STEP, THESIS
from .writing import Array, Dataset, Truth, scalar

CYLINDER = {
    "pressure_gain": Truth(18.09, "N/V", note="valve of 0.9 bar/V, bore of 16 mm"),
    "stiffness": Truth(300.0, "N/m"),
    "preload": Truth(5.0, "N"),
    "coulomb_loading": Truth(2.4, "N", THESIS, "of another pneumatic cylinder"),
    "coulomb_unloading": Truth(2.4, "N", THESIS, "of another pneumatic cylinder"),
    "viscous": Truth(45.0, "N s/m", THESIS, "of another pneumatic cylinder"),
}


def triangle(t: Array, period: float, phase: float) -> Array:
    """Straight lines between -1 and 1."""
    return np.asarray(4.0 * np.abs(np.mod(t / period + phase, 1.0) - 0.5) - 1.0)


def simulate_cylinder(rng: np.random.Generator, trial: int) -> list[Array]:
    """A stage moves the rod back and forth while the command goes up and down."""
    t = STEP * np.arange(1000, dtype=np.float64)
    period = (4.0, 2.3, 1.1)[trial] * rng.uniform(0.95, 1.05)
    command = np.round(2.6 + 1.4 * triangle(t, period, rng.uniform()), 3)
    state = np.sign(np.diff(command, prepend=command[0]))
    for k in range(1, state.size):
        state[k] = state[k] or state[k - 1]
    state[0] = state[1]
    swing = np.array([0.009, 0.011, 0.008])[trial]
    pace = (5.0, 3.1, 1.3)[trial] * rng.uniform(0.95, 1.05)
    angle = 2.0 * np.pi * t / pace + rng.uniform(0.0, 2.0 * np.pi)
    position = 0.014 + swing * np.sin(angle)
    speed = swing * 2.0 * np.pi / pace * np.cos(angle)
    c = {k: scalar(CYLINDER, k) for k in CYLINDER}
    level = np.where(state > 0.0, c["coulomb_loading"], -c["coulomb_unloading"])
    force = c["pressure_gain"] * command - c["stiffness"] * position - c["preload"]
    force = force - level - c["viscous"] * speed + 0.05 * rng.standard_normal(t.size)
    measured = 1e3 * (position + 10e-6 * rng.standard_normal(t.size))
    return [t, command, measured, force]


DATASET = Dataset(
    "spring-cylinder",
    "Single-acting pneumatic cylinder on a moving stage: equations 1 to 6",
    f"the rig of the {FORCE_PAPER}",
    (20251, 2),
    simulate_cylinder,
    COLUMNS,
    ROLES,
    CYLINDER,
    (
        "100 Hz, 1000 samples, 10 s",
        "a stage moves the rod between 3 and 25 mm, slowly, faster and fast (trials 1, 2, 3), "
        "while the command goes up and down between 1.2 and 4 V",
        "the motion state is the sign of the command's change (equation 3)",
        "force noise 0.05 N RMS, position noise 10 um RMS (invented)",
    ),
)
