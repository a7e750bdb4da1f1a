"""Potentiometer: a rational Bezier curve read by a 10-bit converter."""

from __future__ import annotations

import numpy as np

from .signals import FORCE_PAPER, SAMPLES, sample_instants
from .writing import Array, Column, Dataset, Truth

POTENTIOMETER = {
    "control_points": Truth([0.0, 0.022, 0.038, 0.06], "m", note="the curve was not published"),
    "weights": Truth([1.0, 2.5, 2.5, 1.0], "1", note="the curve was not published"),
    "reading_range": Truth([31.0, 992.0], "1", note="10-bit readings"),
}


def true_position(reading: Array) -> Array:
    """Position of a reading: a rational Bezier curve of degree three, written out [m]."""
    points, weights, span = (
        np.asarray(POTENTIOMETER[k].value) for k in ("control_points", "weights", "reading_range")
    )
    t = (reading - span[0]) / (span[1] - span[0])
    basis = np.array([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
    weighted = weights[:, None] * basis
    return np.asarray((points[:, None] * weighted).sum(0) / weighted.sum(0))


def simulate_potentiometer(rng: np.random.Generator, trial: int) -> list[Array]:
    """Reciprocating motion over the whole stroke, read by a 10-bit converter and a laser."""
    t = sample_instants()
    slow, quick = rng.uniform(0.08, 0.12), rng.uniform(0.5, 0.9)
    start = rng.uniform(0.0, 2.0 * np.pi)
    swing = np.sin(2.0 * np.pi * quick * t + start)
    reach = 0.9 + 0.1 * np.sin(2.0 * np.pi * slow * t)
    position = 0.030 + 0.0298 * reach * swing
    table = np.linspace(31.0, 992.0, 200_001)  # inverse of a monotone curve by a fine table
    reading = np.interp(position, true_position(table), table)
    counts = np.round(reading + 0.3 * rng.standard_normal(SAMPLES))
    laser = position + 1e-4 * rng.standard_normal(SAMPLES)
    return [counts, 1e3 * laser]


DATASET = Dataset(
    "potentiometer",
    "Calibration of a linear potentiometer against a laser",
    f"the rig of the {FORCE_PAPER}",
    (20131, 0),
    simulate_potentiometer,
    (
        Column("ADC", "reading of the 10-bit converter [counts]", 0),
        Column("laser (mm)", "position from the laser [mm]", 3),
    ),
    {"reading": "ADC", "reference": "laser (mm)"},
    POTENTIOMETER,
    (
        "60 mm potentiometer, 10-bit converter with 0.3 counts RMS noise (noise invented)",
        "laser of 0.2 mm repeatability, taken as two standard deviations: 0.1 mm RMS",
        "reciprocating motion over the whole stroke; no hysteresis; no time column",
        "the readings crowd at both ends (saturation), as the paper's figure 3 shows; the "
        "shape of the curve is invented and lies inside the model family",
    ),
    {"degree": "auto"},
    tolerance=(1e-4, "m"),
)
