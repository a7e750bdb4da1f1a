"""Derivatives, further columns and residual of a fit beside each other, block by block.

What least squares make of them needs the products of the columns alone; whitened or not, no more
than a block of rows is ever made (:mod:`fluidact_fit.estimation.blocks`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..estimation.blocks import condense, joined
from ..estimation.least_squares import scaled_least_squares
from ..estimation.uncertainty import fit_autoregression, innovations, middle_of
from ..experiment import FloatArray
from ..rows import blocks, column_means, is_kept, side_by_side

_ORDER = 25  # highest of the autoregression that whitens the residual


@dataclass(frozen=True)
class Beside:
    """Columns ``(J, further ones, r)`` of every series.

    Attributes
    ----------
    jacobians, columns, residuals
        Shapes ``(n_i, p)``, ``(n_i,)`` or ``(n_i, q)``, and ``(n_i,)``.
    roles
        Channel of every series: each has noise of its own.
    free
        Whether an offset of its own takes the mean of a series: all columns are then free of
        theirs.
    """

    jacobians: Sequence[FloatArray]
    columns: Sequence[FloatArray]
    residuals: Sequence[FloatArray]
    roles: Sequence[str]
    free: Sequence[bool]

    @property
    def rows(self) -> int:
        """Number of rows of all series."""
        return sum(r.size for r in self.residuals)

    @cached_property
    def _means(self) -> list[FloatArray]:
        """What is taken from the columns of every series."""
        return [self._mean(k) if free else np.zeros(1) for k, free in enumerate(self.free)]

    def _mean(self, k: int) -> FloatArray:
        """Mean of every column of one series."""
        if self._is_kept(k):
            parts = self.jacobians[k], self.columns[k], self.residuals[k]
            return np.concatenate([np.atleast_1d(column_means(x)) for x in parts])
        triangle = self._with_ones[k]
        return np.asarray(triangle[0, 1:] / triangle[0, 0])

    def _is_kept(self, k: int) -> bool:
        """Whether making the rows of a series again takes no time."""
        return is_kept(self.jacobians[k])

    @cached_property
    def _with_ones(self) -> dict[int, FloatArray]:
        """Triangles of a column of ones and all others as they are, where rows are not kept."""
        found = {}
        for k in (k for k in range(len(self.residuals)) if not self._is_kept(k)):
            parts = (self._raw(k, at) for at in blocks(self.residuals[k].size))
            table = condense(side_by_side(np.ones(len(x)), x) for x in parts)
            found[k] = np.asarray(np.linalg.qr(table, mode="r"))
        return found

    def _raw(self, k: int, at: slice) -> FloatArray:
        return side_by_side(self.jacobians[k][at], self.columns[k][at], self.residuals[k][at])

    def _table(self, k: int, at: slice) -> FloatArray:
        """Some rows of one series."""
        raw = self._raw(k, at)
        raw -= self._means[k]
        return raw

    @property
    def tables(self) -> list[FloatArray]:
        """All rows of every series, shape ``(n_i, p + q + 1)``."""
        return [self._table(k, slice(None)) for k in range(len(self.residuals))]

    def _blocks(self, k: int, order: int = 0) -> Iterator[FloatArray]:
        """Blocks of one series, each with some rows of the one before."""
        for at in blocks(self.residuals[k].size):
            yield self._table(k, slice(max(at.start - order, 0), at.stop))

    @cached_property
    def _plain(self) -> list[FloatArray]:
        """Every series condensed."""
        return [self._condensed(k) for k in range(len(self.residuals))]

    def _condensed(self, k: int) -> FloatArray:
        """One series condensed; what is beside a column of ones is what is left without means."""
        if self._is_kept(k):
            return condense(self._blocks(k))
        triangle = self._with_ones[k]
        return triangle[1:, 1:] if self.free[k] else triangle[:, 1:]

    def _left(self, k: int, found: FloatArray) -> float:
        """Mean of a combination of the columns of one series."""
        if not self._is_kept(k):
            return 0.0 if self.free[k] else float(self._mean(k) @ found)
        return sum(float(np.sum(x @ found)) for x in self._blocks(k)) / self.residuals[k].size

    @property
    def finite(self) -> bool:
        """Whether all numbers are."""
        try:
            return all(np.isfinite(x).all() for x in self._plain)
        except np.linalg.LinAlgError:
            return False

    def whiten(self, noise: Sequence[FloatArray] | None = None) -> FloatArray:
        """Rows of all series, condensed, as the residual becomes white; shape ``(m, p + q + 1)``.

        Every channel comes out with the same variance. ``noise`` of every series is what
        becomes white instead of the residual.
        """
        models = self._noise(self.residuals if noise is None else noise)
        out = []
        for k, role in enumerate(self.roles):
            a, deviation = models[role]
            out.append((self._whitened(k, a) if a.size else self._plain[k]) / deviation)
        return np.vstack(out)

    def _whitened(self, k: int, a: FloatArray) -> FloatArray:
        return condense(innovations(x, a) for x in self._blocks(k, a.size))

    def _noise(self, residuals: Sequence[FloatArray]) -> dict[str, tuple[FloatArray, float]]:
        """Autoregression of the residuals of every channel, and what is left of them.

        What is left is in parts of the first channel's, whose unit stays.
        """
        found: dict[str, tuple[FloatArray, float]] = {}
        for role in dict.fromkeys(self.roles):
            own = [r for of, r in zip(self.roles, residuals, strict=True) if of == role]
            shortest = min(r.size for r in own)
            a, variance = fit_autoregression(own, int(min(_ORDER, shortest // 10)))
            found[role] = a, float(np.sqrt(variance)) or 1.0
        first = found[self.roles[0]][1]
        return {role: (a, deviation / first) for role, (a, deviation) in found.items()}

    def left_over(self) -> list[FloatArray]:
        """What is left of the residual when all other columns are fitted to it, of every series.

        Noise is to be judged with them in the model: what drifts is not noise, nor is the level
        of a log beside the others. Of a long series that is the part that shows its colour.
        """
        table = np.vstack(self._plain)
        found = np.append(-scaled_least_squares(table[:, :-1], table[:, -1]), 1.0)
        out = []
        for k, r in enumerate(self.residuals):
            mean = self._left(k, found)
            middle = middle_of(r.size)
            parts = (slice(middle.start + at.start, middle.start + at.stop)
                     for at in blocks(middle.stop - middle.start))  # fmt: skip
            out.append(joined([self._table(k, at) @ found for at in parts]) - mean)
        return out
