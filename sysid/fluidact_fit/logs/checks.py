"""Checks of a log for what is wrong or looks so: notices, never errors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import Notice
from ..experiment import BoolArray, Experiment, FloatArray, IndexArray, where_changed, where_finite
from ..rows import blocks
from ..specification import Variant
from .columns import Binding
from .grid import Run
from .log import Column, Log, count_of, exclude_lines, name_lines

_MANY = 100_000
_GAP = 5.0
_JITTER = 0.2
_STUCK = 8
_MOVING = 50
_ASIDE = 3  # samples over which speed is judged
_FAST = 0.25
_AWAY = 10.0  # times the range of all other values
_VARIED = 20  # other values, of which there are few in a command
_RARE = 0.02


def smallest_step(values: FloatArray) -> float:
    """Return the smallest distance of two distinct values, 0 when all are equal.

    Converter or print resolution of a signal [unit of the values] of shape ``(n,)``; NaN are
    ignored. Of long signals a part is looked at.
    """
    if values.size > _MANY:
        # A stride would miss neighbouring codes of a slow signal, a single block might be flat.
        block = _MANY // 4
        at = np.linspace(0, values.size - block, 4).astype(int)
        values = np.concatenate([values[i : i + block] for i in at])
    steps = np.diff(np.unique(values[np.isfinite(values)]))
    return float(steps.min()) if steps.size else 0.0


def check_sampling(log: Log, runs: Sequence[Run]) -> Iterator[Notice]:
    """Report gaps and uneven sampling, once per log."""
    timed = [run for run in runs if run.time.size > 2 and not run.uniform]
    if not timed:
        return
    steps = np.concatenate([np.diff(run.time) for run in timed])
    rows = np.concatenate([run.rows[:-1] for run in timed])
    usual = float(np.median(steps))
    gaps = np.flatnonzero(steps > _GAP * usual)
    if gaps.size:
        worst = int(gaps[np.argmax(steps[gaps])])
        last = float(np.concatenate([run.time[:-1] for run in timed])[worst])
        yield Notice(
            "gap",
            f"{log.where(rows[worst])}: {steps[worst]:.4g} s without a sample after this line, "
            f"the longest of {count_of(gaps.size, 'gap')} (usual step {usual:.4g} s). What drove "
            "the machine meanwhile is unknown: --exclude "
            f"time={last:.6g}:{last + float(steps[worst]):.6g} makes a run of either side.",
        )
    rest = np.delete(steps, gaps)
    if rest.size and float(np.abs(rest - usual).max()) > _JITTER * usual:
        yield Notice(
            "uneven-sampling",
            f"{log.name}: sampling is uneven: steps of {steps.min():.4g} to "
            f"{steps.max():.4g} s, median {usual:.4g} s. The samples are used where they are.",
        )


def placeholder_rows(values: FloatArray) -> IndexArray:
    """Rows that hold one value far outside all others, as a logger writes for none (-999).

    ``values`` of shape ``(n,)``, NaN are ignored; empty where there is no such value.
    """
    for extreme in (np.fmax.reduce(values), np.fmin.reduce(values)) if values.size else ():
        if not np.isfinite(extreme) or not _is_far(values, extreme):
            continue
        count = np.count_nonzero(values == extreme)
        if not 1 < count <= _RARE * np.count_nonzero(where_finite(values)):
            continue
        others = values[np.isfinite(values) & (values != extreme)]
        if np.unique(others).size > _VARIED:
            return np.flatnonzero(values == extreme)
    return np.array([], dtype=np.int64)


def _is_far(values: FloatArray, extreme: float) -> bool:
    """Return whether a value is far from all others; a few of them mostly show that it is not."""
    low, high = np.inf, -np.inf
    for at in blocks(values.size):
        others = values[at][values[at] != extreme]
        low, high = np.fmin.reduce(others, initial=low), np.fmax.reduce(others, initial=high)
        if min(abs(extreme - low), abs(extreme - high)) <= _AWAY * (high - low):
            return False
    return True


def check_placeholders(log: Log, column: Column) -> Iterator[Notice]:
    """Name cells of a column with a value that can hardly have been measured."""
    rows = placeholder_rows(column.values)
    if column.clock or not rows.size:
        return
    others, lines = np.delete(column.values, rows), log.lines[rows]
    yield Notice(
        "placeholder-values",
        f"{log.name}: column '{column.label}' holds {column.values[rows[0]]:.10g} in "
        f"{count_of(rows.size, 'row')} ({name_lines(lines)}), far from all others "
        f"({np.nanmin(others):g} to {np.nanmax(others):g}): it seems to stand for a value that "
        f"is missing. Leave the rows out with {exclude_lines(lines)}.",
    )


@dataclass(frozen=True)
class Suspect:
    """A value [SI] that seems to stand for a missing one, and what is to be said of it."""

    value: float
    notices: Sequence[Notice]


def find_suspects(log: Log, bindings: Mapping[str, Binding]) -> dict[str, Suspect]:
    """Values of columns that seem to stand for missing ones, by role."""
    out = {}
    for role, binding in bindings.items():
        raw = binding.column.values
        rows = placeholder_rows(raw) if role != "time" else raw[:0]
        if rows.size:
            value = float(raw[rows[0]]) * binding.to_si
            out[role] = Suspect(value, list(check_placeholders(log, binding.column)))
    return out


def check_signals(
    log: Log,
    bindings: Mapping[str, Binding],
    experiments: Sequence[Experiment],
    suspects: Mapping[str, Suspect],
) -> Iterator[Notice]:
    """Report signals that stay at an extreme, or hold one of the ``suspects``.

    One that was replaced as a spike is held no more.
    """
    for role, binding in bindings.items():
        parts = [e[role] for e in experiments if role in e]
        if role == "time" or not parts or sum(part.size for part in parts) < 2:
            continue
        low = min(float(part.min()) for part in parts)
        high = max(float(part.max()) for part in parts)
        column = f"{log.name}: {role} (column '{binding.column.label}')"
        said = next(e for e in experiments if role in e).signals[role].text
        suspect = suspects.get(role)
        if suspect and any(bool(np.isin(part, suspect.value).any()) for part in parts):
            yield from suspect.notices
        if low < high and binding.role.hold != "zoh" and (samples := _clipped(parts, low, high)):
            yield Notice(
                "saturated",
                f"{column} stays at an end of its range, {said(low, 'g')} to {said(high, 'g')}, "
                f"for {samples} samples in a row: the sensor or its "
                "converter may be clipped. Record within its range, or cut the log with --window.",
            )


def find_constant_signals(variant: Variant, experiments: Sequence[Experiment]) -> Iterator[Notice]:
    """Report signals that never change, unless each log has a value of its own: those were set."""
    logs = {e.log: e.log_name for e in experiments}
    for role in (r.name for r in variant.roles):
        ends: dict[int, tuple[float, float]] = {}
        for e in experiments:
            if role in e and e[role].size > 1:
                low, high = ends.get(e.log, (np.inf, -np.inf))
                ends[e.log] = min(low, float(e[role].min())), max(high, float(e[role].max()))
        constant = {log: low for log, (low, high) in ends.items() if low == high}
        if len(constant) == len(ends) and len(set(constant.values())) > 1:
            continue
        for log, value in constant.items():
            signal = next(e.signals[role] for e in experiments if e.log == log and role in e)
            yield Notice(
                "constant-signal",
                f"{logs[log]}: {role} is always {signal.text(value, 'g')}. Check the column and "
                "the sensor.",
            )


def _clipped(parts: Sequence[FloatArray], low: float, high: float) -> int:
    """Return for how many samples a sensor sticks to its extreme but moves everywhere else.

    A command or a resting machine repeats values, too. Only a signal that hardly ever
    repeats one elsewhere, and that runs into the extreme with speed and leaves it with
    speed, is said to be clipped: what comes to rest slows down first. Otherwise 0.
    """
    if not any(_stays_at(part, end) for part in parts for end in (low, high)):
        return 0
    at_ends, elsewhere, moving = 0, 0, 0
    for part in parts:
        first = np.append(0, where_changed(part) + 1)
        length = np.diff(np.r_[first, part.size])
        extreme = (part[first] == low) | (part[first] == high)
        long = extreme & (length >= _STUCK)
        if long.any():
            abrupt = _is_abrupt(part, first[long], length[long])
            at_ends = max(at_ends, int(length[long][abrupt].max(initial=0)))
        moving += int(np.count_nonzero(~extreme))
        elsewhere = max(elsewhere, int(length[~extreme].max(initial=0)))
    clipped = at_ends >= _STUCK and elsewhere * 3 <= at_ends and moving >= _MOVING
    return at_ends if clipped else 0


def _stays_at(values: FloatArray, end: float) -> bool:
    """Return whether a signal stays at an end of its range for as long as a clipped one would."""
    for at in blocks(values.size):
        there = np.flatnonzero(values[at.start : at.stop + _STUCK - 1] == end)
        if np.any(there[_STUCK - 1 :] - there[: 1 - _STUCK] == _STUCK - 1):
            return True
    return False


def _is_abrupt(values: FloatArray, first: IndexArray, length: IndexArray) -> BoolArray:
    """Return whether a signal is fast both right before and right after it stays on a value.

    Fast is a quarter of what it is at its fastest, but for a tenth of the samples. Stays at
    the ends of the record are not judged: one of the two sides is not known.
    """
    last = first + length - 1
    whole = (first >= _ASIDE) & (last + _ASIDE < values.size)
    before = np.abs(values[first] - values[np.maximum(first - _ASIDE, 0)])
    after = np.abs(values[np.minimum(last + _ASIDE, values.size - 1)] - values[last])
    step = max(values.size // _MANY, 1)  # of long signals as many samples tell it
    speed = np.abs(values[_ASIDE::step] - values[: values.size - _ASIDE : step])
    usual = float(np.quantile(speed, 0.9))
    return np.asarray(whole & (np.minimum(before, after) >= _FAST * usual), dtype=np.bool_)
