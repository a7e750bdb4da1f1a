"""Exact sampling of a linear model behind a dead time, for an input that is held."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import floor
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import UsageError
from ..experiment import FloatArray
from ..routines import Filter, Name
from ..routines.routine import as_matrix
from .linear import transition

_LONGEST = 10_000  # samples of dead time that a controller may be asked to store


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


class Stepper:
    """A sampled model that takes its commands one by one.

    Parameters
    ----------
    model
    state : (n,)
        To begin with.
    command
        Held until now.

    Raises
    ------
    UsageError
        When the dead time spans more samples than a controller can store.
    """

    def __init__(self, model: Sampled, state: FloatArray, command: float = 0.0) -> None:
        _refuse_long(model)
        self._model, self._state = model, state
        self._sent = deque([command] * (model.whole + 1))

    def step(self, command: float) -> float:
        """Take the command of this sample and return the output at the same instant."""
        model, now = self._model, self._state
        self._sent.append(command)
        old, new = self._sent.popleft(), self._sent[0]
        self._state = model.phi @ now + model.old * old + model.new * new
        return float(model.output @ now)


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


def companion(
    numerator: Sequence[float], denominator: Sequence[float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """State space ``(A, B, C)`` of a strictly proper transfer function, falling powers."""
    den = np.asarray(denominator, dtype=float)
    n = den.size - 1
    num = np.zeros(n)
    given = np.asarray(numerator, dtype=float) / den[0]
    num[n - given.size :] = given
    a = np.zeros((n, n))
    a[:-1, 1:] = np.eye(n - 1)
    a[-1] = -(den[1:] / den[0])[::-1]
    b = np.zeros(n)
    b[-1] = 1.0
    return a, b, num[::-1].copy()


def discretise(
    numerator: Sequence[float],
    denominator: Sequence[float],
    sample_time: float,
    dead_time: float,
) -> dict[str, Any]:
    """Difference equation of ``exp(-dead_time s) numerator(s)/denominator(s)``.

    Exact for an input that is held, with a dead time of any fraction of a sample: the numerator
    is the pulse response of :func:`sample` times the denominator.

    Parameters
    ----------
    numerator, denominator
        Falling powers of ``s``; strictly proper.
    sample_time
        [s]
    dead_time
        [s]

    Returns
    -------
    dict
        ``sample_time``, ``hold``, ``numerator`` and ``denominator`` of equal length, in
        rising powers of ``1/z`` (which for equal lengths are falling powers of ``z``).

    Raises
    ------
    UsageError
        When the dead time spans more samples than a controller can store.
    """
    model = sample(*companion(numerator, denominator), dead_time, sample_time)
    _refuse_long(model)
    den = np.real(np.poly(model.phi))
    state = model.new
    response = [0.0] * (model.whole + 1)
    for k in range(den.size + 1):
        response.append(float(model.output @ state))
        state = model.phi @ state + (model.old if k == 0 else 0.0)
    num = np.convolve(den, response)[: len(response)]
    num[np.abs(num) < 1e-13 * np.abs(num).max()] = 0.0
    num = np.trim_zeros(num, "b")
    length = max(num.size, den.size)
    return {
        "sample_time": float(sample_time),
        "hold": "zoh",
        "numerator": np.append(num, np.zeros(length - num.size)).tolist(),
        "denominator": np.append(den, np.zeros(length - den.size)).tolist(),
    }


def _refuse_long(model: Sampled) -> None:
    """Refuse a dead time that a controller cannot store (``UsageError``)."""
    if model.whole > _LONGEST:
        raise UsageError(
            f"a dead time of {model.whole} samples is more than {_LONGEST}",
            expected="A difference equation stores every sample of its dead time.",
            remedy="Correct the dead time, or give a longer --controller-sample-time.",
        )
