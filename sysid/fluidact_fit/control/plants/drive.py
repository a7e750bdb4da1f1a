"""A mass with dry friction that a torque or a force drives: ball screw, hydrostatic line, or both.

Ball screw and hydrostatic transmission are one rigid body (equation 11 of the thesis [1]_)

    T = J r x'' + C + h (m x'' + c x' + F_f + F_e),     r = 2 pi n / l,

where ``h`` [m] is torque per force of the screw and ``r`` [rad/m] the angle of the motor per
travel. Divided by ``h``, this is a mass ``M = J r / h + m`` with friction ``b r / h + c`` and
``C / h + F_f``. What a lossless screw would have, ``h = 1 / r``, is not assumed: the value that
the thesis found is half as large again.

The hydrostatic line is the one of its file: a dead zone for the force that moves it, and no dry
friction. Behind a screw both are one body with that dead zone inside (``mechanics.body``).

References
----------
.. [1] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   equations 8 to 11.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...block import Port
from ...errors import UsageError
from ...estimation.sampled import Sampled, sample
from ...mechanics.body import Body, Dynamics
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.tissue import Tissue
from .base import UNLIMITED, Limits, Plant
from .delay import HeldCommands


@dataclass(frozen=True)
class Drive:
    """A mass that a command moves.

    Attributes
    ----------
    mass
        All of it [kg or kg m2].
    friction
        Ahead of the dead zone.
    leverage
        Force per command.
    stiffness, damping
        Of what is moved, without dry friction [N/m, N s/m].
    dead_time
        Of the command [s].
    edges
        Dead zone for the force that moves it [N]; ``None`` without one.
    ahead
        Part of the mass that is ahead of the dead zone [kg].
    """

    mass: float
    friction: FrictionLaw
    leverage: float = 1.0
    stiffness: float = 0.0
    dead_time: float = 0.0
    damping: float = 0.0
    edges: tuple[float, float] | None = None
    ahead: float = 0.0

    @property
    def viscous(self) -> float:
        """All viscous friction, mean of both directions [N s/m or N m s/rad]."""
        law = self.friction
        return self.damping + 0.5 * (law.viscous_positive + law.viscous_negative)

    @property
    def static(self) -> tuple[float, float]:
        """Command that it takes to move it from rest, forward and backward, as magnitudes."""
        low, high = self.edges or (0.0, 0.0)
        law = self.friction
        return (
            (law.breakaway_positive + high) / self.leverage,
            (law.breakaway_negative - low) / self.leverage,
        )

    def holding(self, output: float) -> float:
        """Command that keeps it at rest against its spring."""
        load, (low, high) = self.stiffness * output, self.edges or (0.0, 0.0)
        edge = high if load > 0.0 else low if load < 0.0 else 0.0
        return (load + edge) / self.leverage


def rigid_line(values: Mapping[str, float]) -> Drive:
    """Take the parameters of a hydrostatic line."""
    edges = values.get("dead_zone_negative", 0.0), values.get("dead_zone_positive", 0.0)
    return Drive(
        values["mass"], FrictionLaw(0.0, 0.0), stiffness=values.get("stiffness", 0.0),
        dead_time=values.get("dead_time", 0.0), damping=values["damping"],
        edges=edges if any(edges) else None,
    )  # fmt: skip


def behind_screw(
    values: Mapping[str, float], line: Drive, lever: float, transmission: float
) -> Drive:
    """A line moved by a ball screw, as one mass that a torque drives (equation 11).

    Parameters
    ----------
    values
        Of the ball screw: ``inertia`` [kg m2] and friction [N m].
    line
    lever
        ``h``, torque per force of the screw [m].
    transmission
        ``r``, angle of the motor per travel [rad/m].

    Raises
    ------
    UsageError
        When friction of the screw falls with the speed and the line has a dead zone.
    """
    screw = FrictionLaw.of(values)
    if screw.curved and line.edges is not None:
        raise UsageError(
            "a screw whose friction falls with the speed cannot be put before a line with a dead "
            "zone: no solver here follows both",
            remedy="Fit the screw with --stribeck none for this loop.",
        )
    viscous = transmission / lever
    law = FrictionLaw(
        screw.coulomb_positive / lever, screw.coulomb_negative / lever,
        screw.viscous_positive * viscous, screw.viscous_negative * viscous,
        screw.breakaway_positive / lever, screw.breakaway_negative / lever,
        screw.stribeck / lever, screw.stribeck_speed / transmission, joined=screw.joined,
    )  # fmt: skip
    ahead = values["inertia"] * transmission / lever
    return replace(line, mass=ahead + line.mass, friction=law, leverage=1.0 / lever, ahead=ahead)


class DrivePlant(Plant):
    """Position or angle of a :class:`Drive`, with tissue in its way."""

    def __init__(
        self, drive: Drive, command: Port, controlled: Port, sample_time: float,
        tissue: Tissue | None = None, *, limits: Limits = UNLIMITED,
    ) -> None:  # fmt: skip
        self.drive, self.sample_time = drive, sample_time
        self.commands, self.controlled, self.limits = (command,), controlled, (limits,)
        self.anywhere = drive.stiffness == 0.0
        row = np.array([0.0, 0.0, drive.leverage, 0.0])  # x, v, command, 1
        self.body = Body(
            Dynamics(
                drive.mass, drive.friction, row, np.zeros((4, 4)), sample_time, tissue,
                drive.stiffness, drive.damping, drive.edges, drive.ahead,
            )
        )  # fmt: skip
        self._held = HeldCommands([drive.dead_time], sample_time)

    def reset(self, output: float = 0.0, commands: Sequence[float] = (0.0,)) -> None:
        """Be at rest there, under a command."""
        held = self.within(commands)
        self.body.reset(np.array([output, 0.0, *held, 1.0]))
        self._held.reset(held)

    def measure(self) -> Mapping[str, float]:
        """Position or angle, its velocity, and the force of the tissue."""
        return {
            self.controlled.role: float(self.body.state[0]),
            "speed": float(self.body.state[1]),
            "resistance": self.body.resistance,
        }

    def _advance(self, command: Sequence[float]) -> None:
        for span, (value,) in self._held.send(command):
            self.body.state[2] = value
            self.body.advance(span)

    def linear(self) -> tuple[tuple[Sampled, ...], ...]:
        """The drive without its dry friction and its dead zone."""
        d = self.drive
        a = np.array([[0.0, 1.0], [-d.stiffness / d.mass, -d.viscous / d.mass]])
        b, c = np.array([0.0, d.leverage / d.mass]), np.array([1.0, 0.0])
        return ((sample(a, b, c, d.dead_time, self.sample_time),),)
