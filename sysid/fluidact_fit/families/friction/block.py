"""The friction map: its equation, and the block that a controller calls."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from ...estimation.parametric import scalars
from ...experiment import FloatArray
from ...family import Block, Value


def friction_force(
    velocity: FloatArray, coulomb_positive: float, coulomb_negative: float, viscous: float
) -> FloatArray:
    """Friction that has to be overcome to move at a velocity.

    Parameters
    ----------
    velocity
        Shape ``(n,)`` [m/s].
    coulomb_positive, coulomb_negative
        Magnitudes of the kinetic levels [N].
    viscous
        Viscous friction [N s/m].

    Returns
    -------
    FloatArray
        Shape ``(n,)`` [N]; zero at rest, where friction takes any value between the levels.
    """
    v = np.asarray(velocity, dtype=float)
    level = np.where(v > 0.0, coulomb_positive, coulomb_negative)
    return np.asarray(np.sign(v) * level + viscous * v)


class FrictionBlock(Block):
    """Friction force over velocity, for feed-forward compensation.

    Parameters
    ----------
    parameters
        ``coulomb_positive``, ``coulomb_negative`` [N] and ``viscous`` [N s/m].
    width
        Speed over which the sign is rounded as ``tanh(v / width)`` [m/s]; 0: not at all. A
        controller that compensates all friction at the exact sign chatters about rest.
    """

    family = "cylinder-friction"

    def __init__(self, parameters: Mapping[str, Value], width: float = 0.0) -> None:
        self.parameters = dict(parameters)
        self.width = width

    def __call__(self, velocity: npt.ArrayLike, width: float | None = None) -> FloatArray:
        """Return the friction force, shape of ``velocity`` [N]; ``velocity`` in m/s."""
        p = scalars(self.parameters)
        v = np.asarray(velocity, dtype=float)
        width = self.width if width is None else width
        sharp = friction_force(v, p["coulomb_positive"], p["coulomb_negative"], 0.0)
        if width > 0.0:
            sharp = np.abs(sharp) * np.tanh(v / width)
        return np.asarray(sharp + p["viscous"] * v)
