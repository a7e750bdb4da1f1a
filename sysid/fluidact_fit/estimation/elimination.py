"""Linear unknowns eliminated; see :mod:`.separable`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..experiment import BoolArray, FloatArray
from ..rows import side_by_side
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
    def of(cls, local: FloatArray, *others: FloatArray, own: FloatArray | None = None) -> _Table:
        """Columns beside each other, shapes ``(n, c)`` or ``(n,)``; ``own`` where it is known.

        Raises
        ------
        LinAlgError
            Where the model gives no finite numbers.
        """
        table = condense(rows_of((local, *others)))
        if not np.all(np.isfinite(table)):
            raise np.linalg.LinAlgError("the model gives no finite numbers")
        short, kept = len(table) != len(local), table[:, : local.shape[1]]
        return cls(
            kept, table[:, local.shape[1] :], orthonormal(kept) if own is None or short else own
        )

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
            _Table.of(*problem.weigh(i, b.local, b.shared, y - b.known))
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

    ``raw`` holds them weighed, shape ``(n_i, p)``; ``tables`` hold them between shared columns and
    rest.
    """

    def __init__(self, fit: Eliminated, scales: FloatArray) -> None:
        self.fit = fit
        self.raw, self.tables = [], []
        problem = fit.problem
        for i, (b, y, t) in enumerate(zip(fit.bases, problem.measured, fit.tables, strict=True)):
            j = problem.derivatives(i, fit.eta, scales, fit.linear, fit.local[i]).T
            local, shared, raw, rest = problem.weigh(i, b.local, b.shared, j, y - b.known)
            self.raw.append(raw)
            self.tables.append(_Table.of(local, shared, raw, rest, own=t.own))

    def normal(self) -> tuple[FloatArray, FloatArray]:
        """Derivatives, local and free shared columns projected out, and residuals."""
        q, p = self.fit.linear.size, self.fit.eta.size
        stacked = np.vstack([t.projected for t in self.tables])
        shared, raw, rest = stacked[:, :q], stacked[:, q : q + p], stacked[:, -1]
        free = ~self.fit.linear_active
        return project_out(raw, shared[:, free]), rest - shared @ self.fit.linear

    def finish(self, fit: Eliminated, index: int) -> tuple[FloatArray, FloatArray]:
        """Residuals and Jacobian of one experiment at a fit close by; uses up the derivatives."""
        b, count = fit.bases[index], fit.linear.size
        rest = fit.problem.measured[index] - b.combined(fit.linear, fit.local[index])
        local, shared, rest = fit.problem.weigh(index, b.local, b.shared, rest)
        by_local = self.tables[index].explained[:, count:-1]
        for column, explained in zip(self.raw[index].T, by_local.T, strict=True):
            column -= local @ explained
        shared = shared - local @ fit.tables[index].explained[:, :-1]
        return rest, side_by_side(self.raw[index], shared)
