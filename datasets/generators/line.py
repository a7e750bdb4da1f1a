"""Pneumatic line: dead time and first order after a continuously changing pressure."""

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
    make_steps,
    quantise,
    sample_instants,
    second_order,
)
from .writing import Array, Column, Dataset, Truth, scalar

LINE = {
    "gain": Truth(0.98, "1", note="equation 21 has lost its numbers"),
    "time_constant": Truth(0.12, "s", note="equation 21 has lost its numbers"),
    "dead_time": Truth(0.0147, "s", THESIS),
}


def simulate_line(rng: np.random.Generator, trial: int) -> list[Array]:
    """Dead time and first order after a pressure that a valve changes continuously."""
    target = np.repeat(make_steps(rng, 1.0, 6.0, 2), FINE)[: fine_instants().size]
    inlet = second_order(target, 40.0, 0.8, STEP / FINE)
    late = round(scalar(LINE, "dead_time") / (STEP / FINE))  # 147 steps of the fine grid, exactly
    delayed = np.concatenate((np.full(late, inlet[0]), inlet[:-late]))
    outlet = scalar(LINE, "gain") * lag_of_straight_lines(delayed, scalar(LINE, "time_constant"))
    valve_side = inlet[::FINE] + 0.002 * rng.standard_normal(SAMPLES)
    far_side = outlet[::FINE] + 0.005 * rng.standard_normal(SAMPLES)
    return [
        1e3 * sample_instants(),
        quantise(valve_side, 10.0 / 2**14),
        quantise(far_side, 10.0 / 2**14),
    ]


DATASET = Dataset(
    "line",
    "Pneumatic line of 5 m: pressure at the valve and at the chamber",
    THESIS_RIG,
    (20131, 4),
    simulate_line,
    (
        Column("t (ms)", "time of the sample", 0),
        Column("p_valve (bar)", "pressure at the valve side", 4),
        Column("p_chamber (bar)", "pressure at the chamber", 4),
    ),
    {"time": "t (ms)", "inlet": "p_valve (bar)", "outlet": "p_chamber (bar)"},
    LINE,
    (
        LIMIT,
        "the valve follows steps between 1 bar and 6 bar as a second order of 40 rad/s and "
        "0.8 damping (invented); its pressure is not held between the samples (`auto`)",
        "noise 0.002 bar RMS at the valve, 0.005 bar at the chamber, 14 bits over 10 bar "
        "(invented)",
        "5 m of 2.5 mm inner diameter (thesis); the dead time is 1.47 samples",
    ),
    {"length": 5.0, "sound_speed": 340.0},
)
