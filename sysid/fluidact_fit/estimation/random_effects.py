"""Spread between units apart from the uncertainty of each.

    y_i = mu + u_i + e_i,   u_i ~ N(0, tau**2),   e_i ~ N(0, s_i**2),   s_i known,

the random-effects model of meta-analysis. ``mu`` and ``tau`` follow from restricted maximum
likelihood [1]_ over the units that are no outliers; a unit is one when it lies further from
``mu`` than ``sqrt(tau**2 + s_i**2)`` allows among so many (two-sided t test at 5 % over all
units together, Bonferroni).

References
----------
.. [1] W. Viechtbauer, "Bias and efficiency of meta-analytic variance estimators in the
   random-effects model", J. Educ. Behav. Stat. 30(3), 2005, section 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..experiment import Array

_FEWEST = 3  # units: with two, spread and mean leave nothing to judge either by
_TO_JUDGE = 8  # units from which on one of them can be called an outlier
_LEVEL = 0.05
_MEDIAN = 0.45493642311957283  # of chi-squared with one degree of freedom
_DROP = 3.841458820694124  # its 95 % point: of twice the log-likelihood at the ends of an interval
_ROUNDS = 20


@dataclass(frozen=True)
class Spread:
    """Estimates over units.

    ``mean`` and ``between`` (``tau``) with 95 % intervals, in the unit of the values;
    ``within`` is the typical (root mean square) standard error of one unit. ``deviation`` has
    every unit's distance from the mean in standard deviations, shape ``(n,)``; ``outlier`` says
    which are too far, shape ``(n,)``.
    """

    mean: float
    mean_ci95: tuple[float, float]
    between: float
    between_ci95: tuple[float, float]
    within: float
    deviation: Array
    outlier: npt.NDArray[np.bool_]


def estimate_spread(values: Array, errors: Array) -> Spread | None:
    """Estimate mean and spread of units; ``None`` for fewer than three.

    Parameters
    ----------
    values
        Of every unit, shape ``(n,)``, finite.
    errors
        Standard error of each, shape ``(n,)``, positive.
    """
    if values.size < _FEWEST:
        return None
    scale = float(np.sqrt(np.mean(errors**2)))
    centre = float(np.median(values))
    y, s = (values - centre) / scale, errors / scale  # numbers about one, whatever the unit
    outlier = np.zeros(y.size, dtype=bool)
    if y.size >= _TO_JUDGE:
        outlier = _outliers(y, s)
    kept = ~outlier
    mean, between = _likeliest(y[kept], s[kept])
    half = _half_width(y[kept], s[kept], mean, between)
    ends = _interval(y[kept], s[kept], between)
    return Spread(
        centre + scale * mean,
        (centre + scale * (mean - half), centre + scale * (mean + half)),
        scale * between,
        (scale * ends[0], scale * ends[1]),
        scale,
        (y - mean) / np.hypot(between, s),
        outlier,
    )


def _outliers(y: Array, s: Array) -> npt.NDArray[np.bool_]:
    """Find outlying units: from a robust start, then by likelihood until it settles."""
    mean, between = _robust(y, s)
    outlier = np.zeros(y.size, dtype=bool)
    for _ in range(_ROUNDS):
        found = np.abs(y - mean) > _limit(y.size, (~outlier).sum()) * np.hypot(between, s)
        if 2 * (~found).sum() <= y.size:
            return np.zeros(y.size, dtype=bool)
        if np.array_equal(found, outlier):
            break
        outlier = found
        mean, between = _likeliest(y[~outlier], s[~outlier])
    return outlier


def _limit(units: int, kept: int) -> float:
    """Standard deviations that none of so many units exceeds, 95 times in 100.

    Student's t, as mean and spread come from the units that were kept.
    """
    from scipy.special import stdtrit

    return float(stdtrit(kept - 2, 1.0 - _LEVEL / (2.0 * units))) * float(np.sqrt(1.0 + 1.0 / kept))


def _robust(y: Array, s: Array) -> tuple[float, float]:
    """Median, and the spread for which the median of the squared deviations is as expected."""
    from scipy.optimize import brentq

    mean = float(np.median(y))
    squares = (y - mean) ** 2

    def excess(t2: float) -> float:
        return float(np.median(squares / (t2 + s**2))) - _MEDIAN

    if excess(0.0) <= 0.0:
        return mean, 0.0
    high = float(squares.max()) / _MEDIAN + 1.0
    return mean, float(np.sqrt(brentq(excess, 0.0, high)))


def _weighted(y: Array, s: Array, t2: float) -> tuple[float, Array]:
    weights = 1.0 / (t2 + s**2)
    return float(weights @ y / weights.sum()), weights


def _deviance(y: Array, s: Array, t2: float) -> float:
    """Minus twice the restricted log-likelihood, but for a constant."""
    mean, weights = _weighted(y, s, t2)
    fit = float(weights @ (y - mean) ** 2)
    return fit - float(np.log(weights).sum()) + float(np.log(weights.sum()))


def _likeliest(y: Array, s: Array) -> tuple[float, float]:
    """Mean and spread of greatest restricted likelihood.

    Sought over the spread itself: there the likelihood is flat at zero and has one valley.
    """
    from scipy.optimize import minimize_scalar

    widest = 2.0 * float(np.ptp(y)) + 1e-12
    found = minimize_scalar(
        lambda t: _deviance(y, s, t * t), bounds=(0.0, widest), method="bounded",
        options={"xatol": 1e-9 * widest},
    )  # fmt: skip
    between = float(found.x) if found.fun < _deviance(y, s, 0.0) else 0.0
    return _weighted(y, s, between**2)[0], between


def _half_width(y: Array, s: Array, mean: float, between: float) -> float:
    """Half of the 95 % interval of the mean, after Hartung and Knapp, never below the normal one.

    The observed scatter about the mean takes the place of the assumed one, Student's t that of
    the normal distribution: the spread is estimated too.
    """
    from scipy.special import stdtrit

    _, weights = _weighted(y, s, between**2)
    observed = float(weights @ (y - mean) ** 2) / (y.size - 1)
    return float(stdtrit(y.size - 1, 0.975)) * float(np.sqrt(max(observed, 1.0) / weights.sum()))


def _interval(y: Array, s: Array, between: float) -> tuple[float, float]:
    """Profile-likelihood interval of the spread; the mean is profiled out already."""
    from scipy.optimize import brentq

    least = _deviance(y, s, between**2)

    def beyond(t: float) -> float:
        return _deviance(y, s, t * t) - least - _DROP

    low = 0.0 if between == 0.0 or beyond(0.0) <= 0.0 else float(brentq(beyond, 0.0, between))
    high = 2.0 * between + 1.0
    while beyond(high) < 0.0:
        high *= 2.0
    return low, float(brentq(beyond, between, high))
