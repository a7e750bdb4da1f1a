"""Excitation and small solvers that several datasets share, in closed form.

They need nothing but numpy and share no code with ``fluidact_fit``, so that a fit which recovers
the truth proves something.
"""

from __future__ import annotations

import math

import numpy as np

from .writing import Array

STEP = 0.01  # s: 100 Hz, as on the rigs
SAMPLES = 1000  # 10 s, the recording limit of the thesis' rig
FINE = 100  # steps of the fine grid per sample

THESIS = "thesis"  # D. B. Comber 2013
THESIS_RIG = "the rig of D. B. Comber's thesis of 2013"
FORCE_PAPER = "pneumatic force control paper, 2025"
LIMIT = "100 Hz, 1000 samples, 10 s: the recording limit of the rig (thesis)"


def sample_instants() -> Array:
    """Instants of the samples, shape ``(1000,)`` [s]."""
    return STEP * np.arange(SAMPLES, dtype=np.float64)


def fine_instants() -> Array:
    """Instants of the fine grid; every hundredth is a sample [s]."""
    return STEP / FINE * np.arange((SAMPLES - 1) * FINE + 1, dtype=np.float64)


def make_steps(rng: np.random.Generator, low: float, high: float, digits: int) -> Array:
    """Held levels of 0.3 s to 1.1 s, one value per sample, after 0.2 s of rest."""
    values = np.full(SAMPLES, round(0.5 * (low + high), digits))
    k = 20
    while k < SAMPLES:
        level = round(rng.uniform(low, high), digits)
        while abs(level - values[k - 1]) < 0.2 * (high - low):
            level = round(rng.uniform(low, high), digits)
        values[k:] = level
        k += int(rng.uniform(0.3, 1.1) / STEP)
    return values


def quantise(values: Array, step: float) -> Array:
    """Round to the nearest step of a converter."""
    return np.round(values / step) * step


def lag_of_straight_lines(u: Array, tau: float) -> Array:
    """First-order lag, exact for straight lines between points of the fine grid; from rest."""
    h = STEP / FINE
    keep = math.exp(-h / tau)
    old = tau / h * (1.0 - keep) - keep
    new = 1.0 - tau / h * (1.0 - keep)
    out = np.empty_like(u)
    y = out[0] = u[0]
    for k, drive in enumerate((old * u[:-1] + new * u[1:]).tolist(), start=1):
        y = keep * y + drive
        out[k] = y
    return out


def second_order(command: Array, omega: float, zeta: float, h: float) -> Array:
    """Response of an underdamped second order to held values, closed form; from rest."""
    wd = omega * math.sqrt(1.0 - zeta**2)
    fade = math.exp(-zeta * omega * h)
    c, s = math.cos(wd * h), math.sin(wd * h)
    out = np.empty_like(command)
    y, v = float(command[0]), 0.0
    for k, u in enumerate(command.tolist()):
        out[k] = y
        x = y - u
        y = u + fade * ((c + zeta * omega / wd * s) * x + s / wd * v)
        v = fade * (-(omega**2) / wd * s * x + (c - zeta * omega / wd * s) * v)
    return out
