"""Attacks on backlash: noise and codes of the drive, delays, springs, slip, wear, short ways."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from ..attack import Array, Attack, Recording

UNITS = {"time": "s", "drive": "rad", "load": "rad"}
TRUTH = {"play": 4.0e-3, "ratio": 0.25}
STEP, SIZE, NOISE = 0.02, 1.2, 1.0e-4
Spoil = Callable[[Recording, np.random.Generator], Recording]


def drive(kind: str, n: int, size: float, rng: np.random.Generator) -> Array:
    """Angle of the drive: sines, strokes at constant speed, steps that are held, one way."""
    share, phase = np.arange(n) / n, rng.uniform(0.0, 1.0)
    if kind == "sines":
        turn = 2.0 * np.pi * (4.0 * share + phase)
        return np.asarray(size * (np.sin(turn) + 0.4 * np.sin(2.3 * turn + 1.0)) / 1.4)
    if kind == "strokes":
        return np.asarray(size * (4.0 * np.abs(np.mod(3.7 * share + phase, 1.0) - 0.5) - 1.0))
    if kind == "held":
        places = np.repeat(size * rng.uniform(-1.0, 1.0, 24), 2)
        ends = np.sort(np.concatenate((np.arange(24.0), np.arange(24.0) + 0.6)))
        return np.asarray(np.interp(24.0 * share, ends, places))
    if kind == "short":  # back by nine tenths of the lost motion
        back, strokes = 0.9 * TRUTH["play"] / TRUTH["ratio"], np.arange(21)
        places = 0.05 * (strokes + strokes % 2) - back * (strokes % 2 == 0)
        return np.asarray(np.interp(20.0 * share, strokes, places))
    return np.asarray(size * (2.0 * share - 1.0))


def geared(x: Array, p: Mapping[str, float], rng: np.random.Generator) -> Array:
    """Load, sample by sample.

    No part of the model: a ``spring`` that takes it along within the play, ``coast`` [rad] by
    which it runs on, ``slip`` [rad] at one instant, ``eccentric`` share by which the play sways
    over the drive, ``bow`` of the gear, ``creep`` share of the play by which it falls in a second.
    """
    at, last, out = float(p["ratio"] * x[0]) + 0.5 * p["play"] * rng.uniform(-1.0, 1.0), 0, []
    moved, run_on = 0, 0.0
    for k, place in enumerate(x.tolist()):
        u = p["ratio"] * (place + p.get("bow", 0.0) * (place / SIZE) ** 2)
        play = p["play"] * (1.0 + p.get("eccentric", 0.0) * np.sin(3.0 * place / SIZE))
        before = at
        if p.get("creep"):
            at -= p["creep"] * p["play"] * STEP
        if u - at > 0.5 * play:
            at, last = u - 0.5 * play, 1
        elif at - u > 0.5 * play:
            at, last = u + 0.5 * play, -1
        else:
            if moved and p.get("coast"):
                run_on = moved * min(p["coast"], 0.4 * play)
                at += run_on
            last = 0
        moved = last if at != before else 0
        if p.get("slip") and k == x.size // 2:
            at += p["slip"]
        out.append(at + p.get("spring", 0.0) * (u - at))
    return np.array(out)


def _log(
    rng: np.random.Generator, *, kind: str = "sines", n: int = 1000, logs: int = 2,
    size: float = SIZE, noise: float = NOISE, memory: float = 0.0, drive_noise: float = 0.0,
    codes: float = 0.0, load_codes: float = 0.0, late: int = 0, lag: float = 0.0,
    drift: float = 0.0, machine: Mapping[str, float] | None = None, spoil: Spoil | None = None,
    timed: bool = True,
) -> list[Recording]:  # fmt: skip
    """``codes`` [rad] of an encoder; ``late`` and ``lag`` [samples] of the load's."""
    out = []
    for _ in range(logs):
        x = drive(kind, n, size, rng)
        y = geared(x, TRUTH | dict(machine or {}), rng) + rng.uniform(-0.1, 0.1)
        y = np.concatenate((np.full(late, y[0]), y[: n - late]))
        error = rng.standard_normal(n)
        for k in range(1, n):
            if lag:
                y[k] = y[k - 1] + (y[k] - y[k - 1]) / (1.0 + lag)
            error[k] = memory * error[k - 1] + np.sqrt(1.0 - memory**2) * error[k]
        y = y + noise * error + drift * np.arange(n) / n
        x = x + drive_noise * rng.standard_normal(n)
        x = np.round(x / codes) * codes if codes else x
        y = np.round(y / load_codes) * load_codes if load_codes else y
        one: Recording = {"drive": x, "load": y}
        if timed:
            one = {"time": STEP * np.arange(n), **one}
        out.append(spoil(one, rng) if spoil else one)
    return out


def _glitch(recording: Recording, rng: np.random.Generator, role: str, factor: float) -> Recording:
    spoiled = recording[role].copy()
    spoiled[rng.integers(50, spoiled.size - 50)] = factor * float(np.abs(spoiled).max())
    return {**recording, role: spoiled}


def _swap(recording: Recording, rng: np.random.Generator) -> Recording:
    return {**recording, "drive": recording["load"],
            "load": recording["drive"]}  # fmt: skip


def _of(
    group: str, name: str, repetitions: int = 2, *, good: bool = False, known: bool = True,
    fixed: Mapping[str, float] | None = None, beyond: str = "", **recording: Any,
) -> Attack:  # fmt: skip
    machine = {k: v for k, v in (recording.get("machine") or {}).items() if k in TRUTH}
    truth = TRUTH | machine
    # what a spring takes along while the drive crosses the play is no part of what is lost
    truth["play"] *= 1.0 - (recording.get("machine") or {}).get("spring", 0.0)
    rows = recording.get("n", 1000) * recording.get("logs", 2)
    bounds = {"play": 2.0 * recording.get("noise", NOISE) / np.sqrt(rows), "ratio": 1e-4}
    units = {r: u for r, u in UNITS.items() if r != "time" or recording.get("timed", True)}
    return Attack(
        "backlash", group, name, truth if known else {}, partial(_log, **recording), units,
        fixed=fixed or {}, scales={} if truth["play"] else {"play": TRUTH["play"]},
        bounds=bounds if good else {}, repetitions=repetitions, beyond=beyond,
    )  # fmt: skip


def attacks() -> Iterator[Attack]:
    """All of them."""
    yield _of("right model", "two sines", 12, good=True)
    yield _of("right model", "strokes of one speed", 8, kind="strokes", good=True)
    yield _of("right model", "places that are held", 8, kind="held", good=True)
    yield _of("right model", "no time", 4, timed=False, good=True)
    yield _of("right model", "one log of 300 samples", 6, n=300, logs=1, good=True)
    yield _of("right model", "geared backwards", 4, machine={"ratio": -3.0}, good=True)
    yield _of("right model", "no play", 8, machine={"play": 0.0}, good=True)
    yield _of("right model", "play near the noise", 8, machine={"play": 1e-4})
    yield _of("right model", "half of the way is play", 4, machine={"play": 0.3}, good=True)
    yield _of("right model", "ratio given", 4, fixed={"ratio": TRUTH["ratio"]}, good=True)
    yield _of("noise", "ten times", 4, noise=10.0 * NOISE)
    yield _of("noise", "autocorrelated, 0.95", 6, memory=0.95)
    for kind in ("sines", "strokes", "held"):
        for level in (0.2, 1.0, 5.0):
            yield _of("noise of the drive", f"{kind}, {level:g} of the load's", 4, kind=kind,
                      drive_noise=level * NOISE / TRUTH["ratio"])  # fmt: skip
        for codes in (1e-4, 1e-3, 4e-3):
            yield _of("codes of the drive", f"{kind}, {1e3 * codes:g} mrad", 4, kind=kind,
                      codes=codes)  # fmt: skip
        yield _of("codes of the load", f"{kind}, a quarter of the play", 3, kind=kind,
                  load_codes=1e-3)  # fmt: skip
    yield _of("reversals", "of nine tenths of the play", 4, kind="short")
    yield _of("reversals", "none", 3, kind="one way")
    yield _of("reversals", "play wider than the way", 3, machine={"play": 0.7})
    for kind in ("sines", "strokes"):
        yield _of("delay", f"{kind}, 1 sample", 3, kind=kind, late=1)
        yield _of("delay", f"{kind}, 10 samples", 2, kind=kind, late=10)
        yield _of("delay", f"{kind}, lag of 3 samples", 2, kind=kind, lag=3.0)
        yield _of("load in the play", f"{kind}, spring of 10 %", 3, kind=kind,
                  machine={"spring": 0.1})  # fmt: skip
        yield _of("load in the play", f"{kind}, spring of 50 %", 2, kind=kind,
                  machine={"spring": 0.5})  # fmt: skip
        yield _of("load in the play", f"{kind}, coasts by a quarter", 3, kind=kind,
                  machine={"coast": 1e-3})  # fmt: skip
        yield _of("load in the play", f"{kind}, coasts all the way", 2, kind=kind,
                  machine={"coast": 1.0})  # fmt: skip
        yield _of("load in the play", f"{kind}, creeps down", 3, kind=kind,
                  machine={"creep": 0.5})  # fmt: skip
        yield _of("load in the play", f"{kind}, falls down", 2, kind=kind,
                  machine={"creep": 20.0})  # fmt: skip
    yield _of("load in the play", "held, creeps down", 3, kind="held", machine={"creep": 0.5})
    yield _of("load in the play", "held, falls down", 2, kind="held", machine={"creep": 20.0})
    yield _of("machine", "slips by the play", 3, machine={"slip": 4e-3})
    yield _of("machine", "slips by a tenth of it", 2, machine={"slip": 4e-4})
    yield _of("machine", "play sways by 30 %", 3, machine={"eccentric": 0.3})
    yield _of("machine", "bowed gear", 3, machine={"bow": 0.01})
    yield _of("machine", "drift of the load", 3, drift=2e-3)
    yield _of("channels", "taken for each other", 3, spoil=_swap, known=False)
    for role, factor in (("load", 3.0), ("load", 0.0), ("drive", 2.0)):
        yield _of("one bad sample", f"{role} times {factor:g}", 2,
                  spoil=partial(_glitch, role=role, factor=factor))  # fmt: skip
