"""Attacks on the line: logs cut in motion, gaps, noisy two-level inlets, mixed-up columns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np

from ..attack import Array, Attack, Recording, cramer_rao, with_play

UNITS = {"inlet": "Pa", "outlet": "Pa"}
TRUTH = {"gain": 1.0, "time_constant": 0.12, "dead_time": 0.0147}
SLOW = {"gain": 1.0, "time_constant": 0.12, "dead_time": 0.3147}
Spoil = Callable[[Recording, np.random.Generator], Recording]


def switches(rng: np.random.Generator, span: float, shortest: float, longest: float) -> Array:
    """Instants at which the inlet changes, the first at minus infinity in effect, ``(k,)``."""
    gaps = rng.uniform(shortest, longest, int(span / shortest) + 2)
    instants = np.cumsum(gaps)
    return np.r_[-1e9, instants[instants < span]]


def held(at: Array, levels: Array, time: Array) -> Array:
    """Levels that hold from each instant ``at`` to the next."""
    return np.asarray(levels[np.searchsorted(at, time + 1e-9, side="right") - 1])


def respond(truth: Mapping[str, float], at: Array, levels: Array, time: Array) -> Array:
    """Exact outlet of an inlet that is held from each instant ``at`` to the next.

    ``y = l + (x - l) exp(-(t - t_j) / tau)`` from one change to the next, ``x`` being where
    the last one left it.
    """
    tau, late = truth["time_constant"], at + truth["dead_time"]
    x = np.empty(at.size)
    x[0] = levels[0]
    for j in range(1, at.size):
        decay = np.exp(-(late[j] - late[j - 1]) / tau)
        x[j] = levels[j - 1] + (x[j - 1] - levels[j - 1]) * decay
    j = np.searchsorted(late, time, side="right") - 1
    decay = np.exp(-np.maximum(time - late[j], 0.0) / tau)
    return np.asarray(truth["gain"] * (levels[j] + (x[j] - levels[j]) * decay))


def record(
    rng: np.random.Generator,
    *,
    truth: Mapping[str, float] = TRUTH,
    step: float = 0.01,
    n: int = 1000,
    sigma: float = 0.01,
    size: float = 1.0,
    hold: tuple[float, float] = (0.3, 1.0),
    before: float = 0.0,
    two: bool = False,
    runs: int = 1,
    spoil: Spoil | None = None,
) -> list[Recording]:
    """Steps of the inlet, the switches on the grid of the samples.

    ``before`` seconds are simulated and not recorded; ``two`` levels or many.
    """
    out = []
    for _ in range(runs):
        time = np.arange(round(before / step) + n) * step
        at = switches(rng, time[-1], *hold)
        at[1:] = np.round(at[1:] / step) * step
        levels = size * (np.arange(at.size) % 2 if two else rng.uniform(-1.0, 1.0, at.size))
        inlet = held(at, levels, time)
        outlet = respond(truth, at, levels, time) + size * sigma * rng.standard_normal(time.size)
        recorded = slice(time.size - n, None)
        recording: Recording = {
            "time": time[recorded] - time[recorded][0],
            "inlet": inlet[recorded], "outlet": outlet[recorded],
        }  # fmt: skip
        out.append(spoil(recording, rng) if spoil else recording)
    return out


def smooth(
    rng: np.random.Generator,
    *,
    truth: Mapping[str, float] = TRUTH,
    step: float = 0.01,
    n: int = 1000,
    sigma: float = 0.005,
    gap: tuple[float, float] | None = None,
) -> list[Recording]:
    """A smooth inlet, a sum of sines that has been there for ever; the outlet follows exactly."""
    time = np.arange(n) * step
    w = 2.0 * np.pi * np.array([0.13, 0.37, 0.71, 1.3, 2.1]) * rng.uniform(0.9, 1.1, 5)
    turn, size = rng.uniform(0.0, 6.28, 5), 0.4
    response = truth["gain"] * np.exp(-1j * w * truth["dead_time"])
    response = response / (1.0 + 1j * w * truth["time_constant"])
    wave = size * np.exp(1j * (w * time[:, None] + turn))
    inlet, outlet = wave.imag.sum(axis=1), (wave * response).imag.sum(axis=1)
    kept = np.ones(n, dtype=bool) if gap is None else (time < gap[0]) | (time > gap[1])
    noisy = outlet + sigma * rng.standard_normal(n)
    return [{"time": time[kept], "inlet": inlet[kept], "outlet": noisy[kept]}]


def throttled(
    rng: np.random.Generator,
    *,
    truth: Mapping[str, float] = TRUTH,
    step: float = 0.01,
    n: int = 1000,
    sigma: float = 0.01,
    laminar: float = 0.1,
) -> list[Recording]:
    """Turbulent flow through a throttle into the volume: by the root of the pressure over it.

    ``laminar`` is the pressure over it below which the flow is laminar, in parts of the steps.
    """
    fine = 20
    time = np.arange(n * fine) * (step / fine)
    at = switches(rng, time[-1], 0.3, 1.0)
    at[1:] = np.round(at[1:] / step) * step
    levels = rng.uniform(-1.0, 1.0, at.size)
    late = held(at + truth["dead_time"], levels, time)
    y, out = float(levels[0]), np.empty(time.size)
    rate = step / fine / truth["time_constant"]
    for k, level in enumerate(late.tolist()):
        out[k] = y
        over = level - y
        y += rate * over / (1.0 + abs(over) / laminar) ** 0.5
    inlet = held(at, levels, time[::fine])
    outlet = out[::fine] + sigma * rng.standard_normal(n)
    return [{"time": time[::fine], "inlet": inlet, "outlet": outlet}]


def _noisy_inlet(recording: Recording, rng: np.random.Generator, sigma: float) -> Recording:
    inlet = recording["inlet"]
    return {**recording, "inlet": inlet + sigma * rng.standard_normal(inlet.size)}


def _lost(recording: Recording, rng: np.random.Generator, share: float) -> Recording:
    kept = rng.random(recording["time"].size) > share
    return {role: values[kept] for role, values in recording.items()}


def _swapped(recording: Recording, rng: np.random.Generator) -> Recording:
    return {**recording, "inlet": recording["outlet"], "outlet": recording["inlet"]}


def _same(recording: Recording, rng: np.random.Generator) -> Recording:
    return {**recording, "outlet": recording["inlet"]}


def _slow_inlet(recording: Recording, rng: np.random.Generator, rows: int) -> Recording:
    """An inlet that is converted less often than it is logged."""
    inlet = recording["inlet"]
    return {**recording, "inlet": inlet[np.arange(inlet.size) // rows * rows]}


def _hysteresis(recording: Recording, rng: np.random.Generator, width: float) -> Recording:
    """An outlet transducer with play, in parts of its range; its noise comes after it."""
    clean = recording["outlet"]
    seen = with_play(clean, width * float(np.ptp(clean)))
    return {**recording, "outlet": seen + 0.005 * rng.standard_normal(seen.size)}


def _spoilt(rng: np.random.Generator, spoil: Spoil, **more: float) -> list[Recording]:
    """Smooth logs, spoilt."""
    return [spoil(r, rng) for r in smooth(rng, **more)]


def _bounds(truth: Mapping[str, float], step: float, sigma: float) -> dict[str, float]:
    rng = np.random.default_rng(1)
    time = np.arange(1000) * step
    at = switches(rng, time[-1], 30 * step, 100 * step)
    levels = rng.uniform(-1.0, 1.0, at.size)
    return cramer_rao(lambda p: [respond(p, at, levels, time)], truth, sigma)


def attacks() -> Iterator[Attack]:
    """All of them."""
    attack = partial(Attack, "line", units=UNITS)
    bounds = _bounds(TRUTH, 0.01, 0.01)
    yield attack("right model", "100 Hz, held", TRUTH, record, bounds=bounds, repetitions=12)
    yield attack("right model", "held, said so", TRUTH, record, bounds=bounds,
                 hold={"inlet": "zoh"}, repetitions=4)  # fmt: skip
    yield attack("right model", "smooth", TRUTH, smooth, repetitions=4)
    for scale in (1e-3, 1e2):  # from a micro-actuator to a long pipe
        truth = {**TRUTH, "time_constant": 0.12 * scale, "dead_time": 0.0147 * scale}
        hold = (0.3 * scale, 1.0 * scale)
        yield attack(
            "right model", f"times {scale:g}", truth,
            partial(record, truth=truth, step=0.01 * scale, hold=hold, size=1e5 * scale),
            bounds=_bounds(truth, 0.01 * scale, 0.01), repetitions=2,
        )  # fmt: skip
    yield attack("right model", "5 % of the rows lost", TRUTH,
                 partial(record, spoil=partial(_lost, share=0.05)),
                 hold={"inlet": "zoh"}, repetitions=3)  # fmt: skip
    for runs in (1, 3):
        yield attack("cut in motion, long dead time", f"{runs} logs", SLOW,
                     partial(record, truth=SLOW, before=3.0, runs=runs, hold=(0.1, 0.6)),
                     repetitions=6)  # fmt: skip
        yield attack("at rest, long dead time", f"{runs} logs", SLOW,
                     partial(record, truth=SLOW, runs=runs), repetitions=3)  # fmt: skip
    for sigma in (1e-4, 1e-3, 5e-3):
        yield attack("two-level inlet with noise", f"{sigma:g} of the step", TRUTH,
                     partial(record, two=True, spoil=partial(_noisy_inlet, sigma=sigma)),
                     repetitions=3)  # fmt: skip
    for gap in ((4.0, 4.9), (4.0, 4.2)):
        yield attack("gap in a smooth inlet", f"{gap[1] - gap[0]:.1g} s", TRUTH,
                     partial(smooth, gap=gap), repetitions=3)  # fmt: skip
    for rows in (2, 3):
        yield attack("channel slower than the log", f"inlet every {rows} rows", TRUTH,
                     partial(_spoilt, spoil=partial(_slow_inlet, rows=rows)),
                     repetitions=2)  # fmt: skip
    for width in (0.005, 0.02):
        yield attack("hysteresis of the outlet", f"{100 * width:g} % of its range", TRUTH,
                     partial(_spoilt, spoil=partial(_hysteresis, width=width), sigma=0.0),
                     repetitions=2)  # fmt: skip
    yield attack("mixed-up columns", "inlet and outlet swapped", TRUTH,
                 partial(record, spoil=_swapped), repetitions=2)  # fmt: skip
    yield attack("mixed-up columns", "one column twice", TRUTH,
                 partial(record, spoil=_same), repetitions=2)  # fmt: skip
    ends = {n: TRUTH[n] for n in ("gain", "dead_time")}
    for laminar in (0.1, 1.0):
        yield attack("turbulent flow", f"laminar below {50 * laminar:g} % of the steps", ends,
                     partial(throttled, laminar=laminar), repetitions=3)  # fmt: skip
    for tau in (0.002, 0.0005):
        truth = {**TRUTH, "time_constant": tau}
        yield attack("faster than the sampling", f"{1e3 * tau:g} ms at 100 Hz", truth,
                     partial(record, truth=truth), repetitions=4)  # fmt: skip
