"""Algebra that users of discrete-time tools have to write themselves."""

from __future__ import annotations

import numpy as np


def second_order(a1: float, a2: float, step: float) -> dict[str, float]:
    """Frequency and damping of the denominator ``1 + a1 q^-1 + a2 q^-2`` of a held input."""
    poles = np.log(np.roots([1.0, a1, a2]).astype(complex)) / step
    wn = float(np.sqrt(np.real(poles[0] * poles[1])))
    return {"wn": wn, "z": float(-np.real(poles.sum())) / (2.0 * wn)}


def delayed_first_order(b0: float, b1: float, a1: float, nk: int, step: float) -> dict[str, float]:
    """Gain, lag and dead time of ``(b0 q^-nk + b1 q^-nk-1)/(1 + a1 q^-1)``, held input."""
    tau = -step / np.log(-a1)
    gain = (b0 + b1) / (1.0 + a1)
    newest = min(max(b0 / gain, 0.0), 1.0 + a1)
    return {"K": gain, "tau": tau, "L": nk * step + tau * np.log(1.0 - newest)}


def slowest(poles: np.ndarray, step: float) -> float:
    """Time constant of the slowest pole of a discrete model."""
    return float(-step / np.log(np.abs(poles).max()))
