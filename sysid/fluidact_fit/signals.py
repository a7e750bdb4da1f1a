"""Derivatives of sampled signals by zero-phase local polynomials.

A straight or quadratic polynomial is fitted to a window around every sample (Savitzky,
Golay 1964): no phase, no start-up transient, and the noise it lets through is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .experiment import FloatArray


@dataclass(frozen=True)
class Smoothed:
    """Value, first and second derivative at the kept samples.

    ``inside`` marks the samples whose window lies within the record.
    """

    value: FloatArray
    rate: FloatArray
    curvature: FloatArray
    inside: npt.NDArray[np.bool_]


def smooth(values: FloatArray, sample_time: float, half_width: int, degree: int = 2) -> Smoothed:
    """Fit a polynomial to ``2 half_width + 1`` samples around every sample.

    Parameters
    ----------
    values : (n,)
    sample_time
        [s]
    half_width
        Samples on either side, at least 1.
    degree
        Of the polynomial, at least 2 for a second derivative.

    Returns
    -------
    Smoothed
        Arrays of shape ``(n,)``; at the ends the outermost full window is used.
    """
    half_width = max(1, min(half_width, (values.size - 1) // 2))
    degree = min(degree, 2 * half_width)
    offsets = np.arange(-half_width, half_width + 1)
    kernel = np.linalg.pinv(np.vander(offsets, degree + 1, increasing=True))
    padded = np.pad(values, half_width, mode="edge")
    rows = [np.convolve(padded, k[::-1], mode="valid") for k in kernel]
    inside = np.ones(values.size, dtype=bool)
    inside[:half_width] = False
    inside[values.size - half_width :] = False
    curvature = rows[2] if degree >= 2 else np.zeros(values.size)
    return Smoothed(rows[0], rows[1] / sample_time, 2.0 * curvature / sample_time**2, inside)


def rise_and_fall(values: FloatArray) -> tuple[float, float]:
    """Largest rise above an earlier value, and largest fall below one; ``values`` is ``(n,)``."""
    rise = float(np.max(values - np.minimum.accumulate(values)))
    return rise, float(np.max(np.maximum.accumulate(values) - values))
