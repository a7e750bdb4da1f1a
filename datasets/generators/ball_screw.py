"""Ball-screw drive: stick-slip under a held torque, every event in closed form."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .signals import LIMIT, STEP, THESIS, THESIS_RIG, quantise, sample_instants
from .writing import Array, Column, Dataset, Truth, scalar

_ORDER = "the level is published, which of the four it is was invented: table 3 lost its symbols"
BALL_SCREW = {
    "inertia": Truth(11.71e-7, "kg m2", THESIS),
    "viscous": Truth(1.0e-5, "N m s/rad", note="the thesis says only that it is about zero"),
    "coulomb_positive": Truth(2.0e-3, "N m", THESIS, _ORDER),
    "coulomb_negative": Truth(1.6e-3, "N m", THESIS, _ORDER),
    "breakaway_positive": Truth(2.9e-3, "N m", THESIS, _ORDER),
    "breakaway_negative": Truth(1.9e-3, "N m", THESIS, _ORDER),
}


def drive_torque(rng: np.random.Generator, trial: int) -> Array:
    """A chirp, slow reversals, or half of each; in steps of 0.003 mN m [mN m]."""
    t = sample_instants()
    size, phase = rng.uniform(0.95, 1.05), rng.uniform(-0.3, 0.3)
    chirp = 6.0 * size * np.sin(2.0 * np.pi * (0.2 * t + 0.19 * t**2) + phase)
    ramp = np.abs(np.mod(t / 2.5 + 0.25 + 0.05 * phase, 1.0) - 0.5)
    reversals = 4.0 * size * (4.0 * ramp - 1.0) * np.minimum(t / 0.3, 1.0)
    chosen = (chirp, reversals, np.where(t < 5.0, reversals, chirp))[trial]
    return quantise(chosen, 0.003)  # no step falls on a friction level


def stick_slip(torque: Sequence[float]) -> Array:
    """Angle at the samples for a torque held between them; every event in closed form."""
    inertia, viscous = scalar(BALL_SCREW, "inertia"), scalar(BALL_SCREW, "viscous")
    kinetic = {
        1: scalar(BALL_SCREW, "coulomb_positive"),
        -1: scalar(BALL_SCREW, "coulomb_negative"),
    }
    static = {
        1: scalar(BALL_SCREW, "breakaway_positive"),
        -1: scalar(BALL_SCREW, "breakaway_negative"),
    }
    coast = inertia / viscous
    angle, speed, direction = 0.0, 0.0, 0
    out = []
    for tau in torque:
        out.append(angle)
        left = STEP
        while left > 0.0:
            if direction == 0:
                direction = 1 if tau > static[1] else -1 if tau < -static[-1] else 0
                if direction == 0:
                    break
            final = (tau - direction * kinetic[direction]) / viscous
            stop = math.inf
            if direction * final < 0.0:
                stop = coast * math.log((speed - final) / -final)
            span = min(left, stop)
            fade = math.exp(-span / coast)
            angle += final * span + (speed - final) * coast * (1.0 - fade)
            speed = final + (speed - final) * fade
            left -= span
            if span == stop:
                speed, direction = 0.0, 0
    return np.array(out)


def simulate_ball_screw(rng: np.random.Generator, trial: int) -> list[Array]:
    """Stick-slip under a held torque, read by an encoder of 2000 counts."""
    torque = drive_torque(rng, trial)
    turns = stick_slip((1e-3 * torque).tolist()) / (2.0 * np.pi)
    counts = np.floor(2000.0 * turns + rng.uniform())
    return [sample_instants(), torque, 0.18 * counts]


DATASET = Dataset(
    "ball-screw",
    "Servo motor with ball-screw: torque and angle",
    THESIS_RIG,
    (20131, 1),
    simulate_ball_screw,
    (
        Column("time [s]", "time of the sample", 2),
        Column("torque [mN m]", "torque command, held until the next sample", 3),
        Column("angle [deg]", "motor shaft angle, 2000 counts per turn (0.18 deg)", 2),
    ),
    {"time": "time [s]", "torque": "torque [mN m]", "angle": "angle [deg]"},
    BALL_SCREW,
    (
        LIMIT,
        "the torque is exactly held between the samples of the log (`zoh`) and exactly the "
        "logged number",
        "trial 1: chirp of 0.2 Hz to 4 Hz, about 6 mN m; trial 2: slow reversals up to "
        "4 mN m, period 2.5 s, in which the break-away shows; trial 3: 5 s of each",
        "encoder of 2000 counts per turn, no other noise; starts at rest",
    ),
)
