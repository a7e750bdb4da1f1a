"""Errors that wander below a louder white noise: no autoregression of few lags sees them."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter
from studies.red_team.attacks import cylinder_friction as friction

import fluidact_fit as ff


def fit(seed: int, wander: float) -> ff.FitResult:
    """Two minutes of strokes, the load cell wandering with a correlation time of 10 s [N]."""
    rng = np.random.default_rng([41, seed])
    logs = []
    for r in friction.record(rng, law=friction.TRUTH, n=12_000):
        n, memory = r["force"].size, np.exp(-float(np.diff(r["time"][:2])[0]) / 10.0)
        driven = wander * np.sqrt(1.0 - memory**2) * rng.standard_normal(n)
        logs.append({**r, "force": r["force"] + lfilter([1.0], [1.0, -memory], driven)})
    return ff.fit("cylinder-friction", logs, mass=friction.MASS, offset="none")


def test_a_wandering_load_cell_is_named() -> None:
    """Levels 2 % off at 4 to 8 standard errors, PASS in 2 of 12."""
    for seed in range(4):
        assert "errors-change-slowly" in {n.code for n in fit(seed, 0.2).notices}


def test_white_noise_is_not() -> None:
    for seed in range(8):
        assert "errors-change-slowly" not in {n.code for n in fit(seed, 0.0).notices}
