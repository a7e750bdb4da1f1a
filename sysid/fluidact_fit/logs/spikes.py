"""Single samples that no machine produces: a lost byte, a broken contact, a reading of zero.

A spike is one sample wide: the signal jumps and is back where it was with the next sample, and
nothing else in the record jumps nearly as far. At the ends of a record there is one neighbour
only, and a step that is recorded from its first sample looks the same; a sample there is taken
for a spike only where no input moves.

Criteria are far on the safe side: what is less clear stays in the record, and the fit says so
where its result hangs on it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import Notice
from ..experiment import BoolArray, Experiment, FloatArray, IndexArray, Signal
from ..specification import Variant
from .log import count_of

_FARTHER = 5.0  # times the largest other jump of the record
_BACK = 0.2  # part of the jump by which the neighbours may differ
_MOVED = 0.3  # part of its largest jump by which an input has moved
_USUAL = 3.0  # times its usual change
_NEAR = 3  # samples within which an input would explain it
_FEWEST = 20  # samples of a record that is looked at
_SHARE = 0.005  # largest part of a record that can be spikes
_NEVER = 10.0  # times the range of a record, to which no input moves an output
_ELSEWHERE = 3  # other moves of the inputs, to which the output did nothing of the kind
_LISTED = 5


def replace_spikes(experiment: Experiment, variant: Variant) -> tuple[Experiment, list[Notice]]:
    """Replace spikes of measured signals by what lies between their neighbours.

    Held inputs stay as they are: a command may well be one sample long. Returned with one warning
    per role with spikes.
    """
    if experiment.samples < _FEWEST:
        return experiment, []
    moved = where_inputs_move(experiment, variant)
    signals, notices = dict(experiment.signals), []
    for role in variant.roles:
        signal = experiment.signals.get(role.name)
        if signal is None or signal.values.size != experiment.samples or signal.hold == "zoh":
            continue
        others = moved if role.output else np.broadcast_to(np.False_, moved.shape)
        found = find_spikes(signal.values, others)
        if not found.size:
            continue
        kept = np.delete(np.arange(signal.values.size), found)
        values = signal.values.copy()  # straight lines across the spikes; the ends are level
        # sample numbers where there is no time
        time = experiment.time if experiment.time.size else np.arange(kept.size + found.size)
        values[found] = np.interp(time[found], time[kept], signal.values[kept])
        signals[role.name] = replace(
            signal,
            values=values,
            before=float(values[0]),
            recorded=dict(zip(found.tolist(), signal.values[found].tolist())),
        )
        notices.append(_notice(experiment, signal, found))
    return replace(experiment, signals=signals), notices


def find_spikes(values: FloatArray, moved: BoolArray) -> IndexArray:
    """Return the samples that stand alone, in order; none where an input has ``moved``.

    Shape ``(n,)`` each.
    """
    alone, height = _back_again(values)
    if moved.any():
        explained = moved[alone]
        if explained.any() and np.count_nonzero(moved) > _ELSEWHERE * (_NEAR + 2):
            low, high = np.quantile(values, (_SHARE, 1.0 - _SHARE))
            explained &= height <= _NEVER * (high - low)
        alone, height = alone[~explained], height[~explained]
    most = max(3, int(_SHARE * values.size))
    highest = np.argsort(-height)[:most]
    order = alone[highest]
    far = height[highest] > _FARTHER * _left_when_removed(values, order)
    count = int(np.flatnonzero(far)[-1]) + 1 if far.any() else 0
    return np.sort(order[:count])


def _back_again(values: FloatArray) -> tuple[IndexArray, FloatArray]:
    """Samples from which the signal is back with the next, and how far off each lies, ``(m,)``."""
    jumps = np.diff(values)
    turns = np.flatnonzero(jumps[:-1] * jumps[1:] < 0.0)
    inner = np.minimum(np.abs(jumps[turns]), np.abs(jumps[turns + 1]))
    found = np.abs(values[turns + 2] - values[turns]) <= _BACK * inner
    places, heights = [1 + turns[found]], [inner[found]]
    first, last = np.abs(np.diff(values[:3])), np.abs(np.diff(values[-3:]))[::-1]
    for place, (jump, beside) in ((0, first), (values.size - 1, last)):
        if jump > 0.0 and beside <= _BACK * jump:
            places.append(np.array([place]))
            heights.append(np.array([jump]))
    return np.concatenate(places), np.concatenate(heights)


def _left_when_removed(values: FloatArray, order: IndexArray) -> FloatArray:
    """Largest jump that is left when the first 1, 2, ... samples of ``order`` are gone.

    Shape ``(m,)``; every sample takes the jumps on both its sides with it.
    """
    sides = np.column_stack((order - 1, order)).ravel()
    inside = (sides >= 0) & (sides < values.size - 1)
    # a jump goes with the first of its two samples
    jumps, first = np.unique(sides[inside], return_index=True)
    largest = np.zeros(order.size + 1)
    size = np.abs(np.diff(values))
    np.maximum.at(largest, np.flatnonzero(inside)[first] // 2, size[jumps])
    size[jumps] = 0.0
    largest[-1] = size.max()
    left: FloatArray = np.maximum.accumulate(largest[::-1])[::-1][1:]
    return left


def where_inputs_move(experiment: Experiment, variant: Variant) -> BoolArray:
    """Samples at which, or shortly before which, an input jumps; shape ``(n,)``."""
    n = experiment.samples
    moved = np.zeros(n, dtype=bool)
    for role in variant.roles:
        signal = experiment.signals.get(role.name)
        if signal is None or role.output:
            continue
        if signal.values.size != n:  # a step that was not recorded
            if experiment.time.size and signal.time.size:
                away = np.abs(experiment.time - signal.time[0])
                moved |= away <= _NEAR * experiment.sample_time
            continue
        jumps = _jumps(signal.values)
        for near in range(-1, 1 + _NEAR):
            moved[np.clip(jumps + near, 0, n - 1)] = True
    return moved


def _jumps(values: FloatArray) -> IndexArray:
    """Samples with which a signal jumps: by more than it changes all the time, as a sine does."""
    size = np.abs(np.diff(values))
    if not size.size:
        return np.zeros(0, dtype=np.intp)
    return np.flatnonzero(size > max(_MOVED * size.max(), _USUAL * np.median(size)))


def _notice(experiment: Experiment, signal: Signal, found: IndexArray) -> Notice:
    timed = experiment.time.size > 0
    listed = ", ".join(
        signal.text(signal.values[k], ".4g")
        + (f" at t = {experiment.time[k]:.6g} s" if timed else f" in sample {k + 1}")
        for k in found[:_LISTED]
    )
    more = f" and {found.size - _LISTED} more" if found.size > _LISTED else ""
    one = found.size == 1
    are, was = ("is an isolated spike", "was") if one else ("are isolated spikes", "were")
    return Notice(
        "spikes",
        f"{experiment.name}: {count_of(found.size, 'sample')} of '{signal.role}' {are} "
        f"({listed}{more}), and {was} replaced by interpolation. "
        "Check the cable, the converter and the logger.",
    )
