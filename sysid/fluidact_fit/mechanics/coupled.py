"""Coupled motion with dry friction, followed from event to event, in CasADi.

States ``x`` with a velocity ``v`` among them, whose mass has dry friction, obey

    x' = rates(x, u, p, way),            way = sgn v  while it slips,
    x' = rates(x, u, p, 0), v = 0  while |push(x, p)| <= level(p)  and it sticks.

Where the velocity reaches zero, or the push the level of the friction at rest, the instant is
solved for inside the Runge-Kutta step, and another step begins there: nothing is smoothed. At a
stop the sensitivities jump [1]_. Of ``dx+ = dx- + (f- - f+) dt*`` with ``dt* = -dv- / f-_v`` only

    dv+ = dv- f+_v / f-_v

is left, because ``v = 0`` there and all other rates are the same on both sides; ``f+_v = 0`` where
it sticks. At a break-away the rates are continuous: nothing jumps.

References
----------
.. [1] R. I. Leine, H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems,
   2004, chapter 7 (saltation matrix).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from ..experiment import FloatArray

_EVENTS = 3  # within a step; what rattles faster rests for what is left of it
_NEWTON = 8  # iterations for the instant of an event, which stay within a bracket


@dataclass(frozen=True)
class CoupledSystem:
    """Equations as functions that return CasADi expressions.

    Attributes
    ----------
    states, parameters
        Lengths of ``x`` and ``p``.
    velocity
        Index of ``v`` among the states.
    rates
        ``rates(x, u, p, way)``: all rates of change, for a held input ``u``.
    push, level
        ``push(x, p)`` on the mass, without its friction, and ``level(p)`` of the friction at rest
        and in the slowest motion.
    """

    states: int
    parameters: int
    velocity: int
    rates: Callable[[Any, Any, Any, Any], Sequence[Any]]
    push: Callable[[Any, Any], Any]
    level: Callable[[Any], Any]


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
def motion(
    system: CoupledSystem, samples: int, steps: int, free: tuple[int, ...] | None = None
) -> Any:
    """CasADi function that follows a system over a row of samples, ``steps`` to each.

    ``(z, [u; h], p) -> z`` after every sample, with ``u`` held over a sample of ``h`` seconds.
    ``z`` holds the states and, unless ``free`` is ``None``, column by column their derivatives by
    the initial state and by those parameters. The variational equations run through the same
    Runge-Kutta scheme, which makes them its exact derivative.
    """
    import casadi as ca

    step = _Step(system, free)
    now, held, p = (
        ca.MX.sym("z", step.size),
        ca.MX.sym("input", 2),
        ca.MX.sym("p", system.parameters),
    )
    after = now
    for _ in range(steps):
        after = step.through(after, held[0], held[1] / steps, p)
    return ca.Function("sample", [now, held, p], [after]).mapaccum("samples", samples)


def linearised(
    system: CoupledSystem, x: FloatArray, u: float, p: FloatArray, way: int
) -> tuple[FloatArray, FloatArray]:
    """Derivatives of the rates by the states and by the input, ``(n, n)`` and ``(n,)``."""
    import casadi as ca

    step = _Step(system, None)
    slopes = ca.jacobian(step.rate, ca.vertcat(step.x, step.u))
    both = ca.Function("slopes", [step.x, step.u, step.p, step.way], [slopes])(x, u, p, way)
    return np.asarray(both)[:, :-1], np.asarray(both)[:, -1]


class _Step:
    """One Runge-Kutta step and what it is made of, as CasADi functions."""

    def __init__(self, system: CoupledSystem, free: tuple[int, ...] | None) -> None:
        import casadi as ca

        self.ca, self.system, self.free = ca, system, free
        columns = 0 if free is None else system.states + len(free)
        self.size = system.states * (1 + columns)
        self.x, self.u = ca.SX.sym("x", system.states), ca.SX.sym("u")
        self.p, self.way = ca.SX.sym("p", system.parameters), ca.SX.sym("way")
        self.rate = ca.vertcat(*system.rates(self.x, self.u, self.p, self.way))

    def _arguments(self, kind: Any) -> list[Any]:
        """Symbols of states, input, time, parameters and the way of the motion."""
        return [
            kind.sym("z", self.size), kind.sym("u"), kind.sym("t"),
            kind.sym("p", self.system.parameters), kind.sym("way"),
        ]  # fmt: skip

    @cached_property
    def through(self) -> Any:
        """One step through whatever events lie in it, ``(z, u, t, p) -> z``."""
        ca, begin = self.ca, self._begin
        args = z, u, time, p, _ = self._arguments(ca.MX)
        trial = ca.MX.sym("trial", self.size)
        keep = ca.Function("keep", [*args, trial], [trial])
        # where one event follows the other, it rests for what is left
        rested = ca.if_else(time > 0.0, self._flow(z, u, time, p, 0.0), z)
        onward = ca.Function("rests", [*args, trial], [rested])
        for events in range(_EVENTS + 1):
            if events < _EVENTS:
                begun = self._phase(*args)
            else:
                begun = z, time, begin(z[: self.system.states], p)
            after, left = self._glide(begun[0], u, begun[1], p, begun[2])
            switch = ca.Function.if_else("switch", onward, keep)  # evaluates the chosen one only
            end = switch(left <= 0.0, begun[0], u, begun[1], p, begun[2], after)
            onward = ca.Function("onward", [*args, trial], [end])
        return ca.Function("step", list(args[:4]), [end])

    @cached_property
    def _begin(self) -> Any:
        """Way of the motion, ``(x, p)``; the velocity of what sticks is exactly zero."""
        ca, v = self.ca, self.x[self.system.velocity]
        way = ca.if_else(v == 0.0, self._way_from_rest(self.x, self.p), ca.sign(v))
        return ca.Function("begin", [self.x, self.p], [way])

    @cached_property
    def _glide(self) -> Any:
        """Motion without an event, and what is left until one, ``(z, u, t, p, way)``."""
        args = z, u, time, p, way = self._arguments(self.ca.SX)
        after = self._flow(z, u, time, p, way)
        return self.ca.Function("glide", args, [after, self._reserve(after, p, way)])

    @cached_property
    def _phase(self) -> Any:
        """Motion until the next event or the end: ``(z, u, t, p, way) -> z, time left, way``."""
        ca, plain = self.ca, _Step(self.system, None)
        reserve = ca.Function("reserve", [self.x, self.p, self.way], [
            self._reserve(self.x, self.p, self.way)
        ])  # fmt: skip
        args = z, u, time, p, way = self._arguments(ca.MX)
        x = z[: self.system.states]
        first, last = reserve(x, p, way), reserve(plain._flow(x, u, time, p, way), p, way)
        low, high = ca.MX(0.0), time
        guess = ca.if_else(first > 0.0, time * first / (first - last), time)
        for _ in range(_NEWTON):
            value, slope = self._reserve_rate(plain._flow(x, u, guess, p, way), u, p, way)
            low = ca.if_else(value > 0.0, guess, low)
            high = ca.if_else(value > 0.0, high, guess)
            newton = guess - value / slope
            inside = ca.logic_and(newton >= low, newton <= high)
            guess = ca.if_else(inside, newton, 0.5 * (low + high))
        event = last <= 0.0
        until = ca.if_else(event, guess, time)
        reached = self._flow(z, u, until, p, way)
        turned, then = self._after_event(reached, p, way)
        return ca.Function("phase", args, [
            ca.if_else(event, turned, reached), ca.if_else(event, time - until, 0.0),
            ca.if_else(event, then, way),
        ])  # fmt: skip

    @cached_property
    def _after_event(self) -> Any:
        """States, derivatives and way after a stop or a break-away, ``(z, p, way) -> z, way``."""
        ca = self.ca
        z, _, _, p, way = self._arguments(ca.SX)
        push, level, broke = self.system.push(z, p), self.system.level(p), way == 0.0
        stopped = self._way_from_rest(z, p)
        before = push - way * level
        beyond = ca.if_else(stopped == 0.0, 0.0, push - stopped * level)
        jump = ca.if_else(broke, 1.0, beyond / ca.if_else(before == 0.0, 1.0, before))
        scaled = self._velocities_times(z, jump)
        scaled[self.system.velocity] = 0.0
        return ca.Function(
            "after", [z, p, way], [scaled, ca.if_else(broke, ca.sign(push), stopped)]
        )

    @cached_property
    def _reserve_rate(self) -> Any:
        """Return the margin to the next event, and its rate, ``(x, u, p, way)``."""
        ca = self.ca
        value = self._reserve(self.x, self.p, self.way)
        slope = ca.jtimes(value, self.x, self.rate)
        return ca.Function("reserve_rate", [self.x, self.u, self.p, self.way], [value, slope])

    def _reserve(self, x: Any, p: Any, way: Any) -> Any:
        """Velocity the way it goes, or friction at rest that the push has not used up."""
        ca = self.ca
        held = self.system.level(p) - ca.fabs(self.system.push(x, p))
        # it stays at rest as long as the friction is not exceeded
        held = ca.if_else(held == 0.0, 1e-300, held)
        return ca.if_else(way == 0.0, held, way * x[self.system.velocity])

    def _way_from_rest(self, x: Any, p: Any) -> Any:
        """Sign of the motion that begins at rest, 0 where it sticks."""
        push = self.system.push(x, p)
        return self.ca.if_else(self.ca.fabs(push) > self.system.level(p), self.ca.sign(push), 0.0)

    @cached_property
    def _flow(self) -> Any:
        """Classical Runge-Kutta over a time without event, ``(z, u, t, p, way) -> z``."""
        ca, n = self.ca, self.system.states
        _, u, t, p, way = args = self._arguments(ca.SX)
        z, change = self.x, self.rate
        if self.free is not None:
            s = ca.SX.sym("s", n, n + len(self.free))
            forced = ca.horzcat(ca.SX(n, n), ca.jacobian(self.rate, self.p)[:, list(self.free)])
            moved = ca.mtimes(ca.jacobian(self.rate, self.x), s) + forced
            z, change = ca.vertcat(z, ca.vec(s)), ca.vertcat(change, ca.vec(moved))
        f = ca.Function("f", [z, self.u, self.p, self.way], [change])
        # at rest the velocity and its derivatives are zero
        begin = self._velocities_times(args[0], ca.if_else(way == 0.0, 0.0, 1.0))
        k1 = f(begin, u, p, way)
        k2 = f(begin + 0.5 * t * k1, u, p, way)
        k3 = f(begin + 0.5 * t * k2, u, p, way)
        k4 = f(begin + t * k3, u, p, way)
        end = begin + t / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        return ca.Function("flow", args, [end])

    def _velocities_times(self, z: Any, factor: Any) -> Any:
        """The same states with the velocity and its derivatives multiplied by a factor."""
        out = self.ca.SX(z)
        for k in range(self.system.velocity, self.size, self.system.states):
            out[k] = factor * z[k]
        return out
