"""Rows that a logger lost: when they would have been recorded, and what a driving signal was then.

A gap of about a whole number of sample times holds rows that were never written. Taking the
last value before it shifts what a held signal does by part of a sample.

The values are those of the polynomial through two, four, six or eight samples about the gap,
whichever predicts the intact samples best when as many are left out of those; how well it does is
the error of the values.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..experiment import FloatArray, Signal

_LONGEST = 5.5  # sample times of a gap that is filled; beyond it nothing is known
_OFF = 0.3  # sample times by which a gap may miss a whole number of them
_FEWEST = 16  # samples that show how the signal moves
_SIDES = (1, 2, 3, 4)  # samples on either side that a polynomial goes through


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
    count = np.diff(t) / float(np.median(np.diff(t)))
    whole = np.round(count)
    gaps = np.flatnonzero((whole > 1.0) & (count < _LONGEST) & (np.abs(count - whole) < _OFF))
    if not gaps.size:
        return None
    parts = []
    for width in np.unique(whole[gaps]):
        of_width = gaps[whole[gaps] == width]
        share = np.arange(1, int(width)) / width
        values, error = _predicted(signal, of_width, count, share)
        time = t[of_width, None] + share * (t[of_width + 1] - t[of_width])[:, None]
        parts.append((time.ravel(), values.ravel(), np.full(time.size, error)))
    time, values, errors = (np.concatenate(rows) for rows in zip(*parts))
    order = np.argsort(time, kind="stable")
    return LostRows(time[order], values[order], errors[order])


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
    signal: Signal, gaps: npt.NDArray[np.intp], count: FloatArray, share: FloatArray
) -> tuple[FloatArray, float]:
    """Values of the rows at some shares of gaps, ``(gaps, rows)``, and their standard deviation."""
    t, u = signal.time, signal.values
    missed = [_missed(u, count, share, side) for side in _SIDES]
    side = _SIDES[int(np.argmin(missed))]
    if missed[side - 1] == np.inf:  # no intact stretch is long enough: a straight line
        side, missed[0] = 1, float(np.std(u))
    first = np.clip(gaps - side + 1, 0, t.size - 2 * side)
    at = first[:, None] + np.arange(2 * side)
    nodes = (t[at] - t[gaps, None]) / (t[gaps + 1] - t[gaps])[:, None]
    return np.sum(_weights(nodes, share) * u[at][:, None, :], axis=2), missed[side - 1]


def _missed(u: FloatArray, count: FloatArray, share: FloatArray, side: int) -> float:
    """Root mean square error where as many intact samples are left out; infinite without any."""
    rows = share.size
    length = 2 * side + rows
    odd = np.concatenate(([0], np.cumsum(np.abs(count - 1.0) >= _OFF)))
    begin = np.flatnonzero(odd[length - 1 :] == odd[: 1 - length])
    if not begin.size:
        return np.inf
    inside = side + np.arange(rows)
    outside = np.delete(np.arange(length), inside)
    weights = np.zeros((rows, length))
    weights[:, inside] = -np.eye(rows)
    nodes = (outside[None].astype(np.float64) - side + 1.0) / (rows + 1.0)
    weights[:, outside] = _weights(nodes, share)[0]
    errors = u[begin[:, None] + np.arange(length)] @ weights.T
    return float(np.sqrt(np.mean(errors**2)))


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
