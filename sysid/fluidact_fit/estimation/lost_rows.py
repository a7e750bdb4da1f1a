"""Rows that a logger lost: when they would have been recorded, and what a driving signal was then.

A gap of about a whole number of sample times holds rows that were never written. Taking the
last value before it shifts what a held signal does by part of a sample; a cubic spline across it
misses a smooth one by what a few instants of break-away can show.

The values are predicted from the samples on either side, by the polynomial through two, four, six
or eight of them that predicts the intact samples best when as many are left out of those; this
also shows how well it does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..experiment import FloatArray, Signal
from .inputs import settled_hold

_LONGEST = 5.5  # sample times of a gap that is filled; beyond it nothing is known
_OFF = 0.3  # sample times by which a gap may miss a whole number of them
_FEWEST = 16  # samples that show how the signal moves
_SIDES = (1, 2, 3, 4)  # samples on either side that a polynomial goes through
_AROUND = 24  # places beside a gap that show how a smooth signal moves there


@dataclass(frozen=True)
class LostRows:
    """Instants between the samples at which rows are missing, and the signal there.

    ``time``, ``values`` and ``error`` have shape ``(m,)`` [s, unit of the signal]; ``error`` are
    the standard deviations of the values, as the intact samples show them.
    """

    time: FloatArray
    values: FloatArray
    error: FloatArray


def find_lost_rows(signal: Signal) -> LostRows | None:
    """Rows lost in a sampled signal; ``None`` where there are none, or nothing tells them."""
    t = signal.time
    if t.size < _FEWEST:
        return None
    smooth = settled_hold(signal) == "smooth"
    step = float(np.median(np.diff(t)))
    count = np.diff(t) / step
    whole = np.round(count)
    gaps = np.flatnonzero((whole > 1.0) & (count < _LONGEST) & (np.abs(count - whole) < _OFF))
    if not gaps.size:
        return None
    parts = [
        _predicted(signal, gaps[whole[gaps] == width], int(width), count, local=smooth)
        for width in np.unique(whole[gaps])
    ]
    time, values, error = (np.concatenate(rows) for rows in zip(*parts))
    order = np.argsort(time, kind="stable")
    return LostRows(time[order], values[order], error[order])


def fill_lost_rows(signal: Signal) -> Signal:
    """The signal with a node at every lost row."""
    lost = find_lost_rows(signal)
    if lost is None:
        return signal
    time = np.concatenate((signal.time, lost.time))
    order = np.argsort(time, kind="stable")
    values = np.concatenate((signal.values, lost.values))
    return replace(signal, time=time[order], values=values[order])


def _predicted(
    signal: Signal, gaps: npt.NDArray[np.intp], width: int, count: FloatArray, *, local: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Instants, values and errors of the rows in gaps of one width, ``width - 1`` in each.

    A command jumps anywhere: how well it is predicted is the root mean square over the whole
    log. A smooth signal (``local``) goes on as it does around the gap.
    """
    t, u = signal.time, signal.values
    share = np.arange(1, width) / width
    time = t[gaps, None] + share * (t[gaps + 1] - t[gaps])[:, None]
    trials = [_left_out(u, count, width, side) for side in _SIDES]
    sizes = [float(np.mean(missed**2)) if place.size else np.inf for place, missed in trials]
    if min(sizes) == np.inf:  # no intact stretch is long enough
        values = np.interp(time, t, u)
        return time.ravel(), values.ravel(), np.full(time.size, float(np.std(u)))
    best = int(np.argmin(sizes))
    side, (place, missed) = _SIDES[best], trials[best]
    first = np.clip(gaps - side + 1, 0, t.size - 2 * side)
    at = first[:, None] + np.arange(2 * side)
    nodes = (t[at] - t[gaps, None]) / (t[gaps + 1] - t[gaps])[:, None]
    values = np.sum(_weights(nodes, share) * u[at][:, None, :], axis=2)
    if not local:
        return time.ravel(), values.ravel(), np.full(time.size, np.sqrt(sizes[best]))
    # other gaps and the ends of the log leave samples that are further off
    further = _reach(nodes, share) / _reach(_evenly(side, width)[None, :], share)
    error = _around(place, missed, gaps) * np.maximum(further, 1.0)
    return time.ravel(), values.ravel(), error.ravel()


def _left_out(
    u: FloatArray, count: FloatArray, width: int, side: int
) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """Errors of the prediction where ``width - 1`` intact samples are left out.

    Returns the index of the sample before, ascending, shape ``(k,)``, and the misses,
    shape ``(k, width - 1)``.
    """
    length = 2 * side + width - 1
    if u.size < length:
        return np.zeros(0, dtype=np.intp), np.zeros((0, width - 1))
    odd = np.concatenate(([0], np.cumsum(np.abs(count - 1.0) >= _OFF)))
    begin = np.flatnonzero(odd[length - 1 :] == odd[: odd.size - length + 1])
    weights = _weights(_evenly(side, width)[None, :], np.arange(1, width) / width)[0]
    missed = []
    for k, own in enumerate(weights):
        kernel = np.concatenate((own[:side], np.zeros(width - 1), own[side:]))
        kernel[side + k] = -1.0
        missed.append(np.correlate(u, kernel, "valid")[begin])
    return begin + side - 1, np.stack(missed, axis=1)


def _evenly(side: int, width: int) -> FloatArray:
    """Instants of ``side`` samples before and after a gap, which itself goes from 0 to 1."""
    before = np.arange(1 - side, 1)
    return np.concatenate((before, before + side - 1 + width)) / width


def _weights(nodes: FloatArray, asked: FloatArray) -> FloatArray:
    """Lagrange's weights of the values at nodes, shape ``(m, asked, nodes)``.

    ``nodes`` has shape ``(m, nodes)``, ``asked`` shape ``(asked,)``.
    """
    out = np.ones((nodes.shape[0], asked.size, nodes.shape[1]))
    for i in range(nodes.shape[1]):
        for j in range(nodes.shape[1]):
            if j != i:
                share = (asked - nodes[:, j, None]) / (nodes[:, i] - nodes[:, j])[:, None]
                out[:, :, i] *= share
    return out


def _reach(nodes: FloatArray, asked: FloatArray) -> FloatArray:
    """Error of a polynomial per unit of its first neglected derivative, shape ``(m, asked)``."""
    distances = np.abs(asked[None, :, None] - nodes[:, None, :])
    return np.asarray(np.prod(distances, axis=2))


def _around(
    place: npt.NDArray[np.intp], missed: FloatArray, gaps: npt.NDArray[np.intp]
) -> FloatArray:
    """Root mean square of the misses nearest to each gap, shape ``(gaps, width - 1)``."""
    number = min(_AROUND, place.size)
    total = np.cumsum(np.vstack((np.zeros((1, missed.shape[1])), missed**2)), axis=0)
    first = np.clip(np.searchsorted(place, gaps) - number // 2, 0, place.size - number)
    return np.sqrt((total[first + number] - total[first]) / number)
