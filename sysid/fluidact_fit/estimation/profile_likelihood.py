"""Intervals from the profile likelihood, where the quadratic approximation fails.

The 95 % interval of a parameter ends where the cost, all other unknowns refitted, has
risen by ``t^2 s^2``. Where the cost is a parabola that is value plus or minus ``t``
standard errors; at the edge of a dead zone, for a dead time, or beside a bound it is not.

References
----------
.. [1] D. Bates, D. Watts, Nonlinear Regression Analysis and Its Applications, 1988,
   section 6.1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

_CLOSE = 0.05  # relative departure from the parabola that does not matter


@dataclass(frozen=True)
class Interval:
    """Ends of an interval and the method that made it, ``"wald"`` or ``"profile"``."""

    low: float
    high: float
    method: str


def profile_interval(
    rise: Callable[[float], float],
    value: float,
    std_error: float,
    quantile: float,
    bounds: tuple[float, float],
) -> Interval:
    """Interval of one parameter.

    Parameters
    ----------
    rise
        ``rise(x)``: root of the rise of the profiled cost at ``x``, in standard deviations of the
        residual; ``|x - value| / std_error`` for a parabola.
    value, std_error
        Estimate [unit] and its standard error by the covariance.
    quantile
        Of Student's t, about 1.96.
    bounds
        Possible range.
    """
    ends, curved = [], False
    for side, bound in ((-1.0, bounds[0]), (1.0, bounds[1])):
        end, departs = _end(rise, value, side * std_error, quantile, bound)
        ends.append(end)
        curved |= departs
    return Interval(ends[0], ends[1], "profile" if curved else "wald")


def _end(
    rise: Callable[[float], float], value: float, step: float, quantile: float, bound: float
) -> tuple[float, bool]:
    """One end, and whether it departs from the parabola's."""
    parabola = value + quantile * step

    def inside(x: float) -> float:
        return max(x, bound) if step < 0.0 else min(x, bound)

    x = inside(parabola)
    if x == value:
        return value, False
    z = rise(x)
    if x == bound and z < quantile:
        return bound, False
    expected = abs(x - value) / abs(step)
    if abs(z - expected) <= _CLOSE * quantile:
        return inside(parabola), False
    inner, z_inner = value, 0.0
    for _ in range(6):
        if abs(z - quantile) <= _CLOSE * quantile:
            break
        slope = (z - z_inner) / (x - inner) if x != inner else 0.0
        if slope == 0.0 or not np.isfinite(slope):
            break
        target = x + (quantile - z) / slope
        limit = value + 3.0 * (x - value)
        target = min(target, limit) if step > 0.0 else max(target, limit)
        if z < quantile:
            inner, z_inner = x, z
        moved = inside(target)
        if moved == x or (moved - value) * step <= 0.0:
            break
        x = moved
        z = rise(x)
        if x == bound and z < quantile:
            break
    return x, True
