"""Equations of a servo valve, its two chambers and the piston, and what is given of the machine.

    M y'' = p1 A1 - p2 A2 - B y' - (F_c + F_s exp(-(|y'| / v_s)^2)) sgn(y')            (1)
    p1' =  beta / (V1 + A1 y) (Q1 - A1 y')                                             (2)
    p2' = -beta / (V2 - A2 y) (Q2 - A2 y')                                             (3)
    Q1 = K1 u sqrt(p_s - p1 - l1), u >= 0;  K1 u sqrt(p1 - p_0 - l3), u < 0
    Q2 = K2 u sqrt(p2 - p_0 - l4), u >= 0;  K2 u sqrt(p_s - p2 - l2), u < 0            (4)
    l = r |Q|

with ``u`` the command beyond the dead zone of the valve. The equations are those of [1]_ with its
typing errors corrected, which ``docs/theory/hydraulic-cylinder.md`` lists.

An examination supposes more than a file holds: oil ``leakage (p1 - p2)`` that passes the piston, a
constant ``load`` against its extension, and ``air``, the share of it in the oil at atmospheric
pressure ``p_a``, with ``1 / beta + air p_a / (p + p_a)^2`` in place of ``1 / beta``.

References
----------
.. [1] "A hydraulic actuator model using feedforward neural networks", 25th ABCM
   International Congress of Mechanical Engineering (COBEM), 2019, equations 1 to 9, table 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi, sqrt
from typing import Any

import numpy as np

from .. import routines
from ..estimation.named_model import Values
from ..estimation.stribeck import EXPONENT, STRIBECK
from ..experiment import Array, FloatArray
from .coupled import CoupledSystem
from .friction_law import FrictionLaw

EDGES = ("dead_zone_negative", "dead_zone_positive")
GRAY_NAMES = (
    "valve_gain_1", "valve_gain_2", "line_loss_1", "line_loss_2", "line_loss_3", "line_loss_4",
    "bulk_modulus", *EDGES, "viscous", "coulomb",
)  # fmt: skip
LEAKAGE, LOAD, AIR = "leakage", "load", "air"
THETA = (*GRAY_NAMES, *STRIBECK, EXPONENT, LEAKAGE, LOAD, AIR)
LOSSES = {1: ("line_loss_1", "line_loss_3"), 2: ("line_loss_4", "line_loss_2")}
SIGN = {1: 1.0, 2: -1.0}  # of the motion that makes a chamber larger


_GIVEN = ("area_1", "area_2", "dead_volume_1", "dead_volume_2", "mass", "supply", "tank")
_ATMOSPHERE = 1e5  # Pa
_ROUND = 1e4  # Pa: without loss the root of an orifice has an infinite slope at zero drop


@dataclass(frozen=True)
class Arithmetic:
    """Kind of numbers that the flows are written in.

    Attributes
    ----------
    choose
        ``choose(of, yes, no)`` is ``yes`` where ``of`` is not negative, otherwise ``no``.
    sqrt
        Square root.
    rounding
        Pressure drop below which the root of an orifice is rounded off [Pa].
    """

    choose: Callable[[Any, Any, Any], Any]
    sqrt: Callable[[Any], Any]
    rounding: float


ARRAYS = Arithmetic(lambda of, yes, no: np.where(np.real(of) >= 0.0, yes, no), np.sqrt, 1e-9)
"""Real arrays, or complex ones whose imaginary parts carry derivatives."""
ROUTINES = Arithmetic(
    lambda of, yes, no: routines.choose(of, ">=", 0.0, yes, no), routines.sqrt, _ROUND
)
"""Expressions of a routine, which give what :data:`SYSTEM` gives."""


@dataclass(frozen=True)
class HydraulicMachine:
    """Given data, not estimated: areas [m2], volumes [m3], mass [kg], pressures [Pa].

    ``None`` where nobody said.
    """

    area_1: float | None = None
    area_2: float | None = None
    dead_volume_1: float | None = None
    dead_volume_2: float | None = None
    mass: float | None = None
    supply: float = 0.0
    tank: float = 0.0

    def area(self, chamber: int) -> float:
        """Piston area of a chamber [m2]."""
        area = self.area_1 if chamber == 1 else self.area_2
        assert area is not None
        return area

    def dead_volume(self, chamber: int) -> float | None:
        """Volume of a chamber and its line at position 0 [m3]."""
        return self.dead_volume_1 if chamber == 1 else self.dead_volume_2

    def volume(self, chamber: int, position: Array) -> Array:
        """``V1 + A1 y`` or ``V2 - A2 y`` [m3] of a chamber whose dead volume is known."""
        dead = self.dead_volume(chamber)
        assert dead is not None
        return dead + SIGN[chamber] * self.area(chamber) * position

    def swelling(self, chamber: int, position: Array, pressure: Array) -> Array:
        """``-+ V dp`` between samples: ``beta`` times the oil that adds to the motion [m3 Pa].

        Zero where the dead volume is not known.
        """
        if self.dead_volume(chamber) is None:
            return np.zeros(position.size - 1)
        volume = self.volume(chamber, position)
        return -0.5 * SIGN[chamber] * (volume[1:] + volume[:-1]) * np.diff(pressure)

    def pressure_drop(
        self, chamber: int, command: Any, pressure: Any, kind: Arithmetic = ARRAYS
    ) -> Any:
        """Drop [Pa] over the open edge: a command that is not negative feeds chamber 1, else 2."""
        fed, drained = self.supply - pressure, pressure - self.tank
        return kind.choose(command, *((fed, drained) if chamber == 1 else (drained, fed)))

    def stiffness(self, position: float) -> float:
        """Stiffness of the oil in both closed chambers, per bulk modulus [m]."""
        place = np.array(position)
        return sum(self.area(i) ** 2 / float(self.volume(i, place)) for i in (1, 2))

    def step_rate(self, values: Values, position: float = 0.0, a_period: float = 40.0) -> float:
        """Runge-Kutta steps per second that follow the motion.

        So many in the oil's own period, the piston between both chambers at a position, 2 in the
        time in which a speed grows ``e``-fold where friction falls with it, and 1 in that in which
        viscous friction stops it.
        """
        mass, fall = self.mass or 1.0, FrictionLaw.of(values).fall
        oil = sqrt(values["bulk_modulus"] * self.stiffness(position) / mass) / (2.0 * pi)
        return max(a_period * oil, 2.0 * fall / mass, values["viscous"] / mass)

    @property
    def complete(self) -> bool:
        """Return whether the gray box can be simulated."""
        given = (self.area_1, self.area_2, self.dead_volume_1, self.dead_volume_2, self.mass)
        return all(v is not None for v in given)

    def at_rest(self, position: float) -> FloatArray:
        """Pressures, position and speed at rest with the valve closed, ``(4,)``.

        ``p1 A1 = p2 A2`` leaves one pressure open. The lands of a closed valve leak, equally
        and in proportion to the pressure, from the supply and to the tank: creeping, the piston
        gives one chamber what the other loses, and the pressures settle at the point of that
        line that is closest to half-way between supply and tank.
        """
        area_1, area_2 = self.area(1), self.area(2)
        share = 0.5 * (self.supply + self.tank) * (area_1 + area_2) / (area_1**2 + area_2**2)
        return np.array([share * area_2, share * area_1, position, 0.0])


def orifice_flow(command: Any, drop: Any, gain: Any, loss: Any, kind: Arithmetic = ARRAYS) -> Any:
    """Flow through an orifice in series with a line, with the sign of the command [m3/s].

    ``Q = K u sqrt(drop - r |Q|)`` holds the flow on both sides. With ``k = K |u|`` its
    solution is ``Q = sgn(u) (-k^2 r + sqrt(k^4 r^2 + 4 k^2 drop)) / 2``, written here as
    ``sgn(u) 2 k drop / (k r + sqrt(k^2 r^2 + 4 drop))`` which loses no digits at small flow.

    Parameters
    ----------
    command, drop : (n,)
        Beyond the dead zone [V]; pressure across valve and line [Pa]: flow turns back where it
        is negative.
    gain, loss
        ``K`` [m3/(s V Pa^0.5)] and ``r`` [Pa s/m3].
    kind
        Of all these numbers.
    """
    k = gain * kind.choose(command, command, -command)
    size = kind.sqrt(drop * drop + kind.rounding**2)
    flow = 2.0 * k * drop / (k * loss + kind.sqrt(k * loss * (k * loss) + 4.0 * size))
    return kind.choose(command, flow, -flow)


def chamber_flow(
    chamber: int, command: Any, pressure: Any, values: Values, machine: HydraulicMachine,
    kind: Arithmetic = ARRAYS,
) -> Any:  # fmt: skip
    """Flow into chamber 1 or out of chamber 2, ``K_i u g_i`` of equation 4 [m3/s].

    Positive while the piston extends. ``command`` [V] and ``pressure`` [Pa] have the shape
    ``(n,)``, or are numbers of another ``kind``; ``values`` holds valve gain, the two losses of the
    chamber and the dead zone.
    """
    above, below = (command - values[edge] for edge in reversed(EDGES))
    beyond = kind.choose(above, above, 0.0) + kind.choose(-below, below, 0.0)
    drop = machine.pressure_drop(chamber, beyond, pressure, kind)
    loss = kind.choose(beyond, *(values[name] for name in LOSSES[chamber]))
    return orifice_flow(beyond, drop, values[f"valve_gain_{chamber}"], loss, kind)


def parameter_vector(values: Values, machine: HydraulicMachine) -> FloatArray:
    """Parameters of :data:`SYSTEM`, ``(p,)``; a file without a Stribeck rise has none."""
    absent = {**dict.fromkeys((*STRIBECK, LEAKAGE, LOAD, AIR), 0.0), EXPONENT: 2.0}
    numbers = {n: float(values.get(n, absent[n]) if n in absent else values[n]) for n in THETA}
    if numbers["stribeck_speed"] <= 0.0:  # no rise, whatever its speed
        numbers |= {"stribeck": 0.0, "stribeck_speed": 1.0}
    return np.array([*numbers.values(), *(getattr(machine, n) for n in _GIVEN)], dtype=float)


def _named(p: Any) -> dict[str, Any]:
    """Parameters of :data:`SYSTEM` by name."""
    return {n: p[k] for k, n in enumerate((*THETA, *_GIVEN))}


def _push(x: Any, p: Any) -> Any:
    v = _named(p)
    return x[0] * v["area_1"] - x[1] * v["area_2"] - v[LOAD]


def _level_at_rest(p: Any) -> Any:
    v = _named(p)
    return v["coulomb"] + v["stribeck"]


def _rates(x: Any, u: Any, p: Any, way: Any) -> list[Any]:
    """Equations 1 to 4 as CasADi expressions; the states are p1, p2, y and y'."""
    import casadi as ca

    v = _named(p)
    machine = HydraulicMachine(*(v[name] for name in _GIVEN))
    symbols = Arithmetic(lambda of, yes, no: ca.if_else(of >= 0.0, yes, no), ca.sqrt, _ROUND)

    def stiffness(pressure: Any) -> Any:
        dense = (ca.fmax(pressure, 0.0) + _ATMOSPHERE) ** 2 / _ATMOSPHERE
        return v["bulk_modulus"] / (1.0 + v["bulk_modulus"] * v[AIR] / dense)

    p1, p2, y, speed = (x[k] for k in range(4))
    leak = v[LEAKAGE] * (p1 - p2)
    flow = [chamber_flow(i, u, x[i - 1], v, machine, symbols) for i in (1, 2)]
    slow = ca.fabs(speed) / v["stribeck_speed"]
    level = v["coulomb"] + v["stribeck"] * ca.exp(-(slow ** v[EXPONENT]))
    slipping = (_push(x, p) - v["viscous"] * speed - level * way) / v["mass"]
    return [
        stiffness(p1) / machine.volume(1, y) * (flow[0] - leak - v["area_1"] * speed),
        -stiffness(p2) / machine.volume(2, y) * (flow[1] - leak - v["area_2"] * speed),
        speed,
        ca.if_else(way == 0.0, 0.0, slipping),
    ]


SYSTEM = CoupledSystem(4, len(THETA) + len(_GIVEN), 3, _rates, _push, _level_at_rest)
"""States p1, p2 [Pa], y [m] and y' [m/s]; the input is the command [V]."""
