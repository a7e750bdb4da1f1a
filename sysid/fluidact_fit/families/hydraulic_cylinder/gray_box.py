"""Simulation of all four states with sensitivities, exact derivatives of its Runge-Kutta scheme.

Dry friction makes the equations stiff, but only within a fraction of a millimetre per second
of rest. Samples that begin or end there, or in which the piston turns round, are integrated in
many small steps, all others in the few that the pressure resonance asks for.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from ...estimation.inputs import piecewise
from ...estimation.parametric import Values
from ...experiment import Experiment, FloatArray
from ...signals import smooth
from .equations import EDGES, GRAY_NAMES, LOSSES, Machine

CHANNELS = ("pressure_1", "pressure_2", "position")
_ROUND = 1e4  # Pa: pressure drop below which the square root of the gray box is rounded off
_SLIP = 1e-3  # speed over which dry friction is rounded off, of the fast motion
_MARGIN = 1.3  # of the friction that the steps are made for
_MOST_SUBSTEPS = 16
_NEAR_REST = 5.0  # times the slip: the friction has reached 0.9999 of its level there
_SHARP = 0.125  # times the slip where friction is to be as good as not rounded off


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


def make_gray_log(e: Experiment, machine: Machine) -> GrayLog:
    """Prepare one experiment: measured channels and a first guess of all four states."""
    half = max(2, round(0.006 / e.sample_time))
    motion = smooth(e["position"], e.sample_time, 2 * half, 3)
    guess = np.zeros((e.samples, 4))
    guess[:, 2], guess[:, 3] = motion.value, motion.rate
    channels = tuple(k for k, role in enumerate(CHANNELS) if role in e)
    for k in channels[:-1]:
        guess[:, k] = smooth(e.sampled(CHANNELS[k]), e.sample_time, max(1, half // 2), 2).value
    inertia = (machine.mass or 0.0) * motion.curvature
    if channels == (2,):
        guess[:, 0] = machine.at_rest(0.0)[0]
    if 1 not in channels:
        guess[:, 1] = (guess[:, 0] * machine.area(1) - inertia) / machine.area(2)
    elif 0 not in channels:
        guess[:, 0] = (guess[:, 1] * machine.area(2) + inertia) / machine.area(1)
    guess[:, :2] = np.clip(guess[:, :2], machine.tank, machine.supply)
    measured = np.array([e.sampled(CHANNELS[k]) for k in channels])
    return GrayLog(mean_command(e), np.diff(e.time), channels, measured, guess)


def mean_command(e: Experiment) -> FloatArray:
    """Command over every interval between samples, ``(n - 1,)`` [V].

    Held between its samples it is the command itself. One that acts late or moves between them
    counts by its mean: the valve's flow is proportional to it, and the oil integrates the flow.
    """
    signal = e.signals["command"]
    if signal.hold in (None, "zoh") and np.array_equal(signal.time, e.time):
        return e.sampled("command")[:-1]
    u = piecewise(signal, level=signal.before)
    pieces = np.clip(np.searchsorted(u.nodes, e.time, side="right") - 1, 0, None)
    power = np.arange(1, u.coefficients.shape[1] + 1)
    whole = np.sum(u.coefficients[:-1] * np.diff(u.nodes)[:, None] ** power / power, axis=1)
    since = np.maximum(e.time - u.nodes[pieces], 0.0)
    part = np.sum(u.coefficients[pieces] * since[:, None] ** power / power, axis=1)
    total = np.append(0.0, np.cumsum(whole))[pieces] + part
    return np.asarray(signal.before + np.diff(total) / np.diff(e.time))


@dataclass(frozen=True)
class Scheme:
    """How a sample is integrated.

    Dry friction is rounded off over the speed ``slip``; below the speed ``rest`` [m/s] a sample
    takes ``resting`` Runge-Kutta steps, and ``moving`` ones elsewhere.
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
        s = ca.SX.sym("s", 4, 4 + len(free))
        which = [GRAY_NAMES.index(n) for n in free]
        forced = ca.horzcat(ca.SX(4, 4), ca.jacobian(rate, theta)[:, which])
        z = ca.vertcat(x, ca.vec(s))
        change = ca.vertcat(rate, ca.vec(ca.mtimes(ca.jacobian(rate, x), s) + forced))
    f = ca.Function("f", [z, u, theta], [change])
    after = _sample_function(ca, f, scheme.moving)
    if scheme.resting > scheme.moving:
        states_only = ca.Function("g", [x, u, theta], [rate])
        ahead = _sample_function(ca, states_only, scheme.moving)
        now, held, values = _arguments(ca.MX, z.shape[0])
        v0, v1 = now[3], ahead(now[:4], held, values)[3]
        slowest = ca.fmin(ca.fabs(v0), ca.fabs(v1))
        near_rest = ca.logic_or(slowest < scheme.rest, v0 * v1 < 0.0)
        # a switch evaluates the chosen branch only
        switch = ca.Function.if_else("switch", _sample_function(ca, f, scheme.resting), after)
        after = ca.Function("step", [now, held, values], [switch(near_rest, now, held, values)])
    return after.mapaccum("segment", segment)


def _arguments(kind: Any, size: int) -> tuple[Any, Any, Any]:
    """Symbols of states, ``[u; h]`` and parameters."""
    return kind.sym("z", size), kind.sym("input", 2), kind.sym("theta", len(GRAY_NAMES))


def _sample_function(ca: Any, f: Any, substeps: int) -> Any:
    """Classical Runge-Kutta over one sample, ``(z, [u; h], theta) -> z``."""
    z, input, theta = _arguments(ca.SX, f.size1_in(0))
    u, h = input[0], input[1] / substeps
    k1 = f(z, u, theta)
    k2 = f(z + 0.5 * h * k1, u, theta)
    k3 = f(z + 0.5 * h * k2, u, theta)
    k4 = f(z + h * k3, u, theta)
    one = ca.Function("one", [z, input, theta], [z + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)])
    now, held, values = _arguments(ca.MX, f.size1_in(0))
    after = now
    for _ in range(substeps):
        after = one(after, held, values)
    return ca.Function("sample", [now, held, values], [after])


def _symbolic_rates(ca: Any, x: Any, u: Any, theta: Any, machine: Machine, slip: float) -> Any:
    """Equations 1 to 4 with dead zone, losses and dry friction, as CasADi expressions."""
    p = dict(zip(GRAY_NAMES, ca.vertsplit(theta)))
    beyond = ca.fmax(u - p["dead_zone_positive"], 0.0) + ca.fmin(u - p["dead_zone_negative"], 0.0)
    extending = beyond >= 0.0
    sign = ca.if_else(extending, 1.0, -1.0)

    def flow(chamber: int, pressure: Any) -> Any:
        drops = machine.supply - pressure, pressure - machine.tank
        losses = (p[name] for name in LOSSES[chamber])
        drop = ca.if_else(extending, *(drops if chamber == 1 else reversed(drops)))
        loss = ca.if_else(extending, *losses)
        k = p[f"valve_gain_{chamber}"] * beyond * sign
        # without loss the root has an infinite slope at zero drop: rounded off below 0.1 bar
        size = ca.sqrt(drop * drop + _ROUND**2)
        return sign * 2.0 * k * drop / (k * loss + ca.sqrt((k * loss) ** 2 + 4.0 * size))

    p1, p2, y, v = ca.vertsplit(x)
    area_1, area_2 = machine.area(1), machine.area(2)
    dp1 = p["bulk_modulus"] / machine.volume(1, y) * (flow(1, p1) - area_1 * v)
    dp2 = -p["bulk_modulus"] / machine.volume(2, y) * (flow(2, p2) - area_2 * v)
    friction = p["viscous"] * v + p["coulomb"] * ca.tanh(v / slip)
    dv = (p1 * area_1 - p2 * area_2 - friction) / machine.mass
    return ca.vertcat(dp1, dp2, v, dv)


@dataclass(frozen=True)
class Linear:
    """States ``value + slope [d, 1]`` for a change ``d`` of initial state and parameters.

    The last column closes the gaps between the segments. ``chain`` says the same of the nodes;
    ``defects`` are the gaps between the end of a segment and the next node.
    """

    value: FloatArray
    slope: FloatArray
    chain: FloatArray
    defects: FloatArray


class GrayBox:
    """Simulation and sensitivities of several logs, in segments of so many samples.

    The dry and viscous friction to be expected [N], [N s/m] set the number of Runge-Kutta steps
    per sample and the speed over which dry friction is rounded off where it need not be in steps
    this small: ``slip`` [m/s], from the speeds of the logs when left out.
    """

    def __init__(
        self,
        logs: Sequence[GrayLog],
        machine: Machine,
        friction: tuple[float, float],
        segment: int = 50,
        slip: float | None = None,
    ) -> None:
        self.logs, self.machine, self._friction = list(logs), machine, friction
        self.segment = min(segment, *(log.samples - 1 for log in logs))
        if slip is None:
            speeds = np.concatenate([np.abs(log.guess[:, 3]) for log in logs])
            slip = max(_SLIP * float(np.quantile(speeds, 0.95)), 1e-7)
        self.slip = slip
        self.scheme = self._scheme(slip, _MOST_SUBSTEPS)

    def _scheme(self, slip: float, most: int) -> Scheme:
        step = max(float(np.max(log.step)) for log in self.logs)
        coulomb, viscous = (_MARGIN * f / (self.machine.mass or 1.0) for f in self._friction)
        # Runge-Kutta of order 4 is stable up to 2.78 / h and exact enough below 0.3 / omega
        rolling = step * viscous / 2.0
        moving = int(np.clip(np.ceil(max(rolling, step / 5e-4)), 1, _MOST_SUBSTEPS))
        sticking = step * (coulomb / slip + viscous) / 2.0
        resting = int(np.clip(np.ceil(sticking), moving, max(most, moving)))
        slip *= max(sticking / resting, 1.0)
        # a long step from beyond would have stages on the other side of rest
        return Scheme(slip, _NEAR_REST * slip + 2.0 * coulomb * step, moving, resting)

    def rounded(self, factor: float, most: int) -> GrayBox:
        """The same with dry friction rounded off over a speed ``factor`` times as wide.

        That speed grows until ``most`` Runge-Kutta steps per sample do near rest.
        """
        other = copy(self)
        other.scheme = self._scheme(factor * self.scheme.slip, most)
        return other

    def sharp(self) -> GrayBox:
        """The same with dry friction hardly rounded off at all."""
        return self.rounded(_SHARP, most=int(_MOST_SUBSTEPS / _SHARP))

    def _inputs(self, log: GrayLog) -> FloatArray:
        """Command and step of every sample, the last segment filled up, ``(2, m)``."""
        missing = -log.command.size % self.segment
        return np.pad((log.command, log.step), ((0, 0), (0, missing)), mode="edge")

    def integrate(
        self, log: GrayLog, nodes: FloatArray, values: Values, free: Sequence[str]
    ) -> tuple[FloatArray, FloatArray]:
        """States ``(segments, segment, 4)`` after every sample, from nodes ``(segments, 4)``.

        Beside them their derivatives by the node's state and the free parameters,
        ``(segments, segment, 4, 4 + free)``. ``values`` holds all parameters.
        """
        count, length, columns = nodes.shape[0], self.segment, 4 + len(free)
        function = _segment_function(self.machine, length, self.scheme, tuple(free)).map(count)
        seed = np.repeat(np.eye(columns, 4).reshape(-1, 1), count, axis=1)
        theta = np.tile(_theta(values), (1, count * length))
        out = np.asarray(function(np.vstack((nodes.T, seed)), self._inputs(log), theta))
        out = out.T.reshape(count, length, 1 + columns, 4)
        return out[:, :, 0], np.swapaxes(out[:, :, 1:], 2, 3)

    def simulate(self, log: GrayLog, initial: FloatArray, values: Values) -> FloatArray:
        """States at every sample, ``(n, 4)``, from the initial one [Pa, Pa, m, m/s]."""
        function = _segment_function(self.machine, self.segment, self.scheme, None)
        theta = np.tile(_theta(values), (1, self.segment))
        inputs = self._inputs(log)
        states = np.empty((inputs.shape[1] + 1, 4))
        states[0] = initial
        for first in range(0, inputs.shape[1], self.segment):
            after = first + self.segment
            found = function(states[first], inputs[:, first:after], theta)
            states[first + 1 : after + 1] = np.asarray(found).T
        return states[: log.samples]

    def per_sample(
        self, log: GrayLog, states: FloatArray, values: Values
    ) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the state after every sample of a simulation, ``(n, 4)``.

        By the state before the sample, ``(n - 1, 4, 4)``, and by the command over it,
        ``(n - 1, 4)``.
        """
        single = copy(self)
        single.segment = 1
        slopes = single.integrate(log, states[:-1], values, EDGES)[1][:, 0]
        # a command further up is both edges of the dead zone further down
        return slopes[:, :, :4], -slopes[:, :, 4:].sum(axis=2)

    def nodes_of(self, states: FloatArray) -> FloatArray:
        """States at the beginning of every segment, ``(segments, 4)``."""
        return states[: -1 : self.segment].copy()

    def linearise(
        self, log: GrayLog, nodes: FloatArray, values: Values, free: Sequence[str]
    ) -> Linear:
        """Condense one log: states as an affine function of initial state and parameters."""
        states, slopes = self.integrate(log, nodes, values, free)
        (count, length), q = states.shape[:2], 4 + len(free)
        slope, chain = np.empty((count * length + 1, 4, q + 1)), np.empty((count, 4, q + 1))
        defects = np.zeros((count, 4))
        defects[:-1] = states[:-1, -1] - nodes[1:]
        now = np.eye(4, q + 1)  # by initial state and parameters, and the gaps in the last column
        slope[0] = now
        for k in range(count):
            chain[k] = now
            rows = slope[k * length + 1 : (k + 1) * length + 1]
            rows[:] = slopes[k, :, :, :4] @ now
            rows[:, :, 4:q] += slopes[k, :, :, 4:]
            now = rows[-1].copy()
            now[:, q] += defects[k]
        value = np.vstack((nodes[:1], states.reshape(-1, 4)))
        return Linear(value[: log.samples], slope[: log.samples], chain, defects)


def _theta(values: Values) -> FloatArray:
    return np.array([[values[n]] for n in GRAY_NAMES])
