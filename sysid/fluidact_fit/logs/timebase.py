"""From a column of stamps to runs with strictly increasing time.

Stamps restart when a controller begins a new cycle, wrap when a 32-bit counter
overflows, repeat when they are printed too coarsely, and step back when lines were
printed out of order. What can be repaired without inventing data is repaired and
reported; the rest is refused with its line.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import LogError, Notice
from ..experiment import BoolArray, FloatArray, IndexArray, at_rows
from .columns import Binding, counts_for
from .counters import digits_of_clock, find_overflow
from .grid import Run, make_run, print_resolution
from .invalid import usable_rows
from .log import MIN_RUN, Column, Log, count_of, name_lines

WRAP = 2.0**32
_DAY = 86_400.0  # s
_CLOCKED = (1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 60.0)  # s, steps of slow loggers
# Steps of whole numbers from which on they are likely to be such a part of a second.
_SMALLER = ((1e5, "nanoseconds", "ns"), (1e3, "microseconds", "us"), (1.0, "milliseconds", "ms"))


def split_runs(log: Log, binding: Binding) -> tuple[list[Run], list[Notice]]:
    """Split a log where its time restarts and make each run strictly increasing.

    Returns the runs in order, and what was repaired or left out. ``LogError`` when stamps are
    missing, step back or repeat without an explanation.
    """
    rows = usable_rows(log, binding, np.arange(log.rows))
    repair = _Repair(log, binding.column)
    stamps = at_rows(binding.column.stamps, rows)
    part = repair.drop_impossible(_Part(rows, stamps if binding.to_si > 0.0 else -stamps))
    part = repair.unwrap(part)
    resolution = print_resolution(part.stamps)
    if not binding.column.clock:
        repair.refuse_digits(part)
    part = repair.go_on(part, resolution, binding.column.clock)
    parts = repair.mend_ties(repair.cut_at_restarts(part), resolution)
    parts = repair.leave_out_short(parts)
    seconds = binding.unit == binding.role.unit and binding.scale == 1.0
    if binding.assumed and seconds:
        repair.doubt_unit(part.stamps, whole=resolution >= 1)
    factor = abs(binding.to_si)
    return [make_run(p.rows, p.stamps, resolution, factor) for p in parts], repair.notices


@dataclass(frozen=True)
class _Part:
    """Rows of a log, indices of shape ``(n,)``, and their stamps in the unit of the column."""

    rows: IndexArray
    stamps: FloatArray

    def __getitem__(self, chosen: IndexArray | BoolArray) -> _Part:
        return _Part(self.rows[chosen], self.stamps[chosen])


class _Repair:
    """Repairs of the stamps of one log, and the notices of what was done."""

    def __init__(self, log: Log, column: Column) -> None:
        self.log, self.column = log, column
        self.notices: list[Notice] = []

    def name_lines(self, rows: IndexArray) -> str:
        """Name the lines of some rows."""
        return name_lines(self.log.lines[rows])

    def notice(self, code: str, message: str) -> None:
        """Add a notice on the log."""
        self.notices.append(Notice(code, f"{self.log.name}{message}"))

    def refusal(self, what: str, row: int, expected: str = "", remedy: str = "") -> LogError:
        """Return the error for a row whose time cannot be repaired."""
        return LogError(
            what,
            where=self.log.where(row),
            expected=expected or "Expected time to increase from row to row.",
            remedy=remedy
            or "Remove the line, or give --sample-time SECONDS to replace the time column.",
        )

    def drop_impossible(self, part: _Part) -> _Part:
        """Leave out stamps of a serial log that no 32-bit counter can have printed."""
        if not self.log.dialect.serial:
            return part
        wrong = part.stamps >= WRAP
        if not wrong.any() or wrong.mean() > 0.1:
            return part
        left_out = part.rows[wrong]
        self.notice(
            "overprinted-lines",
            f": {count_of(left_out.size, 'line')} left out ({self.name_lines(left_out)}): the "
            "time stamp exceeds a 32-bit counter, so two lines were printed over each other.",
        )
        return part[~wrong]

    def unwrap(self, part: _Part) -> _Part:
        """Undo the overflow of a 32-bit counter.

        Differences are taken modulo 2^32, so a counter that overflows goes on, and stamps
        just below 2^32 before a zero are the negative times they were meant to be.
        """
        stamps = part.stamps
        if stamps.size < 2 or stamps.max() < WRAP / 2 or stamps.max() >= WRAP or stamps.min() < 0:
            return part
        steps = np.diff(stamps)
        wraps = np.flatnonzero(steps < -WRAP / 2)
        if not wraps.size or (stamps != np.round(stamps)).any():
            return part
        turned = np.concatenate(([0.0], np.cumsum((steps + WRAP / 2) % WRAP - WRAP / 2)))
        # The zero that is kept: that of the counter after its (last) overflow.
        unwrapped = turned - turned[-1] + stamps[-1]
        if stamps[-1] >= WRAP / 2:
            unwrapped -= WRAP
        self.notice(
            "time-wrapped",
            f", {self.name_lines(part.rows[wraps + 1])}: the time counter overflowed "
            "(2^32) and was continued; stamps before it are negative times.",
        )
        return _Part(part.rows, unwrapped)

    def go_on(self, part: _Part, resolution: float, clock: bool) -> _Part:
        """Let any other counter go on that certainly overflowed, from its first stamp on."""
        if _in_order(part.stamps, np.greater_equal):
            return part
        self.refuse_fraction(part)
        turn = None if clock else find_overflow(part.stamps, resolution)
        if turn is None:
            return part
        falls = np.diff(part.stamps) < 0
        self.notice(
            "time-wrapped",
            f", {self.name_lines(part.rows[1:][falls])}: the time counter overflowed "
            f"({_power(turn)}) and was continued.",
        )
        return _Part(part.rows, part.stamps + turn * np.concatenate(([0], np.cumsum(falls))))

    def refuse_digits(self, part: _Part) -> None:
        """Refuse times of day whose digits were read as one number."""
        at = digits_of_clock(part.stamps)
        if at is not None:
            before, after = (f"{part.stamps[k]:.10g}" for k in (at, at + 1))
            raise self.refusal(
                f"time goes from {before} to {after}, as the digits of a clock (HHMMSS) do.",
                part.rows[at + 1],
                "Expected time in a unit.",
                "Export it in seconds or as HH:MM:SS, or give --sample-time SECONDS.",
            )

    def cut_at_restarts(self, part: _Part) -> list[_Part]:
        """Cut where time starts again; small backward steps are another matter."""
        if _in_order(part.stamps, np.greater_equal):
            return [part]
        steps = np.diff(part.stamps)
        self.refuse_disorder(part, steps < 0)
        forward = steps[steps > 0]
        usual = float(np.median(forward)) if forward.size else 0.0
        kept, starts, glitches = _sort_out(part.stamps.tolist(), usual)
        if len(starts) > 1:
            self.notice(
                "time-restarts",
                f": time starts again {count_of(len(starts) - 1, 'time')} "
                f"({self.name_lines(part.rows[starts[1:]])}); each of the {len(starts)} runs is "
                "a separate experiment.",
            )
        if glitches:
            self.judge_glitches(part.rows[glitches], len(starts))
        return [part[rows] for rows in np.split(kept, np.searchsorted(kept, starts[1:]))]

    def refuse_disorder(self, part: _Part, falls: BoolArray) -> None:
        """Refuse a time that goes back so often that runs would be shorter than the least."""
        count = int(np.count_nonzero(falls))
        if MIN_RUN * count <= falls.size:
            return
        if count == falls.size and count > 1:
            raise self.refusal(
                f"column '{self.column.label}', the time, decreases on every row.",
                part.rows[1],
                remedy="Reverse the order of the rows, or give --scale time=-1 if it counts down.",
            )
        raise self.refusal(
            f"column '{self.column.label}', the time, goes back on {count} of {falls.size} rows: "
            "it is not in order.",
            part.rows[1:][falls][0],
            "Expected time to increase from row to row, or to start again for another run.",
            "Sort the rows by time, or choose another column with --column time=...",
        )

    def refuse_fraction(self, part: _Part) -> None:
        """Refuse a time that starts again wherever another column counts one more of it."""
        upper = counts_for(self.log, self.column)
        if upper is not None:
            row = part.rows[1:][np.diff(part.stamps) < 0][0]
            raise self.refusal(
                f"column '{self.column.label}' starts again wherever column '{upper.label}' goes "
                "up by one: it holds only part of the time.",
                row,
                "Expected all of the time in one column, or columns that are called secs and nsecs "
                "(or tv_sec and tv_usec).",
                "Put both into one column, or give --sample-time SECONDS.",
            )

    def judge_glitches(self, rows: IndexArray, runs: int) -> None:
        """Leave out lines printed out of order in terminal logs; refuse them elsewhere."""
        # A terminal log, or one of many cycles, holds events printed now and then out of order.
        events = self.log.dialect.serial or runs >= 3
        if not events or rows.size > 0.2 * self.log.rows:
            raise self.refusal(
                "time goes backwards.",
                rows[0],
                "Expected time to increase from row to row, or to start again.",
            )
        self.notice(
            "time-out-of-order",
            f": {count_of(rows.size, 'line')} left out whose time is out of order "
            f"({self.name_lines(rows)}).",
        )

    def mend_ties(self, parts: list[_Part], resolution: float) -> list[_Part]:
        """Separate equal stamps where coarse printing explains them.

        Samples that share a stamp lie within one unit of its last digit, in the order of the
        lines; they are spread evenly over that unit, which is wrong by less than the rounding.
        """
        if all(_in_order(p.stamps, np.greater) for p in parts):
            return parts
        steps = np.concatenate([np.diff(p.stamps) for p in parts])
        tied = np.concatenate([p.rows[1:] for p in parts])[steps == 0]
        total = sum(p.stamps.size for p in parts)
        steps = steps[steps > 0]
        usual = float(np.median(steps)) if steps.size else 0.0
        varied = steps.size > 0 and np.mean(np.abs(steps - usual) > 0.5 * resolution) > 0.05
        # Printed every few digits with steps that vary: two samples may share a digit. A
        # terminal log holds events, which come as close as they like.
        coarse = self.log.dialect.serial or (
            0 < usual <= 3.5 * resolution and (varied or tied.size > total / 5)
        )
        if resolution <= 0 or not coarse or tied.size >= 0.9 * total:
            more = f" ({tied.size} such lines)" if tied.size > 1 else ""
            raise self.refusal(
                f"the time is the same as on the line before{more}.", tied[0],
                remedy="Such lines repeat the line before in every column: remove them."
                if self._repeat(tied) else "",
            )  # fmt: skip
        self.notice(
            "time-ties",
            f": {count_of(tied.size, 'sample')} with the same printed time as the one "
            f"before ({self.name_lines(tied)}); spread within the last printed digit.",
        )
        return [_Part(p.rows, _spread(p.stamps, resolution)) for p in parts]

    def _repeat(self, rows: IndexArray) -> bool:
        """Return whether rows repeat the ones before them in every column."""
        return all(
            np.array_equal(c.values[rows], c.values[rows - 1], equal_nan=True)
            for c in self.log.columns
        )

    def leave_out_short(self, parts: list[_Part]) -> list[_Part]:
        """Leave out runs too short to be one, unless the log is a single run."""
        if len(parts) == 1:
            return parts
        short = np.array([p.rows[0] for p in parts if p.rows.size < MIN_RUN], dtype=np.intp)
        if short.size:
            self.notice(
                "run-too-short",
                f": {count_of(short.size, 'run')} of fewer than {MIN_RUN} samples left "
                f"out (beginning at {self.name_lines(short)}).",
            )
        return [p for p in parts if p.rows.size >= MIN_RUN]

    def doubt_unit(self, stamps: FloatArray, *, whole: bool) -> None:
        """Warn when seconds were assumed but the numbers look like another unit of time."""
        steps = np.diff(stamps)
        usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
        if whole and stamps.size >= 3 and usual >= 1:
            name, unit = next(x for size, *x in _SMALLER if usual >= size)
            self.notice(
                "time-unit-doubtful",
                ": time has no unit and was taken as seconds, but its whole numbers "
                f"step by {usual:g}. If they are {name}, give --unit time={unit}.",
            )
        elif usual > 0.0 and stamps[0] > 0.0 and stamps.max() < 1.0:
            even = _DAY * float(np.mean(steps[steps > 0]))  # [s], if these are parts of a day
            if min(abs(even - size) for size in _CLOCKED) < 0.01:
                self.notice(
                    "time-unit-doubtful",
                    ": time has no unit and was taken as seconds, but steps by parts of a day "
                    f"({even:.3g} s), as times of day in spreadsheets do. If it is, give "
                    "--unit time=d.",
                )


def _power(number: float) -> str:
    """A power of two or ten as one writes it."""
    for base in (2, 10):
        exponent = round(math.log(number, base))
        if base**exponent == number:
            return f"{base}^{exponent}"
    return f"{number:.10g}"


def _in_order(stamps: FloatArray, behind: np.ufunc) -> bool:
    """Return whether every stamp is ``behind`` the one before it."""
    return bool(np.all(behind(stamps[1:], stamps[:-1])))


def _sort_out(stamps: Sequence[float], usual: float) -> tuple[IndexArray, list[int], list[int]]:
    """Return the stamps to keep, those where a run starts, and those that are out of order."""
    starts, glitches = [0], []
    kept = [0]
    for i in range(1, len(stamps)):
        last, first = stamps[kept[-1]], stamps[starts[-1]]
        if first < 0 < last:
            first = 0.0  # what came before the event does not make the run longer
        if stamps[i] >= last:
            kept.append(i)
            continue
        before = stamps[kept[-2]] if len(kept) > 1 and kept[-2] >= starts[-1] else None
        spiked = before is not None and last - before > 100 * usual
        if before is not None and spiked and 0 < stamps[i] - before <= 5 * usual:
            glitches.append(kept.pop())
            kept.append(i)
            continue
        # One wrong stamp within a run: the next goes on where the one before left off, and
        # does not follow from the wrong one.
        after = stamps[i + 1] if i + 1 < len(stamps) else -math.inf
        resumes = 0 < after - last <= 5 * usual and after - stamps[i] > 10 * usual
        if stamps[i] - first < 0.5 * (last - first) and not resumes:
            starts.append(i)
            kept.append(i)
        else:
            glitches.append(i)
    return np.array(kept), starts, glitches


def _spread(stamps: FloatArray, resolution: float) -> FloatArray:
    """Spread groups of equal stamps evenly over one unit of the last digit."""
    _, first, group, size = np.unique(
        stamps, return_index=True, return_inverse=True, return_counts=True
    )
    place = np.arange(stamps.size) - first[group]
    return np.asarray(stamps + resolution * place / size[group])
