"""Runs, and the even grid that their instants lie on where they do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..experiment import BoolArray, FloatArray, IndexArray
from ..rows import evenly
from .log import IntArray

_UNIFORM = 1e-6
_PRINTED = 0.75  # of a step, that the last printed digit of stamps on a grid may be
_MANY = 200_000  # stamps, of which the first show how far apart they were printed


@dataclass(frozen=True)
class Run:
    """Consecutive rows with increasing time.

    ``rows`` are indices into the log and ``time`` their instants [s], shape ``(n,)``; a log without
    time has none. ``sample_time`` is the median step [s], 0 without time. ``uniform`` says that
    the instants lie on one grid, to which they were then snapped.
    """

    rows: IndexArray
    time: FloatArray
    sample_time: float
    uniform: bool

    def part(self, kept: BoolArray) -> Run:
        """Return some of the rows, ``kept`` of shape ``(n,)``."""
        time = self.time[kept] if self.time.size else self.time
        return replace(self, rows=np.asarray(self.rows)[kept], time=time)


def untimed_run(rows: int) -> Run:
    """Return all rows as one run without time."""
    return Run(np.arange(rows), np.empty(0), 0.0, False)


def counted_run(rows: int, sample_time: float, places: IntArray | None = None) -> Run:
    """Return all rows as one run on a grid that the user named [s].

    ``places`` are those of the rows, where others were left out.
    """
    if places is None or places[-1] == rows - 1:
        return Run(np.arange(rows), evenly(0.0, sample_time, rows), sample_time, True)
    even = bool(places[-1] - places[0] == rows - 1)
    return Run(np.arange(rows), places.astype(np.float64) * sample_time, sample_time, even)


def print_resolution(stamps: FloatArray) -> float:
    """Return the decimal power that all printed stamps are multiples of, 0 without one."""
    if not stamps.size:
        return 0.0
    largest = float(np.abs(stamps).max())
    for digits in range(13):
        power = 10.0**digits
        tolerance = 4 * np.finfo(float).eps * max(1.0, largest * power)
        if tolerance > 0.05:
            break
        scaled = (part * power for part in (stamps[:2000], stamps))
        if all(np.abs(part - np.round(part)).max() <= tolerance for part in scaled):
            return float(10.0**-digits)
    return 0.0


def make_run(rows: IndexArray, stamps: FloatArray, resolution: float, factor: float) -> Run:
    """Turn increasing stamps into a run, snapped to a grid when they lie on one.

    ``stamps`` and their print ``resolution`` are in the unit of the column, which is ``factor``
    seconds; ``rows`` are indices, of shape ``(n,)`` as the stamps.
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
    return Run(rows, evenly(first, step, stamps.size), step, True)


def _in_seconds(value: FloatArray | float, factor: float) -> FloatArray:
    """Scale stamps; dividing keeps 10 ms at exactly 0.01 s where multiplying does not."""
    divisor = round(1 / factor) if 1e-30 < factor < 1 else 0
    if divisor and abs(divisor * factor - 1) < 1e-12:
        return np.asarray(value / divisor, dtype=np.float64)
    return np.asarray(value * factor, dtype=np.float64)


def _fit_grid(stamps: FloatArray, resolution: float) -> tuple[float, float] | None:
    """Return first instant and step of the grid the stamps lie on, ``None`` without one.

    Printed stamps are rounded (or truncated): deviations from the grid may span one unit
    of the last printed digit.
    """
    noise = 8 * np.finfo(float).eps * float(np.abs(stamps).max())
    for step in _guess_steps(stamps, resolution):
        if step <= 0:
            continue
        off = stamps - evenly(float(stamps[0]), step, stamps.size)
        low, high = float(off.min()), float(off.max())
        tolerance = _UNIFORM * step + noise
        if max(high, -low) <= tolerance:
            return float(stamps[0]), step
        # With a sample per printed digit a grid looks the same as jitter.
        if (
            resolution
            and resolution <= _PRINTED * step
            and high - low <= 1.001 * resolution + tolerance
        ):
            half = 0.5 * resolution + tolerance
            shift = 0.0 if max(high, -low) <= half else 0.5 * (low + high)
            return float(stamps[0]) + shift, step
    return None


def _guess_steps(stamps: FloatArray, resolution: float) -> Iterator[float]:
    """Yield steps that a grid may have; the last one is slow to find, and seldom needed.

    Of many stamps that were printed the first tell the same decimal number as all of them, or none
    that any grid of theirs has.
    """
    if resolution and stamps.size > _MANY:
        yield next(_guess_steps(stamps[:_MANY], resolution))
    median = float(np.median(np.diff(stamps)))
    if resolution:
        median = round(median / resolution) * resolution or median
        median = round(median, 1 + round(-float(np.log10(resolution))))
    yield median
    mean = float(stamps[-1] - stamps[0]) / (stamps.size - 1)
    yield mean
    if resolution:
        yield _narrowest_step(stamps, mean, resolution)


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
