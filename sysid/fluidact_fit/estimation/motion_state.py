"""Motion state of a recording: loading or unloading, and which samples are well within it.

The state is held: it is the sign of the last change of a signal that was not noise. A signal that
rests keeps the state that brought it there, and so does the friction that goes with it.
"""

from __future__ import annotations

import numpy as np

from ..experiment import BoolArray, FloatArray
from .noise import noise_floor

_MEETING = 8  # samples after a reversal that belong to it in any case


def motion_state(column: FloatArray) -> FloatArray:
    """A log's direction column as 1 (loading), -1 (unloading) or 0 (unknown).

    Positive is loading and negative unloading; a column of 1 and 2 (pressurising, venting)
    or of 1 and 0 is understood as well.
    """
    kinds = set(np.unique(column).tolist())
    if kinds <= {1.0, 2.0} or kinds == {0.0, 1.0}:
        return np.where(column == 1.0, 1.0, -1.0)
    return np.sign(column)


def choose_dead_band(values: FloatArray) -> float:
    """Change that is not noise: what a median over five samples leaves, or 0.5 % of the range."""
    if values.size < 8:
        return 0.0
    flicker = np.abs(values - running_median(values, 2))
    noise = 6.0 * noise_floor(values)
    return float(max(3.0 * np.quantile(flicker, 0.9), noise, 5e-3 * float(np.ptp(values))))


def held_direction(values: FloatArray, dead_band: float) -> FloatArray:
    """Sign of the last change that exceeded a dead band: -1, 0 (not yet known) or 1.

    Parameters
    ----------
    values : (n,)
    dead_band
        Changes smaller than this leave the direction as it was [unit of values].
    """
    direction = np.zeros(values.size)
    anchor, now = values[0], 0
    for k, v in enumerate(values.tolist()):
        if v - anchor > dead_band:
            now, anchor = 1, v
        elif anchor - v > dead_band:
            now, anchor = -1, v
        elif now > 0:
            anchor = max(anchor, v)
        elif now < 0:
            anchor = min(anchor, v)
        direction[k] = now
    return direction


def running_median(values: FloatArray, half: int) -> FloatArray:
    """Median over ``half`` samples on either side, the ends mirrored."""
    padded = np.pad(values, half, mode="reflect" if values.size > half else "edge")
    return np.asarray(
        np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)
    )


def fill_start(direction: FloatArray) -> None:
    """Give the samples before the first change its direction, in place."""
    known = np.flatnonzero(direction)
    if known.size:
        direction[: known[0]] = direction[known[0]]


def settled_samples(values: FloatArray, direction: FloatArray, least: float) -> BoolArray:
    """Samples that have moved away from the last reversal by at least ``least``.

    The first few do not count however far a command has jumped: a rod that left the sensor
    meets it again in them.
    """
    turned = np.concatenate(([0], np.flatnonzero(np.diff(direction)) + 1))
    now = np.arange(values.size)
    last = turned[np.searchsorted(turned, now, side="right") - 1]
    return np.asarray((np.abs(values - values[last]) >= least) & (now - last >= _MEETING))
