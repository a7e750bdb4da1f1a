"""A drive with dry friction: stick-slip, stepped exactly once per sample."""

from __future__ import annotations

from math import copysign, expm1, inf, log1p
from typing import Self

import numpy as np
import numpy.typing as npt

from ..discrete import discretise
from ..errors import UsageError
from ..estimation.inputs import PiecewiseInput
from ..estimation.linear import make_grid
from ..estimation.stick_slip import StickSlip, simulate_stick_slip
from ..experiment import FloatArray, Hold
from ..parameters import ParameterDocument
from .base import ModelBlock, Port
from .dynamic import TransferFunction
from .section import Section

_NAMES = ("coulomb_positive", "coulomb_negative", "breakaway_positive", "breakaway_negative")


def has_stick_slip(document: ParameterDocument) -> bool:
    """Whether a document describes a mass with kinetic and static friction."""
    return set(_NAMES) <= set(document.parameters)


class DriveBlock(ModelBlock):
    """A mass or inertia with viscous and dry friction.

    ``J v' = tau - b v - F_k(sign v)`` while it moves; it rests while the input stays
    between the static levels. Break-away and stop are solved inside the sample.

    Attributes
    ----------
    position, velocity
        State at the instant of the latest :meth:`step` and thereafter: where the next
        step begins [unit of the output, and per second].
    """

    def __init__(
        self, document: ParameterDocument, section: Section, input: Port, output: Port
    ) -> None:
        super().__init__(document, input, output)
        values = {k: float(v) for k, v in self.parameters.items() if isinstance(v, int | float)}
        self._section = section
        self._inertia = values["inertia"] if "inertia" in values else values["mass"]
        both = values.get("viscous", 0.0)
        self._forward = values.get("viscous_positive", both), values["coulomb_positive"]
        self._backward = values.get("viscous_negative", both), values["coulomb_negative"]
        # the model has no static level below the kinetic one
        self._upper = max(values["breakaway_positive"], values["coulomb_positive"])
        self._lower = -max(values["breakaway_negative"], values["coulomb_negative"])
        self._period = section.discrete.sample_time if section.discrete else 0.0
        self.reset()

    @property
    def sample_time(self) -> float:
        """Period of :meth:`step` [s]; 0 when the file holds none."""
        return self._period

    @property
    def inertia(self) -> float:
        """Inertia [kg m2] or mass [kg]."""
        return self._inertia

    def with_sample_time(self, sample_time: float) -> Self:
        """Return the same drive, at rest, stepping at another period [s]."""
        if not (np.isfinite(sample_time) and sample_time > 0.0):
            raise UsageError(f"sample_time {sample_time!r} is not a positive number")
        other = type(self)(self.document, self._section, self.input, self.output)
        other._period = float(sample_time)
        return other

    def transfer_function(self) -> TransferFunction:
        """Return the linear part, from input less dry friction to output."""
        s = self._section
        return TransferFunction(s.numerator, s.denominator, s.dead_time)

    def difference_equation(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the linear part sampled at ``sample_time``, rising powers of ``1/z``."""
        s = self._section
        self._need_period()
        d = discretise(s.numerator, s.denominator, self._period, "zoh", s.dead_time)
        return tuple(d["numerator"]), tuple(d["denominator"])

    def reset(self, *, output: float | None = None, velocity: float = 0.0) -> None:
        """Put the drive at a position [unit of the output], at rest or moving."""
        self.position = 0.0 if output is None else float(output)
        self.velocity = float(velocity)

    def step(self, value: float) -> float:
        """Take the input of this sample and return the position at the same instant.

        The input is held until the next call, one ``sample_time`` later.

        Parameters
        ----------
        value
            Torque or force [unit of the input].

        Returns
        -------
        float
            Position [unit of the output].
        """
        self._need_period()
        now = self.position
        rest, value = self._period, float(value)
        for _ in range(4):  # a held input: moving, stopped, moving the other way
            rest = self._move(value, rest)
            if rest <= 0.0:
                break
        return now

    def _need_period(self) -> None:
        if self._period <= 0.0:
            raise UsageError(
                "the parameter file holds no sample time",
                remedy="Use with_sample_time(...), or fit with --controller-sample-time.",
            )

    def _move(self, drive: float, span: float) -> float:
        """Advance until the span ends or the motion stops; returns what is left of it [s]."""
        v = self.velocity
        forward = v > 0.0 if v != 0.0 else drive > self._upper
        if v == 0.0 and not forward and drive >= self._lower:
            return 0.0
        viscous, level = self._forward if forward else self._backward
        net = drive - (level if forward else -level)
        stop = _time_to_stop(v, net, viscous, self._inertia)
        time = min(stop, span)
        rate = viscous / self._inertia
        one, two = _phi(-rate * time)
        push = net / self._inertia * time
        self.position += v * time * one + push * time * two
        if stop > span:
            self.velocity = v * (1.0 - rate * time * one) + push * one
            return 0.0
        self.velocity = 0.0
        return span - stop

    def friction(self, velocity: float, torque: float = 0.0) -> float:
        """Friction that opposes the motion [unit of the input].

        Parameters
        ----------
        velocity
            [unit of the output per second]
        torque
            Input, or force on a linear axis [unit of the input]: at rest friction balances
            it as long as it stays between the static levels.

        Returns
        -------
        float
            Moving: ``b v`` plus the kinetic level, with the sign of the velocity. At rest:
            what is balanced, at most the static level.
        """
        if velocity > 0.0:
            return self._forward[0] * velocity + self._forward[1]
        if velocity < 0.0:
            return self._backward[0] * velocity - self._backward[1]
        return min(max(torque, self._lower), self._upper)

    def feedforward(
        self, velocity: float, acceleration: float = 0.0, *, band: float = 0.0
    ) -> float:
        """Input for a wanted motion: inertia, viscous and kinetic friction.

        Parameters
        ----------
        velocity, acceleration
            Of the wanted motion [unit of the output per second, per second squared]. At
            zero velocity the acceleration gives the direction of the motion to come.
        band
            Velocity below which the kinetic level is blended in linearly, so that noise of the
            velocity causes no chatter [unit of the output per second].
        """
        way = velocity if velocity != 0.0 else acceleration
        if way == 0.0:
            return 0.0
        viscous, level = self._forward if way > 0.0 else self._backward
        share = min(abs(velocity) / band, 1.0) if band > 0.0 else 1.0
        return self._inertia * acceleration + viscous * velocity + copysign(level, way) * share

    def simulate(
        self,
        values: npt.ArrayLike,
        time: npt.ArrayLike | None = None,
        *,
        hold: Hold = "zoh",
        before: float | None = None,
        output: float | None = None,
        velocity: float = 0.0,
    ) -> FloatArray:
        """Simulate a whole record; the state of :meth:`step` is not touched.

        Parameters
        ----------
        values : (n,)
            Input [unit of the input].
        time : (n,), optional
            Instants [s], evenly spaced or not; one ``sample_time`` apart when left out.
        hold
            How the input moves between instants, as in :meth:`DynamicBlock.simulate`.
        before
            Not used: the drive has no dead time.
        output, velocity
            Position and velocity at the first instant, 0 when left out.

        Returns
        -------
        (n,)
            Position [unit of the output].
        """
        if time is None:
            self._need_period()
            time = np.arange(np.size(values)) * self._period
        u, t, _ = self._signal(values, time, hold, before)
        if t.size == 1:
            return np.array([output or 0.0])
        motion = simulate_stick_slip(
            self._rows(), _at(u, t), make_grid(t),
            initial_speed=velocity, initial_position=output or 0.0,
        )  # fmt: skip
        return np.asarray(np.real(motion.position[0]))

    def _rows(self) -> StickSlip:
        one = [
            self._inertia, self._forward[0], self._forward[1], self._backward[1],
            self._upper, -self._lower, self._backward[0],
        ]  # fmt: skip
        return StickSlip(*(np.array([v]) for v in one))


def _at(u: PiecewiseInput, time: FloatArray) -> PiecewiseInput:
    """The same input; constant inputs are given with their instants as nodes."""
    if u.nodes.size == time.size:
        return u
    return PiecewiseInput(time, np.repeat(u.coefficients[:1], time.size, axis=0))


def _time_to_stop(v: float, net: float, viscous: float, inertia: float) -> float:
    """Time until a moving mass stops under a constant force [s], infinite when it never does."""
    if v == 0.0 or v * net >= 0.0:
        return inf
    x = -v * viscous / net
    factor = log1p(x) / x if x > 1e-9 else 1.0 - 0.5 * x
    return -v * inertia / net * factor


def _phi(z: float) -> tuple[float, float]:
    """``(exp(z) - 1)/z`` and ``(exp(z) - 1 - z)/z**2``, for small ``z`` too."""
    if abs(z) > 0.3:
        one = expm1(z) / z
        return one, (one - 1.0) / z
    two, term = 0.0, 0.5
    for k in range(3, 17):
        two += term
        term *= z / k
    return 1.0 + z * two, two
