"""Linear unknowns eliminated, piece by piece of a record; see :mod:`.separable`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..experiment import BoolArray, FloatArray
from ..rows import is_repeated, side_by_side
from .blocks import condense
from .least_squares import bounded_least_squares, explain, orthonormal, project_out, without
from .problem import STEP, Basis, Problem, Slopes, bounds_of, slopes_of


def placed(pieces: Sequence[Basis]) -> Iterator[tuple[slice, Basis]]:
    """Consecutive pieces with the rows that they hold."""
    begin = 0
    for piece in pieces:
        end = begin + piece.known.shape[0]
        yield slice(begin, end), piece
        begin = end


@dataclass(frozen=True)
class _Table:
    """Weighed columns of one experiment by the rows that :func:`.blocks.condense` leaves.

    ``local`` come first, then ``shared``, then whatever was asked for, the rest that both are to
    explain last. ``own`` is an orthonormal basis of the local ones.
    """

    local: FloatArray
    others: FloatArray
    own: FloatArray

    @classmethod
    def of(
        cls, tables: Iterator[FloatArray], locals_: int, own: FloatArray | None = None
    ) -> _Table:
        """Condense the tables of consecutive pieces; ``own`` where it is known.

        Raises
        ------
        LinAlgError
            Where the model gives no finite numbers.
        """
        table = condense(tables)
        if not np.all(np.isfinite(table)):
            raise np.linalg.LinAlgError("the model gives no finite numbers")
        local = table[:, :locals_]
        return cls(local, table[:, locals_:], orthonormal(local) if own is None else own)

    @cached_property
    def projected(self) -> FloatArray:
        """The others with the local columns projected out."""
        return without(self.own, self.others)

    @cached_property
    def explained(self) -> FloatArray:
        """Best explanation of the other columns by the local ones, one column for each."""
        return explain(self.others, self.local)


class Eliminated:
    """The linear half of the problem at given ``eta``; ``LinAlgError`` where there is none."""

    def __init__(self, problem: Problem, eta: FloatArray) -> None:
        self.problem = problem
        self.eta = eta
        self.pieces = [list(problem.pieces(i, eta)) for i in range(len(problem.measured))]
        self.tables = [self._table(i) for i in range(len(problem.measured))]
        self.linear, self.linear_active = self._solve_shared()
        rest = [t.projected[:, -1] - t.projected[:, :-1] @ self.linear for t in self.tables]
        cost = float(sum(float(r @ r) for r in rest))
        self.cost = cost if np.isfinite(cost) else np.inf

    def simulate(self) -> list[FloatArray]:
        """Output of the model for every experiment."""
        return [
            np.concatenate([b.known + b.shared @ self.linear + b.local @ local
                            for b in self.pieces[index]])
            for index, local in enumerate(self.local)
        ]  # fmt: skip

    def _table(self, index: int) -> _Table:
        pieces, measured = self.pieces[index], self.problem.measured[index]
        tables = (
            self.problem.weigh(index, side_by_side(b.local, b.shared, measured[at] - b.known), at)
            for at, b in placed(pieces)
        )
        return _Table.of(tables, pieces[0].local.shape[1])

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

    ``raw`` holds them weighed, with room for the shared columns, shape ``(n_i, p + q)``;
    ``tables`` holds them between shared columns and rest.
    """

    def __init__(self, fit: Eliminated, scales: FloatArray) -> None:
        unknowns = fit.eta.size + fit.linear.size
        self.raw = [np.empty((unknowns, y.shape[0])).T for y in fit.problem.measured]
        self.move(fit, scales)

    def move(self, fit: Eliminated, scales: FloatArray) -> None:
        """Take the derivatives at another fit."""
        self.fit, self.scales = fit, scales
        self.tables = [
            # the local columns of a single piece are those of the fit
            _Table.of(self._rows(i), t.local.shape[1], t.own if len(fit.pieces[i]) == 1 else None)
            for i, t in enumerate(fit.tables)
        ]

    def _rows(self, index: int) -> Iterator[FloatArray]:
        p = self.fit.eta.size
        for at, table in _weighed(self.fit, self.scales, index):
            self.raw[index][at, :p] = table[:, -1 - p : -1]
            yield table

    def normal(self) -> tuple[FloatArray, FloatArray]:
        """Derivatives, local and free shared columns projected out, and residuals."""
        q, p = self.fit.linear.size, self.fit.eta.size
        stacked = np.vstack([t.projected for t in self.tables])
        shared, raw, rest = stacked[:, :q], stacked[:, q : q + p], stacked[:, -1]
        free = ~self.fit.linear_active
        return project_out(raw, shared[:, free]), rest - shared @ self.fit.linear

    def finish(self, fit: Eliminated, index: int) -> tuple[FloatArray, FloatArray]:
        """Residuals and Jacobian of one experiment at a fit close by.

        The derivatives turn into the Jacobian: of a long record there is no room for both.
        """
        p = fit.eta.size
        by_local = np.column_stack((
            self.tables[index].explained[:, fit.linear.size : -1],
            fit.tables[index].explained[:, :-1],
        ))  # fmt: skip
        jacobian = self.raw[index]
        residuals = np.empty(jacobian.shape[0])
        for at, local, shared, rest in _left(fit, index):
            residuals[at] = rest
            jacobian[at, p:] = shared
            jacobian[at] -= (by_local.T @ local.T).T
        return residuals, jacobian


def _left(
    fit: Eliminated, index: int
) -> Iterator[tuple[slice, FloatArray, FloatArray, FloatArray]]:
    """Rows, their weighed local and shared columns, and what a fit leaves, piece by piece."""
    problem = fit.problem
    for at, b in placed(fit.pieces[index]):
        simulated = b.known + b.shared @ fit.linear + b.local @ fit.local[index]
        rest = problem.measured[index][at] - simulated
        rows = problem.weigh(index, side_by_side(b.local, b.shared, rest), at)
        yield at, rows[:, : b.local.shape[1]], rows[:, b.local.shape[1] : -1], rows[:, -1]


def _weighed(fit: Eliminated, scales: FloatArray, index: int) -> Iterator[tuple[slice, FloatArray]]:
    """Weighed columns, derivatives by ``eta`` and what the model is to explain, by pieces."""
    problem, end = fit.problem, 0
    for b, slopes in _sloped(fit, scales, index):
        at = slice(end, end + b.known.shape[0])
        end = at.stop
        j = slopes.known.copy()
        for columns, values in ((slopes.shared, fit.linear), (slopes.local, fit.local[index])):
            if values.size:  # as one matrix times a vector: the columns lie interleaved
                some = columns[:, :1] if is_repeated(columns.swapaxes(0, 1)) else columns
                j += some.reshape(-1, values.size).dot(values).reshape(some.shape[:2])
        rest = problem.measured[index][at] - b.known
        yield at, problem.weigh(index, side_by_side(b.local, b.shared, j.T, rest), at)


def _sloped(fit: Eliminated, scales: FloatArray, index: int) -> Iterator[tuple[Basis, Slopes]]:
    """Columns and their slopes, piece by piece."""
    problem, eta, steps = fit.problem, fit.eta, STEP * scales
    own = getattr(problem.model, "slopes", None)
    if own is not None:
        problem.count(index, 1 + eta.size)
        yield own(index, eta)
        return
    turned = [problem.pieces(index, eta + 1j * row) for row in np.diag(steps)]
    for at, *moved in zip(fit.pieces[index], *turned, strict=True):
        yield at, slopes_of(at, moved, steps)
