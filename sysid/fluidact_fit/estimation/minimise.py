"""Damped Gauss-Newton iteration for least squares within bounds: the loop of every
nonlinear search.

Minimises ``|r(x)|**2`` over ``low <= x <= high`` for residuals ``r = measured - model(x)`` by
Levenberg-Marquardt steps [1]_,

    (J'J + damping diag(J'J)) step = J'r,

with bounds handled by an active set. Only ``J'r`` and ``J'J`` are asked for, so that neither the
length of a record nor how its derivatives are found matters here.

References
----------
.. [1] J. More, "The Levenberg-Marquardt algorithm: implementation and theory", 1978.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, Protocol, TypeVar

import numpy as np

from ..experiment import FloatArray
from .budget import exhausted

_CLOSE = 0.03  # step [standard errors] over which the slopes of the model hardly change
_FIRST = 1e-3  # least damping after a failed step: less would repeat it
_GROWTH = 8.0  # of the damping after a failed step, squared from the second one on
_EXACT = 0.05  # relative error of a predicted fall up to which damping only delays


class Point(Protocol):
    """A model evaluated at some values of the unknowns."""

    @property
    def cost(self) -> float:
        """Sum of the squared residuals; infinite where the model breaks down."""
        ...


PointT = TypeVar("PointT", bound=Point)
Bounds = tuple[FloatArray, FloatArray]
Follow = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class Minimum(Generic[PointT]):
    """End of an iteration.

    Attributes
    ----------
    x, point
        The unknowns, shape ``(p,)``, and the model there.
    sloped
        Whether the slopes that were asked for last are close enough to be those of the point.
    iterations, converged
        Accepted and rejected steps, and whether another one would change nothing.
    """

    x: FloatArray
    point: PointT
    sloped: bool
    iterations: int
    converged: bool


def minimise(
    evaluate: Callable[[FloatArray], PointT],
    slopes: Callable[[PointT], tuple[FloatArray, FloatArray]],
    start: FloatArray,
    bounds: Bounds,
    *,
    rows: int,
    tolerance: float = 1e-5,
    least_gain: float = 0.0,
    max_iterations: int,
    damping: float = 1e-3,
    follow: Follow | None = None,
) -> Minimum[PointT]:
    """Minimise a sum of squares from one start.

    Parameters
    ----------
    evaluate
        The model at some values ``(p,)``; may raise ``LinAlgError`` where it breaks down, which at
        the start is passed on.
    slopes
        ``J'r`` and ``J'J``, shapes ``(p,)`` and ``(p, p)``, at an evaluated point.
    start, bounds
        Shapes ``(p,)``.
    rows
        Number of residuals: the cost over what the unknowns leave of them is the noise.
    tolerance
        Length of a step, in standard errors of the unknowns, below which the iteration has
        converged. It ends as well with a step after which less than ten times that can be left.
    least_gain
        Part of the cost; a step that lowers it by less is the last.
    max_iterations
        Of accepted and rejected steps together. An iteration whose fit may not simulate any longer
        ends before; see :mod:`.budget`.
    damping
        Of the first step: little where the start is near the minimum, for it is what keeps
        unknowns that the data hardly tell apart from getting there at once.
    follow
        ``follow(x, step)``: where a step leads, to first order ``x + step``, which it is where
        there is none. A straight step soon leaves a curved valley, and the iteration creeps.
    """
    low, high = bounds
    x = np.clip(np.asarray(start, dtype=float), low, high)
    here, degrees = evaluate(x), max(rows - x.size, 1)
    count, moved, converged = 0, True, x.size == 0
    before, marquardt = 0.0, _Damping(damping)
    while not converged and count < max_iterations and not exhausted():
        if moved:
            local = _Parabola(*slopes(here), x, bounds)
            noise = here.cost / degrees or 1e-300
            if not np.all(np.isfinite(local.curvature)):
                break
            moved = False
        count += 1
        candidate = np.clip(x + local.step(marquardt.value), low, high)
        predicted = local.fall(candidate - x)
        # damping keeps a step out of directions that the data hardly see: what it leaves counts
        small = tolerance**2 * noise
        if predicted <= small and (predicted <= 0.0 or local.lowest <= small):
            converged = True
            break
        if follow is not None:
            bounded = (candidate <= low) | (candidate >= high)
            led = np.clip(follow(x, candidate - x), low, high)
            candidate = np.where(bounded, candidate, led)
        trial = _try(evaluate, candidate)
        if trial is None:  # the model breaks down there
            marquardt.rise()
            continue
        fall = here.cost - trial.cost
        gain = fall / predicted
        if gain > 1e-4:
            # from the new residual: that of a start far off is not noise
            noise = trial.cost / degrees or 1e-300
            length = float(np.sqrt(predicted / noise))
            left = _share_left(length, before, gain, tolerance) * length
            if left <= 10.0 * tolerance and gain > 0.5:
                rest = max(local.lowest - predicted, 0.0)
                converged = left + float(np.sqrt(rest / noise)) <= 10.0 * tolerance
            little = fall <= least_gain * here.cost
            x, here, before = candidate, trial, length
            if converged or little:  # keep the slopes
                converged = True
                break
            marquardt.fall(gain)
            moved = True
        else:
            still = abs(fall) <= 1e-13 * here.cost and predicted <= 1e-11 * here.cost
            # two failures in a row: the cost is rougher than the remaining steps are worth
            rough = marquardt.has_risen and local.lowest <= (10.0 * tolerance) ** 2 * noise
            marquardt.rise()
            converged = rough or still or marquardt.value > 1e12
    return Minimum(x, here, not moved, count, converged)


def _try(evaluate: Callable[[FloatArray], PointT], x: FloatArray) -> PointT | None:
    try:
        found = evaluate(x)
    except np.linalg.LinAlgError:
        return None
    return found if np.isfinite(found.cost) else None


def _share_left(length: float, before: float, gain: float, tolerance: float) -> float:
    """Upper limit of the length of the next step, relative to that of the accepted one.

    ``length`` and ``before`` are the lengths of this step and the last one in standard errors,
    ``gain`` is the fall of the cost relative to the predicted one. A step that comes as predicted
    leaves little. Near the end steps are taken to shorten as fast as before, unless the prediction
    was worse than that.
    """
    wrong = abs(1.0 - gain)
    left = min(1.0, 4.0 * wrong) if tolerance >= 1e-3 else 1.0
    return min(left, max(length / before, wrong)) if before and length < _CLOSE else left


class _Parabola:
    """The cost around ``x``, shape ``(p,)``, as its slopes have it.

    ``gradient`` is ``J'r`` and ``curvature`` ``J'J`` for residuals ``r = measured - model``.
    """

    def __init__(
        self, gradient: FloatArray, curvature: FloatArray, x: FloatArray, bounds: Bounds
    ) -> None:
        self.gradient, self.curvature, self.x, self.bounds = gradient, curvature, x, bounds

    def step(self, damping: float) -> FloatArray:
        """Marquardt step."""
        return damped_step(self.curvature, self.gradient, self.x, self.bounds, damping)

    def fall(self, step: FloatArray) -> float:
        """Fall of the cost with a step."""
        return float(2.0 * self.gradient @ step - step @ self.curvature @ step)

    @cached_property
    def lowest(self) -> float:
        """Fall of the cost with an undamped step."""
        return self.fall(self.step(1e-12))


class _Damping:
    """Marquardt's damping: less after every step that helps, more until one does."""

    def __init__(self, value: float) -> None:
        self.value, self._failed = value, 0

    @property
    def has_risen(self) -> bool:
        """Return whether a step has failed since the last one that helped."""
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
    curvature: FloatArray, gradient: FloatArray, x: FloatArray, bounds: Bounds, damping: float
) -> FloatArray:
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
