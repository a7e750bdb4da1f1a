"""Corrected score: regression of the residual without what noise of a measured input adds.

Noise of an input is in the residual and in every derivative of the output, so their products have a
nonzero mean. What another draw of the same noise adds to them is subtracted [1]_. Derivation:
``docs/theory/score-test.md``.

References
----------
.. [1] T. Nakamura, "Corrected score function for errors-in-variables models", Biometrika 77,
   1990.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..estimation.input_noise import left_information, make_filters, with_noise
from ..estimation.least_squares import orthonormal, without
from ..estimation.recursion import run_recursion
from ..estimation.solution import FittedRun, differences
from ..estimation.whitening import Whitening
from ..experiment import Experiment, FloatArray
from ..outcome import Simulation
from .noise_treatment import TermRegression, solve_triangle
from .optimum import Optimum, make_optimum

_DRAWS = 3  # of the noise, each a copy of all runs
_HEAD = 8  # one over the largest share of a run that is left out while a filter settles
_ROWS = 30_000  # of every run that is copied


@dataclass(frozen=True)
class Products:
    """Products of columns ``(J, further columns, r)``, shape ``(m, m)`` each.

    Attributes
    ----------
    recorded
        Of the recording, as whitened.
    added
        Increase of the products by every draw of the noise.
    relative
        Relative standard error of the power of the noise.
    rows
        Number of rows of the recording.
    """

    recorded: FloatArray
    added: Sequence[FloatArray]
    relative: float
    rows: int

    @property
    def is_finite(self) -> bool:
        """Return whether all numbers are finite, and no column of the recording is zero."""
        known = all(bool(np.isfinite(x).all()) for x in (self.recorded, *self.added))
        return known and bool(np.all(np.diag(self.recorded)[:-1] > 0.0))

    @cached_property
    def _without_noise(self) -> tuple[FloatArray, bool]:
        """Products of the columns without the noise, and whether some are all noise."""
        added = [a[:-1, :-1] for a in self.added]
        return left_information(self.recorded[:-1, :-1], added, self.relative)

    @property
    def weak(self) -> bool:
        """Return whether noise hides some direction of the columns completely."""
        return self._without_noise[1]

    @cached_property
    def triangle(self) -> FloatArray:
        """Triangular decomposition of all columns, as it would be without the noise."""
        clean = self.recorded - np.mean(self.added, axis=0)
        clean[:-1, :-1], clean[-1, -1] = self._without_noise[0], self.recorded[-1, -1]
        size = np.sqrt(np.maximum(np.diag(clean), np.finfo(float).tiny))
        values, vectors = np.linalg.eigh(clean / np.outer(size, size))
        root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * size
        return np.asarray(np.linalg.qr(root, mode="r"))

    def covariance(self, x: FloatArray) -> FloatArray:
        """Covariance ``(m - 1, m - 1)`` of the sizes ``x`` of the columns, shape ``(m - 1,)``.

        Noise in the columns, the small number of draws, and the uncertain power of the noise all
        add to it.
        """
        whole, cross = self.recorded[:-1, :-1], self.recorded[:-1, -1]
        left = float(self.recorded[-1, -1] - 2.0 * x @ cross + x @ whole @ x)
        clean = self._without_noise[0]
        size = np.sqrt(np.diag(clean))
        inverse = np.linalg.inv(clean / np.outer(size, size)) / np.outer(size, size)
        steps = np.array([inverse @ (a[:-1, -1] - a[:-1, :-1] @ x) for a in self.added])
        bias = steps.mean(axis=0)
        covariance = left / max(self.rows - x.size, 1) * inverse @ whole @ inverse
        covariance += np.atleast_2d(np.cov(steps.T)) / len(steps)
        return np.asarray(covariance + self.relative**2 * np.outer(bias, bias))


@dataclass(frozen=True)
class CorrectedScore:
    """Corrected score of a fit with noisy inputs.

    The first series are those of the recording, as many as there are ``filters``; then follow
    those of the copies, each with a draw of the noise added.

    Attributes
    ----------
    filters
        Filters that whiten the residual of every series of the recording.
    relative
        As in :class:`Products`.
    jacobians, residuals
        Of all series, shapes ``(n_i, p)`` and ``(n_i,)``.
    """

    filters: Sequence[Whitening]
    relative: float
    jacobians: Sequence[FloatArray]
    residuals: Sequence[FloatArray]

    def triangle(self, columns: Sequence[FloatArray]) -> tuple[FloatArray, int] | None:
        """As of :class:`.NoiseTreatment`."""
        found = self.products(columns)
        return (found.triangle, found.rows) if found.is_finite else None

    def regress(
        self, columns: Sequence[FloatArray], instruments: Sequence[FloatArray] = ()
    ) -> TermRegression | None:
        """As of :class:`.NoiseTreatment`; the error allows for noise in the columns."""
        products = self.products(columns)
        if not products.is_finite or products.weak:
            return None
        found = solve_triangle(products.triangle, products.rows)
        if found is None or not found.distinct:
            return found
        x = np.append(found.shifts, found.size)
        return replace(found, error=float(np.sqrt(products.covariance(x)[-1, -1])))

    def products(self, columns: Sequence[FloatArray]) -> Products:
        """Products of columns ``(n_i,)`` or ``(n_i, q)`` with the derivatives and residuals."""
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
        white = self.filters[k].filter(rows.reshape(rows.shape[0], -1))
        return without(self._free_responses[k], white)

    @cached_property
    def _free_responses(self) -> list[FloatArray]:
        """Orthonormal basis of the filtered free responses and level of every filter's process."""
        out = []
        for f, r in zip(self.filters, self.residuals):
            start = run_recursion(np.eye(r.size, f.coefficients.size), f.coefficients)
            out.append(orthonormal(f.filter(np.column_stack((start, np.ones(r.size))))))
        return out


def _product(tables: Sequence[FloatArray]) -> FloatArray:
    return np.asarray(sum(t.T @ t for t in tables))


def with_noise_copies(at: Optimum) -> Optimum:
    """Return the fit over a recording and its copies; unchanged where its inputs are exact.

    A fit with instruments is returned unchanged, too: they show the noise. Where a score was
    corrected for the noise, only the output was compared.
    """
    if not at.solution.noise.inputs or at.instruments:
        return at
    at = at.beginning(_ROWS)
    draws = _draws(at)
    every = [*at.experiments, *(run for draw in draws for run in draw)]
    output, simulated = at.variant.output.name, at.family.simulate(at.plant, every)
    count = len(at.experiments)  # whatever noise does to an input, the samples stay the same
    simulated = [replace(s, used=simulated[k % count].used) for k, s in enumerate(simulated)]
    fitted = [Simulation.of(e, found, output) for e, found in zip(every, simulated, strict=True)]
    runs = [FittedRun(e, s, {}) for e, s in zip(every, simulated, strict=True)]
    q = at.solution.differentiated
    names, covariance = at.solution.names[:q], at.solution.covariance[:q, :q]
    tables = differences(at.family.simulate, at.plant, runs, names, covariance)
    runs = [replace(run, jacobians={output: j}) for run, j in zip(runs, tables)]
    plain = replace(at.solution, runs=runs, simulate_near=at.family.simulate)
    found = make_optimum(at.family, at.variant, plain, fitted)
    assert found is not None  # it is made of the same series
    filters = _filters(at, draws)
    relative = max(noise.relative for noise in at.solution.noise.inputs.values())
    return replace(
        found, treatment=CorrectedScore(filters, relative, found.jacobians, found.residuals)
    )


def whitened(at: Optimum) -> Optimum:
    """Return the fit with residuals and derivatives whitened as its corrected score has them.

    It is unchanged where inputs are exact or the fit has instruments. The first rows, in which the
    filter settles, are left out: the level and initial state of a run can fit them freely.
    """
    if not at.solution.noise.inputs or at.instruments:
        return at
    at = at.beginning(_ROWS)
    white = [
        (f.filter(r)[begin:], f.filter(j)[begin:])
        for f, r, j in zip(_filters(at, _draws(at)), at.residuals, at.jacobians, strict=True)
        for begin in [min(f.settling, r.size // _HEAD)]
    ]
    residuals, jacobians = zip(*white, strict=True)
    return replace(at, residuals=residuals, jacobians=jacobians)


def _filters(at: Optimum, draws: Sequence[Sequence[Experiment]]) -> list[Whitening]:
    """Filters that whiten the residual of every run whose inputs carry noise such as the draws."""
    return make_filters(_response(at, draws), at.residuals)


def _draws(at: Optimum) -> list[list[Experiment]]:
    """Copies of all runs with noise added to their inputs, one list for each draw."""
    inputs = at.solution.noise.inputs
    return [
        with_noise(at.experiments, inputs, np.random.default_rng(seed)) for seed in range(_DRAWS)
    ]


def _response(at: Optimum, draws: Sequence[Sequence[Experiment]]) -> list[FloatArray]:
    """Response of the output of every run to every draw of the noise, from rest, ``(n_i,)``."""
    output, count = at.variant.output.name, len(at.experiments)
    runs = [*at.experiments, *(run for draw in draws for run in draw)]
    # a run without a recorded output is simulated from rest
    found = at.family.simulate(at.plant, [e.without(output) for e in runs])
    return [s.output - found[k % count].output for k, s in enumerate(found)][count:]
