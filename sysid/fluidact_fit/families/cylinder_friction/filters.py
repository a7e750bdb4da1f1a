"""Zero-phase filters of a record: local polynomials, sharpening, derivatives."""

from __future__ import annotations

import numpy as np

from ...experiment import BoolArray, Experiment, FloatArray
from ...signals import polynomial_taps, smooth

DEGREE = 2
FIVE_POINTS = np.array([-1.0, 8.0, 0.0, -8.0, 1.0]) / 12.0  # of a derivative per step


def differentiate(
    experiment: Experiment, values: FloatArray, half: int
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Local quadratics: value and slope, shape ``(n,)`` each, and where the window is whole.

    It has ``2 half + 1`` samples, and does not bridge a gap. On an uneven time base values and
    instants are both quadratics of the row, taken where the instant is that of the sample.
    """
    s = smooth(values, experiment.sample_time, half, DEGREE)
    if experiment.uniform:
        return s.value, s.rate, s.inside
    time = smooth(experiment.time, experiment.sample_time, half, DEGREE)
    late = (experiment.time - time.value) / time.rate
    value = s.value + late * (s.rate + 0.5 * late * s.curvature)
    rate = (s.rate + late * s.curvature) / (time.rate + late * time.curvature)
    inside, width = s.inside.copy(), 3.0 * half * experiment.sample_time
    inside[half : inside.size - half] &= (
        experiment.time[2 * half :] - experiment.time[: -2 * half] < width
    )
    return value, rate, inside


def sharpener(kernel: FloatArray) -> FloatArray:
    """Weights that restore what a filter ``K`` removed, but for the third power of its share.

    Another pass removes what the first one did, to first order (Tukey's twicing):
    ``3 - 3 K + K^2``.
    """
    reach, out = kernel.size // 2, np.convolve(kernel, kernel)
    out[reach : out.size - reach] -= 3.0 * kernel
    out[2 * reach] += 3.0
    return out


def filtered(values: FloatArray, kernel: FloatArray) -> FloatArray:
    """A signal through symmetric weights, continued at both ends, shape ``(n,)``."""
    reach = kernel.size // 2
    return np.convolve(_pad(values, reach, reach), kernel, "valid")


def _pad(values: FloatArray, before: int, after: int) -> FloatArray:
    """Continue a signal at both ends, point symmetric about its ends if it is long enough."""
    if values.size > max(before, after):
        return np.pad(values, (before, after), mode="reflect", reflect_type="odd")
    return np.pad(values, (before, after), mode="edge")


def fill(values: FloatArray, inside: BoolArray) -> FloatArray:
    """Continue a filtered signal over the ends, and straight over gaps."""
    index = np.flatnonzero(inside)
    first, last = int(index[0]), int(index[-1])
    between = np.interp(np.arange(first, last + 1), index, values[index])
    return _pad(between, first, values.size - 1 - last)


def matched_kernel(half_width: int, order: int) -> FloatArray:
    """Symmetric weights that smooth a signal as a local polynomial smooths its own one.

    The slope (``order`` 1) of a polynomial fitted to a position is a weighted mean of the
    velocity within the window, with two weights more than the value (``order`` 0) has. This is
    the same mean of a signal sampled at the same instants that moves as a cubic between them.
    """
    taps = polynomial_taps(half_width, DEGREE)[order]
    if order == 0:
        return np.asarray(taps)
    share = -np.cumsum(taps)[:-1]  # of the velocity in the interval after each sample
    return np.convolve(share, np.array([-1.0, 13.0, 13.0, -1.0]) / 24.0)


def central_difference(values: FloatArray, time: FloatArray) -> FloatArray:
    """Derivative of a smooth signal: by five points where the time base is even, else three."""
    out = np.asarray(np.gradient(values, time))
    step = np.diff(time)
    if values.size >= 5 and np.ptp(step) < 1e-3 * float(step.mean()):
        out[2:-2] = np.convolve(values, FIVE_POINTS, "valid") / float(step.mean())
    return out
