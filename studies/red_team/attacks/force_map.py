"""Attacks on force maps: few positions, lengths or samples, late or bad signals, wrong columns.

A network has no covariance. What its file promises is the error at positions that were not
trained, ``validation.rmse``; a passed file is wrong in silence when a new recording of the same
machine at other positions within the range is missed by far more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ..attack import Array, Attack, Error, Recording

UNITS = {"time": "s", "command": "V", "position": "m", "force": "N", "length": "m"}
AREA, FRICTION = 18.0, 6.0  # N/V, N
EVENLY = (0.002, 0.007, 0.012, 0.017, 0.022, 0.027)
BETWEEN = (0.0045, 0.0145, 0.0245)
STEP = 0.01  # s
Spoil = Callable[[Recording, np.random.Generator], Recording]


def seal(u: Array, friction: float) -> Array:
    """Force that a seal takes from the command's: it follows over 1 V of travel (play)."""
    out, at = np.zeros(u.size), -1.0
    for k in range(u.size):
        if k:
            at = float(np.clip(at + (u[k] - u[k - 1]) / 0.5, -1.0, 1.0))
        out[k] = friction * at
    return out


def spring(x: float, kind: str) -> float:
    """Force of the return spring [N]: stiffening, or with a stop in mid-stroke."""
    if kind == "kink":
        return 5.0 + 300.0 * x + 4000.0 * max(x - 0.013, 0.0)
    if kind == "wave":
        return 5.0 + 300.0 * x + 4.0 * float(np.sin(2.0 * np.pi * x / 0.005))
    if kind == "long wave":
        return 5.0 + 300.0 * x + 4.0 * float(np.sin(2.0 * np.pi * x / 0.0085))
    return 5.0 + 300.0 * x + 4000.0 * x * x


def record_at(
    rng: np.random.Generator, x: float, *, length: float | None = None, kind: str = "stiffening",
    samples: int = 240, speed: float = 1.0, noise: float = 0.05, lag: float = 0.0,
    odd: float = 1.0, mean: float = 0.0, clip: float = np.inf,
) -> Recording:  # fmt: skip
    """Two triangles of the command at one position."""
    fine = np.arange(20 * samples) / 20.0
    u = 0.8 + 3.5 * (1.0 - np.abs(np.mod(fine * 4.0 * speed / samples, 2.0) - 1.0))
    factor = odd * (1.0 if length is None else (0.2 + 4.0 * length + 12.0 * (length - 0.2) ** 2))
    force = factor * AREA * u - spring(x, kind) - seal(u, FRICTION)
    late = np.interp(fine - lag, fine, np.maximum(force, 0.0) + mean)[::20]
    out: dict[str, Array] = {
        "command": np.round(u[::20], 3),
        "position": x + 3e-5 * rng.standard_normal(samples),
        "force": np.minimum(late + noise * rng.standard_normal(samples), clip),
    }
    return out if length is None else {**out, "length": np.full(samples, length)}


def _joined(parts: Sequence[Recording]) -> Recording:
    """One position after the other, as one log."""
    out = {role: np.concatenate([p[role] for p in parts]) for role in parts[0]}
    return {"time": STEP * np.arange(out["force"].size), **out}


def _logs(
    rng: np.random.Generator, *, positions: Sequence[float] = EVENLY,
    lengths: Sequence[float] | None = None, drift: float = 0.0, spoil: Spoil | None = None,
    swap: tuple[str, str] | None = None, one_each: bool = False, **machine: Any,
) -> list[Recording]:  # fmt: skip
    out = []
    for length in lengths or (None,):
        parts = [
            record_at(rng, x, length=length, **{"mean": drift * k, **machine})
            for k, x in enumerate(positions)
        ]
        out += [_joined([p]) for p in parts] if one_each else [_joined(parts)]
    if swap:
        out = [{**r, swap[0]: r[swap[1]], swap[1]: r[swap[0]]} for r in out]
    return [spoil(r, rng) if spoil else r for r in out]


def _spiked(recording: Recording, rng: np.random.Generator, role: str, count: int) -> Recording:
    values = recording[role].copy()
    values[rng.integers(20, values.size - 20, count)] += 3.0 * float(np.ptp(values))
    return {**recording, role: values}


def _judge(
    found: Any, places: Sequence[float] = BETWEEN, lengths: Sequence[float] | None = None,
    swap: tuple[str, str] | None = None, **machine: Any,
) -> dict[str, Error]:  # fmt: skip
    """Error on a new recording against the one promised: 1.6 times as much is 4 deviations."""
    from ..run import write

    rng = np.random.default_rng(0)
    new = _logs(rng, positions=places, lengths=lengths, swap=swap, **machine)
    with TemporaryDirectory(prefix="red-team-") as folder:
        paths = [write(f"{folder}/new{k}.csv", r, UNITS) for k, r in enumerate(new)]
        runs = found.simulate(paths)
    missed = np.concatenate([r.residual[np.isfinite(r.residual)] for r in runs])
    span = float(np.ptp(np.concatenate([r.measured[np.isfinite(r.measured)] for r in runs])))
    promised = float((found.document.fit.details or {})["validation"]["rmse"])
    excess = float(np.sqrt(np.mean(missed**2))) - promised
    error = 0.15 * promised + 1e-3 * span
    return {"held-out error": Error(max(excess, 0.0) / error, excess / span, excess < 2.0 * error)}


def _of(
    group: str, name: str, repetitions: int = 1, *, good: bool = False,
    places: Sequence[float] = BETWEEN, new: dict[str, Any] | None = None,
    options: dict[str, Any] | None = None, beyond: str = "", **recording: Any,
) -> Attack:  # fmt: skip
    """An attack; ``new`` is what differs in the recording that is predicted."""
    kept = ("one_each", "kind", "samples", "speed", "noise", "lag", "clip", "swap")
    machine = {k: v for k, v in recording.items() if k in kept} | (new or {})
    given = {"target": "force", "hidden": "5", "starts": 2, **(options or {})}
    if given["target"] == "force" and "lengths" not in recording:
        given["inputs"] = "command,position,direction"
    return Attack(
        "force-map", group, name, {}, partial(_logs, **recording), UNITS, options=given,
        scales={"map": 1.0}, bounds={"map": 1e-3} if good else {}, repetitions=repetitions,
        beyond=beyond, judge=partial(_judge, places=places, **machine),
    )  # fmt: skip


def attacks() -> Iterator[Attack]:
    """All of them."""
    yield _of("right model", "six positions, force", 5, good=True)
    yield _of("right model", "six positions, command", 3, good=True,
              options={"target": "command"})  # fmt: skip
    yield _of("right model", "a log per position", 3, good=True, one_each=True)
    yield _of("spring", "kink in mid-stroke", 2, kind="kink", good=True)
    yield _of("spring", "wave of 8.5 mm", 2, kind="long wave")
    yield _of("spring", "wave as long as positions lie apart", 1, kind="wave",
              beyond="Every position was recorded at the same phase of the wave.")  # fmt: skip
    for count in (1, 2, 3, 4):
        where = np.linspace(0.002, 0.027, count).tolist() if count > 1 else [0.0145]
        for kind in ("stiffening", "kink"):
            yield _of("few positions", f"{count}, {kind}", positions=where, kind=kind)
    for lengths in ((0.2,), (0.1, 0.3), (0.1, 0.15, 0.3), (0.1, 0.15, 0.2, 0.3)):
        yield _of("few lengths", f"{len(lengths)}", positions=EVENLY[::2], lengths=lengths,
                  new={"lengths": (0.25,)})  # fmt: skip
    yield _of("few samples", "20 a position", samples=20, noise=0.5, options={"hidden": "7"})
    for lag in (2.0, 10.0):
        yield _of("late", f"force {lag:g} samples late, same speed", lag=lag)
        yield _of("late", f"force {lag:g} samples late, slower new log", lag=lag,
                  new={"speed": 0.25}, beyond="At one speed a delay is a hysteresis.")  # fmt: skip
    yield _of("late", "force 2 samples late, truth in time", lag=2.0, new={"lag": 0.0},
              beyond="At one speed a delay is a hysteresis.")  # fmt: skip
    yield _of("drift", "force 1.5 N from position to position", drift=1.5,
              beyond="A drift in step with the positions is a spring.")  # fmt: skip
    yield _of("columns", "command and position swapped", swap=("command", "position"))
    yield _of("columns", "force and position swapped", swap=("force", "position"))
    for role, count in (("force", 5), ("force", 60), ("command", 5), ("position", 5)):
        yield _of("spikes", f"{count} in {role}", 2, spoil=partial(_spiked, role=role, count=count))
    yield _of("clipped", "force at 40 N", clip=40.0, new={"clip": np.inf})
    yield _of("noise", "2 N", noise=2.0, good=True)
    yield _of("too large a network", "20 units, 480 samples", samples=80, noise=1.0,
              options={"hidden": "20"})  # fmt: skip
