"""Speed and acceleration of a recorded position, from parabolas through neighbouring samples."""

from __future__ import annotations

import numpy as np

from ..experiment import FloatArray

_HALVES = (2, 3, 5, 8, 12, 20, 30, 50)  # samples on either side


def delayed(time: FloatArray, values: FloatArray, dead_time: float) -> FloatArray:
    """Return what held values were a dead time [s] ago, shape ``(n,)``; NaN before the first."""
    before = np.searchsorted(time, time - dead_time, "right") - 1
    return np.where(before < 0, np.nan, values[np.maximum(before, 0)])


def local_motion(
    time: FloatArray, position: FloatArray, noise: float, speed: float, acceleration: float = np.inf
) -> tuple[FloatArray, FloatArray]:
    """Speed and acceleration at every sample, from the shortest parabola that is sharp enough.

    For noise of standard deviation ``s`` the slope of ``2 h + 1`` samples a time ``T`` apart
    varies by ``s / (T sqrt(sum(k^2)))``, the curvature by ``2 s / (T^2 sqrt(sum(p^2)))`` with
    ``p = k^2`` less its mean.

    Parameters
    ----------
    time, position : (n,)
        [s] and the unit of the position.
    noise
        Standard deviation of the position's noise.
    speed, acceleration
        Standard deviations that are good enough.

    Returns
    -------
    tuple of (n,)
        NaN where samples are missing, and at the ends.
    """
    step = float(np.median(np.diff(time))) if time.size > 1 else 1.0
    half = _HALVES[-1]
    for half in _HALVES:
        k = np.arange(-half, half + 1.0)
        bent = k**2 - np.mean(k**2)
        rate = noise / (step * float(np.sqrt(k @ k)))
        curve = 2.0 * noise / (step**2 * float(np.sqrt(bent @ bent)))
        if rate <= speed and curve <= acceleration:
            break
    v, a = np.full(position.size, np.nan), np.full(position.size, np.nan)
    if position.size <= 2 * half:
        return v, a
    inner = slice(half, position.size - half)
    v[inner] = np.convolve(position, (k / (k @ k))[::-1], "valid") / step
    a[inner] = 2.0 * np.convolve(position, (bent / (bent @ bent))[::-1], "valid") / step**2
    span = time[2 * half :] - time[: -2 * half]
    v[inner][span > (2 * half + 0.5) * step] = np.nan
    a[inner][span > (2 * half + 0.5) * step] = np.nan
    return v, a
