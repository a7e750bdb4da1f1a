"""Noise of position and pressure: what stands in for a column that carries some.

Least squares takes its columns to be exact. Noise of one shrinks its own coefficient and spoils
the others (a stiffness comes out too small). A column is then weighed not by itself but by an
*instrument*, made of neighbouring samples only: it follows the true motion and knows nothing of
the noise of the sample. Two-stage least squares with it is consistent whatever the noise is, and
real motion, however rough, biases it as little [1]_.

A position is represented by the mean of its two neighbours. A velocity computed from positions
within ``REACH`` samples by the difference of means on both sides beyond that: white noise of
the position is then common to no column and no instrument (the weights of the neighbours cancel
in the odd filter of the velocity).

References
----------
.. [1] R. J. Bowden, D. A. Turkington, Instrumental Variables, 1984.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
import numpy.typing as npt

from ...estimation.noise import white_noise
from ...experiment import Experiment, FloatArray

REACH = 5  # samples on either side that a velocity is computed from
_ALL = 0.9  # part of the standard deviation of a column beyond which noise is all there is


@dataclass(frozen=True)
class Instrument:
    """What represents a noisy column, shape ``(n,)``, and the noise of the column [its unit]."""

    values: FloatArray
    noise: float


def instruments(
    e: Experiment, drive: FloatArray, position: FloatArray, velocity: FloatArray
) -> dict[str, Instrument]:
    """Instruments of the columns of a run, by ``Run``'s names; of exact ones there are none."""
    if not e.time.size:
        return {}  # rows without time have no neighbours
    out = {}
    for name, values in (("drive", drive), ("position", position), ("velocity", velocity)):
        recorded = name != "velocity" or "velocity" in e
        if recorded and (sigma := _noise(values)):
            out[name] = Instrument(_of_neighbours(values), sigma)
    if "position" in out and "velocity" not in e:
        gain = sqrt(2.0 * sum(k**2 for k in range(1, REACH + 1)))
        sigma = out["position"].noise / (gain * e.sample_time)
        out["velocity"] = Instrument(_of_slope(position, REACH), sigma)
    return out


def _noise(values: FloatArray) -> float:
    """White noise of a column [its unit]; 0 too where it is nothing else: there is no telling."""
    sigma = white_noise(values)
    return 0.0 if sigma > _ALL * float(values.std()) else sigma


def _of_neighbours(values: FloatArray) -> FloatArray:
    """Mean of the samples before and after each, shape ``(n,)``; at the ends the only one."""
    padded = np.concatenate((values[1:2], values, values[-2:-1]))
    return np.asarray(0.5 * (padded[:-2] + padded[2:]))


def _of_slope(position: FloatArray, reach: int) -> FloatArray:
    """What a velocity is proportional to, from samples more than ``reach`` away, ``(n,)``."""
    total = np.concatenate(([0.0], np.cumsum(position)))
    k = np.arange(position.size)

    def mean(first: npt.NDArray[np.intp], last: npt.NDArray[np.intp]) -> FloatArray:
        low, high = np.clip(first, 0, k.size - 1), np.clip(last, 0, k.size - 1)
        return np.asarray((total[high + 1] - total[low]) / (high + 1 - low))

    return np.asarray(mean(k + reach + 1, k + 2 * reach) - mean(k - 2 * reach, k - reach - 1))
