"""Covariance, intervals and residual tests.

With white residuals the covariance is ``s^2 (J'J)^-1``. Residuals of real machines are
autocorrelated; then ``J'J`` claims far too much information. The robust version fits an
autoregression to the residuals, takes its autocovariances ``R`` and returns
``(J'J)^-1 (J' R J) (J'J)^-1`` [1]_.

References
----------
.. [1] L. Ljung, System Identification: Theory for the User, 2nd ed., 1999, section 9.
.. [2] G. Ljung, G. Box, "On a measure of lack of fit in time series models",
   Biometrika 65, 1978.
.. [3] M. Kendall, "Note on bias in the estimation of autocorrelation", Biometrika 41, 1954.
.. [4] G. Bayley, J. Hammersley, "The effective number of independent observations in an
   autocorrelated time series", Supplement to the Journal of the Royal Statistical Society 8, 1946.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..experiment import BoolArray, FloatArray
from ..rows import middle_of, square_sum
from .blocks import condensed
from .converter_errors import code_errors, codes_matter, noise_beside
from .recursion import run_recursion


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of the unknowns of a least-squares fit.

    Attributes
    ----------
    covariance
        Of the unknowns, shape ``(p, p)``; infinite variances where the data determine nothing.
    degrees
        Degrees of freedom.
    sigma
        Standard deviation of the residual.
    order
        Order of the autoregressive model of the residuals, 0 where they are white.
    independent
        Number of independent samples that would show the size of the errors as well:
        ``n / sum_k rho_k^2`` over all lags [4]_; infinite where the residuals are white.
    from_scores
        Whether the covariance is that of the scores instead, without a model of the residuals.
    """

    covariance: FloatArray
    degrees: int
    sigma: float
    order: int
    independent: float = np.inf
    from_scores: bool = False


def model_of_residuals(order: int) -> str:
    """Describe the noise model of residuals for the file; see :class:`Uncertainty`."""
    return f"autoregressive residuals of order {order}" if order else "white"


@dataclass(frozen=True)
class Whiteness:
    """Ljung-Box test: statistic, p-value and number of lags."""

    statistic: float
    p_value: float
    lags: int


def t_quantile(probability: float, degrees: int) -> float:
    """Quantile of Student's t distribution."""
    from scipy.special import stdtrit

    return float(stdtrit(max(degrees, 1), probability))


def autocovariance(series: Sequence[FloatArray], lags: int) -> FloatArray:
    """Autocovariances at lags ``0..lags``, pooled over series, shape ``(lags + 1,)``."""
    total = sum(s.size for s in series)
    sums = [sum(float(s[: s.size - k] @ s[k:]) for s in series if k < s.size)
            for k in range(lags + 1)]  # fmt: skip
    return np.array(sums) / max(total, 1)


def whiteness(residuals: Sequence[FloatArray], fitted: int = 0) -> Whiteness:
    """Ljung-Box test of the residuals against correlation in time [2]_.

    Parameters
    ----------
    residuals
        One array per experiment.
    fitted
        Number of fitted unknowns; too few samples beyond it give a p-value of one.
    """
    from scipy.special import chdtrc

    kept = [r[middle_of(r.size)] for r in residuals if r.size > 3]
    kept = [r - r.mean() for r in kept]
    n = sum(r.size for r in kept)
    shortest = min((r.size for r in kept), default=0)
    lags = int(min(20, n // 5, shortest - 1))
    if lags < 1 or n <= fitted + lags:
        return Whiteness(0.0, 1.0, 0)
    r = autocovariance(kept, lags)
    if r[0] <= 0.0:
        return Whiteness(0.0, 1.0, lags)
    rho = r[1:] / r[0]
    statistic = float(n * (n + 2) * np.sum(rho**2 / (n - np.arange(1, lags + 1))))
    return Whiteness(statistic, float(chdtrc(lags, statistic)), lags)


def fit_autoregression(residuals: Sequence[FloatArray], highest: int) -> tuple[FloatArray, float]:
    """Autoregression by Levinson-Durbin, its order chosen by the Bayes criterion.

    Returns
    -------
    coefficients : (order,)
        ``e_k = sum_i coefficients[i] e_{k-1-i} + w_k``.
    variance
        Variance of ``w``.
    """
    kept = [r[middle_of(r.size)] for r in residuals if r.size > 1]
    n = sum(r.size for r in kept)
    r = autocovariance(kept, highest)
    best: tuple[FloatArray, float] = (np.zeros(0), r[0])
    if r[0] <= 0.0 or n < 10:
        return best
    a, variance = np.zeros(0), r[0]
    score = n * np.log(variance)
    for order in range(1, highest + 1):
        reflection = (r[order] - a @ r[order - 1 : 0 : -1][: order - 1]) / variance
        if not abs(reflection) < 1.0:
            break
        a = np.append(a - reflection * a[::-1], reflection)
        variance *= 1.0 - reflection**2
        now = n * np.log(max(variance, 1e-300)) + order * np.log(n)
        if now < score:
            score, best = now, (a.copy(), float(variance))
    return best


def innovations(rows: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Innovations of rows (samples first) under an autoregression, shape ``(n - order, ...)``."""
    out = rows.astype(float)
    for k, c in enumerate(coefficients):
        out[k + 1 :] -= c * rows[: -k - 1]
    return out[coefficients.size :]


def _ar_autocovariance(a: FloatArray, variance: float) -> FloatArray:
    """Autocovariances of an autoregression at all lags, negative ones last, from its spectrum."""
    root = float(np.max(np.abs(np.roots(np.concatenate(([1.0], -a)))))) if a.size else 0.0
    memory = int(min(40.0 / max(1.0 - root, 1e-4), 4e5))
    size = 1 << int(np.ceil(np.log2(max(2 * memory, 64))))
    response = np.fft.rfft(np.concatenate(([1.0], -a)), size)
    return np.fft.irfft(variance / np.abs(response) ** 2, size)


def _weighted_product(jacobian: FloatArray, r: FloatArray) -> FloatArray:
    """``J' R J`` with the symmetric Toeplitz matrix of ``r``, shape ``(p, p)``."""
    from scipy.linalg import matmul_toeplitz

    return np.asarray(jacobian.T @ matmul_toeplitz(r, jacobian))


def _coloured_product(jacobian: FloatArray, a: FloatArray) -> FloatArray:
    """``J' R J`` with the covariance of an autoregression driven by white noise, ``(p, p)``.

    With ``h`` its impulse response ``R = H H'``, ``H`` reaching back to before the first sample.
    ``H' J`` is the recursion of the autoregression, run backwards over ``J``; what it does before
    the first sample, where there is nothing to drive it, is the solution of a Lyapunov equation.
    """
    from scipy.linalg import solve_discrete_lyapunov

    q = a.size
    found = run_recursion(jacobian[::-1], a)
    first = np.zeros((q, jacobian.shape[1]))  # what the recursion ends with, the last row first
    first[: len(found)] = found[::-1][:q]
    move = np.vstack((a, np.eye(q)[: q - 1]))
    reach = solve_discrete_lyapunov(move.T, np.outer(a, a))
    return np.asarray(found.T @ found + first.T @ reach @ first)


def enlarge(matrix: FloatArray, variances: FloatArray) -> FloatArray:
    """Scale a covariance up to given variances, correlations kept."""
    now = np.diag(matrix)
    ratio = np.ones(now.size)
    np.divide(variances, now, out=ratio, where=(now > 0.0) & np.isfinite(now))
    scale = np.sqrt(np.maximum(ratio, 1.0))
    with np.errstate(invalid="ignore"):
        return np.where(matrix == 0.0, 0.0, matrix * np.outer(scale, scale))


def widen_by(matrix: FloatArray, change: FloatArray) -> FloatArray:
    """Widen a covariance ``(p, p)`` to cover a change ``(p,)`` of the values, either way."""
    return matrix + np.outer(change, change) / 3.0


def largest(candidates: Sequence[FloatArray]) -> FloatArray:
    """Covariance ``(p, p)`` that covers several candidates.

    It has the largest variance of each unknown, and the correlations of the candidate with the
    largest variances overall: mixed correlations would misjudge the sum of two unknowns.
    """
    variances = np.array([np.diag(c) for c in candidates])
    most = variances.max(axis=0)
    known = (most > 0.0) & np.isfinite(most)
    share = np.sum(variances[:, known] / most[known], axis=1)
    found = enlarge(candidates[int(np.argmax(share))], most)
    np.fill_diagonal(found, most)  # also where that candidate has a variance of zero
    return found


def _positive(matrix: FloatArray) -> FloatArray:
    """Remove the negative eigenvalues that rounding leaves in a nearly singular covariance."""
    symmetric = 0.5 * (matrix + matrix.T)
    scale = np.sqrt(np.maximum(np.diag(symmetric), 0.0))
    if not np.all(np.isfinite(symmetric)):
        return np.asarray(np.nan_to_num(symmetric, nan=np.inf))
    scale[scale == 0.0] = 1.0
    values, vectors = np.linalg.eigh(symmetric / np.outer(scale, scale))
    if values.min(initial=0.0) >= 0.0:
        return np.asarray(symmetric)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(scale, scale))


def inverse_information(table: FloatArray) -> tuple[FloatArray, BoolArray]:
    """``(J'J)^-1``, shape ``(p, p)``, and mask of the unknowns that the data do not determine.

    ``table`` is ``J``, or any table with the same products of columns, shape ``(m, p)``.
    """
    scale = np.linalg.norm(table, axis=0)
    blind = scale == 0.0
    scale = np.where(blind, 1.0, scale)
    # the triangle of a QR has the singular values of the whole, at a fraction of the cost
    _, s, vt = np.linalg.svd(np.linalg.qr(table / scale, mode="r"))
    s = np.append(s, np.zeros(vt.shape[0] - s.size))  # fewer samples than unknowns
    inverse = np.where(s > 1e-12 * s.max(initial=0.0), 1.0 / np.maximum(s, 1e-300), 0.0)
    # directions that the data do not determine leave every parameter in them unknown
    silent = np.abs(vt[inverse == 0.0])
    blind = blind | np.any(silent > 1e-4, axis=0)
    return (vt.T * inverse**2) @ vt / np.outer(scale, scale), blind


def covariance(
    jacobian: Sequence[FloatArray],
    residuals: Sequence[FloatArray],
    *,
    local_unknowns: int = 0,
    robust: bool = True,
    sigma_floor: float = 0.0,
    small_sample: bool = False,
    readings: Sequence[tuple[FloatArray, float]] = (),
) -> Uncertainty:
    """Covariance of least-squares unknowns, robust against autocorrelated residuals.

    Parameters
    ----------
    jacobian
        Per experiment, shape ``(n_i, p)``, local unknowns projected out.
    residuals
        Per experiment, shape ``(n_i,)``.
    local_unknowns
        How many local unknowns were fitted besides the ``p`` shared ones.
    robust
        Whether to look for correlation in time at all (static data: no).
    sigma_floor
        Known lower limit of the standard deviation of the noise, such as that of a converter; the
        residuals of a deterministic fit can fall below it.
    small_sample
        Whether to correct autocorrelated residuals for their small effective number [3]_; see
        ``docs/theory/independent-samples.md``.
    readings
        Per experiment the logged output, shape ``(n_i,)``, and the step of its converter.
        While a reading is constant so is its error; see :func:`.code_errors`.

    Returns
    -------
    Uncertainty
        With infinite variances in directions that the data do not determine.
    """
    stacked = condensed(jacobian)
    n, p = sum(len(j) for j in jacobian), stacked.shape[1]
    degrees = max(n - p - local_unknowns, 1)
    cost = float(sum(map(square_sum, residuals)))
    sigma = max(np.sqrt(cost / degrees), sigma_floor)
    bread, blind = inverse_information(stacked)
    order, middle, independent = 0, None, np.inf
    if robust:
        a, variance = _noise_model(residuals)
        order = a.size
        if order:
            independent = _independent(a, n)
            variance *= n / degrees
            # the autoregression keeps the variance of the residuals, floor included
            variance *= max(sigma**2 / float(_ar_autocovariance(a, variance)[0]), 1.0)
            middle = variance * np.sum([_coloured_product(j, a) for j in jacobian], axis=0)
    total = sigma**2 * bread if middle is None else bread @ middle @ bread
    total = _positive(total)
    if order and small_sample:
        effective = _effective(total, sigma**2 * bread, n)
        total *= effective / max(effective - 3.0 * p - 2.0, 0.25 * effective)
        degrees = max(int(min(effective, independent)) - p, 1)
    whole = readings and all(y.size == j.shape[0] for j, (y, _) in zip(jacobian, readings))
    if robust and whole and codes_matter(jacobian, readings, bread, total, float(sigma)):
        noise = noise_beside(readings, float(sigma))
        rest = total * (noise / sigma**2)
        total = with_codes(
            rest, jacobian, residuals, readings, bread, noise, apart=local_unknowns > 0
        )
    total[blind, blind] = np.inf
    return Uncertainty(total, degrees, float(sigma), order, independent)


def with_codes(
    rest: FloatArray,
    jacobian: Sequence[FloatArray],
    residuals: Sequence[FloatArray],
    readings: Sequence[tuple[FloatArray, float]],
    bread: FloatArray,
    noise: float,
    *,
    apart: bool = False,
) -> FloatArray:
    """Covariance with the errors of a converter added to ``rest``, shape ``(p, p)`` each.

    The other arguments are those of :func:`.code_errors`. Whether a machine is symmetric is not
    known: both are tried, and the larger covariance counts.
    """
    middles = (
        code_errors(jacobian, residuals, readings, bread, noise, apart=apart, mirrored=mirrored)
        for mirrored in (False, True)
    )
    return largest([_positive(bread @ middle @ bread) + rest for middle in middles])


def information_units(
    jacobian: Sequence[FloatArray],
    residuals: Sequence[FloatArray],
    found: FloatArray,
    local_unknowns: int = 0,
) -> FloatArray:
    """Rise of the cost by one standard error of each unknown, shape ``(p,)``.

    It is the variance of the residual where that is white. An autocorrelated one carries less
    information: the rise is larger by the ratio of the covariance ``found``, shape ``(p, p)``, to
    that of white residuals. NaN where the data do not determine the unknown.
    """
    plain = covariance(jacobian, residuals, local_unknowns=local_unknowns, robust=False)
    own, now = np.diag(plain.covariance), np.diag(found)
    usable = np.isfinite(own) & (own > 0.0) & np.isfinite(now)
    excess = np.divide(now, own, out=np.full(own.size, np.nan), where=usable)
    return np.asarray(plain.sigma**2 * np.maximum(excess, 1.0))


def independent_samples(memory: float, n: float) -> float:
    """Number of independent samples that ``n`` of a first-order autoregression are worth [4]_.

    ``memory`` is its coefficient.
    """
    return n * (1.0 - memory**2) / (1.0 + memory**2)


def _independent(a: FloatArray, n: int) -> float:
    """Number of independent samples that ``n`` of an autoregression are worth [4]_."""
    r = _ar_autocovariance(a, 1.0)
    return n * float(r[0] ** 2 / (r @ r))


def _noise_model(residuals: Sequence[FloatArray]) -> tuple[FloatArray, float]:
    """Fit an autoregression to residuals, of an order that so many samples can support."""
    sizes = [r.size for r in residuals]
    n, shortest = sum(sizes), min(sizes, default=0)
    return fit_autoregression(residuals, min(25, shortest // 4, n // 10) if n > 30 else 0)


def _effective(total: FloatArray, white: FloatArray, n: int) -> float:
    """Number of samples with independent errors that would give the variances of ``total``."""
    alone, together = np.diag(white), np.diag(total)
    seen = (alone > 0.0) & np.isfinite(together)
    ratio = float(np.median(together[seen] / alone[seen])) if seen.any() else 1.0
    return n / max(ratio, 1.0) if np.isfinite(ratio) else float(alone.size)


def score_covariance(
    jacobian: Sequence[FloatArray],
    residuals: Sequence[FloatArray],
    channels: Sequence[Sequence[slice]],
) -> Uncertainty:
    """Covariance from the scores, for rows that are functions of the same samples.

    The scores ``J_k' r_k`` of all channels at one instant are added and their long-run
    variance is taken with a Bartlett kernel whose width follows the slowest
    first-order autocorrelation (Newey and West 1987, Andrews 1991).

    Parameters
    ----------
    jacobian, residuals
        As in :func:`covariance`, weighted.
    channels
        Per experiment the rows of every channel; shorter ones are centred on the first.
    """
    bread, blind = inverse_information(np.vstack(jacobian))
    p = len(bread)
    middle = np.zeros((p, p))
    samples, cost = 0, 0.0
    for j, r, rows in zip(jacobian, residuals, channels):
        first = rows[0]
        scores = j[first] * r[first][:, None]
        for other in rows[1:]:
            length = other.stop - other.start
            skip = (scores.shape[0] - length) // 2
            scores[skip : skip + length] += j[other] * r[other][:, None]
        middle += long_run(scores)
        samples += scores.shape[0]
        cost += float(r[first] @ r[first])
    total = _positive(bread @ middle @ bread)
    total[blind, blind] = np.inf
    degrees = max(samples - p, 1)
    return Uncertainty(total, degrees, float(np.sqrt(cost / degrees)), 0, from_scores=True)


def long_run(scores: FloatArray) -> FloatArray:
    """Sum of the autocovariances of a vector series under a Bartlett kernel, times ``n``."""
    n = scores.shape[0]
    if not n:  # a run of which nothing is described
        return np.zeros((scores.shape[1], scores.shape[1]))
    power = np.sum(scores**2, axis=0)
    alike = np.sum(scores[1:] * scores[:-1], axis=0) / np.where(power == 0.0, 1.0, power)
    rho = float(np.clip(np.max(alike, initial=0.0), 0.0, 0.999))
    width = int(min(n // 4, 1.1447 * (4.0 * rho**2 / (1.0 - rho**2) ** 2 * n) ** (1.0 / 3.0)))
    total = _weighted_product(scores, np.maximum(1.0 - np.arange(n) / (width + 1.0), 0.0))
    return np.asarray(0.5 * (total + total.T))
