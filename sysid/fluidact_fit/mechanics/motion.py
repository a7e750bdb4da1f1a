"""What a simulation of stick-slip takes and gives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..experiment import Array


@dataclass(frozen=True)
class Levels:
    """Real parameters of the drive: inertia, and by direction viscous, kinetic and static friction.

    The positive direction comes first. ``speed`` is that of the Stribeck curve, 0 without one.
    """

    inertia: float
    viscous: tuple[float, float]
    kinetic: tuple[float, float]
    static: tuple[float, float]
    speed: float = 0.0


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
    def levels(self) -> Levels:
        """The real parts. A curve that has nothing to fall from is none."""
        j, *pairs, speed, _ = (float(np.real(row.flat[0])) for row in self.rows)
        viscous, kinetic, static = zip(pairs[::2], pairs[1::2])
        falls = any(s > k for s, k in zip(static, kinetic))
        return Levels(j, viscous, kinetic, static, speed if falls else 0.0)

    def turned(self, initial_speed: Array) -> bool:
        """Whether any of the rows, or the initial speed, is complex."""
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
