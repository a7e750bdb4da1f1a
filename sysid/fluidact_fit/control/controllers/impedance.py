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

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, sqrt
from typing import Self

import numpy as np

from ..filters import Differentiator, System
from .base import Controller, Travel

ANY_POSITION = Travel("position")


def allocate(
    force: float, area_1: float, area_2: float, sum_of_pressures: float, atmosphere: float
) -> tuple[float, float]:
    """Pressures [Pa] that give a force [N] and have a set sum (equation 22).

    The rod takes the difference of the areas [m2]; ``atmosphere`` [Pa] acts on it.
    """
    bias = atmosphere * (area_1 - area_2)
    first = (force + sum_of_pressures * area_2 + bias) / (area_1 + area_2)
    return first, sum_of_pressures - first


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

    def compensate(self, speed: float) -> float:
        """Force against friction at a measured speed [N]."""
        force = self.viscous * speed
        if speed > self.tolerance:
            return force + self.coulomb_positive
        return force - self.coulomb_negative if speed < -self.tolerance else force


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

    def commands(self, force: float) -> tuple[float, float]:
        """Commands of both valves; a pressure beyond their range is cut off."""
        low, high = self.range
        found = allocate(force, *self.area, self.total, self.atmosphere)
        one, two = (
            (min(max(p, low), high) - offset) / gain
            for p, gain, offset in zip(found, self.gain, self.offset)
        )
        return one, two


class ImpedanceController(Controller):
    """The controller of the pneumatic rig; ``limits`` are those of the force [N]."""

    def __init__(
        self, impedance: Impedance, pressures: Pressures, sample_time: float,
        friction: KnownFriction = KnownFriction(), *, travel: Travel = ANY_POSITION,
        cutoff: float = 10.0, limits: tuple[float, float] = (-inf, inf),
    ) -> None:  # fmt: skip
        still = pressures.commands(min(max(0.0, limits[0]), limits[1]))
        super().__init__(sample_time, travel, limits, still)
        self.impedance, self.pressures, self.friction = impedance, pressures, friction
        self.cutoff = cutoff
        self._speed = Differentiator(cutoff, sample_time)
        self._wanted = Differentiator(cutoff, sample_time)

    def reset(self) -> None:
        """Forget what was measured."""
        super().reset()
        self._speed.reset()
        self._wanted.reset()

    def _interrupt(self, wanted: float) -> None:
        self._speed.interrupt()
        self._wanted.interrupt()

    def force(self, position: float, reference: float) -> float:
        """Force that is wanted at this sample [N]; filters go on."""
        speed, wanted = self._speed.step(position), self._wanted.step(reference)
        z = self.impedance
        force = z.stiffness * (reference - position) + z.damping * (wanted - speed)
        return self.limit(force + self.friction.compensate(speed))

    def compute(self, measured: Mapping[str, float], wanted: float) -> tuple[float, ...]:
        """The commands for the wanted impedance; see :meth:`Controller.compute`."""
        return self.pressures.commands(self.force(measured["position"], wanted))

    def linear(self) -> System:
        """From the position falling short to both commands; see :meth:`.Controller.linear`."""
        z, p = self.impedance, self.pressures
        per = np.array([1.0, -1.0]) / np.array(p.gain) / sum(p.area)
        rate = Differentiator(self.cutoff, self.sample_time).system()
        return rate.scaled((z.damping - self.friction.viscous) * per, z.stiffness * per)
