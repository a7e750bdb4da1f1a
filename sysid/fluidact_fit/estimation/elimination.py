"""Linear unknowns eliminated; see :mod:`.separable`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..experiment import BoolArray, FloatArray
from ..rows import blocks
from .blocks import condense, rows_of
from .least_squares import (
    NEGLIGIBLE,
    bounded_least_squares,
    orthonormal,
    project_out,
    scaled_least_squares,
    without,
)
from .problem import Basis, Problem, bounds_of


@dataclass(frozen=True)
class _Table:
    """Weighed columns of one experiment, of a long one by the rows that `condensed` leaves.

    ``local`` come first, then ``shared``, then whatever was asked for, the rest that both are to
    explain last. ``own`` is an orthonormal basis of the local ones.
    """

    local: FloatArray
    others: FloatArray
    own: FloatArray

    @classmethod
    def of(cls, columns: Sequence[FloatArray], local: int, own: FloatArray | None = None) -> _Table:
        """Columns ``(n,)`` beside each other, so many of them local; ``own`` where it is known.

        Raises
        ------
        LinAlgError
            Where the model gives no finite numbers.
        """
        table = condense(rows_of(columns))
        if not np.all(np.isfinite(table)):
            raise np.linalg.LinAlgError("the model gives no finite numbers")
        short, kept = len(table) != len(columns[0]), table[:, :local]
        return cls(kept, table[:, local:], orthonormal(kept) if own is None or short else own)

    @cached_property
    def projected(self) -> FloatArray:
        """The others with the local columns projected out."""
        return without(self.own, self.others)

    @cached_property
    def explained(self) -> FloatArray:
        """Best explanation of the other columns by the local ones, one column for each."""
        return scaled_least_squares(self.local, self.others, NEGLIGIBLE)


class Eliminated:
    """The linear half of the problem at given ``eta``; ``LinAlgError`` where there is none.

    ``bases`` are its columns there, where they are known.
    """

    def __init__(
        self, problem: Problem, eta: FloatArray, bases: Sequence[Basis] | None = None
    ) -> None:
        self.problem = problem
        self.eta = eta
        self.bases = bases or [problem.basis(i, eta) for i in range(len(problem.measured))]
        self.tables = [
            _Table.of(problem.weigh(i, *b.local, *b.shared, y - b.known), len(b.local))
            for i, (b, y) in enumerate(zip(self.bases, problem.measured, strict=True))
        ]
        self.linear, self.linear_active = self._solve_shared()
        rest = [t.projected[:, -1] - t.projected[:, :-1] @ self.linear for t in self.tables]
        cost = float(sum(float(r @ r) for r in rest))
        self.cost = cost if np.isfinite(cost) else np.inf

    def simulate(self) -> list[FloatArray]:
        """Output of the model for every experiment."""
        return [
            np.asarray(b.combined(self.linear, local))
            for b, local in zip(self.bases, self.local, strict=True)
        ]

    def _solve_shared(self) -> tuple[FloatArray, BoolArray]:
        """Shared linear unknowns by bounded least squares (active set)."""
        unknowns = self.problem.linear
        if not unknowns:
            return np.zeros(0), np.zeros(0, dtype=bool)
        stacked = np.vstack([t.projected for t in self.tables])
        return bounded_least_squares(stacked[:, :-1], stacked[:, -1], *bounds_of(unknowns))

    @cached_property
    def local(self) -> list[FloatArray]:
        """Local unknowns of every experiment."""
        return [t.explained[:, -1] - t.explained[:, :-1] @ self.linear for t in self.tables]


class Tangent:
    """Derivatives of the model by ``eta`` at a fit.

    ``rows`` hold them weighed, with room for those by the shared unknowns, shape ``(p + q, n_i)``;
    ``tables`` hold them between shared columns and rest.
    """

    def __init__(self, fit: Eliminated, scales: FloatArray) -> None:
        self.fit = fit
        self.rows, self.tables = [], []
        problem, p = fit.problem, fit.eta.size
        for i, (b, y, t) in enumerate(zip(fit.bases, problem.measured, fit.tables, strict=True)):
            rows = np.empty((p + fit.linear.size, y.size))
            problem.write_derivatives(i, fit.eta, scales, fit.linear, fit.local[i], rows[:p])
            columns = problem.weigh(i, *b.local, *b.shared, *rows[:p], y - b.known)
            for row, column in zip(rows, columns[len(columns) - 1 - p : -1]):
                row[:] = column
            self.rows.append(rows)
            self.tables.append(_Table.of(columns, len(b.local), t.own))

    def normal(self) -> tuple[FloatArray, FloatArray]:
        """Derivatives, local and free shared columns projected out, and residuals."""
        q, p = self.fit.linear.size, self.fit.eta.size
        stacked = np.vstack([t.projected for t in self.tables])
        shared, raw, rest = stacked[:, :q], stacked[:, q : q + p], stacked[:, -1]
        free = ~self.fit.linear_active
        return project_out(raw, shared[:, free]), rest - shared @ self.fit.linear

    def finish(self, fit: Eliminated, index: int) -> tuple[FloatArray, FloatArray]:
        """Residuals and Jacobian of one experiment at a fit close by; uses up the derivatives."""
        b, rows, p, q = fit.bases[index], self.rows[index], fit.eta.size, fit.linear.size
        rest = fit.problem.measured[index] - b.combined(fit.linear, fit.local[index])
        *columns, rest = fit.problem.weigh(index, *b.local, *b.shared, rest)
        local, shared = columns[: len(b.local)], columns[len(b.local) :]
        for row, column in zip(rows[p:], shared, strict=True):
            row[:] = column
        by_local = self.tables[index].explained[:, q:-1], fit.tables[index].explained[:, :-1]
        explained = np.hstack(by_local)
        for at, own in zip(blocks(rest.size), rows_of(local), strict=True) if local else ():
            rows[:, at] -= (own @ explained).T
        return rest, rows.T
