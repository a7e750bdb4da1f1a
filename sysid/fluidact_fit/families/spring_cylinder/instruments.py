"""Velocity of a record, and the instruments of its noisy columns.

An instrument is made of other samples than its column: it follows the true motion and knows
nothing of the noise of the sample (``docs/theory/regression.md``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...estimation.noise import white_noise
from ...experiment import BoolArray, Experiment, FloatArray
from ...signals import smooth

REACH = 5  # samples on either side that a velocity is computed from, at most
_DEGREE = 4  # of the polynomial: its velocity is exact to the fourth power of the position's
_FLATTENED = 1e-3  # part of the velocity that a window may lose, or what cannot be seen of it


@dataclass(frozen=True)
class Instrument:
    """Instrument of a noisy column, shape ``(n,)``, and the noise of the column [its unit]."""

    values: FloatArray
    noise: float


@dataclass(frozen=True)
class RodMotion:
    """Velocity [m/s], where it can be relied upon, and its noise per noise of the position [1/s].

    Arrays of shape ``(n,)``.
    """

    rate: FloatArray
    inside: BoolArray
    gain: float = 0.0


def find_motion(e: Experiment, position: FloatArray) -> RodMotion:
    """Velocity, its own or from position; zero without time."""
    everywhere = np.ones(position.size, dtype=bool)
    if "velocity" in e:
        return RodMotion(e.sampled("velocity"), everywhere)
    if e.time.size < 12 or e["position"].size < position.size:
        return RodMotion(np.zeros(position.size), everywhere)
    if e.uniform:
        return differentiate(position, e.sample_time)
    rate = np.asarray(np.gradient(position, e.time))
    return RodMotion(rate, everywhere, 1.0 / (np.sqrt(2.0) * e.sample_time))


def differentiate(position: FloatArray, sample_time: float) -> RodMotion:
    """Velocity of evenly sampled positions, by the longest window that does not flatten it.

    A window of ``2 h + 1`` samples lets through less noise the longer it is, and flattens what
    turns within it. What it loses is seen by a window of five samples, compared where neither
    knows the noise: along the slope of the samples beyond ``REACH``.
    """
    slope = _slope_around(position)
    sigma = white_noise(position)
    shortest = best = smooth(position, sample_time, 2, _DEGREE)
    for half in range(REACH, 2, -1):
        now = smooth(position, sample_time, half, _DEGREE)
        z = slope * now.inside
        lost = float(z @ (shortest.rate - now.rate))
        size, known = abs(float(z @ now.rate)), sigma * shortest.gain * float(np.linalg.norm(z))
        if abs(lost) <= max(_FLATTENED * size, known):
            best = now
            break
    return RodMotion(best.rate, best.inside, best.gain)


def find_instruments(
    e: Experiment, drive: FloatArray, position: FloatArray, motion: RodMotion
) -> dict[str, Instrument]:
    """Instruments of the columns of a run, by ``Run``'s names; of exact ones there are none."""
    if not e.time.size:
        return {}  # rows without time have no neighbours
    out = {}
    for name, values in (("drive", drive), ("position", position), ("velocity", motion.rate)):
        if (name != "velocity" or "velocity" in e) and (sigma := white_noise(values, e.uneven)):
            out[name] = Instrument(mean_around(values, 1), sigma)
    if "position" in out and "velocity" not in e:
        slope = _slope_around(position)
        size = float(np.sum(slope[motion.inside] ** 2)) or 1.0
        share = float(slope[motion.inside] @ motion.rate[motion.inside]) / size
        out["velocity"] = Instrument(share * slope, out["position"].noise * motion.gain)
    return out


def mean_around(values: FloatArray, reach: int) -> FloatArray:
    """Mean of up to ``reach`` samples on either side of each without itself, shape ``(n,)``."""
    kernel = np.ones(2 * reach + 1)
    kernel[reach] = 0.0
    total = np.convolve(values, kernel, mode="same")
    return np.asarray(total / np.convolve(np.ones(values.size), kernel, mode="same"))


def _slope_around(position: FloatArray) -> FloatArray:
    """Return a multiple of the velocity from samples more than ``REACH`` away, ``(n,)``."""
    total = np.concatenate(([0.0], np.cumsum(position)))
    k = np.arange(position.size)

    def mean(first: npt.NDArray[np.intp], last: npt.NDArray[np.intp]) -> FloatArray:
        low, high = np.clip(first, 0, k.size - 1), np.clip(last, 0, k.size - 1)
        return np.asarray((total[high + 1] - total[low]) / (high + 1 - low))

    return np.asarray(mean(k + REACH + 1, k + 2 * REACH) - mean(k - 2 * REACH, k - REACH - 1))
