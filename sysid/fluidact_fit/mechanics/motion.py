"""Inputs and results of a simulation of stick-slip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np

from ..experiment import Array
from .friction_law import FrictionLaw


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
    """Parameters of the model, each of shape ``(k,)``, real parts equal along ``k``.

    ``inertia`` [kg m2 or kg], ``viscous`` [N m s/rad or N s/m], kinetic and static
    levels [N m or N], magnitudes. ``stribeck_speed`` [rad/s or m/s] is that of the curve that
    joins them; without one friction falls at once. ``exponent`` is that of the curve, the real
    part of which is 2. The imaginary part of a row is a direction in which the motion is to be
    differentiated.
    """

    inertia: Array
    viscous: Array
    coulomb_positive: Array
    coulomb_negative: Array
    breakaway_positive: Array
    breakaway_negative: Array
    viscous_negative: Array | None = None
    stribeck_speed: Array | None = None
    exponent: Array | None = None

    @classmethod
    def of(cls, inertia: Array, values: Mapping[str, Any], static: Mapping[str, Array]) -> Self:
        """Read the friction off named values, numbers or rows as long as ``inertia``.

        ``static`` holds the static levels, by name; what is lower than the kinetic level is raised
        to it. One ``viscous`` stands for both directions where there are no one-sided values.
        """

        def row(name: str, otherwise: Any = 0.0) -> Array:
            return np.broadcast_to(values.get(name, otherwise), inertia.shape)

        levels = []
        for side in ("positive", "negative"):
            kinetic, rest = row(f"coulomb_{side}"), static[f"breakaway_{side}"]
            levels.append((kinetic, np.where(np.real(rest) > np.real(kinetic), rest, kinetic)))
        (forward, backward), viscous = levels, values.get("viscous", 0.0)
        return cls(
            inertia, row("viscous_positive", viscous), forward[0], backward[0], forward[1],
            backward[1], row("viscous_negative", viscous), row("stribeck_speed"),
            row("stribeck_exponent", 2.0),
        )  # fmt: skip

    @cached_property
    def rows(self) -> tuple[Array, ...]:
        """Inertia, viscous, kinetic and static friction by direction, the curve's two numbers."""
        backward = self.viscous if self.viscous_negative is None else self.viscous_negative
        curve = np.zeros_like(self.inertia) if self.stribeck_speed is None else self.stribeck_speed
        shape = np.full_like(self.inertia, 2.0) if self.exponent is None else self.exponent
        return (
            self.inertia, self.viscous, backward, self.coulomb_positive, self.coulomb_negative,
            self.breakaway_positive, self.breakaway_negative, curve, shape,
        )  # fmt: skip

    @cached_property
    def mass(self) -> DryMass:
        """The real parts."""
        j, b, bn, kp, kn, sp, sn, speed, _ = (float(np.real(row.flat[0])) for row in self.rows)
        return DryMass(j, FrictionLaw(kp, kn, b, bn, sp, sn, stribeck_speed=speed, joined=True))

    def turned(self, initial_speed: Array) -> bool:
        """Return whether any of the rows, or the initial speed, is complex."""
        return any(np.iscomplexobj(row) for row in (*self.rows, initial_speed))


@dataclass(frozen=True)
class Motion:
    """Simulated motion at the nodes: positions ``(k, m)``, velocity ``(m,)``, and events.

    ``breakaways`` counts break-aways in the positive and the negative direction.
    """

    position: Array
    velocity: Array
    breakaways: tuple[int, int]
    stops: int
