"""Selection of the rows that a fit uses, by ``--window`` and ``--exclude``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..errors import LogError, UsageError
from ..experiment import BoolArray
from .columns import time_candidate
from .exclusions import exclude_runs, with_rows
from .grid import Run, counted_run, untimed_run
from .log import Log
from .timebase import split_runs


def select_runs(log: Log, runs: Sequence[Run]) -> list[Run]:
    """Return the runs of a log within its window, less what is excluded.

    Raises
    ------
    UsageError
        When the log has no time for its window, or nothing is left.
    LogError
        When no sample lies within the window.
    """
    return exclude_runs(log, _within_window(log, runs))


def selected_part(log: Log) -> Log:
    """Return a log with only the rows that a fit uses, and nothing left to select.

    Raises
    ------
    UsageError, LogError
        As :func:`select_runs`; or when the time cannot be ordered.
    """
    if not log.window_text.strip(":") and all(x.kind in ("rows", "lines") for x in log.exclude):
        return log
    kept: BoolArray = np.zeros(log.rows, dtype=np.bool_)
    for run in select_runs(log, _all_runs(log)):
        kept[run.rows] = True
    return replace(with_rows(log, kept), window=None, exclude=())


def _all_runs(log: Log) -> list[Run]:
    """Return the runs of a log by its sample time, its time column, or as one."""
    if log.sample_time is not None:
        return [counted_run(log.rows, log.sample_time, log.places)]
    binding = time_candidate(log)
    return [untimed_run(log.rows)] if binding is None else split_runs(log, binding)[0]


def _within_window(log: Log, runs: Sequence[Run]) -> list[Run]:
    """Keep the seconds asked for, on each run's own time."""
    if log.window is None or log.window == (None, None):
        return list(runs)
    if not any(run.time.size for run in runs):
        raise UsageError(
            f"{log.name} has no time, so --window cannot be applied.",
            remedy="Give --column time=... or --sample-time, or leave --window out.",
        )
    low = -np.inf if log.window[0] is None else log.window[0]
    high = np.inf if log.window[1] is None else log.window[1]
    kept = []
    for run in runs:
        # A bound at a sample's own instant keeps the sample, rounding aside.
        slack = 1e-6 * run.sample_time
        inside = (run.time >= low - slack) & (run.time <= high + slack)
        if inside.any():
            kept.append(run.part(inside))
    if not kept:
        first = min(float(run.time[0]) for run in runs if run.time.size)
        last = max(float(run.time[-1]) for run in runs if run.time.size)
        raise LogError(
            f"no sample lies within the window {log.window_text} s.",
            where=log.name,
            expected=f"Its time runs from {first:g} to {last:g} s.",
            remedy="Choose the window within these seconds.",
        )
    return kept
