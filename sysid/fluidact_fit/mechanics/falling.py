"""Sliding friction that falls with the speed: a state followed by error-controlled steps.

As in :mod:`.hybrid` a state ``z`` with a last entry of 1 is followed until a guard ``g z`` becomes
negative, but its second entry, a velocity, is pulled back by more than a matrix can say:

    z' = A z + e_2 f exp(-(z_2 / v_s)^2)

Steps are those of Dormand and Prince; between them the state is a polynomial of degree 4, and so
is every guard, of which no change of sign is overlooked, however short.
"""

from __future__ import annotations

from math import exp

import numpy as np

from ..estimation.runge_kutta import BETWEEN, ERROR, RESULT, STAGES
from ..experiment import FloatArray
from .hybrid import first_event

_TOLERANCE = 1e-9  # error of a step, in sizes of the state and its change
_SHORTEST = 1e-12  # part of the span, to which a step is not shortened further
_POWERS = np.arange(1.0, BETWEEN.shape[1] + 1.0)


class FallingMode:
    """One smooth piece and the guards that end it.

    Parameters
    ----------
    matrix, guards, span
        As of :class:`.hybrid.Mode`.
    pull, speed
        ``f`` [per second squared] and ``v_s`` [per second].
    """

    def __init__(
        self, matrix: FloatArray, guards: FloatArray, span: float, pull: float, speed: float
    ) -> None:
        self._matrix, self._guards = matrix, guards
        self._pull, self._speed = pull, speed
        self._span = self._longest = span

    def advance(self, z: FloatArray, span: float) -> tuple[FloatArray, float, int | None]:
        """Follow the state until the span ends or a guard becomes negative.

        Returns the state, what is left of the span [s], and the guard that became negative or
        ``None``; see :meth:`.hybrid.Mode.advance`.
        """
        least = _SHORTEST * self._longest
        while span > least:
            h = min(self._span, span)
            slopes, after = self._step(z, h)
            size = np.maximum(np.abs(z), np.abs(after)) + np.abs(h * slopes[0])
            error = np.abs(h * (np.asarray(ERROR) @ slopes))
            worst = float(np.max(error / np.maximum(size, 1e-300))) / _TOLERANCE
            better = float(np.clip(0.9 * max(worst, 1e-5) ** -0.2, 0.2, 5.0))
            if worst > 1.0 and h > least:
                self._span = h * better
                continue
            course = h * (slopes.T @ BETWEEN)
            at, guard = first_event(np.column_stack((self._guards @ z, self._guards @ course)))
            if guard is not None:
                return z + course @ at**_POWERS, max(span - at * h, 0.0), guard
            z, span = after, span - h
            self._span = min(max(self._span, h * better), self._longest)
        return z, 0.0, None

    def _slope(self, z: FloatArray) -> FloatArray:
        slope = self._matrix @ z
        slope[1] += self._pull * exp(-((z[1] / self._speed) ** 2))
        return slope

    def _step(self, z: FloatArray, h: float) -> tuple[FloatArray, FloatArray]:
        """Slopes at the stages and at the end, shape ``(7, n)``, and the state at the end."""
        slopes = np.empty((len(ERROR), z.size))
        for i, weights in enumerate((*STAGES, RESULT)):
            after = z + h * (np.asarray(weights) @ slopes[:i]) if weights else z
            slopes[i] = self._slope(after)
        return slopes, after
