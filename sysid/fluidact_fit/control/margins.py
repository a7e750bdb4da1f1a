"""Stability of the sampled loop, with hold, filter and dead time in it, and its margins.

Dry friction, dead zones and limits are left aside. Whether the loop is stable is said by its poles:
the eigenvalues of plant, controller and everything that is on its way through a dead time. Margins
say how far from that it is: with ``L(z) = C(z) P(z)`` on ``z = exp(j w T)`` the gain margin is the
least factor by which the loop gain can grow until ``L = -1``, ``1 / |L|`` at a phase of -180
degrees; the phase margin is the least of ``180 degrees + arg L`` where ``|L| = 1``.
"""

from __future__ import annotations

from cmath import phase
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import degrees, inf, nan, pi
from typing import Any

import numpy as np
import numpy.typing as npt

from ..estimation.sampled import Sampled
from ..experiment import FloatArray
from ..mechanics.rest import rising_zero
from .controllers.base import Controller
from .filters import System
from .plants.base import Plant

_POINTS = 4000  # over five decades up to half the sampling frequency
_STATES = 1500  # of a loop whose poles are looked for
_ROUNDING = 1e-6  # of a pole: what is no farther beyond 1 is not called unstable


@dataclass(frozen=True)
class Margins:
    """Gain margin as a factor, phase margin [degrees]; infinite where there is no crossing.

    Each with the frequency at which it is [Hz], NaN without one. ``spectral_radius`` is the
    magnitude of the largest pole of the closed loop, per sample; NaN where the dead time spans too
    many samples to look for it.
    """

    gain: float
    gain_frequency: float
    phase: float
    phase_frequency: float
    spectral_radius: float

    @property
    def stable(self) -> bool:
        """Return whether what disturbs the loop fades; by the margins where no poles are known."""
        if np.isnan(self.spectral_radius):
            return self.gain >= 1.0 and self.phase >= 0.0
        return self.spectral_radius <= 1.0 + _ROUNDING

    @property
    def warning(self) -> str:
        """Warning about a loop that is not stable without its friction; empty for any other."""
        if self.stable:
            return ""
        radius = self.spectral_radius
        known = "" if np.isnan(radius) else f"spectral radius {radius:.4g} (stable below 1), "
        return (
            f"the loop is unstable: {known}gain margin {self.gain:.3g}. It is not stable without "
            "its dry friction, dead zone or limits, which alone could hold it. Choose smaller "
            "gains."
        )


def loop_margins(plant: Plant, controller: Controller) -> Margins | None:
    """Margins of the loop of a plant and a controller, the worst about any point of the plant.

    ``None`` where the plant is nowhere linear, or the controller feeds nothing back.
    """
    law, points = controller.linear(), plant.linear()
    if law is None or not points:
        return None
    found = [_margins(point, law, controller.sample_time) for point in points]
    gain, phase_margin = min(g for g, _ in found), min(p for _, p in found)
    radius = max(spectral_radius(point, law) for point in points)
    return Margins(*gain, *phase_margin, radius)


_Crossing = tuple[float, float]  # margin and frequency [Hz]


def _margins(point: Sequence[Sampled], law: System, step: float) -> tuple[_Crossing, _Crossing]:
    def loop(w: npt.ArrayLike) -> Any:
        z = np.exp(1j * step * np.asarray(w))
        return sum(c * one.response(z) for c, one in zip(law.response(z), point))

    top = pi / step
    frequencies = np.geomspace(1e-5 * top, (1.0 - 1e-9) * top, _POINTS)
    grid, values = frequencies.tolist(), loop(frequencies).tolist()
    gain, phases = (inf, nan), (inf, nan)
    for a, b, x, y in zip(grid, grid[1:], values, values[1:]):
        if x.imag * y.imag < 0.0 and min(x.real, y.real) < 0.0 and abs(x - y) < abs(x) + abs(y):
            w = _root(lambda v: loop(v).imag, a, b)
            if loop(w).real < 0.0:
                gain = min(gain, (float(1.0 / abs(loop(w))), w / (2.0 * pi)))
        if (abs(x) - 1.0) * (abs(y) - 1.0) < 0.0:
            w = _root(lambda v: abs(loop(v)) - 1.0, a, b)
            phases = min(phases, (degrees(phase(-loop(w))), w / (2.0 * pi)))
    return gain, phases


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Find a sign change of a function."""
    sign = 1.0 if function(high) > 0.0 else -1.0
    return rising_zero(lambda w: sign * float(function(w)), low, high)


def spectral_radius(point: Sequence[Sampled], law: System) -> float:
    """Magnitude of the largest pole of a closed loop; NaN for one of too many states."""
    longest = [one.whole + 1 for one in point]
    if point[0].new.size + law.b.size + sum(longest) > _STATES:
        return nan
    return float(np.abs(np.linalg.eigvals(_closed(point, law))).max())


def _closed(point: Sequence[Sampled], law: System) -> FloatArray:
    """Matrix of the loop: states of the plant, of the controller, and commands on their way."""
    n, m = point[0].new.size, law.b.size
    size = n + m + sum(one.whole + 1 for one in point)
    matrix = np.zeros((size, size))
    falls_short = np.zeros(size)
    falls_short[:n] = -point[0].output
    matrix[:n, :n] = point[0].phi
    matrix[n : n + m, n : n + m] = law.a
    matrix[n : n + m] += np.outer(law.b, falls_short)
    sent = n + m  # the command of the last sample, and those before it
    for i, one in enumerate(point):
        command = law.d[i] * falls_short
        command[n : n + m] += law.c[i]
        line = [command, *np.eye(size)[sent : sent + one.whole + 1]]
        matrix[:n] += np.outer(one.new, line[one.whole]) + np.outer(one.old, line[one.whole + 1])
        for k in range(one.whole + 1):
            matrix[sent + k] = line[k]
        sent += one.whole + 1
    return matrix
