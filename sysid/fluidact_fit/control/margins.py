"""Gain and phase margin of the sampled loop, with hold, filter and dead time in it.

``L(z) = C(z) P(z)`` on ``z = exp(j w T)``, dry friction left aside. The gain margin is the least
factor by which the loop gain can grow until ``L = -1``, ``1 / |L|`` at a phase of -180 degrees; the
phase margin is the least of ``180 degrees + arg L`` where ``|L| = 1``.
"""

from __future__ import annotations

from cmath import exp, phase
from collections.abc import Callable
from dataclasses import dataclass
from math import degrees, inf, pi

import numpy as np

from .controllers.base import Controller
from .plants.base import Plant

_POINTS = 4000  # over five decades up to half the sampling frequency


@dataclass(frozen=True)
class Margins:
    """Gain margin as a factor, phase margin [degrees]; infinite where there is no crossing.

    Each with the frequency at which it is [Hz], NaN without one.
    """

    gain: float
    gain_frequency: float
    phase: float
    phase_frequency: float

    @property
    def warning(self) -> str:
        """What both margins say of a loop that is not stable without its friction, or nothing."""
        if self.gain >= 1.0 or self.phase >= 0.0:
            return ""
        return (
            f"the loop is not stable by its margins (gain {self.gain:.3g}, phase {self.phase:.3g} "
            "degrees): only dry friction and limits could hold it. Choose smaller gains."
        )


def loop_margins(plant: Plant, controller: Controller) -> Margins:
    """Margins of the loop of a plant and a controller.

    Raises
    ------
    NotImplementedError
        When the plant is not linear or the controller feeds nothing back.
    """
    step = controller.sample_time

    def loop(w: float) -> complex:
        z = exp(1j * w * step)
        return complex(np.dot(controller.response(z), plant.response(z)))

    top = pi / step
    grid = np.geomspace(1e-5 * top, (1.0 - 1e-9) * top, _POINTS).tolist()
    values = [loop(w) for w in grid]
    gain, phases = (inf, float("nan")), (inf, float("nan"))
    for a, b, x, y in zip(grid, grid[1:], values, values[1:]):
        if x.imag * y.imag < 0.0 and min(x.real, y.real) < 0.0 and abs(x - y) < abs(x) + abs(y):
            w = _root(lambda v: loop(v).imag, a, b)
            if loop(w).real < 0.0:
                gain = min(gain, (1.0 / abs(loop(w)), w))
        if (abs(x) - 1.0) * (abs(y) - 1.0) < 0.0:
            w = _root(lambda v: abs(loop(v)) - 1.0, a, b)
            phases = min(phases, (degrees(phase(-loop(w))), w))
    return Margins(gain[0], gain[1] / (2.0 * pi), phases[0], phases[1] / (2.0 * pi))


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a function changes its sign, by halving to the last digit."""
    rising = function(high) > 0.0
    while low < (middle := 0.5 * (low + high)) < high:
        beyond = (function(middle) > 0.0) == rising
        low, high = (low, middle) if beyond else (middle, high)
    return high
