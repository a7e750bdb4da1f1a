"""Stick-slip of one inertia, solved with events.

    J v' = tau(t) - b v - F_k(sign v)        while moving,
    v = 0  while  -F_s- <= tau <= F_s+       while stuck.

Friction that falls from the one level to the other is in :mod:`.curved`. ``tau`` is a piecewise
polynomial, so between two events the motion is linear and known in closed form. Break-away
(``tau`` reaches the static level) and stop (``v`` reaches zero) are solved inside the sampling
interval: position is then a smooth function of all six parameters, with no time grid and no
``tanh`` in it. With the Karnopp band [1]_ shrunk to zero width this is the model's exact solution.

All six parameters may be complex; the imaginary parts carry exact derivatives through
the events (implicit function theorem, one complex Newton step per event).

References
----------
.. [1] D. Karnopp, "Computer simulation of stick-slip friction in mechanical dynamic
   systems", J. Dyn. Sys. Meas. Control 107(1), 1985.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import exp, factorial

import numpy as np

from ...estimation.inputs import PiecewiseInput
from ...estimation.linear import Grid, states_at_nodes
from .curved import simulate_curved
from .motion import Array, Motion, StickSlip
from .rest import StaticBand, rising_root, slope_of, value_of

_INVERSE = [1.0 / factorial(n) for n in range(32)]
_LIMIT = 8  # events inside one sampling interval before the motion counts as stuck


def _phi(z: Array, count: int) -> list[Array]:
    """``phi_n(z) = sum_k z**k / (k + n)!`` for ``n = 1..count``, any size of ``z``."""
    size = np.abs(z)
    small = size < 0.7
    every = bool(small.all())
    near = z if every else np.where(small, z, 0.0)
    # of terms that matter: between two samples z is seldom more than a few hundredths
    last = 6 if every and size.max(initial=0.0) < 0.02 else 13
    total = near * _INVERSE[count + last + 1] + _INVERSE[count + last]
    for k in range(last - 1, -1, -1):
        total *= near
        total += _INVERSE[count + k]
    values = [total]
    for n in range(count - 1, 0, -1):
        values.append(values[-1] * near + _INVERSE[n])
    values.reverse()
    if every:
        return values
    far = np.where(small, 1.0, z)
    previous = np.exp(far)
    out = []
    for n in range(1, count + 1):
        previous = (previous - _INVERSE[n - 1]) / far
        out.append(np.where(small, values[n - 1], previous))
    return out


def phi_real(z: float, count: int) -> list[float]:
    """``phi_1 .. phi_count`` of one real number; the hot path of every event."""
    if abs(z) < 0.7:
        total = 0.0
        for k in range(14, -1, -1):
            total = total * z + _INVERSE[count + k]
        values = [total]
        for n in range(count - 1, 0, -1):
            values.append(values[-1] * z + _INVERSE[n])
        values.reverse()
        return values
    values, previous = [], exp(z)
    for n in range(1, count + 1):
        previous = (previous - _INVERSE[n - 1]) / z
        values.append(previous)
    return values


def _first(values: Array) -> float:
    """Real part of row 0."""
    return float(np.real(values[0]))


class _Direction:
    """Motion in one direction: response of the moving mass to ``tau - s F``.

    ``speed`` and ``place`` are the velocity and position at the nodes of a motion that
    never stops, from zero; every slip phase is this motion minus its own past.
    """

    def __init__(
        self, sign: int, inertia: Array, viscous: Array, level: Array, torque: Array,
        unstopped: Callable[[complex, complex], tuple[Array, Array]],
    ) -> None:  # fmt: skip
        self.sign, self.level, self.torque = sign, level, torque
        self.inertia, self.viscous, self.rate = inertia, viscous, viscous / inertia
        self.first = _first(inertia), _first(self.rate), sign * _first(level)
        motions = [unstopped(j, b) for j, b in zip(inertia, viscous)]
        self.place, self.speed = (
            np.array([m[:, i] - sign * f * one[:, i] for (m, one), f in zip(motions, level)])
            for i in (0, 1)
        )

    def inside(self, node: int, offset: Array) -> tuple[Array, Array]:
        """Speed and place of the unstopped motion between nodes; offset of shape ``(k,)``."""
        torque = self.torque[node]
        phi = _phi(-self.rate * offset, torque.size + 1)
        decay = 1.0 - self.rate * offset * phi[0]
        v = self.speed[:, node] * decay
        p = self.place[:, node] + self.speed[:, node] * offset * phi[0]
        for i, c in enumerate(torque):
            push = (c - self.sign * self.level) if i == 0 else c
            power = factorial(i) * push * offset ** (i + 1) / self.inertia
            v = v + power * phi[i]
            p = p + power * offset * phi[i + 1]
        return v, p

    def speed_inside(self, node: int, offset: float, speed: float) -> float:
        """Speed of row 0 at an offset after a node at which it is ``speed``; plain floats."""
        inertia, rate, level = self.first
        torque = self.torque[node].tolist()
        torque[0] -= level
        z = -rate * offset
        phi = phi_real(z, len(torque))
        total = speed * exp(z)
        power = offset / inertia
        for i, c in enumerate(torque):
            total += c * power * phi[i]
            power *= offset * (i + 1)
        return total


def _unstopped(
    inertia: complex, viscous: complex, u: PiecewiseInput, grid: Grid
) -> tuple[Array, Array]:
    """Position and velocity at the nodes under ``u`` and under a constant one: ``(m, 2)``."""
    a = np.array([[0.0, 1.0], [0.0, -viscous / inertia]])
    b = np.array([0.0, 1.0 / inertia])
    one = PiecewiseInput(u.nodes, np.ones((u.nodes.size, 1)))
    return states_at_nodes(a, b, u, grid), states_at_nodes(a, b, one, grid)


class _Run:
    """One pass through the events of a log."""

    def __init__(self, p: StickSlip, u: PiecewiseInput, grid: Grid, speed: Array) -> None:
        self.time, self.torque = grid.instants, u.coefficients
        kind = np.result_type(p.inertia, p.viscous, p.coulomb_positive, p.breakaway_positive, float)
        self.k = p.inertia.size
        negative = p.viscous if p.viscous_negative is None else p.viscous_negative
        inertia, ways = p.inertia.astype(kind), (p.viscous.astype(kind), negative.astype(kind))
        unstopped = cache(lambda inertia, viscous: _unstopped(inertia, viscous, u, grid))
        self.forward = _Direction(1, inertia, ways[0], p.coulomb_positive, self.torque, unstopped)
        self.backward = _Direction(-1, inertia, ways[1], p.coulomb_negative, self.torque, unstopped)
        self.static = (p.breakaway_positive, p.breakaway_negative)
        self.band = StaticBand(u, _first(p.breakaway_positive), _first(p.breakaway_negative))
        self.position = np.empty((self.k, self.time.size), dtype=kind)
        self.velocity = np.zeros((self.k, self.time.size), dtype=kind)
        self.here = np.zeros(self.k, dtype=kind)
        self.start_speed = np.broadcast_to(speed, (self.k,)).astype(kind)
        self.breakaways = [0, 0]
        self.stops = 0

    def run(self) -> None:
        """Follow the motion from event to event until the log ends."""
        node, offset = 0, np.zeros(self.k)
        self.position[:, 0] = self.here
        speed = self.start_speed
        sign = int(np.sign(np.real(speed[0])))
        in_interval, last_node = 0, -1
        end = self.time.size - 1
        while node < end:
            if sign == 0:
                found = self.band.leave(node, _first(offset))
                if found is None:
                    self.position[:, node + 1 :] = self.here[:, None]
                    return
                until, begin, sign = found
                met = begin > (_first(offset) if until == node else 0.0)
                offset = self._moment(until, begin, sign) if met else np.full(self.k, begin)
                self.position[:, node + 1 : until + 1] = self.here[:, None]
                node = until
                self.breakaways[0 if sign > 0 else 1] += 1
                speed = np.zeros(self.k)
            in_interval = in_interval + 1 if node == last_node else 0
            last_node = node
            if in_interval > _LIMIT:  # rattling faster than the log can show
                self.position[:, node + 1] = self.here
                node, offset, sign = node + 1, np.zeros(self.k), 0
                continue
            node, offset, sign = self._slip(node, offset, sign, speed)
            speed = np.zeros(self.k)
            if node >= end:
                return

    def _moment(self, node: int, offset: float, sign: int) -> Array:
        """Offset of a break-away with its derivatives, where the torque comes to its level."""
        c = self.torque[node]
        level = self.static[0] if sign > 0 else self.static[1]
        late = sign * np.imag(level) / slope_of(c, offset)
        return offset + 1j * late if np.iscomplexobj(self.here) else np.full(self.k, offset)

    def _slip(self, node: int, offset: Array, sign: int, speed: Array) -> tuple[int, Array, int]:
        """Slip from an event to the next stop; returns where it stops and what follows."""
        way = self.forward if sign > 0 else self.backward
        v0, p0 = way.inside(node, offset)
        lag = v0 - speed  # what the unstopped motion has more than this one
        began = self.time[node] + offset
        stop = self._find_stop(way, node, lag, began)
        last = self.time.size - 1 if stop is None else stop
        if last > node:
            nodes = slice(node + 1, last + 1)
            since = self.time[nodes] - began[:, None]
            z = way.rate[:, None] * since
            less = -np.expm1(-z)
            travel = (
                np.where(np.abs(z) > 1e-12, less / np.where(z == 0, 1.0, z), 1.0 - 0.5 * z) * since
            )
            self.velocity[:, nodes] = way.speed[:, nodes] - lag[:, None] * (1.0 - less)
            self.position[:, nodes] = (
                (self.here - p0)[:, None] + way.place[:, nodes] - lag[:, None] * travel
            )
        if stop is None:
            return last, np.zeros(self.k), sign
        return self._stop(way, stop, node, offset, lag, p0)

    def _find_stop(self, way: _Direction, node: int, lag: Array, began: Array) -> int | None:
        """Interval in which the speed returns to zero; ``None`` when the log ends first."""
        rate, less, start = _first(way.rate), _first(lag), _first(began)
        first, width, end = node + 1, 32, self.time.size
        while first < end:
            part = slice(first, min(first + width, end))
            v = np.real(way.speed[0, part]) - less * np.exp(-rate * (self.time[part] - start))
            back = np.flatnonzero(v * way.sign <= 0.0)
            if back.size:
                return first + int(back[0]) - 1
            first, width = first + width, width * 2
        return None

    def _stop(
        self, way: _Direction, j: int, node: int, offset: Array, lag: Array, p0: Array
    ) -> tuple[int, Array, int]:
        """Solve the instant of the stop inside interval ``j`` and decide what follows."""
        begin = _first(offset) if j == node else 0.0
        step = self.time[j + 1] - self.time[j]
        rate, less = _first(way.rate), _first(lag)
        # actual speed at the node: the unstopped motion less what this phase never had
        since = self.time[j] - self.time[node] - _first(offset)
        base = float(np.real(way.speed[0, j])) - less * exp(-rate * since)

        def backwards(o: float) -> float:
            return -way.sign * way.speed_inside(j, o, base)

        low = _moving_start(backwards, begin, step) if j == node else begin
        root = begin if low is None else rising_root(backwards, low, step)
        v, p = way.inside(j, np.full(self.k, root))
        since = self.time[j] + root - self.time[node] - offset
        v = v - lag * np.exp(-way.rate * since)
        inertia, _, level = way.first
        torque = value_of(self.torque[j], root)
        slope = (torque - level) / inertia
        moment: Array = np.full(self.k, root)
        if np.iscomplexobj(v) and slope * way.sign < 0.0:
            moment = root - 1j * np.imag(v) / slope
            _, p = way.inside(j, moment)
        since = self.time[j] + moment - self.time[node] - offset
        travel = since * _phi(-way.rate * since, 1)[0]
        self.here = self.here + p - p0 - lag * travel
        self.stops += 1
        # no rest where the torque already exceeds the static level at the turning point
        return j, moment, self.band.way(torque)


def _moving_start(backwards: Callable[[float], float], begin: float, end: float) -> float | None:
    """A point shortly after a break-away at which the motion really moves."""
    width = end - begin
    for _ in range(40):
        width *= 0.5
        if width <= 1e-12 * max(end, 1e-12):
            return None
        if backwards(begin + width) < 0.0:
            return begin + width
    return None


def simulate_stick_slip(
    parameters: StickSlip,
    torque: PiecewiseInput,
    grid: Grid,
    initial_speed: Array | float = 0.0,
) -> Motion:
    """Simulate stick-slip at the nodes of the torque, from position zero.

    Parameters
    ----------
    parameters
        Each as a row of ``k`` (complex) values.
    torque, grid
        Of any degree, and its nodes.
    initial_speed
        At the first node.
    """
    curve = parameters.stribeck_speed
    if curve is not None and _first(curve) > 0.0:
        return simulate_curved(parameters, torque, np.asarray(initial_speed))
    run = _Run(parameters, torque, grid, np.asarray(initial_speed))
    run.run()
    return Motion(run.position, run.velocity, (run.breakaways[0], run.breakaways[1]), run.stops)
