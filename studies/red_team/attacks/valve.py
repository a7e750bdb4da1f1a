"""Attacks on the valve: fast dynamics, delays and poles that it has not, glitches, noise."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np
from scipy.linalg import expm

from ..attack import Array, Attack, Recording, cramer_rao

UNITS = {"command": "V", "outlet": "Pa"}
TRUTH = {"gain": 1.0, "natural_frequency": 20.0, "damping_ratio": 0.7}


def levels(rng: np.random.Generator, n: int, step: float, shortest: float, longest: float) -> Array:
    """Random levels held for ``shortest`` to ``longest`` seconds."""
    u, k = np.zeros(n), round(0.1 / step) + 1
    while k < n:
        hold = max(1, round(rng.uniform(shortest, longest) / step))
        u[k : k + hold] = rng.uniform(-1.0, 1.0)
        k += hold
    return u


def simulate(
    truth: Mapping[str, float], u: Array, step: float, delay: float = 0.0, pole: float = np.inf
) -> Array:
    """Exact output of a held command that reaches the valve late, through another pole.

    The state is carried from one event to the next by matrix exponentials: samples, and
    the instants at which a delayed command switches between them.
    """
    wn, zeta = truth["natural_frequency"], truth["damping_ratio"]
    a = np.array([[0.0, 1.0, 0.0], [-(wn**2), -2.0 * zeta * wn, wn**2], [0.0, 0.0, -pole]])
    b = np.array([0.0, 0.0, pole])
    if not np.isfinite(pole):
        a, b = a[:2, :2], np.array([0.0, wn**2])
    whole, part = divmod(delay / step, 1.0)
    n = b.size

    def interval(h: float) -> tuple[Array, Array]:
        e = expm(np.block([[a, b[:, None]], [np.zeros((1, n + 1))]]) * h)
        return e[:n, :n], e[:n, n]

    first, second = interval(part * step), interval((1.0 - part) * step)
    x, y = np.zeros(n), np.zeros(u.size)
    for k in range(u.size):
        y[k] = x[0]
        late = k - int(whole)
        before = u[late - 1] if late >= 1 else u[0]
        now = u[late] if late >= 0 else u[0]
        x = first[0] @ x + first[1] * before
        x = second[0] @ x + second[1] * now
    return truth["gain"] * y


def record(
    rng: np.random.Generator,
    *,
    truth: Mapping[str, float] = TRUTH,
    step: float = 0.01,
    n: int = 1000,
    sigma: float = 0.01,
    hold: tuple[float, float] = (0.3, 1.0),
    spoil: Callable[[Recording, np.random.Generator], Recording] | None = None,
    **machine: float,
) -> list[Recording]:
    u = levels(rng, n, step, *hold)
    y = simulate(truth, u, step, **machine) + sigma * rng.standard_normal(n)
    recording: Recording = {"time": np.arange(n) * step, "command": u, "outlet": y}
    return [spoil(recording, rng) if spoil else recording]


def _glitch(
    recording: Recording, rng: np.random.Generator, role: str, where: float, factor: float
) -> Recording:
    spoiled = recording[role].copy()
    k = min(int(where * spoiled.size), spoiled.size - 1)
    spoiled[k] = factor * float(np.abs(spoiled).max())
    return {**recording, role: spoiled}


def attacks() -> Iterator[Attack]:
    """All of them."""
    u = levels(np.random.default_rng(1), 1000, 0.01, 0.3, 1.0)
    bounds = cramer_rao(lambda p: [simulate(p, u, 0.01)], TRUTH, 0.01)
    yield Attack("valve", "right model", "20 rad/s, 100 Hz", TRUTH, record, UNITS,
                 bounds=bounds, repetitions=20)  # fmt: skip
    for wn, zeta, hold in (
        (40.0, 0.05, (0.3, 1.0)), (60.0, 0.3, (0.3, 1.0)), (50.0, 0.5, (0.3, 1.0)),
        (100.0, 0.2, (0.3, 1.0)), (25.0, 0.3, (0.3, 1.0)), (25.0, 1.5, (0.3, 1.0)),
        (70.0, 0.1, (0.3, 1.0)), (15.0, 0.2, (0.3, 1.0)),
    ):  # fmt: skip
        truth = {"gain": 1.0, "natural_frequency": wn, "damping_ratio": zeta}
        yield Attack(
            "valve", "faster than the sampling", f"{wn:g} rad/s, {zeta:g}, every 0.1 s", truth,
            partial(record, truth=truth, step=0.1, hold=hold), UNITS, repetitions=8,
        )  # fmt: skip
    for delay in (0.003, 0.010):
        yield Attack("valve", "delay not asked for", f"{1e3 * delay:g} ms", TRUTH,
                     partial(record, delay=delay), UNITS, repetitions=4)  # fmt: skip
    for pole in (200.0, 60.0, 20.0):
        yield Attack("valve", "another pole", f"{pole:g} rad/s", TRUTH,
                     partial(record, pole=pole), UNITS, repetitions=4)  # fmt: skip
    for where in (0.0, 0.4, 1.0):
        for factor in (0.0, 3.0, 1e4):
            yield Attack(
                "valve", "one bad sample", f"outlet at {where:g} of the log, {factor:g}", TRUTH,
                partial(record, spoil=partial(_glitch, role="outlet", where=where, factor=factor)),
                UNITS, repetitions=2,
            )  # fmt: skip
