"""Inputs and results of a simulation of stick-slip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np

from ..experiment import Array
from .friction_law import FrictionLaw

FRICTION = (
    "viscous_positive", "viscous_negative", "coulomb_positive", "coulomb_negative",
    "breakaway_positive", "breakaway_negative", "stribeck_speed", "stribeck_exponent",
)  # fmt: skip


@dataclass(frozen=True)
class DryMass:
    """A mass [kg] or inertia [kg m2] and its friction; pairs hold the positive direction first."""

    inertia: float
    law: FrictionLaw

    @cached_property
    def viscous(self) -> tuple[float, float]:
        """Viscous friction by direction [N s/m or N m s/rad]."""
        return self.law.viscous_positive, self.law.viscous_negative

    @cached_property
    def kinetic(self) -> tuple[float, float]:
        """Kinetic levels by direction [N or N m]."""
        return self.law.coulomb_positive, self.law.coulomb_negative

    @cached_property
    def static(self) -> tuple[float, float]:
        """Static levels by direction [N or N m]."""
        return self.law.breakaway_positive, self.law.breakaway_negative

    @cached_property
    def speed(self) -> float:
        """Speed of the Stribeck curve [m/s or rad/s]; 0 where none has anything to fall from."""
        return self.law.stribeck_speed if self.law.curved else 0.0


@dataclass(frozen=True)
class StickSlip:
    """Parameters of the model as rows ``(9, k)``, real parts equal along ``k``.

    Inertia [kg m2 or kg] and the parameters of :data:`FRICTION`: viscous friction
    [N m s/rad or N s/m], kinetic and static levels [N m or N], magnitudes, and speed [rad/s or
    m/s] and exponent of the curve that joins them; at speed 0 friction falls at once. The real
    part of the exponent is 2. The imaginary part of a column is a direction in which the motion
    is to be differentiated.
    """

    rows: Array

    @classmethod
    def of(cls, inertia: Array, values: Mapping[str, Any]) -> Self:
        """Read the friction off named values, numbers or rows as long as ``inertia``, ``(k,)``.

        A static level below the kinetic one is raised to it. One ``viscous`` stands for both
        directions where there are no one-sided values.
        """
        otherwise = {"stribeck_speed": 0.0, "stribeck_exponent": 2.0}
        otherwise |= {name: values.get("viscous", 0.0) for name in FRICTION[:2]}
        friction = {name: values.get(name, otherwise.get(name)) for name in FRICTION}
        for side in ("positive", "negative"):
            kinetic, static = friction[f"coulomb_{side}"], friction[f"breakaway_{side}"]
            below = np.real(static) < np.real(kinetic)
            friction[f"breakaway_{side}"] = np.where(below, kinetic, static)
        rows = (inertia, *friction.values())
        return cls(np.array([np.broadcast_to(row, inertia.shape) for row in rows]))

    @cached_property
    def mass(self) -> DryMass:
        """The real parts."""
        inertia, *friction, _ = np.real(self.rows[:, 0]).tolist()
        named = dict(zip(FRICTION, friction))
        return DryMass(inertia, FrictionLaw(**named, joined=True))


@dataclass(frozen=True)
class Motion:
    """Simulated motion at the nodes: positions ``(k, m)``, velocity ``(m,)``, and events.

    ``breakaways`` counts break-aways in the positive and the negative direction.
    """

    position: Array
    velocity: Array
    breakaways: tuple[int, int]
    stops: int
