"""Zero-phase filters of a record: local polynomials, sharpening, the noise of a sensor."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...experiment import Experiment, FloatArray
from ...signals import matched_kernel, smooth

Mask = npt.NDArray[np.bool_]
DEGREE = 2


def _local_polynomial(
    time: FloatArray, values: FloatArray, step: float, half: int
) -> tuple[FloatArray, Mask]:
    """Local quadratics on an uneven time base, by value, slope and curvature.

    Returns
    -------
    rows : (4, n)
        Value, first and second derivative, and the share of each sample's own reading in
        its value.
    inside : (n,)
        False near the ends and where the window bridges a gap.
    """
    n, width = values.size, 2 * half + 1
    rows, inside = np.zeros((4, n)), np.zeros(n, dtype=bool)
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
        rows[:3, at] = found.T / np.array([1.0, half * step, 0.5 * (half * step) ** 2])[:, None]
        rows[0, at] += middle
        rows[3, at] = np.linalg.inv(moments)[:, 0, 0]
        inside[at] = good
    rows[:, :half], rows[:, n - half :] = rows[:, half, None], rows[:, n - half - 1, None]
    return rows, inside


def sensor_noise(values: FloatArray, time: FloatArray, resolution: float) -> float:
    """Noise that no motion explains: high differences, or the resolution if that is more.

    A handful of exact levels, as in a table of plateaus, is no resolution.
    """
    if np.ptp(values) < 20.0 * resolution:
        resolution = 0.0
    floor = float(resolution / np.sqrt(12.0))
    if values.size < 8:
        return floor
    found = [float(np.median(np.abs(_rough(values, time, order)))) for order in (3, 5)]
    return max(1.4826 * min(found), floor)


def _rough(values: FloatArray, time: FloatArray, order: int) -> FloatArray:
    """Divided differences, scaled so that white noise keeps its size; without time: as even."""
    if not time.size:
        time = np.arange(values.size, dtype=float)
    n = values.size - order
    t = np.stack([time[k : n + k] for k in range(order + 1)])
    t = (t - t[0]) / max(float(np.median(t[order] - t[0])), 1e-300)
    weights = []
    for k in range(order + 1):
        gaps = t[k] - np.delete(t, k, axis=0)
        weights.append(1.0 / np.prod(gaps, axis=0))
    w = np.stack(weights)
    w /= np.sqrt(np.sum(w**2, axis=0))
    return np.asarray(np.sum(w * np.stack([values[k : n + k] for k in range(order + 1)]), axis=0))


def differentiate(experiment: Experiment, values: FloatArray, half: int) -> tuple[FloatArray, Mask]:
    """Value, rate, curvature, own share: shape ``(4, n)``; and where the window is whole."""
    if experiment.uniform:
        s = smooth(values, experiment.sample_time, half, DEGREE)
        own = np.full(values.size, matched_kernel(half, 0, DEGREE)[half])
        return np.stack([s.value, s.rate, s.curvature, own]), s.inside
    return _local_polynomial(experiment.time, values, experiment.sample_time, half)


def sharpened(kernel: FloatArray) -> FloatArray:
    """Kernel of :func:`sharpen` after this one, three times as long."""
    twice = np.convolve(kernel, kernel)
    out = np.convolve(twice, kernel)
    reach = kernel.size // 2
    out[reach:-reach] -= 3.0 * twice
    out[2 * reach : -2 * reach] += 3.0 * kernel
    return out


def _pad(values: FloatArray, before: int, after: int) -> FloatArray:
    """Continue a signal at both ends, point symmetric about its ends if it is long enough."""
    if values.size > max(before, after):
        return np.pad(values, (before, after), mode="reflect", reflect_type="odd")
    return np.pad(values, (before, after), mode="edge")


def fill(values: FloatArray, inside: Mask) -> FloatArray:
    """Continue a filtered signal over the ends, and straight over gaps."""
    index = np.flatnonzero(inside)
    first, last = int(index[0]), int(index[-1])
    between = np.interp(np.arange(first, last + 1), index, values[index])
    return _pad(between, first, values.size - 1 - last)


def sharpen(values: FloatArray, kernel: FloatArray) -> FloatArray:
    """Put back what a filter took off, but for the third power of its share.

    What another pass takes off is what the first one took, to first order (Tukey's twicing).
    """
    reach = kernel.size // 2
    out = lost = values
    for _ in range(2):
        lost = lost - np.convolve(_pad(lost, reach, reach), kernel, "valid")
        out = out + lost
    return out
