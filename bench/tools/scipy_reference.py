"""scipy: ``least_squares`` with hand-written exact simulators, the floor a script can reach.

Not a tool of the field; what an expert writes for one problem at a time.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy
from problems import Log, dead_zone, line, valve
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.signal import lfilter, savgol_filter

TITLE = "scipy, by hand"
_SUB = 20


def version() -> str:
    """Version of scipy."""
    return scipy.__version__


def _solve(simulate: Any, log: Log, start: dict[str, float], **options: Any) -> dict[str, float]:
    names, scale = list(start), np.array(list(start.values()))

    def residual(x: np.ndarray) -> np.ndarray:
        return np.asarray(simulate(dict(zip(names, x * scale)))) - log.y

    found = least_squares(residual, np.ones(len(names)), x_scale="jac", **options)
    return dict(zip(names, found.x * scale))


def p1(log: Log, guess: dict[str, float]) -> dict[str, float]:
    """Force splined between samples, the rest exact on the finer grid."""
    h = log.sample_time / _SUB
    force = CubicSpline(log.t, log.u)(np.arange((log.t.size - 1) * _SUB + 1) * h)

    def simulate(p: dict[str, float]) -> np.ndarray:
        w = dead_zone(force, p["dz_neg"], p["dz_pos"]) / p["c"]
        lag = p["m"] / p["c"]
        a = math.exp(-h / lag)
        v = lfilter([1 - lag / h * (1 - a), lag / h * (1 - a) - a], [1, -a], w)
        x = np.concatenate(([0.0], np.cumsum(0.5 * h * (w[1:] + w[:-1]))))
        return (x - lag * (v - v[0]))[::_SUB]

    return _solve(simulate, log, guess)


def p2(log: Log, guess: dict[str, float]) -> dict[str, float]:
    """Exact discretisation of the held command."""
    return _solve(lambda p: valve(p, log.u, log.sample_time), log, guess)


def p3(log: Log, guess: dict[str, float]) -> dict[str, float]:
    """Gain and lag at every dead time of a grid, then all three."""
    best: tuple[float, dict[str, float]] | None = None
    step = log.sample_time
    for dead in np.arange(0.0, 10.0 * step, 0.5 * step):

        def residual(x: np.ndarray, dead: float = float(dead)) -> np.ndarray:
            return line({"K": x[0], "tau": abs(x[1]), "L": dead}, log.u, step) - log.y

        r = least_squares(residual, [guess["K"], guess["tau"]], max_nfev=30)
        if best is None or r.cost < best[0]:
            best = (r.cost, {"K": r.x[0], "tau": abs(r.x[1]), "L": float(dead) + 0.01 * step})
    assert best is not None
    return _solve(lambda p: line(p, log.u, step), log, best[1])


def _stick_slip(p: dict[str, float], torque: np.ndarray, h: float, every: int) -> np.ndarray:
    """Exact response to a torque that runs straight between its nodes."""
    inertia, b = p["J"], p["b"]
    lag = inertia / b
    out = np.zeros((torque.size - 1) // every + 1)
    angle = speed = 0.0
    way = 0
    tau = torque.tolist()
    for i in range(len(tau) - 1):
        if i % every == 0:
            out[i // every] = angle
        slope, at = (tau[i + 1] - tau[i]) / h, 0.0
        for _ in range(4):
            if way == 0:
                now = tau[i] + slope * at
                if now > p["fsp"] or now < -p["fsn"]:
                    way = 1 if now > 0 else -1
                else:
                    level = p["fsp"] if slope > 0 else -p["fsn"]
                    reach = (level - tau[i]) / slope if slope else 2 * h
                    if not at < reach < h:
                        break
                    at, way = reach, 1 if slope > 0 else -1
                speed = 0.0
            rest = h - at
            friction = p["fkp"] if way > 0 else -p["fkn"]
            rate = slope / b
            base = (tau[i] + slope * at - friction) / b - rate * lag
            extra = speed - base
            end = base + rate * rest + extra * math.exp(-rest / lag)
            if end * way > 0:
                angle += base * rest + 0.5 * rate * rest**2 + extra * lag * -math.expm1(-rest / lag)
                speed = end
                break
            low, high = 0.0, rest
            for _ in range(40):
                mid = 0.5 * (low + high)
                if (base + rate * mid + extra * math.exp(-mid / lag)) * way > 0:
                    low = mid
                else:
                    high = mid
            angle += base * low + 0.5 * rate * low**2 + extra * lag * -math.expm1(-low / lag)
            at, speed, way = at + low, 0.0, 0
            if at >= h * (1 - 1e-12):
                break
    out[-1] = angle
    return out


def p4(log: Log, guess: dict[str, float]) -> dict[str, float]:
    """Torque balance, then increments from several static levels, then position."""
    every, step = 5, log.sample_time
    h = step / every
    torque = CubicSpline(log.t, log.u)(np.arange((log.t.size - 1) * every + 1) * h)
    v = savgol_filter(log.y, 7, 2, deriv=1, delta=step)
    a = savgol_filter(log.y, 7, 2, deriv=2, delta=step)
    moving = np.abs(v) > 0.15 * np.abs(v).max()
    columns = np.column_stack([a, v, 1.0 * (v > 0), -1.0 * (v < 0)])[moving]
    j, b, fp, fn = np.abs(np.linalg.lstsq(columns, log.u[moving], rcond=None)[0])
    scale = np.array([j, b, fp, fn, fp, fn])

    def simulate(x: np.ndarray) -> np.ndarray:
        values = np.maximum(x * scale, 1e-9)
        return _stick_slip(dict(zip(guess, values.tolist())), torque, h, every)

    best: Any = None
    for positive in (1.1, 1.5):
        for negative in (1.1, 1.5):
            r = least_squares(
                lambda x: np.diff(simulate(x)) - np.diff(log.y),
                [1, 1, 1, 1, positive, negative],
                bounds=(0.05, 10),
                x_scale="jac",
                diff_step=1e-4,
                max_nfev=25,
            )
            if best is None or r.cost < best.cost:
                best = r
    last = least_squares(
        lambda x: simulate(x[:6]) + 1e-3 * x[6] - log.y,
        np.append(best.x, 0.0),
        x_scale="jac",
        diff_step=1e-5,
        max_nfev=100,
    )
    return dict(zip(guess, last.x[:6] * scale))


FITS = {"P1": p1, "P2": p2, "P3": p3, "P4": p4}
