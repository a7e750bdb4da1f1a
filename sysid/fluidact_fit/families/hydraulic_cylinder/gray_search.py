"""Output error of pressures and position: the search for parameters and initial states.

A lifted Gauss-Newton iteration: multiple shooting whose node states are condensed away [1]_.

References
----------
.. [1] J. Albersmeyer, M. Diehl, "The lifted Newton method and its application in
   optimization", SIAM Journal on Optimization 20(3), 2010.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ...estimation.least_squares import without
from ...estimation.minimise import damped_step
from ...estimation.named_model import Values
from ...estimation.price import exhausted
from ...estimation.problem import Unknown
from ...estimation.uncertainty import Uncertainty, score_covariance
from ...experiment import BoolArray, FloatArray
from .case import LONG
from .gray_box import GrayBox, GrayLog, Linear

_AS_PREDICTED = 0.1  # part of what a step was to gain, up to which its slopes are kept
_UNDAMPED = 1e-12  # damping that only keeps singular equations solvable
_ASTRAY = 1e12  # residuals in standard deviations beyond which a simulation has run away
STATE_SCALE = np.array([1e5, 1e5, 1e-3, 1e-2])  # Pa, Pa, m, m/s


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
    def is_long(self) -> bool:
        """Whether steps over all samples are to be saved."""
        return sum(log.samples for log in self.box.logs) > LONG


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

    @property
    def merit(self) -> float:
        """What a step has to lower."""
        return self.cost + self.defect


@dataclass(frozen=True)
class GraySolution:
    """Outcome of the gray-box iteration.

    ``states`` holds ``(n, 4)`` per log (p1, p2, y, v) and ``initial`` their first rows,
    ``residuals`` and ``jacobian`` the weighted rows of every log, channel after channel, initial
    states projected out of the latter: ``start_basis`` is an orthonormal basis of what they can
    say. Where the search has not left the derivatives behind they are computed when asked for.
    """

    problem: GrayProblem
    end: _Iterate
    iterations: int
    converged: bool

    @property
    def values(self) -> dict[str, float]:
        """All parameters [SI]."""
        return self.end.values

    @property
    def states(self) -> list[FloatArray]:
        """Pressures, place and speed of every log, ``(n, 4)`` each."""
        return self.end.states

    @property
    def cost(self) -> float:
        """Sum of the squared weighted residuals."""
        return self.end.cost

    @property
    def initial(self) -> list[FloatArray]:
        """State of every log at its beginning."""
        return [s[0] for s in self.states]

    @property
    def active(self) -> BoolArray:
        """Which of the free parameters are at a bound."""
        inside = [u.low < self.values[u.name] < u.high for u in self.problem.free]
        return ~np.array(inside, dtype=bool)

    @cached_property
    def residuals(self) -> list[FloatArray]:
        """Weighted residuals of every log, channel after channel."""
        pairs = zip(self.problem.box.logs, self.states)
        return [_residuals(log, x, self.problem.sigma) for log, x in pairs]

    @property
    def jacobian(self) -> list[FloatArray]:
        """Derivatives of the weighted rows by the free parameters, with the sign of the model."""
        return [j for j, _ in self._derivatives]

    @property
    def start_basis(self) -> list[FloatArray]:
        """What the initial states of every log can say."""
        return [basis for _, basis in self._derivatives]

    @cached_property
    def _derivatives(self) -> list[tuple[FloatArray, FloatArray]]:
        if not self.end.linear:
            _linearise(self.problem, self.end)
        out = []
        for log, linear in zip(self.problem.box.logs, self.end.linear):
            j = _jacobian(log, linear, self.problem.sigma)
            basis = _basis(j[:, :4] * STATE_SCALE)[0]
            out.append((without(basis, j[:, 4:]), basis))
        self.end.linear = []  # several times as large as what was made of it
        return out

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """Covariance of the free parameters; the channels of a log share their errors."""
        channels = [
            [slice(k * log.samples, (k + 1) * log.samples) for k in range(len(log.channels))]
            for log in self.problem.box.logs
        ]
        return score_covariance(self.jacobian, self.residuals, channels)


def solve_gray_box(
    problem: GrayProblem,
    start: Values,
    initial: Sequence[FloatArray] | None = None,
    max_iterations: int = 40,
    *,
    near: bool = False,
    enough: float = 0.0,
) -> GraySolution:
    """Minimise the weighted output error over parameters and initial states.

    ``start`` holds all parameters, ``initial`` the state of every log at its beginning [SI] from
    an earlier solution near by: the search then starts without gaps between the segments. Left
    out, it starts from the measured signals. Steps count whether they are accepted or not.

    Parameters that are ``near`` their end already need no segments, and no second look at logs
    that may begin at rest: whether they do shows at once. The search ends where steps gain
    less than the part ``enough`` of the cost.
    """
    begin, count = dict(start), 0
    first: _Iterate | None = None
    if initial is None and (near or not problem.free):
        initial = [log.guess[0] for log in problem.box.logs]  # near enough
        rested = _at_rest(problem, initial) if near else None
        if rested is not None:
            ends = [_close(problem, begin, x) for x in (initial, rested)]
            first = min(ends, key=lambda e: e.cost)
    if initial is None:
        far = _Iterate(begin, [problem.box.nodes_of(log.guess) for log in problem.box.logs])
        _evaluate_gaps(problem, far)
        far, count, _ = _descend(problem, far, max_iterations, gaps=True)
        begin, initial = far.values, far.initial
    first = first or _close(problem, begin, initial)
    now, more, converged = _descend(problem, first, max_iterations, enough)
    rested = _at_rest(problem, now.initial) if max_iterations and not near else None
    if rested is not None:
        other, extra, settled = _descend(
            problem, _close(problem, now.values, rested), max_iterations, enough
        )
        more += extra
        if other.cost < now.cost:
            now, converged = other, settled
    return GraySolution(problem, now, count + more, converged and bool(np.isfinite(now.cost)))


def _at_rest(problem: GrayProblem, initial: Sequence[FloatArray]) -> list[FloatArray] | None:
    """The same beginnings with every log that hardly moves there at rest, forces balanced.

    Noise of the pressures may put a piston that sticks beyond its friction; it then slips in
    the simulation, and no small step of the search brings it back, from whatever speed it has come
    to by then. ``None`` where all move.
    """
    machine, found, changed = problem.box.machine, [], False
    area = np.array([machine.area(1), -machine.area(2)])
    for log, state in zip(problem.box.logs, initial):
        x = state.copy()
        slow = min(abs(x[3]), abs(log.guess[0, 3]))
        if x[3] != 0.0 and slow * float(np.median(log.step)) < problem.sigma[2]:
            x[:2] -= area * (area @ x[:2]) / (area @ area)
            x[3], changed = 0.0, True
        found.append(x)
    return found if changed else None


def _descend(
    problem: GrayProblem, now: _Iterate, most: int, enough: float = 0.0, gaps: bool = False
) -> tuple[_Iterate, int, bool]:
    """Damped steps until none helps; returns their number, and whether it came to that.

    With ``gaps`` that is multiple shooting, until the gaps between the segments are closed.
    Without, a trial is simulated without sensitivities; they are computed where it is accepted.
    Two steps in a row that change less than the part ``enough`` of the cost are the last: a single
    one may be short for its damping. So is one that came as predicted and leaves nothing to gain.
    """
    damping, count, little = 1e-4, 0, 0
    while count < most and not exhausted():
        count += 1
        if not now.linear:
            _linearise(problem, now)
        step, initial, predicted, left = _propose(problem, now, damping)
        trial = _move(problem, now, step, initial)
        if gaps:
            _evaluate_gaps(problem, trial)
        else:
            trial = _close(problem, trial.values, trial.initial)
        gain = now.merit - trial.merit
        little = little + 1 if abs(gain) <= enough * now.merit else 0
        if gain >= -1e-12 * now.merit:
            if gaps:
                settled = trial.defect <= 1e-2 * trial.cost and gain <= 1e-3 * now.merit
            else:  # a hundredth of one squared standard error: the slopes are the same
                at_end = abs(gain - predicted) <= 1e-2 and left <= 1e-2
                settled = gain <= 1e-2 or at_end or little > 1
            if settled:
                trial.linear = trial.linear or now.linear
                return trial, count, True
            as_predicted = abs(gain - predicted) <= _AS_PREDICTED * predicted
            if problem.is_long and (as_predicted or not problem.free):
                trial.linear = trial.linear or now.linear  # they are hardly others
            now, damping = trial, max(0.1 * damping, 1e-10)
        else:
            damping = max(10.0 * damping, 1e-6)
            if damping > 1e4 or predicted <= 1e-2 or little > 1:
                return now, count, True
    return now, count, False


@np.errstate(all="ignore")  # a simulation that has run away
def _residuals(log: GrayLog, states: FloatArray, sigma: FloatArray) -> FloatArray:
    """Weighted residuals, channel after channel."""
    r = [(y - states[:, c]) / sigma[c] for c, y in zip(log.channels, log.measured)]
    return np.concatenate(r)


@np.errstate(all="ignore")
def _jacobian(log: GrayLog, linear: Linear, sigma: FloatArray) -> FloatArray:
    """Their derivatives with the sign of the model."""
    return np.vstack([linear.slope[:, c, :-1] / sigma[c] for c in log.channels])


@np.errstate(all="ignore")
def _cost(problem: GrayProblem, states: Sequence[FloatArray]) -> float:
    """Sum of the squared weighted residuals, infinite where a simulation has run away."""
    every = (_residuals(log, s, problem.sigma) for log, s in zip(problem.box.logs, states))
    cost = sum(float(np.sum(r**2)) for r in every)
    return cost if np.isfinite(cost) else np.inf


def _close(problem: GrayProblem, values: Values, initial: Sequence[FloatArray]) -> _Iterate:
    """Simulate every log from its initial state."""
    box = problem.box
    states = [box.simulate(log, x, values) for log, x in zip(box.logs, initial)]
    nodes = [box.nodes_of(s) for s in states]
    return _Iterate(dict(values), nodes, states, cost=_cost(problem, states))


@np.errstate(all="ignore")
def _linearise(problem: GrayProblem, point: _Iterate) -> None:
    point.linear = [
        problem.box.linearise(log, nodes, point.values, problem.names)
        for log, nodes in zip(problem.box.logs, point.nodes)
    ]


def _evaluate_gaps(problem: GrayProblem, point: _Iterate) -> None:
    """Linearise every segment from its own node; weigh the gaps between them."""
    _linearise(problem, point)
    gap = np.append(problem.sigma, 100.0 * problem.sigma[2])  # counts as one residual
    point.cost = _cost(problem, [x.value for x in point.linear])
    point.defect = 10.0 * sum(float(np.sum((x.defects / gap) ** 2)) for x in point.linear)


def _propose(
    problem: GrayProblem, now: _Iterate, damping: float
) -> tuple[FloatArray, list[FloatArray], float, float]:
    """Damped Gauss-Newton step of the parameters and the initial states.

    Returned beside them is what it should gain, and what a step without damping would gain more.
    """
    scale, p = np.array([u.scale for u in problem.free]), len(problem.free)
    h, g = np.zeros((p, p)), np.zeros(p)
    blocks = []
    # gaps between the segments are closed to first order
    every = now.states or [linear.value + linear.slope[:, :, -1] for linear in now.linear]
    for log, linear, states in zip(problem.box.logs, now.linear, every):
        r = _residuals(log, states, problem.sigma)
        j = _jacobian(log, linear, problem.sigma)
        if not (np.all(np.abs(r) < _ASTRAY) and np.all(np.abs(j) < _ASTRAY**8)):
            raise np.linalg.LinAlgError("the simulation leaves every measured range")
        q, t = _basis(j[:, :4] * STATE_SCALE)
        shared = without(q, j[:, 4:] * scale)
        h += shared.T @ shared
        g += shared.T @ without(q, r)
        blocks.append((q, t, r, j))
    low, high = (np.array([getattr(u, end) for u in problem.free]) for end in ("low", "high"))
    x = np.array([now.values[n] for n in problem.names]) / scale
    step, whole = (
        damped_step(h, g, x, (low / scale, high / scale), d) for d in (damping, _UNDAMPED)
    )
    gain, most = (float(2.0 * g @ d - d @ h @ d) for d in (step, whole))
    initial, left = [], most - gain
    for q, t, r, j in blocks:
        rest = r - j[:, 4:] @ (step * scale)
        # damped as well: the speed of a piston at rest is anything but linear in its friction
        damped = np.vstack((t, np.diag(np.sqrt(damping) * np.linalg.norm(t, axis=0))))
        target = np.concatenate((q.T @ rest, np.zeros(4)))
        found = np.linalg.lstsq(damped, target, rcond=1e-12)[0]
        initial.append(found * STATE_SCALE)
        unmet = float(np.sum((q.T @ rest - t @ found) ** 2))
        left, gain = left + unmet, gain + float(np.sum((q.T @ r) ** 2)) - unmet
    return step * scale, initial, gain, left


def _basis(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orthonormal basis of columns, and the columns in it.

    One may be zero: a piston that sticks forgets the speed that it was said to begin with.
    """
    size = np.linalg.norm(columns, axis=0)
    q = np.linalg.qr(columns[:, size > 1e-12 * size.max()])[0]
    return q, q.T @ columns


def moving_speeds(solution: GraySolution) -> FloatArray:
    """Velocities while the piston moves, measured ones where it never does, ``(n,)`` [m/s]."""
    v = np.concatenate([s[:, 3] for s in solution.states])
    if not v.any():
        v = np.concatenate([log.guess[:, 3] for log in solution.problem.box.logs])
    return np.asarray(v[v != 0.0])


def _move(
    problem: GrayProblem, now: _Iterate, step: FloatArray, initial: Sequence[FloatArray]
) -> _Iterate:
    """Take a step: parameters, initial states, and the nodes that follow from them."""
    moved = {
        u.name: float(np.clip(now.values[u.name] + d, u.low, u.high))
        for u, d in zip(problem.free, step)
    }
    nodes = [
        old + linear.chain @ np.concatenate((start, step, [1.0]))
        for linear, old, start in zip(now.linear, now.nodes, initial)
    ]
    return _Iterate({**now.values, **moved}, nodes)
