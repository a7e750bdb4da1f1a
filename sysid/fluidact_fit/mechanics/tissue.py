"""Tissue that a needle pushes, punctures and slides into.

Until it is punctured it is a spring with a damper that can push and not pull,

    F_e = max(k (x - x_s) + c v, 0)     for x > x_s,

and where this reaches the puncture force it turns into a weak spring, ``F_e = k_r (x - x_s)``, for
good: the test bed of the thesis [1]_.

References
----------
.. [1] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   figures 31 to 33.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..experiment import FloatArray

# Away from it, pushing it, ahead of it as it recovers; and when punctured: within, away.
Contact = Literal["off", "on", "lag", "within", "out"]


@dataclass(frozen=True)
class Tissue:
    """Surface [m], stiffness [N/m], damping [N s/m], puncture force [N], stiffness left [N/m]."""

    surface: float
    stiffness: float
    puncture_force: float
    damping: float = 0.0
    residual_stiffness: float = 0.0

    def begin(self, position: float) -> Contact:
        """State of a whole tissue with a needle at rest at a position [m]."""
        return "on" if position > self.surface else "off"

    def force(self, contact: Contact, size: int) -> FloatArray:
        """Row that gives the force on the needle from a state of that size: x, v, ..., 1."""
        row = np.zeros(size)
        if contact in ("on", "within"):
            k = self.stiffness if contact == "on" else self.residual_stiffness
            row[0], row[-1] = k, -k * self.surface
        if contact == "on":
            row[1] = self.damping
        return row

    def guards(self, contact: Contact, size: int) -> list[tuple[FloatArray, Contact]]:
        """Rows that are not negative in a state of contact, each with what follows it."""
        depth, push = np.zeros(size), self.force("on", size)
        depth[0], depth[-1] = 1.0, -self.surface
        left = -push
        left[-1] += self.puncture_force
        following: dict[Contact, list[tuple[FloatArray, Contact]]] = {
            "off": [(-depth, "on")],
            "on": [(push, "lag"), (left, "within")],
            "lag": [(-push, "on"), (depth, "off")],
            "within": [(depth, "out")],
            "out": [(-depth, "within")],
        }
        return following[contact]
