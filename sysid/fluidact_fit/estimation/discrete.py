"""From a continuous transfer function to the difference equation a controller runs."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from typing import Any

import numpy as np

from ..errors import UsageError
from ..experiment import FloatArray
from .inputs import PiecewiseInput
from .linear import forced_response, transition

_LONGEST = 10_000  # samples of dead time that a controller may be asked to store


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

    Exact for an input that is held, with a dead time of any fraction of a sample: the
    numerator is the pulse response of the continuous model times the denominator.

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
    if dead_time > _LONGEST * sample_time:
        raise UsageError(
            f"a dead time of {dead_time:g} s is more than {_LONGEST} samples of {sample_time:g} s",
            expected="A difference equation stores every sample of its dead time.",
            remedy="Correct the dead time, or give a longer --controller-sample-time.",
        )
    a, b, c = companion(numerator, denominator)
    phi, _ = transition(a, None, np.array([sample_time]))
    den = np.real(np.poly(phi[0]))
    instants = np.arange(a.shape[0] + 2 + ceil(dead_time / sample_time - 1e-9)) * sample_time
    pulse = PiecewiseInput(np.array([0.0, sample_time]), np.array([[1.0], [0.0]]))
    response = np.real(forced_response(a, b, c, pulse, instants, dead_time=dead_time))
    num = np.convolve(den, response)[: instants.size]
    num[np.abs(num) < 1e-13 * np.abs(num).max()] = 0.0
    num = np.trim_zeros(num, "b")
    length = max(num.size, den.size)
    return {
        "sample_time": float(sample_time),
        "hold": "zoh",
        "numerator": np.append(num, np.zeros(length - num.size)).tolist(),
        "denominator": np.append(den, np.zeros(length - den.size)).tolist(),
    }
