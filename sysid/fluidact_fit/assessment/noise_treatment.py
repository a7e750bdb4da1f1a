"""Regression of the residual on the derivatives of a fit and further columns.

It estimates which changes of the parameters, and which size of one more column, explain the
residual. The noise of a solution (:class:`.NoiseModel`) decides how: for each kind there is one
class, two here and one in :mod:`.corrected_score`. Theory: ``docs/theory/score-test.md``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from ..estimation.blocks import condense, rows_of
from ..estimation.least_squares import NEGLIGIBLE, scaled_least_squares
from ..estimation.uncertainty import covariance, fit_autoregression, innovations
from ..experiment import FloatArray
from ..rows import middle_of, side_by_side
from . import policy

_ORDER = 25  # highest order of the autoregression that whitens the residual
_NEARBY = 12, 24  # distance [rows], longer than the filter of a velocity reaches


@dataclass(frozen=True)
class TermRegression:
    """Regression of the residual on the parameters and one more column.

    Attributes
    ----------
    shifts
        Changes of the parameters, shape ``(p,)``.
    size, error
        Size of the further column, and its standard error.
    shifts_per_size
        Changes of the parameters per unit of a given size, shape ``(p,)``.
    distinct
        Whether the parameters cannot represent the column.
    degrees
        Degrees of freedom of the standard error.
    """

    shifts: FloatArray
    size: float
    error: float
    shifts_per_size: FloatArray
    distinct: bool
    degrees: int


class NoiseTreatment(Protocol):
    """Regression of the residual of a fit, allowing for its noise."""

    def regress(
        self, columns: Sequence[FloatArray], instruments: Sequence[FloatArray] = ()
    ) -> TermRegression | None:
        """Regress on the derivatives and one column, ``(n_i,)`` each; ``None`` without an answer.

        ``instruments`` are that column without the noise of inputs, where that is known. A
        treatment by instruments otherwise takes the mean of the column over rows before and after
        that share no sample with it.
        """
        ...

    def triangle(self, columns: Sequence[FloatArray]) -> tuple[FloatArray, int] | None:
        """Triangle of ``(J, columns, r)`` without the noise, and the number of rows behind it."""
        ...


def solve_triangle(triangle: FloatArray, rows: int) -> TermRegression | None:
    """Regression by a triangle ``(p + 2, p + 2)`` of derivatives, column and residual."""
    columns, target = triangle[:, :-1], triangle[:, -1]
    last = columns.shape[1] - 1
    if triangle.shape[0] <= last:
        return None
    own, whole = abs(float(columns[last, last])), float(np.linalg.norm(columns[:, last]))
    x = scaled_least_squares(columns, target)
    left = float(np.linalg.norm(target - columns @ x))
    degrees = max(rows - columns.shape[1], 1)
    error = left / np.sqrt(degrees) / own if own else np.inf
    shifts_per_size = -scaled_least_squares(columns[:last, :-1], columns[:last, last])
    distinct = bool(own) and own >= policy.DIRECTION_LEFT * whole
    return TermRegression(x[:-1], float(x[-1]), error, shifts_per_size, distinct, degrees)


@dataclass(frozen=True)
class AugmentedJacobian:
    """Columns ``(J, further columns, r)`` of every series.

    Attributes
    ----------
    jacobians, columns, residuals
        Shapes ``(n_i, p)``, ``(n_i,)`` or ``(n_i, q)``, and ``(n_i,)``.
    roles
        Channel of every series: each has noise of its own.
    own_levels
        Whether a series has an offset of its own: the means of its columns are then taken off.
    """

    jacobians: Sequence[FloatArray]
    columns: Sequence[FloatArray]
    residuals: Sequence[FloatArray]
    roles: Sequence[str]
    own_levels: Sequence[bool]

    @property
    def rows(self) -> int:
        """Number of rows of all series."""
        return sum(r.size for r in self.residuals)

    @property
    def _series(self) -> Iterator[tuple[Sequence[FloatArray], FloatArray | None]]:
        """Columns of every series, and what is subtracted of all rows of it."""
        parts = zip(self.jacobians, self.columns, self.residuals, strict=True)
        for columns, own in zip(parts, self.own_levels):
            means = [np.atleast_1d(x.mean(axis=0)) for x in columns] if own else []
            yield columns, np.concatenate(means) if own else None

    @cached_property
    def tables(self) -> list[FloatArray]:
        """All rows of every series, shape ``(n_i, p + q + 1)``."""
        tables = ((side_by_side(*columns), mean) for columns, mean in self._series)
        return [t if mean is None else t - mean for t, mean in tables]

    @property
    def is_finite(self) -> bool:
        """Return whether all numbers of all rows are finite."""
        every = (*self.jacobians, *self.columns, *self.residuals)
        return all(np.isfinite(x).all() for x in every)

    @cached_property
    def whitened(self) -> FloatArray:
        """Rows of all series, filtered so that what the columns leave of the residual is white.

        Condensed, shape ``(m, p + q + 1)``; every channel is scaled to the variance of the first.
        """
        series = list(self._series)
        table = np.vstack([condense(rows_of(*one)) for one in series])
        found = np.append(-scaled_least_squares(table[:, :-1], table[:, -1]), 1.0)
        models: dict[str, tuple[FloatArray, float]] = {}
        for role in dict.fromkeys(self.roles):
            own = []
            for (columns, _), of in zip(series, self.roles):
                if of == role:  # the middle shows its autocorrelation well enough
                    middle = middle_of(len(columns[0]))
                    noise = side_by_side(*(x[middle] for x in columns)) @ found
                    own.append(noise - noise.mean())
            a, variance = fit_autoregression(own, int(min(_ORDER, min(n.size for n in own) // 10)))
            models[role] = a, float(np.sqrt(variance)) or 1.0
        first = models[self.roles[0]][1]
        out = []
        for one, role in zip(series, self.roles, strict=True):
            a, deviation = models[role]
            white = condense(innovations(rows, a) for rows in rows_of(*one, before=a.size))
            out.append(white * (first / deviation))
        return np.vstack(out)


@dataclass(frozen=True)
class Whitened:
    """Rao's score test with an autoregressive model of the noise."""

    augmented: AugmentedJacobian

    def triangle(self, columns: Sequence[FloatArray]) -> tuple[FloatArray, int] | None:
        """As of :class:`NoiseTreatment`."""
        table = replace(self.augmented, columns=columns)
        if not table.is_finite:
            return None
        return np.asarray(np.linalg.qr(table.whitened, mode="r")), table.rows

    def regress(
        self, columns: Sequence[FloatArray], instruments: Sequence[FloatArray] = ()
    ) -> TermRegression | None:
        """As of :class:`NoiseTreatment`."""
        found = self.triangle(columns)
        return None if found is None else solve_triangle(*found)


@dataclass(frozen=True)
class Instrumented:
    """Two-stage least squares: noise of an input is in residual and derivatives alike.

    Attributes
    ----------
    instruments
        Derivatives with instruments in the place of noisy inputs, shape ``(n_i, p)`` each.
    """

    augmented: AugmentedJacobian
    instruments: Sequence[FloatArray]

    def triangle(self, columns: Sequence[FloatArray]) -> None:
        """No answer: several directions at once would be those of the noise."""
        return

    def regress(
        self, columns: Sequence[FloatArray], instruments: Sequence[FloatArray] = ()
    ) -> TermRegression | None:
        """As of :class:`NoiseTreatment`."""
        table = replace(self.augmented, columns=columns)
        instead = instruments or [_mean_nearby(c) for c in columns]
        exogenous = replace(self.augmented, columns=instead, jacobians=self.instruments)
        if not table.is_finite or not exogenous.is_finite:
            return None
        rows = table.tables
        stacked = np.vstack(rows)
        design, residual = stacked[:, :-1], stacked[:, -1]
        z = np.vstack(exogenous.tables)[:, :-1]
        projected = z @ scaled_least_squares(z, design, NEGLIGIBLE)
        triangle = np.asarray(np.linalg.qr(projected, mode="r"))
        own, whole = abs(float(triangle[-1, -1])), float(np.linalg.norm(triangle[:, -1]))
        x = scaled_least_squares(projected, residual)
        cuts = np.cumsum([r.shape[0] for r in rows])[:-1]
        spread = covariance(np.split(projected, cuts), np.split(residual - design @ x, cuts))
        error = float(np.sqrt(max(spread.covariance[-1, -1], 0.0)))
        shifts_per_size = -scaled_least_squares(projected[:, :-1], design[:, -1])
        distinct = own >= policy.DIRECTION_LEFT * whole > 0.0
        degrees = max(design.shape[0] - design.shape[1], 1)
        return TermRegression(x[:-1], float(x[-1]), error, shifts_per_size, distinct, degrees)


def _mean_nearby(column: FloatArray) -> FloatArray:
    """Mean of a column, shape ``(n,)``, over rows before and after each row."""
    near, far = _NEARBY
    total, k = np.concatenate(([0.0], np.cumsum(column))), np.arange(column.size)
    first = np.clip([k - far, k + near], 0, column.size)
    last = np.clip([k - near + 1, k + far + 1], 0, column.size)
    sums, rows = (total[last] - total[first]).sum(axis=0), (last - first).sum(axis=0)
    return np.asarray(sums / np.maximum(rows, 1))
