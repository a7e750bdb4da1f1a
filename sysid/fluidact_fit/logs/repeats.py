"""Readings of a channel slower than its log: repeated or drawn out; and rows that stand twice."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from itertools import combinations, islice, product

import numpy as np

from ..errors import LogError, Notice
from ..experiment import Experiment, FloatArray, where_changed
from ..specification import Variant
from .checks import smallest_step
from .columns import Binding
from .log import Log

_SET = ("V", "A", "1")  # units of what a controller sets and holds; others are of sensors
_FAST = 4.0  # times the least change: between two such ones a signal does not rest by chance
_LONGEST = 10  # rows for which a slow channel repeats a reading
_FEWEST = 10  # repeats
_SHARE = 0.03  # of the changes of a moving signal, that come late
_CHANCE = 3.0  # times the repeats that noise makes
_SLOWED = 0.5  # of the next change, to which a motion falls that comes to rest or leaves it
_ONWARDS = 0.7  # of successive changes in one direction: a motion, not levels set one by one
_REST = 0.2  # of its steps elsewhere, by which a channel moves that does not rest
_ALWAYS = 0.98  # of the changes of a signal that repeats every reading
_PART = 100_000  # rows that tell lines between readings as well as all
_ROUNDING = 2.1  # steps of a printed number that three on a line may be off it
_STRAIGHT = 0.25  # of the rows lie on a line between their neighbours, at least
_BENT = 200  # that do not
_EVEN = 0.4  # of their rows come in even steps; by chance a quarter
_LINE = 20.0  # rows of a line; longer ones are of a motion
_ROWS = 25  # that two records have in common only if one is a copy
_HALF = 0.51  # steps by which a number is off when it is printed in fewer digits
_SINGLE = 1e-6  # of its range, by which a channel is off in single precision
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


def check_lines(
    log: Log, bindings: Mapping[str, Binding], experiments: Sequence[Experiment]
) -> Iterator[Notice]:
    """Warn of channels that follow straight lines between readings further apart.

    Rows between two readings were computed: they clip every peak, and their errors are no noise.
    """
    for role, binding in bindings.items():
        # inputs may be commanded in lines, and a hold describes them
        if role == "time" or binding.role.hold is not None or binding.role.unit in _SET:
            continue
        parts = [e[role] for e in experiments if role in e and e[role].size == e.time.size > 0]
        apart = max((rows_of_a_line(p) for p in parts), default=0.0)
        if apart == 0.0:
            continue
        yield Notice(
            "readings-interpolated",
            f"{log.name}: {role} (column '{binding.column.label}') follows straight lines between "
            f"readings some {apart:.2g} rows apart: the log was resampled, or a slower "
            "channel brought to its rate. What is between readings was not measured, and peaks are "
            "cut off: masses, lags and frequencies depend on it. Use the log as it was recorded, "
            "each channel with its own time.",
        )


def rows_of_a_line(values: FloatArray) -> float:
    """Mean number of rows from a reading to the next on straight lines; 0 without such lines."""
    begin = max((values.size - _PART) // 2, 0)
    some = values[begin : begin + _PART]
    off = np.abs(np.diff(some, 2))
    size = float(np.abs(some).max(initial=0.0))
    rounding = max(_ROUNDING * smallest_step(some), 16.0 * np.finfo(float).eps * size)
    bent = off > rounding
    count = np.count_nonzero(bent)
    if count < _BENT or count > (1.0 - _STRAIGHT) * bent.size:
        return 0.0
    even = np.abs(np.fft.rfft(bent - bent.mean())) / count
    first = int(np.argmax(even > 0.6 * even.max()))  # those behind it are its multiples
    rows = bent.size / max(first, 1)
    return rows if even[first] > _EVEN and rows < _LINE else 0.0


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

    A quick look that spares nearly all signals the other one.
    """
    size = np.abs(np.diff(values))
    changes = int(np.count_nonzero(size))
    same = size.size - changes
    if changes < 3 * _FEWEST or same < _FEWEST:
        return False
    fast = size >= _FAST * float(size[size > 0.0].min())
    return bool(same >= _SHARE * np.count_nonzero(fast[1:] & fast[:-1]))


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
    # a motion slows down to a rest and gathers speed from it; a late reading is as large as others
    around = np.concatenate(([0.0], size, [0.0]))
    rests = (around[1:-2] < _SLOWED * around[:-3]) | (around[2:-1] < _SLOWED * around[3:])
    paused = moving & (rows > 1)
    late = int(np.count_nonzero(paused & ~rests))
    # noise of a converter makes no change about as often as one of a single step to either side
    beside = (rows[:-1] == 1) & (rows[1:] == 1)
    small = beside & (size[1:-1] < 1.5 * least) & fast[:-2] & fast[2:]
    by_chance = _CHANCE * (0.5 * float(np.count_nonzero(small)) + 1.0)
    if late < max(_FEWEST, by_chance, _SHARE * float(np.count_nonzero(moving))):
        return 1.0
    if led and np.count_nonzero(paused) > _ALWAYS * np.count_nonzero(moving):
        return float(rows[moving].mean())
    onwards = steps[:-1] * steps[1:] > 0.0
    if np.count_nonzero(onwards & moving) < _ONWARDS * np.count_nonzero(moving):
        return 1.0
    return float(rows[moving].mean())


def find_copied_rows(variant: Variant, experiments: Sequence[Experiment]) -> list[Notice]:
    """Refuse runs that hold the same rows (``LogError``); warn of rows that stand twice in one."""
    role = variant.output.name
    runs = [e for e in experiments if role in e and e[role].size >= _ROWS]
    seen: dict[bytes, Experiment] = {}
    for e in runs:
        if np.count_nonzero(np.diff(e[role])) < _FEWEST:
            continue  # at rest all are alike
        other = seen.setdefault(_digest(e), e)
        if other is not e:
            raise _twice(other, e)
    tables = [_channels(e, variant) for e in runs[:_MOST]]
    if len(runs) <= _MOST:
        for (other, one), (e, two) in combinations(zip(runs, tables, strict=True), 2):
            if _overlap(one, two):
                raise _twice(other, e)
    found = ((e, _repeated_rows(table)) for e, table in zip(runs, tables, strict=False))
    return [_rows_twice(e, *copy) for e, copy in found if copy is not None]


def refuse_fitted_rows(
    variant: Variant, fitted: Sequence[Experiment], judged: Sequence[Experiment]
) -> None:
    """Refuse to validate with rows that are fitted (``LogError``)."""
    output = variant.output.name
    tables = [
        [(e, _channels(e, variant)) for e in runs if output in e and e[output].size >= _ROWS]
        for runs in (fitted, judged)
    ]
    for (one, known), (two, other) in islice(product(*tables), _MOST**2):
        if _overlap(known, other):
            names = f"{two.name} holds rows of {one.name}"
            raise LogError(
                f"{names if one.name != two.name else f'{two.name} holds rows'}, which are fitted.",
                expected="Expected other rows to validate with: the model was fitted to these.",
                remedy="Validate with another log, or split this one with --window and "
                "--validate-window.",
            )


def _digest(e: Experiment) -> bytes:
    """The same for runs with the same readings only."""
    found = sha256()
    for signal in e.signals.values():
        found.update(np.ascontiguousarray(signal.values).data)
    return found.digest()


def _channels(e: Experiment, variant: Variant) -> list[FloatArray]:
    """Channels of a run that were recorded with every row, that of the output first."""
    output = variant.output.name
    names = [output, *(r.name for r in variant.roles if r.name != output)]
    return [e[n] for n in names if n in e and e[n].size == e[output].size]


def _overlap(one: Sequence[FloatArray], two: Sequence[FloatArray]) -> bool:
    """Return whether some consecutive rows, each unlike the one before, stand in both.

    To the last bit, or as far as one of them was rounded when it was written in other digits.
    """
    if len(one) != len(two):
        return False
    rounding = [_rounding(a, b) for a, b in zip(one, two, strict=True)]
    return any(
        True
        for within in ([0.0] * len(one), rounding)
        for part in _probes(two, within)
        for _ in _places(one, [c[part] for c in two], within)
    )


def _rounding(one: FloatArray, two: FloatArray) -> float:
    """Distance of a reading from its copy in fewer digits: half a step of the coarser."""
    step, span = max(smallest_step(one), smallest_step(two)), float(np.ptp(two))
    return max(_HALF * step, _SINGLE * span)


def _repeated_rows(channels: Sequence[FloatArray]) -> tuple[slice, int] | None:
    """Rows of a run that repeat earlier ones, and how many rows earlier those stand."""
    exactly = [0.0] * len(channels)
    for part in _probes(channels, exactly):
        for other in _places(channels, [c[part] for c in channels], exactly):
            first, apart = min(part.start, other), abs(part.start - other)
            if apart < _ROWS:
                continue
            unlike = np.any([c[apart:] != c[:-apart] for c in channels], axis=0)
            ends = np.concatenate(([-1], np.flatnonzero(unlike), [unlike.size]))
            k = int(np.searchsorted(ends, first))
            return slice(int(ends[k - 1]) + 1 + apart, int(ends[k]) + apart), apart
    return None


def _probes(channels: Sequence[FloatArray], within: Sequence[float]) -> Iterator[slice]:
    """Some stretches of a run in which each row is unlike the one before, by more than that."""
    for at in np.linspace(0, channels[0].size - _ROWS, _PROBES).astype(int).tolist():
        part = slice(at, at + _ROWS)
        moved = [np.abs(np.diff(c[part])) > w for c, w in zip(channels, within, strict=True)]
        if np.any(moved, axis=0).all():
            yield part


def _places(
    channels: Sequence[FloatArray], rows: Sequence[FloatArray], within: Sequence[float]
) -> Iterator[int]:
    """First rows of all that a run holds of given rows, ``within`` a distance in each channel."""
    last = channels[0].size - rows[0].size + 1
    for k in np.flatnonzero(np.abs(channels[0][:last] - rows[0][0]) <= within[0])[:_MOST].tolist():
        at = slice(k, k + rows[0].size)
        if all(
            bool((np.abs(c[at] - r) <= w).all())
            for c, r, w in zip(channels, rows, within, strict=True)
        ):
            yield k


def _rows_twice(e: Experiment, rows: slice, apart: int) -> Notice:
    first, last = rows.start + 1, rows.stop
    return Notice(
        "rows-repeated",
        f"{e.name}: rows {first} to {last} hold the same readings as rows {first - apart} to "
        f"{last - apart}. If they were copied, they count twice and the intervals are too short: "
        "remove them from the log. A simulated log without noise may repeat itself.",
    )


def _twice(one: Experiment, two: Experiment) -> LogError:
    names = f"{one.name} and {two.name}"
    if one.name == two.name:
        names = f"{one.name} and another log of that name"
    remedy = "Leave one of them out, or cut what they share with --window."
    if one.log == two.log:
        remedy = "Leave one of the two runs out with --exclude, or remove the rows from the log."
    return LogError(
        f"{names} hold the same rows.",
        expected="Expected every recording once: what counts twice makes intervals too short.",
        remedy=remedy,
    )
