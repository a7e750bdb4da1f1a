"""Force of the cylinder, and the command for a wanted force."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy.typing as npt

from ...block import Block, as_motion_state
from ...experiment import Experiment, FloatArray
from ...routines import Argument, Draft, Routine, constant
from .data import prepare
from .equation import SpringLaw
from .options import SpringOptions

_Array = npt.ArrayLike


class SpringCylinderBlock(Block):
    """Force of the cylinder, and the command for a wanted force.

    ``direction`` is the motion state: 1 loading, -1 unloading, 0 the middle of both.
    """

    @cached_property
    def _law(self) -> SpringLaw:
        return SpringLaw.of(self.numbers())

    def __call__(
        self, drive: _Array, position: _Array, direction: _Array = 0.0, velocity: _Array = 0.0
    ) -> FloatArray:
        """Force [N] at a command [V] or pressure [Pa], position [m] and velocity [m/s].

        With a Stribeck rise friction at velocity 0 is that of the slowest motion.
        """
        self.watch(**{self.variant.name: drive, "position": position})
        return self._law.force(drive, position, as_motion_state(direction), velocity)

    def inverse(
        self, force: _Array, position: _Array, direction: _Array = 0.0, velocity: _Array = 0.0
    ) -> FloatArray:
        """Command [V] or pressure [Pa] for a wanted force [N]; exact."""
        self.watch(force=force, position=position)
        return self._law.command(force, position, as_motion_state(direction), velocity)

    def methods(self) -> Mapping[str, Callable[..., Any]]:
        """Both of them; see :meth:`.Block.methods`."""
        return {"force": self, "command_for": self.inverse}

    def routines(self) -> Sequence[Routine]:
        """Force of the rod, and the command or pressure for a wanted force."""
        law, role = self._law, self.variant.driving[0].name
        drive = self.argument(role, "what drives the cylinder")
        position = self.argument("position", "compression of the spring")
        velocity = self.rate_argument("velocity", "position", "velocity of the rod")
        direction = Argument("direction", "1", "1 loading, -1 unloading, 0 between", -1.0, 1.0)
        force = Draft("force", "Force of the rod.", "N")
        u, x, s, v = map(force.argument, (drive, position, direction, velocity))
        command = Draft("command_for", "What drives the cylinder to a wanted force.", drive.unit)
        wanted = command.argument(self.argument("force", "wanted force of the rod"))
        lost = law.routine_lost(*map(command.argument, (position, direction, velocity)))
        return (
            force.returns(constant("gain", law.gain) * u - law.routine_lost(x, s, v)),
            command.returns((wanted + lost) * constant("per_gain", 1.0 / law.gain)),
        )

    def predict(self, experiment: Experiment) -> FloatArray:
        """Force from command or pressure and motion; see :meth:`Block.predict`."""
        options = self.document.settled_options(SpringOptions)
        (run,), _ = prepare(self.variant, [experiment], options)
        return run.predict(self._law)
