"""Pressures and motion with dry friction that sticks and slips, event by event, in CasADi.

While the piston slips one way, or sticks, the equations are smooth:

    v' = (push - viscous v - s level(v)) / mass,  s = sgn v     while slipping,
    v' = 0, v = 0  while |push| <= level(0)       while stuck,

with ``push = p1 A1 - p2 A2`` and ``level(v) = coulomb + stribeck exp(-(v / stribeck_speed)^2)``.
Where the speed reaches zero, or the push the level of the friction at rest, the instant is solved
for inside the Runge-Kutta step, and another step begins there: nothing is smoothed. At a stop the
sensitivities jump [1]_. Of ``dx+ = dx- + (f- - f+) dt*`` with ``dt* = -dv- / f-_v`` only

    dv+ = dv- f+_v / f-_v

is left, because ``y' = v = 0`` there and the pressures' rates are the same on both sides;
``f+_v = 0`` where the piston sticks. At a break-away the rates are continuous: nothing jumps.

References
----------
.. [1] R. I. Leine, H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems,
   2004, chapter 7 (saltation matrix).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from ...estimation.stribeck import EXPONENT
from ...experiment import FloatArray
from .equations import LOSSES, THETA, Machine

_ROUND = 1e4  # Pa: pressure drop below which the square root of an orifice is rounded off
_EVENTS = 3  # within a step; a piston that rattles faster rests for what is left of it
_NEWTON = 8  # iterations for the instant of an event, which stay within a bracket


class InPlace:
    """A CasADi function with one output that reads and writes arrays in their place.

    Called as CasADi's functions are, it would copy every number through a list: as long as the
    integration itself takes. ``arguments`` are to be filled before each call, whose result is
    overwritten by the next.
    """

    def __init__(self, function: Any) -> None:
        self.arguments: list[FloatArray] = [
            np.zeros(function.size_in(k), order="F") for k in range(function.n_in())
        ]
        self._result = np.zeros(function.size_out(0), order="F")
        self._buffer, self._run = function.buffer()
        for k, argument in enumerate(self.arguments):
            self._buffer.set_arg(k, argument.T.data)
        self._buffer.set_res(0, self._result.T.data)

    def __call__(self) -> FloatArray:
        """Evaluate at the arguments."""
        self._run()
        return self._result


@lru_cache(maxsize=16)
def segment_function(
    machine: Machine, segment: int, steps: int, free: tuple[str, ...] | None, count: int = 0
) -> Any:
    """CasADi function that integrates over a segment of samples, ``steps`` to each.

    With a ``count`` it does so for as many segments beside each other.

    ``(z, [u; h], theta) -> z after every sample``, with ``z`` the states p1, p2, y, v and, unless
    ``free`` is ``None``, column by column their derivatives by the initial state and the free
    parameters. The variational equations run through the same Runge-Kutta scheme, which makes
    them its exact derivative.
    """
    import casadi as ca

    if count:
        return segment_function(machine, segment, steps, free).map(count)
    now, held, theta = ca.MX.sym("z", _size(free)), ca.MX.sym("input", 2), _theta(ca.MX)
    step, after = _step_function(ca, machine, free), now
    for _ in range(steps):
        after = step(after, held[0], held[1] / steps, theta)
    sample = ca.Function("sample", [now, held, theta], [after])
    if free is None:  # with derivatives one piece of so many operations is no faster
        sample = _without_event_at_once(ca, machine, sample, steps)
    return sample.mapaccum("segment", segment)


def _without_event_at_once(ca: Any, machine: Machine, sample: Any, steps: int) -> Any:
    """The same sample, in one piece where no event lies in it: most have none."""
    x, held, theta = ca.SX.sym("x", 4), ca.SX.sym("input", 2), _theta(ca.SX)
    glide, way = _glide_function(ca, machine, None), _begun(ca, x, theta, machine)
    after, least = x, ca.inf
    for _ in range(steps):
        after, left = glide(after, held[0], held[1] / steps, theta, way)
        least = ca.fmin(least, left)
    at_once = ca.Function("at_once", [x, held, theta], [after, least])
    args = ca.MX.sym("x", 4), ca.MX.sym("input", 2), _theta(ca.MX)
    trial = ca.MX.sym("trial", 4)
    stepped = ca.Function("stepped", [*args, trial], [sample(*args)])
    keep = ca.Function("keep", [*args, trial], [trial])
    smooth, least = at_once(*args)
    # a switch evaluates the chosen branch only
    end = ca.Function.if_else("switch", stepped, keep)(least <= 0.0, *args, smooth)
    return ca.Function("sample", list(args), [end])


def _size(free: tuple[str, ...] | None) -> int:
    """Length of the states with their derivatives."""
    return 4 if free is None else 4 * (5 + len(free))


def _theta(kind: Any) -> Any:
    return kind.sym("theta", len(THETA))


def _arguments(kind: Any, size: int) -> list[Any]:
    """Symbols of states, command, time, parameters and the way the piston goes."""
    return [
        kind.sym("z", size), kind.sym("u"), kind.sym("t"), _theta(kind), kind.sym("way"),
    ]  # fmt: skip


def _begun(ca: Any, z: Any, theta: Any, machine: Machine) -> Any:
    """Way that the piston goes; the speed of one that sticks is exactly zero."""
    return ca.if_else(z[3] == 0.0, _way_from_rest(ca, z, theta, machine), ca.sign(z[3]))


def _step_function(ca: Any, machine: Machine, free: tuple[str, ...] | None) -> Any:
    """One step through whatever events lie in it, ``(z, u, t, theta) -> z``."""
    x, theta = ca.SX.sym("x", 4), _theta(ca.SX)
    way_of = ca.Function("begun", [x, theta], [_begun(ca, x, theta, machine)])
    glide, phase = _glide_function(ca, machine, free), _phase_function(ca, machine, free)
    flow = _flow_function(ca, machine, free)
    args = z, u, time, theta, _ = _arguments(ca.MX, _size(free))
    trial = ca.MX.sym("trial", _size(free))
    keep = ca.Function("keep", [*args, trial], [trial])
    # where one event follows the other, the piston rests for what is left
    rested = ca.if_else(time > 0.0, flow(z, u, time, theta, 0.0), z)
    through = ca.Function("rests", [*args, trial], [rested])
    for events in range(_EVENTS + 1):
        begun = phase(*args) if events < _EVENTS else (z, time, way_of(z[:4], theta))
        after, left = glide(begun[0], u, begun[1], theta, begun[2])
        switch = ca.Function.if_else("switch", through, keep)
        end = switch(left <= 0.0, begun[0], u, begun[1], theta, begun[2], after)
        through = ca.Function("through", [*args, trial], [end])
    return ca.Function("step", list(args[:4]), [end])


def _glide_function(ca: Any, machine: Machine, free: tuple[str, ...] | None) -> Any:
    """Motion without an event, and what is left until one, ``(z, u, t, theta, way)``."""
    args = z, u, time, theta, way = _arguments(ca.SX, _size(free))
    after = _flow_function(ca, machine, free)(z, u, time, theta, way)
    return ca.Function("glide", args, [after, _reserve(ca, after, theta, way, machine)])


def _phase_function(ca: Any, machine: Machine, free: tuple[str, ...] | None) -> Any:
    """Motion until the next event or the end: ``(z, u, t, theta, way) -> z, time left, way``."""
    flow, states = _flow_function(ca, machine, free), _flow_function(ca, machine, None)
    reserve, after = _reserve_function(ca, machine), _after_event(ca, machine, free)
    with_rate = _reserve_rate_function(ca, machine)
    args = z, u, time, theta, way = _arguments(ca.MX, _size(free))
    x = z[:4]
    first = reserve(x, theta, way)
    last = reserve(states(x, u, time, theta, way), theta, way)
    low, high = ca.MX(0.0), time
    guess = ca.if_else(first > 0.0, time * first / (first - last), time)
    for _ in range(_NEWTON):
        value, slope = with_rate(states(x, u, guess, theta, way), u, theta, way)
        low = ca.if_else(value > 0.0, guess, low)
        high = ca.if_else(value > 0.0, high, guess)
        newton = guess - value / slope
        inside = ca.logic_and(newton >= low, newton <= high)
        guess = ca.if_else(inside, newton, 0.5 * (low + high))
    event = last <= 0.0
    until = ca.if_else(event, guess, time)
    reached = flow(z, u, until, theta, way)
    turned, then = after(reached, theta, way)
    return ca.Function(
        "phase", [*args],
        [ca.if_else(event, turned, reached), ca.if_else(event, time - until, 0.0),
         ca.if_else(event, then, way)],
    )  # fmt: skip


def _after_event(ca: Any, machine: Machine, free: tuple[str, ...] | None) -> Any:
    """State, derivatives and way after a stop or a break-away, ``(z, theta, way) -> z, way``."""
    z, _, _, theta, way = _arguments(ca.SX, _size(free))
    push, level = _push(z, machine), _level(theta)
    stopped = _way_from_rest(ca, z, theta, machine)
    broke = way == 0.0
    then = ca.if_else(broke, ca.sign(push), stopped)
    before = push - way * level
    beyond = ca.if_else(stopped == 0.0, 0.0, push - stopped * level)
    jump = ca.if_else(broke, 1.0, beyond / ca.if_else(before == 0.0, 1.0, before))
    columns = [ca.vertcat(z[:3], 0.0)]
    for k in range(4, z.shape[0], 4):
        columns.append(ca.vertcat(z[k : k + 3], jump * z[k + 3]))
    return ca.Function("after", [z, theta, way], [ca.vertcat(*columns), then])


def _reserve_function(ca: Any, machine: Machine) -> Any:
    """What is left until the next event, ``(x, theta, way)``.

    Speed [m/s] the way the piston goes, or friction [N] that the push has not used up.
    """
    x, _, _, theta, way = _arguments(ca.SX, 4)
    return ca.Function("reserve", [x, theta, way], [_reserve(ca, x, theta, way, machine)])


def _reserve_rate_function(ca: Any, machine: Machine) -> Any:
    """The same with its rate, ``(x, u, theta, way)``: every step asks for the first alone."""
    x, u, _, theta, way = _arguments(ca.SX, 4)
    value = _reserve(ca, x, theta, way, machine)
    slope = ca.mtimes(ca.jacobian(value, x), _rates(ca, x, u, theta, way, machine))
    return ca.Function("reserve_rate", [x, u, theta, way], [value, slope])


def _reserve(ca: Any, x: Any, theta: Any, way: Any, machine: Machine) -> Any:
    held = _level(theta) - ca.fabs(_push(x, machine))
    value = ca.if_else(way == 0.0, held, way * x[3])
    # a piston stays at rest as long as the friction is not exceeded
    return ca.if_else(ca.logic_and(way == 0.0, held == 0.0), 1e-300, value)


def _push(x: Any, machine: Machine) -> Any:
    return x[0] * machine.area(1) - x[1] * machine.area(2)


def _level(theta: Any) -> Any:
    """Friction at rest and in the slowest motion."""
    return theta[THETA.index("coulomb")] + theta[THETA.index("stribeck")]


def _way_from_rest(ca: Any, x: Any, theta: Any, machine: Machine) -> Any:
    """Sign of the motion that begins at rest, 0 where the piston sticks."""
    push = _push(x, machine)
    return ca.if_else(ca.fabs(push) > _level(theta), ca.sign(push), 0.0)


def _flow_function(ca: Any, machine: Machine, free: tuple[str, ...] | None) -> Any:
    """Classical Runge-Kutta over a time without event, ``(z, u, t, theta, way) -> z``."""
    x, u, t, theta, way = _arguments(ca.SX, 4)
    rate = _rates(ca, x, u, theta, way, machine)
    z, change = x, rate
    if free is not None:
        s = ca.SX.sym("s", 4, 4 + len(free))
        which = [THETA.index(n) for n in free]
        forced = ca.horzcat(ca.SX(4, 4), ca.jacobian(rate, theta)[:, which])
        z = ca.vertcat(x, ca.vec(s))
        change = ca.vertcat(rate, ca.vec(ca.mtimes(ca.jacobian(rate, x), s) + forced))
    f = ca.Function("f", [z, u, theta, way], [change])
    begin = _halted(ca, z, way)
    k1 = f(begin, u, theta, way)
    k2 = f(begin + 0.5 * t * k1, u, theta, way)
    k3 = f(begin + 0.5 * t * k2, u, theta, way)
    k4 = f(begin + t * k3, u, theta, way)
    end = begin + t / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    return ca.Function("flow", [z, u, t, theta, way], [end])


def _halted(ca: Any, z: Any, way: Any) -> Any:
    """The same state with the speed and its derivatives at zero where the piston sticks."""
    moving = ca.if_else(way == 0.0, 0.0, 1.0)
    return ca.vertcat(*(
        ca.vertcat(z[k : k + 3], moving * z[k + 3]) for k in range(0, z.shape[0], 4)
    ))  # fmt: skip


def _rates(ca: Any, x: Any, u: Any, theta: Any, way: Any, machine: Machine) -> Any:
    """Equations 1 to 4 with dead zone, losses and dry friction, as CasADi expressions."""
    p = dict(zip(THETA, ca.vertsplit(theta)))
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
    slow = ca.fabs(v) / p["stribeck_speed"]
    level = p["coulomb"] + p["stribeck"] * ca.exp(-(slow ** p[EXPONENT]))
    friction = p["viscous"] * v + level * way
    slipping = (p1 * area_1 - p2 * area_2 - friction) / machine.mass
    return ca.vertcat(dp1, dp2, v, ca.if_else(way == 0.0, 0.0, slipping))
