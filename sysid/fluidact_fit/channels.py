"""Facts about the channels of a log before a fit: each by itself, and each pair.

Everything is in the unit of the column as recorded. A long record is looked at through the means
of at most some hundred or thousand consecutive parts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from math import log2, sqrt

import numpy as np

from .assessment import leads
from .errors import LogError
from .estimation.noise import white_noise
from .experiment import FloatArray
from .logs.checks import smallest_step
from .logs.columns import Binding, time_candidate
from .logs.grid import Run
from .logs.log import Column, Log
from .logs.repeats import rows_per_reading
from .logs.timebase import split_runs

_CURVE = 80  # points of a sparkline
_PARTS = 400  # of a record, to tell motion from rest
_LAGGED = 4000  # parts of a record, to tell the lag of two channels
_LEVELS = 16  # distinct values, up to which a channel is switched between levels
_STILL = 0.05  # of its usual change, below which a channel rests
_TURN = 0.05  # of its range, by which a channel has to come back to have turned round
_SURE = 6.0  # standard deviations of noise
_STUCK = 10  # equal readings of a noisy channel at least
_CLIPPED = 4  # readings in a row at the very end of the range
_CLIPPED_SHARE = 0.002  # of the samples there at least
_CHANCE = 5.0  # standard deviations of a correlation by chance
_FURTHEST = 0.1  # of a record, up to which lags are looked for
_COPY = 1e-5  # of its range, within which a channel is computed from another one
_FEWEST = 50  # samples that can tell so
_SQUARED = 1e150  # beyond it squares overflow; a logger's sign for no number
_AGREES = 0.9  # of the largest correlation, from which on a shorter lag is the lag
_FOLLOWS = 0.3  # correlation from which on two channels are worth a line


@dataclass(frozen=True)
class Channel:
    """Facts about one column.

    Attributes
    ----------
    curve
        Means of consecutive parts as heights from 0 to 1; ``None`` where a part holds no sample.
    low, high
        Smallest and largest value.
    levels
        Distinct values of a channel that is switched between a few, else 0.
    noise
        Standard deviation of the white part; 0 where the numbers are exact.
    bits
        Effective bits: of an ideal converter over the same range whose rounding is as large as
        the noise; ``None`` for a channel of a few levels.
    clipped_low, clipped_high
        Share of the samples that stand at the very end of the range, as noise never does.
    rest
        Share of the time without a change beyond the noise.
    reversals
        How often it turned round, by more than a twentieth of its range.
    repeated
        Mean rows per new reading of a moving channel; 1 where every row is one.
    stuck
        Longest run of equal readings of a noisy channel, in samples; 0 where there is none.
    stuck_from
        Its first row, from 0.
    """

    curve: tuple[float | None, ...]
    low: float
    high: float
    levels: int
    noise: float
    bits: float | None
    clipped_low: float
    clipped_high: float
    rest: float
    reversals: int
    repeated: float
    stuck: int
    stuck_from: int


@dataclass(frozen=True)
class Relation:
    """Facts about a pair of columns.

    Attributes
    ----------
    first, second
        Numbers of the columns; the first leads where one does.
    lag
        Samples by which the second follows; 0 where neither leads.
    resolution
        Samples within which the lag is known.
    correlation
        Of their changes at this lag, from -1 to 1; the sign is that of the motion.
    factor
        Of a second channel that is computed from the first, else ``None``.
    """

    first: int
    second: int
    lag: float
    resolution: float
    correlation: float
    factor: float | None = None


# ------------------------------------------------------------------------------- one channel


def describe_channels(log: Log) -> dict[int, Channel | None]:
    """Describe each column of a log, by its number."""
    longest = _longest_part(log)
    return {c.index: describe_channel(c, longest) for c in log.columns}


def time_of(log: Log) -> tuple[int, FloatArray] | None:
    """Column of the time, and instants of all rows [s], NaN outside any run; ``None`` without."""
    binding, runs = _runs(log)
    if binding is None or not runs:
        return None
    time = np.full(log.rows, np.nan)
    for run in runs:
        time[run.rows] = run.time
    return binding.column.index, time


def _runs(log: Log) -> tuple[Binding | None, list[Run]]:
    try:
        binding = time_candidate(log)
        return binding, [] if binding is None else split_runs(log, binding)[0]
    except LogError:
        return None, []


def _longest_part(log: Log) -> slice:
    """Rows of the longest run: noise is no difference of two runs."""
    runs = _runs(log)[1]
    rows = max((run.rows for run in runs), key=len, default=np.empty(0))
    return slice(int(rows[0]), int(rows[-1]) + 1) if len(rows) else slice(None)


def describe_channel(column: Column, run: slice = slice(None)) -> Channel | None:
    """Describe a column; ``None`` without two samples.

    Noise is looked for in the rows of one ``run``.
    """
    values = column.stamps[np.isfinite(column.stamps)]
    if values.size < 2:
        return None
    low, high = float(values.min()), float(values.max())
    levels = _few_levels(values)
    part = column.stamps[run]
    noise = 0.0 if levels or low == high else white_noise(part[np.isfinite(part)])
    step = smallest_step(values)
    noisy = noise > step
    rest, reversals = _motion(values, noise)
    stuck_from, stuck = _longest_run(values) if noisy else (0, 0)
    return Channel(
        _curve(column.stamps), low, high, levels, noise,
        None if levels else _effective_bits(high - low, noise, step),
        _share_at(values, low) if noisy else 0.0, _share_at(values, high) if noisy else 0.0,
        rest, reversals, rows_per_reading(values), stuck, stuck_from,
    )  # fmt: skip


def _few_levels(values: FloatArray) -> int:
    """Number of distinct values of a channel that is switched between few, else 0."""
    levels = np.unique(values[:: max(values.size // 100_000, 1)]).size
    return levels if levels <= _LEVELS and values.size >= 4 * levels else 0


def _effective_bits(span: float, noise: float, step: float) -> float | None:
    """``log2(range / (sqrt(12) sigma))``, where ``sigma`` is at least that of the rounding."""
    rounding = max(noise * sqrt(12.0), step)
    return min(log2(span / rounding), 52.0) if span > rounding > 0.0 else None


def _parts(values: FloatArray, most: int) -> tuple[FloatArray, int]:
    """Means of consecutive parts of one size, NaN where none is known, and that size."""
    size = max(values.size // most, 1)
    table = values[: values.size // size * size].reshape(-1, size)
    known = np.isfinite(table)
    count = known.sum(axis=1)
    total = np.where(known, table, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan), size


def _curve(values: FloatArray) -> tuple[float | None, ...]:
    """Heights of a sparkline."""
    edges = np.linspace(0, values.size, min(values.size, _CURVE) + 1).astype(int)
    parts = [values[a:b][np.isfinite(values[a:b])] for a, b in pairwise(edges)]
    means = [float(p.mean()) if p.size else None for p in parts]
    known = [m for m in means if m is not None]
    low, span = min(known), max(known) - min(known)
    return tuple(None if m is None else (m - low) / span if span else 0.0 for m in means)


def _motion(values: FloatArray, noise: float) -> tuple[float, int]:
    """Share of the time at rest, and how often the motion turned round."""
    means, size = _parts(values, _PARTS)
    means = means[np.isfinite(means)]
    if means.size < 3 or not np.ptp(means) > 0.0:
        return 1.0, 0
    change = np.abs(np.diff(means))
    spread = noise * sqrt(2.0 / size)
    still = max(_STILL * float(np.sqrt(np.mean(change**2))), 3.0 * spread)
    return float(np.mean(change < still)), _turns(means, spread)


def _turns(means: FloatArray, spread: float) -> int:
    """Extremes from which a signal came back by more than its noise and a part of its range."""
    least = max(_TURN * float(np.ptp(means)), _SURE * spread)
    turns, way, extreme = 0, 0, float(means[0])
    low = high = extreme
    for value in means[1:].tolist():
        if way == 0:
            low, high = min(low, value), max(high, value)
            if high - low > least:
                way, extreme = (1 if value == high else -1), value
        elif way * (value - extreme) > 0.0:
            extreme = value
        elif way * (extreme - value) > least:
            turns, way, extreme = turns + 1, -way, value
    return turns


def _share_at(values: FloatArray, end: float) -> float:
    """Share of the samples at an end of the range, where several in a row stand there."""
    at = values == end
    edges = np.flatnonzero(np.diff(np.r_[False, at, False].astype(np.int8)))
    runs = edges[1::2] - edges[::2]
    share = float(at.mean())
    return share if runs.max(initial=0) >= _CLIPPED and share >= _CLIPPED_SHARE else 0.0


def _longest_run(values: FloatArray) -> tuple[int, int]:
    """First row and length of the longest run of equal values within the range; 0 if by chance."""
    same = np.diff(values) == 0.0
    same &= (values[1:] != values.min()) & (values[1:] != values.max())
    edges = np.flatnonzero(np.diff(np.r_[False, same, False].astype(np.int8)))
    if not edges.size:
        return 0, 0
    lengths = edges[1::2] - edges[::2]
    k = int(np.argmax(lengths))
    usual = max(float(same.sum() - lengths[k]) / same.size, 0.01)
    by_chance = log2(1e-6 / same.size) / log2(min(usual, 0.9))
    long = int(lengths[k]) + 1
    return (int(edges[2 * k]), long) if long >= max(_STUCK, by_chance) else (0, 0)


# ------------------------------------------------------------------------------- two channels


def relate(columns: Sequence[Column]) -> list[Relation]:
    """Relate each pair of columns: which leads, by how much, with which sign.

    The lag is the shortest one at which their changes agree about as well as at any.
    """
    return list(_relations(columns))


def _relations(columns: Sequence[Column]) -> Iterator[Relation]:
    for one, other in combinations(columns, 2):
        known = np.maximum(np.abs(one.values), np.abs(other.values)) < _SQUARED  # not NaN either
        a, b = one.values[known], other.values[known]
        if a.size < _FEWEST:
            continue
        factor = factor_between(a, b)
        if factor is not None:
            sign = 1.0 if factor > 0.0 else -1.0
            yield Relation(one.index, other.index, 0.0, 0.0, sign, factor)
            continue
        lag, size, correlation = _lag(a, b)
        if abs(correlation) < max(_FOLLOWS, _CHANCE * sqrt(size / a.size)):
            continue
        first = leads(a, b)
        if first is not None and lag and first is not (lag > 0):
            lag = 0  # the changes from row to row say otherwise
        ends = (one.index, other.index) if lag >= 0 else (other.index, one.index)
        yield Relation(*ends, float(abs(lag) * size), float(size), correlation)


def factor_between(a: FloatArray, b: FloatArray) -> float | None:
    """Factor of a channel that is a straight line of another one, else ``None``.

    Such a channel was computed, or recorded twice: it says nothing that the other does not.
    """
    if a.size < _FEWEST or min(np.unique(a).size, np.unique(b).size) <= _LEVELS:
        return None
    da, db = a - a.mean(), b - b.mean()
    factor = float(da @ db) / float(da @ da)
    rounding = abs(factor) * smallest_step(a) + smallest_step(b)
    left = float(np.abs(db - factor * da).max())
    return (
        factor if left <= max(_COPY * float(np.ptp(b)), min(rounding, 1e-3 * np.ptp(b))) else None
    )


def _lag(a: FloatArray, b: FloatArray) -> tuple[int, int, float]:
    """Parts by which the changes of ``b`` follow those of ``a``, samples of a part, correlation."""
    (u, size), (v, _) = _parts(a, _LAGGED), _parts(b, _LAGGED)
    u, v = np.diff(u), np.diff(v)
    power = float(np.linalg.norm(u) * np.linalg.norm(v))
    if not power > 0.0:
        return 0, size, 0.0
    length = 2 * u.size
    both = np.fft.irfft(np.conj(np.fft.rfft(u, length)) * np.fft.rfft(v, length), length) / power
    most = max(int(_FURTHEST * u.size), 1)
    lags = np.r_[0 : most + 1, -most:0]
    found = both[lags]
    close = np.abs(found) >= _AGREES * np.abs(found).max()
    lag = int(min(lags[close], key=lambda k: (abs(k), -both[k])))
    return lag, size, float(both[lag])
