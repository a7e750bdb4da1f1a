"""What noise of a measured input adds to the products of columns and residual, taken away again.

The residual holds ``-G w`` of the noise ``w`` of an input, and every derivative of the output
what the model makes of it: their products have a mean although nothing is missing. What a draw
of the same noise, added once more, changes in either has products of that mean, and without it
the score is as that of exact inputs: a corrected score [1]_, as in
:mod:`fluidact_fit.estimation.input_noise`. That holds where the model is linear within the noise.

What the noise makes of the output is close to an autoregression from rest, with the noise of
the output on top. That filter whitens all columns; what a log may begin with, and its level,
is a free response of it and is projected out.

References
----------
.. [1] T. Nakamura, "Corrected score function for errors-in-variables models", Biometrika 77,
   1990.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..estimation.input_noise import left_information
from ..estimation.least_squares import orthonormal, without
from ..estimation.recursion import run_recursion
from ..estimation.whitening import Whitening
from ..experiment import FloatArray


@dataclass(frozen=True)
class Products:
    """Products of columns ``(J, further ones, r)``, shape ``(m, m)`` each.

    Attributes
    ----------
    recorded
        Of the recording, as whitened.
    added
        What every draw of the noise adds to them.
    relative
        Standard error of the power of the noise, in parts of it.
    rows
        Of the recording.
    """

    recorded: FloatArray
    added: Sequence[FloatArray]
    relative: float
    rows: int

    @property
    def finite(self) -> bool:
        """Whether all numbers are."""
        return all(bool(np.isfinite(x).all()) for x in (self.recorded, *self.added))

    @cached_property
    def _left(self) -> tuple[FloatArray, bool]:
        """Products of the columns without the noise, and whether some are all noise."""
        added = [a[:-1, :-1] for a in self.added]
        return left_information(self.recorded[:-1, :-1], added, self.relative)

    @property
    def weak(self) -> bool:
        """Whether nothing can be said of some direction of the columns for the noise."""
        return self._left[1]

    @cached_property
    def triangle(self) -> FloatArray:
        """What a triangular decomposition of all columns without the noise would be."""
        clean = self.recorded - np.mean(self.added, axis=0)
        clean[:-1, :-1], clean[-1, -1] = self._left[0], self.recorded[-1, -1]
        size = np.sqrt(np.maximum(np.diag(clean), np.finfo(float).tiny))
        values, vectors = np.linalg.eigh(clean / np.outer(size, size))
        root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * size
        return np.asarray(np.linalg.qr(root, mode="r"))

    def covariance(self, x: FloatArray) -> FloatArray:
        """Covariance of sizes ``x`` of the columns, ``(m - 1, m - 1)``.

        The noise in the columns widens it, the few draws do, and what is not known of its power.
        """
        whole, cross = self.recorded[:-1, :-1], self.recorded[:-1, -1]
        left = float(self.recorded[-1, -1] - 2.0 * x @ cross + x @ whole @ x)
        size = np.sqrt(np.diag(self._left[0]))
        inverse = np.linalg.inv(self._left[0] / np.outer(size, size)) / np.outer(size, size)
        steps = np.array([inverse @ (a[:-1, -1] - a[:-1, :-1] @ x) for a in self.added])
        bias = steps.mean(axis=0)
        covariance = left / max(self.rows - x.size, 1) * inverse @ whole @ inverse
        covariance += np.atleast_2d(np.cov(steps.T)) / len(steps)
        return np.asarray(covariance + self.relative**2 * np.outer(bias, bias))


@dataclass(frozen=True)
class Copies:
    """How the series of a fit with noisy inputs belong together.

    The first ones are those of the recording, as many as there are ``filters``; then come those
    of the copies, each with a draw of the noise added.

    Attributes
    ----------
    filters
        What whitens the residual of every series of the recording.
    relative
        As in :class:`Products`.
    jacobians, residuals
        Of all series, shapes ``(n_i, p)`` and ``(n_i,)``.
    """

    filters: Sequence[Whitening]
    relative: float
    jacobians: Sequence[FloatArray]
    residuals: Sequence[FloatArray]

    def products(self, columns: Sequence[FloatArray]) -> Products:
        """Products of columns ``(n_i,)`` or ``(n_i, q)`` of all series beside the others."""
        count, p = len(self.filters), self.jacobians[0].shape[1]
        white = [
            np.column_stack((known[:, :p], self._whiten(k, c), known[:, p:]))
            for k, (known, c) in enumerate(zip(self._known, columns, strict=True))
        ]
        whole = white[:count]
        copies = (white[k : k + count] for k in range(count, len(white), count))
        added = [_product([a - b for a, b in zip(copy, whole, strict=True)]) for copy in copies]
        return Products(_product(whole), added, self.relative, sum(w.shape[0] for w in whole))

    @cached_property
    def _known(self) -> list[FloatArray]:
        """Derivatives and residual of every series, whitened."""
        pairs = zip(self.jacobians, self.residuals, strict=True)
        return [self._whiten(k, np.column_stack(pair)) for k, pair in enumerate(pairs)]

    def _whiten(self, series: int, rows: FloatArray) -> FloatArray:
        k = series % len(self.filters)
        return without(self._free[k], self.filters[k].filter(rows.reshape(rows.shape[0], -1)))

    @cached_property
    def _free(self) -> list[FloatArray]:
        """Free responses of every filter's process, and a level, as the filter leaves them."""
        out = []
        for f, r in zip(self.filters, self.residuals):
            start = run_recursion(np.eye(r.size, f.coefficients.size), f.coefficients)
            out.append(orthonormal(f.filter(np.column_stack((start, np.ones(r.size))))))
        return out


def _product(tables: Sequence[FloatArray]) -> FloatArray:
    return np.asarray(sum(t.T @ t for t in tables))
