"""Noise of a logged command: a play takes every flicker for motion and would look wider.

A command of held levels is read as the means of these; one that moves cannot be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...estimation.noise import white_noise
from ...experiment import Experiment, FloatArray

_APART = 6.0  # standard deviations by which a sample leaves a level
_SHORTEST = 4  # samples of a level, on average
_LIKE_NOISE = 1.5  # ratio of what the levels leave to the noise


def command_noise(experiments: Sequence[Experiment]) -> float:
    """Standard deviation of the noise of the commands, 0 for clean ones [its unit]."""
    return max(white_noise(e.signals["command"].values) for e in experiments)


def held_levels(experiments: Sequence[Experiment], sigma: float) -> list[Experiment] | None:
    """The logs with their commands replaced by levels; ``None`` where they have none."""
    out = []
    for e in experiments:
        signal = e.signals["command"]
        levels = _levels(signal.values, sigma)
        rest, count = signal.values - levels, 1 + np.count_nonzero(np.diff(levels))
        if _SHORTEST * count > levels.size or rest.std() > _LIKE_NOISE * sigma:
            return None
        clean = replace(signal, values=levels, before=float(levels[0]))
        out.append(replace(e, signals={**e.signals, "command": clean}))
    return out


def _levels(values: FloatArray, sigma: float) -> FloatArray:
    """Mean of every stretch whose samples stay within the noise, shape ``(n,)``."""
    starts, mean, count = [0], float(values[0]), 0
    for k, u in enumerate(values.tolist()):
        if abs(u - mean) > _APART * sigma * (1.0 + 1.0 / max(count, 1)) ** 0.5:
            starts.append(k)
            mean, count = u, 0
        count += 1
        mean += (u - mean) / count
    counts = np.diff([*starts, values.size])
    return np.repeat(np.add.reduceat(values, starts) / counts, counts)
