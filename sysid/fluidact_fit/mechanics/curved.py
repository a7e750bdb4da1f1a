"""Stick-slip of one inertia whose friction falls from the static to the kinetic level.

    J v' = tau(t) - b v - s F(|v|),   F(v) = F_k + (F_s - F_k) exp(-(v / v_s)^2)     moving,
    v = 0  while  -F_s- <= tau <= F_s+                                                stuck,

with levels of the direction ``s``: the Stribeck curve [1]_ joins its static and its kinetic level.
For ``v_s -> 0`` this is the model of :mod:`.stick_slip`.

Between two nodes of the torque the speed is followed by steps of Dormand and Prince's pair
(``estimation.runge_kutta``), divided where its error would exceed ``1e-7 (v_s + |v|)``: they are
long in fast motion and short where friction falls. Beyond six speeds of the curve nothing is left
of it, and the motion is that of a mass with viscous friction. Break-away and stop are solved inside
the step, nothing is smoothed. The derivatives are those of the steps themselves, in whole arrays
(variational equation): exact, at a small part of the price of the motion.

At a break-away under a torque that rises steadily the acceleration is zero, and under one that
jumps the instant is a node: it does not matter to the motion by how much the instant moves. At a
stop the speed is zero, so the place does not depend on it either; only a turning point without
rest hands its instant on.

References
----------
.. [1] B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, "A survey of models, analysis tools
   and compensation methods for the control of machines with friction", Automatica 30, 1994,
   equation 8 with the exponent of Bo and Pavelescu, 2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import exp, inf

import numpy as np

from ..estimation.grid import Grid
from ..estimation.inputs import PiecewiseInput
from ..estimation.runge_kutta import ERROR, NODES, RESULT, STAGES
from ..experiment import Array, FloatArray
from .changes import Steps, Varied, with_changes
from .motion import DryMass, Motion, StickSlip
from .phi import Responses
from .rest import StaticBand, rising_zero, value_of

((_A21,), (_A31, _A32), (_A41, _A42, _A43), (_A51, _A52, _A53, _A54),
 (_A61, _A62, _A63, _A64, _A65)) = STAGES[1:]  # fmt: skip
_B1, _, _B3, _B4, _B5, _B6 = RESULT
_E1, _, _E3, _E4, _E5, _E6, _E7 = ERROR

Push = Callable[[float, float], Sequence[float]]
_TOLERANCE = 1e-7  # error of a step, in speeds of the curve and of the motion
_SHORTEST = 1e-9  # part of an interval, below which a motion does not count as one
_REFUSED = 0.9  # times its length that a step should have, below which it is taken again
_SLOW, _NEARER = 2.0, 0.7  # speeds of the curve from which a motion stops, part of the way there
_BEYOND = 6.0  # speeds of the curve above which nothing is left of it: exp(-36) is rounding
_LIMIT = 8  # events inside one sampling interval before the motion counts as stuck


@dataclass(frozen=True)
class Slide:
    """Motion in one direction, speeds taken positive: ``y' = push - rate y - fall exp(-w y^2)``.

    ``rate`` [1/s], ``level`` (kinetic) and ``fall`` (static less kinetic) per inertia
    [per second squared], ``speed`` of the curve, ``w = 1 / speed^2``; ``push`` is the torque less
    the kinetic level, per inertia.
    """

    rate: float
    level: float
    fall: float
    speed: float
    inertia: float

    @cached_property
    def _curve(self) -> float:
        return 1.0 / (self.speed * self.speed)

    def advance(
        self, y: float, h: float, push: Sequence[float]
    ) -> tuple[float, float, float, float]:
        """Speed, way made good, error and acceleration after a step [s], pushes at its nodes."""
        b, r, w = self.rate, self.fall, self._curve
        p1, p2, p3, p4, p5, p6 = push
        k1 = p1 - b * y - r * exp(-w * y * y)
        x = y + h * (_A21 * k1)
        k2 = p2 - b * x - r * exp(-w * x * x)
        x3 = y + h * (_A31 * k1 + _A32 * k2)
        k3 = p3 - b * x3 - r * exp(-w * x3 * x3)
        x4 = y + h * (_A41 * k1 + _A42 * k2 + _A43 * k3)
        k4 = p4 - b * x4 - r * exp(-w * x4 * x4)
        x5 = y + h * (_A51 * k1 + _A52 * k2 + _A53 * k3 + _A54 * k4)
        k5 = p5 - b * x5 - r * exp(-w * x5 * x5)
        x6 = y + h * (_A61 * k1 + _A62 * k2 + _A63 * k3 + _A64 * k4 + _A65 * k5)
        k6 = p6 - b * x6 - r * exp(-w * x6 * x6)
        x = y + h * (_B1 * k1 + _B3 * k3 + _B4 * k4 + _B5 * k5 + _B6 * k6)
        k7 = p6 - b * x - r * exp(-w * x * x)
        way = h * (_B1 * y + _B3 * x3 + _B4 * x4 + _B5 * x5 + _B6 * x6)
        error = h * (_E1 * k1 + _E3 * k3 + _E4 * k4 + _E5 * k5 + _E6 * k6 + _E7 * k7)
        return x, way, abs(error), k7

    def held(self, torque: float) -> Push:
        """Pushes of a constant torque, positive along the motion [N m or N]."""
        push = [torque / self.inertia - self.level] * NODES.size
        return lambda at, h: push

    def allowed(self, y: float) -> float:
        """Error that a step may have."""
        return _TOLERANCE * (self.speed + abs(y))

    def divide(self, y: float, begin: float, end: float, push: Push, span: float) -> list[Step]:
        """Follow a motion inside an interval, in steps as short as the error asks for.

        Parameters
        ----------
        y
            Speed at the begin.
        begin, end
            Offsets in the interval [s]. The steps cease before the end where the motion does.
        push
            Pushes at the six nodes of a step from an offset over a span.
        span
            Of the first step that is tried [s].
        """
        steps: list[Step] = []
        at, h, least = begin, span, _SHORTEST * end
        while end - at > least:
            h = min(h, end - at)
            x, way, error, slope = self.advance(y, h, push(at, h))
            better = self._better(x, error)
            if better < _REFUSED and h > least:
                h *= max(better, 0.2)
            elif x > 0.0:
                steps.append(Step(at, h, y, way, x, slope))
                at, y = at + h, x
                h *= max(better, 0.2)
            elif y > _SLOW * self.speed and h > least:
                h *= _NEARER * y / (y - x)  # it leapt over the curve, through which it stops
            elif y > 0.0:
                last, better = self._last(y, at, h, push)
                if better >= _REFUSED or h <= least:
                    return [*steps, last]
                h = last.span * max(better, 0.2)
            elif h > least:
                h *= 0.5  # where it has hardly begun, it may already be over
            else:
                break
        return steps

    def _better(self, x: float, error: float) -> float:
        """Factor by which a step that led to a speed should be longer, with its error."""
        allowed = self.allowed(x)
        return _REFUSED * (allowed / max(error, 1e-5 * allowed)) ** 0.2

    def _last(self, y: float, at: float, h: float, push: Push) -> tuple[Step, float]:
        """The step that ends at rest, and how many times longer it should be."""
        # its last acceleration is no slope of what steps of several lengths lead to
        span = rising_zero(lambda span: -self.advance(y, span, push(at, span))[0], 0.0, h)
        _, way, error, slope = self.advance(y, span, push(at, span))
        return Step(at, span, y, way, 0.0, slope), self._better(0.0, error)


@dataclass(frozen=True, slots=True)
class Step:
    """One step: where in its interval [s] and how long, speeds, way made, last acceleration."""

    offset: float
    span: float
    speed: float
    way: float
    after: float
    slope: float


def slide_of(mass: DryMass, way: int) -> Slide:
    """Motion in a direction, 1 or -1."""
    k, j = (0 if way > 0 else 1), mass.inertia
    fall = mass.law.rise(way)
    return Slide(mass.viscous[k] / j, mass.kinetic[k] / j, fall / j, mass.speed, j)


@dataclass(frozen=True)
class _Fast:
    """Motion far beyond the curve in closed form, for whole intervals between two nodes.

    The speed at the end is ``decay y + pushed`` and the way made ``travel y + carried``, where the
    speed ``y`` at the begin is ``above`` and that at the end ``enough``.
    """

    above: float
    enough: float
    decay: list[float]
    pushed: list[float]
    travel: list[float]
    carried: list[float]


class CurvedRun:
    """One pass through a log: all steps in order, and where the nodes lie among them.

    Attributes
    ----------
    steps
        Shape ``(7, n)``: interval, direction, offset in the interval [s], length [s], and speed at
        the begin (positive) of every step; the way it makes and the speed at its end, with their
        signs.
    carry
        What the derivative of the speed at the end of a step is multiplied by to be that at the
        begin of the next, for the steps that end in a stop: 0 where a rest follows. Otherwise 1.
    """

    def __init__(self, law: DryMass, u: PiecewiseInput, grid: Grid, speed: float) -> None:
        self.law, self.torque, self._grid = law, u.coefficients, grid
        self.spans: list[float] = np.diff(u.nodes).tolist()
        self.slides = {way: slide_of(law, way) for way in (1, -1)}
        self.band = StaticBand(u, *law.static)
        self._tables: dict[int, FloatArray] = {}
        self._fast: dict[int, _Fast] = {}
        self._polynomials: list[list[float]] = u.coefficients.tolist()
        self._steps: list[tuple[int, int, float, float, float, float, float]] = []
        self.carry: dict[int, float] = {}
        self.breakaways, self.stops = [0, 0], 0
        self._run(abs(speed), int(np.sign(speed)))
        self.steps = np.array(self._steps, dtype=float).reshape(-1, 7).T
        # the pass is kept
        del self._steps, self._tables, self._fast, self._polynomials, self._grid
        del self.band, self.spans

    def _run(self, speed: float, way: int) -> None:
        node, offset, end = 0, 0.0, len(self.spans)
        events, last = 0, -1
        while node < end:
            if way == 0:
                found = self.band.leave(node, offset)
                if found is None:
                    return
                node, offset, way = found
                self.breakaways[0 if way > 0 else 1] += 1
            events, last = (events + 1, last) if node == last else (0, node)
            if events > _LIMIT:  # rattling faster than the log can show
                node, offset, way = node + 1, 0.0, 0
                continue
            node, offset, way = self._slip(node, offset, way, speed)
            speed = 0.0

    def _slip(self, node: int, offset: float, way: int, y: float) -> tuple[int, float, int]:
        """Slip from an event to the next stop: interval, offset, and the way that follows."""
        slide, table, spans = self.slides[way], self._pushes(way), self.spans
        advance, tolerance, least = slide.advance, _TOLERANCE, _TOLERANCE * slide.speed
        note, span = self._steps.append, inf  # the span to try next
        fast = self._beyond_curve(way)
        above, enough = fast.above, fast.enough
        decay, pushed, travel, carried = fast.decay, fast.pushed, fast.travel, fast.carried
        while node < len(spans):
            h = spans[node]
            if y > above and offset == 0.0:
                x = decay[node] * y + pushed[node]
                if x > enough:
                    note((node, way, 0.0, h, y, way * (travel[node] * y + carried[node]), way * x))
                    node, y, span = node + 1, x, inf
                    continue
            if offset == 0.0 and y > 0.0 and span >= h:
                x, made, error, _ = advance(y, h, table[node].tolist())
                if x > 0.0 and error <= least + tolerance * x:
                    note((node, way, 0.0, h, y, way * made, way * x))
                    node, y = node + 1, x
                    continue
                span = 0.5 * h
            steps = slide.divide(y, offset, h, self._push(node, way), span)
            for s in steps:
                note((node, way, s.offset, s.span, s.speed, way * s.way, way * s.after))
            if not steps or steps[-1].after <= 0.0:
                return self._rest(node, way, steps)
            node, offset, y = node + 1, 0.0, steps[-1].after
            span = 2.0 * max(s.span for s in steps[-2:])
        return node, 0.0, way

    def _rest(self, node: int, way: int, steps: Sequence[Step]) -> tuple[int, float, int]:
        """Return what follows a stop: rest, or motion the other way at once."""
        if not steps:  # pushed by a hair, and by nothing before it moved
            return node + 1, 0.0, 0
        self.stops += 1
        last = steps[-1]
        offset = last.offset + last.span
        torque = value_of(self.torque[node], offset)
        following = self.band.way(torque)
        self.carry[len(self._steps) - 1] = 0.0
        if following == -way and last.slope < 0.0:
            other = self.slides[following]
            begins = following * torque / self.law.inertia - other.level - other.fall
            self.carry[len(self._steps) - 1] = -begins / last.slope
        return node, offset, following

    def _pushes(self, way: int) -> FloatArray:
        """Pushes of a direction at the six nodes of whole intervals, ``(n, 6)``."""
        if way not in self._tables:
            torque = torque_at(self.torque[:-1], NODES[:, None] * np.array(self.spans)).T
            self._tables[way] = way * torque / self.law.inertia - self.slides[way].level
        return self._tables[way]

    def _beyond_curve(self, way: int) -> _Fast:
        """Advance whole intervals of a direction where nothing is left of the curve."""
        if way not in self._fast:
            law, which, side = self.law, self._grid.which, 0 if way > 0 else 1
            net = way * self.torque[:-1].T
            net[0] -= law.kinetic[side]
            r = Responses.of(law.inertia, law.viscous[side], self._grid.distinct, len(net))
            above = _BEYOND * law.speed
            # a speed that is lowest inside an interval has risen from there by no more than this
            rise = (self._pushes(way).max(axis=1) * self.spans).max(initial=0.0)
            self._fast[way] = _Fast(
                above, above + max(float(rise), 0.0),
                r.decay[which].tolist(), (r.speed[:, which] * net).sum(axis=0).tolist(),
                r.travel[which].tolist(), (r.place[:, which] * net).sum(axis=0).tolist(),
            )  # fmt: skip
        return self._fast[way]

    def _push(self, node: int, way: int) -> Push:
        """Pushes of a direction inside an interval, as :meth:`Slide.divide` asks for them."""
        slide, scale = self.slides[way], way / self.law.inertia
        first, *rest = self._polynomials[node]
        if not rest:
            return slide.held(way * first)
        return polynomial([scale * first - slide.level, *(scale * c for c in rest)])


def polynomial(coefficients: Sequence[float]) -> Push:
    """Pushes of a polynomial with rising powers, at most three."""
    c0, c1, c2, c3 = (*coefficients, *[0.0] * (4 - len(coefficients)))
    _, x2, x3, x4, x5, _ = NODES.tolist()

    def push(at: float, h: float) -> list[float]:  # the hot path of every slow motion
        b0 = c0 + at * (c1 + at * (c2 + at * c3))
        b1 = h * (c1 + at * (2.0 * c2 + at * 3.0 * c3))
        b2 = h * h * (c2 + at * 3.0 * c3)
        b3 = h * h * h * c3
        return [
            b0,
            b0 + x2 * (b1 + x2 * (b2 + x2 * b3)),
            b0 + x3 * (b1 + x3 * (b2 + x3 * b3)),
            b0 + x4 * (b1 + x4 * (b2 + x4 * b3)),
            b0 + x5 * (b1 + x5 * (b2 + x5 * b3)),
            b0 + b1 + b2 + b3,
        ]

    return push


def torque_at(coefficients: FloatArray, offset: FloatArray) -> FloatArray:
    """Piecewise polynomials ``(n, d)`` at offsets ``(..., n)`` [s]."""
    total = np.zeros(np.shape(offset))
    for c in coefficients.T[::-1]:
        total = total * offset + c
    return total


def _vary(run: CurvedRun, steps: Steps, speed: FloatArray, shape: bool) -> Varied:
    """Derivatives of all steps of a motion, side by side; first speeds positive, ``(n,)``.

    By the ``shape`` of the curve, its exponent, only where that is asked for.
    """
    law, node, sign, h = run.law, steps.node, steps.way, steps.span
    j, w, forward = law.inertia, law.speed**-2, sign > 0
    pick = [np.where(forward, *pair) for pair in (law.viscous, law.kinetic, law.static)]
    viscous, level, fall = pick[0] / j, pick[1] / j, (pick[2] - pick[1]) / j
    torque = torque_at(run.torque[node], steps.offset + NODES[:, None] * h)
    push = sign * torque / j - level
    slopes: list[FloatArray] = []  # of every stage, shape (n,)
    changes: list[FloatArray] = []  # row 0 by the first speed, then by the law
    start = np.zeros((7 if shape else 6, h.size))
    start[0] = 1.0
    way, moved = np.zeros_like(start), start.copy()
    for p, a, weight in zip(push, STAGES, RESULT):
        y = speed + h * sum((c * k for c, k in zip(a, slopes)), start=np.zeros(h.size))
        dy = start + h * sum((c * k for c, k in zip(a, changes)), start=np.zeros_like(start))
        left = np.exp(-w * y * y)
        k = p - viscous * y - fall * left
        steep = -viscous + 2.0 * w * fall * y * left
        dk = steep * dy
        dk[1] -= k / j
        dk[2] -= y / j
        dk[3] -= (1.0 - left) / j
        dk[4] -= left / j
        square = w * y * y
        dk[5] -= 2.0 * fall * square * left / law.speed
        if shape:
            dk[6] += 0.5 * fall * left * square * np.log(np.maximum(square, 1e-300))
        slopes.append(k)
        changes.append(dk)
        way += weight * h * dy
        moved += weight * h * dk
    return Varied(moved[0], sign * moved[1:], way[0], sign * way[1:])


def motion_of(run: CurvedRun, p: StickSlip, initial_speed: Array) -> Motion:
    """The motion of a pass at the nodes of the torque, from position zero.

    The imaginary parts of the parameters carry exact derivatives: those of the steps taken.
    """
    begin = float(np.real(initial_speed.flat[0]))
    node, way, offset, span, first, made, after = run.steps
    nodes = np.arange(run.torque.shape[0])
    count = np.searchsorted(node, nodes)  # steps before each node
    last = np.maximum(count - 1, 0)
    moving = (count > 0) & (np.append(node, -1.0)[last] == nodes - 1)
    place = np.concatenate(([0.0], np.cumsum(made)))[count]
    speed = np.where(moving, np.append(after, 0.0)[last], 0.0)
    speed[0] = begin
    places = np.tile(place, (p.rows.shape[1], 1))
    motion = Motion(places, speed, (run.breakaways[0], run.breakaways[1]), run.stops)
    if not (np.iscomplexobj(p.rows) or np.iscomplexobj(initial_speed)):
        return motion
    if not node.size:
        return with_changes(motion, None, None, p, initial_speed)
    carry = np.ones(node.size)
    carry[list(run.carry)] = list(run.carry.values())
    steps = Steps(node.astype(int), way.astype(int), offset, span, way * first, carry,
                  np.zeros(node.size))  # fmt: skip
    varied = _vary(run, steps, first, bool(np.imag(p.rows[-1]).any()))
    return with_changes(motion, steps, varied, p, initial_speed)
