"""Speeds of the strokes: is there a second one, as viscous friction needs?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...experiment import FloatArray
from .samples import Data

SECOND_SPEED = 1.5  # ratio of two speeds that are clearly different


def _speeds(speed: FloatArray) -> tuple[float, float] | None:
    """Range of the speeds of whole strokes [m/s].

    Weighted by distance, the short slow tails about a reversal weigh little and a fast
    stroke as much as a slow one: the middle 80 % of the distance. Slow strokes that take a
    fifth of the time are not tails, however short they are.
    """
    if speed.size < 5:
        return None
    v = np.sort(np.abs(speed))
    share = np.cumsum(v)
    low, high = np.searchsorted(share, np.array([0.1, 0.9]) * share[-1])
    low = min(int(low), v.size // 5)
    return float(v[low]), float(v[min(int(high), v.size - 1)])


def speed_ranges(data: Sequence[Data], moved: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Slowest and fastest speed by direction, over all logs."""
    out = {}
    for s in moved:
        found = [r for d in data if (r := _speeds(d.speed[d.side(s)])) is not None]
        if found:
            out[s] = min(r[0] for r in found), max(r[1] for r in found)
    return out


def speed_span(low: float, high: float, noise: float) -> float:
    """Spread of true speeds, the noise of the velocity (2 x 1.282 sd) subtracted [m/s]."""
    return float(np.sqrt(max((high - low) ** 2 - (2.563 * noise) ** 2, 0.0)))


def one_speed(ranges: Mapping[str, tuple[float, float]], noise: float) -> bool:
    """Whether every direction has one speed only."""
    for low, high in ranges.values():
        middle, half = 0.5 * (low + high), 0.5 * speed_span(low, high, noise)
        if middle + half >= SECOND_SPEED * (middle - half):
            return False
    return True


def describe_speeds(ranges: Mapping[str, tuple[float, float]]) -> str:
    """Say which speeds the logs have."""
    parts = [f"{low:.3g} and {high:.3g} m/s ({s} direction)" for s, (low, high) in ranges.items()]
    return "all strokes, apart from their ends, are between " + " and between ".join(parts)
