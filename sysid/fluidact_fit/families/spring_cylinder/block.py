"""Force of the cylinder, and the command for a wanted force."""

from __future__ import annotations

from functools import cached_property

import numpy.typing as npt

from ...block import Block
from ...experiment import Experiment, FloatArray
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
        """Force [N] at a command [V] or pressure [Pa], position [m] and velocity [m/s]."""
        return self._law.force(drive, position, direction, velocity)

    def inverse(
        self, force: _Array, position: _Array, direction: _Array = 0.0, velocity: _Array = 0.0
    ) -> FloatArray:
        """Command [V] or pressure [Pa] for a wanted force [N]; exact."""
        return self._law.command(force, position, direction, velocity)

    def predict(self, experiment: Experiment) -> FloatArray:
        """Force from command or pressure and motion; see :meth:`Block.predict`."""
        options = self.document.settled_options(SpringOptions)
        (run,), _ = prepare(self.variant, [experiment], options)
        return run.predict(self._law)
