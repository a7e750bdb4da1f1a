"""Number of independent samples that the data are worth.

The contributions of blocks of rows to the estimate reveal slowly varying errors [1]_; the strongest
autocorrelation that the restricted likelihood [2]_ does not rule out bounds the number of
independent samples in the residuals. Theory: ``docs/theory/independent-samples.md``.

References
----------
.. [1] B. Schmeiser, "Batch size effects in the analysis of simulation output", Operations
   Research 30(3), 1982.
.. [2] D. A. Harville, "Maximum likelihood approaches to variance component estimation and to
   related problems", J. American Statistical Association 72(358), 1977.
.. [3] F. E. Satterthwaite, "An approximate distribution of estimates of variance components",
   Biometrics Bulletin 2(6), 1946.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from typing import Any

import numpy as np

from ..errors import Notice
from ..estimation.blocks import condensed, joined
from ..estimation.uncertainty import independent_samples, inverse_information
from ..experiment import FloatArray
from ..logs.log import count_of
from ..rows import square_sum
from . import policy
from .corrected_score import whitened
from .optimum import Optimum

_BLOCKS = (6, 12, 24, 48)  # numbers of blocks that are compared; each divides the last
_SHORTEST = 25  # rows of a block
_TRIED = 60  # autocorrelations, denser towards 1
_ROUNDING = 1e-12  # share of a sum of squares that is rounding
_NOT_RULED_OUT = 2.7  # twice the loss of log-likelihood within a one-sided 95 % limit


def find_independent_samples(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """Return the number of independent samples in the residuals, and a warning if they are few."""
    at = whitened(at)
    slow, slow_notices = _find_slow_errors(at)
    entry, few_notices = _count_independent(at)
    return {**entry, **slow}, few_notices or slow_notices


def _find_slow_errors(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """Find slow drift that the intervals do not include: an entry for the file, and a warning."""
    if len(at.roles) > 1 or at.instruments or not all(e.time.size for e in at.experiments):
        return {}, []
    wider = wider_by_blocks(at.jacobians, at.residuals, at.std_errors)
    worst = int(np.argmax(wider))
    if wider[worst] <= policy.WIDER:
        return {}, []
    name, times = at.names[worst], float(wider[worst])
    return {"slow_errors": {"parameter": name, "times": times}}, [
        Notice(
            "errors-change-slowly",
            f"the residuals hold errors that change slowly, over a part of the log that counts: by "
            f"what its blocks contribute, {name} is uncertain by {times:.2g} times its standard "
            "error. Look for a sensor that warms up, a supply that wanders, or a machine that "
            "changes; record for longer, or zero the sensors before every log.",
        )
    ]


def wider_by_blocks(
    jacobians: Sequence[FloatArray], residuals: Sequence[FloatArray], errors: FloatArray
) -> FloatArray:
    """Ratio of the standard errors that blocks of rows show to those given, shape ``(p,)``.

    Parameters
    ----------
    jacobians, residuals
        Of every run, shapes ``(n_i, p)`` and ``(n_i,)``.
    errors
        Standard errors of the parameters so far, shape ``(p,)``.

    Returns
    -------
    (p,), 0 where the scatter of the blocks may be chance.
    """
    from scipy.special import chdtri

    bread, blind = inverse_information(condensed(jacobians))
    n = sum(r.size for r in residuals)
    counts = [count for count in _BLOCKS if n >= count * _SHORTEST]
    out = np.zeros(errors.size)
    if np.any(blind) or not counts:  # parameters may have been fitted to other channels only
        return out
    finest = counts[-1]
    begins = np.arange(finest) * n // finest
    rows, r = joined(jacobians), joined(residuals)
    # contribution of every block to the estimate, and its variance for independent unit errors
    parts, white = np.empty((2, finest, errors.size))
    for k, column in enumerate(bread.T):
        weight = rows @ column
        parts[:, k] = np.add.reduceat(weight * r, begins)
        white[:, k] = np.add.reduceat(weight**2, begins)
    left = sum(square_sum(r) for r in residuals) / n
    # the given errors may come from more rows than these: a filter settles, a log is long
    known = np.maximum(errors**2, left * white.sum(axis=0))
    for count in counts:
        sums, share = (x.reshape(count, finest // count, -1).sum(axis=1) for x in (parts, white))
        free = (1.0 - 1.0 / count) * share.sum(axis=0) ** 2 / np.sum(share**2, axis=0)
        found = np.sum(sums**2, axis=0) * count / (count - 1) / known
        more = found > chdtri(free, policy.CHANCE) / free
        out = np.where(more, np.maximum(out, found), out)
    return np.sqrt(out)


def _count_independent(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """Count the independent samples behind the size of the errors, and warn if they are few."""
    independent, unknowns = at.solution.noise.independent, len(at.names)
    if not np.isfinite(independent):
        return {}, []
    if len(at.roles) == 1 and not at.instruments:
        independent = min(independent, fewest_independent(at.part.jacobians, at.part.residuals))
    entry = {"samples": independent}
    if independent >= policy.INDEPENDENT * unknowns:
        return entry, []
    return entry, [
        Notice(
            "few-independent-samples",
            f"the residuals are so strongly autocorrelated that {at.samples} samples are worth "
            f"no more than about {ceil(independent)} independent ones, with "
            f"{count_of(unknowns, 'unknown')} fitted to them: the parameters may be off by "
            "more than their intervals say. Other warnings, if there are any, may name the cause: "
            "resolve them first. Then record for longer, with more strokes over the whole range. "
            "Faster sampling does not help.",
        )
    ]


def fewest_independent(jacobians: Sequence[FloatArray], residuals: Sequence[FloatArray]) -> float:
    """Number of independent samples for the strongest autocorrelation not ruled out.

    Parameters
    ----------
    jacobians, residuals
        Of every run, shapes ``(n_i, p)`` and ``(n_i,)``.
    """
    triangle = np.asarray(np.linalg.qr(condensed(jacobians), mode="r"))
    if np.any(inverse_information(triangle)[1]):
        return np.inf
    root, p = np.linalg.inv(triangle), len(triangle)  # columns at right angles
    here, lagged, inner = np.zeros((3, p + 1, p + 1))
    for j, r in zip(jacobians, residuals, strict=True):
        z = np.column_stack((j @ root, r))
        here += z.T @ z
        lagged += z[1:].T @ z[:-1]
        inner += z[1:-1].T @ z[1:-1]
    n, runs = sum(r.size for r in residuals), len(residuals)
    a = 1.0 - np.geomspace(1.0, 1.0 / n, _TRIED)
    sums = here - a[:, None, None] * (lagged + lagged.T) + (a**2)[:, None, None] * inner
    x, xr, rr = sums[:, :p, :p], sums[:, :p, p:], sums[:, p, p]
    left = np.maximum(rr - np.sum(xr * np.linalg.solve(x, xr), axis=(1, 2)), _ROUNDING * rr)
    cost = (n - p) * np.log(left) + np.linalg.slogdet(x)[1] - runs * np.log1p(-(a**2))
    return independent_samples(float(a[cost < cost.min() + _NOT_RULED_OUT][-1]), n)
