"""Readings that rest on the end of their range: clipped samples of a calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...errors import Notice
from ...estimation.noise import noise_floor
from ...estimation.uncertainty import t_quantile
from ...experiment import BoolArray, Experiment, FloatArray, where_both, where_finite
from ...rows import blocks
from .data import Data, check_data, gather
from .options import PotentiometerOptions

_SURE = 0.995  # of an extreme reading off the course of its neighbours: thousands are looked at


def prepare(
    experiments: Sequence[Experiment], options: PotentiometerOptions
) -> tuple[Data, PotentiometerOptions, list[Notice]]:
    """All samples and which of them can be used; the options with the rails settled."""
    data = gather(experiments)
    check_data(data)
    notices: list[Notice] = []
    if options.clipped is None:
        suspects: list[float] = []
        if options.rails is None:
            rails, suspects, notices = find_rails(data)
        else:
            rails, notices = widen_rails(data, options.rails)
        inside = between(data.reading, rails)
        left_out = not inside.all() and not (inside | ~data.used).all()
        named = ",".join(repr(s) for s in suspects) or None
        options = replace(options, rails=rails, clipped=left_out, suspects=named)
    used = where_both(data.used, between(data.reading, options.rails))
    if used is not data.used and not np.array_equal(used, data.used):
        data = replace(data, used=used)
        check_data(data)
    return data, options, notices


def between(reading: FloatArray, rails: tuple[float, float] | None) -> BoolArray:
    """Readings that are finite and inside the rails, if there are any."""
    if rails is None:
        return where_finite(reading)
    low, high = rails
    if all(bool(((reading[at] > low) & (reading[at] < high)).all()) for at in blocks(reading.size)):
        return np.broadcast_to(np.True_, reading.shape)
    return (reading > low) & (reading < high)


def widen_rails(data: Data, rails: tuple[float, float]) -> tuple[tuple[float, float], list[Notice]]:
    """Move given rails inwards where they clip a noisy reading, and say how many are left out.

    Of a noisy reading that is clipped, those just inside a rail are the ones whose noise
    happened to point inwards, and would bend the ends of the curve: beside a rail that
    clips, readings within three standard deviations of their noise are left out as well.
    """
    low, high = rails
    reading, reference = data.kept(data.reading), data.kept(data.reference)
    kept = between(reading, rails)
    count = int(np.sum(~kept))
    if not count:
        return rails, []
    notices = [_rails_notice(count, f"at or beyond the rails {low:g}:{high:g}")]
    margin = 3.0 * _reading_noise(reading[kept], reference[kept])
    if np.count_nonzero(reading <= low) >= 3:
        low += margin
    if np.count_nonzero(reading >= high) >= 3:
        high -= margin
    near = int(np.sum(kept & ~between(reading, (low, high))))
    if near:
        text = (
            f"{_samples(near)} within {margin:.3g} of a rail, three standard deviations of the "
            "reading's noise, left out as well: clipping has taken the others like them."
        )
        notices.append(Notice("rails", text))
    return (low, high), notices


def _reading_noise(reading: FloatArray, reference: FloatArray) -> float:
    """Noise of the reading at a position [unit of the reading]; 0 where it cannot be told.

    In the order of the position, whose own noise counts as well. Few samples, or ones far
    apart, say nothing of it.
    """
    if reading.size < 200:
        return 0.0
    x = reading[np.argsort(reference, kind="stable")]
    noise = noise_floor(x, 3)
    return noise if noise <= 0.01 * float(np.ptp(x)) else 0.0


def _samples(count: int) -> str:
    return "1 sample" if count == 1 else f"{count} samples"


def _rails_notice(count: int, place: str) -> Notice:
    text = "left out: a clipped reading says nothing about the position."
    return Notice("rails", f"{_samples(count)} {place} {text}")


def find_rails(data: Data) -> tuple[tuple[float, float] | None, list[float], list[Notice]]:
    """Find extremes that the reading rests on while the reference moves.

    At least three samples exactly on an extreme whose references spread three times wider
    than those of the readings beside it (their scatter about a straight line, and the
    slope of that line over one step of the converter) are left out. A lone extreme that
    is off the course of its neighbours, and by a step out of proportion, is only warned of.

    Returns the rails (``None`` where both ends are sound), readings at or beyond which nothing
    is used, the extreme readings that are warned of and stay, and the warnings.
    """
    distinct = data.distinct.reading
    if distinct.size < 6:
        return None, [], []
    finest = float(np.diff(distinct).min())
    rails: list[float] = []
    suspects: list[float] = []
    notices: list[Notice] = []
    for order in (slice(None), slice(None, None, -1)):
        x, n, y, squares = (v[order] for v in vars(data.distinct).values())
        scatter, slope = _course(x[1:21], n[1:21], y[1:21], squares[1:21])
        if n[0] >= 3 and np.sqrt(squares[0] / n[0]) > 3.0 * (scatter + slope * finest):
            rails.append(float(x[0]))
            notices.append(_rails_notice(int(n[0]), f"on the extreme reading {x[0]:g}"))
        elif n[0] <= 2 and _is_off_course(x, y):
            suspects.append(float(x[0]))
    if suspects:
        notices.append(_suspicion(_rails_at(suspects, distinct), suspects))
    return _rails_at(rails, distinct) if rails else None, sorted(suspects), notices


def _course(
    x: FloatArray, count: FloatArray, mean: FloatArray, squares: FloatArray
) -> tuple[float, float]:
    """Scatter about a straight line through some readings, and its slope without its sign."""
    line = np.polynomial.Polynomial.fit(x, mean, 1, w=np.sqrt(count))
    left = float(squares.sum() + count @ (mean - line(x)) ** 2)
    return float(np.sqrt(left / count.sum())), abs(float(line.convert().coef[-1]))


def _rails_at(ends: Sequence[float], distinct: FloatArray) -> tuple[float, float]:
    """Rails at some of the two extreme readings; out of reach where an end is sound."""
    low, high = float(distinct[0]), float(distinct[-1])
    margin = 0.1 * (high - low)
    return low if low in ends else low - margin, high if high in ends else high + margin


def _is_off_course(x: FloatArray, y: FloatArray) -> bool:
    """Whether the first point is not where the next ones lead, by line and by parabola."""
    if x.size < 8:
        return False
    steps = np.abs(np.diff(y[:6])) / np.abs(np.diff(x[:6]))
    ratio = steps[0] / max(float(np.median(steps[1:])), 1e-300)
    if 1.0 / 3.0 < ratio < 3.0:
        return False
    for degree, points in ((1, 7), (2, 9)):
        beside, level = x[1 : points + 1] - x[0], y[1 : points + 1]
        columns = np.vander(beside / beside[-1], degree + 1, increasing=True)
        solution = np.linalg.lstsq(columns, level, rcond=None)[0]
        rest = level - columns @ solution
        free = max(rest.size - degree - 1, 1)
        leverage = float(np.linalg.inv(columns.T @ columns)[0, 0])
        error = float(np.sqrt(rest @ rest / free * (1.0 + leverage)))
        if abs(y[0] - solution[0]) <= t_quantile(_SURE, free) * error + 1e-9 * np.ptp(y):
            return False
    return True


def _suspicion(rails: tuple[float, float], readings: Sequence[float]) -> Notice:
    names = " and ".join(f"{r:g}" for r in sorted(readings))
    many = len(readings) > 1
    what, follow = ("readings look", "do") if many else ("reading looks", "does")
    text = (
        f"the extreme {what} clipped: {names} {follow} not follow from the readings beside it. "
        f"Such samples were kept, with little weight if they are far off the others' curve; "
        f"give --rails {rails[0]:g}:{rails[1]:g} to leave them out."
    )
    return Notice("rails-suspected", text)
