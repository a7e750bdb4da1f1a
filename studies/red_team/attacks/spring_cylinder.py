"""Attacks on the spring cylinder: noise of position and pressure, offsets, drift, one stroke."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np
from scipy.signal import lfilter

from ..attack import Array, Attack, Recording, cramer_rao, with_play

UNITS = {"command": "V", "pressure": "Pa", "position": "m", "force": "N", "velocity": "m/s"}
TRUTH = {
    "pressure_gain": 31.0, "stiffness": 850.0, "preload": 14.0,
    "coulomb_loading": 5.0, "coulomb_unloading": 5.0, "viscous": 60.0,
}  # fmt: skip
BY_PRESSURE = {"area": 3.1e-4, **{k: v for k, v in TRUTH.items() if k != "pressure_gain"}}
Spoil = Callable[[Recording, np.random.Generator], Recording]


def drives(
    rng: np.random.Generator, n: int, step: float, stroke: float, period: float
) -> tuple[Array, Array, Array, Array]:
    """Triangular command from 0 to 5 V, a slow stroke, its speed and the motion state."""
    t = np.arange(n) * step
    phase = (t / period) % 1.0
    u = 5.0 * np.minimum(2.0 * phase, 2.0 - 2.0 * phase)
    a, b = rng.uniform(0.0, 2.0 * np.pi, 2)
    w1, w2 = 2.0 * np.pi / (2.7 * period), 2.0 * np.pi / (0.63 * period)
    x = stroke * (0.5 + 0.3 * np.sin(w1 * t + a) + 0.2 * np.sin(w2 * t + b))
    v = stroke * (0.3 * w1 * np.cos(w1 * t + a) + 0.2 * w2 * np.cos(w2 * t + b))
    way = np.sign(np.diff(u, prepend=-1.0))  # at a turning point still that of the way there
    return u, x, v, way


def force(p: Mapping[str, float], u: Array, x: Array, v: Array, s: Array) -> Array:
    """Force of the rod."""
    gain = p.get("pressure_gain", p.get("area", 0.0))
    lost = np.where(s > 0.0, p["coulomb_loading"], -p["coulomb_unloading"])
    if "stribeck" in p:
        fall = (np.abs(v) / p["stribeck_speed"]) ** p.get("shape", 2.0)
        lost = lost + s * p["stribeck"] * np.exp(-fall)
    return gain * u - p["stiffness"] * x - p["preload"] - lost - p["viscous"] * v


def log(
    rng: np.random.Generator,
    *,
    p: Mapping[str, float] = TRUTH,
    n: int = 4000,
    step: float = 0.01,
    stroke: float = 0.03,
    period: float = 4.0,
    sigma: float = 0.3,
    noise: Mapping[str, float] | None = None,
    velocity: bool = False,
    spoil: Spoil | None = None,
) -> list[Recording]:
    """One log; ``noise`` gives the standard deviation on a role [SI]."""
    u, x, v, s = drives(rng, n, step, stroke, period)
    drive = "command"
    if "area" in p:
        drive, u = "pressure", 1e5 * u
    y = force(p, u, x, v, s) + sigma * rng.standard_normal(n)
    r: Recording = {"time": np.arange(n) * step, drive: u, "position": x, "force": y}
    if velocity:
        r = {**r, "velocity": v}
    for role, size in (noise or {}).items():
        r = {**r, role: r[role] + size * rng.standard_normal(n)}
    return [spoil(r, rng) if spoil else r]


def _spoil(r: Recording, rng: np.random.Generator, what: str) -> Recording:
    y, x, n = r["force"], r["position"], r["force"].size
    size = float(np.ptp(y))
    if what == "drift":
        y = y + 0.05 * size * np.linspace(0.0, 1.0, n)
    elif what == "clipped force":
        y = np.clip(y, None, float(np.quantile(y, 0.85)))
    elif what == "coarse position":
        x = np.round(x / 5e-4) * 5e-4
    elif what == "late force":
        y = np.append(np.full(10, y[0]), y[:-10])
    elif what == "glitch":
        y = y.copy()
        y[n // 2] = 50.0 * size
    elif what == "slow position":
        x = x[np.arange(n) // 3 * 3]
    elif what == "play of the position":
        x = with_play(x, 1e-3)
    elif what == "curved valve":
        y = y + 31.0 * 0.1 * (1.0 - (r["command"] / 2.5 - 1.0) ** 2)
    elif what == "progressive spring":
        y = y - 8e3 * ((x - x.mean()) ** 2 - x.var())  # as stiff on average
    elif what == "return with twice the friction":
        v = np.gradient(x, r["time"])
        y = y + np.where(v < 0.0, 60.0 * np.abs(v), 0.0)
    elif what == "valve behind by 10 ms":
        u, h = r["command"], float(r["time"][1])
        late = lfilter([1.0 - np.exp(-h / 0.01)], [1.0, -np.exp(-h / 0.01)], u)
        y = y + 31.0 * (late - u)
    elif what == "vibration":
        # real motion at half the sampling rate: nothing is wrong with the position
        shake = 2e-4 * rng.standard_normal(n)
        x, y = x + shake, y - 850.0 * shake
    elif what == "lost rows":
        kept = rng.uniform(size=n) > 0.05
        return {role: q[kept] for role, q in r.items()}
    elif what == "filtered noise":
        e = rng.standard_normal(n)
        for k in range(1, n):
            e[k] += 0.9 * e[k - 1]
        y = y + 0.5 * e
    return {**r, "force": y, "position": x}


def _bounds(
    p: Mapping[str, float], sigma: float = 0.3, stroke: float = 0.03
) -> dict[str, float]:  # fmt: skip
    u, x, v, s = drives(np.random.default_rng(1), 4000, 0.01, stroke, 4.0)
    free = {k: q for k, q in p.items() if k != "coulomb_unloading"}

    def simulate(q: Mapping[str, float]) -> list[Array]:
        u2 = 1e5 * u if "area" in q else u
        return [force({**q, "coulomb_unloading": q["coulomb_loading"]}, u2, x, v, s)]

    found = cramer_rao(simulate, free, sigma, lambda n: np.zeros((n, 1)))
    return {**found, "coulomb_unloading": found["coulomb_loading"]}


def _attack(group: str, name: str, truth: Mapping[str, float] = TRUTH, **more: object) -> Attack:
    own = {k: more.pop(k) for k in ("options", "hold", "bounds", "fixed", "repetitions", "beyond")
           if k in more}  # fmt: skip
    return Attack("spring-cylinder", group, name, truth, partial(log, p=truth, **more), UNITS,
                  **own)  # fmt: skip


def attacks() -> Iterator[Attack]:
    """All of them."""
    yield _attack("right model", "command", bounds=_bounds(TRUTH), repetitions=10)
    yield _attack("right model", "pressure", BY_PRESSURE, bounds=_bounds(BY_PRESSURE),
                  repetitions=5)  # fmt: skip
    yield _attack("right model", "velocity recorded", velocity=True, repetitions=3)
    for size in (2e-5, 1e-4, 2e-4, 5e-4):
        for stroke in (0.003, 0.03):
            yield _attack("noise of the position", f"{1e3 * size:g} mm, stroke {1e3 * stroke:g} mm",
                          noise={"position": size}, stroke=stroke, repetitions=4)  # fmt: skip
    yield _attack("noise of the position", "0.2 mm, velocity recorded", noise={"position": 2e-4},
                  velocity=True, stroke=0.003, repetitions=3)  # fmt: skip
    for size in (1e3, 1e4, 5e4):
        yield _attack("noise of the pressure", f"{1e-5 * size:g} bar", BY_PRESSURE,
                      noise={"pressure": size}, repetitions=4)  # fmt: skip
    yield _attack("noise of the pressure", "and of the position", BY_PRESSURE,
                  noise={"pressure": 1e4, "position": 2e-4}, stroke=0.003,
                  repetitions=3)  # fmt: skip
    for what in (
        "drift", "clipped force", "coarse position", "late force", "glitch",
        "progressive spring", "vibration", "lost rows", "filtered noise",
        "slow position", "play of the position", "curved valve",
        "return with twice the friction",
    ):  # fmt: skip
        yield _attack("recording", what, spoil=partial(_spoil, what=what), repetitions=3)
    yield _attack("recording", "vibration, stroke 3 mm", stroke=0.003,
                  spoil=partial(_spoil, what="vibration"), repetitions=3)  # fmt: skip
    yield _attack("recording", "valve behind by 10 ms", repetitions=3,
                  spoil=partial(_spoil, what="valve behind by 10 ms"),
                  beyond="At one rate of the command a lag is a hysteresis.")  # fmt: skip
    uneven = {**TRUTH, "coulomb_unloading": 0.8 * TRUTH["coulomb_unloading"]}
    yield _attack("recording", "friction by direction", uneven, repetitions=2,
                  beyond="Friction that differs by direction is preload.")  # fmt: skip
    rising = {**TRUTH, "stribeck": 2.0, "stribeck_speed": 0.004}
    wanted = {"stribeck": "estimate"}
    yield _attack("Stribeck", "2 N, 4 mm/s", rising, repetitions=2)
    yield _attack("Stribeck asked for", "2 N, 4 mm/s", rising, options=wanted,
                  bounds=_bounds(rising), repetitions=3)  # fmt: skip
    noises = (("position", 2e-5, "mm"), ("position", 1e-4, "mm"), ("velocity", 1e-3, "mm/s"))
    for role, size, unit in noises:
        name = f"2 N, 4 mm/s, noise of the {role}, {1e3 * size:g} {unit}"
        yield _attack("Stribeck asked for", name, rising, options=wanted, noise={role: size},
                      velocity=role == "velocity",
                      repetitions=2)  # fmt: skip
    for shape, speed in ((1.0, 0.004), (1.0, 0.01), (0.5, 0.01), (4.0, 0.01)):
        other = {**rising, "stribeck_speed": speed, "shape": shape}
        name = f"2 N, {1e3 * speed:g} mm/s, shape {shape:g}"
        yield _attack("Stribeck asked for", name, other, options=wanted, repetitions=4)
    yield _attack("Stribeck asked for", "stroke 1 mm", rising, options=wanted, stroke=1e-3)
    yield _attack("Stribeck asked for", "there is none", options=wanted, repetitions=2)
    yield _attack("recording", "half a cycle", n=200, repetitions=3)
    yield _attack("recording", "one cycle", n=400, repetitions=3)
    yield _attack("wrong number given", "area 10 % off", BY_PRESSURE,
                  fixed={"area": 3.4e-4}, repetitions=2)  # fmt: skip
