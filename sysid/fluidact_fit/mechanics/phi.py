"""The functions of which the response of a mass with viscous friction is made.

phi_n(z) = sum_k z**k / (k + n)!,    phi_0 = exp,    phi_n = (phi_(n-1) - 1 / (n-1)!) / z
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, factorial

import numpy as np

from ..experiment import Array, FloatArray

_INVERSE = [1.0 / factorial(n) for n in range(32)]
_SERIES = [_INVERSE[n + 14 : n - 1 if n else None : -1] for n in range(18)]  # of phi_n, last first


def phi_of(z: Array, count: int) -> list[Array]:
    """``phi_n(z) = sum_k z**k / (k + n)!`` for ``n = 1..count``, any size of ``z``."""
    size = np.abs(z)
    small = size < 0.7
    every = bool(small.all())
    near = z if every else np.where(small, z, 0.0)
    # of terms that matter: between two samples z is seldom more than a few hundredths
    last = 6 if every and size.max(initial=0.0) < 0.02 else 13
    total = near * _INVERSE[count + last + 1] + _INVERSE[count + last]
    for k in range(last - 1, -1, -1):
        total *= near
        total += _INVERSE[count + k]
    values = [total]
    for n in range(count - 1, 0, -1):
        values.append(values[-1] * near + _INVERSE[n])
    values.reverse()
    if every:
        return values
    far = np.where(small, 1.0, z)
    previous = np.exp(far)
    out = []
    for n in range(1, count + 1):
        previous = (previous - _INVERSE[n - 1]) / far
        out.append(np.where(small, values[n - 1], previous))
    return out


def phi_real(z: float, count: int) -> list[float]:
    """``phi_1 .. phi_count`` of one real number; the hot path of every event."""
    if abs(z) < 0.7:
        total = 0.0
        for c in _SERIES[count]:
            total = total * z + c
        values = [total]
        for n in range(count - 1, 0, -1):
            values.append(values[-1] * z + _INVERSE[n])
        values.reverse()
        return values
    values, previous = [], exp(z)
    for n in range(1, count + 1):
        previous = (previous - _INVERSE[n - 1]) / z
        values.append(previous)
    return values


@dataclass(frozen=True)
class Responses:
    """Responses of a moving mass to spans of time, ``(g,)`` each: real, or complex for derivatives.

    ``decay`` of the speed and ``travel`` per speed [s]; ``speed`` and ``place``, shape
    ``(d, g)``, per coefficient of the net torque at the begin of the span.
    """

    decay: Array
    travel: Array
    speed: Array
    place: Array

    @classmethod
    def of(cls, inertia: complex, viscous: complex, spans: FloatArray, size: int) -> Responses:
        z = -(viscous / inertia) * spans
        phi = phi_of(z, size + 1)
        powers = [factorial(i) * spans ** (i + 1) / inertia for i in range(size)]
        return cls(
            1.0 + z * phi[0],
            spans * phi[0],
            np.array([power * phi[i] for i, power in enumerate(powers)]),
            np.array([power * spans * phi[i + 1] for i, power in enumerate(powers)]),
        )
