"""Readings that stand twice: in a channel slower than its log, and in two logs of one fit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from itertools import combinations

import numpy as np

from ..errors import LogError, Notice
from ..experiment import Experiment, FloatArray, where_changed
from ..rows import blocks
from ..specification import Variant
from .columns import Binding
from .log import Log

_SET = ("V", "A", "1")  # units of what a controller sets and holds; others are of sensors
_FAST = 4.0  # times the least change: between two such ones a signal does not rest by chance
_LONGEST = 10  # rows for which a slow channel repeats a reading
_FEWEST = 10  # repeats
_SHARE = 0.03  # of the changes of a moving signal, that come late
_CHANCE = 3.0  # times the repeats that noise makes
_ONWARDS = 0.7  # of successive changes in one direction: a motion, not levels set one by one
_REST = 0.2  # of its steps elsewhere, by which a channel moves that does not rest
_ALWAYS = 0.98  # of the changes of a signal that repeats every reading
_ROWS = 25  # that two records have in common only if one is a copy
_PROBES = 16  # places of a record that are looked for in another one
_MOST = 40  # records that are compared with each other


def check_repeats(
    log: Log, bindings: Mapping[str, Binding], experiments: Sequence[Experiment]
) -> Iterator[Notice]:
    """Warn of channels that repeat their last reading although they move.

    A converter slower than the logger leaves rows with old readings: the channel comes late by a
    part of its own period, which no model knows of.
    """
    static = all(b.role.hold is None for b in bindings.values())
    for role, binding in bindings.items():
        if role == "time" or (binding.role.hold == "zoh" and binding.role.unit in _SET):
            continue
        parts = [e[role] for e in experiments if role in e and e[role].size == e.time.size]
        if all(rows_per_reading(p, led=True) == 1.0 for p in parts):
            continue
        # what drives nothing is not set level by level, but it may rest as all channels do
        led = binding.role.hold is None and any(_others_move(e, role) for e in experiments)
        if static and not led:
            continue
        every = max((rows_per_reading(p, led) for p in parts), default=1.0)
        if every == 1.0:
            continue
        step = next(e.sample_time for e in experiments if role in e)
        yield Notice(
            "readings-repeated",
            f"{log.name}: {role} (column '{binding.column.label}') repeats its last reading while "
            f"it moves: there is a new one about every {every:.3g} rows ({every * step:.3g} s), so "
            "what is recorded is late by up to that. Masses, lags and dead times depend on it. "
            "Record at the rate of the slowest channel, or each channel with its own time.",
        )


def _others_move(experiment: Experiment, role: str) -> bool:
    """True if another channel moves while one repeats its reading, as it does at other rows."""
    if role not in experiment or experiment[role].size != experiment.time.size:
        return False
    new = np.diff(experiment[role]) != 0.0
    if not 0 < np.count_nonzero(new) < new.size:
        return False
    for other, signal in experiment.signals.items():
        if other == role or signal.values.size != experiment.time.size:
            continue
        steps = np.abs(np.diff(signal.values))
        if np.median(steps[~new]) > _REST * np.median(steps[new]):
            return True
    return False


def _may_repeat(values: FloatArray) -> bool:
    """Return whether there are rows enough without a new reading, beside those of a motion.

    A quick look, block by block, that spares nearly all signals the other one.
    """
    same, changes, least, moving = 0, 0, np.inf, 0
    for at in blocks(values.size - 1):
        size = np.abs(np.diff(values[at.start : at.stop + 1]))
        changed = size > 0.0
        count = int(np.count_nonzero(changed))
        same, changes = same + size.size - count, changes + count
        moves = size if count == size.size else size[changed]
        least = min(least, float(moves.min(initial=np.inf)))
    if changes < 3 * _FEWEST or same < _FEWEST:
        return False
    for at in blocks(values.size - 1):
        fast = np.abs(np.diff(values[at.start : at.stop + 1])) >= _FAST * least
        moving += int(np.count_nonzero(fast[1:] & fast[:-1]))
    return same >= _SHARE * moving


def rows_per_reading(values: FloatArray, led: bool = False) -> float:
    """Mean number of rows that a reading of a moving signal stands for; 1 where all are new.

    A signal that is ``led`` follows others: where it never changes from one row to the next it
    repeats its readings, be it in motion or in its noise.
    """
    if not _may_repeat(values):
        return 1.0
    changes = where_changed(values)
    steps = values[changes + 1] - values[changes]
    size = np.abs(steps)
    least = float(size.min())
    fast = size >= _FAST * least
    rows = np.diff(changes)
    moving = fast[:-1] & fast[1:] & (rows <= _LONGEST)
    late = int(np.count_nonzero(moving & (rows > 1)))
    # noise of a converter makes no change about as often as one of a single step to either side
    beside = (rows[:-1] == 1) & (rows[1:] == 1)
    small = beside & (size[1:-1] < 1.5 * least) & fast[:-2] & fast[2:]
    by_chance = _CHANCE * (0.5 * float(np.count_nonzero(small)) + 1.0)
    if late < max(_FEWEST, by_chance, _SHARE * float(np.count_nonzero(moving))):
        return 1.0
    if led and late > _ALWAYS * np.count_nonzero(moving):
        return float(rows[moving].mean())
    onwards = steps[:-1] * steps[1:] > 0.0
    if np.count_nonzero(onwards & moving) < _ONWARDS * np.count_nonzero(moving):
        return 1.0
    return float(rows[moving].mean())


def require_other_data(variant: Variant, experiments: Sequence[Experiment]) -> None:
    """Refuse logs that hold the same rows: each counts once (``LogError``)."""
    role = variant.output.name
    runs = [e for e in experiments if role in e and e[role].size >= _ROWS]
    if len({e.log for e in runs}) < 2:
        return
    seen: dict[bytes, Experiment] = {}
    for e in runs:
        other = seen.setdefault(_digest(e), e)
        if other.log != e.log:
            raise _twice(other, e)
    if len(runs) > _MOST:
        return
    tables = [_table(e, variant) for e in runs]
    for (other, one), (e, two) in combinations(zip(runs, tables, strict=True), 2):
        if other.log != e.log and _overlap(one, two):
            raise _twice(other, e)


def _digest(e: Experiment) -> bytes:
    """The same for runs with the same readings only."""
    found = sha256()
    for signal in e.signals.values():
        found.update(np.ascontiguousarray(signal.values).data)
    return found.digest()


def _table(e: Experiment, variant: Variant) -> FloatArray:
    """Channels of a run that were recorded with every row, shape ``(n, c)``."""
    size = e[variant.output.name].size
    names = [r.name for r in variant.roles if r.name in e and e[r.name].size == size]
    return np.column_stack([e[n] for n in names])


def _overlap(one: FloatArray, two: FloatArray) -> bool:
    """Return whether some consecutive rows, each unlike the one before, stand in both."""
    if one.shape[1] != two.shape[1]:
        return False
    for at in np.linspace(0, two.shape[0] - _ROWS, _PROBES).astype(int):
        part = two[at : at + _ROWS]
        if np.any(np.all(np.diff(part, axis=0) == 0.0, axis=1)):
            continue
        for k in np.flatnonzero(one[: one.shape[0] - _ROWS + 1, -1] == part[0, -1])[:_MOST]:
            if np.array_equal(one[k : k + _ROWS], part):
                return True
    return False


def _twice(one: Experiment, two: Experiment) -> LogError:
    names = f"{one.name} and {two.name}"
    if one.name == two.name:
        names = f"{one.name} and another log of that name"
    return LogError(
        f"{names} hold the same rows.",
        expected="Expected every recording once: what counts twice makes intervals too short.",
        remedy="Leave one of them out, or cut what they share with --window.",
    )
