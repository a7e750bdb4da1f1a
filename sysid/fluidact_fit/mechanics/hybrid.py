"""Systems that are linear between events: followed exactly, events solved for.

A state ``z`` with a last entry of 1 obeys ``z' = A z`` as long as every guard ``g z`` is not
negative. Its course over a step ``d`` is the power series

    z(s d) = sum_k s^k (A d)^k / k! z(0),     0 <= s <= 1,

and so is that of every guard, a polynomial in ``s``. Steps are so short that the series ends
below rounding, ``|lambda| d <= 1`` for all eigenvalues of ``A``. A guard is negative somewhere in
the step only if one of its Bernstein coefficients is; the step is halved until there is one change
of sign and hence one root [1]_. No grid decides whether an event is seen.

References
----------
.. [1] J. M. Lane, R. F. Riesenfeld, "Bounds on a polynomial", BIT 21, 1981.
"""

from __future__ import annotations

from functools import cache
from math import ceil, comb

import numpy as np

from ..errors import UsageError
from ..experiment import FloatArray

_DEGREE = 24  # of the series: 1 / 25! = 6e-26
_ROUNDING = 1e-12  # of the largest coefficient: what is less below zero is not an event
_HALVINGS = 50
_MOST_STEPS = 2000  # of a sample: more take minutes for a second of a loop


class Mode:
    """One linear piece ``z' = A z`` and the guards that end it.

    Parameters
    ----------
    matrix : (n, n)
    guards : (m, n)
        Rows ``g``; the mode ends when one of the ``g z`` becomes negative.
    span
        Longest time to be followed at once [s].
    """

    def __init__(self, matrix: FloatArray, guards: FloatArray, span: float) -> None:
        rate = float(np.abs(np.linalg.eigvals(matrix)).max(initial=0.0))
        self.step = span / max(1, ceil(rate * span))
        powers = [np.eye(matrix.shape[0])]
        for k in range(1, _DEGREE + 1):
            powers.append(powers[-1] @ matrix * (self.step / k))
        self._series = np.array(powers)
        self._guards = np.einsum("mi,kij->mkj", guards, self._series)
        self._whole = np.asarray(self._series.sum(axis=0))

    def advance(self, z: FloatArray, span: float) -> tuple[FloatArray, float, int | None]:
        """Follow the state until the span ends or a guard becomes negative.

        Parameters
        ----------
        z : (n,)
        span
            [s]

        Returns
        -------
        z : (n,)
            State at the end, or where a guard has just become negative.
        rest
            What is left of the span [s].
        guard
            Which one became negative; ``None`` at the end of the span.

        Raises
        ------
        UsageError
            When the motion is too fast for the span.
        """
        check_steps(self.step, span)
        while span > 0.0:
            share = min(span / self.step, 1.0)
            at, guard = self._first_event(z, share)
            if guard is not None:
                return self._inside(z, at), max(span - at * self.step, 0.0), guard
            z = self._whole @ z if share == 1.0 else self._inside(z, share)
            span -= self.step
            if span < 1e-12 * self.step:
                break
        return z, 0.0, None

    def at(self, z: FloatArray, time: float) -> FloatArray:
        """State after a time of at most one ``step`` [s], whatever the guards are."""
        return self._inside(z, time / self.step)

    def _inside(self, z: FloatArray, share: float) -> FloatArray:
        return np.asarray(share ** np.arange(_DEGREE + 1.0) @ (self._series @ z))

    def _first_event(self, z: FloatArray, share: float) -> tuple[float, int | None]:
        """The first guard to become negative, and after which share of a step."""
        table = self._guards @ z
        if share < 1.0:
            table = table * share ** np.arange(_DEGREE + 1.0)
        at, guard = first_event(table)
        return at * share, guard


def check_steps(step: float, span: float) -> None:
    """Refuse a machine of too many steps [s] in the span of a sample (``UsageError``)."""
    if not span <= _MOST_STEPS * step:
        raise UsageError(
            f"a part of the machine moves within about {step:.2g} s, too fast to be followed over "
            f"the {span:.3g} s between samples",
            expected=f"Expected at most {_MOST_STEPS} steps a sample.",
            remedy="Choose a shorter sample_time, or look whether its mass, stiffness, damping or "
            "natural frequency is right.",
        )


def first_event(guards: FloatArray) -> tuple[float, int | None]:
    """Find the first polynomial that becomes negative on 0 .. 1, and where.

    Parameters
    ----------
    guards : (m, n)
        Coefficients, rising powers.

    Returns
    -------
    at
        1 when none does.
    guard
        Its row, ``None`` when none does.
    """
    first, found = 1.0, None
    sizes = np.abs(guards)
    doubtful = guards[:, 0] < sizes[:, 1:].sum(axis=1)
    for i in np.flatnonzero(doubtful).tolist():
        at = first_negative(guards[i], _ROUNDING * float(sizes[i].max()))
        if at is not None and (found is None or at < first):
            first, found = at, i
    return first, found


@cache
def _to_bernstein(degree: int) -> FloatArray:
    """Matrix from power to Bernstein coefficients on 0 .. 1."""
    rows = range(degree + 1)
    return np.array([[comb(j, k) / comb(degree, k) if k <= j else 0.0 for k in rows] for j in rows])


def first_negative(coefficients: FloatArray, slack: float = 0.0) -> float | None:
    """Find where on 0 .. 1 a polynomial first falls below ``-slack``; ``None`` if it does not.

    Parameters
    ----------
    coefficients : (n,)
        Rising powers.
    slack
        Not negative.

    Returns
    -------
    float or None
        The polynomial is below ``-slack`` there, by rounding alone.
    """
    c = coefficients.copy()
    c[0] += slack
    if c[0] < 0.0:
        return 0.0
    bracket = _bracket(_to_bernstein(c.size - 1) @ c, 0.0, 1.0, _HALVINGS)
    if bracket is None:
        return None
    low, high = bracket
    powers = c[::-1].tolist()
    while low < (middle := 0.5 * (low + high)) < high:
        value = 0.0
        for p in powers:
            value = value * middle + p
        low, high = (low, middle) if value < 0.0 else (middle, high)
    return high


def _bracket(b: FloatArray, low: float, high: float, left: int) -> tuple[float, float] | None:
    """First part of an interval in which the coefficients change their sign once."""
    negative = b < 0.0
    if not negative.any():
        return None
    if (b[-1] < 0.0 and np.count_nonzero(negative[1:] != negative[:-1]) == 1) or left == 0:
        return (low, high) if b[-1] < 0.0 else None
    rows, first, second = b, [b[0]], [b[-1]]
    while rows.size > 1:  # de Casteljau: both halves at once
        rows = 0.5 * (rows[1:] + rows[:-1])
        first.append(rows[0])
        second.append(rows[-1])
    middle = 0.5 * (low + high)
    found = _bracket(np.array(first), low, middle, left - 1)
    if found is not None:
        return found
    return _bracket(np.array(second[::-1]), middle, high, left - 1)
