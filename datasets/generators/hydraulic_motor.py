"""Hydraulic motor behind a proportional valve: play, curve and lag in closed form."""

from __future__ import annotations

import math

import numpy as np

from .writing import Array, Column, Dataset, Truth, scalar

MOTOR_STEP = 0.02  # s: 50 Hz

_MOTOR = "chosen near the curve of a bench with a small hydraulic motor"
MOTOR = {
    "dead_zone": Truth(0.4, "A", note=_MOTOR),
    "gain": Truth(88.0, "rad/s/A", note=_MOTOR),
    "curvature": Truth(0.24, "1/A", note=_MOTOR),
    "saturation_command": Truth(6.2, "A", note=_MOTOR),
    "hysteresis": Truth(0.25, "A", note=_MOTOR),
    "time_constant": Truth(0.07, "s", note=_MOTOR),
    "dead_time": Truth(0.03, "s", note=_MOTOR),
}


def staircase(trial: int) -> Array:
    """Levels 0 to 7 and back, 1.6 s each; the trials differ by where the levels lie [A]."""
    levels = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]
    shift = (0.0, 0.35, -0.3)[trial]
    up = [max(level + shift, 0.0) if 0.0 < level < 7.0 else level for level in levels]
    return np.repeat(np.array([*up, *up[-2::-1]]), 80)


def motor_curve(command: Array) -> Array:
    """Speed over the command that the spool sees [rad/s]."""
    t = {n: scalar(MOTOR, n) for n in MOTOR}
    x = np.clip(np.minimum(command, t["saturation_command"]) - t["dead_zone"], 0.0, None)
    return np.asarray(t["gain"] / t["curvature"] * (1.0 - np.exp(-t["curvature"] * x)))


def simulate_motor(rng: np.random.Generator, trial: int) -> list[Array]:
    """Play, static curve and first-order lag after a held command."""
    command = staircase(trial)
    half = 0.5 * scalar(MOTOR, "hysteresis")
    seen, spool = np.empty_like(command), 0.0
    for k, u in enumerate(command.tolist()):
        spool = min(max(spool, u - half), u + half)
        seen[k] = spool
    # half steps: the dead time is one and a half samples
    target = np.repeat(motor_curve(seen), 2)
    late = np.concatenate((np.full(3, target[0]), target[:-3]))
    keep = math.exp(-0.5 * MOTOR_STEP / scalar(MOTOR, "time_constant"))
    fine, now = np.empty_like(late), 0.0
    for k, aim in enumerate(late.tolist()):
        fine[k] = now
        now = aim + keep * (now - aim)
    speed = fine[::2]
    measured = 1.5 + speed + 0.7 * rng.standard_normal(speed.size)
    return [MOTOR_STEP * np.arange(speed.size, dtype=np.float64), command, measured]


DATASET = Dataset(
    "hydraulic-motor",
    "Hydraulic motor behind a proportional valve: staircase of the valve current",
    "a small bench",
    (20191, 2),
    simulate_motor,
    (
        Column("t [s]", "time of the sample", 2),
        Column("i [A]", "current of the valve, held until the next sample", 2),
        Column("omega [rad/s]", "speed of the motor", 2),
    ),
    {"time": "t [s]", "command": "i [A]", "speed": "omega [rad/s]"},
    MOTOR,
    (
        "50 Hz, staircase from 0 A to 7 A and back, 1.6 s per level; the levels of the three "
        "trials interlace",
        "sensor noise 0.7 rad/s RMS, zero error 1.5 rad/s (invented)",
    ),
    {},
)
