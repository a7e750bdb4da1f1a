"""Output error of pressures and position: the search for parameters and initial states.

A lifted Gauss-Newton iteration: multiple shooting whose node states are condensed away [1]_.

References
----------
.. [1] J. Albersmeyer, M. Diehl, "The lifted Newton method and its application in
   optimization", SIAM Journal on Optimization 20(3), 2010.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...estimation.separable import Unknown, damped_step
from ...experiment import FloatArray
from .equations import Mask
from .gray_box import GrayBox, GrayLog, Linear

_ASTRAY = 1e12  # residuals in standard deviations beyond which a simulation has run away
_COARSE = 16.0  # times the slip while the search is still far away
STATE_SCALE = np.array([1e5, 1e5, 1e-3, 1e-2])  # Pa, Pa, m, m/s


@dataclass
class GraySolution:
    """Outcome of the gray-box iteration.

    ``states`` holds ``(n, 4)`` per log (p1, p2, y, v), ``residuals`` and ``jacobian`` the
    weighted rows of every log, channel after channel, initial states projected out of the latter.
    """

    values: dict[str, float]
    states: list[FloatArray]
    residuals: list[FloatArray]
    jacobian: list[FloatArray]
    initial: list[FloatArray]
    cost: float
    iterations: int
    converged: bool
    active: Mask
    sigma: FloatArray


@dataclass
class _Iterate:
    """A point of the iteration with everything computed there.

    ``states`` are those of a simulation without gaps and empty while there are gaps.
    """

    values: dict[str, float]
    nodes: list[FloatArray]
    states: list[FloatArray] = field(default_factory=list)
    linear: list[Linear] = field(default_factory=list)
    cost: float = np.inf
    defect: float = 0.0

    @property
    def initial(self) -> list[FloatArray]:
        """State of every log at its beginning."""
        return [n[0] for n in self.nodes]


@dataclass(frozen=True)
class GrayProblem:
    """What a search works on: logs and machine, the parameters to be estimated, weights.

    ``sigma`` holds the standard deviation of the residuals of p1, p2 and y [Pa, Pa, m].
    """

    box: GrayBox
    free: Sequence[Unknown]
    sigma: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters."""
        return tuple(u.name for u in self.free)

    @property
    def scale(self) -> FloatArray:
        """Typical sizes of the free parameters."""
        return np.array([u.scale for u in self.free])


def solve_gray_box(
    problem: GrayProblem,
    start: Mapping[str, float],
    initial: Sequence[FloatArray] | None = None,
    max_iterations: int = 40,
) -> GraySolution:
    """Minimise the weighted output error over parameters and initial states.

    Parameters
    ----------
    problem, start
        Logs, machine and what is free, and where to begin: all parameters by name.
    initial
        State of every log at its beginning [SI], from an earlier solution near by; the search then
        starts without gaps between the segments. Left out, it starts from the measured signals.
    max_iterations
        Limit on accepted and rejected steps together.
    """
    box, begin, count = problem.box, dict(start), 0
    if initial is None:
        # far away, sharp friction is of no use and takes most of the time
        coarse = replace(problem, box=box.rounded(_COARSE, most=1))
        far = _Iterate(begin, [box.nodes_of(log) for log in box.logs])
        _evaluate_gaps(coarse, far)
        far, count = _close_gaps(coarse, far, max_iterations)
        begin, initial = far.values, far.initial
        # a gap closes last; what is left of it must not hide a first state that is off
        now = _close(coarse, begin, initial)
        if np.isfinite(now.cost):
            now, more, _ = _iterate(coarse, now, max_iterations)
            count += more
            begin, initial = now.values, now.initial
    now = _close(problem, begin, initial)
    now, more, converged = _iterate(problem, now, max_iterations)
    if not now.linear:
        _linearise(problem, now)
    if max_iterations and converged:
        now = _sharpen(problem, now)
    return _finish(problem, now, count + more, converged)


def _close_gaps(problem: GrayProblem, now: _Iterate, most: int) -> tuple[_Iterate, int]:
    """Multiple shooting: damped steps until the gaps between the segments are closed."""
    damping, count = 1e-4, 0
    while count < most:
        count += 1
        step, initial, predicted = _propose(problem, now, damping)
        trial = _move(problem, now, step, initial)
        _evaluate_gaps(problem, trial)
        merit, new = now.cost + now.defect, trial.cost + trial.defect
        if new <= merit * (1.0 + 1e-12):
            now, damping = trial, max(0.1 * damping, 1e-10)
            if now.defect <= 1e-2 * now.cost and merit - new <= 1e-3 * merit:
                break
        else:
            damping = max(10.0 * damping, 1e-6)
            if damping > 1e4 or predicted <= 1e-2:
                break
    return now, count


def _iterate(problem: GrayProblem, now: _Iterate, most: int) -> tuple[_Iterate, int, bool]:
    """Damped steps without gaps until none helps.

    A trial is simulated without sensitivities; they are computed where it is accepted.
    """
    damping, count = 1e-4, 0
    while count < most:
        count += 1
        if not now.linear:
            _linearise(problem, now)
        step, initial, predicted = _propose(problem, now, damping)
        moved = _move(problem, now, step, initial)
        trial = _close(problem, moved.values, moved.initial)
        gain = now.cost - trial.cost
        if gain >= -1e-12 * now.cost:
            if gain <= 1e-2:  # a hundredth of one squared standard error: the slopes are the same
                trial.linear = now.linear
                return trial, count, True
            now, damping = trial, max(0.1 * damping, 1e-10)
        else:
            damping = max(10.0 * damping, 1e-6)
            if damping > 1e4 or predicted <= 1e-2:
                return now, count, True
    return now, count, False


def _sharpen(problem: GrayProblem, now: _Iterate) -> _Iterate:
    """Two more steps towards what friction without rounding would give.

    Rounding off moves the estimates by about a standard error. The residuals can be had with
    hardly any of it; the sensitivities cannot: those of a piston that sticks and breaks away are
    right in a neighbourhood that noise leaves at once. With the smooth ones as instruments the
    normal equations ``J' r = 0`` keep their solution.
    """
    sharp = replace(problem, box=problem.box.sharp())
    point = now
    for _ in range(2):
        trial = _close(sharp, point.values, point.initial)
        trial.linear = now.linear
        step, initial, _ = _propose(sharp, trial, 1e-9)
        point = _move(sharp, trial, step, initial)
    last = _close(sharp, point.values, point.initial)
    last.linear = now.linear
    return last if np.isfinite(last.cost) else now


@np.errstate(all="ignore")  # a simulation that has run away
def _residuals(log: GrayLog, states: FloatArray, sigma: FloatArray) -> FloatArray:
    """Weighted residuals, channel after channel."""
    r = [(y - states[:, c]) / sigma[c] for c, y in zip(log.channels, log.measured)]
    return np.concatenate(r)


@np.errstate(all="ignore")
def _jacobian(log: GrayLog, slope: FloatArray, sigma: FloatArray) -> FloatArray:
    """Their derivatives with the sign of the model."""
    return np.vstack([slope[:, c, :] / sigma[c] for c in log.channels])


@np.errstate(all="ignore")
def _cost(log: GrayLog, states: FloatArray, sigma: FloatArray) -> float:
    cost = float(np.sum(_residuals(log, states, sigma) ** 2))
    return cost if np.isfinite(cost) else np.inf


def _close(
    problem: GrayProblem, values: Mapping[str, float], initial: Sequence[FloatArray]
) -> _Iterate:
    """Simulate every log from its initial state."""
    box = problem.box
    states = [box.simulate(log, x, values) for log, x in zip(box.logs, initial)]
    cost = sum(_cost(log, s, problem.sigma) for log, s in zip(box.logs, states))
    nodes = [box.nodes_of(log, s) for log, s in zip(box.logs, states)]
    return _Iterate(dict(values), nodes, states, [], cost)


@np.errstate(all="ignore")
def _linearise(problem: GrayProblem, point: _Iterate) -> None:
    point.linear = [
        problem.box.linearise(log, nodes, point.values, problem.names)
        for log, nodes in zip(problem.box.logs, point.nodes)
    ]


def _evaluate_gaps(problem: GrayProblem, point: _Iterate) -> None:
    """Linearise every segment from its own node; weigh the gaps between them."""
    _linearise(problem, point)
    sigma = problem.sigma
    gap = np.append(sigma, 100.0 * sigma[2])  # counts as one residual
    cost = sum(_cost(log, x.value, sigma) for log, x in zip(problem.box.logs, point.linear))
    defect = 10.0 * sum(float(np.sum((x.defects / gap) ** 2)) for x in point.linear)
    finite = np.isfinite(cost) and np.isfinite(defect)
    point.cost, point.defect = (cost, defect) if finite else (np.inf, np.inf)


def _propose(
    problem: GrayProblem, now: _Iterate, damping: float
) -> tuple[FloatArray, list[FloatArray], float]:
    """Damped Gauss-Newton step of the parameters and the initial states."""
    scale, p = problem.scale, len(problem.free)
    h, g = np.zeros((p, p)), np.zeros(p)
    blocks = []
    for log, linear, states in zip(problem.box.logs, now.linear, now.states or _opened(now)):
        r = _residuals(log, states, problem.sigma)
        j = _jacobian(log, linear.slope, problem.sigma)
        if not (np.all(np.abs(r) < _ASTRAY) and np.all(np.abs(j) < _ASTRAY**8)):
            raise np.linalg.LinAlgError("the simulation leaves every measured range")
        own, shared = j[:, :4] * STATE_SCALE, j[:, 4:] * scale
        q, t = np.linalg.qr(own)
        shared = shared - q @ (q.T @ shared)
        h += shared.T @ shared
        g += shared.T @ (r - q @ (q.T @ r))
        blocks.append((q, t, r, j))
    low, high = (np.array([getattr(u, end) for u in problem.free]) for end in ("low", "high"))
    x = np.array([now.values[n] for n in problem.names])
    step = damped_step(h, g, x / scale, (low / scale, high / scale), damping)
    initial = []
    for q, t, r, j in blocks:
        rest = r - j[:, 4:] @ (step * scale)
        # damped as well: the speed of a piston at rest is anything but linear in its friction
        damped = np.vstack((t, np.diag(np.sqrt(damping) * np.linalg.norm(t, axis=0))))
        target = np.concatenate((q.T @ rest, np.zeros(4)))
        initial.append(np.linalg.lstsq(damped, target, rcond=1e-12)[0] * STATE_SCALE)
    return step * scale, initial, float(2.0 * g @ step - step @ h @ step)


def _opened(now: _Iterate) -> list[FloatArray]:
    """States with the gaps between the segments closed to first order."""
    return [linear.value + linear.shift for linear in now.linear]


def _move(
    problem: GrayProblem, now: _Iterate, step: FloatArray, initial: Sequence[FloatArray]
) -> _Iterate:
    """Take a step: parameters, initial states, and the nodes that follow from them."""
    moved = {
        u.name: float(np.clip(now.values[u.name] + d, u.low, u.high))
        for u, d in zip(problem.free, step)
    }
    nodes = [
        old + linear.chain @ np.concatenate((start, step)) + linear.offsets
        for linear, old, start in zip(now.linear, now.nodes, initial)
    ]
    return _Iterate({**now.values, **moved}, nodes)


def _finish(problem: GrayProblem, now: _Iterate, count: int, converged: bool) -> GraySolution:
    residuals, jacobian = [], []
    for log, states, linear in zip(problem.box.logs, now.states, now.linear):
        j = _jacobian(log, linear.slope, problem.sigma)
        q = np.linalg.qr(j[:, :4] * STATE_SCALE)[0]
        residuals.append(_residuals(log, states, problem.sigma))
        jacobian.append(j[:, 4:] - q @ (q.T @ j[:, 4:]))
    values = now.values
    active = [not u.low < values[u.name] < u.high for u in problem.free]
    return GraySolution(
        values, now.states, residuals, jacobian, now.initial, now.cost, count,
        converged and np.isfinite(now.cost), np.array(active, dtype=bool), problem.sigma,
    )  # fmt: skip
