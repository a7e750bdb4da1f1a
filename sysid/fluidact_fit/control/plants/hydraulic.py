"""A double-acting hydraulic cylinder behind a servo valve: pressures, motion, dry friction.

The equations are those that were fitted (:mod:`fluidact_fit.mechanics.hydraulic_cylinder`),
followed by events in steps that the oil asks for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil

import numpy as np

from ...block import Port
from ...errors import UsageError
from ...estimation.sampled import Sampled, sample
from ...mechanics.coupled import InPlace, linearised, motion
from ...mechanics.hybrid import check_steps
from ...mechanics.hydraulic_cylinder import EDGES, SYSTEM, HydraulicMachine, parameter_vector
from .base import UNLIMITED, Limits, Plant

_OPENING = 1e-3  # of the valve beyond its dead zone, where the cylinder is taken for linear [V]


class HydraulicPlant(Plant):
    """Position of the cylinder of a file; the command is that of its valve [V].

    Parameters
    ----------
    machine, values
        What is given, complete, and the parameters [SI].
    """

    def __init__(
        self, machine: HydraulicMachine, values: Mapping[str, float], command: Port,
        sample_time: float, *, limits: Limits = UNLIMITED,
    ) -> None:  # fmt: skip
        self.machine, self.sample_time, self.limits = machine, sample_time, (limits,)
        self.commands, self.controlled = (command,), Port("position", "m")
        self.edges = values[EDGES[0]], values[EDGES[1]]
        rate = machine.step_rate(values)
        check_steps(1.0 / rate, sample_time)
        self.steps = ceil(rate * sample_time)
        self._run = InPlace(motion(SYSTEM, 1, 1))
        self._parameters = parameter_vector(values, machine)
        self._run.arguments[2][:, 0] = self._parameters
        self.reset()

    def reset(self, output: float = 0.0, commands: Sequence[float] = ()) -> None:
        """Be at rest there with the valve closed."""
        self._state = self.machine.at_rest(output)

    def measure(self) -> Mapping[str, float]:
        """Position, speed and both pressures."""
        p1, p2, y, v = self._state.tolist()
        return {"position": y, "speed": v, "pressure_1": p1, "pressure_2": p2}

    def _advance(self, command: Sequence[float]) -> None:
        state, held, _ = self._run.arguments
        state[:, 0] = self._state
        held[:, 0] = command[0], self.sample_time / self.steps
        for _ in range(self.steps):
            state[:] = self._run()
        self._state = state[:, 0].copy()
        place = self._state[2]
        if not all(self.machine.volume(i, place) > 0.0 for i in (1, 2)):
            raise UsageError(
                f"the piston is at {place:.4g} m, beyond where a chamber holds oil",
                remedy="Choose a smaller reference or smaller gains, or limit the command.",
            )

    def linear(self) -> tuple[tuple[Sampled, ...], ...]:
        """About a slow motion each way, the valve just open and the piston at position 0."""
        return tuple((self._about(way),) for way in (-1, 1))

    def _about(self, way: int) -> Sampled:
        command = self.edges[way > 0] + way * _OPENING
        a, b = linearised(SYSTEM, self.machine.at_rest(0.0), command, self._parameters, way)
        return sample(a, b, np.eye(4)[2], 0.0, self.sample_time)
