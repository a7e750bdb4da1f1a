"""Outlets of lines whose logs begin in motion: first order behind a dead time, on a fine grid."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

Array = npt.NDArray[np.float64]
Inlet = Callable[[Array], Array]

_FINE = 20  # instants of the simulation per sample
_BEFORE = 12.0  # time constants and dead times that are simulated before the log begins


def sines(rng: np.random.Generator, slowest: float, fastest: float, count: int = 4) -> Inlet:
    """Sum of sines between two frequencies [Hz] that has been there for ever, of size one."""
    f = np.exp(rng.uniform(np.log(slowest), np.log(fastest), count))
    turn, size = rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(0.3, 1.0, count)
    return lambda t: np.asarray(
        (size * np.sin(2.0 * np.pi * f * t[:, None] + turn)).sum(axis=1) / size.sum()
    )


def steps(rng: np.random.Generator, shortest: float, longest: float, step: float) -> Inlet:
    """Levels held for random times, changing on the grid of the samples."""
    gaps = rng.uniform(shortest, longest, 4000)
    at = np.round((np.cumsum(gaps) - 2000.0 * shortest) / step) * step
    levels = rng.uniform(-1.0, 1.0, at.size + 1)
    return lambda t: np.asarray(levels[np.searchsorted(at, t + 1e-9, side="right")])


def line_log(
    rng: np.random.Generator,
    inlet: Inlet,
    *,
    gain: float = 1.0,
    time_constant: float,
    dead_time: float,
    step: float,
    span: float,
    noise: float = 0.005,
    offset: float = 0.0,
    sensor_lag: float = 0.0,
) -> dict[str, Array]:
    """Log of a line that was in motion long before; ``sensor_lag`` [s] is that of the inlet's."""
    h = step / _FINE
    before = round(_BEFORE * (time_constant + dead_time + sensor_lag) / step) * step
    t = np.arange(round((before + span) / h)) * h - before
    u = inlet(t)
    late = inlet(t - dead_time)
    recorded = slice(round(before / h), None, _FINE)
    outlet = gain * _lag(late, time_constant, h)[recorded] + offset
    logged = _lag(u, sensor_lag, h)[recorded] if sensor_lag else u[recorded]
    noisy = outlet + noise * rng.standard_normal(outlet.size)
    return {"time": t[recorded], "inlet": logged, "outlet": noisy}


def _lag(u: Array, lag: float, h: float) -> Array:
    """First-order lag [s], from rest, of what runs straight between instants ``h`` [s] apart."""
    a = np.exp(-h / lag)
    share = lag / h * (1.0 - a)
    return np.asarray(lfilter([1.0 - share, share - a], [1.0, -a], u - u[0]) + u[0])
