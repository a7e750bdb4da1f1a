"""Proportional-derivative position control with compensation of static friction.

    T = K_p e + K_d e' + T_s,    e = r - x                                         (figure 20)
    T_s = C_s H(v_tol - |x'|)                                                       (17)
    C_s = C_s+ for e > 0, 0 for e = 0, -C_s- for e < 0                              (18)

The derivative acts on the error; both rates are differences followed by the velocity filter
(:mod:`..filters`). Kinetic friction is left alone: it damps [1]_.

Gains follow the reasoning of the thesis. With ``M x'' + B x' = K T``, friction compensated,

    X/R = (K_d s + K_p) / (M s^2 + (B + K_d) s + K_p)                               (12)
    E/R = (M s^2 + B s) / (M s^2 + (B + K_d) s + K_p)                               (13)
    e_ss = A B / K_p    after a ramp of slope A                                     (15)
    zeta = (B + K_d) / (2 sqrt(M K_p))                                              (16)

(gains times ``K`` in them): ``K_p`` follows from the error that a ramp may leave or from the
bandwidth ``sqrt(K_p / M)``, and ``K_d`` from the damping ratio, not below zero. Sampling, hold and
filter take from the damping what these equations promise; the margins tell how much.

References
----------
.. [1] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   section 4.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan, pi, sqrt
from typing import Self

import numpy as np

from ...errors import UsageError
from ...routines import Draft, Routine, by_sign, choose, constant
from ..filters import System, differentiator
from .base import RoutineController, Travel
from .routines import arguments, limited, rate, returned


@dataclass(frozen=True)
class Gains:
    """Proportional [command per m or rad] and derivative gain [command s per m or rad].

    Attributes
    ----------
    proportional, derivative
    natural_frequency
        Of equation 12 [Hz]; NaN where the mass is not known, as is the next.
    damping_ratio
        Of equation 16.
    """

    proportional: float
    derivative: float
    natural_frequency: float = nan
    damping_ratio: float = nan

    @classmethod
    def of(
        cls, mass: float, damping: float, leverage: float, proportional: float, derivative: float
    ) -> Self:
        """Gains with what they come to on a plant of that mass, damping and force per command."""
        stiffness = proportional * leverage
        ratio = 0.5 * (damping + derivative * leverage) / sqrt(mass * stiffness)
        return cls(proportional, derivative, sqrt(stiffness / mass) / (2.0 * pi), ratio)

    @classmethod
    def for_ramp(
        cls, mass: float, damping: float, leverage: float, *,
        slope: float, error: float, damping_ratio: float,
    ) -> Self:  # fmt: skip
        """Gains that leave ``error`` [m] behind a ramp of ``slope`` [m/s] (equation 15).

        ``mass`` and ``damping`` are those of the plant, ``leverage`` its force per command.

        Raises
        ------
        UsageError
            When the plant has no damping: then any gain leaves less.
        """
        if damping <= 0.0:
            raise UsageError(
                "controller.ramp_error gives no gain: the machine has no viscous friction, and "
                "leaves no error behind a ramp",
                remedy="Give controller.proportional or controller.bandwidth.",
            )
        return cls._damped(mass, damping, leverage, slope * damping / error, damping_ratio)

    @classmethod
    def for_bandwidth(
        cls, mass: float, damping: float, leverage: float, *,
        bandwidth: float, damping_ratio: float,
    ) -> Self:  # fmt: skip
        """Gains with the natural frequency ``bandwidth`` [Hz] of equation 12."""
        stiffness = mass * (2.0 * pi * bandwidth) ** 2
        return cls._damped(mass, damping, leverage, stiffness, damping_ratio)

    @classmethod
    def with_damping(
        cls, mass: float, damping: float, leverage: float, *,
        proportional: float, damping_ratio: float,
    ) -> Self:  # fmt: skip
        """A given proportional gain, with the derivative gain of equation 16."""
        return cls._damped(mass, damping, leverage, proportional * leverage, damping_ratio)

    @classmethod
    def _damped(
        cls, mass: float, damping: float, leverage: float, stiffness: float, ratio: float
    ) -> Self:
        derivative = max(2.0 * ratio * sqrt(mass * stiffness) - damping, 0.0)
        return cls.of(mass, damping, leverage, stiffness / leverage, derivative / leverage)


@dataclass(frozen=True)
class StaticFriction:
    """Levels added at rest [command], and the speed below which it is rest [1/s]: (17), (18)."""

    positive: float = 0.0
    negative: float = 0.0
    tolerance: float = 0.0


class PDController(RoutineController):
    """The controller of the hydrostatic rig.

    Parameters
    ----------
    gains
    travel
        Of what is measured and controlled.
    sample_time
        [s]
    friction
        What is added at rest.
    cutoff
        Of the velocity filter [Hz].
    limits
        Of the command.
    holding
        Command that keeps the machine where it starts; it is part of every command.
    """

    def __init__(
        self, gains: Gains, travel: Travel, sample_time: float,
        friction: StaticFriction = StaticFriction(), *,
        cutoff: float = 10.0, limits: tuple[float, float] = (-inf, inf), holding: float = 0.0,
    ) -> None:  # fmt: skip
        super().__init__(sample_time, travel, limits)
        self.gains, self.friction = gains, friction
        self.cutoff, self.holding = cutoff, holding
        self.begins = (self.limit(holding),)

    def routines(self, unit: str = "") -> tuple[Routine, ...]:
        """The command against the deviation; see :meth:`RoutineController.routines`."""
        draft = Draft("step", "Command of this sample.", unit, self.sample_time, careful=True)
        reference, measured = map(draft.argument, arguments(self.travel))
        error = draft.let("error", reference - measured)
        command = constant("proportional", self.gains.proportional) * error
        if self.gains.derivative:
            damping = rate(draft, "error_rate", error, self.cutoff, self.sample_time)
            command = command + constant("derivative", self.gains.derivative) * damping
        if self.holding:
            command = command + constant("holding", self.holding)
        f = self.friction
        if f.tolerance > 0.0 and (f.positive or f.negative):
            speed = rate(draft, "speed", measured, self.cutoff, self.sample_time)
            up, down = (
                constant("friction_positive", f.positive),
                constant("friction_negative", -f.negative),
            )
            push = by_sign(error, up, down, jumps=True)
            slow = constant("velocity_tolerance", f.tolerance)
            command = command + choose(abs(speed), "<", slow, push, 0.0, jumps=True)
        return (returned(draft, limited(command, self.limits), self.begins[0]),)

    def linear(self) -> System:
        """From the error to the command; see :meth:`.Controller.linear`."""
        gains = self.gains
        speed = differentiator(self.cutoff, self.sample_time)
        return speed.scaled(np.array([gains.derivative]), np.array([gains.proportional]))
