"""A mass with dry friction that a torque or a force drives: ball screw, hydrostatic line, or both.

Ball screw and hydrostatic transmission are one rigid body (equation 11 of the thesis [1]_)

    T = J r x'' + C + h (m x'' + c x' + F_f + F_e),     r = 2 pi n / l,

where ``h`` [m] is torque per force of the screw and ``r`` [rad/m] the angle of the motor per
travel. Divided by ``h``, this is a mass ``M = J r / h + m`` with friction ``b r / h + c`` and
``C / h + F_f``. What a lossless screw would have, ``h = 1 / r``, is not assumed: the value that
the thesis found is half as large again.

The dead zone of a hydrostatic line is taken for its dry friction ``F_f``: it is the same where
the motion is driven slowly compared with ``m / c``.

References
----------
.. [1] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   equations 8 to 11.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...block import Port
from ...estimation.friction_law import FrictionLaw
from ...estimation.sampled import Sampled, sample
from ...experiment import FloatArray
from .base import Plant
from .body import Body, Dynamics
from .delay import HeldCommands
from .tissue import Tissue


@dataclass(frozen=True)
class Drive:
    """Mass [kg or kg m2], friction, spring [N/m], force per command, and dead time [s]."""

    mass: float
    friction: FrictionLaw
    leverage: float = 1.0
    stiffness: float = 0.0
    dead_time: float = 0.0

    @property
    def damping(self) -> float:
        """Viscous friction, mean of both directions [N s/m or N m s/rad]."""
        return 0.5 * (self.friction.viscous_positive + self.friction.viscous_negative)


def rigid_line(values: Mapping[str, float]) -> Drive:
    """Take the parameters of a hydrostatic line for a mass with dry friction."""
    viscous = values["damping"]
    law = FrictionLaw(
        values.get("dead_zone_positive", 0.0), -values.get("dead_zone_negative", 0.0),
        viscous, viscous,
    )  # fmt: skip
    return Drive(
        values["mass"], law, stiffness=values.get("stiffness", 0.0),
        dead_time=values.get("dead_time", 0.0),
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
    """
    screw, far = FrictionLaw.of(values), line.friction
    viscous = transmission / lever
    law = FrictionLaw(
        screw.coulomb_positive / lever + far.coulomb_positive,
        screw.coulomb_negative / lever + far.coulomb_negative,
        screw.viscous_positive * viscous + far.viscous_positive,
        screw.viscous_negative * viscous + far.viscous_negative,
        screw.breakaway_positive / lever + far.breakaway_positive,
        screw.breakaway_negative / lever + far.breakaway_negative,
        screw.stribeck / lever, screw.stribeck_speed / transmission, joined=screw.joined,
    )  # fmt: skip
    mass = values["inertia"] * transmission / lever + line.mass
    return Drive(mass, law, 1.0 / lever, line.stiffness, line.dead_time)


class DrivePlant(Plant):
    """Position or angle of a :class:`Drive`, with tissue in its way."""

    def __init__(
        self, drive: Drive, command: Port, controlled: Port, sample_time: float,
        tissue: Tissue | None = None,
    ) -> None:  # fmt: skip
        self.drive, self.sample_time = drive, sample_time
        self.commands, self.controlled = (command,), controlled
        row = np.array([-drive.stiffness, 0.0, drive.leverage, 0.0])  # x, v, command, 1
        self.body = Body(
            Dynamics(drive.mass, drive.friction, row, np.zeros((4, 4)), sample_time, tissue)
        )
        self._held = HeldCommands([drive.dead_time], sample_time)

    def reset(self, output: float = 0.0) -> None:
        """Be at rest there, without a command."""
        self.body.reset(np.array([output, 0.0, 0.0, 1.0]))
        self._held.reset([0.0])

    def measure(self) -> Mapping[str, float]:
        """Position or angle, its velocity, and the force of the tissue."""
        return {
            self.controlled.role: float(self.body.state[0]),
            "speed": float(self.body.state[1]),
            "resistance": self.body.resistance,
        }

    def advance(self, command: Sequence[float]) -> None:
        """Hold the torque or force for one sample."""
        for span, (value,) in self._held.send(command):
            self.body.state[2] = value
            self.body.advance(span)

    @cached_property
    def _linear(self) -> Sampled:
        """The drive without its dry friction."""
        d = self.drive
        a = np.array([[0.0, 1.0], [-d.stiffness / d.mass, -d.damping / d.mass]])
        b, c = np.array([0.0, d.leverage / d.mass]), np.array([1.0, 0.0])
        return sample(a, b, c, d.dead_time, self.sample_time)

    def response(self, z: complex) -> FloatArray:
        """Response of the position to the command; dry friction apart."""
        return np.array([self._linear.response(z)])
