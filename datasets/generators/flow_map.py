"""Proportional valve on a bench: slow ramps of the command, steady flow at a varying pressure."""

from __future__ import annotations

import numpy as np

from .writing import Array, Column, Dataset, Truth, scalar

FLOW_STEP = 0.05  # s: 20 Hz
FLOW_SAMPLES = 1200
REFERENCE = 3.5e6  # Pa: half of the rated pressure drop of 70 bar

_VALVE = "chosen near a proportional valve of size 6 with overlapped spool"
FLOW_MAP = {
    "dead_band_negative": Truth(-1.1, "V", note=_VALVE),
    "dead_band_positive": Truth(0.8, "V", note=_VALVE),
    "gain_negative": Truth(4.2e-5, "m3/s/V", note=_VALVE),
    "gain_positive": Truth(5.0e-5, "m3/s/V", note=_VALVE),
    "curvature": Truth(0.03, "1/V", note=_VALVE),
    "leakage": Truth(4.0e-6, "m3/s", note=_VALVE),
    "saturation_negative": Truth(-8.6, "V", note=_VALVE),
    "saturation_positive": Truth(9.0, "V", note=_VALVE),
}


def valve_curve(command: Array) -> Array:
    """Flow at the reference pressure drop, sample by sample [m3/s]."""
    t = {n: scalar(FLOW_MAP, n) for n in FLOW_MAP}
    low, high, leak = t["dead_band_negative"], t["dead_band_positive"], t["leakage"]
    out = np.empty_like(command)
    for k, u in enumerate(command.tolist()):
        out[k] = leak
        sign, edge = (1.0, high) if u > 0.0 else (-1.0, -low)
        side = "positive" if u > 0.0 else "negative"
        x = min(abs(u), abs(t[f"saturation_{side}"])) - edge
        if x > 0.0:
            gain = t[f"gain_{side}"]
            left = max(0.0, 1.0 - x / (edge + 2.0 * abs(leak) / gain))
            out[k] = sign * gain * x * (1.0 + t["curvature"] * x) + leak * left
    return out


def simulate_valve(rng: np.random.Generator, trial: int) -> list[Array]:
    """A slow triangle of the command from end to end, begun elsewhere in every trial."""
    phase = np.arange(FLOW_SAMPLES) / FLOW_SAMPLES * 2.0 + (0.0, 0.37, 0.81)[trial]
    command = np.round(10.0 * (2.0 * np.abs(np.mod(phase, 2.0) - 1.0) - 1.0), 3)
    ripple = np.sin(2.0 * np.pi * np.arange(FLOW_SAMPLES) / 310.0 + 2.0 * trial)
    drop = REFERENCE * (1.0 + 0.15 * ripple)
    flow = valve_curve(command) * np.sqrt(drop / REFERENCE)
    measured = flow + 1.0e-6 * rng.standard_normal(FLOW_SAMPLES)
    return [FLOW_STEP * np.arange(FLOW_SAMPLES, dtype=np.float64), command, 1e-5 * drop,
            6e4 * measured]  # fmt: skip


DATASET = Dataset(
    "flow-map",
    "Flow map of a proportional valve: slow ramps of the command",
    "a valve bench",
    (20201, 3),
    simulate_valve,
    (
        Column("t [s]", "time of the sample", 2),
        Column("u [V]", "command of the valve, held until the next sample", 3),
        Column("dp [bar]", "pressure drop over the valve", 4),
        Column("Q [l/min]", "steady flow", 4),
    ),
    {"time": "t [s]", "command": "u [V]", "pressure_drop": "dp [bar]", "flow": "Q [l/min]"},
    FLOW_MAP,
    (
        "20 Hz, one triangle of the command between -10 V and 10 V per trial, 60 s long",
        "the pressure drop sways by 15 % about 35 bar; it is taken as exact",
        "flow meter noise 0.06 l/min RMS (invented)",
    ),
    {"reference_pressure": REFERENCE},
)
