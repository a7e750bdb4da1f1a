"""The friction map that a controller calls."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ...block import Block
from ...experiment import Experiment, FloatArray
from ...mechanics.friction_law import FrictionLaw
from ...parameters.document import ParameterDocument
from ...routines import Argument, Draft, Routine, exp
from ...specification import Plant, Variant
from .axis import axis_of
from .options import FrictionOptions
from .samples import simulate_force


class FrictionBlock(Block):
    """Friction over velocity, for feed-forward compensation: N over m/s, or N m over rad/s.

    Attributes
    ----------
    width
        Speed over which the sign is rounded as ``tanh(v / width)`` [m/s or rad/s]; 0: not at
        all. A controller that compensates all friction at the exact sign chatters about rest.
    """

    def __init__(self, document: ParameterDocument, variant: Variant, width: float = 0.0) -> None:
        super().__init__(document, variant)
        self.width = width

    @cached_property
    def _law(self) -> FrictionLaw:
        return FrictionLaw.of(self.numbers())

    @property
    def _parts(self) -> tuple[FrictionLaw, FrictionLaw]:
        """The levels without viscous friction, and that alone."""
        level = replace(self._law, viscous_positive=0.0, viscous_negative=0.0)
        return level, FrictionLaw(0.0, 0.0, self._law.viscous_positive, self._law.viscous_negative)

    def __call__(self, velocity: npt.ArrayLike, width: float | None = None) -> FloatArray:
        """Return the friction, shape of ``velocity`` [N or N m]; ``velocity`` in m/s or rad/s."""
        self.watch(**{axis_of(self.variant).speed: velocity})
        v = np.asarray(velocity, dtype=float)
        width = self.width if width is None else width
        if width <= 0.0:
            return self._law.moving(v)
        level, viscous = (law.moving(v) for law in self._parts)
        return np.asarray(np.abs(level) * np.tanh(v / width) + viscous)

    def methods(self) -> Mapping[str, Callable[..., Any]]:
        """Both of them; see :meth:`.Block.methods`."""
        return {
            "friction": self,
            "friction_rounded": lambda v, s: self(v, 1.0 / s if s else np.inf),
        }

    def routines(self) -> Sequence[Routine]:
        """Friction in motion with its exact sign, and with a rounded one."""
        unit, axis = self.output.unit, axis_of(self.variant)
        velocity = self.rate_argument(axis.speed, axis.place, "velocity")
        exact = Draft("friction", "Friction against the motion; 0 at rest.", unit)
        rounded = Draft(
            "friction_rounded", "Friction with its sign rounded as tanh(steepness velocity).", unit
        )
        v, w = exact.argument(velocity), rounded.argument(velocity)
        fastest = max(velocity.high, -velocity.low)
        steepness = rounded.argument(
            Argument("steepness", f"1/({velocity.unit})", "one over the speed of rounding",
                     0.0, 1000.0 / fastest, recorded=False)
        )  # fmt: skip
        fading = rounded.let("fading", exp(abs(w) * steepness * -2.0))
        share = rounded.let("share", (1.0 - fading) / (1.0 + fading))
        level, viscous = self._parts
        return (
            exact.returns(self._law.routine_value(v)),
            rounded.returns(level.routine_value(w) * share + viscous.routine_value(w)),
        )

    def predict(self, experiment: Experiment) -> FloatArray:
        """Force, torque or first pressure that a motion needs; see :meth:`Block.predict`."""
        signals = {r: s for r, s in experiment.signals.items() if r != self.variant.output.name}
        options = self.document.settled_options(FrictionOptions)
        plant = Plant(self.variant, self.parameters, options)
        return simulate_force(plant, [replace(experiment, signals=signals)], self.offset)[0].output
