"""Rows that a logger lost: when they would have been recorded, and what a driving signal was then.

A gap of about a whole number of sample times holds rows that were never written. A held signal
was not held across it: it took values that nobody knows, and taking the last one for them shifts
what it does by part of a sample, over and over. The values are predicted from those around
them, by the rule that predicts the intact ones best, which also shows how well it does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..experiment import FloatArray, Signal
from .inputs import GAP, settled_hold

_LONGEST = 5.5  # sample times of a gap that is filled; beyond it nothing is known
_OFF = 0.3  # sample times by which a gap may miss a whole number of them
_APART = 8  # samples between those that are left out to see what a curve misses
_FEWEST = 16  # samples that show how the signal moves
# weights of the two samples before and the two after; lines, and the cubic through all four
_RULES = (np.array([0.0, 0.5, 0.5, 0.0]), np.array([-1.0, 4.0, 4.0, -1.0]) / 6.0)


@dataclass(frozen=True)
class LostRows:
    """Instants between the samples at which rows are missing, and the signal there.

    ``time`` and ``values`` have shape ``(m,)`` [s, unit of the signal]; ``error`` is the
    standard deviation of the values, as the intact ones show it [unit of the signal].
    """

    time: FloatArray
    values: FloatArray
    error: float


def find_lost_rows(signal: Signal) -> LostRows | None:
    """Rows lost in a sampled signal; ``None`` where there are none, or nothing tells them."""
    t, u = signal.time, signal.values
    if t.size < _FEWEST:
        return None
    smooth = settled_hold(signal) == "smooth"
    step = float(np.median(np.diff(t)))
    count = np.diff(t) / step
    whole = np.round(count)
    longest = min(_LONGEST, GAP) if smooth else _LONGEST
    gaps = np.flatnonzero((whole > 1.0) & (count < longest) & (np.abs(count - whole) < _OFF))
    if not gaps.size:
        return None
    time = [t[g] + np.arange(1, int(whole[g])) / whole[g] * (t[g + 1] - t[g]) for g in gaps]
    if smooth:
        return _on_curve(t, u, np.concatenate(time))
    rule, error = _best_rule(u, count)
    values = [_predict(t, u, int(g), asked, cubic=rule == 1) for g, asked in zip(gaps, time)]
    return LostRows(np.concatenate(time), np.concatenate(values), error)


def _on_curve(t: FloatArray, u: FloatArray, asked: FloatArray) -> LostRows:
    """Rows on the cubic spline through the others, which stays the curve that it is.

    Every eighth sample in turn is left out to see how far the curve of the others misses it.
    """
    from scipy.interpolate import CubicSpline

    missed = []
    for first in range(2, 2 + _APART):
        out = np.arange(first, t.size - 2, _APART)
        curve = CubicSpline(np.delete(t, out), np.delete(u, out))
        missed.append(curve(t[out]) - u[out])
    error = float(np.sqrt(np.mean(np.concatenate(missed) ** 2)))
    return LostRows(asked, np.asarray(CubicSpline(t, u)(asked)), error)


def fill_lost_rows(signal: Signal) -> Signal:
    """The signal with a node at every lost row."""
    lost = find_lost_rows(signal)
    if lost is None:
        return signal
    time = np.concatenate((signal.time, lost.time))
    order = np.argsort(time, kind="stable")
    values = np.concatenate((signal.values, lost.values))
    return replace(signal, time=time[order], values=values[order])


def _best_rule(u: FloatArray, count: FloatArray) -> tuple[int, float]:
    """The rule that predicts the intact samples best, and its error (root mean square)."""
    whole = np.ones(u.size - 4, dtype=bool)
    for k in range(4):
        whole &= np.abs(count[k : count.size - 3 + k] - 1.0) < _OFF
    around = np.stack([u[k : u.size - 4 + k] for k in (0, 1, 3, 4)])[:, whole]
    if around.shape[1] < 4:
        return 0, float(np.std(u))
    errors = [
        float(np.sqrt(np.mean((weights @ around - u[2:-2][whole]) ** 2))) for weights in _RULES
    ]
    best = int(np.argmin(errors))
    return best, errors[best]


def _predict(
    t: FloatArray, u: FloatArray, gap: int, asked: FloatArray, *, cubic: bool
) -> npt.NDArray[np.float64]:
    """Values inside a gap, from the samples around it."""
    first, last = gap - 1, gap + 2
    if not cubic or first < 0 or last >= t.size:
        return np.interp(asked, t, u)
    at = slice(first, last + 1)
    middle, width = t[gap], t[gap + 1] - t[gap]
    powers = np.vander((t[at] - middle) / width, 4)
    coefficients = np.linalg.solve(powers, u[at])
    return np.asarray(np.vander((asked - middle) / width, 4) @ coefficients)
