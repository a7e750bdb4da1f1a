"""Hydraulic motor by small steps, sharing no code with the family: play, curve, lag, integral."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
TRUTH = {
    "dead_zone_negative": -0.9, "dead_zone_positive": 0.4, "gain": 88.0, "curvature": 0.24,
    "saturation_command": 6.2, "hysteresis": 0.25, "time_constant": 0.07, "dead_time": 0.03,
}  # fmt: skip
EVEN = {n: v for n, v in TRUTH.items() if n != "dead_zone_negative"}
EVEN["dead_zone"] = EVEN.pop("dead_zone_positive")
STEP = 0.02  # s
_FINE = 20  # steps of the solution between two samples


def levels(rng: np.random.Generator, count: int, each: int = 40, top: float = 7.0) -> Array:
    """Random levels of the command, held for ``each`` samples."""
    return np.repeat(rng.uniform(-top, top, count), each)


def steady_speed(command: float, spool: float, p: Mapping[str, float]) -> tuple[float, float]:
    """Steady speed after a change of the command, and the place of the spool."""
    half = 0.5 * p["hysteresis"]
    spool = min(max(spool, command - half), command + half)
    w = spool - p.get("command_offset", 0.0)
    edge = p.get("dead_zone", p.get("dead_zone_positive", 0.0))
    if w < 0.0:
        edge = p.get("dead_zone", -p.get("dead_zone_negative", 0.0))
    x = max(min(abs(w), p["saturation_command"]) - edge, 0.0)
    size = p["gain"] / p["curvature"] * (1.0 - np.exp(-p["curvature"] * x))
    return float(np.sign(w) * size), spool


def points(command: Array, p: Mapping[str, float]) -> Array:
    """Settled speeds, the points being visited in their order."""
    spool, out = float(command[0]), []
    for u in command.tolist():
        speed, spool = steady_speed(u, spool, p)
        out.append(speed)
    return np.array(out)


def run(command: Array, p: Mapping[str, float]) -> tuple[Array, Array]:
    """Speed and angle at the samples of a held command, from the steady speed of the first."""
    h = STEP / _FINE
    target = np.repeat(points(command, p), _FINE)
    late = round(p["dead_time"] / h)
    target = np.concatenate((np.full(late, target[0]), target))[: target.size]
    keep = np.exp(-h / p["time_constant"])
    speed, angle = np.empty(target.size), np.empty(target.size)
    n, place = float(target[0]), 0.0
    for k, aim in enumerate(target.tolist()):
        speed[k], angle[k] = n, place
        place += aim * h + (n - aim) * p["time_constant"] * (1.0 - keep)
        n = aim + keep * (n - aim)
    return speed[::_FINE], angle[::_FINE]
