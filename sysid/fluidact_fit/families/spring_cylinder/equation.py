"""Force of a single-acting cylinder with a return spring: equations 1 to 6 of the paper.

    F   = p A - F_s(x) - F_r                       (1)
    F_s = k x + F_0                                (2)
    p   = k_u u                                    (4)
    F_r = c_l while loading, -c_u while unloading, plus b v

and with ``--stribeck`` either level higher by ``F_s exp(-(v / v_s)^2)``, so that
``F = k_F u - k x - F_0 - c_l [s > 0] + c_u [s < 0] - b v`` with the pressure gain
``k_F = k_u A`` [N/V], or the area ``A`` [m2] where the pressure was measured [1]_. ``F`` is
the force of the rod, positive as it pushes out. The command for a wanted force is the exact
inverse (equation 5)

    u = (F + k x + F_0 + c_l [s > 0] - c_u [s < 0] + b v) / k_F.

Equation 3, ``s = u_j - u_(j-1)``, is taken as the *held sign* of the change: as a difference it
vanishes whenever the command rests. The line over ``k_u s_a`` in equation 5 is a division.

References
----------
.. [1] X. Wu, H. Hua, S. Feng, Y. Zhao, Y. Yang, Z. Liao, "Data-Driven Feedforward Force
   Control of a Single-Acting Pneumatic Cylinder with a Nonlinear Hysteresis
   Characteristic", Actuators 14, 162, 2025.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from ...estimation.stribeck import STRIBECK
from ...experiment import FloatArray
from ...mechanics.friction_law import FrictionLaw
from ...routines import Expression, constant

_Array = npt.ArrayLike
LEVELS = ("coulomb_loading", "coulomb_unloading")
GAINS = {"command": "pressure_gain", "pressure": "area"}  # by variant


@dataclass(frozen=True)
class SpringLaw:
    """Gain [N/V] or area [m2], spring [N/m, N] and friction by motion state (loading: positive)."""

    gain: float
    stiffness: float
    preload: float
    friction: FrictionLaw

    @classmethod
    def of(cls, values: Mapping[str, float]) -> Self:
        """Read the law off the parameters of a file."""
        gain = next(values[n] for n in GAINS.values() if n in values)
        loading, unloading, viscous = (values[n] for n in (*LEVELS, "viscous"))
        rise, speed = (values.get(n, 0.0) for n in STRIBECK)
        friction = FrictionLaw(
            loading, unloading, viscous, viscous, stribeck=rise, stribeck_speed=speed
        )
        return cls(gain, values["stiffness"], values["preload"], friction)

    def _lost(self, position: _Array, direction: _Array, velocity: _Array) -> FloatArray:
        """Force of the spring and of friction [N]."""
        spring = self.stiffness * np.asarray(position, dtype=float) + self.preload
        return np.asarray(spring + self.friction.moving(velocity, direction))

    def routine_lost(
        self, position: Expression, direction: Expression, velocity: Expression
    ) -> Expression:
        """Force of the spring and of friction as an expression, see :meth:`force`."""
        stiffness = constant("stiffness", self.stiffness)
        spring = stiffness * position + constant("preload", self.preload)
        return spring + self.friction.routine_value(velocity, direction=direction)

    def force(
        self, drive: _Array, position: _Array, direction: _Array, velocity: _Array
    ) -> FloatArray:
        """Force of the rod (equation 6) [N] at a command [V] or pressure [Pa].

        ``position`` is the compression of the spring beyond its preload [m], ``direction`` the
        motion state: positive loading, negative unloading, 0 between (no friction).
        """
        driving = self.gain * np.asarray(drive, dtype=float)
        return np.asarray(driving - self._lost(position, direction, velocity))

    def command(
        self, force: _Array, position: _Array, direction: _Array, velocity: _Array
    ) -> FloatArray:
        """Command or pressure for a wanted force (equation 5), inverse of :meth:`force`."""
        wanted = np.asarray(force, dtype=float)
        return np.asarray((wanted + self._lost(position, direction, velocity)) / self.gain)
