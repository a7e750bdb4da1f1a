"""Stick-slip of one inertia, solved with events.

    J v' = tau(t) - b v - F_k(sign v)        while moving,
    v = 0  while  -F_s- <= tau <= F_s+       while stuck.

Friction that falls from the one level to the other is in :mod:`.curved`. ``tau`` is a piecewise
polynomial, so between two events the motion is linear and known in closed form. Break-away
(``tau`` reaches the static level) and stop (``v`` reaches zero) are solved inside the sampling
interval: position is then a smooth function of all six parameters, with no time grid and no
``tanh`` in it. With the Karnopp band [1]_ shrunk to zero width this is the model's exact solution.

All parameters may be complex; the imaginary parts carry exact derivatives through the events
(:mod:`.changes`), which take one pass over whole arrays after the events are known.

References
----------
.. [1] D. Karnopp, "Computer simulation of stick-slip friction in mechanical dynamic
   systems", J. Dyn. Sys. Meas. Control 107(1), 1985.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import comb, exp
from typing import Self

import numpy as np
import numpy.typing as npt

from ..estimation.grid import Grid, make_grid
from ..estimation.inputs import PiecewiseInput, piecewise
from ..estimation.recursion import run_recursion
from ..experiment import Array, FloatArray, Signal
from .changes import Steps, Varied, with_changes
from .curved import CurvedRun, motion_of
from .motion import DryMass, Motion, StickSlip
from .phi import Responses, phi_real
from .rest import StaticBand, rising_zero, slope_of, value_of

_LIMIT = 8  # events inside one sampling interval before the motion counts as stuck
_GRAZING = 1e-6  # of a static level, over which a break-away at a peak is differentiated
_TINY = 1e-30  # imaginary part, in parts of a parameter


class _Direction:
    """Motion in one direction: response of the moving mass to ``tau - s F``.

    ``speed`` and ``place`` are the velocity and position at the nodes of a motion that
    never stops, from zero; every slip phase is this motion minus its own past.
    """

    def __init__(self, sign: int, mass: DryMass, u: PiecewiseInput, grid: Grid) -> None:
        k = 0 if sign > 0 else 1
        self.sign, self.torque, self.inertia = sign, u.coefficients, mass.inertia
        self.viscous, self.level = mass.viscous[k], sign * mass.kinetic[k]
        self.rate = self.viscous / self.inertia
        net = self.torque[:-1].T.copy()
        net[0] -= self.level
        r = Responses.of(self.inertia, self.viscous, grid.distinct, net.shape[0])
        speed, place = ((part[:, grid.which] * net).sum(axis=0) for part in (r.speed, r.place))
        driven = np.concatenate(([0.0], speed))
        decay = np.append(r.decay[grid.which], 0.0)
        self.speed = run_recursion(driven[:, None], decay[None])[:, 0]
        steps = place + self.speed[:-1] * r.travel[grid.which]
        self.place = np.concatenate(([0.0], np.cumsum(steps)))

    def inside(self, node: int, offset: float, speed: float) -> tuple[float, float]:
        """Speed, and way made, at an offset after a node at which the speed is known."""
        torque = self.torque[node].tolist()
        torque[0] -= self.level
        z = -self.rate * offset
        phi = phi_real(z, len(torque) + 1)
        v, p = speed * exp(z), speed * offset * phi[0]
        power = offset / self.inertia
        for i, c in enumerate(torque):
            v += c * power * phi[i]
            p += c * power * offset * phi[i + 1]
            power *= offset * (i + 1)
        return v, p


@dataclass(frozen=True)
class _Phase:
    """Motion from an event to a stop, or to the end of the log.

    ``late`` is how much later the phase begins per static level of its direction; ``hands_on``
    what of the derivative of its last speed the next phase begins with.
    """

    node: int
    offset: float
    sign: int
    speed: float
    last: int  # interval in which it ends
    end: float  # offset of the stop in it; infinite where the log ends first
    late: float = 0.0
    hands_on: float = 0.0


class _Run:
    """One pass through the events of a log."""

    def __init__(self, mass: DryMass, u: PiecewiseInput, grid: Grid, speed: float) -> None:
        self.mass, self.time, self.torque = mass, grid.instants, u.coefficients
        self.ways = {sign: _Direction(sign, mass, u, grid) for sign in (1, -1)}
        self.band = StaticBand(u, *mass.static)
        self.position = np.empty(self.time.size)
        self.velocity = np.zeros(self.time.size)
        self.here = 0.0
        self.phases: list[_Phase] = []
        self.breakaways, self.stops = [0, 0], 0
        self._run(speed)
        del self.band  # the pass is kept
        self.velocity.flags.writeable = False

    def _run(self, speed: float) -> None:
        """Follow the motion from event to event until the log ends."""
        node, offset, sign, late = 0, 0.0, int(np.sign(speed)), 0.0
        self.position[0], self.velocity[0] = 0.0, speed
        in_interval, last_node = 0, -1
        end = self.time.size - 1
        while node < end:
            if sign == 0:
                found = self.band.leave(node, offset)
                if found is None:
                    self.position[node + 1 :] = self.here
                    return
                until, begin, sign = found
                # where the torque comes to its level, and not where it jumps past it
                met = begin > (offset if until == node else 0.0)
                late = self._lateness(until, begin, sign) if met else 0.0
                self.position[node + 1 : until + 1] = self.here
                node, offset = until, begin
                self.breakaways[0 if sign > 0 else 1] += 1
            in_interval = in_interval + 1 if node == last_node else 0
            last_node = node
            if in_interval > _LIMIT:  # rattling faster than the log can show
                self.position[node + 1] = self.here
                node, offset, sign = node + 1, 0.0, 0
                continue
            node, offset, sign = self._slip(node, offset, sign, speed, late)
            speed = late = 0.0

    def _lateness(self, node: int, offset: float, way: int) -> float:
        """Delay at which the torque reaches its level, per level.

        Near a peak of the torque that is the mean over a small part of the level: at the peak
        itself it would be infinite.
        """
        torque = self.torque[node]
        bend = slope_of(torque[1:] * np.arange(1, torque.size), offset)
        least = 2.0 * abs(bend) * _GRAZING * self.mass.static[0 if way > 0 else 1]
        return 1.0 / float(max(abs(slope_of(torque, offset)), np.sqrt(least), 1e-300))

    def _slip(
        self, node: int, offset: float, sign: int, speed: float, late: float
    ) -> tuple[int, float, int]:
        """Slip from an event to the next stop; returns where it stops and what follows."""
        way = self.ways[sign]
        v0, p0 = way.inside(node, offset, float(way.speed[node]))
        p0 += float(way.place[node])
        lag = v0 - speed  # what the unstopped motion has more than this one
        began = float(self.time[node]) + offset
        stop = self._find_stop(way, node, lag, began)
        last = self.time.size - 1 if stop is None else stop
        self._fill(way, slice(node + 1, last + 1), self.here - p0, lag, began)
        if stop is None:
            self.phases.append(_Phase(node, offset, sign, speed, last - 1, np.inf, late))
            return last, 0.0, sign
        # speed and place of the phase at the node of the stop, drawn back where that is before it
        since = float(self.time[stop]) - began
        base = float(way.speed[stop]) - lag * exp(-way.rate * since)
        travel = since * phi_real(-way.rate * since, 1)[0]
        there = self.here - p0 + float(way.place[stop]) - lag * travel
        root = self._stop(way, stop, offset if stop == node else None, base)
        self.here = there + way.inside(stop, root, base)[1]
        self.stops += 1
        torque = value_of(self.torque[stop], root)
        # no rest where the torque already exceeds the static level at the turning point
        following = self.band.way(torque)
        hands_on = 0.0
        if following and torque != way.level:
            hands_on = (torque - self.ways[following].level) / (torque - way.level)
        phase = _Phase(node, offset, sign, speed, stop, root, late, hands_on)
        self.phases.append(phase)
        return stop, root, following

    def _fill(self, way: _Direction, nodes: slice, place: float, lag: float, began: float) -> None:
        """Speed and place at the nodes of a phase: the unstopped motion less its own past."""
        since = self.time[nodes] - began
        less = -np.expm1(-way.rate * since)
        travel = less / way.rate if way.rate * since.max(initial=0.0) > 1e-12 else since
        self.velocity[nodes] = way.speed[nodes] - lag * (1.0 - less)
        self.position[nodes] = place + way.place[nodes] - lag * travel

    def _find_stop(self, way: _Direction, node: int, lag: float, began: float) -> int | None:
        """Interval in which the speed returns to zero; ``None`` when the log ends first."""
        first, width, end = node + 1, 32, self.time.size
        while first < end:
            part = slice(first, min(first + width, end))
            v = way.speed[part] - lag * np.exp(-way.rate * (self.time[part] - began))
            back = v * way.sign <= 0.0
            k = int(back.argmax())
            if back[k]:
                return first + k - 1
            first, width = first + width, width * 2
        return None

    def _stop(self, way: _Direction, j: int, begin: float | None, base: float) -> float:
        """Offset of the stop inside interval ``j``, in which the phase begins unless ``None``."""
        step = float(self.time[j + 1] - self.time[j])

        def backwards(offset: float) -> float:
            return -way.sign * way.inside(j, offset, base)[0]

        if begin is None:
            return rising_zero(backwards, 0.0, step)
        low = _moving_start(backwards, begin, step)
        return begin if low is None else rising_zero(backwards, low, step)

    def steps(self) -> Steps:
        """All phases, cut at the nodes."""
        counts = [p.last - p.node + 1 for p in self.phases]
        first = np.concatenate(([0], np.cumsum(counts)[:-1])).astype(int)
        final = np.cumsum(counts).astype(int) - 1
        node = np.concatenate([np.arange(p.node, p.last + 1) for p in self.phases])
        offset, end = np.zeros(node.size), np.diff(self.time)[node]
        offset[first] = [p.offset for p in self.phases]
        end[final] = np.minimum(end[final], [p.end for p in self.phases])
        speed = self.velocity[node]
        speed[first] = [p.speed for p in self.phases]
        carry = np.ones(node.size)
        carry[final] = [p.hands_on for p in self.phases]
        lead = np.zeros(node.size)
        lead[first] = [-p.late * self._acceleration(p) if p.late else 0.0 for p in self.phases]
        return Steps(
            node, np.repeat([p.sign for p in self.phases], counts), offset, end - offset, speed,
            carry, lead,
        )  # fmt: skip

    def _acceleration(self, phase: _Phase) -> float:
        """At the begin of a phase [per second squared]."""
        torque = value_of(self.torque[phase.node], phase.offset)
        return (torque - self.ways[phase.sign].level) / self.mass.inertia


def _vary(run: _Run, steps: Steps) -> Varied:
    """Derivatives of all steps of a motion by inertia, viscous friction and kinetic level."""
    speed, way = np.empty(steps.node.size), np.empty(steps.node.size)
    speed_by, way_by = np.empty((3, speed.size)), np.empty((3, speed.size))
    for sign, side in run.ways.items():
        own = np.flatnonzero(steps.way == sign)
        net = _shifted(run.torque[steps.node[own]], steps.offset[own])
        net[0] -= side.level
        # whole intervals have few lengths, as long as those that events cut have no more
        spans, which = np.unique(steps.span[own], return_inverse=True)
        j, b, v0 = side.inertia, side.viscous, steps.speed[own]
        now = Responses.of(j, b, spans, net.shape[0])
        speed[own], way[own] = now.decay[which], now.travel[which]
        tiny = _TINY * j, _TINY * max(b, 1e-12 * j / spans.max(initial=1e-300))
        for row, (dj, db) in enumerate(((tiny[0], 0.0), (0.0, tiny[1]))):
            r = Responses.of(j + 1j * dj, b + 1j * db, spans, net.shape[0])
            for out, by_speed, by_net in (
                (speed_by, r.decay, r.speed), (way_by, r.travel, r.place)
            ):  # fmt: skip
                size = dj + db
                change = (np.imag(by_net)[:, which] * net).sum(axis=0)
                out[row, own] = (np.imag(by_speed)[which] * v0 + change) / size
        speed_by[2, own], way_by[2, own] = -sign * now.speed[0, which], -sign * now.place[0, which]
    return Varied(speed, speed_by, way, way_by)


def _shifted(coefficients: FloatArray, offset: FloatArray) -> FloatArray:
    """Coefficients ``(d, n)`` of polynomials ``(n, d)`` that begin at offsets ``(n,)`` [s]."""
    out = coefficients.T.copy()
    moved = np.flatnonzero(offset)
    for i in range(out.shape[0]):
        for k in range(i + 1, out.shape[0]):
            out[i, moved] += comb(k, i) * coefficients[moved, k] * offset[moved] ** (k - i)
    return out


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


class Passes:
    """Passes through the events of a torque, the last of which is kept.

    Derivatives are asked for where a search has just been, and have the same events.

    Parameters
    ----------
    torque, grid
        Of any degree (a curve: three at most), and its nodes.
    """

    def __init__(self, torque: PiecewiseInput, grid: Grid) -> None:
        self.torque, self.grid = torque, grid
        self._last: tuple[DryMass, float, _Run | CurvedRun] | None = None

    @classmethod
    def on_samples(cls, signal: Signal, time: FloatArray) -> tuple[Self, npt.NDArray[np.intp]]:
        """Split an input at instants ``(n,)``, each a node; return also which nodes they are."""
        u = piecewise(signal)
        nodes = np.union1d(u.nodes[(u.nodes > time[0]) & (u.nodes < time[-1])], time)
        piece = np.searchsorted(u.nodes, nodes, side="right") - 1
        coefficients = u.coefficients[np.maximum(piece, 0)]
        coefficients[piece < 0] = 0.0
        coefficients[piece < 0, 0] = signal.before
        found = cls(PiecewiseInput(nodes, coefficients), make_grid(nodes))
        return found, np.searchsorted(nodes, time)

    def pass_of(self, mass: DryMass, speed: float) -> _Run | CurvedRun:
        """The pass of a drive with some first speed; ``LinAlgError`` where it breaks down."""
        if self._last is None or self._last[:2] != (mass, speed):
            self._last = None  # free it before the next is made
            follow = CurvedRun if mass.speed > 0.0 else _Run
            try:
                run = follow(mass, self.torque, self.grid, speed)
            except ArithmeticError as error:  # it comes to rest within a tiny part of an interval
                raise np.linalg.LinAlgError(f"no motion can be followed: {error}") from error
            self._last = mass, speed, run
        return self._last[2]


def simulate_stick_slip(
    parameters: StickSlip, passes: Passes, initial_speed: Array | float = 0.0
) -> Motion:
    """Simulate stick-slip at the nodes of a torque, from position zero.

    Parameters
    ----------
    parameters
        With ``k`` columns.
    passes
        Of the torque.
    initial_speed
        At the first node.
    """
    start = np.asarray(initial_speed)
    run = passes.pass_of(parameters.mass, float(np.real(start.flat[0])))
    if isinstance(run, CurvedRun):
        return motion_of(run, parameters, start)
    motion = Motion(
        np.tile(run.position, (parameters.rows.shape[1], 1)),
        run.velocity,
        (run.breakaways[0], run.breakaways[1]), run.stops,
    )  # fmt: skip
    if not (np.iscomplexobj(parameters.rows) or np.iscomplexobj(start)):
        return motion
    if not run.phases:
        return with_changes(motion, None, None, parameters, start)
    steps = run.steps()
    return with_changes(motion, steps, _vary(run, steps), parameters, start)
