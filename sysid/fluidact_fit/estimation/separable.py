"""Separable least squares over several experiments.

The model of experiment ``i`` is

    y_i = known_i(eta) + S_i(eta) a + L_i(eta) l_i + e_i

with nonlinear unknowns ``eta`` and linear unknowns ``a`` shared by all experiments and
linear unknowns ``l_i`` (initial state, offset) of its own. All linear ones are eliminated
exactly (variable projection [1]_ with Kaufman's Jacobian [2]_), bounds and fixed values
respected; ``eta`` is found by :func:`.minimise.minimise`.

References
----------
.. [1] G. Golub, V. Pereyra, "Separable nonlinear least squares: the variable projection
   method and its applications", Inverse Problems 19(2), 2003.
.. [2] L. Kaufman, "A variable projection method for solving separable nonlinear least
   squares problems", BIT 15, 1975.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..experiment import FloatArray
from .budget import exhausted
from .elimination import Eliminated, Tangent
from .least_squares import solve_normal
from .minimise import minimise
from .problem import Problem, StationaryPoint, bounds_of


def solve(
    problem: Problem,
    start: FloatArray,
    *,
    max_iterations: int = 60,
    tolerance: float = 1e-5,
    damping: float = 1e-3,
) -> StationaryPoint:
    """Minimise the sum of squared residuals from one start.

    Parameters
    ----------
    start : (p,)
        Of the nonlinear unknowns.
    max_iterations
        Of accepted and rejected steps; a fit ends before where :mod:`.budget` says so.
    tolerance
        As in :func:`.minimise.minimise`.
    damping
        Of the first step: little where the start is near the minimum.
    """
    scales = np.array([u.scale for u in problem.nonlinear])
    tangent: Tangent | None = None

    def slopes(fit: Eliminated) -> tuple[FloatArray, FloatArray]:
        nonlocal tangent
        tangent = None  # of long records there is no room for two
        tangent = Tangent(fit, scales)
        j, r = tangent.normal()
        return j.T @ r, j.T @ j

    found = minimise(
        lambda eta: Eliminated(problem, eta), slopes, start, bounds_of(problem.nonlinear),
        rows=problem.rows, max_iterations=max_iterations, tolerance=tolerance, damping=damping,
        follow=problem.follow,
    )  # fmt: skip
    fit = found.point
    at_end = tangent if tangent is not None and found.sloped else Tangent(fit, scales)
    residuals, jacobian = zip(*(at_end.finish(fit, i) for i in range(len(fit.tables))), strict=True)
    return StationaryPoint(
        fit.eta, fit.linear, fit.local, fit.cost, list(residuals), list(jacobian),
        local_counts=tuple(t.own.shape[1] for t in fit.tables),
        iterations=found.iterations, converged=found.converged,
    )  # fmt: skip


def evaluate(problem: Problem, eta: FloatArray) -> StationaryPoint:
    """The linear half solved and the Jacobian taken at given ``eta``; nothing is moved."""
    return solve(problem, eta, max_iterations=0)


@dataclass(frozen=True)
class Score:
    """Score of the nonlinear unknowns, all linear ones projected out.

    ``slope`` is ``J'r``, shape ``(p,)``, ``curvature`` ``J'J``, shape ``(p, p)``, and ``cost``
    ``r'r``, with ``J`` the derivatives of the model and ``r`` what it leaves of the measured.
    """

    slope: FloatArray
    curvature: FloatArray
    cost: float

    def solve(self, slope: FloatArray) -> FloatArray:
        """Gauss-Newton step for a score, shape ``(p,)``."""
        return solve_normal(self.curvature, slope)


def score(problem: Problem, eta: FloatArray) -> Score:
    """Score at given ``eta``."""
    fit = Eliminated(problem, eta)
    j, r = Tangent(fit, np.array([u.scale for u in problem.nonlinear])).normal()
    return Score(j.T @ r, j.T @ j, fit.cost)


def profile(problem: Problem, candidates: FloatArray) -> FloatArray:
    """Cost at each candidate ``eta``, all linear unknowns eliminated.

    Parameters
    ----------
    candidates : (k, p)

    Returns
    -------
    (k,) sums of squared weighted residuals; infinite where the model fails.
    """
    return np.array([_cost(problem, eta) for eta in candidates])


def _cost(problem: Problem, eta: FloatArray) -> float:
    try:
        return Eliminated(problem, eta).cost
    except np.linalg.LinAlgError:  # the model gives no finite numbers
        return float("inf")


@dataclass(frozen=True)
class Search:
    """Outcome of a search from several starts: the best, how many agree, the rivals."""

    best: StationaryPoint
    tried: int
    agreeing: int
    rivals: tuple[StationaryPoint, ...]


def solve_from(problem: Problem, starts: Sequence[FloatArray], **limits: Any) -> Search:
    """Solve from several starts and say how many agree with the best.

    A rival is another optimum whose cost is within a factor 1.05 of the best, more than
    one part in a thousand away in some unknown. A start from which the computation breaks
    down is dropped; ``LinAlgError`` when there is no other.
    """
    found: list[StationaryPoint] = []
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

    def same(other: StationaryPoint) -> bool:
        close = best.eta.size == 0 or np.all(np.abs(other.eta - best.eta) <= 1e-3 * scales)
        return bool(close) or other.cost <= best.cost * (1.0 + 1e-7)

    agreeing = sum(same(s) for s in found)
    rivals = tuple(s for s in found if not same(s) and s.cost <= 1.05 * best.cost)
    return Search(best, len(found), agreeing, rivals)
