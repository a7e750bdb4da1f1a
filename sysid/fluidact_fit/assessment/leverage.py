"""Leave-one-out of every sample, in closed form.

With the derivatives ``J`` of a least-squares fit the estimate without sample ``i`` differs by
``(J'J)^-1 J_i' r_i / (1 - h_i)``, ``h_i`` being the sample's leverage, the diagonal of
``J (J'J)^-1 J'`` [1]_.

References
----------
.. [1] R. D. Cook, S. Weisberg, Residuals and Influence in Regression, 1982.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..estimation.blocks import condensed
from ..experiment import BoolArray, FloatArray, IndexArray
from ..rows import blocks, ends_of, square_sum

_ODD = 1e-6  # probability of a residual that large among all samples
_MOVES = 0.5  # standard errors by which an odd sample may move a parameter
_CARRIES = 3.0  # standard errors by which any sample may
_FAR = 10.0  # standard deviations that no noise reaches
_CLOSE = 1.0 - 1e-9  # of a limit; rounding does not pass over what lies between


@dataclass(frozen=True)
class Effect:
    """What one sample does to the solution.

    Attributes
    ----------
    series, row
        Where it is: the series, and the row among its used samples.
    leverage, deviations
        Entry on the diagonal of the hat matrix, and studentised residual.
    odd
        Whether that is too large for one of that many.
    parameter, errors
        Number of the parameter that it moves most, and by how many standard errors.
    """

    series: int
    row: int
    leverage: float
    deviations: float
    odd: bool
    parameter: int
    errors: float

    @property
    def deciding(self) -> bool:
        """Whether the result hangs on it."""
        return abs(self.errors) > (_MOVES if self.odd else _CARRIES)

    @property
    def outlying(self) -> bool:
        """Whether no model near this one explains it: it is odd, and decides or lies far off."""
        return self.odd and (abs(self.errors) > _MOVES or abs(self.deviations) > _FAR)


@dataclass(frozen=True)
class Influence:
    """What the samples do to the solution.

    Attributes
    ----------
    leverage, most
        The largest leverage, and the most standard errors by which one moves a parameter.
    effects
        Those of samples that decide or lie far off, in order.
    odd
        Samples of every series that are odd, in order, shape ``(m_i,)`` each.
    inverse
        That of the triangle of the derivatives: rows of them times it are those of the
        orthogonal factor, shape ``(p, p)``.
    """

    leverage: float
    most: float
    effects: Sequence[Effect]
    odd: Sequence[IndexArray]
    inverse: FloatArray


def measure_influence(
    jacobians: Sequence[FloatArray], residuals: Sequence[FloatArray], known: FloatArray
) -> Influence | None:
    """What every sample does to the estimate; ``None`` where too few of them tell.

    Parameters
    ----------
    jacobians, residuals
        Of every series, shapes ``(n_i, p)`` and ``(n_i,)``.
    known : (p,)
        Standard errors of the parameters.
    """
    table = condensed(jacobians)
    n, p = sum(r.size for r in residuals), table.shape[1]
    if n <= p + 10:
        return None
    scale = np.linalg.norm(table, axis=0)
    scale[scale == 0.0] = 1.0
    triangle = np.linalg.qr(table / scale, mode="r")
    if np.min(np.abs(np.diag(triangle))) < 1e-9:
        return None
    inverse = np.linalg.inv(triangle) / scale[:, None]
    reach = float((np.linalg.norm(inverse, axis=1) / known).max())
    scatter = _Scatter.of(residuals, p)
    limit = _limit(n, n - p - 1)
    leverage, most, effects = 0.0, 0.0, []
    odd: list[list[IndexArray]] = [[] for _ in residuals]
    for series, part in ((k, at) for k, r in enumerate(residuals) for at in blocks(r.size)):
        r = residuals[series][part]
        q = jacobians[series][part] @ inverse
        own = np.minimum(np.einsum("ij,ij->i", q, q), 1.0 - 1e-9)
        leverage = max(leverage, float(own.max()))
        # no parameter moves by more than this; what that leaves is looked at closely
        moved = np.sqrt(own) * np.abs(r) * (reach / (1.0 - own))
        near = (moved >= _CLOSE * min(most, _CARRIES)) | scatter.may_be_odd(r, own, limit)
        rows = np.flatnonzero(near)
        own, deviations = own[rows], scatter.studentised(r[rows], own[rows])
        errors = (q[rows] * (r[rows] / (1.0 - own))[:, None]) @ inverse.T / known
        size, strange = np.abs(errors).max(axis=1), np.abs(deviations) > limit
        most = max(most, float(size.max(initial=0.0)))
        odd[series].append(part.start + rows[strange])
        strong = (size > _MOVES) | (np.abs(deviations) > _FAR)
        for i in np.flatnonzero((strange & strong) | (size > _CARRIES)):
            k = int(np.argmax(np.abs(errors[i])))
            found = (float(own[i]), float(deviations[i]), bool(strange[i]), k, float(errors[i, k]))
            effects.append(Effect(series, part.start + int(rows[i]), *found))
    return Influence(leverage, most, effects, [np.concatenate(rows) for rows in odd], inverse)


@dataclass(frozen=True)
class _Scatter:
    """Size of the residuals of a fit of ``p`` unknowns.

    ``squares`` is the sum of their squares, ``robust`` their standard deviation by the median or
    infinite where that is not far below the one by the squares, ``largest`` the largest of them.
    """

    samples: int
    p: int
    squares: float
    robust: float
    largest: float

    @classmethod
    def of(cls, residuals: Sequence[FloatArray], p: int) -> _Scatter:
        """The scatter of all series together."""
        n = sum(r.size for r in residuals)
        squares = sum(map(square_sum, residuals))
        largest = max(max(high, -low) for low, high in map(ends_of, residuals))
        per_median = 1.4826 * np.sqrt(n / max(n - p, 1))
        enough = np.sqrt(squares / max(n - p - 1, 1)) / (2.0 * per_median)
        below = sum(
            int(np.count_nonzero(np.abs(r[at]) < enough))
            for r in residuals
            for at in blocks(r.size)
        )
        if 2 * below < n - 1:
            return cls(n, p, squares, np.inf, largest)
        size = np.concatenate([np.abs(r) for r in residuals])  # an array, however long
        median = float(np.median(size, overwrite_input=True))
        return cls(n, p, squares, per_median * median, largest)

    def may_be_odd(self, r: FloatArray, leverage: FloatArray, limit: float) -> BoolArray:
        """Whether residuals may exceed a limit in standard deviations of the others."""
        degrees = max(self.samples - self.p - 1, 1)
        least = limit * np.sqrt(self.squares / (degrees + limit**2))
        if self.robust > 0.0:
            least = min(least, limit * 2.0 * self.robust)
        return np.asarray(r**2 >= _CLOSE * least**2 * (1.0 - leverage))

    def studentised(self, r: FloatArray, leverage: FloatArray) -> FloatArray:
        """Residuals in standard deviations of the others, robust against many odd ones."""
        own = r / np.sqrt(1.0 - leverage)
        degrees = max(self.samples - self.p - 1, 1)
        sigma = np.sqrt(np.maximum(self.squares - own**2, 0.0) / degrees)
        # a residual that is mostly zero (a counter at rest) has no robust size
        sigma = sigma if self.robust == 0.0 else np.minimum(sigma, 2.0 * self.robust)
        # of a residual that is one sample alone nothing is left but rounding
        return np.asarray(own / np.maximum(sigma, 1e-12 * max(self.largest, 1e-300)))


def _limit(n: int, degrees: int) -> float:
    """Studentised residual that one of ``n`` exceeds with a probability of ``_ODD``."""
    from scipy.special import stdtrit

    return float(-stdtrit(max(degrees, 1), 0.5 * _ODD / n))
