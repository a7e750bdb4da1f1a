"""Noise on the logged command of a gray box, and what it does to the estimates.

A simulation takes its input for exact. Where the logged command is a reading rather than the
number that the controller sent, its noise passes through valve and oil and ends as a random
walk of the position, most of which the fit absorbs: the residual hardly shows it, while gains
and dead zone scatter several times as far as white residuals would make them.

How much noise there is follows from the log itself, from differences of the command. Whether
the machine saw it is another matter: a controller that closes a loop over a noisy position sends a
noisy command, and then the log is right. The residuals decide, by the restricted
likelihood [1]_ of the linearised model with and without noise at the input [2]_.

References
----------
.. [1] D. Harville, "Maximum likelihood approaches to variance component estimation and to
   related problems", J. Am. Stat. Assoc. 72, 1977.
.. [2] L. Ljung, System Identification: Theory for the User, 2nd ed., 1999, section 4.3.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...estimation.noise import noise_floor
from ...experiment import FloatArray
from .gray_search import STATE_SCALE, GraySolution

_ENOUGH = 20_000  # samples of a log that the likelihood looks at
_SURE = 2.0  # by which the likelihood has to favour an exact command


class _Linearised(NamedTuple):
    """A log about its solution, sample by sample.

    ``channels`` are the measured states and ``sigma`` their weights; ``residuals`` have the shape
    ``(channels, n)``, ``jacobian`` has ``(channels, n, p)``. ``white`` is the standard deviation
    of the white part of every channel, ``noise`` that of the command [V]; ``transition`` and
    ``drive`` are the derivatives of :meth:`.GrayBox.per_sample`.
    """

    channels: list[int]
    sigma: FloatArray
    residuals: FloatArray
    jacobian: FloatArray
    white: FloatArray
    noise: float
    transition: FloatArray
    drive: FloatArray


def command_noise(solution: GraySolution) -> tuple[FloatArray, float]:
    """Variances of the free parameters by noise on the command and white noise on the channels.

    They stand beside the covariance that the residuals show, and the larger ones count: what
    residuals show of themselves at a few hundred instants that matter is less than there was,
    because the fit went after them. Returned as well is the largest standard deviation found on
    the command of a log [V], 0 where all are exact.
    """
    jacobian = np.vstack(solution.jacobian)
    scale = np.linalg.norm(jacobian, axis=0)
    if not scale.size or not np.all(scale > 0.0):
        return np.zeros(scale.size), 0.0
    bread = np.linalg.pinv((jacobian / scale).T @ (jacobian / scale)) / np.outer(scale, scale)
    middle = np.zeros_like(bread)
    largest = 0.0
    box = solution.problem.box
    for k, log in enumerate(box.logs):
        channels = list(log.channels)
        residuals = solution.residuals[k].reshape(len(channels), -1)
        own = solution.jacobian[k].reshape(*residuals.shape, -1)
        white = np.array([noise_floor(r, 2, robust=False) for r in residuals])
        middle += np.einsum("c,cnp,cnq->pq", white**2, own, own)
        noise = noise_floor(log.command, 4)
        if noise == 0.0:
            continue
        near = _Linearised(
            channels, solution.problem.sigma[channels], residuals, own, white, noise,
            *box.per_sample(log, solution.states[k], solution.values),
        )  # fmt: skip
        if _favours_noise(near):
            largest = max(largest, noise)
            scores = _score_slopes(near)
            middle += noise**2 * scores.T @ scores
    return np.diag(bread @ middle @ bread), largest


def _score_slopes(log: _Linearised) -> FloatArray:
    """Derivatives of the score ``J' r`` by every sample of the command, ``(n - 1, p)``.

    The adjoint of the linearised model: ``l_k = C' j_k + A_k' l_{k+1}``, slope ``b_k' l_{k+1}``.
    """
    _, n, p = log.jacobian.shape
    out, adjoint = np.empty((n - 1, p)), np.zeros((4, p))
    weights = 1.0 / log.sigma[:, None]
    for k in range(n - 2, -1, -1):
        adjoint[log.channels] += log.jacobian[:, k + 1] * weights
        out[k] = log.drive[k] @ adjoint
        adjoint = log.transition[k].T @ adjoint
    return out


def _favours_noise(log: _Linearised) -> bool:
    """Whether the residuals speak for noise on the command, or at least not against it."""
    if not np.all(log.white > 0.0):
        return True
    table = np.concatenate((log.residuals[:, :, None], log.jacobian), axis=2)[:, :_ENOUGH]
    table = table.transpose(1, 0, 2) / log.white[:, None]
    table[:, :, 1:] /= np.maximum(np.linalg.norm(table[:, :, 1:], axis=(0, 1)), 1e-300)
    plain = _restricted(table, 0.0)
    return plain < _restricted(*_innovations(log, table)) + _SURE


def _innovations(log: _Linearised, table: FloatArray) -> tuple[FloatArray, float]:
    """Kalman filter over every column of a table, ``(n, channels, m)``, in units of the noise.

    Returns the whitened table and the logarithm of the determinant of its covariance.
    """
    channels, m = table.shape[1:]
    observe = np.zeros((channels, 4))
    seen = STATE_SCALE[log.channels] / (log.white * log.sigma)
    observe[np.arange(channels), log.channels] = seen
    steps = log.transition * STATE_SCALE / STATE_SCALE[:, None]
    pushes = log.noise * log.drive / STATE_SCALE
    state, spread = np.zeros((4, m)), np.zeros((4, 4))
    out, logarithm = np.empty_like(table), 0.0
    for k, row in enumerate(table):
        if k:
            state = steps[k - 1] @ state
            spread = steps[k - 1] @ spread @ steps[k - 1].T + np.outer(pushes[k - 1], pushes[k - 1])
        crossed = observe @ spread
        root = np.linalg.cholesky(crossed @ observe.T + np.eye(channels))
        inverse = np.linalg.inv(root)
        out[k] = inverse @ (row - observe @ state)
        logarithm += 2.0 * float(np.sum(np.log(np.diag(root))))
        gain = inverse @ crossed
        state = state + gain.T @ out[k]
        spread = spread - gain.T @ gain
    return out, logarithm


def _restricted(table: FloatArray, logarithm: float) -> float:
    """Restricted log-likelihood of the first column after a fit of the others to it."""
    rows = table.reshape(-1, table.shape[2])
    r, j = rows[:, 0], rows[:, 1:]
    product = j.T @ j + 1e-9 * np.eye(j.shape[1])
    fitted = np.linalg.solve(product, j.T @ r)
    cost = float(r @ r - fitted @ (j.T @ r))
    return -0.5 * (logarithm + float(np.linalg.slogdet(product)[1]) + cost)
