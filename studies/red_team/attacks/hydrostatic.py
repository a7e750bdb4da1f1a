"""Attacks on the hydrostatic transmission: edges never crossed, springs, hard machines."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np
from scipy.signal import cont2discrete, lfilter

from ..attack import Array, Attack, Recording, cramer_rao

UNITS = {"force": "N", "position": "m"}
TRUTH = {
    "mass": 53.7, "damping": 1720.5, "dead_zone_negative": -3.0, "dead_zone_positive": 1.2,
}  # fmt: skip
FINE = 40  # steps of the simulation per sample


def wave(rng: np.random.Generator, t: Array, slow: float, low: float, high: float) -> Array:
    """The force of a hand, a sum of sines between two ends [N]."""
    f = np.array([0.13, 0.31, 0.52, 0.83, 1.27, 1.9]) * rng.uniform(0.9, 1.1, 6) / slow
    turn = rng.uniform(0.0, 6.28, 6)
    u = (f[:, None] ** -0.4 * np.sin(2.0 * np.pi * f[:, None] * t + turn[:, None])).sum(axis=0)
    u = u * (1.0 - np.exp(-((t / (0.3 * slow)) ** 2)))
    return np.asarray(np.where(u > 0.0, high * u / u.max(), low * u / u.min()))


def beyond(truth: Mapping[str, float], u: Array, soft: float = 0.0) -> Array:
    """What the dead zone lets pass of a force; its edges are ``soft`` by so much [N]."""
    up, down = u - truth["dead_zone_positive"], truth["dead_zone_negative"] - u
    if soft:
        return np.asarray(soft * (np.logaddexp(0.0, up / soft) - np.logaddexp(0.0, down / soft)))
    return np.asarray(np.maximum(up, 0.0) - np.maximum(down, 0.0))


def respond(truth: Mapping[str, float], u: Array, h: float) -> Array:
    """Position from the force on a fine grid: straight lines between its points, from rest."""
    w = beyond(truth, u)
    late = truth.get("dead_time", 0.0)
    if late:
        t = np.arange(u.size) * h
        w = np.interp(t - late, t, w, left=w[0])
    denominator = [truth["mass"], truth["damping"], truth.get("stiffness", 0.0)]
    b, a, _ = cont2discrete(([1.0], denominator), h, method="foh")
    return np.asarray(lfilter(b.ravel(), a, w))


def differ(
    truth: Mapping[str, float], u: Array, h: float, *,
    friction: float = 0.0, turbulent: float = 0.0, soft: float = 0.0,
) -> Array:  # fmt: skip
    """Position of a machine that is not the model.

    It has Coulomb ``friction`` [N], ``turbulent`` losses by the square of its speed [N s^2/m^2] or
    ``soft`` edges [N]. Steps of the speed in closed form with the damping of the moment; it stops
    where friction would turn it.
    """
    w = beyond(truth, u, soft)
    m, x, v = truth["mass"], 0.0, 0.0
    out = np.empty(u.size)
    for k, push in enumerate(w.tolist()):
        out[k] = x
        way = np.sign(v) or (np.sign(push) if abs(push) > friction else 0.0)
        if way == 0.0:
            continue
        rate = (truth["damping"] + turbulent * abs(v)) / m
        final = (push - way * friction) / (m * rate)
        new = final + (v - final) * np.exp(-rate * h)
        new = 0.0 if new * way < 0.0 and abs(push) <= friction else new
        x, v = x + 0.5 * h * (v + new), float(new)
    return out


def record(
    rng: np.random.Generator,
    *,
    truth: Mapping[str, float] = TRUTH,
    step: float = 0.01,
    n: int = 1000,
    sigma: float = 0.01,
    low: float = -12.0,
    high: float = 12.0,
    runs: int = 1,
    noise: float = 0.0,
    offset: float = 0.0,
    rate: float | None = None,
    every: int = 1,
    machine: Callable[[Mapping[str, float], Array, float], Array] = respond,
) -> list[Recording]:
    """Strokes; ``sigma`` is noise of the position in shares of its own deviation.

    ``rate`` is how often the force is converted, where that is less often than it is logged [Hz];
    the position has a new reading ``every`` so many rows.
    """
    out = []
    for _ in range(runs):
        h = step / FINE
        t = np.arange((n - 1) * FINE + 1) * h
        u = wave(rng, t, step / 0.01, low, high)
        x = machine(truth, u, h)[::FINE]
        x = x + sigma * x.std() * rng.standard_normal(n)
        x = x[np.arange(n) // every * every]
        force = u[::FINE] + noise * rng.standard_normal(n) + offset
        if rate is not None:
            force = force[(np.floor(np.arange(n) * step * rate) / rate / step).astype(int)]
        out.append({"time": np.arange(n) * step, "force": force, "position": x})
    return out


def _bounds(truth: Mapping[str, float], step: float = 0.01, **ends: float) -> dict[str, float]:
    rng = np.random.default_rng(1)
    t = np.arange(999 * FINE + 1) * step / FINE
    u = wave(rng, t, step / 0.01, ends.get("low", -12.0), ends.get("high", 12.0))
    sigma = 0.01 * respond(truth, u, step / FINE).std()
    return cramer_rao(
        lambda p: [respond(p, u, step / FINE)[::FINE]], truth, sigma,
        nuisance=lambda n: np.column_stack((np.ones(n), np.exp(-np.arange(n) * step * 32.0))),
    )  # fmt: skip


def attacks() -> Iterator[Attack]:
    """All of them."""
    width = {"dead_zone_negative": 4.2, "dead_zone_positive": 4.2}
    attack = partial(Attack, "hydrostatic", units=UNITS, scales=width)
    bounds = _bounds(TRUTH)
    yield attack("right model", "100 Hz, 12 N", TRUTH, record, bounds=bounds, repetitions=12)
    yield attack("right model", "three logs", TRUTH, partial(record, runs=3), bounds=bounds,
                 repetitions=3)  # fmt: skip
    for size, speed in ((1e-3, 10.0), (1e4, 0.2)):  # a micro-actuator, a press
        ends = {"low": -12.0 * size, "high": 12.0 * size}
        edges = {n: size * TRUTH[n] for n in width}
        truth = {"mass": 53.7 * size, "damping": 1720.5 * size * speed, **edges}
        yield attack(
            "right model", f"force times {size:g}", truth,
            partial(record, truth=truth, step=0.01 / speed, **ends),
            scales=dict.fromkeys(width, 4.2 * size),
            bounds=_bounds(truth, 0.01 / speed, **ends), repetitions=3,
        )  # fmt: skip
    wide = {**TRUTH, "dead_zone_negative": -9.0, "dead_zone_positive": 8.0}
    yield attack("wide dead zone", "-9 and 8 of 12 N", wide, partial(record, truth=wide),
                 bounds=_bounds(wide), scales=dict.fromkeys(width, 17.0),
                 repetitions=6)  # fmt: skip
    for reach in (-0.1, -0.5, -1.0, -2.0, -2.8, -2.95):
        yield attack("edge never crossed", f"force down to {reach:g} of -3 N", TRUTH,
                     partial(record, low=reach), repetitions=3)  # fmt: skip
    for reach in (-3.1, -3.5, -5.0):
        yield attack("edge barely crossed", f"force down to {reach:g} of -3 N", TRUTH,
                     partial(record, low=reach), repetitions=3)  # fmt: skip
    for rate in (80.0, 33.3):
        yield attack("channel slower than the log", f"force at {rate:g} Hz", TRUTH,
                     partial(record, rate=rate), repetitions=2)  # fmt: skip
    yield attack("channel slower than the log", "every position twice", TRUTH,
                 partial(record, every=2), repetitions=2)  # fmt: skip
    for name, unlike, more in (
        ("friction of 1 N", "dead_zone_negative dead_zone_positive", {"friction": 1.0}),
        ("half of the losses turbulent", "damping", {"turbulent": 3e5}),
        ("edges 0.5 N wide", "", {"soft": 0.5}),
    ):
        truth = {n: x for n, x in TRUTH.items() if n not in unlike.split()}
        yield attack("another machine", name, truth,
                     partial(record, machine=partial(differ, **more)), repetitions=4)  # fmt: skip
    mass = {"mass": TRUTH["mass"]}
    for name, truth, more in (
        ("friction of 2 N", mass, {"machine": partial(differ, friction=2.0)}),
        ("half of the losses turbulent", mass, {"machine": partial(differ, turbulent=3e5)}),
        ("edges 0.5 N wide", TRUTH, {"machine": partial(differ, soft=0.5)}),
        ("force 20 ms late", TRUTH, {"truth": {**TRUTH, "dead_time": 0.02}}),
        ("spring of 30 N/m", TRUTH, {"truth": {**TRUTH, "stiffness": 30.0}}),
    ):
        yield attack("another machine, noisy force", name, truth,
                     partial(record, noise=0.1, **more), repetitions=4)  # fmt: skip
    for stiffness in (0.0, 200.0, 1e4, 1e5):
        truth = {**TRUTH, "stiffness": stiffness}
        options = {"stiffness": "estimate"}
        yield attack("spring asked for", f"{stiffness:g} N/m", truth,
                     partial(record, truth=truth), options=options,
                     scales={**width, "stiffness": max(stiffness, 500.0)},
                     repetitions=4)  # fmt: skip
    yield attack("everything asked for", "no spring, no dead time",
                 {**TRUTH, "stiffness": 0.0, "dead_time": 0.0}, record,
                 options={"stiffness": "estimate", "dead_time": "estimate"},
                 scales={**width, "stiffness": 500.0, "dead_time": 0.03},
                 repetitions=4)  # fmt: skip
    late = {**TRUTH, "dead_time": 0.03}
    yield attack("everything asked for", "dead time 30 ms", late, partial(record, truth=late),
                 options={"dead_time": "estimate"}, repetitions=3)  # fmt: skip
