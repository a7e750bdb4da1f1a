"""Attacks on the calibration of a potentiometer: few positions, bad readings, two-way motion.

The truth is the curve: what the loaded block says of several readings is compared with where
the slider was, in standard errors that follow from the written covariance by the delta method.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from math import comb
from typing import Any

import numpy as np
from scipy.optimize import brentq

from ..attack import Array, Attack, Error, Recording

UNITS = {"reading": "1", "reference": "m"}
STROKE = 0.06
POINTS, WEIGHTS = (0.0, 0.022, 0.038, 0.06), (1.0, 2.5, 2.5, 1.0)
Wiper = Callable[[Array], Array]
"""Share of the supply at the wiper, for shares of the stroke."""


def loaded(x: Array, load: float = 2.0) -> Array:
    """A wiper that an input resistance loads: ``load`` is track over input resistance."""
    return np.asarray(x / (1.0 + load * x * (1.0 - x)))


def saturating(x: Array) -> Array:
    """Flat towards both ends."""
    return np.asarray(0.5 + 0.5 * np.tanh(2.0 * (2.0 * x - 1.0)) / np.tanh(2.0))


def folding(x: Array) -> Array:
    """A worn track: the voltage turns back over the last tenth."""
    return np.asarray(np.where(x < 0.9, x / 0.9, 1.0 - (x - 0.9)))


def bezier(t: float, points: Sequence[float] = POINTS, weights: Sequence[float] = WEIGHTS) -> float:
    """A rational Bezier curve, term by term."""
    n = len(points) - 1
    b = [weights[i] * comb(n, i) * t**i * (1.0 - t) ** (n - i) for i in range(n + 1)]
    return sum(p * v for p, v in zip(points, b)) / sum(b)


def section(low: float, high: float) -> dict[str, float]:
    """Control points and weights of the part of the curve between two shares of the reading.

    Blossoms of the weighted points, the first weight 1 as in the file.
    """
    table = np.array([[w * p, w] for p, w in zip(POINTS, WEIGHTS)])
    n = len(POINTS) - 1
    out = []
    for i in range(n + 1):
        x = table
        for t in [low] * (n - i) + [high] * i:
            x = (1.0 - t) * x[:-1] + t * x[1:]
        out.append(x[0])
    points = {f"control_points[{i}]": float(x[0] / x[1]) for i, x in enumerate(out)}
    return points | {f"weights[{i}]": float(out[i][1] / out[0][1]) for i in range(1, n + 1)}


def right(x: Array) -> Array:
    """A wiper whose calibration is the rational Bezier curve of the dataset."""
    t = np.linspace(0.0, 1.0, 20_001)
    return np.asarray(np.interp(x * STROKE, [bezier(s) for s in t.tolist()], t))


def _passes(rng: np.random.Generator, n: int, passes: int, step: float) -> Array:
    """Share of the stroke of a slider that goes to and fro."""
    swing = np.arange(n) * passes / n + rng.uniform(0.0, 0.01)
    return np.asarray(1.0 - np.abs(np.mod(swing, 2.0) - 1.0)) + 0.0 * step


def _log(
    rng: np.random.Generator,
    *,
    wiper: Wiper = loaded,
    stroke: float = STROKE,
    n: int = 600,
    passes: int = 3,
    positions: Array | None = None,
    repeats: int = 1,
    once: bool = False,
    timed: bool = False,
    counts: int = 1023,
    reading_noise: float = 0.0,
    noise: float = 1e-4,
    memory: float = 0.0,
    play: float = 0.0,
    lag: float = 0.0,
    ruler: float = 0.0,
    clip: tuple[float, float] = (0.0, 1.0),
    gains: tuple[float, ...] = (1.0,),
    offset: float = 0.0,
    drift: float = 0.0,
    order: str = "as recorded",
    spoil: Callable[[Recording, np.random.Generator], Recording] | None = None,
) -> list[Recording]:
    """Logs of a slider that goes to and fro, or rests at some positions.

    ``repeats`` readings are taken at each of the ``positions``; ``once`` says that the reference
    is measured once for all of them. ``play`` [m] separates the directions, ``lag`` [samples]
    delays the reference, the voltage of log ``k`` is ``gains[k]`` times what it should be,
    ``ruler`` [m] is the division of the reference, ``offset`` [m] its change from log to log and
    ``drift`` [m] that over a log.
    """
    out = []
    for k, gain in enumerate(gains):
        if positions is None:
            x = _passes(rng, n, passes, 1.0)
        else:
            x = np.repeat(positions, repeats)
        way = np.sign(np.gradient(x))
        volts = np.clip(gain * wiper(np.clip(x - 0.5 * play / stroke * way, 0.0, 1.0)), *clip)
        reading = np.round(counts * volts + reading_noise * rng.standard_normal(x.size))
        reading = np.clip(reading, np.floor(counts * clip[0]), np.ceil(counts * clip[1]))
        error = rng.standard_normal(x.size)
        if memory:
            for i in range(1, x.size):
                error[i] = memory * error[i - 1] + np.sqrt(1.0 - memory**2) * error[i]
        if once:
            error = np.repeat(error[::repeats], repeats)
        place = np.arange(x.size, dtype=float)
        seen = np.interp(place - lag, place, x) if lag else x
        reference = stroke * seen + offset * k + drift * place / x.size
        reference = reference + noise * (stroke / STROKE) * error
        if ruler:
            reference = ruler * np.round(reference / ruler)
        recording: Recording = {"reading": reading, "reference": reference}
        if timed:
            recording = {"time": 0.01 * place, **recording}
        if order == "sorted":
            index = np.argsort(reading, kind="stable")
            recording = {name: values[index] for name, values in recording.items()}
        out.append(spoil(recording, rng) if spoil else recording)
    return out


def _glitch(
    recording: Recording, rng: np.random.Generator, role: str, where: float, value: float
) -> Recording:
    spoiled = recording[role].copy()
    spoiled[min(int(where * spoiled.size), spoiled.size - 1)] = value * float(spoiled.max())
    return {**recording, role: spoiled}


PLACES = (0.03, 0.2, 0.35, 0.5, 0.65, 0.8, 0.97)


def _judge(
    found: Any, wiper: Wiper = loaded, stroke: float = STROKE, counts: int = 1023,
    places: Sequence[float] = PLACES,
) -> dict[str, Error]:  # fmt: skip
    """Errors of the curve where the slider is at shares of its stroke.

    Relative to a quarter of the stroke, so that 2 % are half a percent of it: a potentiometer
    that nobody calibrates is that good. What lies beyond the range of the file is not judged: the
    block says that it is.
    """
    from fluidact_fit.control import make_block

    block = make_block(found.document, accept_failed=True)
    block.accept(True)
    values = {name: np.array(q.value, dtype=float) for name, q in found.parameters.items()}
    out = {}
    for x in places:
        reading = counts * float(np.asarray(wiper(np.asarray(x))))
        if block.outside("reading", reading):
            continue
        value = float(block(reading))
        gradient = _gradient(found, values, reading)
        error = float(np.sqrt(max(gradient @ found.covariance @ gradient, 1e-300)))
        miss = value - stroke * x
        out[f"{100.0 * x:g} %"] = Error(
            miss / error, miss / (0.25 * stroke), abs(miss) <= 1.96 * error
        )
    return out


def _judge_numbers(found: Any, counts: int, **more: Any) -> dict[str, Error]:
    """Errors of control points and weights, over the readings that were recorded."""
    low, high = found.parameters["reading_range"].value
    out = _judge(found, counts=counts, **more)
    for entry, truth in section(low / counts, high / counts).items():
        name, _, index = entry.partition("[")
        q, k = found.parameters[name], int(index.rstrip("]"))
        size = STROKE if name == "control_points" else truth
        if q.status == "estimated" and q.ci95[k][0] < q.ci95[k][1]:
            error = float(np.ravel(q.std_error)[k])
            out[entry] = Error.of(q.value[k], truth, error, q.ci95[k], size)
    return out


def _gradient(found: Any, values: Mapping[str, Array], reading: float) -> Array:
    """Derivative of a position by the parameters of the covariance; both branches alike."""
    low, high = values["reading_range"]
    t = float(np.clip((reading - low) / (high - low), 0.0, 1.0))
    names = [s for s in ("", "_falling") if f"control_points{s}" in values]

    def position(changed: Mapping[str, Array]) -> float:
        return float(np.mean([
            bezier(t, changed[f"control_points{s}"].tolist(), changed[f"weights{s}"].tolist())
            for s in names
        ]))  # fmt: skip

    out = []
    for entry in found.covariance_order:
        name, _, index = entry.partition("[")
        step, ends = 1e-6 * float(np.abs(values[name]).max()), []
        for sign in (1.0, -1.0):
            moved = values[name].copy()
            moved[int(index.rstrip("]"))] += sign * step
            ends.append(position({**values, name: moved}))
        out.append((ends[0] - ends[1]) / (2.0 * step))
    return np.array(out)


def _at(shares: Sequence[float], wiper: Wiper) -> Array:
    """Where the wiper gives shares of the supply."""
    return np.array([
        brentq(lambda x, s=s: float(wiper(np.asarray(x))) - s, 0.0, 1.0) for s in shares
    ])  # fmt: skip


def _of(
    group: str, name: str, repetitions: int = 2, *, good: bool = False,
    judge: Callable[..., dict[str, Error]] = _judge, options: Mapping[str, Any] | None = None,
    places: Sequence[float] = PLACES, **recording: Any,
) -> Attack:  # fmt: skip
    """An attack; ``good`` where the data determine the curve and the model can follow it."""
    seen = {k: recording[k] for k in ("wiper", "stroke", "counts") if k in recording}
    units = {"time": "s", **UNITS} if recording.get("timed") else UNITS
    return Attack(
        "potentiometer", group, name, {}, partial(_log, **recording), units,
        options=options or {}, repetitions=repetitions,
        scales={"curve": 1.0},
        bounds={"curve": 1e-3} if good else {}, judge=partial(judge, places=places, **seen),
    )  # fmt: skip


def attacks() -> Iterator[Attack]:
    """All of them."""
    exact = {"counts": 1_000_000, "wiper": right, "good": True}
    yield _of("right model", "degree 3, 600 samples", 20, **exact)
    yield _of(
        "right model", "degree 3 given", 10, judge=_judge_numbers, options={"degree": "3"}, **exact
    )
    yield _of("right model", "degree 3 given, fixed ends", 10, judge=_judge_numbers,
              positions=np.tile(np.linspace(0.0, 1.0, 101), 4),
              options={"degree": "3", "endpoints": "fixed"}, **exact)  # fmt: skip
    yield _of("right model", "straight", 10, wiper=lambda x: x, counts=1_000_000, good=True)
    for wiper, kind in ((loaded, "loaded"), (saturating, "saturating")):
        yield _of("another curve", kind, 5, wiper=wiper, good=True)
        yield _of("another curve", f"{kind}, timed", 2, wiper=wiper, timed=True, good=True)
        for count in (4, 5, 6, 7, 9, 12, 16):
            x = np.linspace(0.0, 1.0, count)
            yield _of("few positions", f"{count}, {kind}", wiper=wiper, positions=x,
                      good=count >= 9)  # fmt: skip
            if count in (5, 9):
                yield _of("few positions", f"{count}, 20 readings each, {kind}", wiper=wiper,
                          positions=x, repeats=20, reading_noise=0.5, good=count >= 9)  # fmt: skip
    for timed in (False, True):
        for count in (12, 25):
            yield _of("reference measured once", f"{count} x 40{', timed' * timed}", 3,
                      positions=np.linspace(0.0, 1.0, count), repeats=40, once=True, timed=timed,
                      reading_noise=0.7, wiper=partial(loaded, load=1.0))  # fmt: skip
    for play in (3e-4, 2e-3):
        for passes, kind in ((4, "both ways"), (3, "two up, one down"), (1, "one way")):
            yield _of("hysteresis", f"{1e3 * play:g} mm, {kind}", play=play, passes=passes)
        yield _of("hysteresis", f"{1e3 * play:g} mm, sorted", play=play, order="sorted")
    yield _of("hysteresis", "2 mm, two branches", play=2e-3, n=2000, passes=6, timed=True,
              options={"branches": "two"}, good=True)  # fmt: skip
    for clip in ((0.05, 1.0), (0.1, 0.85)):
        for noise in (0.0, 3.0):
            yield _of("clipped", f"{clip[0]:g} to {clip[1]:g}, {noise:g} counts of noise",
                      clip=clip, reading_noise=noise, n=1500, good=True,
                      places=PLACES[1:-2])  # fmt: skip
    for bits in (6, 8):
        yield _of("coarse", f"{bits} bits", counts=2**bits - 1)
    yield _of("coarse", "ruler of 1 mm, 20 positions", ruler=1e-3, noise=0.0,
              positions=np.linspace(0.0, 1.0, 20))  # fmt: skip
    yield _of("coarse", "reading noise of 1 %", reading_noise=10.0, n=3000)
    for role in ("reading", "reference"):
        for n, where, value in ((60, 0.0, 0.0), (60, 0.5, 0.0), (600, 0.5, 10.0), (600, 1.0, 0.0),
                                (600, 0.3, 1e4)):  # fmt: skip
            yield _of("one bad sample", f"{role} at {where:g} of {n}, {value:g}", n=n,
                      spoil=partial(_glitch, role=role, where=where, value=value))  # fmt: skip
    yield _of("drift", "reference 0.5 mm from log to log", gains=(1.0,) * 3, offset=5e-4)
    yield _of("drift", "reference 2 mm over the log", drift=2e-3)
    yield _of("drift", "one log of another potentiometer", 4, gains=(1.0, 0.97, 1.0))
    yield _of("machine", "track that turns back", wiper=folding, places=PLACES[:-2])
    yield _of("machine", "ripple of 1 mm, 8 periods",
              wiper=lambda x: x + 1e-3 / STROKE * np.sin(16.0 * np.pi * x))  # fmt: skip
    yield _of("noise", "autocorrelated, 0.98", 4, memory=0.98, noise=3e-4)
    yield _of("noise", "autocorrelated, 0.98, timed", 4, memory=0.98, noise=3e-4, timed=True)
    yield _of("noise", "reference 10 samples late", lag=10.0, n=300, passes=4)
    yield _of("scale", "1 mm", stroke=1e-3, good=True)
    yield _of("scale", "4 m, 10 passes", stroke=4.0, n=4000, passes=10, good=True)
    gap = np.concatenate((np.linspace(0.0, 0.25, 60), np.linspace(0.75, 1.0, 60)))
    yield _of("gap", "nothing between 25 and 75 %", positions=gap, wiper=saturating)
