"""A hydraulic motor for a controller: its static curve, the inverse, and one step of the motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ...block import Block, LinearBlock, LinearModel
from ...estimation.sampled import Sampled, Stepper, difference_equation, sample
from ...estimation.transfer_model import AT_REST
from ...experiment import Experiment, FloatArray
from ...routines import Routine
from ...specification import quotient_unit
from .equation import SHORT_OF_TOP, MotorModel, SettledModel, edges, lag, static_speed
from .routines import MotorRoutines


class MotorCurve(Block):
    """Steady speed of the motor for a command, and the command for a speed."""

    @property
    def centre(self) -> float:
        """Command at which the motor stands still [unit of the command]."""
        return self.numbers().get("command_offset", 0.0)

    @property
    def speed_unit(self) -> str:
        """Unit of the speed, that of the output or of its rate."""
        return self.output.unit if self._gives_speed else quotient_unit(self.output.unit, "s")

    @property
    def _gives_speed(self) -> bool:
        return self.output.role == "speed"

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

        Where the curve is flat, the least command that reaches the speed but for 1e-5 of it.

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
        share = np.minimum(np.abs(n) * k / v["gain"], 1.0 - SHORT_OF_TOP)
        low, high = edges(v)
        size = np.where(n > 0.0, high, -low) - np.log1p(-share) / k
        size = np.minimum(size, v.get("saturation_command", np.inf))
        shift = 0.5 * np.sign(direction) * v["hysteresis"]
        moved = np.sign(n) * size + shift
        return np.asarray(self.centre + np.where(n == 0.0, 0.0, moved))

    def methods(self) -> Mapping[str, Callable[..., Any]]:
        """Steady speed and its inverse; see :meth:`.Block.methods`."""
        return {"speed": self, "command_for": self.inverse}

    def routines(self) -> Sequence[Routine]:
        """Steady speed for a known direction, and its inverse."""
        return self._routines().curve()

    def _routines(self, *also: float) -> MotorRoutines:
        """Routines for the commands of the logs, and for some others."""
        command = self.argument("command", "command of the valve")
        command = replace(command, low=min((command.low, *also)), high=max((command.high, *also)))
        return MotorRoutines(self.numbers(), command, self.speed_unit)

    def predict(self, experiment: Experiment) -> FloatArray:
        """Steady speeds of settled points in their order; see :meth:`.Block.predict`."""
        return np.asarray(SettledModel([experiment]).response(0, self.numbers()))


class MotorBlock(MotorCurve, LinearBlock):
    """The same with the motion, one step per sample.

    :meth:`step` puts the play before the curve and the dead time and the lag behind it, exactly
    for a command that is held between samples. Fitted to an angle or a position it gives that.
    """

    def _begin(self) -> None:
        self._rest: tuple[float | None, float | None] = None, None
        self._lag: Stepper | None = None  # nothing has been put in yet

    def linear_model(self) -> LinearModel:
        """Lag and dead time, behind the play and the static curve."""
        # it may rest without a command that the logs never had
        v, curve = self.numbers(), self._routines(self.centre).steady()
        gain = 1.0 if self._gives_speed else None
        law = lag(v, not self._gives_speed)
        return LinearModel(*law, v.get("dead_time", 0.0), None, gain, curve, self.centre)

    def _sampled(self) -> Sampled:
        """Lag and dead time at the sample time."""
        self._need_sample_time("discrete model")
        v = self.numbers()
        law = lag(v, not self._gives_speed)
        return sample(*law, v.get("dead_time", 0.0), self.sample_time)

    def reset(self, *, input: float | None = None, output: float | None = None) -> None:
        """Return to rest.

        Parameters
        ----------
        input
            Command that was applied until now, in the middle of the hysteresis [unit of the
            command]; :attr:`centre` when left out. A motor that it turns does so steadily.
        output
            Output to begin with [its unit, offset included]; when left out that which the command
            gives in the long run, 0 for an angle or a position.
        """
        self._rest, self._lag = (input, output), None

    def _start(self) -> Stepper:
        """Take up the rest that was asked for."""
        command, output = self._rest
        self._spool = self.centre if command is None else float(command)
        steady = float(self(self._spool))
        begin = [steady, 0.0 if output is None else float(output)]
        if self._gives_speed:
            begin = [steady if output is None else float(output) - self.offset]
        return Stepper(self._sampled(), np.array(begin), steady)

    @property
    def _zero(self) -> float:
        """Output at rest; where an angle begins belongs to the log."""
        return self.offset if self._gives_speed else 0.0

    def _step(self, value: float) -> float:
        """Play and curve act on the command, then dead time and lag."""
        self._lag = self._lag or self._start()
        half = 0.5 * self.numbers()["hysteresis"]
        self._spool = min(max(self._spool, value - half), value + half)
        return self._lag.step(float(self(self._spool))) + self._zero

    def routines(self) -> Sequence[Routine]:
        """One step of the motion; steady speed for a known direction, and its inverse."""
        law, (role, unit) = difference_equation(self._sampled()), self.output
        step = self._routines().step(role, unit, law, self._zero, self.sample_time)
        return step, *super().routines()

    def predict(self, experiment: Experiment) -> FloatArray:
        """Output from the command, from rest and with the offset; see :meth:`.Block.predict`."""
        model = MotorModel(self.variant, [experiment], AT_REST)
        return model.combined(self.numbers()) + self.offset
