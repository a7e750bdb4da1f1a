"""From a continuous transfer function to the difference equation a controller runs."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, floor
from typing import Any, Literal

import numpy as np

from ...errors import UsageError
from ...estimation.inputs import PiecewiseInput
from ...estimation.linear import forced_response, transition
from ...experiment import FloatArray

_LONGEST = 10_000  # samples of dead time that a controller may be asked to store
Method = Literal["zoh", "foh", "tustin"]


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
    method: Method,
    dead_time: float = 0.0,
) -> dict[str, Any]:
    """Difference equation of ``exp(-dead_time s) numerator(s)/denominator(s)``.

    ``zoh`` and ``foh`` are exact for an input that is held or follows straight lines, with a
    dead time of any fraction of a sample: the numerator is the pulse response of the
    continuous model times the denominator. ``tustin`` maps ``s = 2/T (z-1)/(z+1)`` and
    splits the dead time linearly between the two neighbouring samples.

    Parameters
    ----------
    numerator, denominator
        Falling powers of ``s``; strictly proper.
    sample_time
        [s]
    method
        ``"zoh"``, ``"foh"`` or ``"tustin"``.
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
    if method == "tustin":
        num, den = _tustin(numerator, denominator, sample_time)
        whole = floor(dead_time / sample_time + 1e-9)
        share = max(dead_time / sample_time - whole, 0.0)
        delay = [0.0] * whole + ([1.0] if share < 1e-9 else [1.0 - share, share])
        num = np.convolve(num, delay)
    else:
        num, den = _exact(numerator, denominator, sample_time, method, dead_time)
    length = max(num.size, den.size)
    return {
        "sample_time": float(sample_time),
        "hold": method,
        "numerator": np.append(num, np.zeros(length - num.size)).tolist(),
        "denominator": np.append(den, np.zeros(length - den.size)).tolist(),
    }


def _exact(
    numerator: Sequence[float],
    denominator: Sequence[float],
    step: float,
    method: Method,
    dead_time: float,
) -> tuple[FloatArray, FloatArray]:
    """Exact hold-equivalent by the pulse response."""
    a, b, c = companion(numerator, denominator)
    phi, _ = transition(a, None, np.array([step]))
    den = np.real(np.poly(phi[0]))
    length = a.shape[0] + 2 + ceil(dead_time / step - 1e-9)
    if method == "zoh":
        pulse = PiecewiseInput(np.array([0.0, step]), np.array([[1.0], [0.0]]))
    else:
        nodes = np.array([-step, 0.0, step])
        pulse = PiecewiseInput(nodes, np.array([[0.0, 1 / step], [1.0, -1 / step], [0.0, 0.0]]))
    instants = np.arange(length) * step
    response = np.real(forced_response(a, b, c, pulse, instants, dead_time=dead_time))
    num = np.convolve(den, response)[:length]
    num[np.abs(num) < 1e-13 * np.abs(num).max()] = 0.0
    return np.trim_zeros(num, "b"), den


def _tustin(
    numerator: Sequence[float], denominator: Sequence[float], step: float
) -> tuple[FloatArray, FloatArray]:
    """Bilinear transform, coefficients in rising powers of ``1/z``."""
    order = len(denominator) - 1

    def substitute(coefficients: Sequence[float]) -> FloatArray:
        total = np.zeros(order + 1)
        padded = [0.0] * (order + 1 - len(coefficients)) + list(coefficients)
        for power, value in zip(range(order, -1, -1), padded):
            term = np.array([value * (2.0 / step) ** power])
            for _ in range(power):
                term = np.convolve(term, [1.0, -1.0])
            for _ in range(order - power):
                term = np.convolve(term, [1.0, 1.0])
            total += term
        return total

    num, den = substitute(numerator), substitute(denominator)
    return num / den[0], den / den[0]
