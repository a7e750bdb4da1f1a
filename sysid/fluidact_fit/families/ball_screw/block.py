"""A drive with dry friction: stick-slip, stepped exactly once per sample."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from math import sqrt
from typing import Any

import numpy as np
import numpy.typing as npt

from ...block import DryDrive, DryDriveBlock, Port, SampleSimulator
from ...errors import UsageError
from ...estimation.inputs import make_signal
from ...experiment import Experiment, FloatArray, Hold
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.held import HeldMass
from ...routines import Argument, Draft, Routine, by_sign, constant, maximum, minimum
from ...specification import scalars
from .model import BREAKAWAY, SPEED, DriveModel, axis_of


class DriveBlock(DryDriveBlock, SampleSimulator):
    """A mass or inertia with viscous and dry friction.

    ``J v' = tau - b v - F_k(sign v)`` while it moves, with friction that falls from the static
    to the kinetic level where the file has a ``stribeck_speed``; it rests while the input stays
    between the static levels. Break-away and stop are solved inside the sample.

    Attributes
    ----------
    position, velocity
        State at the instant of the latest :meth:`step` and thereafter: where the next
        step begins [unit of the output, and per second].
    """

    def _begin(self) -> None:
        self.reset()

    @cached_property
    def inertia(self) -> float:
        """Inertia [kg m2] or mass [kg]."""
        name = axis_of(self.variant).inertia
        return scalars({name: self.parameters[name]})[name]

    @cached_property
    def _law(self) -> FrictionLaw:
        """Friction at rest and in motion."""
        return FrictionLaw.of(self.numbers())

    @cached_property
    def _moving(self) -> FrictionLaw:
        """Friction in motion: without a curve it can be known while the static levels are not."""
        curve = scalars({n: self.parameters[n] for n in self.parameters if n == SPEED})
        if curve.get(SPEED, 0.0) > 0.0:
            return self._law
        known = [n for n in self.parameters if n not in BREAKAWAY.values()]
        return FrictionLaw.of(scalars({n: self.parameters[n] for n in known}))

    @cached_property
    def _mass(self) -> HeldMass:
        return HeldMass(self.inertia, self._law)

    def dry_drive(self) -> DryDrive:
        """Return inertia and friction as plain numbers."""
        law, name = self._law, axis_of(self.variant).inertia
        if law.curved:
            raise UsageError(
                "the file has friction that falls with the speed, which the plant of this format "
                "does not know",
                remedy="Export to another format, or fit with --stribeck none.",
            )
        return DryDrive(
            self.inertia, Port(name, self.document.parameters[name].unit),
            (law.viscous_negative, law.viscous_positive),
            (law.coulomb_negative, law.coulomb_positive),
            (law.breakaway_negative, law.breakaway_positive),
        )  # fmt: skip

    def reset(self, *, output: float | None = None, velocity: float = 0.0) -> None:
        """Put the drive at a position [unit of the output], at rest or moving."""
        self.position = 0.0 if output is None else float(output)
        self.velocity = float(velocity)

    def _step(self, value: float) -> float:
        """Hold the input for one sample time, and return the position before that."""
        self._need_sample_time("sample time")
        now = self.position
        self.position, self.velocity = self._mass.advance(
            now, self.velocity, value, self.sample_time
        )
        return now

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
            Moving: ``b v`` plus the dry friction at that speed, with the sign of the velocity. At
            rest: what is balanced, at most the static level.
        """
        if velocity != 0.0:
            return float(self._moving.moving(velocity))
        return float(self._law.at_rest(torque))

    def methods(self) -> Mapping[str, Callable[..., Any]]:
        """Feed-forward and friction; see :meth:`.Block.methods`."""
        return {"feedforward": self.feedforward, "friction": self.friction}

    def routines(self) -> Sequence[Routine]:
        """Feed-forward of a wanted motion, and friction in motion and at rest."""
        output = self.output
        drive = self.argument(self._port(self.variant.driving[0]).role, "input of the drive")
        low, high, _ = self._range(output.role)
        return routines_of(self._law, self._moving, self.inertia, drive, output, high - low)

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
        law = self._moving
        viscous = law.viscous_positive if way > 0.0 else law.viscous_negative
        level = float(law.moving(velocity, way)) - viscous * velocity
        share = min(abs(velocity) / band, 1.0) if band > 0.0 else 1.0
        return self.inertia * acceleration + viscous * velocity + level * share

    def simulate_samples(
        self,
        values: npt.ArrayLike,
        time: npt.ArrayLike | None = None,
        *,
        hold: Hold = "zoh",
        before: float | None = None,
        output: float | None = None,
        velocity: float = 0.0,
    ) -> FloatArray:
        """Simulate a whole record; see :meth:`.SampleSimulator.simulate_samples`.

        ``output`` and ``velocity`` are position and velocity at the first instant, 0 when left out.
        ``before`` is not used: the drive has no dead time.
        """
        if time is None:
            self._need_sample_time("sample time")
            time = np.arange(np.size(values)) * self.sample_time
        role = self.variant.driving[0]
        self.watch(**{role.name: values})
        signal = make_signal(role.name, values, time, role.unit, hold)
        place = output or 0.0
        if signal.time.size == 1:
            return np.array([place])
        run = Experiment("record", 0, signal.time, {role.name: signal}, 0.0, False)
        return place + self._follow(run, velocity, logged=False)

    def predict(self, experiment: Experiment) -> FloatArray:
        """Position from the input of an experiment, from rest; see :meth:`.Block.predict`."""
        return self._follow(experiment, 0.0, logged=True)

    def _follow(self, experiment: Experiment, velocity: float, *, logged: bool) -> FloatArray:
        model = DriveModel([experiment], axis_of(self.variant), logged=logged)
        return np.real(model.columns(0, {**self.numbers(), "initial_speed[0]": velocity}).known)


def reach_of(
    law: FrictionLaw, inertia: float, drive: tuple[float, float], travel: float
) -> tuple[float, float]:
    """Velocities [per second] that the drive of the logs can give over the way they covered.

    The steady one against friction, or that of the whole way under full drive where that is less.
    """
    ends = []
    for level, viscous, most in (
        (law.coulomb_negative, law.viscous_negative, -drive[0]),
        (law.coulomb_positive, law.viscous_positive, drive[1]),
    ):
        net = max(most - level, 1e-3 * max(most, level, 1e-12))
        free = sqrt(2.0 * net * travel / inertia)
        ends.append(min(net / viscous, free) if viscous > 0.0 else free)
    return -ends[0], ends[1]


def routines_of(
    law: FrictionLaw, moving: FrictionLaw, inertia: float, drive: Argument, output: Port,
    travel: float,
) -> Sequence[Routine]:  # fmt: skip
    """Return the routines; ``moving`` is the law without static levels."""
    low, high = reach_of(moving, inertia, (drive.low, drive.high), travel)
    velocity = Argument(
        "velocity", f"{output.unit}/s", "wanted velocity", low, high, recorded=False
    )
    most = max(drive.high, -drive.low) / inertia
    acceleration = Argument(
        "acceleration", f"{output.unit}/s2", "wanted acceleration", -most, most, recorded=False
    )
    ahead = Draft(
        "feedforward", "Input for a wanted motion: inertia, viscous and kinetic friction.",
        drive.unit,
    )  # fmt: skip
    v, a = ahead.argument(velocity), ahead.argument(acceleration)
    forward, backward = (float(moving.moving(0.0, way)) for way in (1.0, -1.0))
    starting = by_sign(
        a, constant("starting_positive", forward), constant("starting_negative", backward)
    )
    friction = Draft(
        "friction", "Friction against the motion; at rest what it balances.", drive.unit
    )
    speed, load = friction.argument(velocity), friction.argument(drive)
    at_rest = minimum(
        maximum(load, constant("breakaway_negative", -law.breakaway_negative)),
        constant("breakaway_positive", law.breakaway_positive),
    )
    return (
        ahead.returns(moving.routine_value(v, starting) + inertia * a),
        friction.returns(law.routine_value(speed, at_rest)),
    )
