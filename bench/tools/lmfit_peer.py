"""lmfit: optimiser and statistics; the simulators are the user's, as tutorials write them."""

from __future__ import annotations

from typing import Any

import lmfit
import numpy as np
from problems import Log, dead_zone, line
from scipy.signal import lsim, savgol_filter

TITLE = "lmfit"
Guess = dict[str, float]


def version() -> str:
    """Version of lmfit."""
    return lmfit.__version__


def _minimise(residual: Any, guess: Guess, limits: dict[str, tuple] | None = None, **options: Any):
    parameters = lmfit.Parameters()
    for name, value in guess.items():
        low, high = (limits or {}).get(name, (-np.inf, np.inf))
        parameters.add(name, value=value, min=low, max=high)
    found = lmfit.minimize(lambda p: residual(p.valuesdict()), parameters, **options)
    return found.params.valuesdict()


def p1(log: Log, guess: Guess) -> Guess:
    """``lsim``, which moves its input straight from sample to sample."""

    def residual(p: Guess) -> np.ndarray:
        force = dead_zone(log.u, p["dz_neg"], p["dz_pos"])
        return lsim(([1.0], [p["m"], p["c"], 0.0]), force, log.t)[1] - log.y

    return _minimise(residual, guess)


def p2(log: Log, guess: Guess, held: bool = True) -> Guess:
    """``lsim`` with the input held, or with its default."""

    def residual(p: Guess) -> np.ndarray:
        wn, z = p["wn"], p["z"]
        return lsim(([wn**2], [1, 2 * z * wn, wn**2]), log.u, log.t, interp=not held)[1] - log.y

    return _minimise(residual, guess)


def p3(log: Log, guess: Guess) -> Guess:
    """Dead time by shifting the input with ``np.interp``."""

    def residual(p: Guess) -> np.ndarray:
        u = np.interp(log.t - p["L"], log.t, log.u, left=0.0)
        return lsim(([p["K"]], [p["tau"], 1.0]), u, log.t, interp=False)[1] - log.y

    return _minimise(residual, guess, {"L": (0, 0.5), "tau": (1e-3, 5)})


def p3_exact(log: Log, guess: Guess) -> Guess:
    """The exact recursion instead."""
    return _minimise(
        lambda p: line(p, log.u, log.sample_time) - log.y,
        guess,
        {"L": (0, 0.5), "tau": (1e-3, 5)},
    )


def _karnopp(p: Guess, log: Log) -> np.ndarray:
    """Stick-slip with a fixed step of 1 ms, semi-implicit Euler."""
    sub = max(round(log.sample_time / 1e-3), 1)
    h = log.sample_time / sub
    torque = np.interp(np.arange((log.t.size - 1) * sub + 1) * h, log.t, log.u).tolist()
    out = np.empty(log.t.size)
    angle = speed = 0.0
    for i, tau in enumerate(torque):
        if i % sub == 0:
            out[i // sub] = angle
        if speed == 0.0:
            if tau > p["fsp"]:
                speed = h * (tau - p["fkp"]) / p["J"]
            elif tau < -p["fsn"]:
                speed = h * (tau + p["fkn"]) / p["J"]
            else:
                continue
        else:
            friction = p["fkp"] if speed > 0 else -p["fkn"]
            new = (speed + h / p["J"] * (tau - friction)) / (1 + h * p["b"] / p["J"])
            speed = 0.0 if new * speed < 0 else new
        angle += h * speed
        if not abs(angle) < 1e9:
            out[i // sub :] = 1e9
            break
    return out


def p4(log: Log, guess: Guess, **options: Any) -> Guess:
    """From the guess."""
    top = float(np.abs(log.u).max())
    limits = {
        "J": (1e-8, 1e-4), "b": (1e-8, 1e-2), "fkp": (1e-6, top), "fkn": (1e-6, top),
        "fsp": (1e-6, top), "fsn": (1e-6, top),
    }  # fmt: skip
    return _minimise(lambda p: _karnopp(p, log) - log.y, guess, limits, **options)


def p4_skilled(log: Log, guess: Guess) -> Guess:
    """Start from the torque balance, coarser step of the differences."""
    v = savgol_filter(log.y, 7, 2, deriv=1, delta=log.sample_time)
    a = savgol_filter(log.y, 7, 2, deriv=2, delta=log.sample_time)
    moving = np.abs(v) > 0.15 * np.abs(v).max()
    columns = np.column_stack([a, v, 1.0 * (v > 0), -1.0 * (v < 0)])[moving]
    j, b, fp, fn = np.abs(np.linalg.lstsq(columns, log.u[moving], rcond=None)[0])
    start = {"J": j, "b": b, "fkp": fp, "fkn": fn, "fsp": 1.3 * fp, "fsn": 1.3 * fn}
    return p4(log, start, epsfcn=1e-4)


FITS = {
    "P1": p1,
    "P2": p2,
    "P2|lsim default": lambda log, guess: p2(log, guess, held=False),
    "P3": p3,
    "P3|exact simulator": p3_exact,
    "P4": p4,
    "P4|torque balance first": p4_skilled,
}
