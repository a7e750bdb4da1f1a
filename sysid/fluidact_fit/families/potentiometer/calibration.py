"""The calibration itself: position of a reading, and back, over one curve or two branches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from ...block import as_motion_state
from ...errors import UsageError
from ...estimation.recursion import clamped
from ...experiment import BoolArray, FloatArray, where_finite
from ...family import Value
from .rational_bezier import (
    blend,
    express,
    is_monotone,
    rational_bezier,
    rational_bezier_slope,
)

SECOND = ("", "_falling")
_CURVE = ("control_points", "weights")


def rising_share(reading: npt.ArrayLike, dead_band: float, state: float = 0.0) -> FloatArray:
    """Share of the rising branch while a reading (n,) moves: 0 (falling) to 1 (rising).

    After a reversal the share moves linearly with the reading and has changed over
    completely once the reading has moved by the dead band; then it is held. ``state`` is -1
    (falling) to 1 (rising) at the first reading; 0 is not known.
    """
    values = np.asarray(reading, dtype=float)
    there = np.isfinite(values)  # a reading that is missing moves nothing
    known, moved = values[there], np.zeros(values.size)
    moved[there] = np.diff(known, prepend=known[:1]) * 2.0 / max(dead_band, 1e-300)
    return 0.5 + 0.5 * clamped(state, -1.0, 1.0, moved, moved.size)


def is_share_known(reading: npt.ArrayLike, dead_band: float) -> BoolArray:
    """Readings (n,) from which on the share does not depend on the motion before the first."""
    rising, falling = (rising_share(reading, dead_band, state) for state in (1.0, -1.0))
    return np.asarray(np.abs(rising - falling) < 1e-9)


def over_common_readings(
    every: Sequence[Mapping[str, Value]],
) -> tuple[list[dict[str, Value]], str]:
    """Parameters of calibrations over the readings that all cover, at the highest of their degrees.

    The curves stay the same: their numerators and denominators are expressed anew.

    Returns
    -------
    The parameters, without curves where no reading is common, and what was done; empty for nothing.
    """
    each = [Calibration.of(values) for values in every]
    low, high = max(c.low for c in each), min(c.high for c in each)
    degree = max(p.size - 1 for c in each for p, _ in c.curves)
    if all((c.low, c.high, c.curves[0][0].size - 1) == (low, high, degree) for c in each):
        return [dict(values) for values in every], ""
    out = []
    for values, c in zip(every, each):
        common = {n: v for n, v in values.items() if n.removesuffix("_falling") not in _CURVE}
        for suffix, (p, w) in zip(SECOND, c.curves) if low < high else ():
            ends = [(x - c.low) / (c.high - c.low) for x in (low, high)]
            top, bottom = (express(a, degree, *ends) for a in (w * p, w))
            common[f"control_points{suffix}"] = (top / bottom).tolist()
            common[f"weights{suffix}"] = (bottom / bottom[0]).tolist()
        out.append(common)
    if low >= high:
        return out, "the ranges of readings do not overlap: the curves cannot be compared"
    return out, (
        f"control points and weights refer to the common range of readings, {low:.6g} to "
        f"{high:.6g}, at degree {degree}"
    )


@dataclass(frozen=True)
class Calibration:
    """Control points and weights of the curve or of both branches, over a range of readings."""

    curves: tuple[tuple[FloatArray, FloatArray], ...]
    low: float
    high: float
    dead_band: float = 0.0

    @classmethod
    def of(cls, values: Mapping[str, Value]) -> Self:
        """The calibration of a file.

        Raises
        ------
        UsageError
            When lists that belong together differ in length.
        """
        curves = []
        for s in SECOND:
            if f"control_points{s}" not in values:
                continue
            p, w = (np.asarray(values[f"{name}{s}"], dtype=float) for name in _CURVE)
            if p.shape != w.shape or p.size < 2:
                raise UsageError(
                    f"{p.size} control_points{s} and {w.size} weights{s}",
                    expected="As many weights as control points, two at least.",
                )
            curves.append((p, w))
        low, high = np.asarray(values["reading_range"], dtype=float)
        band = np.asarray(values.get("hysteresis_dead_band", 0.0), dtype=float)
        return cls(tuple(curves), float(low), float(high), float(band))

    @property
    def monotone(self) -> bool:
        """Return whether no curve turns back."""
        return all(is_monotone(p, w) for p, w in self.curves)

    @property
    def sizes(self) -> dict[str, float]:
        """Stroke between the extreme readings and, of two branches, the width of the hysteresis."""
        points = self.curves[0][0]
        out = {"stroke": abs(float(points[-1] - points[0]))}
        if len(self.curves) == 2:
            rise, fall = (rational_bezier(np.linspace(0.0, 1.0, 1001), *c) for c in self.curves)
            out["hysteresis"] = float(np.mean(np.abs(rise - fall)))
        return out

    def place(self, reading: FloatArray) -> FloatArray:
        """Share of the range at which readings lie, 0 to 1; clamped."""
        share = np.asarray(reading - self.low, dtype=float)
        share /= self.high - self.low
        return np.clip(share, 0.0, 1.0, out=share)

    def share(self, reading: FloatArray, direction: npt.ArrayLike | None = None) -> FloatArray:
        """Share of the rising branch; an array without directions is a recording."""
        if direction is not None:
            return np.asarray(0.5 + 0.5 * as_motion_state(direction))
        if len(self.curves) == 1 or reading.ndim == 0:
            return np.asarray(0.5)
        return rising_share(reading, self.dead_band)

    def is_described(self, reading: FloatArray) -> BoolArray:
        """Mask of a recording without the beginning that may belong to either branch."""
        if len(self.curves) == 1:
            return where_finite(reading)
        return is_share_known(reading, self.dead_band)

    def value(self, place: FloatArray, share: npt.ArrayLike) -> FloatArray:
        """Position at places of the range [m]."""
        return blend([rational_bezier(place, p, w) for p, w in self.curves], share)

    def position(self, reading: FloatArray, direction: npt.ArrayLike | None = None) -> FloatArray:
        """Position of readings [m]; clamped to the range."""
        return self.value(self.place(reading), self.share(reading, direction))

    def slope(self, reading: FloatArray, direction: npt.ArrayLike | None = None) -> FloatArray:
        """Change of position per reading; 0 beyond the range."""
        t, span = self.place(reading), self.high - self.low
        slopes = [rational_bezier_slope(t, p, w) for p, w in self.curves]
        inside = (t == (reading - self.low) / span).astype(float)
        return np.asarray(blend(slopes, self.share(reading, direction)) * inside / span)

    def invert(self, position: FloatArray, share: float) -> FloatArray:
        """Places of positions on a monotone calibration; the end of the range beyond it.

        By bisection down to the spacing of floating point numbers.
        """
        sign = 1.0 if self.curves[0][0][-1] >= self.curves[0][0][0] else -1.0
        low, high = np.zeros_like(position), np.ones_like(position)
        for _ in range(60):
            t = 0.5 * (low + high)
            below = sign * (self.value(t, share) - position) < 0.0
            low, high = np.where(below, t, low), np.where(below, high, t)
        # what never came off an end of the range lies on it or beyond
        return np.asarray(np.where(high == 1.0, 1.0, low))
