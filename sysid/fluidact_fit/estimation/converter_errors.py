"""Errors of a coarse converter: alike wherever a reading comes again, so no white noise.

Samples of one code share its error, whichever run they are from. They are one cluster, and the
covariance is that of the delete-a-cluster jackknife [1]_: with ``J_c``, ``r_c`` the rows of a code
the estimate without it differs by

    d_c = (J'J - J_c' J_c)^-1 J_c' r_c,

and the covariance is ``sum_c d_c d_c'``. A code that holds a direction nearly alone leaves nothing
in its residual: there the error has the variance ``q^2 / 12`` of a level anywhere within the code,
less what the residual scatters within it beside white noise: a signal that crosses the code
averages its error. Noise that shakes a level across two codes does so too, which is not counted on:
the intervals are then wider than they have to be.

References
----------
.. [1] A. C. Cameron, D. L. Miller, "A practitioner's guide to cluster-robust inference",
   J. Human Resources 50(2), 2015, section VI.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..experiment import FloatArray
from ..rows import blocks
from .noise import noise_floor

_COARSE = 0.3  # of the variance of a residual, that the error of a coarse converter is at least
_LASTING = 12  # samples over which a signal is seen to rest
_CROSSED = 2.0 / 3.0  # of a code squared, mean square of differences where noise crosses codes
_RESTING = 0.05  # of all samples where it does not, from which on their errors may matter
_HELD = 0.5  # leverage of a code from which its residual does not show its error
_CHANCE = 3.0  # standard deviations by which a variance may be larger by chance

Readings = Sequence[tuple[FloatArray, float]]


def is_coarse(step: float, sigma: float) -> bool:
    """Return whether the error of a converter is much of a residual of that standard deviation."""
    return step**2 / 12.0 >= _COARSE * sigma**2


def codes_matter(readings: Readings, sigma: float) -> bool:
    """Return whether the errors of a converter are no white noise.

    They are where the converter is coarse beside the residual ``sigma``, or where noise does not
    take it across its codes: the residual may hold noise of a regressor, which the reading does
    not.
    """
    step = max((step for _, step in readings), default=0.0)
    return is_coarse(step, sigma) or _rests(readings)


def _rests(readings: Readings) -> bool:
    """Return whether neither noise nor motion takes what a converter was given across its codes.

    A signal on an edge, which the least noise flips, has differences of half a code squared in the
    mean; noise of half a code, which averages the error, makes two thirds.
    """
    resting, samples = 0, 0
    for y, step in readings:
        for at in blocks(y.size) if step > 0.0 else ():
            moved = np.diff(y[at], prepend=y[at][:1]) ** 2
            level = np.convolve(moved, np.full(min(_LASTING, moved.size), 1.0 / _LASTING), "same")
            resting += int(np.count_nonzero(level < _CROSSED * step**2))
        samples += y.size
    return resting > _RESTING * samples


def code_covariance(
    jacobian: Sequence[FloatArray],
    residuals: Sequence[FloatArray],
    readings: Readings,
    bread: FloatArray,
    *,
    mirrored: bool,
) -> FloatArray:
    """Covariance ``(p, p)`` of the unknowns by errors that samples of one code share.

    Parameters
    ----------
    jacobian, residuals, readings
        Per experiment, shapes ``(n_i, p)`` and ``(n_i,)``; readings with the step of the converter.
    bread : (p, p)
        ``(J'J)^-1`` of all experiments.
    mirrored
        Whether a code below zero has the error of the one above, with the sign changed: a machine
        that is alike both ways is read alike both ways.
    """
    step = max(step for _, step in readings)
    codes = [np.round((np.abs(y) if mirrored else y) / step) for y, _ in readings]
    every, p = np.unique(np.concatenate([np.unique(c) for c in codes])), len(bread)
    count, total, square = np.zeros((3, every.size))
    scores, sums = np.zeros((2, every.size, p))
    products = np.zeros((every.size, p, p))
    for j, r, code, (y, _) in zip(jacobian, residuals, codes, readings, strict=True):
        for at in blocks(y.size):
            which, rows, left = np.searchsorted(every, code[at]), j[at], r[at]
            signs = np.sign(y[at]) if mirrored else np.ones(left.size)
            np.add.at(count, which, 1.0)
            np.add.at(total, which, signs * left)
            np.add.at(square, which, left**2)
            np.add.at(scores, which, left[:, None] * rows)
            np.add.at(sums, which, signs[:, None] * rows)
            np.add.at(products, which, rows[:, :, None] * rows[:, None, :])
    white = sum(r.size * noise_floor(r) ** 2 for r in residuals) / float(count.sum())
    most = white * (1.0 + _CHANCE * np.sqrt(2.0 / count))
    scatter = np.maximum(square / count - (total / count) ** 2 - most, 0.0)
    level = np.sqrt(np.maximum(step**2 / 12.0 - scatter, 0.0))
    moves = level[:, None] * sums @ bread
    leverages = bread @ products
    seen = np.trace(leverages, axis1=1, axis2=2) < _HELD
    rest = np.eye(p) - leverages[seen]
    moves[seen] = np.linalg.solve(rest, (scores[seen] @ bread)[:, :, None])[:, :, 0]
    return np.asarray(moves.T @ moves)
