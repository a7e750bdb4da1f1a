"""The velocity filter of the rigs: a difference followed by a second-order Butterworth filter.

    H(s) = w_c^2 / (s^2 + sqrt(2) w_c s + w_c^2)

is made discrete by the bilinear transformation, prewarped so that the attenuation at the cut-off
frequency ``f_c`` is 3 dB to the last digit: with ``K = tan(pi f_c T)``,

    H(z) = b_0 (1 + 2/z + 1/z^2) / (1 + a_1/z + a_2/z^2),     b_0 = K^2 / (1 + sqrt(2) K + K^2).

The thesis names order and cut-off frequency (10 Hz at 100 Hz) and not the way to a difference
equation [1]_.

References
----------
.. [1] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   section 4.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt, tan

import numpy as np
import numpy.typing as npt

from ..errors import UsageError
from ..experiment import FloatArray


@dataclass(frozen=True)
class System:
    """``x[k+1] = a x[k] + b e[k]``, ``y[k] = c x[k] + d e[k]``.

    Shapes ``(n, n)``, ``(n,)``, ``(m, n)`` and ``(m,)``.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray

    def scaled(self, gains: FloatArray, direct: FloatArray) -> System:
        """Outputs ``gains`` times the only one, and ``direct`` times the input; ``(m,)`` each."""
        return System(self.a, self.b, np.outer(gains, self.c[0]), gains * self.d[0] + direct)

    def response(self, z: npt.ArrayLike) -> npt.NDArray[np.complex128]:
        """Return the transfer functions at ``z`` of shape ``(...)``; shape ``(m, ...)``."""
        at = np.asarray(z, dtype=complex)[..., None, None]
        states = np.linalg.solve(at * np.eye(self.b.size) - self.a, self.b[:, None])
        return np.asarray(np.moveaxis(states[..., 0] @ self.c.T + self.d, -1, 0))


def butterworth(cutoff: float, sample_time: float) -> tuple[FloatArray, FloatArray]:
    """Numerator and denominator ``(3,)`` of the low-pass filter, rising powers of ``1/z``.

    Parameters
    ----------
    cutoff
        Frequency at which 3 dB are lost [Hz].
    sample_time
        [s]

    Raises
    ------
    UsageError
        When the cut-off frequency is not between 0 and half the sampling frequency.
    """
    if not 0.0 < cutoff * sample_time < 0.5:
        raise UsageError(
            f"a filter cannot cut off at {cutoff:g} Hz in steps of {sample_time:g} s",
            expected=f"Expected a frequency between 0 and {0.5 / sample_time:g} Hz, half the "
            "sampling frequency.",
        )
    k = tan(pi * cutoff * sample_time)
    scale = 1.0 + sqrt(2.0) * k + k * k
    falls = 2.0 * (k * k - 1.0) / scale, (1.0 - sqrt(2.0) * k + k * k) / scale
    return k * k / scale * np.array([1.0, 2.0, 1.0]), np.array([1.0, *falls])


def differentiator(cutoff: float, sample_time: float) -> System:
    """Rate of change of a signal: difference between samples, then :func:`butterworth`.

    The states are the last sample and those of the filter.
    """
    b, a = butterworth(cutoff, sample_time)
    difference = np.array([-1.0, 0.0, 0.0]) / sample_time
    output = b[0] * difference + np.array([0.0, 1.0, 0.0])
    matrix = np.zeros((3, 3))
    matrix[1] = b[1] * difference - a[1] * output + np.array([0.0, 0.0, 1.0])
    matrix[2] = b[2] * difference - a[2] * output
    direct = b[0] / sample_time
    inputs = [1.0, b[1] / sample_time - a[1] * direct, b[2] / sample_time - a[2] * direct]
    return System(matrix, np.array(inputs), output[None, :], np.array([direct]))
