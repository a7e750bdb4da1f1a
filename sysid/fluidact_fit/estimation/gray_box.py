"""Gray box of the servo-hydraulic cylinder: output error of pressures and position.

All four states are simulated and compared with both pressures and the position. The search is
a lifted Gauss-Newton iteration (multiple shooting whose node states are condensed away [1]_)
with sensitivities that are the exact derivatives of the Runge-Kutta scheme, built with CasADi.

Dry friction makes the equations stiff, but only within a fraction of a millimetre per second
of rest. Samples that begin or end there, or in which the piston turns round, are integrated in
many small steps, all others in the few that the pressure resonance asks for.

References
----------
.. [1] J. Albersmeyer, M. Diehl, "The lifted Newton method and its application in
   optimization", SIAM Journal on Optimization 20(3), 2010.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from ..experiment import Experiment, FloatArray
from ..signals import smooth
from .hydraulics import GRAY_NAMES, LOSSES, Machine

Mask = npt.NDArray[np.bool_]
_ROUND = 1e4  # Pa: pressure drop below which the square root of the gray box is rounded off
_SLIP = 1e-3  # speed over which dry friction is rounded off, of the fast motion
_MOST_SUBSTEPS = 16
_ASTRAY = 1e12  # residuals in standard deviations beyond which a simulation has run away
_NEAR_REST = 5.0  # times the slip: the friction has reached 0.9999 of its level there
_COARSE = 16.0  # times the slip while the search is still far away
STATE_SCALE = np.array([1e5, 1e5, 1e-3, 1e-2])  # Pa, Pa, m, m/s
_SHARP = 0.125  # times the slip when the last steps are taken


@dataclass(frozen=True)
class GrayLog:
    """One experiment as the gray box sees it.

    ``command`` and ``step`` have shape ``(n - 1,)``; ``channels`` holds the measured states
    (0: p1, 1: p2, 2: y) and ``measured`` their values, ``(len(channels), n)``. ``guess`` holds
    all four states from smoothed signals, ``(n, 4)``.
    """

    command: FloatArray
    step: FloatArray
    channels: tuple[int, ...]
    measured: FloatArray
    guess: FloatArray

    @property
    def samples(self) -> int:
        """Number of samples."""
        return int(self.guess.shape[0])


@dataclass
class GraySolution:
    """Outcome of the gray-box iteration.

    ``states`` holds ``(n, 4)`` per log (p1, p2, y, v), ``residuals`` and ``jacobian`` the
    weighted rows of every log, channel after channel, initial states projected out.
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


def make_gray_log(e: Experiment, machine: Machine) -> GrayLog:
    """Prepare one experiment: measured channels and a first guess of all four states."""
    half = max(2, round(0.006 / e.sample_time))
    motion = smooth(e["position"], e.sample_time, 2 * half, 3)
    guess = np.zeros((e.samples, 4))
    guess[:, 2], guess[:, 3] = motion.value, motion.rate
    channels = []
    for k, role in enumerate(("pressure_1", "pressure_2")):
        if role in e:
            guess[:, k] = smooth(e[role], e.sample_time, max(1, half // 2), 2).value
            channels.append(k)
    area_1, area_2, mass = machine.area(1), machine.area(2), machine.mass or 0.0
    inertia = mass * motion.curvature
    if 1 not in channels:
        guess[:, 1] = (guess[:, 0] * area_1 - inertia) / area_2
    if 0 not in channels:
        guess[:, 0] = (guess[:, 1] * area_2 + inertia) / area_1
    guess[:, :2] = np.clip(guess[:, :2], machine.tank, machine.supply)
    channels.append(2)
    roles = ("pressure_1", "pressure_2", "position")
    measured = np.array([e[roles[k]] for k in channels])
    return GrayLog(e["command"][:-1], np.diff(e.time), tuple(channels), measured, guess)


# ---------------------------------------------------------------------------------- scheme


@dataclass(frozen=True)
class Scheme:
    """How a sample is integrated.

    Attributes
    ----------
    slip
        Speed over which dry friction is rounded off [m/s].
    rest
        Speed below which a piston counts as near rest [m/s].
    moving, resting
        Runge-Kutta steps per sample away from rest and near it.
    """

    slip: float
    rest: float
    moving: int
    resting: int


@lru_cache(maxsize=16)
def _segment_function(
    machine: Machine, segment: int, scheme: Scheme, free: tuple[str, ...] | None
) -> Any:
    """CasADi function that integrates over a segment.

    ``(z, [u; h], theta) -> z after every sample``, with ``z`` the states and, unless ``free``
    is ``None``, column by column their derivatives by the initial state and the free
    parameters. The variational equations run through the same Runge-Kutta scheme, which makes
    them its exact derivative.
    """
    import casadi as ca

    x, u, theta = ca.SX.sym("x", 4), ca.SX.sym("u"), ca.SX.sym("theta", len(GRAY_NAMES))
    rate = _symbolic_rates(ca, x, u, theta, machine, scheme.slip)
    z, change = x, rate
    if free is not None:
        columns = 4 + len(free)
        s = ca.SX.sym("s", 4, columns)
        which = [GRAY_NAMES.index(n) for n in free]
        forced = ca.horzcat(ca.SX(4, 4), ca.jacobian(rate, theta)[:, which])
        z = ca.vertcat(x, ca.vec(s))
        change = ca.vertcat(rate, ca.vec(ca.mtimes(ca.jacobian(rate, x), s) + forced))
    f = ca.Function("f", [z, u, theta], [change])
    after = _sample_function(ca, f, scheme.moving)
    if scheme.resting > scheme.moving:
        states_only = ca.Function("g", [x, u, theta], [rate])
        ahead = _sample_function(ca, states_only, scheme.moving)
        now, held = ca.MX.sym("z", z.shape[0]), ca.MX.sym("input", 2)
        values = ca.MX.sym("theta", len(GRAY_NAMES))
        v0, v1 = now[3], ahead(now[:4], held, values)[3]
        slowest = ca.fmin(ca.fabs(v0), ca.fabs(v1))
        near_rest = ca.logic_or(slowest < scheme.rest, v0 * v1 < 0.0)
        # a switch evaluates the chosen branch only
        switch = ca.Function.if_else("switch", _sample_function(ca, f, scheme.resting), after)
        after = ca.Function("step", [now, held, values], [switch(near_rest, now, held, values)])
    return after.mapaccum("segment", segment)


def _sample_function(ca: Any, f: Any, substeps: int) -> Any:
    """Classical Runge-Kutta over one sample, ``(z, [u; h], theta) -> z``."""
    size = f.size1_in(0)
    z, input = ca.SX.sym("z", size), ca.SX.sym("input", 2)
    theta = ca.SX.sym("theta", len(GRAY_NAMES))
    u, h = input[0], input[1] / substeps
    k1 = f(z, u, theta)
    k2 = f(z + 0.5 * h * k1, u, theta)
    k3 = f(z + 0.5 * h * k2, u, theta)
    k4 = f(z + h * k3, u, theta)
    one = ca.Function("one", [z, input, theta], [z + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)])
    now, held = ca.MX.sym("z", size), ca.MX.sym("input", 2)
    values = ca.MX.sym("theta", len(GRAY_NAMES))
    after = now
    for _ in range(substeps):
        after = one(after, held, values)
    return ca.Function("sample", [now, held, values], [after])


def _symbolic_rates(ca: Any, x: Any, u: Any, theta: Any, machine: Machine, slip: float) -> Any:
    """Equations 1 to 4 with dead zone, losses and dry friction, as CasADi expressions.

    Equation 5 of the paper writes ``f`` with a dot although it is no derivative, and equation
    8 has ``M y'`` where equation 1 has ``M y''``: both are typing errors.
    """
    p = dict(zip(GRAY_NAMES, ca.vertsplit(theta)))
    beyond = ca.fmax(u - p["dead_zone_positive"], 0.0) + ca.fmin(u - p["dead_zone_negative"], 0.0)
    forward = beyond >= 0.0
    sign = ca.if_else(forward, 1.0, -1.0)

    def flow(chamber: int, pressure: Any) -> Any:
        inward = machine.supply - pressure
        outward = pressure - machine.tank
        ahead, back = (inward, outward) if chamber == 1 else (outward, inward)
        names = LOSSES[chamber]
        drop = ca.if_else(forward, ahead, back)
        loss = ca.if_else(forward, p[names[0]], p[names[1]])
        k = p[f"valve_gain_{chamber}"] * beyond * sign
        # without loss the root has an infinite slope at zero drop: rounded off below 0.1 bar
        size = ca.sqrt(drop * drop + _ROUND**2)
        return sign * 2.0 * k * drop / (k * loss + ca.sqrt((k * loss) ** 2 + 4.0 * size))

    p1, p2, y, v = ca.vertsplit(x)
    area_1, area_2 = machine.area(1), machine.area(2)
    beta, mass = p["bulk_modulus"], machine.mass
    volume_1 = (machine.dead_volume_1 or 0.0) + area_1 * y
    volume_2 = (machine.dead_volume_2 or 0.0) - area_2 * y
    dp1 = beta / volume_1 * (flow(1, p1) - area_1 * v)
    dp2 = -beta / volume_2 * (flow(2, p2) - area_2 * v)
    friction = p["viscous"] * v + p["coulomb"] * ca.tanh(v / slip)
    dv = (p1 * area_1 - p2 * area_2 - friction) / mass
    return ca.vertcat(dp1, dp2, v, dv)


class GrayBox:
    """Output error of pressures and position over several logs.

    Parameters
    ----------
    logs
        See :func:`make_gray_log`.
    machine
        Everything given; complete.
    friction
        Largest dry and viscous friction to be expected [N], [N s/m]: they set the speed over
        which dry friction is rounded off and the number of Runge-Kutta steps per sample.
    segment
        Samples between two shooting nodes.
    """

    def __init__(
        self,
        logs: Sequence[GrayLog],
        machine: Machine,
        friction: tuple[float, float],
        segment: int = 50,
    ) -> None:
        self.logs, self.machine, self._friction = list(logs), machine, friction
        self.segment = min(segment, *(log.samples - 1 for log in logs))
        speeds = np.concatenate([np.abs(log.guess[:, 3]) for log in logs])
        slip = max(_SLIP * float(np.quantile(speeds, 0.95)), 1e-7)
        self.scheme = self._scheme(slip, _MOST_SUBSTEPS)

    def _scheme(self, slip: float, most: int) -> Scheme:
        step = max(float(np.max(log.step)) for log in self.logs)
        coulomb, viscous = self._friction
        mass = self.machine.mass or 1.0
        # Runge-Kutta of order 4 is stable up to 2.78 / h and exact enough below 0.3 / omega
        rolling = step * viscous / mass / 2.0
        moving = int(np.clip(np.ceil(max(rolling, step / 5e-4)), 1, _MOST_SUBSTEPS))
        most = max(most, moving)
        sticking = step * (coulomb / (mass * slip) + viscous / mass) / 2.0
        resting = int(np.clip(np.ceil(sticking), moving, most))
        slip *= max(sticking / resting, 1.0)
        # a long step from beyond would have stages on the other side of rest
        return Scheme(slip, _NEAR_REST * slip + 2.0 * coulomb / mass * step, moving, resting)

    def rounded(self, factor: float, most: int = _MOST_SUBSTEPS) -> GrayBox:
        """The same with dry friction rounded off over a speed ``factor`` times as wide.

        Parameters
        ----------
        factor
            Of the speed.
        most
            Limit on the Runge-Kutta steps per sample near rest; the speed grows until it holds.
        """
        other = copy(self)
        other.scheme = self._scheme(factor * self.scheme.slip, most)
        return other

    def _segments(self, log: GrayLog) -> int:
        return -(-(log.samples - 1) // self.segment)

    def _inputs(self, log: GrayLog) -> FloatArray:
        """Command and step of every sample, the last segment filled up, ``(2, m)``."""
        inputs = np.empty((2, self._segments(log) * self.segment))
        for row, values in zip(inputs, (log.command, log.step)):
            row[: values.size], row[values.size :] = values, values[-1]
        return inputs

    def integrate(
        self, log: GrayLog, nodes: FloatArray, values: Mapping[str, float], free: Sequence[str]
    ) -> tuple[FloatArray, FloatArray]:
        """States and sensitivities after every sample of every segment.

        Parameters
        ----------
        log
            The log.
        nodes : (segments, 4)
            State at the beginning of every segment [Pa, Pa, m, m/s].
        values
            All parameters by name.
        free
            Names of those whose sensitivities are wanted.

        Returns
        -------
        states : (segments, segment, 4)
        slopes : (segments, segment, 4, 4 + free)
            Derivatives by the node's state and the free parameters.
        """
        count, length, columns = nodes.shape[0], self.segment, 4 + len(free)
        function = _segment_function(self.machine, length, self.scheme, tuple(free)).map(count)
        seed = np.zeros((4, columns))
        seed[:, :4] = np.eye(4)
        z = np.vstack((nodes.T, np.repeat(seed.T.reshape(-1, 1), count, axis=1)))
        theta = np.tile(_theta(values), (1, count * length))
        out = np.asarray(function(z, self._inputs(log), theta)).T.reshape(count, length, -1)
        slopes = out[:, :, 4:].reshape(count, length, columns, 4)
        return out[:, :, :4], np.swapaxes(slopes, 2, 3)

    def simulate(
        self, log: GrayLog, initial: FloatArray, values: Mapping[str, float]
    ) -> FloatArray:
        """States at every sample from the initial state, ``(n, 4)``.

        Parameters
        ----------
        log
            The log.
        initial : (4,)
            [Pa, Pa, m, m/s]
        values
            All parameters by name.
        """
        function = _segment_function(self.machine, self.segment, self.scheme, None)
        theta = np.tile(_theta(values), (1, self.segment))
        inputs = self._inputs(log)
        states = np.empty((inputs.shape[1] + 1, 4))
        states[0] = initial
        for first in range(0, inputs.shape[1], self.segment):
            rows = slice(first, first + self.segment)
            states[first + 1 : rows.stop + 1] = np.asarray(
                function(states[first], inputs[:, rows], theta)
            ).T
        return states[: log.samples]

    def per_sample(
        self, log: GrayLog, states: FloatArray, values: Mapping[str, float]
    ) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the state after every sample.

        Parameters
        ----------
        log
            The log.
        states : (n, 4)
            Of a simulation.
        values
            All parameters by name.

        Returns
        -------
        transition : (n - 1, 4, 4)
            By the state before the sample.
        drive : (n - 1, 4)
            By the command over it.
        """
        single = copy(self)
        single.segment = 1
        # a command further up is both edges of the dead zone further down
        edges = ("dead_zone_negative", "dead_zone_positive")
        slopes = single.integrate(log, states[:-1], values, edges)[1][:, 0]
        return slopes[:, :, :4], -slopes[:, :, 4:].sum(axis=2)

    def nodes_of(self, log: GrayLog, states: FloatArray | None = None) -> FloatArray:
        """Node states from given states or the first guess, ``(segments, 4)``."""
        rows = np.arange(self._segments(log)) * self.segment
        return np.asarray((log.guess if states is None else states)[rows]).copy()

    def linearise(
        self,
        log: GrayLog,
        nodes: FloatArray,
        values: Mapping[str, float],
        free: Sequence[str],
    ) -> _Linear:
        """Condense one log: states as an affine function of initial state and parameters."""
        states, slopes = self.integrate(log, nodes, values, free)
        count, length = states.shape[:2]
        n, q = log.samples, 4 + len(free)
        value, slope = np.empty((count * length + 1, 4)), np.empty((count * length + 1, 4, q))
        shift, defects = np.empty((count * length + 1, 4)), np.zeros((count, 4))
        by_node, known = np.zeros((4, q)), np.zeros(4)
        by_node[:, :4] = np.eye(4)
        chain, offsets = np.empty((count, 4, q)), np.empty((count, 4))
        value[0], slope[0], shift[0] = nodes[0], by_node, known
        for k in range(count):
            rows = slice(k * length + 1, (k + 1) * length + 1)
            chain[k], offsets[k] = by_node, known
            forward = slopes[k, :, :, :4]
            slope[rows] = forward @ by_node
            slope[rows, :, 4:] += slopes[k, :, :, 4:]
            shift[rows] = forward @ known
            value[rows] = states[k]
            by_node, known = slope[rows][-1], shift[rows][-1]
            if k + 1 < count:
                defects[k] = states[k, -1] - nodes[k + 1]
                known = known + defects[k]
        return _Linear(value[:n], slope[:n], shift[:n], chain, offsets, defects)


def _theta(values: Mapping[str, float]) -> FloatArray:
    return np.array([[values[n]] for n in GRAY_NAMES])


# ---------------------------------------------------------------------------------- search


@dataclass(frozen=True)
class _Linear:
    """States ``value + slope d + shift`` for a change ``d`` of initial state and parameters."""

    value: FloatArray
    slope: FloatArray
    shift: FloatArray
    chain: FloatArray
    offsets: FloatArray
    defects: FloatArray


@dataclass
class _Iterate:
    """A point of the iteration with everything computed there.

    ``states`` are those of a simulation without gaps and empty while there are gaps.
    """

    values: dict[str, float]
    nodes: list[FloatArray]
    states: list[FloatArray] = field(default_factory=list)
    linear: list[_Linear] = field(default_factory=list)
    cost: float = np.inf
    defect: float = 0.0


@dataclass(frozen=True)
class _Problem:
    """What an iteration works on; ``scale`` and the bounds as arrays follow ``free``."""

    box: GrayBox
    free: Sequence[str]
    scale: FloatArray
    bounds: Mapping[str, tuple[float, float]]
    sigma: FloatArray


def solve_gray_box(
    box: GrayBox,
    start: Mapping[str, float],
    free: Sequence[str],
    scales: Mapping[str, float],
    bounds: Mapping[str, tuple[float, float]],
    sigma: FloatArray,
    initial: Sequence[FloatArray] | None = None,
    max_iterations: int = 40,
) -> GraySolution:
    """Minimise the weighted output error over parameters and initial states.

    Parameters
    ----------
    box
        Logs and machine.
    start
        All parameters by name.
    free
        Those to be estimated.
    scales, bounds
        Typical size and closed range of each free one.
    sigma : (3,)
        Standard deviation of the residuals of p1, p2 and y [Pa, Pa, m].
    initial
        State of every log at its beginning, from an earlier solution near by; the search then
        starts without gaps between the segments. Left out, it starts from the measured signals.
    max_iterations
        Limit on accepted and rejected steps together.
    """
    problem = _Problem(box, free, np.array([scales[n] for n in free]), bounds, sigma)
    count = 0
    begin = dict(start)
    if initial is None:
        # far away, sharp friction is of no use and takes most of the time
        coarse = replace(problem, box=box.rounded(_COARSE, most=1))
        far = _Iterate(begin, [box.nodes_of(log) for log in box.logs])
        _evaluate_gaps(coarse, far)
        far, count = _close_gaps(coarse, far, max_iterations)
        begin, initial = far.values, [n[0] for n in far.nodes]
        # a gap closes last; what is left of it must not hide a first state that is off
        now = _close(coarse, begin, initial)
        if np.isfinite(now.cost):
            now, more, _ = _iterate(coarse, now, max_iterations)
            count += more
            begin, initial = now.values, [n[0] for n in now.nodes]
    now = _close(problem, begin, initial)
    now, more, converged = _iterate(problem, now, max_iterations)
    if not now.linear:
        _linearise(problem, now)
    if max_iterations and converged:
        now = _sharpen(problem, now)
    return _finish(problem, now, count + more, converged)


def _close_gaps(problem: _Problem, now: _Iterate, most: int) -> tuple[_Iterate, int]:
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


def _iterate(problem: _Problem, now: _Iterate, most: int) -> tuple[_Iterate, int, bool]:
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
        trial = _close(problem, moved.values, [n[0] for n in moved.nodes])
        gain = now.cost - trial.cost
        if gain >= -1e-12 * now.cost:
            small = gain <= 1e-2  # a hundredth of one squared standard error
            if small:
                # so near that the slopes are the same
                trial.linear = now.linear
            now, damping = trial, max(0.1 * damping, 1e-10)
            if small:
                return now, count, True
        else:
            damping = max(10.0 * damping, 1e-6)
            if damping > 1e4 or predicted <= 1e-2:
                return now, count, True
    return now, count, False


def _sharpen(problem: _Problem, now: _Iterate) -> _Iterate:
    """Two more steps towards what friction without rounding would give.

    Rounding off moves the estimates by about a standard error. The residuals can be had with
    hardly any of it; the sensitivities cannot: those of a piston that sticks and breaks away are
    right in a neighbourhood that noise leaves at once. With the smooth ones as instruments the
    normal equations ``J' r = 0`` keep their solution.
    """
    sharp = replace(problem, box=problem.box.rounded(_SHARP, most=int(_MOST_SUBSTEPS / _SHARP)))
    point = now
    for _ in range(2):
        trial = _close(sharp, point.values, [n[0] for n in point.nodes])
        trial.linear = now.linear
        step, initial, _ = _propose(sharp, trial, 1e-9)
        point = _move(sharp, trial, step, initial)
    last = _close(sharp, point.values, [n[0] for n in point.nodes])
    last.linear = now.linear
    return last if np.isfinite(last.cost) else now


def _rows(
    log: GrayLog, states: FloatArray, slope: FloatArray, sigma: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Weighted residuals and Jacobian, channel after channel."""
    with np.errstate(over="ignore", invalid="ignore"):  # a simulation that has run away
        r = [(y - states[:, c]) / sigma[c] for c, y in zip(log.channels, log.measured)]
        j = [slope[:, c, :] / sigma[c] for c in log.channels]
    return np.concatenate(r), np.vstack(j)


def _weighted_cost(log: GrayLog, states: FloatArray, sigma: FloatArray) -> float:
    with np.errstate(all="ignore"):
        cost = sum(
            float(np.sum(((y - states[:, c]) / sigma[c]) ** 2))
            for c, y in zip(log.channels, log.measured)
        )
    return cost if np.isfinite(cost) else np.inf


def _close(
    problem: _Problem, values: Mapping[str, float], initial: Sequence[FloatArray]
) -> _Iterate:
    """Simulate every log from its initial state."""
    box = problem.box
    states = [box.simulate(log, x, values) for log, x in zip(box.logs, initial)]
    cost = sum(_weighted_cost(log, s, problem.sigma) for log, s in zip(box.logs, states))
    nodes = [box.nodes_of(log, s) for log, s in zip(box.logs, states)]
    return _Iterate(dict(values), nodes, states, [], cost)


def _linearise(problem: _Problem, point: _Iterate) -> None:
    with np.errstate(all="ignore"):
        point.linear = [
            problem.box.linearise(log, nodes, point.values, problem.free)
            for log, nodes in zip(problem.box.logs, point.nodes)
        ]


def _evaluate_gaps(problem: _Problem, point: _Iterate) -> None:
    """Linearise every segment from its own node; weigh the gaps between them."""
    _linearise(problem, point)
    sigma = problem.sigma
    gap = np.array([sigma[0], sigma[1], sigma[2], 100.0 * sigma[2]])  # counts as one residual
    cost, defect = 0.0, 0.0
    for log, linear in zip(problem.box.logs, point.linear):
        cost += _weighted_cost(log, linear.value, sigma)
        defect += float(10.0 * np.sum((linear.defects / gap) ** 2))
    finite = np.isfinite(cost) and np.isfinite(defect)
    point.cost, point.defect = (cost, defect) if finite else (np.inf, np.inf)


def _propose(
    problem: _Problem, now: _Iterate, damping: float
) -> tuple[FloatArray, list[FloatArray], float]:
    """Damped Gauss-Newton step of the parameters and the initial states."""
    free, scale, bounds = problem.free, problem.scale, problem.bounds
    p = len(free)
    h, g = np.zeros((p, p)), np.zeros(p)
    blocks = []
    for log, linear, states in zip(problem.box.logs, now.linear, now.states or _opened(now)):
        r, j = _rows(log, states, linear.slope, problem.sigma)
        if not (np.all(np.abs(r) < _ASTRAY) and np.all(np.abs(j) < _ASTRAY**8)):
            raise np.linalg.LinAlgError("the simulation leaves every measured range")
        own, shared = j[:, :4] * STATE_SCALE, j[:, 4:] * scale
        q, t = np.linalg.qr(own)
        shared = shared - q @ (q.T @ shared)
        h += shared.T @ shared
        g += shared.T @ (r - q @ (q.T @ r))
        blocks.append((q, t, r, j))
    low = np.array([bounds[n][0] for n in free]) / scale
    high = np.array([bounds[n][1] for n in free]) / scale
    x = np.array([now.values[n] for n in free]) / scale
    step = _bounded_step(h, g, x, low, high, damping)
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


def _bounded_step(
    h: FloatArray, g: FloatArray, x: FloatArray, low: FloatArray, high: FloatArray, damping: float
) -> FloatArray:
    """Marquardt step in scaled unknowns; those that would cross a bound stop on it."""
    step = np.zeros(g.size)
    free = ~(((x <= low) & (g <= 0.0)) | ((x >= high) & (g >= 0.0)))
    for _ in range(g.size + 1):
        index = np.flatnonzero(free)
        if index.size == 0:
            break
        size = np.sqrt(np.maximum(np.diag(h)[index], 1e-300))
        normal = h[np.ix_(index, index)] / np.outer(size, size) + damping * np.eye(index.size)
        rhs = (g[index] - h[index][:, ~free] @ step[~free]) / size
        step[index] = np.linalg.lstsq(normal, rhs, rcond=1e-14)[0] / size
        crossing = free & ((x + step < low) | (x + step > high))
        if not crossing.any():
            break
        step[crossing] = np.clip(x + step, low, high)[crossing] - x[crossing]
        free &= ~crossing
    return step


def _move(
    problem: _Problem, now: _Iterate, step: FloatArray, initial: Sequence[FloatArray]
) -> _Iterate:
    """Take a step: parameters, initial states, and the nodes that follow from them."""
    values = dict(now.values)
    for name, d in zip(problem.free, step):
        low, high = problem.bounds[name]
        values[name] = float(np.clip(values[name] + d, low, high))
    nodes = []
    for linear, old, start in zip(now.linear, now.nodes, initial):
        d = np.concatenate((start, step))
        nodes.append(old + linear.chain @ d + linear.offsets)
    return _Iterate(values, nodes)


def _finish(problem: _Problem, now: _Iterate, count: int, converged: bool) -> GraySolution:
    residuals, jacobian = [], []
    for log, states, linear in zip(problem.box.logs, now.states, now.linear):
        r, j = _rows(log, states, linear.slope, problem.sigma)
        q = np.linalg.qr(j[:, :4] * STATE_SCALE)[0]
        shared = j[:, 4:]
        residuals.append(r)
        jacobian.append(shared - q @ (q.T @ shared))
    bounds, values = problem.bounds, now.values
    active = [not bounds[n][0] < values[n] < bounds[n][1] for n in problem.free]
    return GraySolution(
        values, now.states, residuals, jacobian, [n[0] for n in now.nodes], now.cost, count,
        converged and np.isfinite(now.cost), np.array(active, dtype=bool), problem.sigma,
    )  # fmt: skip
