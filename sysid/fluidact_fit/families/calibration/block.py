"""A calibrated potentiometer for a controller, and the direction it has to know."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from ...estimation.rational_bezier import (
    blend,
    invert_rational_bezier,
    is_monotone,
    rational_bezier,
    rational_bezier_slope,
)
from ...experiment import FloatArray
from ...family import Block, Value

SECOND = ("", "_falling")


def rising_share(reading: npt.ArrayLike, dead_band: float, state: float = 0.0) -> FloatArray:
    """Share of the rising branch while a reading moves.

    After a reversal the share moves linearly with the reading and has changed over
    completely once the reading has moved by the dead band; then it is held.

    Parameters
    ----------
    reading : (n,)
    dead_band
        [unit of the reading]
    state
        -1 (falling) to 1 (rising) at the first reading; 0 is not known.

    Returns
    -------
    (n,) between 0 (falling) and 1 (rising).
    """
    values = np.asarray(reading, dtype=float)
    if not values.size:
        return np.zeros(0)
    moved = np.empty(values.size)
    moved[0] = 0.0
    np.subtract(values[1:], values[:-1], out=moved[1:])
    if not np.all(np.isfinite(moved)):  # a reading that is missing moves nothing
        there = np.flatnonzero(np.isfinite(values))
        moved[:] = 0.0
        moved[there[1:]] = np.diff(values[there])
    moved *= 2.0 / max(dead_band, 1e-300)
    at = np.flatnonzero(moved)
    states = [state]
    for step in moved[at].tolist():
        state += step
        if state > 1.0:
            state = 1.0
        elif state < -1.0:
            state = -1.0
        states.append(state)
    # between two moves the share stays
    length = np.diff(np.concatenate(([0], at, [values.size])))
    return 0.5 + 0.5 * np.repeat(np.array(states), length)


class PotentiometerBlock(Block):
    """A calibrated potentiometer: reading in, metres out.

    With two branches an array is a recording, its direction found from the start; a
    controller that gets one reading at a time calls `step`, which remembers the direction.
    ``direction`` (1 rising, -1 falling, 0 between) overrides both.
    """

    family = "potentiometer"

    def __init__(self, parameters: Mapping[str, Value]) -> None:
        self.parameters = dict(parameters)
        low, high = np.asarray(parameters["reading_range"], dtype=float)
        self._low, self._span = float(low), float(high - low)
        self._curves = curves_of(parameters)
        self._dead_band = _scalar(parameters.get("hysteresis_dead_band"))
        self.reset()

    def reset(self) -> None:
        """Forget the direction of motion."""
        self._last, self._state = float("nan"), 0.0

    def __call__(
        self, reading: npt.ArrayLike, direction: npt.ArrayLike | None = None
    ) -> float | FloatArray:
        """Position of a reading or an array of readings [m]; clamped to the reading range."""
        values = np.asarray(reading, dtype=float)
        y = self._value(self._place(values), self._share(values, direction))
        return float(y) if y.ndim == 0 else y

    def step(self, reading: float) -> float:
        """Position of the next reading of a controller [m]."""
        if len(self._curves) > 1:
            pair = np.array([reading if np.isnan(self._last) else self._last, reading])
            share = rising_share(pair, self._dead_band, self._state)[-1]
            self._last, self._state = reading, float(2.0 * share - 1.0)
        return float(self._value(self._place(np.asarray(reading)), 0.5 + 0.5 * self._state))

    def sensitivity(
        self, reading: npt.ArrayLike, direction: npt.ArrayLike | None = None
    ) -> float | FloatArray:
        """Change of position per reading [m per unit of the reading]; 0 beyond the range."""
        values = np.asarray(reading, dtype=float)
        t = self._place(values)
        slopes = [rational_bezier_slope(t, p, w) for p, w in self._curves]
        inside = (t == (values - self._low) / self._span).astype(float)
        s = np.asarray(blend(slopes, self._share(values, direction)) * inside / self._span)
        return float(s) if s.ndim == 0 else s

    def inverse(
        self, metres: npt.ArrayLike, direction: float = 0.0, *, clamp: bool = False
    ) -> float | FloatArray:
        """Reading at a position, to the spacing of floating point numbers.

        Parameters
        ----------
        metres : scalar or (n,)
        direction
            With two branches: 1 rising, -1 falling, 0 the mean of both.
        clamp
            Take the end of the range for positions beyond it.

        Raises
        ------
        ValueError
            When a position is beyond the range (unless clamped) or the curve turns back,
            so that a position has several readings.
        """
        y = np.asarray(metres, dtype=float)
        if not all(is_monotone(p, w) for p, w in self._curves):
            raise ValueError(
                "the curve is not monotone: one position has several readings. "
                "Fit again with --monotone."
            )
        share = 0.5 + 0.5 * float(np.clip(direction, -1.0, 1.0))
        ends = [float(self._value(np.asarray(t), share)) for t in (0.0, 1.0)]
        slack = 1e-12 * abs(ends[1] - ends[0])
        outside = ~((y >= min(ends) - slack) & (y <= max(ends) + slack))
        if np.any(np.isnan(y)) or (np.any(outside) and not clamp):
            first = float(y[outside].flat[0])
            raise ValueError(
                f"{first:g} m is outside the calibrated range {min(ends):g} to {max(ends):g} m. "
                "Give clamp=True to take the end of the range."
            )
        x = np.asarray(self._low + self._span * self._invert(y, share))
        return float(x) if x.ndim == 0 else x

    def _place(self, values: FloatArray) -> FloatArray:
        return np.asarray(np.clip((values - self._low) / self._span, 0.0, 1.0))

    def _share(self, values: FloatArray, direction: npt.ArrayLike | None) -> FloatArray:
        if direction is not None:
            return np.asarray(0.5 + 0.5 * np.clip(direction, -1.0, 1.0))
        if len(self._curves) == 1 or values.ndim == 0:
            return np.asarray(0.5)
        return rising_share(values, self._dead_band)

    def _value(self, t: FloatArray, share: npt.ArrayLike) -> FloatArray:
        return blend([rational_bezier(t, p, w) for p, w in self._curves], share)

    def _invert(self, y: FloatArray, share: float) -> FloatArray:
        if len(self._curves) == 1:
            return invert_rational_bezier(y, *self._curves[0])
        sign = np.sign(self._curves[0][0][-1] - self._curves[0][0][0])
        low, high = np.zeros_like(y), np.ones_like(y)
        for _ in range(60):
            t = 0.5 * (low + high)
            below = sign * (self._value(t, share) - y) < 0.0
            low, high = np.where(below, t, low), np.where(below, high, t)
        return np.asarray(0.5 * (low + high))


def curves_of(parameters: Mapping[str, Value]) -> list[tuple[FloatArray, FloatArray]]:
    """Control points and weights of each branch in a file."""
    return [
        (
            np.asarray(parameters[f"control_points{s}"], dtype=float),
            np.asarray(parameters[f"weights{s}"], dtype=float),
        )
        for s in SECOND
        if f"control_points{s}" in parameters
    ]


def _scalar(value: Value | None) -> float:
    return float(value) if isinstance(value, (int, float)) else 0.0
