"""Numbers that do not count on as time does: counters that overflow, digits of clocks.

And two columns of which one counts what the other has counted to its end, as seconds and
nanoseconds, or seconds and frames: how far the lower one counts shows where the upper one goes up.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..experiment import FloatArray

# Of these widths hardly anything but a counter begins again [bits].
_WIDE = 16, 24, 31, 32
_NARROW = 8, 10, 12, 14, 15
_DECIMAL = range(3, 13)  # digits of a counter that a logger prints
_SCALED = range(10)  # powers of ten by which what was counted is printed
_REGULAR = 0.9  # of the steps; others are gaps, or where it starts again


def find_overflow(stamps: FloatArray, resolution: float) -> float | None:
    """Return what a counter counts to before it begins again; ``None`` where that is not certain.

    All stamps, of shape ``(n,)``, have to lie within one turn; every fall among them has to be a
    step as the others are, had the counter gone on; and it has to begin again at another number
    than the log does, or to be as wide as a register: else each run may be a recording of its own.
    """
    steps = np.diff(stamps)
    falls = np.flatnonzero(steps < 0)
    forward = steps[steps > 0]
    if not falls.size or forward.size < max(3, 2 * falls.size):
        return None
    usual = float(np.median(forward))
    low, high = (float(np.quantile(forward, q)) for q in (0.02, 0.98))
    slack = max(resolution, 1e-9 * float(np.abs(stamps).max()))
    beside = np.abs(stamps[falls + 1] - stamps[0]).min() > max(usual - slack, slack)
    beside = beside or np.ptp(stamps[falls + 1]) > slack
    bottom, top = float(stamps.min()), float(stamps.max())
    for period, wide in _periods(stamps, resolution):
        within = (bottom >= 0 and top < period) or (-period / 2 <= bottom and top < period / 2)
        across = steps[falls] + period
        if not within or across.min() < low - slack or across.max() > high + slack:
            continue
        if wide or beside:
            return period
    return None


def _periods(stamps: FloatArray, resolution: float) -> Iterator[tuple[float, bool]]:
    """Numbers at which counters begin again, and whether hardly anything but a counter does."""
    whole = resolution >= 1
    for bits in _WIDE:
        yield 2.0**bits, whole
    for bits in _NARROW if whole else ():
        yield 2.0**bits, False
    for digits in _DECIMAL if whole else ():
        yield 10.0**digits, False
    for bits in () if whole else (16, 24, 32):
        for power in _SCALED[1:]:
            yield 2.0**bits / 10.0**power, False


def digits_of_clock(stamps: FloatArray) -> int | None:
    """Return the first row after which numbers skip as the digits of a clock do, at 59 seconds.

    ``None`` where they do not: no two digits of an even count stop at 59 before the next one goes
    up. Looked at are seconds and minutes, with or without a fraction or milliseconds behind them.
    """
    if stamps.size < 3:
        return None
    low, high = float(stamps.min()), float(stamps.max())
    for size in (1.0, 100.0, 1_000.0, 100_000.0):
        if high // (100 * size) == low // (100 * size):
            continue  # no skip can lie between
        whole = np.floor(stamps / size)
        if np.any(whole % 100 >= 60) or np.any(whole // 100 % 100 >= 60):
            continue
        steps, minutes = np.diff(stamps), np.diff(np.floor(stamps / (100 * size)))
        usual = steps[(minutes == 0) & (steps > 0)]
        skips = np.flatnonzero((minutes > 0) & (steps > 0))
        if not usual.size or not skips.size or (step := float(np.median(usual))) > 20 * size:
            continue
        over = (steps[skips] - step) / size - 40
        # the hour, and the day of a date, skip more
        over = np.min([np.abs(over), np.abs(over - 4_000), np.abs(over - 764_000)], axis=0)
        if np.all(over < max(step / size, 0.5)):
            return int(skips[0])
    return None


@dataclass(frozen=True)
class Carry:
    """Carry of a lower counter into a higher one, give or take ``spread``."""

    base: float
    spread: float

    def is_at(self, base: float) -> bool:
        """Return whether it may count up to that."""
        return abs(self.base - base) <= self.spread


def find_carry(upper: FloatArray, lower: FloatArray) -> Carry | None:
    """Return how far the lower of two numbers counts, ``None`` where that does not show.

    ``upper`` and ``lower`` are whole numbers of shape ``(n,)``. The lower one has to grow while the
    upper one stays, and to fall wherever that goes up by one, always as far.
    """
    up, steps = np.diff(upper), np.diff(lower)
    inside, across = steps[up == 0], steps[up == 1]
    regular = inside.size + across.size >= _REGULAR * up.size
    if not (regular and inside.size and across.size) or inside.min() < 0 or across.max() >= 0:
        return None
    usual = float(np.median(inside))
    bases = usual - across
    base = float(np.median(bases))
    uneven = max(float(np.abs(bases - base).max()), float(np.quantile(np.abs(inside - usual), 0.9)))
    spread = uneven + 0.5
    return Carry(base, spread) if usual > 0 and spread < 0.5 * base else None
