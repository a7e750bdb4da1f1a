"""Static curve of a hydraulic motor and its inverse, for a controller."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ...block import Block
from ...experiment import Experiment, FloatArray
from ...routines import Routine
from .equation import MotorModel, static_speed


class MotorBlock(Block):
    """Steady speed of the motor for a command, and the command for a speed."""

    def __call__(self, command: npt.ArrayLike, direction: int = 0) -> FloatArray:
        """Steady speed without the :attr:`offset` of the sensor, vectorised.

        Parameters
        ----------
        command
            [unit of the command]
        direction
            1 where the command was last raised, -1 where it was lowered, 0 for the middle of
            the hysteresis.
        """
        u, v = np.asarray(command, dtype=float), self.numbers()
        return static_speed(u - 0.5 * np.sign(direction) * v["hysteresis"], v)

    def inverse(self, speed: npt.ArrayLike, direction: int = 0) -> FloatArray:
        """Command for a steady speed, vectorised; cut at the saturation.

        Parameters
        ----------
        speed
            [unit of the speed]
        direction
            As when calling; use the sign of the wanted change.
        """
        n, v = np.asarray(speed, dtype=float), self.numbers()
        k = v["curvature"] + 1e-12
        share = np.minimum(np.abs(n) * k / v["gain"], 1.0 - 1e-12)
        size = v["dead_zone"] - np.log1p(-share) / k
        size = np.minimum(size, v.get("saturation_command", np.inf))
        shift = 0.5 * np.sign(direction) * v["hysteresis"]
        return np.asarray(np.where(n == 0.0, 0.0, np.sign(n) * size + shift))

    def routines(self) -> Sequence[Routine]:
        """Steady speed behind the play, the same for a given direction, and its inverse."""
        from .routines import routines_of

        command = self.argument("command", "command of the valve")
        return routines_of(self.numbers(), command, self.output.unit)

    def predict(self, experiment: Experiment) -> FloatArray:
        """Speed from the command, from rest and with the offset; see :meth:`.Block.predict`."""
        return np.asarray(MotorModel([experiment]).speed(0, self.numbers()) + self.offset)
