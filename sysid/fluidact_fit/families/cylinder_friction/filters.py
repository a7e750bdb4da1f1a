"""Zero-phase filters of a record: local polynomials, sharpening, derivatives, sensor noise."""

from __future__ import annotations

import numpy as np

from ...estimation.noise import noise_floor
from ...experiment import BoolArray, Experiment, FloatArray
from ...signals import smooth

DEGREE = 2


def _local_polynomial(
    time: FloatArray, values: FloatArray, step: float, half: int
) -> tuple[FloatArray, BoolArray]:
    """:func:`differentiate` on an uneven time base; a window that bridges a gap is not whole."""
    n, width = values.size, 2 * half + 1
    rows, inside = np.zeros((3, n)), np.zeros(n, dtype=bool)
    if n < width:
        return rows, inside
    times = np.lib.stride_tricks.sliding_window_view(time, width)
    windows = np.lib.stride_tricks.sliding_window_view(values, width)
    for begin in range(0, times.shape[0], 4096):
        part = slice(begin, min(begin + 4096, times.shape[0]))
        at = slice(part.start + half, part.stop + half)
        s = (times[part] - time[at, None]) / (half * step)
        middle = values[at]
        powers = np.stack([np.ones_like(s), s, s * s])
        moments = np.einsum("ikj,lkj->kil", powers, powers)
        right = np.einsum("ikj,kj->ki", powers, windows[part] - middle[:, None])
        good = (s[:, -1] - s[:, 0] < 3.0) & (s[:, -1] > 0.5) & (s[:, 0] < -0.5)
        moments[~good] = np.eye(3)
        found = np.linalg.solve(moments, right[:, :, None])[:, :, 0]
        rows[0, at] = found[:, 0] + middle
        rows[1, at] = found[:, 1] / (half * step)
        rows[2, at] = np.linalg.inv(moments)[:, 0, 0]
        inside[at] = good
    rows[:, :half], rows[:, n - half :] = rows[:, half, None], rows[:, n - half - 1, None]
    return rows, inside


def sensor_noise(experiment: Experiment, role: str) -> float:
    """Noise that no motion explains: high differences, or the resolution if that is more.

    A handful of exact levels, as in a table of plateaus, is not a resolution.
    """
    signal = experiment.signals[role]
    values, resolution = signal.values, signal.resolution
    if np.ptp(values) < 20.0 * resolution:
        resolution = 0.0
    time = None if experiment.uniform or not experiment.time.size else experiment.time
    found = [noise_floor(values, k, time=time) for k in (3, 5) if values.size >= 4 * k]
    return max(min(found, default=0.0), float(resolution / np.sqrt(12.0)))


def differentiate(
    experiment: Experiment, values: FloatArray, half: int
) -> tuple[FloatArray, BoolArray]:
    """Local quadratics: value, slope and each sample's own share in its value, shape ``(3, n)``.

    The mask says where the window of ``2 half + 1`` samples is whole.
    """
    if not experiment.uniform:
        return _local_polynomial(experiment.time, values, experiment.sample_time, half)
    s = smooth(values, experiment.sample_time, half, DEGREE)
    own = np.full(values.size, matched_kernel(half, 0)[half])
    return np.stack([s.value, s.rate, own]), s.inside


def sharpened(kernel: FloatArray, taps: FloatArray) -> FloatArray:
    """Taps of a filter and of :func:`sharpen` after it: ``3 - 3 K + K^2``."""
    reach = kernel.size // 2
    out = np.convolve(kernel, kernel)
    out[reach:-reach] -= 3.0 * kernel
    out[2 * reach] += 3.0
    return np.convolve(taps, out)


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


def sharpen(values: FloatArray, kernel: FloatArray) -> FloatArray:
    """Restore what a filter removed, but for the third power of its share.

    Another pass removes what the first one did, to first order (Tukey's twicing).
    """
    reach = kernel.size // 2
    out = lost = values
    for _ in range(2):
        lost = lost - np.convolve(_pad(lost, reach, reach), kernel, "valid")
        out = out + lost
    return out


def matched_kernel(half_width: int, order: int) -> FloatArray:
    """Symmetric weights that smooth a signal as a local polynomial smooths its own one.

    The slope (``order`` 1) of a polynomial fitted to a position is a weighted mean of the
    velocity within the window, with two weights more than the value (``order`` 0) has. This is
    the same mean of a signal sampled at the same instants that moves as a cubic between them.
    """
    offsets = np.arange(-half_width, half_width + 1)
    degree = min(DEGREE, 2 * half_width)
    taps = np.linalg.pinv(np.vander(offsets, degree + 1, increasing=True))[order]
    if order == 0:
        return np.asarray(taps)
    share = -np.cumsum(taps)[:-1]  # of the velocity in the interval after each sample
    return np.convolve(share, np.array([-1.0, 13.0, 13.0, -1.0]) / 24.0)


def central_difference(values: FloatArray, time: FloatArray) -> FloatArray:
    """Derivative of a smooth signal: by five points where the time base is even, else three."""
    out = np.asarray(np.gradient(values, time))
    step = np.diff(time)
    if values.size >= 5 and np.ptp(step) < 1e-3 * float(step.mean()):
        d = 8.0 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])
        out[2:-2] = d / (12.0 * float(step.mean()))
    return out
