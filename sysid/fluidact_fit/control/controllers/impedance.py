"""Impedance control of a pneumatic cylinder, with its force shared between two pressures.

    F_d = k (r - x) + b_d (r' - x') + b~ x' + F~_c sgn x'                           (23)
    F_d = P1 A1 - P2 A2 - P_atm A_r,    P1 + P2 = P_sum                             (22)

hence ``P1 = (F_d + P_sum A2 + P_atm A_r) / (A1 + A2)``. Viscous and Coulomb friction are
compensated with identified values (``~``), so that the rod answers to a force like a mass on a
spring ``k`` with a damper ``b_d``. The thesis has the structure of (23) and has lost its terms; the
inertia of the rod is left as it is, which needs no measured force [1]_. Of the sign of the velocity
no more is compensated than a speed beyond its noise can tell.

References
----------
.. [1] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   section 5.3, after Y. Zhu, E. J. Barth, "Impedance control of a pneumatic actuator for contact
   tasks", ICRA 2005.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, sqrt
from typing import Self

import numpy as np

from ...routines import Argument, Draft, Machine, Routine, choose, constant
from ..filters import System, differentiator
from .base import RoutineController, Travel
from .routines import arguments, limited, rate, returned

ANY_POSITION = Travel("position")


@dataclass(frozen=True)
class Impedance:
    """Stiffness [N/m] and damping [N s/m] that are wanted."""

    stiffness: float
    damping: float

    @classmethod
    def with_damping_ratio(cls, mass: float, stiffness: float, ratio: float) -> Self:
        """Damping ``2 zeta sqrt(m k)`` of the free rod (equation 16 without ``B``)."""
        return cls(stiffness, 2.0 * ratio * sqrt(mass * stiffness))


@dataclass(frozen=True)
class KnownFriction:
    """Viscous [N s/m] and Coulomb [N] friction by direction that is compensated.

    ``tolerance`` is the speed that has a sign [m/s].
    """

    viscous: float = 0.0
    coulomb_positive: float = 0.0
    coulomb_negative: float = 0.0
    tolerance: float = 0.0


@dataclass(frozen=True)
class Pressures:
    """Conversion of a force into the commands of two valves.

    Areas [m2], sum of pressures and atmosphere [Pa], steady pressure per command of each supply,
    its offset [Pa], and the range that the valves can give [Pa].
    """

    area: tuple[float, float]
    total: float
    atmosphere: float
    gain: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    range: tuple[float, float] = (0.0, inf)


class ImpedanceController(RoutineController):
    """The controller of the pneumatic rig; ``limits`` are those of the force [N]."""

    def __init__(
        self, impedance: Impedance, pressures: Pressures, sample_time: float,
        friction: KnownFriction = KnownFriction(), *, travel: Travel = ANY_POSITION,
        cutoff: float = 10.0, limits: tuple[float, float] = (-inf, inf),
    ) -> None:  # fmt: skip
        super().__init__(sample_time, travel, limits)
        self.impedance, self.pressures, self.friction = impedance, pressures, friction
        self.cutoff, still = cutoff, {"force": self.limit(0.0)}
        self.begins = tuple(float(Machine(r)(**still)[0]) for r in self._commands(""))

    def routines(self, unit: str = "") -> tuple[Routine, ...]:
        """Wanted force, and the commands for it; see :meth:`RoutineController.routines`."""
        return self._force(), *self._commands(unit)

    def _force(self) -> Routine:
        about = "Force that is wanted at this sample."
        draft = Draft("force", about, "N", self.sample_time, careful=True)
        reference, measured = map(draft.argument, arguments(self.travel))
        z, f = self.impedance, self.friction
        coulomb = f.coulomb_positive or f.coulomb_negative
        force = constant("stiffness", z.stiffness) * (reference - measured)
        if z.damping or f.viscous or coulomb:
            speed = rate(draft, "speed", measured, self.cutoff, self.sample_time)
        if z.damping:
            wanted = rate(draft, "wanted_speed", reference, self.cutoff, self.sample_time)
            force = force + constant("damping", z.damping) * (wanted - speed)
        if f.viscous:
            force = force + constant("viscous", f.viscous) * speed
        if coulomb:
            up = constant("coulomb_positive", f.coulomb_positive)
            down = constant("coulomb_negative", -f.coulomb_negative)
            low, high = (constant("velocity_tolerance", way * f.tolerance) for way in (-1.0, 1.0))
            sign = choose(speed, "<", low, down, 0.0, jumps=True)
            sign = choose(speed, ">", high, up, sign, jumps=True)
            force = force + sign
        return returned(draft, limited(force, self.limits), self.limit(0.0))

    def _commands(self, unit: str) -> list[Routine]:
        """Commands of both valves for a force: equation 22."""
        p = self.pressures
        one, two = p.area
        most = max(p.total, p.atmosphere) * max(one, two)
        bias = p.total * two + p.atmosphere * (one - two)
        found = []
        for chamber in (1, 2):
            draft = Draft(f"command_{chamber}", f"Command of the valve of chamber {chamber}.", unit)
            force = draft.argument(
                Argument("force", "N", "wanted force", -most, most, recorded=False)
            )  # fmt: skip
            per_area = constant("per_area", 1.0 / (one + two))
            pressure = draft.let("pressure", (force + constant("bias", bias)) * per_area)
            if chamber == 2:
                pressure = draft.let("other", constant("sum_of_pressures", p.total) - pressure)
            offset = constant("offset", p.offset[chamber - 1])
            per_gain = constant("per_gain", 1.0 / p.gain[chamber - 1])
            found.append(draft.returns((limited(pressure, p.range) - offset) * per_gain))
        return found

    def linear(self) -> System:
        """From the position falling short to both commands; see :meth:`.Controller.linear`."""
        z, p = self.impedance, self.pressures
        per = np.array([1.0, -1.0]) / np.array(p.gain) / sum(p.area)
        speed = differentiator(self.cutoff, self.sample_time)
        return speed.scaled((z.damping - self.friction.viscous) * per, z.stiffness * per)
