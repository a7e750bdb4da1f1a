"""A drive with dry friction: stick-slip, stepped exactly once per sample."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from math import inf, log1p

import numpy as np
import numpy.typing as npt

from ...block import DryDrive, DryDriveBlock, Port
from ...errors import UsageError
from ...estimation.inputs import make_signal
from ...experiment import Experiment, FloatArray, Hold
from ...mechanics.curved import Slide, slide_of
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.motion import Levels
from ...mechanics.phi import phi_real
from ...routines import Routine
from ...specification import scalars
from .model import BREAKAWAY, SPEED, DriveModel, axis_of


class DriveBlock(DryDriveBlock):
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
    def _slides(self) -> dict[int, Slide]:
        """Motion under the curve, by direction; none without one."""
        law = self._law
        if not law.curved:
            return {}
        levels = Levels(
            self.inertia, (law.viscous_positive, law.viscous_negative),
            (law.coulomb_positive, law.coulomb_negative),
            (law.breakaway_positive, law.breakaway_negative), law.stribeck_speed,
        )  # fmt: skip
        return {way: slide_of(levels, way) for way in (1, -1)}

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
        rest = self.sample_time
        for _ in range(4):  # a held input: moving, stopped, moving the other way
            rest = self._move(value, rest)
            if rest <= 0.0:
                break
        return now

    def _move(self, drive: float, span: float) -> float:
        """Advance until the span ends or the motion stops; returns what is left of it [s]."""
        v, law = self.velocity, self._law
        forward = v > 0.0 if v != 0.0 else drive > law.breakaway_positive
        if v == 0.0 and not forward and drive >= -law.breakaway_negative:
            return 0.0
        if self._slides:
            return self._slide(1 if forward else -1, drive, span)
        viscous = law.viscous_positive if forward else law.viscous_negative
        net = drive - (law.coulomb_positive if forward else -law.coulomb_negative)
        stop = _time_to_stop(v, net, viscous, self.inertia)
        time = min(stop, span)
        rate = viscous / self.inertia
        one, two = phi_real(-rate * time, 2)
        push = net / self.inertia * time
        self.position += v * time * one + push * time * two
        if stop > span:
            self.velocity = v * (1.0 - rate * time * one) + push * one
            return 0.0
        self.velocity = 0.0
        return span - stop

    def _slide(self, way: int, drive: float, span: float) -> float:
        """Advance like :meth:`_move` where friction falls with the speed."""
        slide = self._slides[way]
        steps = slide.divide(abs(self.velocity), 0.0, span, slide.held(way * drive), span)
        self.position += way * sum(s.way for s in steps)
        self.velocity = way * steps[-1].after if steps else 0.0
        if not steps or steps[-1].after > 0.0:
            return 0.0
        return span - steps[-1].offset - steps[-1].span

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

    def routines(self) -> Sequence[Routine]:
        """Feed-forward of a wanted motion, and friction in motion and at rest."""
        from .routines import routines_of

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
            How the input moves between instants: ``"zoh"``, ``"foh"`` (straight lines),
            ``"smooth"`` or ``"auto"`` (smooth where the samples show it, else straight lines).
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


def _time_to_stop(v: float, net: float, viscous: float, inertia: float) -> float:
    """Time until a moving mass stops under a constant force [s], infinite when it never does."""
    if v == 0.0 or v * net >= 0.0:
        return inf
    x = -v * viscous / net
    factor = log1p(x) / x if x > 1e-9 else 1.0 - 0.5 * x
    return -v * inertia / net * factor
