"""Exact sampling of a linear model behind a dead time, for an input that is held."""

from __future__ import annotations

from dataclasses import dataclass
from math import floor

import numpy as np
import numpy.typing as npt

from ..experiment import FloatArray
from ..routines import Filter, Name
from ..routines.routine import as_matrix
from .linear import transition


@dataclass(frozen=True)
class Sampled:
    """``x[k+1] = phi x[k] + new u[k-whole] + old u[k-whole-1]``, ``y[k] = output x[k]``."""

    phi: FloatArray
    new: FloatArray
    old: FloatArray
    output: FloatArray
    whole: int

    def response(self, z: npt.ArrayLike) -> npt.NDArray[np.complex128]:
        """Response in ``z``, on the unit circle and no pole of the system; shape of ``z``."""
        at = np.asarray(z, dtype=complex)[..., None]
        drive = at ** -float(self.whole) * (self.new + self.old / at)
        matrix = at[..., None] * np.eye(self.new.size) - self.phi
        return np.asarray(np.linalg.solve(matrix, drive[..., None])[..., 0] @ self.output)


def sample(
    a: FloatArray, b: FloatArray, c: FloatArray, dead_time: float, sample_time: float
) -> Sampled:
    """Sample ``y = c x``, ``x' = a x + b u(t - dead_time)``.

    With ``dead_time = (whole + g) sample_time`` the input of ``whole + 1`` samples ago acts for
    ``g sample_time`` and that of ``whole`` samples ago for the rest of the sample.

    Parameters
    ----------
    a : (n, n)
    b, c : (n,)
    dead_time, sample_time
        [s]; the dead time may be any fraction of a sample.

    Returns
    -------
    Sampled
        With what reaches the end of a sample of what was held during it, and before.
    """
    whole = floor(dead_time / sample_time + 1e-9)
    late = max(dead_time - whole * sample_time, 0.0)
    phi, gamma = transition(a, b, np.array([sample_time, sample_time - late]))
    assert gamma is not None
    new = gamma[1, :, 0]  # the sample's own command, once it arrives
    return Sampled(phi[0], new, gamma[0, :, 0] - new, c, whole)


def difference_equation(model: Sampled) -> Filter:
    """The sampled model as it stands in a routine, its input named ``drive``."""
    change = model.phi - np.eye(model.new.size)
    return Filter(
        "moved", as_matrix(change), tuple(model.new.tolist()), tuple(model.old.tolist()),
        tuple(model.output.tolist()), model.whole, Name("drive"),
    )  # fmt: skip
