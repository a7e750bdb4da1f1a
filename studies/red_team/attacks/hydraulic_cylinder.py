"""Attacks on the hydraulic cylinder: dry friction, wrong numbers given, clocks, leaks, sensors."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ..attack import Array, Attack, Recording, cramer_rao

UNITS = {"command": "V", "pressure_1": "Pa", "pressure_2": "Pa", "position": "m"}
CHANNELS = ("pressure_1", "pressure_2", "position")
State = tuple[float, float, float, float]


@dataclass(frozen=True)
class Plant:
    """A machine: what is given to the fit, what is estimated, and what the fit does not know.

    ``stiction`` is what the friction has above its Coulomb level at rest [N], gone at a few
    times ``stribeck`` [m/s] as ``exp(-(v / stribeck)^shape)``; ``leakage`` [m3/(s Pa)] passes the
    piston. The edges of the valve are ``soft`` by so many volts, and its opening is ``bent``: by
    that share more for every volt.
    """

    area_1: float = 4.91e-4
    area_2: float = 2.37e-4
    dead_volume_1: float = 1.2446e-4
    dead_volume_2: float = 9.906e-5
    mass: float = 14.54
    supply: float = 50e5
    tank: float = 0.0
    gain: float = 2.137e-8
    losses: tuple[float, float, float, float] = (5.68e10, 4.35e10, 3.59e10, 3.59e10)
    bulk_modulus: float = 1e9
    edges: tuple[float, float] = (-0.12, 0.18)
    viscous: float = 3600.0
    coulomb: float = 35.0
    stiction: float = 0.0
    stribeck: float = 0.01
    shape: float = 1.0
    leakage: float = 0.0
    soft: float = 0.0
    bent: float = 0.0
    middle: float = 0.1

    def given(self, **changed: float) -> dict[str, float]:
        """Options of the fit, some of them multiplied by a factor."""
        names = ("area_1", "area_2", "dead_volume_1", "dead_volume_2", "mass")
        options = {n: getattr(self, n) for n in names}
        options |= {"supply_pressure": self.supply, "tank_pressure": self.tank}
        return {n: v * changed.get(n, 1.0) for n, v in options.items() if v}

    def truth(self) -> dict[str, float]:
        """What the fit should find."""
        return {
            **({} if self.bent else {"valve_gain_1": self.gain, "valve_gain_2": self.gain}),
            **{f"line_loss_{i}": r for i, r in enumerate(self.losses, start=1)},
            "bulk_modulus": self.bulk_modulus,
            "dead_zone_negative": self.edges[0], "dead_zone_positive": self.edges[1],
            "viscous": self.viscous, "coulomb": self.coulomb,
            **({"stribeck": self.stiction, "stribeck_speed": self.stribeck} if self.shape == 2.0
               else {}),
        }  # fmt: skip


def _orifice(k: float, drop: float, loss: float) -> float:
    """``q = k sqrt(drop - loss q)``, solved for the root of the drop over the edge."""
    x = 0.5 * (math.sqrt((loss * k) ** 2 + 4.0 * abs(drop)) - loss * k)
    return math.copysign(k * x, drop)


def _bend(x: float) -> float:
    """``ln(1 + e^x)``, straight far from zero."""
    return max(x, 0.0) + math.log1p(math.exp(-abs(x)))


def _friction(m: Plant, v: float) -> float:
    """Level of the dry friction at a speed [N]."""
    if not m.stiction:
        return m.coulomb
    return m.coulomb + m.stiction * math.exp(-((abs(v) / m.stribeck) ** m.shape))


def _rates(m: Plant, x: State, u: float, way: float) -> State:
    p1, p2, y, v = x
    low, high = m.edges
    e = u - high if u > high else u - low if u < low else 0.0
    if m.soft:
        e = m.soft * (_bend((u - high) / m.soft) - _bend((low - u) / m.soft))
    e *= 1.0 + m.bent * abs(e)
    k = m.gain * abs(e)
    r1, r2, r3, r4 = m.losses
    if e >= 0.0:
        q1, q2 = _orifice(k, m.supply - p1, r1), _orifice(k, p2 - m.tank, r4)
    else:
        q1, q2 = -_orifice(k, p1 - m.tank, r3), -_orifice(k, m.supply - p2, r2)
    leak = m.leakage * (p1 - p2)
    d1 = m.bulk_modulus / (m.dead_volume_1 + m.area_1 * y) * (q1 - leak - m.area_1 * v)
    d2 = -m.bulk_modulus / (m.dead_volume_2 - m.area_2 * y) * (q2 - leak - m.area_2 * v)
    if way == 0.0:
        return d1, d2, 0.0, 0.0
    push = p1 * m.area_1 - p2 * m.area_2
    return d1, d2, v, (push - m.viscous * v - way * _friction(m, v)) / m.mass


def _moved(m: Plant, x: State, u: float, h: float, way: float) -> State:
    """A Runge-Kutta step without events."""
    a = _rates(m, x, u, way)
    b = _rates(m, _add(x, a, 0.5 * h), u, way)
    c = _rates(m, _add(x, b, 0.5 * h), u, way)
    d = _rates(m, _add(x, c, h), u, way)
    return tuple(s + h / 6.0 * (i + 2.0 * (j + k) + w) for s, i, j, k, w in zip(x, a, b, c, d))


def _add(x: State, rate: State, h: float) -> State:
    return tuple(s + h * r for s, r in zip(x, rate))


def _way(m: Plant, x: State) -> float:
    """Way that a piston at rest takes."""
    push = x[0] * m.area_1 - x[1] * m.area_2
    return math.copysign(1.0, push) if abs(push) > _friction(m, 0.0) else 0.0


def _over(m: Plant, x: State, way: float) -> bool:
    """Whether the piston has gone past a stop, or past its break-away."""
    return way * x[3] < 0.0 if way else _way(m, x) != 0.0


def _advance(m: Plant, x: State, u: float, h: float, way: float) -> tuple[State, float]:
    """A step, halved around every event until that is known to 1e-12 of it."""
    left = h
    for _ in range(20):
        after = _moved(m, x, u, left, way)
        if not _over(m, after, way):
            return after, way
        low, high = 0.0, left
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (
                (low, middle) if _over(m, _moved(m, x, u, middle, way), way) else (middle, high)
            )
        x = _moved(m, x, u, high, way)
        x, left = (x[0], x[1], x[2], 0.0), left - high
        way = _way(m, x)
    return x, way


def simulate(
    m: Plant,
    time: Array,
    command: Array,
    feedback: Callable[[int, float], float] | None = None,
    fine: int = 8,
) -> Array:
    """Pressures and position at the instants, ``(n, 3)``; the command is held between them.

    ``feedback`` gives the command from index and position instead, and writes it.
    """
    share = 0.5 * m.supply * (m.area_1 + m.area_2) / (m.area_1**2 + m.area_2**2)
    x: State = (share * m.area_2, share * m.area_1, m.middle, 0.0)
    way, rows = 0.0, np.empty((time.size, 3))
    for k, step in enumerate(np.append(np.diff(time), 0.0)):
        rows[k] = x[:3]
        if feedback is not None:
            command[k] = feedback(k, x[2])
        for _ in range(fine if step else 0):
            x, way = _advance(m, x, float(command[k]), step / fine, way)
    return rows


def commands(rng: np.random.Generator, n: int, volts: float, edges: tuple[float, float]) -> Array:
    """Half of it steps of either sign beyond the edges, half slow passes through both."""
    low, high = edges
    u, k, sign = np.zeros(n), 20, 1.0
    while k < n // 2:
        size = math.exp(rng.uniform(math.log(0.06 * volts), math.log(volts)))
        hold = int(rng.uniform(40, 80))
        for level in (
            (high if sign > 0 else low) + sign * size,
            (low if sign > 0 else high) - sign * size,
        ):
            u[k : k + hold] = level
            k += hold
        sign = -sign
    phase = np.arange(n - n // 2) / 250.0 + 0.25
    reach = 0.08 * volts * (4.0 * np.abs(phase % 1.0 - 0.5) - 1.0)
    u[n // 2 :] = 0.5 * (low + high) + reach + 0.5 * (high - low) * np.sign(reach) * 0.9
    return u


def record(
    rng: np.random.Generator,
    *,
    plant: Plant = Plant(),
    step: float = 1e-3,
    n: int = 1000,
    volts: float = 6.0,
    noise: tuple[float, float] = (2e4, 5e-5),
    late: float = 0.0,
    jitter: float = 0.0,
    lost: float = 0.0,
    logs: int = 1,
    feedback: float = 0.0,
    other: Plant | None = None,
    spoil: Callable[[Recording, np.random.Generator], Recording] | None = None,
) -> list[Recording]:
    out = []
    for index in range(logs):
        m = other if other is not None and index == logs - 1 else plant
        time = step * np.arange(n)
        time[1:-1] += jitter * step * rng.uniform(-0.5, 0.5, n - 2)
        u = commands(rng, n, volts, m.edges)
        if feedback:
            wanted = m.middle + np.cumsum(u) * 5e-5 * step / 1e-3

            def control(k: int, y: float, wanted: Array = wanted) -> float:
                error = wanted[k] - y - noise[1] * rng.standard_normal()
                return float(np.clip(feedback * error, -8.0, 8.0))

            rows = simulate(m, time, u, control)
        elif late:
            grid = np.union1d(time, time + late)
            acts = u[np.clip(np.searchsorted(time + late, grid, side="right") - 1, 0, None)]
            rows = simulate(m, grid, acts, fine=4)[np.searchsorted(grid, time)]
        else:
            rows = simulate(m, time, u)
        noisy = rows + rng.standard_normal(rows.shape) * [noise[0], noise[0], noise[1]]
        recording: Recording = {"time": time, "command": u, **dict(zip(CHANNELS, noisy.T))}
        if lost:
            kept = np.sort(rng.permutation(n)[: round((1.0 - lost) * n)])
            recording = {role: values[kept] for role, values in recording.items()}
        out.append(spoil(recording, rng) if spoil else recording)
    return out


def strokes(
    rng: np.random.Generator, *, plant: Plant = Plant(), code: float = 1e-5, logs: int = 2
) -> list[Recording]:
    """Strokes at steady commands with rests between, read by an encoder of steps ``code`` [m]."""
    out = []
    for _ in range(logs):
        levels = np.tile([1.0, 0.0, -1.0, 0.0], 4)[:14] * rng.uniform(0.3, 2.5, 14)
        time, u = 1e-3 * np.arange(2000), np.repeat(np.append(levels, 0.0), 150)[:2000]
        rows = simulate(plant, time, u)
        rows[:, :2] += 5e3 * rng.standard_normal((time.size, 2))
        rows[:, 2] = code * np.round(rows[:, 2] / code)
        out.append({"time": time, "command": u, **dict(zip(CHANNELS, rows.T))})
    return out


def _lagging(recording: Recording, rng: np.random.Generator, role: str, lag: float) -> Recording:
    """A channel behind a filter of the first order."""
    x, share = recording[role].copy(), 1.0 - math.exp(-1e-3 / lag)
    for k in range(1, x.size):
        x[k] = x[k - 1] + share * (x[k] - x[k - 1])
    return {**recording, role: x}


def _rounded(recording: Recording, rng: np.random.Generator, **steps: float) -> Recording:
    return {r: np.round(x / steps[r]) * steps[r] if r in steps else x for r, x in recording.items()}


def _coloured(recording: Recording, rng: np.random.Generator, size: float) -> Recording:
    """Autocorrelated noise on both pressures."""
    out = dict(recording)
    for role in CHANNELS[:2]:
        e = size * math.sqrt(1.0 - 0.8**2) * rng.standard_normal(recording[role].size)
        for k in range(1, e.size):
            e[k] += 0.8 * e[k - 1]
        out[role] = recording[role] + e
    return out


def _glitch(recording: Recording, rng: np.random.Generator, role: str, factor: float) -> Recording:
    x = recording[role].copy()
    x[x.size // 3] *= factor
    return {**recording, role: x}


def _changed(recording: Recording, rng: np.random.Generator, role: str, **how: float) -> Recording:
    """A channel with a wrong scale, an offset, or a clipped one."""
    x = recording[role] * how.get("scale", 1.0) + how.get("offset", 0.0)
    return {**recording, role: np.minimum(x, how.get("most", np.inf))}


MICRO = Plant(area_1=2e-5, area_2=1.5e-5, dead_volume_1=1.5e-6, dead_volume_2=1.5e-6, mass=0.3,
              supply=80e5, gain=8e-10, losses=(1e12, 1.2e12, 0.9e12, 1.1e12), viscous=120.0,
              coulomb=8.0, middle=0.01)  # fmt: skip
PRESS = Plant(area_1=2e-2, area_2=1.4e-2, dead_volume_1=8e-3, dead_volume_2=8e-3, mass=1500.0,
              supply=200e5, gain=4e-7, losses=(8e8, 9e8, 7e8, 6e8), viscous=6e4, coulomb=5e3,
              bulk_modulus=1.3e9, middle=0.15)  # fmt: skip
WIDE = replace(Plant(), edges=(-2.2, 2.5))


def _bounds(
    plant: Plant, *, step: float = 1e-3, n: int = 1000, volts: float = 6.0,
    noise: tuple[float, float] = (2e4, 5e-5),
) -> dict[str, float]:  # fmt: skip
    """Cramér-Rao bound of one log."""
    time, u = step * np.arange(n), commands(np.random.default_rng(1), n, volts, plant.edges)

    def outputs(p: Mapping[str, float]) -> list[Array]:
        m = replace(
            plant, losses=tuple(p[f"line_loss_{i}"] for i in (1, 2, 3, 4)),
            gain=p["valve_gain_1"], bulk_modulus=p["bulk_modulus"], viscous=p["viscous"],
            edges=(p["dead_zone_negative"], p["dead_zone_positive"]), coulomb=p["coulomb"],
            stiction=p.get("stribeck", plant.stiction),
            stribeck=p.get("stribeck_speed", plant.stribeck),
        )  # fmt: skip
        return list((simulate(m, time, u, fine=2) / [noise[0], noise[0], noise[1]]).T)

    truth = {n: v for n, v in plant.truth().items() if n != "valve_gain_2"}
    return cramer_rao(outputs, truth, 1.0)


def attacks() -> Iterator[Attack]:
    """All of them."""

    def attack(
        group: str, name: str, plant: Plant = Plant(), *, repetitions: int = 2,
        changed: Mapping[str, float] | None = None, options: Mapping[str, str] | None = None,
        bounds: Callable[[], Mapping[str, float]] | None = None, **how: object,
    ) -> Attack:  # fmt: skip
        low, high = plant.edges
        recorder = partial(record, plant=plant, **how)
        given = {**plant.given(**(changed or {})), **(options or {})}
        return Attack(
            "hydraulic-cylinder", group, name, plant.truth(), recorder, UNITS, options=given,
            scales=dict.fromkeys(("dead_zone_negative", "dead_zone_positive"), high - low),
            bounds=bounds or {}, repetitions=repetitions,
        )  # fmt: skip

    for coulomb, times in ((35.0, 8), (200.0, 4), (900.0, 8)):
        plant = replace(Plant(), coulomb=coulomb)
        yield attack("right model", f"{coulomb:g} N", plant, repetitions=times,
                     bounds=partial(_bounds, plant))  # fmt: skip
    usual: list[tuple[str, Plant, dict[str, Any]]] = [
        ("micro-actuator, 5 kHz", MICRO,
         {"step": 2e-4, "volts": 5.0, "noise": (3e4, 5e-6), "n": 1500}),
        ("press, 500 Hz", PRESS, {"step": 2e-3, "noise": (6e4, 2e-4)}),
        ("wide dead zone", WIDE, {}),
    ]  # fmt: skip
    for name, plant, how in usual:
        yield attack("right model", name, plant, bounds=partial(_bounds, plant, **how), **how)
    yield attack("right model", "three logs", logs=3)
    yield attack("right model", "closed loop", feedback=1000.0)
    yield replace(attack("right model", "encoder of 10 um", repetitions=4), record=strokes)
    yield attack("sampling", "5 % of the rows lost", lost=0.05)
    yield attack("sampling", "jitter of 30 %", jitter=0.3)
    yield attack("sampling", "500 Hz", step=2e-3)
    for name, factor in (
        ("mass", 2.0), ("mass", 0.8), ("supply_pressure", 1.05), ("supply_pressure", 0.95),
        ("area_1", 1.03), ("area_2", 1.03), ("dead_volume_1", 1.2), ("dead_volume_2", 0.8),
    ):  # fmt: skip
        yield attack("wrong number given", f"{name} x {factor:g}", changed={name: factor},
                     repetitions=1)  # fmt: skip
    for late in (5e-4, 2e-3):
        yield attack("command acts late", f"{1e3 * late:g} ms", late=late)
    for leakage in (1e-12, 1e-11):
        yield attack("leakage", f"{leakage:g} m3/(s Pa)", replace(Plant(), leakage=leakage))
    shape = "valve of another shape"
    yield attack(shape, "edges 0.05 V wide", replace(Plant(), soft=0.05))
    bent = attack(shape, "opens 4 % more a volt", replace(Plant(), bent=0.04))
    yield replace(bent, beyond="A valve that opens more and more looks like lines that lose less.")
    yield attack("stribeck", "50 % more at rest", replace(Plant(), coulomb=200.0, stiction=100.0))
    yield attack(
        "stribeck", "900 N and 300 N more", replace(Plant(), coulomb=900.0, stiction=300.0)
    )
    rising = replace(Plant(), coulomb=200.0, stiction=100.0, shape=2.0)
    small = replace(MICRO, stiction=6.0, shape=2.0)
    wanted = {"stribeck": "estimate"}
    yield attack("Stribeck", "100 N, 0.01 m/s", rising)
    yield attack("Stribeck asked for", "100 N, 0.01 m/s", rising, options=wanted,
                 bounds=partial(_bounds, rising))  # fmt: skip
    yield attack("Stribeck asked for", "60 N, 0.02 m/s",
                 replace(rising, coulomb=35.0, stiction=60.0, stribeck=0.02),
                 options=wanted)  # fmt: skip
    yield attack("Stribeck asked for", "900 N, 300 N, 0.01 m/s",
                 replace(rising, coulomb=900.0, stiction=300.0), options=wanted)  # fmt: skip
    yield attack("Stribeck asked for", "micro-actuator, 5 kHz", small, options=wanted,
                 step=2e-4, volts=5.0, noise=(3e4, 5e-6), n=1500)  # fmt: skip
    yield attack("Stribeck asked for", "there is none", options=wanted)
    for words, shape in (("another shape", 1.0), ("a sudden fall", 4.0)):
        yield attack("Stribeck asked for", words, replace(rising, shape=shape), options=wanted)
    for role, lag in (("pressure_1", 2e-3), ("position", 2e-3)):
        yield attack("sensor lag", f"{role} 2 ms", spoil=partial(_lagging, role=role, lag=lag))
    yield attack("sensors", "rounded",
                 spoil=partial(_rounded, position=1e-4, pressure_1=5e4))  # fmt: skip
    yield attack("sensors", "autocorrelated noise", spoil=partial(_coloured, size=3e4))
    yield attack("sensors", "one bad pressure",
                 spoil=partial(_glitch, role="pressure_1", factor=10.0))  # fmt: skip
    yield attack("sensors", "one bad position", spoil=partial(_glitch, role="position", factor=0.0))
    yield attack("sensors", "pressure 5 % too large",
                 spoil=partial(_changed, role="pressure_1", scale=1.05))  # fmt: skip
    yield attack("sensors", "pressure offset 1 bar",
                 spoil=partial(_changed, role="pressure_2", offset=1e5))  # fmt: skip
    yield attack("sensors", "pressure clipped",
                 spoil=partial(_changed, role="pressure_2", most=33e5))  # fmt: skip
    yield attack("tank pressure not given", "3 bar", replace(Plant(), tank=3e5),
                 changed={"tank_pressure": 0.0})  # fmt: skip
    yield attack("two machines", "friction doubled in the last log", logs=2,
                 other=replace(Plant(), coulomb=300.0, viscous=7200.0))  # fmt: skip
