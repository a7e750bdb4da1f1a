"""Noise on a measured input: the inlet of a line, the force on a hydrostatic transmission.

The machines are driven by functions of time whose response is known exactly (sines) or that are
straight between the instants of a grid much finer than the sampling. Noise and converter sit
on the logged input alone: the machine never saw them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from ..attack import Array, Attack, Recording, cramer_rao

LINE_UNITS = {"inlet": "Pa", "outlet": "Pa"}
LINE = {"gain": 1.0, "time_constant": 0.12, "dead_time": 0.0147}
BAR = 1e5
_TONES = {
    "smooth": np.array([0.11, 0.23, 0.41, 0.67]),
    "multisine": np.array([0.13, 0.31, 0.74, 1.3, 2.2, 3.7, 5.3]),
}
_FINE = 20  # steps of the grid per sample

FORCE_UNITS = {"force": "N", "position": "m"}
HYDROSTATIC = {
    "mass": 53.7, "damping": 1720.5, "dead_zone_negative": -3.0, "dead_zone_positive": 1.2,
}  # fmt: skip
_WIDTH = HYDROSTATIC["dead_zone_positive"] - HYDROSTATIC["dead_zone_negative"]
EDGES = {"dead_zone_negative": _WIDTH, "dead_zone_positive": _WIDTH}


def _first_order(u: Array, step: float, tau: float, delay: float) -> Array:
    """Exact response of ``1/(tau s + 1)`` to straight lines through ``u``, which began at rest.

    The delay is whole steps and a share of one, over which the response is exact as well.
    """
    whole, share = divmod(delay / step, 1.0)
    lines = lfilter([1.0, -1.0], [1.0], u, zi=[-u[0]])[0]  # change over every step
    a = np.exp(-step / tau)
    ramp = 1.0 - tau / step * (1.0 - a)
    x = u[0] + lfilter([ramp, 1.0 - a - ramp], [1.0, -a], np.cumsum(lines))
    if share:  # from the last node on: its state, its level, and a part of the next line
        h = (1.0 - share) * step
        b = np.exp(-h / tau)
        slope = np.append(lines[1:], 0.0) / step
        x = u + slope * (h - tau) + (x - u + slope * tau) * b
        whole += 1
    late = np.arange(u.size) - int(whole)
    return np.where(late >= 0, x[np.maximum(late, 0)], u[0])


def inlet(rng: np.random.Generator, kind: str, n: int, step: float) -> Array:
    """Inlet pressure of up to 2 bar on the fine grid [Pa], at rest for the first 0.2 s."""
    t = np.arange(n * _FINE) * step / _FINE
    if kind == "steps":  # opening a valve takes a few milliseconds
        u, k, level = np.zeros(t.size), round(0.2 / step) * _FINE, 0.0
        width = 2 * _FINE
        while k < t.size:
            new = rng.uniform(0.0, 2.0)
            u[k:] = level + (new - level) * np.minimum((np.arange(t.size - k)) / width, 1.0)
            level = new
            k += round(rng.uniform(0.3, 1.0) / step) * _FINE
        return BAR * u
    f = _TONES[kind] * rng.uniform(0.9, 1.1, _TONES[kind].size)
    phase = rng.uniform(0.0, 2.0 * np.pi, f.size)
    u = np.sin(2.0 * np.pi * np.outer(t, f) + phase).sum(axis=1)
    late = np.maximum(t - 0.2, 0.0)
    return BAR * 2.0 * u / np.abs(u).max() * (1.0 - np.exp(-((late / 0.3) ** 2)))


def line_response(truth: Mapping[str, float], u: Array, step: float) -> Array:
    """Outlet at the samples of an inlet on the fine grid."""
    y = _first_order(u, step / _FINE, truth["time_constant"], truth["dead_time"])
    return np.asarray(truth["gain"] * y[::_FINE])


def _line(
    rng: np.random.Generator, *, kind: str = "multisine", noise: float = 0.0,
    converter: float = 0.0, sigma: float = 0.01, n: int = 1000, step: float = 0.01,
) -> list[Recording]:  # fmt: skip
    """One log; noise, converter step and sigma in bar."""
    u = inlet(rng, kind, n, step)
    y = line_response(LINE, u, step) + BAR * sigma * rng.standard_normal(n)
    return [{
        "time": np.arange(n) * step, "inlet": _logged(rng, u, BAR * noise, BAR * converter),
        "outlet": y,
    }]  # fmt: skip


def _logged(rng: np.random.Generator, u: Array, noise: float, converter: float) -> Array:
    """What a noisy sensor and a converter make of an input on the fine grid."""
    seen = u[::_FINE] + noise * rng.standard_normal(u[::_FINE].size)
    return converter * np.round(seen / converter) if converter else seen


def force(rng: np.random.Generator, n: int, step: float) -> Array:
    """Force of a hand of up to 12 N on the fine grid [N]."""
    t = np.arange(n * _FINE) * step / _FINE
    f = np.array([0.13, 0.31, 0.52, 0.83, 1.27, 1.9]) * rng.uniform(0.9, 1.1, 6)
    u = (np.sin(2.0 * np.pi * np.outer(t, f) + rng.uniform(0.0, 6.0, 6)) * f**-0.4).sum(axis=1)
    return 12.0 / np.abs(u).max() * u * (1.0 - np.exp(-((t / 0.3) ** 2)))


def piston(truth: Mapping[str, float], u: Array, step: float) -> Array:
    """Position at the samples, driven by straight lines on the fine grid beyond the dead zone."""
    low, high = truth["dead_zone_negative"], truth["dead_zone_positive"]
    driving = (np.maximum(u - high, 0.0) + np.minimum(u - low, 0.0)) / truth["damping"]
    h, tau = step / _FINE, truth["mass"] / truth["damping"]
    v = _first_order(driving, h, tau, 0.0)
    way = np.concatenate(([0.0], np.cumsum(0.5 * h * (driving[1:] + driving[:-1]))))
    return np.asarray((way - tau * (v - v[0]))[::_FINE])


def hydrostatic(
    rng: np.random.Generator, *, noise: float = 0.0, converter: float = 0.0,
    sigma: float = 0.01, n: int = 1000, step: float = 0.01, logs: int = 2,
) -> list[Recording]:  # fmt: skip
    """Logs; noise and converter step in newtons, sigma as a share of the stroke's spread."""
    out: list[Recording] = []
    for _ in range(logs):
        u = force(rng, n, step)
        x = piston(HYDROSTATIC, u, step)
        out.append({
            "time": np.arange(n) * step, "force": _logged(rng, u, noise, converter),
            "position": x + sigma * x.std() * rng.standard_normal(n),
        })  # fmt: skip
    return out


def _line_bounds(kind: str, noise: float, sigma: float) -> dict[str, float]:
    """Bound with white noise on both ends: that of the outlet with ``e + G w`` for its noise."""
    n, step = 1000, 0.01
    u = inlet(np.random.default_rng(1), kind, n, step)
    hat = np.zeros(n * _FINE)
    around = 5 * _FINE
    hat[around - _FINE : around + _FINE + 1] = 1.0 - np.abs(np.arange(-_FINE, _FINE + 1)) / _FINE
    h = line_response(LINE, hat, step)[5:]
    through = toeplitz(np.pad(h, (0, n - h.size)), np.zeros(n))
    spread = sigma**2 * np.eye(n) + noise**2 * through @ through.T
    root = np.linalg.cholesky(spread) * BAR
    t = np.arange(n) * step
    own = np.column_stack((np.ones(n), np.exp(-t / LINE["time_constant"])))
    return cramer_rao(
        lambda p: [np.linalg.solve(root, line_response(p, u, step))], LINE, 1.0,
        nuisance=lambda _: np.linalg.solve(root, own),
    )  # fmt: skip


def attacks() -> Iterator[Attack]:
    """All of them."""
    for kind in ("smooth", "multisine", "steps"):
        for noise in (0.0, 0.02, 0.1, 0.2):
            yield Attack(
                "line", "noise on the inlet", f"{kind}, {noise:g} bar of 2", LINE,
                partial(_line, kind=kind, noise=noise), LINE_UNITS,
                bounds=partial(_line_bounds, kind, noise, 0.01), repetitions=3,
            )  # fmt: skip
    for converter in (0.02, 0.1):
        yield Attack(
            "line", "converter at the inlet", f"multisine, {converter:g} bar of 2", LINE,
            partial(_line, converter=converter), LINE_UNITS, repetitions=3,
        )  # fmt: skip
    for noise in (0.0, 0.02, 0.1, 0.5):
        yield Attack(
            "hydrostatic", "noise on the force", f"{noise:g} N of 12", HYDROSTATIC,
            partial(hydrostatic, noise=noise), FORCE_UNITS, scales=EDGES, repetitions=3,
        )  # fmt: skip
    for converter in (0.05, 0.5):
        yield Attack(
            "hydrostatic", "converter at the force", f"{converter:g} N of 12", HYDROSTATIC,
            partial(hydrostatic, converter=converter), FORCE_UNITS, scales=EDGES,
            repetitions=3,
        )  # fmt: skip
