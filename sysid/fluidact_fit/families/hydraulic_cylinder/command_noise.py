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

from dataclasses import replace

import numpy as np

from ...estimation.noise import noise_floor
from ...estimation.uncertainty import Uncertainty, enlarge
from ...experiment import FloatArray
from .gray_box import GrayBox, GrayLog
from .gray_search import STATE_SCALE, GraySolution

_ENOUGH = 20_000  # samples of a log that the likelihood looks at
_SURE = 2.0  # by which the likelihood has to favour an exact command


def with_command_noise(
    box: GrayBox, solution: GraySolution, uncertainty: Uncertainty
) -> tuple[Uncertainty, float]:
    """Enlarge the covariance by what noise on the command does to the estimates.

    The variances become no smaller than white noise on the channels would make them alone: what
    residuals show of themselves at a few hundred instants that matter is less than there was,
    because the fit went after them.

    Parameters
    ----------
    box, solution, uncertainty
        The fit, and what its residuals alone say.

    Returns
    -------
    uncertainty
        With larger variances where there is reason.
    noise
        Largest standard deviation found on the command of a log [V]; 0 where all are exact.
    """
    jacobian = np.vstack(solution.jacobian)
    scale = np.linalg.norm(jacobian, axis=0)
    if not scale.size or not np.all(scale > 0.0):
        return uncertainty, 0.0
    bread = np.linalg.pinv((jacobian / scale).T @ (jacobian / scale)) / np.outer(scale, scale)
    middle = np.zeros_like(bread)
    largest = 0.0
    for k, log in enumerate(box.logs):
        own = solution.jacobian[k].reshape(len(log.channels), log.samples, -1)
        white = _white_levels(solution.residuals[k].reshape(len(log.channels), -1))
        middle += np.einsum("c,cnp,cnq->pq", white**2, own, own)
        sigma = noise_floor(log.command, 4)
        if sigma == 0.0:
            continue
        transition, drive = box.per_sample(log, solution.states[k], solution.values)
        if _favours_noise(log, solution, k, transition, drive, sigma):
            largest = max(largest, sigma)
            scores = _score_slopes(log, own, solution.sigma, transition, drive)
            middle += sigma**2 * scores.T @ scores
    total = enlarge(uncertainty.covariance, np.diag(bread @ middle @ bread))
    return replace(uncertainty, covariance=total), largest


def _white_levels(residuals: FloatArray) -> FloatArray:
    """Standard deviation of the white part of every channel of ``(channels, n)``."""
    return np.array([noise_floor(r, 2, robust=False) for r in residuals])


def _score_slopes(
    log: GrayLog, jacobian: FloatArray, sigma: FloatArray, transition: FloatArray, drive: FloatArray
) -> FloatArray:
    """Derivatives of the score ``J' r`` by every sample of the command, ``(n - 1, p)``.

    The adjoint of the linearised model: ``l_k = C' j_k + A_k' l_{k+1}``, slope ``b_k' l_{k+1}``.
    """
    n, p = jacobian.shape[1:]
    out = np.empty((n - 1, p))
    adjoint = np.zeros((4, p))
    rows = list(log.channels)
    weights = 1.0 / sigma[rows][:, None]
    for k in range(n - 2, -1, -1):
        adjoint[rows] += jacobian[:, k + 1] * weights
        out[k] = drive[k] @ adjoint
        adjoint = transition[k].T @ adjoint
    return out


def _favours_noise(
    log: GrayLog, solution: GraySolution, index: int, transition: FloatArray, drive: FloatArray,
    sigma: float,
) -> bool:  # fmt: skip
    """Whether the residuals of a log speak for noise on its command, or at least not against it.

    ``transition`` and ``drive`` are those of :meth:`.GrayBox.per_sample`, ``sigma`` is the
    standard deviation of the noise [V].
    """
    n = min(log.samples, _ENOUGH)
    channels = len(log.channels)
    r = solution.residuals[index].reshape(channels, -1)
    white = _white_levels(r)
    if not np.all(white > 0.0):
        return True
    j = solution.jacobian[index].reshape(channels, log.samples, -1)
    table = np.concatenate((r[:, :n, None], j[:, :n]), axis=2).transpose(1, 0, 2)
    table = table / white[:, None]
    table[:, :, 1:] /= np.maximum(np.linalg.norm(table[:, :, 1:], axis=(0, 1)), 1e-300)
    plain = _restricted(table.reshape(n * channels, -1), 0.0)
    noise = white * solution.sigma[list(log.channels)]
    noisy = _restricted(*_innovations(log, table, noise, transition, drive, sigma))
    return plain < noisy + _SURE


def _innovations(
    log: GrayLog, table: FloatArray, noise: FloatArray, transition: FloatArray,
    drive: FloatArray, sigma: float,
) -> tuple[FloatArray, float]:  # fmt: skip
    """Kalman filter over every column of a table, ``(n, channels, m)``, in units of the noise.

    Returns
    -------
    whitened : (n channels, m)
    logarithm
        Of the determinant of the innovations' covariance.
    """
    n, channels, m = table.shape
    observe = np.zeros((channels, 4))
    observe[np.arange(channels), list(log.channels)] = STATE_SCALE[list(log.channels)] / noise
    steps = transition * STATE_SCALE / STATE_SCALE[:, None]
    pushes = sigma * drive / STATE_SCALE
    state, spread = np.zeros((4, m)), np.zeros((4, 4))
    one = np.eye(channels)
    out, logarithm = np.empty_like(table), 0.0
    for k in range(n):
        seen = observe @ spread
        root = np.linalg.cholesky(seen @ observe.T + one)
        inverse = np.linalg.inv(root)
        out[k] = inverse @ (table[k] - observe @ state)
        logarithm += 2.0 * float(np.sum(np.log(np.diag(root))))
        gain = inverse @ seen
        state = state + gain.T @ out[k]
        spread = spread - gain.T @ gain
        if k < n - 1:
            state = steps[k] @ state
            spread = steps[k] @ spread @ steps[k].T + np.outer(pushes[k], pushes[k])
    return out.reshape(n * channels, m), logarithm


def _restricted(table: FloatArray, logarithm: float) -> float:
    """Restricted log-likelihood of the first column after a fit of the others to it."""
    r, j = table[:, 0], table[:, 1:]
    product = j.T @ j + 1e-9 * np.eye(j.shape[1])
    fitted = np.linalg.solve(product, j.T @ r)
    cost = float(r @ r - fitted @ (j.T @ r))
    return -0.5 * (logarithm + float(np.linalg.slogdet(product)[1]) + cost)
