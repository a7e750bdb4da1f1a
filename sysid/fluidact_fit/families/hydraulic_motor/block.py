"""A hydraulic motor for a controller: its static curve, the inverse, and one step of the motion."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ...block import LinearBlock, LinearModel
from ...estimation.sampled import Sampled, difference_equation, sample
from ...experiment import Experiment, FloatArray
from ...routines import Routine
from .equation import MotorModel, static_speed


class MotorBlock(LinearBlock):
    """Steady speed of the motor for a command, the command for a speed, and the motion itself.

    Called, it is the static curve; :meth:`step` puts the play before the curve and the dead time
    and the lag behind it, exactly for a command that is held between samples.
    """

    def _begin(self) -> None:
        self.reset()

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
        self.watch(command=command)
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
        self.watch(speed=speed)
        n, v = np.asarray(speed, dtype=float), self.numbers()
        k = v["curvature"] + 1e-12
        share = np.minimum(np.abs(n) * k / v["gain"], 1.0 - 1e-12)
        size = v["dead_zone"] - np.log1p(-share) / k
        size = np.minimum(size, v.get("saturation_command", np.inf))
        shift = 0.5 * np.sign(direction) * v["hysteresis"]
        return np.asarray(np.where(n == 0.0, 0.0, np.sign(n) * size + shift))

    def linear_model(self) -> LinearModel:
        """Lag and dead time, behind the play and the static curve."""
        from .routines import curve_routine

        v = self.numbers()
        rate = np.array([1.0 / v["time_constant"]])
        command = self.argument("command", "command of the valve")
        # a motor may rest without a command that the logs never had
        command = replace(command, low=min(command.low, 0.0), high=max(command.high, 0.0))
        return LinearModel(
            -rate[:, None], rate, np.ones(1), v.get("dead_time", 0.0), None, 1.0,
            curve_routine(v, command, self.output.unit),
        )  # fmt: skip

    def _sampled(self) -> Sampled:
        """Lag and dead time at the sample time."""
        self._need_sample_time("discrete model")
        law = self.linear_model()
        return sample(law.a, law.b, law.c, law.dead_time, self.sample_time)

    def reset(self, *, input: float = 0.0, output: float | None = None) -> None:
        """Return to rest.

        Parameters
        ----------
        input
            Command that was applied until now, in the middle of the hysteresis [unit of the
            command].
        output
            Speed to begin with [unit of the speed, offset included]; that which the command
            gives in the long run when left out.
        """
        self._rest = float(input), output
        self._speed: float | None = None  # nothing has been put in yet

    def _start(self) -> float:
        """Take up the rest that was asked for; returns the speed there, without the offset."""
        self._spool, output = self._rest
        steady, self._lag = float(self(self._spool)), self._sampled()
        self._on_their_way = deque([steady] * (self._lag.whole + 1))
        return steady if output is None else float(output) - self.offset

    def _step(self, value: float) -> float:
        """Play and curve act on the command, then dead time and lag."""
        now = self._start() if self._speed is None else self._speed
        half, lag = 0.5 * self.numbers()["hysteresis"], self._lag
        self._spool = min(max(self._spool, value - half), value + half)
        self._on_their_way.append(float(self(self._spool)))
        before, newest = self._on_their_way.popleft(), self._on_their_way[0]
        pushed = lag.old[0] * before + lag.new[0] * newest
        self._speed = float(lag.phi[0, 0]) * now + float(pushed)
        return now + self.offset

    def methods(self) -> Mapping[str, Callable[..., Any]]:
        """Steady speed and its inverse; see :meth:`.Block.methods`."""
        return {"speed": self, "command_for": self.inverse}

    def routines(self) -> Sequence[Routine]:
        """One step of the motion; steady speed for a known direction, and its inverse."""
        from .routines import routines_of

        command, lag = self.argument("command", "command of the valve"), self._sampled()
        return routines_of(
            self.numbers(), command, self.output.unit, difference_equation(lag), self.offset,
            self.sample_time,
        )  # fmt: skip

    def predict(self, experiment: Experiment) -> FloatArray:
        """Speed from the command, from rest and with the offset; see :meth:`.Block.predict`."""
        return np.asarray(MotorModel([experiment]).speed(0, self.numbers()) + self.offset)
