"""Output error of pressures and position: the search for parameters and initial states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...estimation.converter_errors import codes_matter, noise_beside
from ...estimation.least_squares import column_scales, orthonormal, without
from ...estimation.minimise import Minimum, minimise
from ...estimation.named_model import Values
from ...estimation.problem import Unknown, bounds_of
from ...estimation.uncertainty import Uncertainty, enlarge, score_covariance, with_codes
from ...experiment import BoolArray, FloatArray
from .gray_box import SLOPES, GrayBox, GrayLog

_TOLERANCE = 1e-2  # standard errors
_ASTRAY = 1e12  # residuals in standard deviations beyond which a simulation has run away
STATE_SCALE = np.array([1e5, 1e5, 1e-3, 1e-2])  # Pa, Pa, m, m/s


@dataclass(frozen=True)
class GrayProblem:
    """Problem of a search: the machine and its logs, the free parameters, weights.

    ``sigma`` holds the standard deviation of the residuals of p1, p2 and y [Pa, Pa, m].
    """

    box: GrayBox
    logs: Sequence[GrayLog]
    free: Sequence[Unknown]
    sigma: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters."""
        return tuple(u.name for u in self.free)

    @property
    def rows(self) -> int:
        """Number of residuals."""
        return sum(log.measured.size for log in self.logs)

    def residuals(self, log: GrayLog, states: FloatArray) -> FloatArray:
        """Weighted residuals of a log, channel after channel."""
        measured = log.measured / self.sigma[list(log.channels), None]
        return measured.ravel() - self.weighted(log, states)

    def weighted(self, log: GrayLog, states: FloatArray) -> FloatArray:
        """Measured channels of states ``(n, 4)``, weighted, channel after channel."""
        channels = list(log.channels)
        return (states.T[channels] / self.sigma[channels, None]).ravel()

    def jacobian(self, log: GrayLog, initial: FloatArray, values: Values) -> FloatArray:
        """Derivatives of the weighted channels by the initial state, scaled, and the parameters."""
        columns = [0, 1, 2, 3, *(4 + SLOPES.index(n) for n in self.names)]
        slopes = self.box.slopes(log, initial, values)
        rows = np.concatenate([slopes[:, c, columns] / self.sigma[c] for c in log.channels])
        rows[:, :4] *= STATE_SCALE
        return rows


@dataclass(frozen=True)
class GrayPoint:
    """All logs simulated with some parameters from some initial states.

    ``values`` holds all parameters [SI], ``initial`` the state of every log at its beginning.
    """

    problem: GrayProblem
    values: dict[str, float]
    initial: list[FloatArray]

    @cached_property
    def states(self) -> list[FloatArray]:
        """p1, p2, y and v of every log, ``(n, 4)`` each [Pa, Pa, m, m/s]."""
        pairs = zip(self.problem.logs, self.initial)
        with np.errstate(all="ignore"):  # a simulation that has run away
            return [self.problem.box.simulate(log, x, self.values) for log, x in pairs]

    @cached_property
    def residuals(self) -> list[FloatArray]:
        """Weighted residuals of every log, channel after channel, ``(c n,)`` each."""
        with np.errstate(all="ignore"):
            return [self.problem.residuals(*pair) for pair in zip(self.problem.logs, self.states)]

    @cached_property
    def cost(self) -> float:
        """Sum of the squared weighted residuals, infinite where a simulation has run away."""
        with np.errstate(all="ignore"):
            cost = sum(float(r @ r) for r in self.residuals)
        return cost if cost < _ASTRAY**2 * self.problem.rows else np.inf

    @cached_property
    def slopes(self) -> list[FloatArray]:
        """Slopes of every log by initial state and parameters; see `GrayProblem.jacobian`."""
        pairs = zip(self.problem.logs, self.initial)
        return [self.problem.jacobian(log, x, self.values) for log, x in pairs]

    @cached_property
    def start_basis(self) -> list[FloatArray]:
        """Orthonormal basis of the effect of the initial state of every log on its rows.

        A piston that sticks forgets the speed that it was said to begin with.
        """
        return [orthonormal(j[:, :4]) for j in self.slopes]

    @cached_property
    def jacobian(self) -> list[FloatArray]:
        """Slopes by the free parameters, initial states projected out, ``(c n, p)`` each."""
        return [without(q, j[:, 4:]) for q, j in zip(self.start_basis, self.slopes)]

    @property
    def active(self) -> BoolArray:
        """Mask of the free parameters at a bound, ``(p,)``."""
        inside = [u.low < self.values[u.name] < u.high for u in self.problem.free]
        return ~np.array(inside, dtype=bool)

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """Covariance of the free parameters; the channels of a log share their errors.

        No variance is less than that of white residuals: what a few hundred instants show of
        their errors is less than there was, because the fit went after them.
        """
        channels = [
            [slice(k * log.samples, (k + 1) * log.samples) for k in range(len(log.channels))]
            for log in self.problem.logs
        ]
        by_scores = score_covariance(self.jacobian, self.residuals, channels)
        white = np.diag(self.bread) * self.cost / self.problem.rows
        total = enlarge(by_scores.covariance, white)
        for channel in range(len(self.problem.sigma)):
            total = self._with_codes(channel, total)
        return replace(by_scores, covariance=total)

    def _with_codes(self, channel: int, total: FloatArray) -> FloatArray:
        """The covariance with the errors of the converter of a channel, where they matter.

        A piston at rest is read with one error all the time, which the scores of two logs hardly
        show.
        """
        sigma = self.problem.sigma[channel]
        parts = [
            (j[k * log.samples : (k + 1) * log.samples], r[k * log.samples : (k + 1) * log.samples],
             (log.measured[k] / sigma, log.codes[k] / sigma))
            for log, j, r in zip(self.problem.logs, self.jacobian, self.residuals, strict=True)
            if channel in log.channels and log.codes for k in [log.channels.index(channel)]
        ]  # fmt: skip
        if not parts:
            return total
        jacobian, residuals, readings = zip(*parts, strict=True)
        spread = float(np.sqrt(np.mean(np.concatenate(residuals) ** 2)))
        if not codes_matter(jacobian, readings, self.bread, total, spread):
            return total
        noise = noise_beside(readings, spread)
        return with_codes(total, jacobian, residuals, readings, self.bread, noise)

    @cached_property
    def bread(self) -> FloatArray:
        """``inv(J'J)`` of the free parameters, ``(p, p)``."""
        j = np.vstack(self.jacobian)
        scale = column_scales(j)
        return np.asarray(np.linalg.pinv((j / scale).T @ (j / scale)) / np.outer(scale, scale))


def solve_gray_box(
    problem: GrayProblem,
    start: Values,
    initial: Sequence[FloatArray] | None = None,
    *,
    max_iterations: int = 40,
) -> Minimum[GrayPoint]:
    """Minimise the weighted output error over parameters and initial states.

    ``start`` holds all parameters, ``initial`` the state of every log at its beginning [SI], which
    is guessed from the measured signals if left out.

    Noise of the pressures may let a piston slip that sticks, which no small step of the search
    undoes. Rest is therefore tried as well, at first and at the end.

    Raises
    ------
    LinAlgError
        Where no simulation follows the logs.
    """
    moving = list(initial or [log.guess[0] for log in problem.logs])
    starts = [GrayPoint(problem, dict(start), x) for x in (moving, _rested(problem, moving))]
    if problem.free:
        starts = [min(starts, key=lambda s: s.cost)]
    best = min((_descend(s, max_iterations) for s in starts), key=lambda m: m.point.cost)
    if not np.isfinite(best.point.cost):
        raise np.linalg.LinAlgError("the simulation leaves every measured range")
    end = best.point
    rested = _rested(problem, end.initial)
    if max_iterations and any(a[3] != b[3] for a, b in zip(rested, end.initial)):
        other = _descend(GrayPoint(problem, end.values, rested), max_iterations)
        other = replace(other, iterations=best.iterations + other.iterations)
        best = min((best, other), key=lambda m: m.point.cost)
    return best


def _descend(begin: GrayPoint, max_iterations: int) -> Minimum[GrayPoint]:
    """Go to the minimum; unknowns are the parameters and the initial states, both scaled."""
    problem = begin.problem
    names, scales = problem.names, np.array([u.scale for u in problem.free])
    count, p = len(problem.logs), len(names)
    size = np.concatenate((scales, np.tile(STATE_SCALE, count)))

    def evaluate(x: FloatArray) -> GrayPoint:
        x = x * size
        values = {**begin.values, **dict(zip(names, x[:p].tolist()))}
        return GrayPoint(problem, values, list(x[p:].reshape(-1, 4)))

    @np.errstate(all="ignore")  # a simulation that has run away
    def slopes(point: GrayPoint) -> tuple[FloatArray, FloatArray]:
        gradient, curvature = np.zeros(size.size), np.zeros((size.size, size.size))
        for k, (j, residuals) in enumerate(zip(point.slopes, point.residuals)):
            j = np.column_stack((j[:, 4:] * scales, j[:, :4]))
            own = [*range(p), *range(p + 4 * k, p + 4 * k + 4)]
            gradient[own] += j.T @ residuals
            curvature[np.ix_(own, own)] += j.T @ j
        return gradient, curvature

    low, high = bounds_of(problem.free)
    open_end = np.full(4 * count, np.inf)
    return minimise(
        evaluate, slopes,
        np.concatenate(([begin.values[n] for n in names], *begin.initial)) / size,
        (np.append(low / scales, -open_end), np.append(high / scales, open_end)),
        rows=problem.rows, tolerance=_TOLERANCE, max_iterations=max_iterations,
    )  # fmt: skip


def _rested(problem: GrayProblem, initial: Sequence[FloatArray]) -> list[FloatArray]:
    """The same beginnings with every log that hardly moves there at rest, forces balanced."""
    machine, out = problem.box.machine, []
    area = np.array([machine.area(1), -machine.area(2)])
    for log, state in zip(problem.logs, initial):
        slow = min(abs(state[3]), abs(log.guess[0, 3])) * float(np.median(log.step))
        if slow < problem.sigma[2]:
            state = np.append(state[:2] - area * (area @ state[:2]) / (area @ area), state[2:])
            state[3] = 0.0
        out.append(state)
    return out


def moving_speeds(point: GrayPoint) -> FloatArray:
    """Velocities while the piston moves, measured ones where it never does, ``(n,)`` [m/s]."""
    v = np.concatenate([s[:, 3] for s in point.states])
    if not v.any():
        v = np.concatenate([log.guess[:, 3] for log in point.problem.logs])
    return np.asarray(v[v != 0.0])
