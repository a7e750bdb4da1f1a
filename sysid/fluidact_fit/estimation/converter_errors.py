"""Quantisation errors of a converter, which last as long as a reading does: no white noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..experiment import BoolArray, FloatArray
from ..rows import blocks

_LASTING = 12  # samples from which a reading is too long for noise to dither it
_CROSSED = 2.0 / 3.0  # mean square step of readings [codes^2] where noise takes them across codes
_ADDS = 0.02  # share of a variance that is worth a closer look
_RESTING = 0.05  # share of the samples without such noise, from which their errors may matter
_TRIES = (20, 200)  # least and largest number of draws of the position of a signal in its code
_NEAR = (5, 25, 125)  # samples over which a signal hardly changes: always, and where it may rest
_TURNS = 20  # of an iteration that has long converged by then
_DRAWN = 5_000_000  # samples of all draws together, unless that leaves too few draws
_MUCH = 0.3  # share of the variance of a residual that makes a converter coarse
_BENDS = 9.0  # variance ratio from which a slope or bow of a residual is not noise


def is_coarse(step: float, sigma: float) -> bool:
    """Return whether the error of a converter is much of a residual of deviation ``sigma``."""
    return step**2 / 12.0 >= _MUCH * sigma**2


def noise_beside(readings: Sequence[tuple[FloatArray, float]], sigma: float) -> float:
    """Variance of a residual of deviation ``sigma`` without the errors of the converter."""
    step = max(step for _, step in readings)
    return max(sigma**2 - step**2 / 12.0, 0.0)


def code_errors(
    jacobian: Sequence[FloatArray],
    residuals: Sequence[FloatArray],
    readings: Sequence[tuple[FloatArray, float]],
    bread: FloatArray,
    noise: float,
    *,
    apart: bool,
    mirrored: bool,
) -> FloatArray:
    """``J' R J`` of the errors of a converter, shape ``(p, p)``, beside white noise.

    The position of the signal within its code is drawn at random; see
    ``docs/theory/noisy-inputs.md``.

    Parameters
    ----------
    jacobian, residuals
        Per series, shapes ``(n_i, p)`` and ``(n_i,)``.
    readings
        Per series the logged output, shape ``(n_i,)``, and the step of its converter.
    bread
        ``(J'J)^-1``, shape ``(p, p)``.
    noise
        Variance of the white noise.
    apart
        Whether every series has an offset, and hence a position within the codes, of its own.
    mirrored
        Whether errors are mirrored at zero, as those of a symmetric machine are.
    """
    p, samples = jacobian[0].shape[1], sum(y.size for y, _ in readings)
    rng = np.random.default_rng(0)
    tries = int(np.clip(_DRAWN // samples, *_TRIES))
    codes = _by_codes(jacobian, readings, mirrored)
    away = rng.standard_normal((tries, codes.shape[0])) @ (codes @ bread)
    parts = rng.uniform(-0.5, 0.5, (tries, len(jacobian) if apart else 1))
    parts = np.broadcast_to(parts, (tries, len(jacobian)))
    sizes, most = np.full(tries, np.sqrt(noise)), _most_noise(readings)
    if most < sizes[0]:
        sizes = most * rng.uniform(size=tries)
    sums = np.zeros((tries, p))
    for i, (j, r, (y, step)) in enumerate(zip(jacobian, residuals, readings)):
        if not step > 0.0:
            continue
        signal, shaken = _signal(np.asarray(y), np.asarray(r))
        for at in blocks(y.size):
            rows, sides = np.asarray(j[at]), step * (np.sign(y[at]) if mirrored else 1.0)
            for k in range(tries):
                moved = signal[at] + rows @ away[k] + parts[k, i] * sides
                moved += sizes[k] * shaken[at] * rng.standard_normal(moved.size)
                sums[k] += (step * np.round(moved / step) - moved) @ rows
    return np.asarray(sums.T @ sums / tries)


def codes_matter(
    jacobian: Sequence[FloatArray],
    readings: Sequence[tuple[FloatArray, float]],
    bread: FloatArray,
    total: FloatArray,
    sigma: float,
) -> bool:
    """Return whether the errors of a converter are not white, and matter.

    They are not white where the converter is coarse, or where noise does not take the signal across
    codes. The covariance without them is ``total``, the deviation of the residual ``sigma``.
    """
    step = max((step for _, step in readings), default=0.0)
    if is_coarse(step, sigma):
        return True
    if not _rests(readings):
        return False
    error = _by_codes(jacobian, readings, mirrored=False) @ bread
    return bool(np.any(np.sum(error**2, axis=0) > _ADDS * np.diag(total)))


def _rests(readings: Sequence[tuple[FloatArray, float]]) -> bool:
    """Return whether neither noise nor motion takes the signal across codes, for long enough."""
    resting, samples = 0, 0
    for y, step in readings:
        for at in blocks(y.size) if step > 0.0 else ():
            moved = np.diff(y[at], prepend=y[at][:1]) ** 2
            level = np.convolve(moved, np.full(min(_LASTING, moved.size), 1.0 / _LASTING), "same")
            resting += int(np.count_nonzero(level < _CROSSED * step**2))
        samples += y.size
    return resting > _RESTING * samples


def _most_noise(readings: Sequence[tuple[FloatArray, float]]) -> float:
    """Largest standard deviation of noise that the longest constant reading allows, at 5 %."""
    from scipy.special import ndtri

    samples, longest, step = sum(y.size for y, _ in readings), 0, 0.0
    for y, own in readings:
        ends = np.flatnonzero(np.diff(y, prepend=np.nan, append=np.nan))
        longest, step = max(longest, int(np.diff(ends).max(initial=0))), max(step, own)
    stays = 0.5
    for _ in range(_TURNS):
        stays = min((0.05 / (samples * (1.0 - stays))) ** (1.0 / max(longest, 1)), 1.0 - 1e-9)
    return -0.5 * step / float(ndtri(0.5 * (1.0 - stays)))


def _by_codes(
    jacobian: Sequence[FloatArray], readings: Sequence[tuple[FloatArray, float]], mirrored: bool
) -> FloatArray:
    """Sums of the derivatives over all samples of a code, times the size of its error, (k, p).

    With ``mirrored``, a code below zero has the negative error of the code above zero.
    """
    size = np.abs if mirrored else np.asarray
    values = np.unique(np.concatenate([np.unique(size(y)) for y, _ in readings]))
    sums = np.zeros((values.size, jacobian[0].shape[1]))
    for j, (y, step) in zip(jacobian, readings):
        for at in blocks(y.size):
            which, rows = np.searchsorted(values, size(y[at])), np.asarray(j[at])
            weights = step * np.sign(y[at]) if mirrored else np.full(which.size, step)
            for k in range(rows.shape[1]):
                sums[:, k] += np.bincount(which, weights * rows[:, k], values.size)
    return sums / np.sqrt(12.0)


def _signal(y: FloatArray, r: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Reconstruct the input of a converter from readings less residuals; shape ``(n,)``.

    Within a lasting reading the level of the residual is taken, with a slope and a bow where these
    are significant. Returned with it is the mask of samples of short readings.
    """
    starts = np.concatenate(([0], np.flatnonzero(np.diff(y)) + 1))
    lengths = np.diff(np.append(starts, y.size))
    which = np.repeat(np.arange(starts.size), lengths)

    def sums(values: FloatArray) -> FloatArray:
        return np.asarray(np.add.reduceat(values, starts))

    curve = (sums(r) / lengths)[which]
    left = sums((r - curve) ** 2)
    off = (np.arange(y.size) - (starts + 0.5 * (lengths - 1))[which]) / lengths[which]
    bow = off**2 - (sums(off**2) / lengths)[which]
    for column in (off, bow):  # at right angles to the level and to each other
        size = np.maximum(sums(column**2), 1e-300)
        slope = sums(column * r) / size
        left = left - slope**2 * size
        seen = slope**2 * size > _BENDS * left / np.maximum(lengths - 3, 1)
        curve += np.where(seen, slope, 0.0)[which] * column
    short = (lengths < _LASTING)[which]
    return np.where(short, _smooth(y, r), y - curve), short


def _smooth(y: FloatArray, r: FloatArray) -> FloatArray:
    """Reconstruct the input of a converter where noise dithers its readings, shape ``(n,)``.

    Noise of a regressor is in the residual but not in the signal, so neighbours are averaged: as
    many as stay within the two codes that the signal lies between.
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    moved = np.diff(y)
    step = 1.5 * float(np.abs(moved[moved != 0.0]).min(initial=np.inf))
    out = y.copy()
    for near in _NEAR:
        count = np.ones(min(near, y.size))
        mean = np.convolve(y - r, count, "same") / np.convolve(np.ones(y.size), count, "same")
        between = maximum_filter1d(y, count.size) - minimum_filter1d(y, count.size) <= step
        out = np.where(between | (near == _NEAR[0]), mean, out)
    return out
