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

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..experiment import BoolArray, FloatArray
from ..rows import by_rows, is_kept, square_sum
from .blocks import products
from .elimination import Eliminated, Tangent
from .price import exhausted
from .problem import Problem, Solution, bounds_of

_CLOSE = 0.03  # standard errors, within which the slopes of the model hardly change
_GROWTH = 8.0  # of the damping after a step that failed, and as much again with every other one
_EXACT = 0.05  # of its fall that the cost differs from a parabola, up to which damping only delays


def solve(
    problem: Problem,
    start: FloatArray,
    *,
    max_iterations: int = 60,
    tolerance: float = 1e-5,
    damping: float = 1e-3,
) -> Solution:
    """Minimise the sum of squared residuals from one start.

    Parameters
    ----------
    start : (p,)
        Of the nonlinear unknowns.
    max_iterations
        Limit on accepted and rejected steps together. A fit that has taken all simulations that it
        may ends before; see :mod:`.price`.
    tolerance
        Relative change of all scaled unknowns, in units of their own standard errors,
        below which the iteration has converged.
    damping
        Of the first step: little where the start is near the minimum, for it is what keeps
        unknowns that the data hardly tell apart from getting there at once.
    """
    scales = np.array([u.scale for u in problem.nonlinear])
    low, high = (b / scales for b in bounds_of(problem.nonlinear))
    degrees = max(problem.rows - scales.size, 1)
    x = np.clip(np.asarray(start, dtype=float) / scales, low, high)
    fit = Eliminated(problem, x * scales)
    tangent = Tangent(fit, scales)
    count, moved, converged = 0, True, x.size == 0
    before, marquardt = 0.0, _Damping(damping)
    while not converged and count < max_iterations and not exhausted():
        if moved:
            j, r = tangent.normal()
            j *= scales
            gradient, curvature = j.T @ r, j.T @ j
            noise = fit.cost / degrees or 1e-300
            if not np.all(np.isfinite(curvature)):
                break
        count += 1
        step = damped_step(curvature, gradient, x, (low, high), marquardt.value)
        candidate = np.clip(x + step, low, high)
        step = candidate - x
        predicted = _fall(curvature, gradient, step)
        if predicted <= tolerance**2 * noise:
            # damping keeps a step out of directions that the data hardly see: what it leaves counts
            left = _left(curvature, gradient, x, (low, high), predicted) if moved else 0.0
            if predicted <= 0.0 or predicted + left <= tolerance**2 * noise:
                converged = True
                break
        trial = _value(problem, candidate * scales)
        if trial is None:  # the model breaks down there
            marquardt.rise()
            moved = False
            continue
        gain = (fit.cost - trial.cost) / predicted
        first, moved = moved, gain > 1e-4
        if moved:
            # of what is left: a start far off has residuals that are not noise
            noise = trial.cost / degrees or 1e-300
            length = float(np.sqrt(predicted / noise))
            miss = min(1.0, 4.0 * abs(1.0 - gain)) if tolerance > 1e-3 else 1.0
            if before and length < _CLOSE:  # steps shorten at least as fast from one to the next
                miss = min(miss, length / before)
            if miss * length <= 10.0 * tolerance and gain > 0.5:
                left = _left(curvature, gradient, x, (low, high), predicted) if first else 0.0
                if miss * length + float(np.sqrt(left / noise)) <= 10.0 * tolerance:
                    # so short a step, or so exactly predicted, that the next one would be
                    # below the tolerance: keep these slopes
                    x, fit, converged = candidate, trial, True
                    break
            x, fit, before = candidate, trial, length
            marquardt.fall(gain)
            tangent.move(fit, scales)
        else:
            still = abs(fit.cost - trial.cost) <= 1e-13 * fit.cost
            # twice no better: the cost is rougher than the steps that are left are worth
            rough = marquardt.has_risen and predicted <= (10.0 * tolerance) ** 2 * noise
            marquardt.rise()
            still = still and predicted <= 1e-11 * fit.cost
            converged = rough or still or marquardt.value > 1e12
    return _finish(fit, tangent, (x <= low) | (x >= high), count, converged)


class _Damping:
    """Marquardt's damping: less after every step that helps, and ever more until one does."""

    def __init__(self, value: float) -> None:
        self.value, self._growth = value, _GROWTH

    @property
    def has_risen(self) -> bool:
        """Whether a step has failed since the last one that helped."""
        return self._growth > _GROWTH

    def fall(self, gain: float) -> None:
        """After a step whose fall of the cost was so many times the predicted one."""
        fewer = 1e-3 if abs(1.0 - gain) < _EXACT else 0.1 if gain > 0.5 else 0.5
        self.value, self._growth = max(self.value * fewer, 1e-12), _GROWTH

    def rise(self) -> None:
        """After a step that failed."""
        self.value = max(self.value * self._growth, 1e-9)
        self._growth *= _GROWTH


def _left(
    curvature: FloatArray, gradient: FloatArray, x: FloatArray,
    bounds: tuple[FloatArray, FloatArray], predicted: float,
) -> float:  # fmt: skip
    """How much farther than ``predicted`` the cost falls with a step that nothing damps."""
    free = damped_step(curvature, gradient, x, bounds, 1e-12)
    return max(_fall(curvature, gradient, free) - predicted, 0.0)


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
        step[index] = _solution(normal, rhs / scale) / scale
        target = x + step
        crossing = free & ((target < low) | (target > high))
        if not crossing.any():
            break
        step[crossing] = np.clip(target, low, high)[crossing] - x[crossing]
        free &= ~crossing
    return step


def _solution(normal: FloatArray, rhs: FloatArray) -> FloatArray:
    """Solution of normal equations; the shortest where they are singular."""
    try:
        return np.asarray(np.linalg.solve(normal, rhs))  # in a third of the time
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(normal, rhs, rcond=1e-15)[0])


def _value(problem: Problem, eta: FloatArray) -> Eliminated | None:
    """The linear half at ``eta``; ``None`` where the model gives no finite numbers."""
    try:
        return Eliminated(problem, eta)
    except np.linalg.LinAlgError:
        return None


def evaluate(problem: Problem, eta: FloatArray) -> Solution:
    """The linear half solved and the Jacobian taken at given ``eta``; nothing is moved."""
    return solve(problem, eta, max_iterations=0)


def score(problem: Problem, eta: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Of the nonlinear unknowns at given ``eta``, all linear ones projected out.

    Returns
    -------
    J'r, J'J : (p,), (p, p)
        With ``J`` the derivatives of the model and ``r`` what it leaves of the measured.
    cost
        ``r'r``.
    """
    fit = Eliminated(problem, eta)
    j, r = Tangent(fit, np.array([u.scale for u in problem.nonlinear])).normal()
    return j.T @ r, j.T @ j, fit.cost


def _finish(
    fit: Eliminated, tangent: Tangent, on_bound: BoolArray, count: int, converged: bool
) -> Solution:
    found = [tangent.finish(fit, i) for i in range(len(fit.tables))]
    return Solution(
        fit.eta, fit.linear, fit.local, fit.cost,
        residuals=[residuals for residuals, _ in found],
        simulate=fit.simulate,
        jacobian=[jacobian for _, jacobian in found],
        local_counts=tuple(t.own.shape[1] for t in fit.tables),
        active=np.concatenate((on_bound, fit.linear_active)),
        iterations=count, converged=converged,
    )  # fmt: skip


def settled(problem: Problem, found: Solution, least: float) -> Solution:
    """Where the derivatives of a solution lead once more, if that is farther than ``least``.

    ``least`` is in standard errors. So short a step is exact enough as it is computed, from the
    derivatives and residuals that are there: no model is evaluated, and ``simulate`` stays behind.
    """
    free = ~found.active
    pairs = list(zip(found.jacobian, found.residuals, strict=True))
    squares, scores = zip(*(products(j, r) for j, r in pairs))
    curvature = np.sum(squares, axis=0)[np.ix_(free, free)]
    gradient = np.sum(scores, axis=0)[free]
    scale = np.sqrt(np.maximum(np.diag(curvature), 1e-300))
    step = np.zeros(free.size)
    step[free] = np.linalg.lstsq(
        curvature / np.outer(scale, scale), gradient / scale, rcond=1e-15
    )[0] / scale  # fmt: skip
    noise = found.cost / max(problem.rows - free.size, 1)
    at = np.concatenate((found.eta, found.linear)) + step
    low, high = bounds_of([*problem.nonlinear, *problem.linear])
    if not gradient @ step[free] > least**2 * noise or np.any((at < low) | (at > high)):
        return found
    left = [_less(r, j, step) for j, r in pairs]
    eta, linear = at[: found.eta.size], at[found.eta.size :]
    cost = sum(map(square_sum, left))
    return replace(found, eta=eta, linear=linear, residuals=left, cost=cost)


def _less(residuals: FloatArray, jacobian: FloatArray, step: FloatArray) -> FloatArray:
    """Residuals after a step; those that are kept are moved where they lie."""
    if not is_kept(residuals):
        return by_rows(lambda r, j: r - j @ step, residuals, jacobian)
    residuals -= jacobian @ step
    return residuals


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
    found: list[Solution] = []
    failure: np.linalg.LinAlgError | None = None
    for start in starts:
        if found and exhausted():
            break
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
