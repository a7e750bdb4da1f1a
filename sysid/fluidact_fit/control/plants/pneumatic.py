"""A double-acting pneumatic cylinder behind pressure valves and long lines.

    m x'' = P1 A1 - P2 A2 - P_atm A_r - b x' - F_c sgn x' - F_e                (19, 22)
    P_i = G_line G_valve u_i + offset                                           (20, 21)

with a valve of second order and a line of first order with dead time. Where the volume ``V_i`` of
chamber and line is given, the gas is pressed as the piston moves, at constant temperature:

    P_i' = (G_line's right side) -+ P_i0 A_i / V_i x',

linear about the pressure ``P_i0`` of rest: this is the natural compliance that the set sum of the
pressures changes [1]_. Without volumes the pressures do not feel the piston, as in the equations
printed.

References
----------
.. [1] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   equations 19 to 23 and section 5.3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...block import Port
from ...estimation.sampled import Sampled, sample
from ...experiment import FloatArray
from ...mechanics.body import Body, Dynamics
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.tissue import Tissue
from .base import UNLIMITED, Limits, Plant
from .delay import HeldCommands
from .linear import Chain


@dataclass(frozen=True)
class Chamber:
    """Supply and area [m2] of a chamber; offset of the pressure [Pa]; volume [m3] or ``None``."""

    supply: Chain
    area: float
    offset: float = 0.0
    volume: float | None = None


@dataclass(frozen=True)
class Cylinder:
    """Mass [kg], friction, both chambers, and the pressure around them [Pa].

    ``atmosphere`` is 0 where the pressures are counted from it. ``sum_of_pressures`` [Pa] is what
    the chambers have together at rest.
    """

    mass: float
    friction: FrictionLaw
    chambers: tuple[Chamber, Chamber]
    atmosphere: float
    sum_of_pressures: float

    @property
    def bias(self) -> float:
        """Force of the atmosphere on the rod [N]."""
        return self.atmosphere * (self.chambers[0].area - self.chambers[1].area)

    def rest(self) -> tuple[float, float]:
        """Pressures that push neither way [Pa] (equation 22 without force)."""
        one, two = self.chambers
        first = (self.sum_of_pressures * two.area + self.bias) / (one.area + two.area)
        return first, self.sum_of_pressures - first


class PneumaticPlant(Plant):
    """Position of a :class:`Cylinder`; commands are those of the two valves."""

    anywhere = True

    def __init__(
        self, cylinder: Cylinder, command: Port, sample_time: float,
        tissue: Tissue | None = None, *, limits: tuple[Limits, Limits] = (UNLIMITED, UNLIMITED),
    ) -> None:  # fmt: skip
        self.cylinder, self.sample_time, self.limits = cylinder, sample_time, limits
        self.commands = (
            Port(f"{command.role}_1", command.unit), Port(f"{command.role}_2", command.unit)
        )  # fmt: skip
        self.controlled = Port("position", "m")
        self._states, start = [], 2
        for chamber in cylinder.chambers:
            self._states.append(slice(start, start + chamber.supply.b.size))
            start += chamber.supply.b.size
        self._inputs = slice(start, start + 2)
        self._size = start + 3
        drive, actuator = self._drive(), self._actuator()
        self.body = Body(
            Dynamics(cylinder.mass, cylinder.friction, drive, actuator, sample_time, tissue)
        )
        self._held = HeldCommands([c.supply.dead_time for c in cylinder.chambers], sample_time)

    def _drive(self) -> FloatArray:
        row = np.zeros(self._size)
        row[-1] = -self.cylinder.bias
        for chamber, states, sign in zip(self.cylinder.chambers, self._states, (1.0, -1.0)):
            row[states] = sign * chamber.area * chamber.supply.c
            row[-1] += sign * chamber.area * chamber.offset
        return row

    def _actuator(self) -> FloatArray:
        matrix = np.zeros((self._size, self._size))
        parts = zip(self.cylinder.chambers, self._states, self.cylinder.rest(), (1.0, -1.0))
        for number, (chamber, states, pressure, sign) in enumerate(parts):
            matrix[states, states] = chamber.supply.a
            matrix[states, self._inputs.start + number] = chamber.supply.b
            if chamber.volume is not None:
                pressed = sign * pressure * chamber.area / chamber.volume
                # the last link's first state is the pressure of the chamber
                matrix[states, 1] -= pressed * chamber.supply.c
        return matrix

    def reset(self, output: float = 0.0, commands: Sequence[float] = ()) -> None:
        """Be at rest there, with both chambers at the pressures that push neither way."""
        state = np.zeros(self._size)
        state[0], state[-1] = output, 1.0
        parts = zip(self.cylinder.chambers, self._states, self.cylinder.rest())
        for number, (chamber, states, pressure) in enumerate(parts):
            command = (pressure - chamber.offset) / chamber.supply.gain
            state[self._inputs.start + number] = command
            state[states] = chamber.supply.rest(command)
        self.body.reset(state)
        self._held.reset(state[self._inputs].tolist())

    def measure(self) -> Mapping[str, float]:
        """Position, speed, pressures of the chambers, and the force of the tissue."""
        z = self.body.state
        found = {
            f"pressure_{i}": float(chamber.supply.c @ z[states]) + chamber.offset
            for i, (chamber, states) in enumerate(zip(self.cylinder.chambers, self._states), 1)
        }
        place = {"position": float(z[0]), "speed": float(z[1])}
        return {**place, **found, "resistance": self.body.resistance}

    def _advance(self, command: Sequence[float]) -> None:
        for span, values in self._held.send(command):
            self.body.state[self._inputs] = values
            self.body.advance(span)

    def linear(self) -> tuple[tuple[Sampled, ...], ...]:
        """The cylinder behind each valve, without its dry friction."""
        law, mass = self.cylinder.friction, self.cylinder.mass
        n = self._inputs.start
        a = self._actuator()
        a[0, 1], a[1] = 1.0, self._drive() / mass
        a[1, 1] -= 0.5 * (law.viscous_positive + law.viscous_negative) / mass
        c = np.eye(n)[0]
        return (
            tuple(
                sample(a[:n, :n], a[:n, n + i], c, chamber.supply.dead_time, self.sample_time)
                for i, chamber in enumerate(self.cylinder.chambers)
            ),
        )
