"""Derivatives of sampled signals by zero-phase local polynomials.

A straight or quadratic polynomial is fitted to a window around every sample (Savitzky,
Golay 1964): no phase, no start-up transient, and the noise it lets through is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .experiment import FloatArray


@dataclass(frozen=True)
class Smoothed:
    """Value, first and second derivative at the kept samples.

    ``inside`` marks the samples whose window lies within the record.
    """

    value: FloatArray
    rate: FloatArray
    curvature: FloatArray
    inside: np.ndarray


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


def matched_kernel(half_width: int, order: int, degree: int = 2) -> FloatArray:
    """Kernel that smooths a signal as a local polynomial smooths the one it belongs to.

    The slope of a polynomial fitted to a position is a weighted mean of the velocity within
    the window. This is the same mean for a signal that is sampled at the same instants and
    moves as a cubic between them.

    Parameters
    ----------
    half_width
        Samples on either side of the local polynomial.
    order
        1 for what belongs to its slope, 0 for what belongs to its value.
    degree
        Of the polynomial.

    Returns
    -------
    FloatArray
        Symmetric weights with sum one: ``2 half_width + 1`` of them for the value, two more
        for the slope.
    """
    offsets = np.arange(-half_width, half_width + 1)
    degree = min(degree, 2 * half_width)
    taps = np.linalg.pinv(np.vander(offsets, degree + 1, increasing=True))[order]
    if order == 0:
        return np.asarray(taps)
    share = -np.cumsum(taps)[:-1]  # of the velocity in the interval after each sample
    return np.convolve(share, np.array([-1.0, 13.0, 13.0, -1.0]) / 24.0)


def antiderivative(values: FloatArray, time: FloatArray) -> FloatArray:
    """Integrate a signal over any time base, shape ``(n,)``; zero at the first sample.

    By Hermite cubics with slopes from parabolas: exact to the third power of the step.
    """
    step = np.diff(time)
    slope = np.gradient(values, time)
    parts = 0.5 * step * (values[1:] + values[:-1]) + step**2 * (slope[:-1] - slope[1:]) / 12.0
    return np.concatenate(([0.0], np.cumsum(parts)))


def central_difference(values: FloatArray, time: FloatArray) -> FloatArray:
    """Derivative of a smooth signal over any time base, shape ``(n,)``.

    With five points where the base is even, to the fourth power of the step, else with three.
    """
    out = np.asarray(np.gradient(values, time))
    step = np.diff(time)
    if values.size >= 5 and np.ptp(step) < 1e-3 * float(step.mean()):
        d = 8.0 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])
        out[2:-2] = d / (12.0 * float(step.mean()))
    return out


def held_direction(values: FloatArray, dead_band: float) -> np.ndarray:
    """Sign of the last change that exceeded a dead band: -1, 0 (not yet known) or 1.

    Parameters
    ----------
    values : (n,)
    dead_band
        Changes smaller than this leave the direction as it was [unit of values].
    """
    direction = np.zeros(values.size, dtype=int)
    anchor, now = values[0], 0
    for k, v in enumerate(values.tolist()):
        if v - anchor > dead_band:
            now, anchor = 1, v
        elif anchor - v > dead_band:
            now, anchor = -1, v
        elif now > 0:
            anchor = max(anchor, v)
        elif now < 0:
            anchor = min(anchor, v)
        direction[k] = now
    return direction
