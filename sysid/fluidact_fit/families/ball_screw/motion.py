"""What a simulation of stick-slip takes and gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class StickSlip:
    """Parameters of the model, each of shape ``(k,)``, real parts equal along ``k``.

    ``inertia`` [kg m2 or kg], ``viscous`` [N m s/rad or N s/m], kinetic and static
    levels [N m or N], magnitudes. ``stribeck_speed`` [rad/s or m/s] is that of the curve that
    joins them; without one friction falls at once. Row 0 decides at which events the motion
    changes.
    """

    inertia: Array
    viscous: Array
    coulomb_positive: Array
    coulomb_negative: Array
    breakaway_positive: Array
    breakaway_negative: Array
    viscous_negative: Array | None = None
    stribeck_speed: Array | None = None


@dataclass(frozen=True)
class Motion:
    """Simulated motion: position and velocity at the nodes, shape ``(k, m)``, and events.

    ``breakaways`` counts break-aways in the positive and the negative direction.
    """

    position: Array
    velocity: Array
    breakaways: tuple[int, int]
    stops: int
