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
from functools import cached_property
from typing import Any

import numpy as np

from ..experiment import BoolArray, FloatArray
from ..rows import by_rows, is_kept, square_sum
from .blocks import products
from .elimination import Eliminated, Tangent
from .price import exhausted
from .problem import Problem, Solution, bounds_of

_CLOSE = 0.03  # standard errors, within which the slopes of the model hardly change
_FIRST = 1e-3  # least damping after a step that failed: less would lead to the same again
_GROWTH = 8.0  # of the damping after a step that failed, its square from the second one on
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
        below which the iteration has converged. It ends as well with a step after which less than
        ten times that can be left.
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
            local = _Parabola(j.T @ r, j.T @ j, x, (low, high))
            noise = fit.cost / degrees or 1e-300
            if not np.all(np.isfinite(local.curvature)):
                break
        count += 1
        candidate = np.clip(x + local.step(marquardt.value), low, high)
        predicted = local.fall(candidate - x)
        # damping keeps a step out of directions that the data hardly see: what it leaves counts
        small = tolerance**2 * noise
        if predicted <= small and (predicted <= 0.0 or local.lowest <= small):
            converged = True
            break
        trial = _value(problem, candidate * scales)
        if trial is None:  # the model breaks down there
            marquardt.rise()
            moved = False
            continue
        gain = (fit.cost - trial.cost) / predicted
        moved = gain > 1e-4
        if moved:
            # of what is left: a start far off has residuals that are not noise
            noise = trial.cost / degrees or 1e-300
            length = float(np.sqrt(predicted / noise))
            left = _share_left(length, before, gain, tolerance) * length
            if left <= 10.0 * tolerance and gain > 0.5:
                rest = max(local.lowest - predicted, 0.0)
                if left + float(np.sqrt(rest / noise)) <= 10.0 * tolerance:
                    x, fit, converged = candidate, trial, True  # keep the slopes
                    break
            x, fit, before = candidate, trial, length
            marquardt.fall(gain)
            tangent.move(fit, scales)
        else:
            still = abs(fit.cost - trial.cost) <= 1e-13 * fit.cost and predicted <= 1e-11 * fit.cost
            # twice no better: the cost is rougher than the steps that are left are worth
            rough = marquardt.has_risen and local.lowest <= (10.0 * tolerance) ** 2 * noise
            marquardt.rise()
            converged = rough or still or marquardt.value > 1e12
    return _finish(fit, tangent, (x <= low) | (x >= high), count, converged)


def _share_left(length: float, before: float, gain: float, tolerance: float) -> float:
    """The part of an accepted step that the next one would go at most.

    ``length`` and ``before`` are those of this step and the last one in standard errors, ``gain``
    the fall of the cost in parts of the predicted one. A step that comes as predicted leaves
    little. Near the end, where less is wanted, the steps shorten at least as fast as before, those
    of the slowest unknown too unless the prediction says otherwise.
    """
    wrong = abs(1.0 - gain)
    left = min(1.0, 4.0 * wrong) if tolerance > 1e-3 else 1.0
    return min(left, max(length / before, wrong)) if before and length < _CLOSE else left


class _Parabola:
    """The cost around ``x``, shape ``(p,)``, as its slopes have it.

    ``gradient`` is ``J'r`` and ``curvature`` ``J'J`` for residuals ``r = measured - model``.
    """

    def __init__(
        self, gradient: FloatArray, curvature: FloatArray, x: FloatArray,
        bounds: tuple[FloatArray, FloatArray],
    ) -> None:  # fmt: skip
        self.gradient, self.curvature, self.x, self.bounds = gradient, curvature, x, bounds

    def step(self, damping: float) -> FloatArray:
        """Marquardt step."""
        return damped_step(self.curvature, self.gradient, self.x, self.bounds, damping)

    def fall(self, step: FloatArray) -> float:
        """How far the cost falls with a step."""
        return float(2.0 * self.gradient @ step - step @ self.curvature @ step)

    @cached_property
    def lowest(self) -> float:
        """How far it falls with a step that nothing damps."""
        return self.fall(self.step(1e-12))


class _Damping:
    """Marquardt's damping: less after every step that helps, more until one does."""

    def __init__(self, value: float) -> None:
        self.value, self._failed = value, 0

    @property
    def has_risen(self) -> bool:
        """Whether a step has failed since the last one that helped."""
        return self._failed > 0

    def fall(self, gain: float) -> None:
        """After a step whose fall of the cost was so many times the predicted one."""
        fewer = 0.1 if gain > 0.5 else 0.5
        if abs(1.0 - gain) < _EXACT and not self.has_risen:  # a short step is always exact
            fewer = 1e-3
        self.value, self._failed = max(self.value * fewer, 1e-12), 0

    def rise(self) -> None:
        """After a step that failed."""
        self._failed += 1
        self.value = max(self.value * _GROWTH ** min(self._failed, 2), _FIRST)


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
