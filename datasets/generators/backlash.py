"""Rack-and-pinion rotary actuator: slow strokes of the rack, angle of the shaft behind the play."""

from __future__ import annotations

import numpy as np

from .writing import Array, Column, Dataset, Truth, scalar

PLAY_STEP = 0.05  # s: 20 Hz
PLAY_SAMPLES = 900

ZEROS = (0.8, 0.8, 1.1)  # deg: of the angle sensor, each trial

_ACTUATOR = "chosen near a rotary actuator with a worn pinion of 50 mm"
BACKLASH = {
    "play": Truth(0.0105, "rad", note=_ACTUATOR),
    "ratio": Truth(40.0, "rad/m", note="pinion of 50 mm: 1 / 25 mm"),
    "offset": Truth(round(float(np.mean(np.deg2rad(ZEROS))), 6), "rad", note="mean of the trials"),
}


def turn_shaft(rack: Array, begins: float) -> Array:
    """Angle of the shaft, sample by sample: it rests until a flank of the tooth pushes it [rad]."""
    ratio, play = scalar(BACKLASH, "ratio"), scalar(BACKLASH, "play")
    angle, out = ratio * float(rack[0]) + begins * play, np.empty_like(rack)
    for k, place in enumerate((ratio * rack).tolist()):
        if place - angle > 0.5 * play:
            angle = place - 0.5 * play
        elif angle - place > 0.5 * play:
            angle = place + 0.5 * play
        out[k] = angle
    return out


def simulate_rack(rng: np.random.Generator, trial: int) -> list[Array]:
    """Two sines of the rack, so that its strokes differ in length and in speed."""
    time = PLAY_STEP * np.arange(PLAY_SAMPLES, dtype=np.float64)
    slow, period = (28e-3, 34e-3, 22e-3)[trial], (14.0, 17.0, 11.0)[trial]
    rack = slow * np.sin(2.0 * np.pi * time / period + 0.9 * trial)
    rack += 7e-3 * np.sin(2.0 * np.pi * time / (0.37 * period) + 2.0)
    shaft = turn_shaft(rack, (0.2, -0.4, 0.1)[trial]) + np.deg2rad(ZEROS[trial])
    shaft += np.deg2rad(0.02) * rng.standard_normal(PLAY_SAMPLES)
    rack = rack + 2e-6 * rng.standard_normal(PLAY_SAMPLES)
    return [time, 1e3 * rack, np.rad2deg(shaft)]


DATASET = Dataset(
    "backlash",
    "Backlash of a rack-and-pinion actuator: slow strokes both ways",
    "a rotary actuator on a bench",
    (20202, 3),
    simulate_rack,
    (
        Column("t [s]", "time of the sample", 2),
        Column("x [mm]", "position of the rack", 3),
        Column("phi [deg]", "angle of the shaft", 3),
    ),
    {"time": "t [s]", "drive": "x [mm]", "load": "phi [deg]"},
    BACKLASH,
    (
        "20 Hz, 45 s per trial, two sines of the rack, 20 mm/s at most",
        "friction of the shaft holds it while the rack crosses the play",
        "the zero of the angle sensor lies 0.8 to 1.1 degrees beside that of the rack",
        "sensor noise 2 um of the rack and 0.02 degrees of the shaft RMS (invented)",
    ),
)
