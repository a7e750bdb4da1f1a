"""SIPPY (``sippy_unipi``): discrete ARX and OE models with integer delays."""

from __future__ import annotations

from importlib import metadata
from typing import Any

import numpy as np
from conversions import delayed_first_order, second_order
from problems import Log, dead_zone
from scipy.optimize import minimize
from scipy.signal import lfilter
from sippy_unipi import system_identification

TITLE = "SIPPY"
Guess = dict[str, float]


def version() -> str:
    """Version of SIPPY."""
    return metadata.version("sippy_unipi")


def _row(coefficients: Any) -> np.ndarray:
    inner = coefficients[0][0] if isinstance(coefficients, list) else coefficients
    return np.asarray(inner, float).ravel()


def _fit(y: np.ndarray, u: np.ndarray, step: float, method: str, nb: int, nf: int, nk: int) -> Any:
    orders = {"OE": {"OE_orders": [nb, nf, nk]}, "ARX": {"ARX_orders": [nf, nb, nk]}}[method]
    m = system_identification(y.reshape(1, -1), u.reshape(1, -1), method, tsample=step, **orders)
    b, a = _row(m.NUMERATOR), _row(m.DENOMINATOR)
    return np.concatenate((np.zeros(a.size - b.size), b)), a


def p1(log: Log, guess: Guess) -> Guess:
    """SIPPY has no dead zone: the user searches it around output-error fits."""
    step, size = log.sample_time, float(np.std(log.y))

    def fit(x: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        force = dead_zone(log.u, min(x), max(x))
        b, a = _fit(log.y / size, force, step, "OE", 1, 2, 0)
        cost = float(np.sum((lfilter(b, a, force) - log.y / size) ** 2))
        return cost if np.isfinite(cost) else 1e9, size * b, np.trim_zeros(a, "b")

    found = minimize(
        lambda x: fit(x)[0],
        [guess["dz_neg"], guess["dz_pos"]],
        method="Nelder-Mead",
        options={"maxfev": 60, "xatol": 0.003, "fatol": 1e-12},
    )
    _, b, a = fit(found.x)
    pole = float(np.sort(np.real(np.roots(a[:3])))[0])
    c = step * (1.0 - pole) / b.sum()
    lag = step / 2.0 * (1.0 + pole) / (1.0 - pole)
    return {"dz_neg": min(found.x), "dz_pos": max(found.x), "m": lag * c, "c": c}


def _p2(method: str) -> Any:
    def run(log: Log, guess: Guess) -> Guess:
        _, a = _fit(log.y, log.u, log.sample_time, method, 2, 2, 0)
        return second_order(a[1], a[2], log.sample_time)

    return run


def p3(log: Log, guess: Guess) -> Guess:
    """Best of five whole delays, the fraction from the numerator."""
    fits = [_fit(log.y, log.u, log.sample_time, "OE", 2, 1, nk) for nk in range(5)]
    b, a = min(fits, key=lambda f: float(np.sum((lfilter(f[0], f[1], log.u) - log.y) ** 2)))
    nk = int(np.flatnonzero(np.abs(b) > 1e-12)[0])
    b0, b1 = np.append(b[nk : nk + 2], 0.0)[:2]
    return delayed_first_order(b0, b1, a[1], nk, log.sample_time)


FITS = {"P1|outer search": p1, "P2|OE": _p2("OE"), "P2|ARX": _p2("ARX"), "P3|OE": p3}
