"""Separable least squares over several experiments.

The model of experiment ``i`` is

    y_i = known_i(eta) + S_i(eta) a + L_i(eta) l_i + e_i

with nonlinear unknowns ``eta`` and linear unknowns ``a`` shared by all experiments and
linear unknowns ``l_i`` (initial state, offset) of its own. All linear ones are eliminated
exactly (variable projection [1]_ with Kaufman's Jacobian [2]_), bounds and fixed values
respected; ``eta`` is found by a Levenberg-Marquardt iteration [3]_ in variables scaled to
order one, with bounds handled by an active set.

References
----------
.. [1] G. Golub, V. Pereyra, "Separable nonlinear least squares: the variable projection
   method and its applications", Inverse Problems 19(2), 2003.
.. [2] L. Kaufman, "A variable projection method for solving separable nonlinear least
   squares problems", BIT 15, 1975.
.. [3] J. More, "The Levenberg-Marquardt algorithm: implementation and theory", 1978.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ..experiment import FloatArray
from .blocks import condense
from .whitening import Whitening

Array = npt.NDArray[Any]
Mask = npt.NDArray[np.bool_]
_STEP = 1e-30  # complex step: no cancellation, so it can be as small as one likes
_WHOLE = slice(None)
_NEGLIGIBLE = 1e-10  # part of the largest singular value below which a direction is none


@dataclass(frozen=True)
class Unknown:
    """An unknown of the estimation.

    ``scale`` is its typical size (the iteration sees ``value / scale``); ``low`` and
    ``high`` are closed bounds in the unit of the value.
    """

    name: str
    low: float = -np.inf
    high: float = np.inf
    scale: float = 1.0


def _bounds(unknowns: Sequence[Unknown]) -> tuple[FloatArray, FloatArray]:
    return np.array([u.low for u in unknowns]), np.array([u.high for u in unknowns])


@dataclass(frozen=True)
class Basis:
    """The columns of one experiment at given ``eta`` (real or complex).

    ``known`` has shape ``(n,)``, ``shared`` ``(n, number of shared linear unknowns)``,
    ``local`` ``(n, number of local ones)``.
    """

    known: Array
    shared: Array
    local: Array


@dataclass(frozen=True)
class Slopes:
    """Derivatives of the columns by ``eta``: shapes ``(p, n)``, ``(p, n, .)``, ``(p, n, .)``."""

    known: FloatArray
    shared: FloatArray
    local: FloatArray


class Model(Protocol):
    """What the solver needs to know of a model.

    One that knows its own derivatives has a method ``slopes(index, eta)`` as well, which
    returns the columns and their :class:`Slopes`. One of long records has a method
    ``pieces(index, eta)``, which returns an iterator over the columns of consecutive rows.
    """

    def basis(self, index: int, eta: Array) -> Basis:
        """Columns of experiment ``index``; analytic in ``eta`` unless slopes are given."""
        ...


@dataclass(frozen=True)
class Problem:
    """Data and unknowns of a separable fit.

    ``measured`` holds one array ``(n_i,)`` per experiment; ``weights`` one number or
    array ``(n_i,)`` per experiment that multiplies the residual (0 leaves a sample out).
    ``whiten`` is one filter per experiment, applied to both sides after the weights, which is
    generalised least squares; none where the residuals are taken for white.
    """

    model: Model
    measured: Sequence[FloatArray]
    nonlinear: Sequence[Unknown]
    linear: Sequence[Unknown] = ()
    weights: Sequence[FloatArray | float] = ()
    whiten: Sequence[Whitening] = ()

    @property
    def rows(self) -> int:
        """Number of rows of all experiments."""
        return sum(y.shape[0] for y in self.measured)

    def pieces(self, index: int, eta: Array) -> Iterator[Basis]:
        """Columns of one experiment, piece by piece; whole where it is whitened."""
        own = None if self.whiten else getattr(self.model, "pieces", None)
        return iter((self.model.basis(index, eta),)) if own is None else own(index, eta)

    def weigh(self, index: int, table: Array, at: slice = _WHOLE) -> Array:
        """Weigh and whiten a table (samples first) of one experiment, or rows of it."""
        w = np.asarray(self.weights[index] if self.weights else 1.0)
        if w.ndim:
            table = table * (w[at, None] if table.ndim > 1 else w[at])
        elif w != 1.0:
            table = table * w
        return self.whiten[index].filter(table) if self.whiten else table


@dataclass(frozen=True)
class Solution:
    """A stationary point of a `Problem`.

    Attributes
    ----------
    eta, linear
        Values of the nonlinear and the shared linear unknowns.
    local
        Local linear unknowns, one array per experiment.
    cost
        Sum of the squared weighted residuals.
    residuals
        Weighted residuals ``measured - model`` per experiment.
    simulated
        Model output per experiment.
    jacobian
        Weighted derivative of the model output by ``(eta, linear)`` with the local
        unknowns projected out, one array ``(n_i, p + q)`` per experiment.
    local_counts
        Number of local unknowns per experiment.
    active
        For each of ``(eta, linear)`` whether it is at a bound.
    iterations, converged
        What the iteration did.
    """

    eta: FloatArray
    linear: FloatArray
    local: list[FloatArray]
    cost: float
    residuals: list[FloatArray]
    simulated: list[FloatArray]
    jacobian: list[FloatArray]
    local_counts: tuple[int, ...]
    active: Mask
    iterations: int
    converged: bool


def differentiate(
    basis: Callable[[Array], Basis], eta: FloatArray, scales: FloatArray
) -> tuple[Basis, Slopes]:
    """Columns and their exact derivatives by complex steps."""
    steps = _STEP * scales
    at = basis(eta)
    return at, _slopes_of(at, [basis(eta + 1j * row) for row in np.diag(steps)], steps)


def _slopes_of(at: Basis, turned: Sequence[Basis], steps: FloatArray) -> Slopes:
    """Derivatives from columns with a complex step in every unknown."""

    def slope(part: str) -> FloatArray:
        rows = [np.imag(getattr(b, part)) / step for b, step in zip(turned, steps)]
        return np.reshape(rows, (steps.size, *getattr(at, part).shape))

    return Slopes(slope("known"), slope("shared"), slope("local"))


def _orthonormal(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of the span of some columns; negligible directions are left out."""
    norms = np.linalg.norm(columns, axis=0)
    used = columns[:, norms > 0.0] / norms[norms > 0.0]
    if used.shape[1] <= 1:
        return used
    q, r = np.linalg.qr(used)
    size = np.abs(np.diag(r))
    if size.min() > _NEGLIGIBLE * size.max():
        return q
    left, singular, _ = np.linalg.svd(used, full_matrices=False)
    return left[:, singular > _NEGLIGIBLE * singular[0]]


def project_out(rows: FloatArray, columns: FloatArray) -> FloatArray:
    """Remove from ``rows``, shape ``(n, p)``, what ``columns``, ``(n, q)``, explain."""
    return _without(_orthonormal(columns), rows)


def explain(rows: FloatArray, columns: FloatArray) -> FloatArray:
    """How ``columns``, ``(n, q)``, explain ``rows``, ``(n, p)``, best; shape ``(q, p)``."""
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    found = np.linalg.lstsq(columns / scale, rows, rcond=_NEGLIGIBLE)[0]
    return np.asarray(found / scale[:, None])


def _without(q: FloatArray, rows: Array) -> Array:
    """Remove the part of rows that lies in the span of an orthonormal ``q``."""
    return np.asarray(rows - q @ (q.T @ rows)) if q.shape[1] else rows


def _placed(pieces: Iterator[Basis]) -> Iterator[tuple[slice, Basis]]:
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
    def of(cls, tables: Iterator[FloatArray], locals_: int) -> _Table:
        """Condense the tables of consecutive pieces.

        Raises
        ------
        LinAlgError
            Where the model gives no finite numbers.
        """
        table = condense(tables)
        if not np.all(np.isfinite(table)):
            raise np.linalg.LinAlgError("the model gives no finite numbers")
        local = table[:, :locals_]
        return cls(local, table[:, locals_:], _orthonormal(local))

    @cached_property
    def projected(self) -> FloatArray:
        """The others with the local columns projected out."""
        return _without(self.own, self.others)

    @cached_property
    def explained(self) -> FloatArray:
        """How the local columns explain the others best, one column for each."""
        return explain(self.others, self.local)


class _Fit:
    """The linear half of the problem at given ``eta``; ``LinAlgError`` where there is none."""

    def __init__(self, problem: Problem, eta: FloatArray) -> None:
        self.problem = problem
        self.eta = eta
        self._whole: dict[int, Basis] = {}
        self.tables = [self._table(i) for i in range(len(problem.measured))]
        self.linear, self.linear_active = self._solve_shared()
        rest = [t.projected[:, -1] - t.projected[:, :-1] @ self.linear for t in self.tables]
        cost = float(sum(float(r @ r) for r in rest))
        self.cost = cost if np.isfinite(cost) else np.inf

    def pieces(self, index: int) -> Iterator[Basis]:
        """Columns of one experiment; one of a single piece is not computed again."""
        if index in self._whole:
            return iter((self._whole[index],))
        return self.problem.pieces(index, self.eta)

    def _table(self, index: int) -> _Table:
        pieces = _placed(self.problem.pieces(index, self.eta))
        at, first = next(pieces)
        measured = self.problem.measured[index]
        if at.stop == measured.shape[0]:
            self._whole[index] = first

        def tables() -> Iterator[FloatArray]:
            for rows, b in chain(((at, first),), pieces):
                columns = np.column_stack((b.local, b.shared, measured[rows] - b.known))
                yield self.problem.weigh(index, columns, rows)

        return _Table.of(tables(), first.local.shape[1])

    def _solve_shared(self) -> tuple[FloatArray, Mask]:
        """Shared linear unknowns by bounded least squares (active set)."""
        unknowns = self.problem.linear
        if not unknowns:
            return np.zeros(0), np.zeros(0, dtype=bool)
        stacked = np.vstack([t.projected for t in self.tables])
        return bounded_least_squares(stacked[:, :-1], stacked[:, -1], *_bounds(unknowns))

    @cached_property
    def local(self) -> list[FloatArray]:
        """Local unknowns of every experiment."""
        return [t.explained[:, -1] - t.explained[:, :-1] @ self.linear for t in self.tables]


class _Tangent:
    """Derivatives of the model by ``eta`` at a fit.

    ``raw`` holds them weighed, with room for the shared columns, shape ``(n_i, p + q)``;
    ``tables`` holds them between shared columns and rest.
    """

    def __init__(self, fit: _Fit, scales: FloatArray) -> None:
        unknowns = fit.eta.size + fit.linear.size
        self.raw = [np.empty((y.shape[0], unknowns)) for y in fit.problem.measured]
        self.move(fit, scales)

    def move(self, fit: _Fit, scales: FloatArray) -> None:
        """Take the derivatives at another fit."""
        self.fit = fit
        self.tables = [
            _Table.of(self._rows(i, scales), t.local.shape[1]) for i, t in enumerate(fit.tables)
        ]

    def _rows(self, index: int, scales: FloatArray) -> Iterator[FloatArray]:
        fit, problem, end = self.fit, self.fit.problem, 0
        for b, slopes in self._sloped(index, scales):
            at = slice(end, end + b.known.shape[0])
            end = at.stop
            j = slopes.known.copy()
            for columns, values in ((slopes.shared, fit.linear), (slopes.local, fit.local[index])):
                if values.size:  # as one matrix times a vector: the columns lie interleaved
                    j += columns.reshape(-1, values.size).dot(values).reshape(j.shape)
            rest = problem.measured[index][at] - b.known
            table = problem.weigh(index, np.column_stack((b.local, b.shared, j.T, rest)), at)
            self.raw[index][at, : fit.eta.size] = table[:, -1 - fit.eta.size : -1]
            yield table

    def _sloped(self, index: int, scales: FloatArray) -> Iterator[tuple[Basis, Slopes]]:
        """Columns and their slopes, piece by piece."""
        problem, eta, steps = self.fit.problem, self.fit.eta, _STEP * scales
        own = getattr(problem.model, "slopes", None)
        if own is not None:
            yield own(index, eta)
            return
        turned = [problem.pieces(index, eta + 1j * row) for row in np.diag(steps)]
        for at, *moved in zip(self.fit.pieces(index), *turned, strict=True):
            yield at, _slopes_of(at, moved, steps)

    def normal(self) -> tuple[FloatArray, FloatArray]:
        """Derivatives, local and free shared columns projected out, and residuals."""
        q, p = self.fit.linear.size, self.fit.eta.size
        stacked = np.vstack([t.projected for t in self.tables])
        shared, raw, rest = stacked[:, :q], stacked[:, q : q + p], stacked[:, -1]
        free = ~self.fit.linear_active
        return project_out(raw, shared[:, free]), rest - shared @ self.fit.linear

    def finish(self, fit: _Fit, index: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Residuals, model output and Jacobian of one experiment at a fit close by.

        The derivatives turn into the Jacobian: there is no room for both.
        """
        problem, jacobian, table = fit.problem, self.raw[index], fit.tables[index]
        n, p = jacobian.shape[0], fit.eta.size
        by_local = np.column_stack((
            self.tables[index].explained[:, fit.linear.size : -1], table.explained[:, :-1]
        ))  # fmt: skip
        residuals, simulated = np.empty(n), np.empty(n)
        for at, b in _placed(fit.pieces(index)):
            simulated[at] = b.known + b.shared @ fit.linear + b.local @ fit.local[index]
            rest = problem.measured[index][at] - simulated[at]
            rows = problem.weigh(index, np.column_stack((b.local, b.shared, rest)), at)
            local, shared = rows[:, : b.local.shape[1]], rows[:, b.local.shape[1] : -1]
            residuals[at] = rows[:, -1]
            jacobian[at, p:] = shared
            jacobian[at] -= local @ by_local
        return residuals, simulated, jacobian


def scaled_least_squares(a: FloatArray, y: FloatArray, rcond: float = 1e-12) -> FloatArray:
    """Least squares ``min |y - a x|`` whose columns may differ by many orders of magnitude.

    ``a`` has shape ``(n, q)``, ``y`` ``(n,)``; ``rcond`` is the smallest singular value of the
    columns, each of length one, that counts.
    """
    scale = np.linalg.norm(a, axis=0)
    scale[scale == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(a / scale, y, rcond=rcond)[0] / scale)


def bounded_least_squares(
    a: FloatArray, y: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, Mask]:
    """Least squares ``min |y - a x|`` with bounds, and which entries are at one.

    Parameters
    ----------
    a : (n, q)
    y : (n,)
    low, high : (q,)
    """
    if a.shape[1] == 1:  # a gain alone: no decomposition needed
        column = a[:, 0]
        square = float(column @ column)
        best = float(column @ y) / square if square > 0.0 else 0.0
        x = np.clip(np.array([best]), low, high)
        return x, (x != best) | (low == high)
    x = scaled_least_squares(a, y, 1e-13)
    active = np.zeros(x.size, dtype=bool)
    if np.all(x >= low) and np.all(x <= high):
        return x, active | (low == high)
    from scipy.optimize import lsq_linear

    scale = np.linalg.norm(a, axis=0)
    scale[scale == 0.0] = 1.0
    width = np.where(high > low, high, np.nextafter(low, np.inf))
    found = lsq_linear(a / scale, y, bounds=(low * scale, width * scale), method="bvls")
    return np.clip(found.x / scale, low, high), found.active_mask != 0


def solve(
    problem: Problem,
    start: FloatArray,
    *,
    max_iterations: int = 60,
    tolerance: float = 1e-5,
) -> Solution:
    """Minimise the sum of squared residuals from one start.

    Parameters
    ----------
    start : (p,)
        Of the nonlinear unknowns.
    max_iterations
        Limit on accepted and rejected steps together.
    tolerance
        Relative change of all scaled unknowns, in units of their own standard errors,
        below which the iteration has converged.
    """
    scales = np.array([u.scale for u in problem.nonlinear])
    low, high = (b / scales for b in _bounds(problem.nonlinear))
    degrees = max(problem.rows - scales.size, 1)
    x = np.clip(np.asarray(start, dtype=float) / scales, low, high)
    fit = _Fit(problem, x * scales)
    tangent = _Tangent(fit, scales)
    damping, count, moved, converged = 1e-3, 0, True, x.size == 0
    while not converged and count < max_iterations:
        if moved:
            j, r = tangent.normal()
            j *= scales
            gradient, curvature = j.T @ r, j.T @ j
            noise = fit.cost / degrees or 1e-300
            if not np.all(np.isfinite(curvature)):
                break
        count += 1
        step = damped_step(curvature, gradient, x, (low, high), damping)
        candidate = np.clip(x + step, low, high)
        step = candidate - x
        predicted = _fall(curvature, gradient, step)
        # damping keeps a step out of directions that the data hardly see: what it leaves counts
        free = damped_step(curvature, gradient, x, (low, high), 1e-12) if moved else step
        left = max(_fall(curvature, gradient, free) - predicted, 0.0)
        if predicted <= 0.0 or predicted + left <= tolerance**2 * noise:
            converged = True
            break
        trial = _value(problem, candidate * scales)
        if trial is None:  # the model breaks down there
            damping, moved = max(damping * 8.0, 1e-9), False
            continue
        gain = (fit.cost - trial.cost) / predicted
        moved = gain > 1e-4
        if moved:
            # of what is left: a start far off has residuals that are not noise
            x, noise = candidate, trial.cost / degrees or 1e-300
            length, rest = float(np.sqrt(predicted / noise)), float(np.sqrt(left / noise))
            miss = min(1.0, 4.0 * abs(1.0 - gain)) if tolerance > 1e-3 else 1.0
            if miss * length + rest <= 10.0 * tolerance and gain > 0.5:
                # so short a step, or so exactly predicted, that the next one would be
                # below the tolerance: keep these slopes
                fit, converged = trial, True
                break
            damping = max(damping * (0.1 if gain > 0.5 else 0.5), 1e-12)
            fit = trial
            tangent.move(fit, scales)
        else:
            still = abs(fit.cost - trial.cost) <= 1e-13 * fit.cost
            damping = max(damping * 8.0, 1e-9)
            converged = (still and predicted <= 1e-11 * fit.cost) or damping > 1e12
    return _finish(fit, tangent, (x <= low) | (x >= high), count, converged)


def _fall(curvature: FloatArray, gradient: FloatArray, step: FloatArray) -> float:
    """How far the cost falls with a step, to second order."""
    return float(2.0 * gradient @ step - step @ curvature @ step)


def damped_step(
    curvature: FloatArray, gradient: FloatArray, x: FloatArray,
    bounds: tuple[FloatArray, FloatArray], damping: float,
) -> FloatArray:  # fmt: skip
    """Marquardt step; unknowns that would cross a bound stop on it, shape ``(p,)``.

    Parameters
    ----------
    curvature, gradient : (p, p), (p,)
        ``J'J`` and ``J'r`` for residuals ``r = measured - model``.
    x, bounds : (p,)
        Where the step begins, and how far it may lead.
    damping
        Share of the diagonal that is added to it.
    """
    low, high = bounds
    step = np.zeros(x.size)
    free = ~(((x <= low) & (gradient <= 0.0)) | ((x >= high) & (gradient >= 0.0)))
    for _ in range(x.size + 1):
        index = np.flatnonzero(free)
        if index.size == 0:
            break
        h = curvature[np.ix_(index, index)]
        scale = np.sqrt(np.maximum(np.diag(h), 1e-300))
        rhs = gradient[index] - curvature[index][:, ~free] @ step[~free]
        normal = h / np.outer(scale, scale) + damping * np.eye(index.size)
        step[index] = np.linalg.lstsq(normal, rhs / scale, rcond=1e-15)[0] / scale
        target = x + step
        crossing = free & ((target < low) | (target > high))
        if not crossing.any():
            break
        step[crossing] = np.clip(target, low, high)[crossing] - x[crossing]
        free &= ~crossing
    return step


def _value(problem: Problem, eta: FloatArray) -> _Fit | None:
    """The linear half at ``eta``; ``None`` where the model gives no finite numbers."""
    try:
        return _Fit(problem, eta)
    except np.linalg.LinAlgError:
        return None


def evaluate(problem: Problem, eta: FloatArray) -> Solution:
    """The linear half solved and the Jacobian taken at given ``eta``; nothing is moved."""
    return solve(problem, eta, max_iterations=0)


def _finish(fit: _Fit, tangent: _Tangent, on_bound: Mask, count: int, converged: bool) -> Solution:
    found = [tangent.finish(fit, i) for i in range(len(fit.tables))]
    return Solution(
        fit.eta, fit.linear, fit.local, fit.cost,
        residuals=[residuals for residuals, _, _ in found],
        simulated=[simulated for _, simulated, _ in found],
        jacobian=[jacobian for _, _, jacobian in found],
        local_counts=tuple(t.own.shape[1] for t in fit.tables),
        active=np.concatenate((on_bound, fit.linear_active)),
        iterations=count, converged=converged,
    )  # fmt: skip


def profile(problem: Problem, candidates: FloatArray) -> FloatArray:
    """Cost at each candidate ``eta``, all linear unknowns eliminated.

    Parameters
    ----------
    candidates : (k, p)

    Returns
    -------
    (k,) sums of squared weighted residuals; infinite where the model fails.
    """
    costs = np.array([_cost(problem, eta) for eta in candidates])
    costs[~np.isfinite(costs)] = np.inf
    return costs


def _cost(problem: Problem, eta: FloatArray) -> float:
    fit = _value(problem, eta)
    return float("inf") if fit is None else fit.cost


@dataclass(frozen=True)
class Search:
    """Outcome of a search from several starts: the best, how many agree, the rivals."""

    best: Solution
    tried: int
    agreeing: int
    rivals: tuple[Solution, ...]


def solve_from(problem: Problem, starts: Sequence[FloatArray], **limits: Any) -> Search:
    """Solve from several starts and say how many agree with the best.

    A rival is another optimum whose cost is within a factor 1.05 of the best, more than
    one part in a thousand away in some unknown. A start from which the computation breaks
    down is dropped; ``LinAlgError`` when there is no other.
    """
    found, failure = [], None
    for start in starts:
        try:
            found.append(solve(problem, start, **limits))
        except np.linalg.LinAlgError as error:
            failure = error
    if not found and failure is not None:
        raise failure
    found.sort(key=lambda s: s.cost)
    best = found[0]
    scales = np.maximum(np.abs(best.eta), [1e-6 * u.scale for u in problem.nonlinear])

    def same(other: Solution) -> bool:
        close = best.eta.size == 0 or np.all(np.abs(other.eta - best.eta) <= 1e-3 * scales)
        return bool(close) or other.cost <= best.cost * (1.0 + 1e-7)

    agreeing = sum(same(s) for s in found)
    rivals = tuple(s for s in found if not same(s) and s.cost <= 1.05 * best.cost)
    return Search(best, len(found), agreeing, rivals)
