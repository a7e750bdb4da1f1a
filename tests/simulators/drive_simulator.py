"""A drive with dry friction under a controller that reads its encoder: closed form, no estimator.

The torque is held between the ticks of the controller, so the speed relaxes exponentially towards
that of the balance of forces until it returns to zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import copysign, expm1, log

import numpy as np

SERVO = {
    "inertia": 1.2e-6, "viscous": 1e-5, "coulomb_positive": 2e-3, "coulomb_negative": 1.6e-3,
    "breakaway_positive": 2.9e-3, "breakaway_negative": 1.9e-3,
}  # fmt: skip


def advance(
    drive: Mapping[str, float], torque: float, time: float, place: float, speed: float
) -> tuple[float, float]:
    """Place and speed after a torque was held for some time."""
    sign = 0.0 if speed == 0.0 else copysign(1.0, speed)
    rate = drive["viscous"] / drive["inertia"]
    while time > 1e-15:
        if sign == 0.0:
            if -drive["breakaway_negative"] <= torque <= drive["breakaway_positive"]:
                break
            sign = copysign(1.0, torque)
        side = "positive" if sign > 0.0 else "negative"
        final = (torque - sign * drive[f"coulomb_{side}"]) / drive["viscous"]
        left = log(1.0 - speed / final) / rate if sign * final < 0.0 else np.inf
        span = min(left, time)
        place += final * span - (speed - final) * expm1(-rate * span) / rate
        speed = final - (final - speed) * (1.0 + expm1(-rate * span))
        if span == left:
            speed = sign = 0.0
        time -= span
    return place, speed


def servo_log(
    rng: np.random.Generator, path: int, step: float = 0.01, rows: int = 1000,
    code: float = np.deg2rad(0.05), drive: Mapping[str, float] = SERVO,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Log of every tick of a PD controller that follows one of three paths by its encoder."""
    time = np.arange(rows) * step
    sines = (((2.5, 0.25),), ((2.0, 0.9),), ((1.5, 0.13), (0.8, 0.71)))[path]
    phase = rng.uniform(0.0, 6.0)
    wanted = rng.uniform(0.8, 1.2) * sum(
        a * np.sin(2.0 * np.pi * f * time + phase) for a, f in sines
    )
    torque, angle = np.empty(rows), np.empty(rows)
    place = speed = seen = filtered = 0.0
    for k in range(rows):
        last, seen = seen, code * round(place / code)
        filtered += 0.5 * ((seen - last) / step - filtered)
        dither = 2e-4 * np.sin(37.0 * time[k])
        command = 3e-3 * (wanted[k] - seen) - 6e-5 * filtered + dither
        torque[k] = 1e-6 * round(float(np.clip(command, -9e-3, 9e-3)) / 1e-6)
        angle[k] = seen
        place, speed = advance(drive, float(torque[k]), step, place, speed)
    return {"time [s]": time, "torque [N m]": torque, "angle [rad]": angle}
