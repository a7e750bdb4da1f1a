"""A double-acting hydraulic cylinder behind a servo valve: pressures, motion, dry friction.

    p1' = beta (Q1(u, p1) - A1 v) / (V1 + A1 y),      p2' = beta (A2 v - Q2(u, p2)) / (V2 - A2 y)
    M v' = p1 A1 - p2 A2 - F_e - b v - F(v) sgn v     while it moves,  v = 0 while it rests

The flows are not linear: a Runge-Kutta scheme of fourth order with fixed steps, in which the
instant of every stop and break-away is solved for and another step begins. The flows and the
friction are those of the parameter file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, pi, sqrt

import numpy as np

from ...block import Port
from ...errors import UsageError
from ...estimation.sampled import Sampled, sample
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.hybrid import check_steps
from .base import UNLIMITED, Limits, Plant

_State = tuple[float, float, float, float]  # p1, p2, y, v
_EVENTS = 8  # within a step; a piston that rattles faster rests for what is left of it
_BISECTIONS = 50
_OPENING = 1e-3  # of the valve beyond its dead zone, where the cylinder is taken for linear [V]
_NUDGE = 1e-4  # of the supply pressure, to find how a flow changes with a pressure


@dataclass(frozen=True)
class HydraulicCylinder:
    """Areas [m2], volumes at position 0 [m3], mass [kg], bulk modulus and pressures [Pa].

    ``flow(chamber, command, pressure)`` is the flow into chamber 1 or out of chamber 2 [m3/s], and
    ``edges`` the commands at which the valve begins to open, backward and forward.
    """

    area: tuple[float, float]
    volume: tuple[float, float]
    mass: float
    bulk_modulus: float
    supply: float
    tank: float
    friction: FrictionLaw
    flow: Callable[[int, float, float], float]
    edges: tuple[float, float] = (0.0, 0.0)

    def rest(self) -> tuple[float, float]:
        """Pressures of a piston at rest, as close to half-way from tank to supply as can be."""
        one, two = self.area
        share = 0.5 * (self.supply + self.tank) * (one + two) / (one**2 + two**2)
        return share * two, share * one

    @property
    def rate(self) -> float:
        """Runge-Kutta steps per second that follow the motion.

        40 in the oil's own period, the piston between both chambers at position 0, 2 in the time
        in which a speed grows ``e``-fold where friction falls with it, and 1 in that in which
        viscous friction stops it.
        """
        stiffness = sum(a * a / v for a, v in zip(self.area, self.volume)) * self.bulk_modulus
        oil = sqrt(stiffness / self.mass) / (2.0 * pi)
        law = self.friction
        viscous = max(law.viscous_positive, law.viscous_negative)
        return max(40.0 * oil, 2.0 * law.fall / self.mass, viscous / self.mass)

    def step(self, sample_time: float) -> float:
        """Runge-Kutta step that divides a sample [s]."""
        return sample_time / ceil(self.rate * sample_time)


class HydraulicPlant(Plant):
    """Position of a :class:`HydraulicCylinder`; the command is that of its valve [V]."""

    def __init__(
        self, cylinder: HydraulicCylinder, command: Port, sample_time: float,
        *, limits: Limits = UNLIMITED,
    ) -> None:  # fmt: skip
        self.cylinder, self.sample_time, self.limits = cylinder, sample_time, (limits,)
        self.commands, self.controlled = (command,), Port("position", "m")
        self._step = cylinder.step(sample_time)
        check_steps(self._step, sample_time)
        self.reset()

    def reset(self, output: float = 0.0, commands: Sequence[float] = ()) -> None:
        """Be at rest there with the valve closed."""
        self._state: _State = (*self.cylinder.rest(), output, 0.0)
        self._way = 0

    def measure(self) -> Mapping[str, float]:
        """Position, speed and both pressures."""
        p1, p2, y, v = self._state
        return {"position": y, "speed": v, "pressure_1": p1, "pressure_2": p2}

    def _advance(self, command: Sequence[float]) -> None:
        for _ in range(round(self.sample_time / self._step)):
            rest = self._step
            for _ in range(_EVENTS):
                rest = self._follow(command[0], rest)
                if rest <= 0.0:
                    break
            else:
                self._way = 0
                self._state = self._integrate((*self._state[:3], 0.0), command[0], rest, 0)
        if min(self._volumes(self._state)) <= 0.0:
            raise UsageError(
                f"the piston is at {self._state[2]:.4g} m, beyond where a chamber holds oil",
                remedy="Choose a smaller reference or smaller gains, or limit the command.",
            )

    def _volumes(self, state: _State) -> tuple[float, float]:
        c = self.cylinder
        return c.volume[0] + c.area[0] * state[2], c.volume[1] - c.area[1] * state[2]

    def _push(self, state: _State) -> float:
        return state[0] * self.cylinder.area[0] - state[1] * self.cylinder.area[1]

    def _leaving(self, state: _State) -> int:
        push, law = self._push(state), self.cylinder.friction
        return 1 if push > law.breakaway_positive else -1 if push < -law.breakaway_negative else 0

    def _follow(self, command: float, span: float) -> float:
        """Advance until the span ends or an event comes; returns what is left [s]."""
        if self._way == 0:
            self._way = self._leaving(self._state)
        way, start = self._way, self._state
        over = self._breaks if way == 0 else lambda s: s[3] * way < 0.0
        end = self._integrate(start, command, span, way)
        if not over(end):
            self._state = end
            return 0.0
        low, high = 0.0, span
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            beyond = over(self._integrate(start, command, middle, way))
            low, high = (low, middle) if beyond else (middle, high)
        state = self._integrate(start, command, high, way)
        self._state = state if way == 0 else (*state[:3], 0.0)
        self._way = self._leaving(self._state)
        return span - high

    def _breaks(self, state: _State) -> bool:
        return self._leaving(state) != 0

    def _integrate(self, state: _State, command: float, span: float, way: int) -> _State:
        """One step of the classical Runge-Kutta scheme in one mode of motion."""
        x = np.array(state)
        k1 = self._rates(x, command, way)
        k2 = self._rates(x + 0.5 * span * k1, command, way)
        k3 = self._rates(x + 0.5 * span * k2, command, way)
        k4 = self._rates(x + span * k3, command, way)
        p1, p2, y, v = (x + span / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)).tolist()
        return p1, p2, y, v

    def _rates(self, x: np.ndarray, command: float, way: int) -> np.ndarray:
        c = self.cylinder
        p1, p2, y, v = x.tolist()
        first, second = self._volumes((p1, p2, y, v))
        in_1 = c.flow(1, command, p1) - c.area[0] * v
        in_2 = c.area[1] * v - c.flow(2, command, p2)
        force = 0.0
        if way:
            force = self._push((p1, p2, y, v)) - way * c.friction.sliding(way, v)
        return np.array(
            [c.bulk_modulus * in_1 / first, c.bulk_modulus * in_2 / second, v, force / c.mass]
        )

    def linear(self) -> tuple[tuple[Sampled, ...], ...]:
        """About a slow motion each way, the valve just open and the piston at position 0."""
        return tuple((self._about(way),) for way in (-1, 1))

    def _about(self, way: int) -> Sampled:
        c, law = self.cylinder, self.cylinder.friction
        pressures, command = c.rest(), c.edges[way > 0] + way * _OPENING
        viscous = law.viscous_positive if way > 0 else law.viscous_negative
        a, b = np.zeros((4, 4)), np.zeros(4)
        for i, (p, sign) in enumerate(zip(pressures, (1.0, -1.0))):
            rate, step = sign * c.bulk_modulus / c.volume[i], _NUDGE * c.supply
            ends = [c.flow(i + 1, command, p + side * step) for side in (1.0, -1.0)]
            opened = c.flow(i + 1, command, p) - c.flow(i + 1, c.edges[way > 0], p)
            a[i, i] = rate * (ends[0] - ends[1]) / (2.0 * step)
            a[i, 3] = -rate * c.area[i]
            b[i] = rate * opened / (way * _OPENING)
            a[3, i] = sign * c.area[i] / c.mass
        a[2, 3], a[3, 3] = 1.0, -viscous / c.mass
        return sample(a, b, np.eye(4)[2], 0.0, self.sample_time)
