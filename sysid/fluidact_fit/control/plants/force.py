"""Force of a single-acting cylinder against a sensor, its rod held in place by dry friction.

The rod does not move, so that friction is between its levels and the force rests until the drive
has gone through all of the hysteresis: with the branches ``F_l`` (loading) and ``F_u`` (unloading)
of the force over the drive,

    F = min(max(F, F_l(p)), F_u(p)),

the play of the seal on its two branches, which needs no more than the turning points of ``p(t)``
[1]_. They are solved for inside the sample. A parameter file that jumps from one branch to the
other as the motion state changes has the same branches.

References
----------
.. [1] M. A. Krasnosel'skii, A. V. Pokrovskii, "Systems with Hysteresis", 1989, chapter 2 (play).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ...block import Port
from ...mechanics.hybrid import Mode
from .base import UNLIMITED, Limits, Plant
from .delay import HeldCommands
from .linear import Chain

Branches = Callable[[float], tuple[float, float]]
"""Force of loading and of unloading [N] at a drive [V or Pa]."""
_TURNS = 64


class ForcePlant(Plant):
    """Force at a position that is held; the command goes through a valve, and a line.

    Parameters
    ----------
    branches
        Force of loading and of unloading over the drive, both rising.
    supply
        From the command to the drive; without links the drive is the command.
    offset
        Of the drive [its unit].
    position
        Where the rod is held [m].
    drive_unit
        Of the drive; that of the command where it is not given.
    """

    def __init__(
        self, branches: Branches, supply: Chain, command: Port, sample_time: float,
        *, offset: float = 0.0, position: float = 0.0, drive_unit: str | None = None,
        limits: Limits = UNLIMITED,
    ) -> None:  # fmt: skip
        self.units = {"drive": command.unit if drive_unit is None else drive_unit}
        self.commands, self.controlled, self.limits = (command,), Port("force", "N"), (limits,)
        self.sample_time, self.position = sample_time, position
        self._branches, self._supply, self._offset = branches, supply, offset
        n = supply.b.size
        matrix = np.zeros((n + 1, n + 1))  # states, command
        matrix[:n, :n], matrix[:n, n] = supply.a, supply.b
        self._row = np.append(supply.c, 0.0) if n else np.ones(1)
        rate = self._row @ matrix
        self._modes = {w: Mode(matrix, w * rate[None, :], sample_time) for w in (1, -1)}
        self._held = HeldCommands([supply.dead_time], sample_time)
        self.reset()

    @property
    def _drive(self) -> float:
        return float(self._row @ self._state) + self._offset

    def reset(self, output: float = 0.0, commands: Sequence[float] = ()) -> None:
        """Be at rest at the end of a slow loading by a command; without one, as near as can be."""
        (command,) = self.within(commands or (0.0,))
        state = np.array([command])
        if self._supply.b.size:
            state = np.append(self._supply.rest(command), command)
        self._state, self._way = state, 1
        self._held.reset([command])
        low, high = self._branches(self._drive)
        self.force = low if commands else min(max(output, low), high)

    def measure(self) -> Mapping[str, float]:
        """Force, position, and the drive that acts."""
        return {"force": self.force, "position": self.position, "drive": self._drive}

    def _advance(self, command: Sequence[float]) -> None:
        for span, (value,) in self._held.send(command):
            self._state[-1] = value
            for _ in range(_TURNS):
                self._state, span, turned = self._modes[self._way].advance(self._state, span)
                low, high = self._branches(self._drive)
                self.force = min(max(self.force, low), high)
                if turned is None:
                    break
                self._way = -self._way
