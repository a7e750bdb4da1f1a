"""Two or more logs of one experiment: every column at its own instants, on one clock."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path

import numpy as np

from ..errors import LogError
from .arrays import Named, joined, make_log
from .columns import Binding, time_candidate
from .log import Column, Log
from .timebase import split_runs


def merged(logs: Sequence[Log]) -> Log:
    """Return one log of several that were recorded at the same time by the same clock.

    Raises
    ------
    LogError
        When one has no time, several runs, or none in common with the others.
    """
    parts, ends, notices = [], [], []
    taken: set[str] = set()
    times = [time_candidate(log) for log in logs]
    counted = [_counted_from(t) for t in times if t is not None]
    origin = min(counted, default=Decimal(0)) if all(counted) else Decimal(0)
    for log, time in zip(logs, times):
        if time is None:
            raise LogError(
                "there is no time column, so it cannot be merged.",
                where=log.name,
                remedy="Name the column of the time 'time' in its header.",
            )
        runs, said = split_runs(log, time)
        if len(runs) > 1:
            raise LogError(
                f"it holds {len(runs)} runs, and one can be merged.",
                where=log.name,
                remedy="Cut the file into its runs.",
            )
        (run,) = runs
        instants = run.time
        if counted_from := _counted_from(time):  # the first of the file: now from that of them all
            instants = np.round(instants + float(counted_from - origin), 12)
        notices += [*log.notices, *said]
        ends.append((float(instants[0]), float(instants[-1])))
        columns = [c for c in log.columns if c.index != time.column.index]
        named = [_named(c, log, run.rows, taken) for c in columns]
        parts.append([Named("time", instants, "s"), *named])
    name = "+".join(log.name for log in logs)
    if max(low for low, _ in ends) >= min(high for _, high in ends):
        raise LogError(
            "the logs have no instant in common.",
            where=name,
            expected="Expected logs of one experiment, on one clock.",
            remedy="Give them one by one if they are several experiments.",
        )
    checksum = hashlib.sha256("".join(log.sha256 for log in logs).encode()).hexdigest()
    found = joined(parts, name)
    path = Path("+".join(str(log.path) for log in logs))
    return make_log(found, name, "merged", path=path, sha256=checksum, notices=notices)


def _counted_from(time: Binding) -> Decimal:
    """Instant from which the stamps of a log count [s]; 0 where they are as they were written."""
    exact = time.column.exact
    if exact is None:
        return Decimal(time.column.since) / 10**9
    return exact.first * Decimal(repr(abs(time.to_si)))


def _named(column: Column, log: Log, rows: np.ndarray, taken: set[str]) -> Named:
    """A column under its header, with the name of its log where another has the same."""
    header = column.header or f"{log.name} #{column.index}"
    if header in taken:
        header = f"{log.name}: {header}"
    taken.add(header)
    damaged = any(text for row, text in column.bad.items())
    return Named(header, column.values[rows], column.unit, sparse=not damaged)
