"""Intervals of two-stage least squares that hold where the instruments say little.

An estimate with instruments is ``z'y / z'a``, and its standard error takes ``z'a`` for known.
Where the noise of the column ``a`` is not small beside what the instrument ``z`` has in common
with it, it is not, and an estimate that is too small looks the more precise. Which values ``b``
are possible is seen from ``y - b a`` alone, which has nothing in common with ``z`` at the right
one [1]_. With ``x`` the projected column beside all others, ``e`` what the projection left of
the column and ``r`` the residual, ``b + d`` is possible where

    d^2 (x'x)^2 <= t^2 var(x'(r - d e)),

a quadratic in ``d``. The variances are those of the products sample by sample: instrument and noise
of the column come from the same samples, at other times. It has no upper end where
``(x'x)^2`` is less than ``t^2 var(x'e)``, and those of the intervals that happen to have one hold
too seldom where it is less than ``37.4 var(x'e)`` [2]_: both are refused. (At 16.4, the critical
value for errors of one size [3]_, chance still picked 17 of 200 recordings of which 41 % held.)

References
----------
.. [1] T. W. Anderson, H. Rubin, "Estimation of the parameters of a single equation in a complete
   system of stochastic equations", Annals of Mathematical Statistics 20, 1949.
.. [2] J. L. Montiel Olea, C. Pflueger, "A robust test for weak instruments", Journal of Business
   and Economic Statistics 31, 2013, table 1: one instrument, bias of 5 %.
.. [3] J. H. Stock, M. Yogo, "Testing for weak instruments in linear IV regression", in
   Identification and Inference for Econometric Models, 2005, table 5.2: one instrument, 10 %.
"""

from __future__ import annotations

import numpy as np

from ..experiment import FloatArray
from .uncertainty import score_covariance, t_quantile

_WEAK = 37.4  # squared product of a column with its instrument, over its variance by noise
_NOISELESS = 1e-9  # part of a column that rounding may leave of it


def reachable_variances(
    columns: FloatArray,
    projected: FloatArray,
    residual: FloatArray,
    known: FloatArray,
    degrees: int,
) -> FloatArray:
    """Variances of unknowns whose intervals reach as far as the values that are possible.

    Parameters
    ----------
    columns, projected
        Weighted columns and their projections on the instruments, shape ``(n, p)``.
    residual
        Weighted, shape ``(n,)``, of the same unit for all rows.
    known, degrees
        Variances of the estimate, shape ``(p,)``, and its degrees of freedom.

    Returns
    -------
    Shape ``(p,)``; 0 for columns without noise, infinite where an interval has no end.
    """
    t = t_quantile(0.975, degrees)
    return np.array([
        _reach(*_beside(columns, projected, k), residual, float(known[k]), t) ** 2 / t**2
        for k in range(columns.shape[1])
    ])  # fmt: skip


def _beside(columns: FloatArray, projected: FloatArray, k: int) -> tuple[FloatArray, FloatArray]:
    """A projected column without what the others have of it, and what it lacks, ``(n,)`` each."""
    others = np.delete(projected, k, axis=1)
    scale = np.linalg.norm(others, axis=0)
    others = others / np.where(scale > 0.0, scale, 1.0)
    own = projected[:, k] - others @ np.linalg.lstsq(others, projected[:, k], rcond=1e-12)[0]
    return own, columns[:, k] - projected[:, k]


def _reach(
    own: FloatArray, left: FloatArray, residual: FloatArray, variance: float, t: float
) -> float:
    """Distance of the farther end of the values that are possible."""
    x = float(own @ own)
    if not x or not np.any(residual) or float(left @ left) <= _NOISELESS**2 * x:
        return 0.0

    def of(series: FloatArray) -> float:
        """Variance of its product with the instrument."""
        rows = [slice(0, series.size)]
        found = score_covariance([own[:, None]], [series], [rows]).covariance
        return x**2 * float(found[0, 0])

    scale = float(np.linalg.norm(residual) / np.linalg.norm(left))
    alone, ee = of(residual / scale), of(left)
    re = 0.5 * (of(residual / scale + left) - alone - ee) * scale
    rr = max(alone * scale**2, variance * x**2)
    if x**2 <= max(_WEAK, t**2) * ee:
        return np.inf
    rr, re, ee = t**2 * rr, t**2 * re, t**2 * ee
    return (abs(re) + float(np.sqrt(re**2 + (x**2 - ee) * rr))) / (x**2 - ee)
