"""Errors of a converter, which stay the same as long as a reading does: no white noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..experiment import BoolArray, FloatArray
from ..rows import blocks

_LASTING = 12  # samples of a reading that no noise shakes
_CROSSED = 2.0 / 3.0  # of a code squared, that readings differ by where noise crosses codes
_ADDS = 0.02  # of a variance that is worth a closer look
_RESTING = 0.05  # of all samples where it does not, from which on their errors may matter
_TRIES = (20, 200)  # draws of where a signal lies among the codes, fewest and most
_NEAR = (5, 25, 125)  # samples that a signal hardly changes over: always, and where it may rest
_TURNS = 20  # of an iteration whose error soon is far below what matters
_DRAWN = 5_000_000  # samples of all draws, as long as these are not the fewest
_MUCH = 0.3  # of the variance of a residual
_BENDS = 9.0  # times what noise gives, that a slope or bow of a residual has to be


def is_coarse(step: float, sigma: float) -> bool:
    """Return whether the error of a converter is much of a residual of that standard deviation."""
    return step**2 / 12.0 >= _MUCH * sigma**2


def noise_beside(readings: Sequence[tuple[FloatArray, float]], sigma: float) -> float:
    """Variance of a residual of that standard deviation without the errors of the converter."""
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

    From draws of where the signal lies among the codes; see ``docs/theory/noisy-inputs.md``.
    Errors are ``mirrored`` at zero where the machine is alike both ways. The signals of series that
    are ``apart``, each with an offset of its own, are moved by parts of a code of their own.
    ``bread`` is ``(J'J)^-1``, ``noise`` the variance of the white noise.
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
    """Return whether the errors of a converter are no white noise and matter.

    They are where the converter is coarse, or where noise does not take it across its codes. The
    covariance without them is ``total``, the standard deviation of the residual ``sigma``.
    """
    step = max((step for _, step in readings), default=0.0)
    if is_coarse(step, sigma):
        return True
    if not _rests(readings):
        return False
    error = _by_codes(jacobian, readings, mirrored=False) @ bread
    return bool(np.any(np.sum(error**2, axis=0) > _ADDS * np.diag(total)))


def _rests(readings: Sequence[tuple[FloatArray, float]]) -> bool:
    """Return whether neither noise nor motion takes what a converter was given across its codes."""
    resting, samples = 0, 0
    for y, step in readings:
        for at in blocks(y.size) if step > 0.0 else ():
            moved = np.diff(y[at], prepend=y[at][:1]) ** 2
            level = np.convolve(moved, np.full(min(_LASTING, moved.size), 1.0 / _LASTING), "same")
            resting += int(np.count_nonzero(level < _CROSSED * step**2))
        samples += y.size
    return resting > _RESTING * samples


def _most_noise(readings: Sequence[tuple[FloatArray, float]]) -> float:
    """Standard deviation of noise behind which the longest reading is hardly as long (5 %)."""
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

    ``mirrored``: a code below zero has the error of the one above, with the sign changed.
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
    """Reconstruct the input of a converter, ``(n,)``: readings less residuals; and the short ones.

    Of a lasting one the level of the residual is taken, and a slope and bow that stand out of what
    noise leaves.
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

    Noise of a regressor is in the residual, and not in the signal: neighbours are taken together,
    as many as hardly differ by more than the two codes that a signal is between.
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
