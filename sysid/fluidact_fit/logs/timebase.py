"""From a column of stamps to runs with strictly increasing time.

Stamps restart when a controller begins a new cycle, wrap when a 32-bit counter
overflows, repeat when they are printed too coarsely, and step back when lines were
printed out of order. What can be repaired without inventing data is repaired and
reported; the rest is refused with its line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..errors import LogError, Notice
from ..experiment import FloatArray
from .columns import Binding, require_numbers
from .log import IntArray, Log, count_of, name_lines

WRAP = 2.0**32
MIN_RUN = 3
_UNIFORM = 1e-6


@dataclass(frozen=True)
class Run:
    """Consecutive rows with increasing time.

    Attributes
    ----------
    rows
        Indices into the log, shape ``(n,)``.
    time
        Instants [s], shape ``(n,)``; empty when the log has no time.
    sample_time
        Median step [s], 0 without time.
    uniform
        Whether the instants lie on one grid, to which they were then snapped.
    """

    rows: npt.NDArray[np.intp]
    time: FloatArray
    sample_time: float
    uniform: bool


def untimed_run(rows: int) -> Run:
    """Return all rows as one run without time."""
    return Run(np.arange(rows), np.empty(0), 0.0, False)


def counted_run(rows: int, sample_time: float) -> Run:
    """Return all rows as one run on a grid that the user named [s]."""
    time = np.arange(rows, dtype=np.float64) * sample_time
    return Run(np.arange(rows), time, sample_time, True)


def split_runs(log: Log, binding: Binding) -> tuple[list[Run], list[Notice]]:
    """Split a log where its time restarts and make each run strictly increasing.

    Parameters
    ----------
    log
        The log.
    binding
        Its time column.

    Returns
    -------
    tuple
        Runs in order, and what was repaired or left out.

    Raises
    ------
    LogError
        When stamps are missing, step back or repeat without an explanation.
    """
    require_numbers(log, binding, np.arange(log.rows))
    stamps = binding.column.values * np.sign(binding.to_si)
    notices: list[Notice] = []
    rows = np.arange(stamps.size)
    stamps, rows = _drop_impossible(log, stamps, rows, notices)
    stamps = _unwrap(log, stamps, rows, notices)
    resolution = print_resolution(stamps)
    pieces = _cut_at_restarts(log, stamps, rows, notices)
    pieces = _mend_ties(log, pieces, resolution, notices)
    pieces = _leave_out_short(log, pieces, notices)
    factor = abs(binding.to_si)
    runs = [make_run(r, t, resolution, factor) for t, r in pieces]
    _doubt_unit(log, binding, stamps, resolution, notices)
    return runs, notices


def print_resolution(stamps: FloatArray) -> float:
    """Return the decimal power that all stamps are multiples of, 0 when there is none.

    Parameters
    ----------
    stamps
        Numbers as printed, shape ``(n,)``.
    """
    if not stamps.size:
        return 0.0
    sample = stamps[:2000]
    largest = float(np.abs(stamps).max())
    for digits in range(13):
        power = 10.0**digits
        tolerance = 4 * np.finfo(float).eps * max(1.0, largest * power)
        if tolerance > 0.05:
            break
        if all(
            np.abs(part * power - np.round(part * power)).max() <= tolerance
            for part in (sample, stamps)
        ):
            return float(10.0**-digits)
    return 0.0


def make_run(
    rows: npt.NDArray[np.intp], stamps: FloatArray, resolution: float, factor: float
) -> Run:
    """Turn increasing stamps into a run, snapped to a grid when they lie on one.

    Parameters
    ----------
    rows
        Row indices, shape ``(n,)``.
    stamps
        Strictly increasing stamps [unit of the column], shape ``(n,)``.
    resolution
        Print resolution of the stamps [same].
    factor
        Seconds per unit.
    """
    if stamps.size < 2:
        return Run(rows, stamps * factor, 0.0, False)
    grid = _fit_grid(stamps, resolution)
    if grid is None:
        step = float(np.median(np.diff(stamps)))
        if resolution:
            step = round(step, 2 - round(float(np.log10(resolution))))
        return Run(rows, _in_seconds(stamps, factor), float(_in_seconds(step, factor)), False)
    first, step = grid
    first, step = float(_in_seconds(first, factor)), float(_in_seconds(step, factor))
    count = np.arange(stamps.size, dtype=np.float64)
    return Run(rows, first + count * step, step, True)


def _in_seconds(value: FloatArray | float, factor: float) -> FloatArray:
    """Scale stamps; dividing keeps 10 ms at exactly 0.01 s where multiplying does not."""
    divisor = round(1 / factor) if factor < 1 else 0
    if divisor and abs(divisor * factor - 1) < 1e-12:
        return np.asarray(value / divisor, dtype=np.float64)
    return np.asarray(value * factor, dtype=np.float64)


def _fit_grid(stamps: FloatArray, resolution: float) -> tuple[float, float] | None:
    """Return first instant and step of the grid the stamps lie on, ``None`` without one.

    Printed stamps are rounded (or truncated): deviations from the grid may span one unit
    of the last printed digit.
    """
    count = np.arange(stamps.size)
    median = float(np.median(np.diff(stamps)))
    if resolution:
        median = round(median / resolution) * resolution or median
        digits = round(-float(np.log10(resolution)))
        median = round(median, digits + 1)
    mean = float(stamps[-1] - stamps[0]) / (stamps.size - 1)
    noise = 8 * np.finfo(float).eps * float(np.abs(stamps).max())
    guesses: tuple[Callable[[], float], ...] = (
        lambda: median,
        lambda: mean,
        lambda: _narrowest_step(stamps, mean, resolution) if resolution else mean,
    )
    for guess in guesses:  # the last one is slow, and seldom needed
        step = guess()
        if step <= 0:
            continue
        deviation = stamps - (stamps[0] + count * step)
        low, high = float(deviation.min()), float(deviation.max())
        tolerance = _UNIFORM * step + noise
        if max(high, -low) <= tolerance:
            return float(stamps[0]), step
        # With two samples per printed digit a grid looks the same as jitter.
        if resolution and resolution <= 0.5 * step and high - low <= 1.001 * resolution + tolerance:
            half = 0.5 * resolution + tolerance
            shift = 0.0 if max(high, -low) <= half else 0.5 * (low + high)
            return float(stamps[0]) + shift, step
    return None


def _narrowest_step(stamps: FloatArray, mean: float, resolution: float) -> float:
    """Return the step of the grid that the stamps deviate least from.

    The span of the deviations is convex in the step, so a ternary search finds its least.
    It is spared where even least squares leaves deviations no rounding can explain.
    """
    count = np.arange(stamps.size, dtype=np.float64)
    centred = count - count.mean()
    squares = float(centred @ (stamps - stamps.mean()) / (centred @ centred))
    if float(np.ptp(stamps - count * squares)) > 2 * resolution:
        return mean
    low, high = (squares + side * 3 * resolution / stamps.size for side in (-1, 1))
    for _ in range(45):
        third = (high - low) / 3
        left, right = (float(np.ptp(stamps - count * h)) for h in (low + third, high - third))
        low, high = (low, high - third) if left <= right else (low + third, high)
    return 0.5 * (low + high)


def _drop_impossible(
    log: Log, stamps: FloatArray, rows: npt.NDArray[np.intp], notices: list[Notice]
) -> tuple[FloatArray, npt.NDArray[np.intp]]:
    """Leave out stamps of a serial log that no 32-bit counter can have printed."""
    if not log.dialect.serial:
        return stamps, rows
    wrong = stamps >= WRAP
    if not wrong.any() or wrong.mean() > 0.1:
        return stamps, rows
    lines = log.lines[rows[wrong]]
    notices.append(
        Notice(
            "overprinted-lines",
            f"{log.name}: {count_of(lines.size, 'line')} left out ({name_lines(lines)}): the "
            "time stamp exceeds a 32-bit counter, so two lines were printed over each other.",
        )
    )
    return stamps[~wrong], rows[~wrong]


def _unwrap(
    log: Log, stamps: FloatArray, rows: npt.NDArray[np.intp], notices: list[Notice]
) -> FloatArray:
    """Undo the overflow of a 32-bit counter.

    Differences are taken modulo 2^32, so a counter that overflows goes on, and stamps
    just below 2^32 before a zero are the negative times they were meant to be.
    """
    if stamps.size < 2 or stamps.max() < WRAP / 2 or stamps.max() >= WRAP or stamps.min() < 0:
        return stamps
    steps = np.diff(stamps)
    wraps = np.flatnonzero(steps < -WRAP / 2)
    if not wraps.size or (stamps != np.round(stamps)).any():
        return stamps
    turned = np.concatenate(([0.0], np.cumsum((steps + WRAP / 2) % WRAP - WRAP / 2)))
    # The zero that is kept: that of the counter after its (last) overflow.
    unwrapped = turned - turned[-1] + stamps[-1]
    if stamps[-1] >= WRAP / 2:
        unwrapped -= WRAP
    notices.append(
        Notice(
            "time-wrapped",
            f"{log.name}, {name_lines(log.lines[rows[wraps + 1]])}: the time counter overflowed "
            f"(2^32) and was continued; stamps before it are negative times.",
        )
    )
    return np.asarray(unwrapped)


def _cut_at_restarts(
    log: Log, stamps: FloatArray, rows: npt.NDArray[np.intp], notices: list[Notice]
) -> list[tuple[FloatArray, npt.NDArray[np.intp]]]:
    """Cut where time starts again; small backward steps are another matter."""
    steps = np.diff(stamps)
    if not (steps < 0).any():
        return [(stamps, rows)]
    forward = steps[steps > 0]
    usual = float(np.median(forward)) if forward.size else 0.0
    starts, glitches = [0], []
    kept = [0]
    values = stamps.tolist()
    for i in range(1, len(values)):
        last, first = values[kept[-1]], values[starts[-1]]
        if first < 0 < last:
            first = 0.0  # what came before the event does not make the run longer
        if values[i] >= last:
            kept.append(i)
            continue
        before = values[kept[-2]] if len(kept) > 1 and kept[-2] >= starts[-1] else None
        after = values[i + 1] if i + 1 < len(values) else None
        spiked = before is not None and last - before > 100 * usual
        if before is not None and spiked and 0 < values[i] - before <= 5 * usual:
            glitches.append(kept.pop())
            kept.append(i)
            continue
        # One wrong stamp within a run: the next goes on where the one before left off, and
        # does not follow from the wrong one.
        resumes = (
            after is not None and 0 < after - last <= 5 * usual and after - values[i] > 10 * usual
        )
        if values[i] - first < 0.5 * (last - first) and not resumes:
            starts.append(i)
            kept.append(i)
        else:
            glitches.append(i)
    if len(starts) > 1:
        notices.append(
            Notice(
                "time-restarts",
                f"{log.name}: time starts again {count_of(len(starts) - 1, 'time')} "
                f"({name_lines(log.lines[rows[starts[1:]]])}); each of the {len(starts)} runs is "
                "a separate experiment.",
            )
        )
    _judge_glitches(log, rows, glitches, len(starts), notices)
    index = np.array(kept)
    cuts = np.searchsorted(index, starts[1:])
    return [(stamps[part], rows[part]) for part in np.split(index, cuts)]


def _judge_glitches(
    log: Log,
    rows: npt.NDArray[np.intp],
    glitches: Sequence[int],
    runs: int,
    notices: list[Notice],
) -> None:
    """Leave out lines printed out of order in terminal logs; refuse them elsewhere."""
    if not glitches:
        return
    lines = log.lines[rows[list(glitches)]]
    # A terminal log, or one of many cycles, holds events printed now and then out of order.
    events = log.dialect.serial or runs >= 3
    if not events or lines.size > 0.2 * log.rows:
        raise LogError(
            "time goes backwards.",
            where=f"{log.name}, line {int(lines[0])}",
            expected="Expected time to increase from row to row, or to start again.",
            remedy=("Remove the line, or give --sample-time SECONDS to replace the time column."),
        )
    notices.append(
        Notice(
            "time-out-of-order",
            f"{log.name}: {count_of(lines.size, 'line')} left out whose time is out of order "
            f"({name_lines(lines)}).",
        )
    )


def _mend_ties(
    log: Log,
    pieces: list[tuple[FloatArray, npt.NDArray[np.intp]]],
    resolution: float,
    notices: list[Notice],
) -> list[tuple[FloatArray, npt.NDArray[np.intp]]]:
    """Separate equal stamps where coarse printing explains them.

    Samples that share a stamp lie within one unit of its last digit, in the order of the
    lines; they are spread evenly over that unit, which is wrong by less than the rounding.
    """
    tied = [np.diff(stamps) == 0 for stamps, _ in pieces]
    number = int(sum(t.sum() for t in tied))
    if not number:
        return pieces
    at = np.concatenate([rows[1:][t] for (_, rows), t in zip(pieces, tied)])
    total = sum(stamps.size for stamps, _ in pieces)
    steps = np.concatenate([np.diff(s) for s, _ in pieces])
    steps = steps[steps > 0]
    usual = float(np.median(steps)) if steps.size else 0.0
    varied = bool(steps.size) and float(np.mean(np.abs(steps - usual) > 0.5 * resolution)) > 0.05
    # Printed every few digits with steps that vary: two samples may share a digit. A
    # terminal log holds events, which come as close as they like.
    coarse = log.dialect.serial or (
        0 < usual <= 3.5 * resolution and (varied or number > total / 5)
    )
    if resolution > 0 and coarse and number < 0.9 * total:
        notices.append(
            Notice(
                "time-ties",
                f"{log.name}: {count_of(number, 'sample')} with the same printed time as the one "
                f"before ({name_lines(log.lines[at])}); spread within the last printed digit.",
            )
        )
        return [(_spread(stamps, resolution), rows) for stamps, rows in pieces]
    raise LogError(
        "the time is the same as on the line before"
        + (f" ({number} such lines)." if number > 1 else "."),
        where=f"{log.name}, line {int(log.lines[at[0]])}",
        expected="Expected time to increase from row to row.",
        remedy="Remove the line, or give --sample-time SECONDS to replace the time column.",
    )


def _spread(stamps: FloatArray, resolution: float) -> FloatArray:
    """Spread groups of equal stamps evenly over one unit of the last digit."""
    new = np.r_[True, np.diff(stamps) != 0]
    first = np.flatnonzero(new)
    size = np.diff(np.r_[first, stamps.size])
    place = np.arange(stamps.size) - np.repeat(first, size)
    return np.asarray(stamps + resolution * place / np.repeat(size, size))


def _leave_out_short(
    log: Log, pieces: list[tuple[FloatArray, npt.NDArray[np.intp]]], notices: list[Notice]
) -> list[tuple[FloatArray, npt.NDArray[np.intp]]]:
    if len(pieces) == 1:
        return pieces
    long = [piece for piece in pieces if piece[0].size >= MIN_RUN]
    short = [piece for piece in pieces if piece[0].size < MIN_RUN]
    lines: IntArray = log.lines[np.array([int(rows[0]) for _, rows in short], dtype=np.intp)]
    if not long:
        raise LogError(
            f"time starts again so often that no run has {MIN_RUN} samples.",
            where=f"{log.name}, line {int(lines[1])}",
            expected="Expected time to increase from row to row.",
            remedy="Choose another time column, or give --sample-time SECONDS.",
        )
    if short:
        notices.append(
            Notice(
                "run-too-short",
                f"{log.name}: {count_of(len(short), 'run')} of fewer than {MIN_RUN} samples left "
                f"out (beginning at {name_lines(lines)}).",
            )
        )
    return long


def _doubt_unit(
    log: Log,
    binding: Binding,
    stamps: FloatArray,
    resolution: float,
    notices: list[Notice],
) -> None:
    """Warn when seconds were assumed but the numbers look like milliseconds."""
    if not binding.assumed or binding.scale != 1.0 or stamps.size < 3:
        return
    steps = np.diff(stamps)
    steps = steps[steps > 0]
    if resolution >= 1 and steps.size and float(np.median(steps)) >= 1:
        notices.append(
            Notice(
                "time-unit-doubtful",
                f"{log.name}: time has no unit and was taken as seconds, but its whole numbers "
                f"step by {float(np.median(steps)):g}. If they are milliseconds, give "
                "--unit time=ms.",
            )
        )
