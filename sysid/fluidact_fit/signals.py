"""Derivatives of sampled signals by zero-phase local polynomials.

A straight or quadratic polynomial is fitted to a window around every sample (Savitzky,
Golay 1964): no phase, no start-up transient, and the noise it lets through is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .experiment import FloatArray

_PLACES, _ROUNDS = 17, 12  # between two samples, then beside the best, where a turn is looked for
_SMOOTH = 3.0  # times the larger bend beside a turn: a signal that bends more in it has a corner


@dataclass(frozen=True)
class Smoothed:
    """Value, first and second derivative at the kept samples.

    ``inside`` marks the samples whose window lies within the record, ``gain`` is the noise of the
    first derivative per white noise of the values [1/s].
    """

    value: FloatArray
    rate: FloatArray
    curvature: FloatArray
    inside: npt.NDArray[np.bool_]
    gain: float


def polynomial_taps(half_width: int, degree: int) -> FloatArray:
    """Weights of the coefficients of a polynomial fitted to ``2 half_width + 1`` samples.

    Shape ``(degree + 1, 2 half_width + 1)``: value, slope, half the curvature, ... per sample.
    """
    offsets = np.arange(-half_width, half_width + 1)
    return np.asarray(np.linalg.pinv(np.vander(offsets, degree + 1, increasing=True)))


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
    padded = np.pad(values, half_width, mode="edge")
    kernel = polynomial_taps(half_width, degree)
    rows = [np.convolve(padded, k[::-1], mode="valid") for k in kernel]
    inside = np.ones(values.size, dtype=bool)
    inside[:half_width] = False
    inside[values.size - half_width :] = False
    curvature = rows[2] if degree >= 2 else np.zeros(values.size)
    return Smoothed(
        rows[0], rows[1] / sample_time, 2.0 * curvature / sample_time**2, inside,
        float(np.linalg.norm(kernel[1])) / sample_time,
    )  # fmt: skip


def rise_and_fall(values: FloatArray) -> tuple[float, float]:
    """Largest rise above an earlier value, and largest fall below one; ``values`` is ``(n,)``."""
    rise = float(np.max(values - np.minimum.accumulate(values)))
    return rise, float(np.max(np.maximum.accumulate(values) - values))


def turns_between(
    time: FloatArray, values: FloatArray, least: float
) -> tuple[FloatArray, FloatArray]:
    """Find where a signal turned between two samples, beyond both by more than ``least``.

    Where the signal bends as much on either side as across the turn, it is the cubic through four
    samples. Elsewhere the parabolas through three samples on either side go on until they meet;
    one that would rise the more steeply towards a peak is taken for a straight line.

    Parameters
    ----------
    time, values : (n,)
    least
        [unit of the values]

    Returns
    -------
    Instants and values of the turning points, in order, shape ``(m,)``.
    """
    if values.size < 6:
        return np.zeros(0), np.zeros(0)
    step = np.diff(time)
    slope = np.diff(values) / step
    bend = np.pad(np.diff(slope) / (time[2:] - time[:-2]), 1)  # straight at the ends
    before, after = slope[:-2], slope[2:]
    least_slope = least / step[1:-1]  # no turn beyond that needs a look
    steep = (np.abs(before) > least_slope) & (np.abs(after) > least_slope)
    k = np.flatnonzero(steep & (before * after < 0.0)) + 1
    way = np.sign(slope[k - 1])[:, None]  # 1 towards a peak

    def beyond(at: FloatArray, end: npt.NDArray[np.intp], side: int) -> FloatArray:
        """Go on from sample ``end``, whose neighbour is ``end + side``."""
        line = end if side > 0 else end - 1
        away, farther = at - time[end, None], at - time[end + side, None]
        bends = np.minimum(way * bend[end + side, None], 0.0)
        straight = values[end, None] + slope[line, None] * away
        return np.asarray(way * straight + bends * away * farther)

    def through(at: FloatArray) -> FloatArray:
        """Interpolate from sample ``k - 1`` to ``k + 2``."""
        first, second, third = (at - time[k + j, None] for j in (-1, 0, 1))
        change = ((bend[k + 1] - bend[k]) / (time[k + 2] - time[k - 1]))[:, None]
        line = values[k - 1, None] + slope[k - 1, None] * first
        return np.asarray(way * (line + first * second * (bend[k, None] + change * third)))

    across, beside = bend[[k, k + 1]] * way[:, 0], bend[[k - 1, k + 2]] * way[:, 0]
    smooth = (across.sum(axis=0) > _SMOOTH * beside.min(axis=0))[:, None]
    row, low, high = np.arange(k.size), time[k], time[k + 1]
    for _ in range(_ROUNDS):
        at = low[:, None] + np.linspace(0.0, 1.0, _PLACES) * (high - low)[:, None]
        meeting = np.minimum(beyond(at, k, -1), beyond(at, k + 1, 1))
        meeting = np.where(smooth, through(at), meeting)
        best = np.argmax(meeting, axis=1)
        low = at[row, np.maximum(best - 1, 0)]
        high = at[row, np.minimum(best + 1, _PLACES - 1)]
    peak = meeting[row, best]
    found = peak - np.maximum(way[:, 0] * values[k], way[:, 0] * values[k + 1]) > least
    return at[row, best][found], (way[:, 0] * peak)[found]
