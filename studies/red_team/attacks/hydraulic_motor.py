"""Attacks on the hydraulic motor: no saturation, other holds, jitter, lags, noisy commands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np

from ..attack import Array, Attack, Recording, cramer_rao, with_play

UNITS = {"command": "A", "speed": "rad/s"}
TRUTH = {
    "dead_zone": 0.09, "gain": 130.0, "curvature": 0.5, "saturation_command": 0.85,
    "hysteresis": 0.04, "time_constant": 0.08, "dead_time": 0.013,
}  # fmt: skip
OPEN = {k: v for k, v in TRUTH.items() if k != "saturation_command"}
FINE = 40  # points between two samples where a command moves on straight lines
Spoil = Callable[[Recording, np.random.Generator], Recording]


def static(w: Array, p: Mapping[str, float]) -> Array:
    """Steady speed over the spool's command.

    Besides what the model has: ``soft`` edges of the dead zone [A], another ``power`` of what the
    spool opens, a dead zone and a gain that are larger by some part in the other direction.
    """
    other = np.where(w < 0.0, 1.0, 0.0)
    edge = p["dead_zone"] * (1.0 + p.get("dead_zone_more", 0.0) * other)
    x = np.minimum(np.abs(w), p.get("saturation_command", np.inf)) - edge
    soft, k = p.get("soft", 0.0), p["curvature"]
    x = soft * np.logaddexp(0.0, x / soft) if soft else np.maximum(x, 0.0)
    x = x ** p.get("power", 1.0)
    if "round" in p:  # saturates by and by
        return np.asarray(np.sign(w) * p["gain"] * p["round"] * np.tanh(x / p["round"]))
    bent = x if k == 0.0 else (1.0 - np.exp(-k * x)) / k
    return np.asarray(np.sign(w) * p["gain"] * (1.0 + p.get("gain_more", 0.0) * other) * bent)


def simulate(
    p: Mapping[str, float], t: Array, u: Array, moves: bool = False, second: float = 0.0
) -> Array:
    """Speed at the instants ``t`` of a command with values ``u`` there.

    The steady speed is held, or straight on a grid ``FINE`` times finer than the sampling; the
    lag and a second one [s] behind it are followed from event to event by their exact solution.
    """
    at, now = t, u
    if moves:
        at = np.unique(np.concatenate([t[:-1] + k / FINE * np.diff(t) for k in range(FINE)]
                                      + [t[-1:]]))  # fmt: skip
        now = np.interp(at, t, u)
    target = static(with_play(now, p["hysteresis"]), p)
    slope = np.append(np.diff(target) / np.diff(at), 0.0) if moves else np.zeros(at.size)
    event = np.concatenate((at + p["dead_time"], t))
    order = np.argsort(event, kind="stable")
    out, lags = np.full(t.size, target[0]), (p["time_constant"], second)
    level, rate, since = float(target[0]), 0.0, float(t[0])
    state, clock = [level, level], float(t[0])
    for k in order:
        h = float(event[k]) - clock
        if h > 0.0:
            state = _advance(state, level + rate * (clock - since), rate, h, lags)
            clock = float(event[k])
        if k < at.size:
            level, rate, since = float(target[k]), float(slope[k]), clock
        else:
            out[k - at.size] = state[1] if second > 0.0 else state[0]
    return out


def _advance(
    state: list[float], level: float, rate: float, h: float, lags: tuple[float, float]
) -> list[float]:
    """Two lags in a row after ``h`` of a target ``level + rate s``."""
    a, b = lags
    c = state[0] - (level - rate * a)
    first = level + rate * (h - a) + c * np.exp(-h / a)
    if b <= 0.0:
        return [first, first]
    share = a / (a - b)  # response of the second lag to c exp(-s / a)
    d = state[1] - (level - rate * (a + b)) - c * share
    last = level + rate * (h - a - b) + c * share * np.exp(-h / a) + d * np.exp(-h / b)
    return [first, last]


def staircase(rng: np.random.Generator, n: int, step: float, top: float) -> Array:
    """Stairs up and down over both directions, then random levels, held 0.3 to 0.6 s."""
    ways = np.concatenate([np.linspace(0, 1, 8), np.linspace(1, -1, 15), np.linspace(-1, 0, 8)])
    levels = iter(top * np.concatenate((ways, rng.uniform(-1.0, 1.0, n))))
    u, k = np.zeros(n), round(0.3 / step)
    while k < n:
        hold = round(rng.uniform(0.3, 0.6) / step)
        u[k : k + hold] = next(levels)
        k += hold
    return u


def ramps(rng: np.random.Generator, n: int, step: float, top: float) -> Array:
    """Straight lines between the levels of a staircase."""
    u = staircase(rng, n, step, top)
    corners = np.concatenate(([0], np.flatnonzero(np.diff(u)) + 1, [n - 1]))
    return np.interp(np.arange(n), corners, u[corners])


def log(
    rng: np.random.Generator,
    *,
    p: Mapping[str, float] = TRUTH,
    step: float = 0.02,
    n: int = 1500,
    sigma: float = 0.5,
    top: float = 1.0,
    jitter: float = 0.0,
    drive: Callable[[np.random.Generator, int, float, float], Array] = staircase,
    spoil: Spoil | None = None,
    moves: bool = False,
    second: float = 0.0,
) -> list[Recording]:
    """One log of ``n`` samples every ``step``."""
    u = drive(rng, n, step, top)
    t = np.arange(n) * step
    # never by half a step, so that time does not go backwards
    t[1:] += step * np.clip(jitter * rng.standard_normal(n - 1), -0.45, 0.45)
    y = simulate(p, t, u, moves, second) + sigma * rng.standard_normal(n)
    recording: Recording = {"time": t - t[0], "command": u, "speed": y}
    return [spoil(recording, rng) if spoil else recording]


def _noisy_command(r: Recording, rng: np.random.Generator, share: float) -> Recording:
    u = r["command"]
    return {**r, "command": u + share * float(np.ptp(u)) * rng.standard_normal(u.size)}


def _drop(r: Recording, rng: np.random.Generator, share: float) -> Recording:
    kept = rng.uniform(size=r["time"].size) > share
    kept[[0, -1]] = True
    return {role: x[kept] for role, x in r.items()}


def _add(r: Recording, rng: np.random.Generator, what: str) -> Recording:
    y, n = r["speed"], r["speed"].size
    size = float(np.ptp(y))
    if what == "offset":
        y = y + 0.05 * size
    elif what == "drift":
        y = y + 0.05 * size * np.linspace(0.0, 1.0, n)
    elif what == "clipped":
        y = np.clip(y, *(0.7 * np.array([y.min(), y.max()])))
    elif what == "glitch":
        y = y.copy()
        y[n // 3] = 20.0 * size
    elif what == "one direction":
        y = np.abs(y)
    elif what == "coarse":
        y = np.round(y / (size / 100.0)) * size / 100.0
    elif what == "filtered noise":
        e = rng.standard_normal(n)
        for k in range(1, n):
            e[k] += 0.9 * e[k - 1]
        y = y + 0.5 * e
    return {**r, "speed": y}


def _bounds(
    p: Mapping[str, float], top: float = 1.0, moves: bool = False, sigma: float = 0.5,
    step: float = 0.02, n: int = 1500,
) -> dict[str, float]:  # fmt: skip
    rng = np.random.default_rng(1)
    u = (ramps if moves else staircase)(rng, n, step, top)
    t = np.arange(n) * step
    return cramer_rao(lambda q: [simulate(q, t, u, moves)], p, sigma)


def _attack(group: str, name: str, truth: Mapping[str, float] = TRUTH, **more: object) -> Attack:
    own = {k: more.pop(k) for k in ("options", "hold", "bounds", "repetitions") if k in more}
    return Attack(
        "hydraulic-motor", group, name, truth, partial(log, **more), UNITS,
        scales={"dead_zone": 0.1, "hysteresis": 0.05, "dead_time": 0.02, "curvature": 1.0}, **own,
    )  # fmt: skip


def attacks() -> Iterator[Attack]:
    """All of them."""
    yield _attack("right model", "stairs", bounds=partial(_bounds, TRUTH), repetitions=10)
    for factor in (0.05, 20.0):  # a small motor and a winch
        p = {**TRUTH, "time_constant": 0.08 * factor, "dead_time": 0.013 * factor}
        yield _attack("right model", f"time constant {0.08 * factor:g} s", p, p=p,
                      drive=partial(_scaled, factor=factor), step=0.02 * factor,
                      repetitions=2)  # fmt: skip
    for top in (0.8, 0.5, 1.0):
        p = {**OPEN, "curvature": 1.0} if top == 1.0 else OPEN
        yield _attack("no saturation", f"up to {top:g} A, curvature {p['curvature']:g}", p,
                      p=p, top=top, bounds=partial(_bounds, p, top), repetitions=5)  # fmt: skip
    yield _attack("no saturation", "straight", {**OPEN, "curvature": 0.0},
                  p={**OPEN, "curvature": 0.0}, repetitions=5)  # fmt: skip
    yield _attack("moving command", "as foh", moves=True, drive=ramps, hold={"command": "foh"},
                  bounds=partial(_bounds, TRUTH, moves=True), repetitions=5)  # fmt: skip
    yield _attack("moving command", "sweep as foh", moves=True, drive=_sweep, step=0.04,
                  hold={"command": "foh"}, repetitions=4)  # fmt: skip
    yield _attack("moving command", "not said", moves=True, drive=ramps, repetitions=3)
    for name, more in (
        ("3 times the sampling", {"time_constant": 0.007}),
        ("half the log", {"time_constant": 12.0}), ("long dead time", {"dead_time": 0.8}),
        ("wide dead zone", {"dead_zone": 0.6}), ("bent", {"curvature": 5.0}),
        ("wide hysteresis", {"hysteresis": 0.3}), ("early saturation", {"saturation_command": 0.3}),
    ):  # fmt: skip
        p = {**TRUTH, **more}
        yield _attack("at the edge of the search", name, p, p=p, repetitions=2)
    for jitter in (0.01, 0.04, 0.2):
        yield _attack("uneven sampling", f"jitter {100 * jitter:g} %", jitter=jitter,
                      bounds=partial(_bounds, TRUTH), repetitions=3)  # fmt: skip
    for share in (0.02, 0.1):
        yield _attack("uneven sampling", f"{100 * share:g} % of rows lost",
                      spoil=partial(_drop, share=share), repetitions=3)  # fmt: skip
    for second in (0.005, 0.02, 0.06):
        yield _attack("second lag", f"{1e3 * second:g} ms", second=second, repetitions=3)
    for share in (5e-5, 5e-4, 2e-3, 1e-2):
        yield _attack("noise of the command", f"{100 * share:g} % of range",
                      spoil=partial(_noisy_command, share=share), repetitions=3)  # fmt: skip
    yield _attack("noise of the command", "moving, 0.1 % of range", moves=True, drive=ramps,
                  hold={"command": "foh"}, spoil=partial(_noisy_command, share=1e-3),
                  repetitions=3)  # fmt: skip
    for what in (
        "offset",
        "drift",
        "clipped",
        "glitch",
        "one direction",
        "coarse",
        "filtered noise",
    ):
        yield _attack("sensor", what, spoil=partial(_add, what=what), repetitions=2)
    for name, more, unlike in (
        ("opens softly", {"soft": 0.05}, ()),
        ("square root", {"power": 0.8}, ("gain", "curvature")),
        ("saturates by and by", {"round": 0.76}, ("curvature", "saturation_command")),
        ("dead zone 10 % wider one way", {"dead_zone_more": 0.1}, ()),
        ("gain 5 % higher one way", {"gain_more": 0.05}, ()),
    ):
        truth = {k: v for k, v in TRUTH.items() if k not in unlike}
        yield _attack("valve of another shape", name, truth, p={**TRUTH, **more}, repetitions=4)
    none = {**TRUTH, "hysteresis": 0.0}
    yield _attack("absent", "no hysteresis", none, p=none, repetitions=3)
    none = {**TRUTH, "dead_time": 0.0}
    yield _attack("absent", "no dead time", none, p=none, repetitions=3)
    yield _attack("absent", "dead time not asked for", options={"dead_time": "none"},
                  repetitions=3)  # fmt: skip


def _scaled(rng: np.random.Generator, n: int, step: float, top: float, factor: float) -> Array:
    return staircase(rng, n, step / factor, top)


def _sweep(rng: np.random.Generator, n: int, step: float, top: float) -> Array:
    t = np.arange(n) * step
    return top * np.sin(2.0 * np.pi * (0.3 * t + (1.0 / 60.0) * t**2) + rng.uniform(-0.2, 0.2))
