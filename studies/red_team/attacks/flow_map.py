"""Attacks on flow maps: hysteresis, lag, one side only, few levels, other shapes, bad samples."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from ..attack import Array, Attack, Recording

UNITS = {"time": "s", "command": "V", "flow": "m3/s", "pressure_drop": "Pa"}
TRUTH = {
    "dead_band_negative": -0.9, "dead_band_positive": 1.2, "gain_negative": 3.0e-5,
    "gain_positive": 4.0e-5, "curvature": -0.02, "leakage": 2.0e-6,
    "saturation_negative": -8.5, "saturation_positive": 8.8,
}  # fmt: skip
NOISE, REFERENCE = 8e-7, 3.5e6
Spoil = Callable[[Recording, np.random.Generator], Recording]


def valve(u: Array, p: Mapping[str, float]) -> Array:
    """Steady flow, sample by sample; ``soft`` edges [V] and another ``power`` are no part of it."""
    out = np.empty(u.size)
    for k, value in enumerate(u.tolist()):
        side, sign = ("positive", 1.0) if value >= 0.0 else ("negative", -1.0)
        edge, gain, leak = abs(p[f"dead_band_{side}"]), p[f"gain_{side}"], p["leakage"]
        x = min(abs(value), abs(p[f"saturation_{side}"])) - edge
        if "soft" in p:
            x = p["soft"] * float(np.logaddexp(0.0, x / p["soft"]))
        x = max(x, 0.0)
        left = max(0.0, 1.0 - x / (edge + 2.0 * abs(leak) / gain)) if edge + abs(leak) else 0.0
        bent = x ** p.get("power", 1.0) * (1.0 + p["curvature"] * x)
        out[k] = sign * gain * bent + leak * left
    return out


def _command(kind: str, n: int, ends: tuple[float, float]) -> Array:
    share = np.arange(n) / n
    low, high = ends
    if kind == "levels":
        levels = np.linspace(low, high, 12)
        return np.repeat(np.concatenate((levels, levels[::-1])), n // 24)
    swing = {"ramp": 2.0, "one way": 1.0, "fast ramp": 20.0}[kind] * share
    return low + (high - low) * (1.0 - np.abs(np.mod(swing, 2.0) - 1.0))


def _log(
    rng: np.random.Generator, *, kind: str = "ramp", n: int = 1200, noise: float = NOISE,
    ends: tuple[float, float] = (-10.0, 10.0), play: float = 0.0, lag: float = 0.0,
    memory: float = 0.0, drop: float = 0.0, hidden_drop: float = 0.0, offset: float = 0.0,
    machine: Mapping[str, float] | None = None, spoil: Spoil | None = None, timed: bool = True,
) -> list[Recording]:  # fmt: skip
    """``play`` [V] of the spool, ``lag`` [samples], ``drop`` share by which the pressure sways."""
    p = TRUTH | dict(machine or {})
    u = np.round(_command(kind, n, ends), 3)
    seen, at = np.empty(u.size), float(u[0])
    for k, value in enumerate(u.tolist()):
        at = min(max(at, value - 0.5 * play), value + 0.5 * play)
        seen[k] = at
    q = valve(seen, p)
    for k in range(1, u.size):
        if lag:
            q[k] = q[k - 1] + (q[k] - q[k - 1]) / (1.0 + lag)
    sway = 1.0 + (drop or hidden_drop) * np.sin(np.arange(u.size) / 47.0 + rng.uniform(0.0, 6.0))
    error = rng.standard_normal(u.size)
    for k in range(1, u.size):
        error[k] = memory * error[k - 1] + np.sqrt(1.0 - memory**2) * error[k]
    q = q * np.sqrt(sway) + noise * error + offset
    out: Recording = {"command": u, "flow": q}
    if timed:
        out = {"time": 0.05 * np.arange(u.size), **out}
    if drop:
        out = {**out, "pressure_drop": REFERENCE * sway}
    return [spoil(out, rng) if spoil else out]


def _glitch(recording: Recording, rng: np.random.Generator, role: str, factor: float) -> Recording:
    spoiled = recording[role].copy()
    spoiled[rng.integers(50, spoiled.size - 50)] = factor * float(np.abs(spoiled).max())
    return {**recording, role: spoiled}


def _of(
    group: str, name: str, repetitions: int = 2, *, good: bool = False, known: bool = True,
    options: Mapping[str, Any] | None = None, **recording: Any,
) -> Attack:  # fmt: skip
    truth = TRUTH | {
        k: v for k, v in (recording.get("machine") or {}).items() if k in TRUTH
    }  # fmt: skip
    low, high = recording.get("ends", (-10.0, 10.0))
    for side, end in (("negative", -low), ("positive", high)):
        if end < abs(truth[f"saturation_{side}"]):
            truth.pop(f"saturation_{side}")
        if end <= 0.0:
            truth = {k: v for k, v in truth.items() if not k.endswith(side)}
    units = {
        r: u for r, u in UNITS.items()
        if (r != "pressure_drop" or recording.get("drop")) and (
            r != "time" or recording.get("timed", True))
    }  # fmt: skip
    given = dict(options or {}) | (
        {"reference_pressure": REFERENCE} if recording.get("drop") else {}
    )  # fmt: skip
    scales = {"curvature": 0.1, "leakage": 1e-5, "dead_band_negative": 2.1,
              "dead_band_positive": 2.1}  # fmt: skip
    return Attack(
        "flow-map", group, name, truth if known else {}, partial(_log, **recording),
        units, options=given,
        scales={k: v for k, v in scales.items() if k in truth},
        bounds={n: 1e-3 * abs(v) for n, v in truth.items() if "gain" in n} if good else {},
        repetitions=repetitions,
    )  # fmt: skip


def attacks() -> Iterator[Attack]:
    """All of them."""
    yield _of("right model", "slow ramp", 12, good=True)
    yield _of("right model", "levels", 6, kind="levels", good=True)
    yield _of("right model", "no time", 4, timed=False, good=True)
    yield _of("right model", "pressure drop recorded", 6, drop=0.2, good=True)
    yield _of("right model", "never saturated", 6, ends=(-7.0, 7.0), good=True)
    yield _of("right model", "positive side only", 4, ends=(0.0, 10.0), good=True)
    yield _of("right model", "no leakage", 4, machine={"leakage": 0.0}, good=True)
    none = {"dead_band_negative": 0.0, "dead_band_positive": 0.0, "leakage": 0.0}
    yield _of("right model", "no dead band", 4, machine=none, good=True)
    yield _of("noise", "ten times", 4, noise=10.0 * NOISE)
    yield _of("noise", "autocorrelated, 0.95", 4, memory=0.95)
    yield _of("few samples", "60", 4, n=60)
    yield _of("hysteresis", "0.4 V, both ways", 3, play=0.4)
    yield _of("hysteresis", "0.4 V, one way", 2, play=0.4, kind="one way", known=False)
    yield _of("hysteresis", "0.05 V", 2, play=0.05)
    yield _of("lag", "10 samples, slow ramp", 2, lag=10.0)
    yield _of("lag", "10 samples, fast ramps", 2, lag=10.0, kind="fast ramp")
    yield _of("shape", "soft edges", 2, machine={"soft": 0.3})
    yield _of("shape", "power 1.5", 2, machine={"power": 1.5}, known=False)
    yield _of("pressure", "drop sways by 30 %, not recorded", 3, hidden_drop=0.3)
    yield _of("offset", "flow meter", 2, offset=5e-6)
    for role, factor in (("flow", 10.0), ("flow", 0.0), ("command", 2.0)):
        yield _of("one bad sample", f"{role} times {factor:g}", 2,
                  spoil=partial(_glitch, role=role, factor=factor))  # fmt: skip
