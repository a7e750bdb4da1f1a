"""Samples to fit: gathered, without clipped readings, checked, scaled and merged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from ...errors import LogError, Notice, NotIdentifiedError
from ...estimation.blocks import joined
from ...estimation.map import MapRows, position_edges
from ...estimation.noise import noise_floor
from ...estimation.uncertainty import t_quantile
from ...experiment import (
    BoolArray,
    Experiment,
    FloatArray,
    Signal,
    all_of,
    where_both,
    where_finite,
)
from .calibration import rising_share
from .options import PotentiometerOptions

FINE = 4096  # rows that searches work on
_NEAR = 21  # distinct readings next to an extreme one that it is compared with
_SURE = 0.995  # confidence that an extreme reading is off the course of its neighbours


@dataclass(frozen=True)
class CalibrationData:
    """Samples of all logs, one after the other.

    Attributes
    ----------
    reading, reference
        Shape ``(n,)`` each [SI].
    parts
        Rows of every log.
    used
        Mask of the samples that are fitted, shape ``(n,)``.
    in_order
        Whether samples follow one another in time: they have a time, or the reading moves in both
        directions. A table may have been sorted.
    unit, output
        Unit of the reading, and reference of the first log.
    """

    reading: FloatArray
    reference: FloatArray
    parts: tuple[slice, ...]
    used: BoolArray
    in_order: bool
    unit: str
    output: Signal

    def kept(self, values: FloatArray) -> FloatArray:
        """Values at the used samples."""
        return all_of(values, self.used)

    def by_log(self, values: FloatArray) -> list[FloatArray]:
        """Values of used samples, cut into the logs that have any."""
        sizes = [int(np.count_nonzero(self.used[p])) for p in self.parts]
        ends = np.cumsum([0, *(n for n in sizes if n)]).tolist()
        return [values[a:b] for a, b in pairwise(ends)]

    def rising(self, dead_band: float) -> FloatArray:
        """Share of the rising branch of the used samples; each log from its own start."""
        shares = [rising_share(self.reading[p], dead_band) for p in self.parts]
        return self.kept(joined(shares))


def gather(experiments: Sequence[Experiment]) -> CalibrationData:
    """All samples of all logs, in order."""
    readings = [e["reading"] for e in experiments]
    reading, reference = joined(readings), joined([e["reference"] for e in experiments])
    ends = np.cumsum([0, *(x.size for x in readings)]).tolist()
    parts = tuple(slice(begin, end) for begin, end in pairwise(ends))
    used = where_both(where_finite(reading), where_finite(reference))
    both_ways = all(
        any(bool(way(x[:-1], x[1:]).any()) for x in readings) for way in (np.less, np.greater)
    )
    in_order = both_ways or all(e.time.size > 0 for e in experiments)
    first = experiments[0].signals
    unit = first["reading"].unit
    return CalibrationData(reading, reference, parts, used, in_order, unit, first["reference"])


def check_data(data: CalibrationData) -> None:
    """Refuse data that cannot determine any curve."""
    if not data.used.any():
        raise LogError(
            "no sample is left to fit.",
            expected="Samples with a reading inside the rails and a reference.",
            remedy="Correct --rails, --window or the columns.",
        )
    for name, values in (("reading", data.reading), ("reference", data.reference)):
        kept = data.kept(values)
        low, high = float(kept.min()), float(kept.max())
        if high - low <= 1e-12 * max(high, -low):
            raise NotIdentifiedError(
                f"the {name} is {kept[0]:g} in all {kept.size} samples.",
                expected="A calibration needs readings at several positions.",
                remedy="Move the potentiometer over its whole range while recording.",
            )


# ---------------------------------------------------------------------- clipped readings


def prepare(
    experiments: Sequence[Experiment], options: PotentiometerOptions
) -> tuple[CalibrationData, PotentiometerOptions, list[Notice]]:
    """All samples and which of them can be used; the options with the rails settled."""
    data = gather(experiments)
    check_data(data)
    notices: list[Notice] = []
    if options.clipped is None:
        rails, notices = _settle_rails(data, options.rails)
        inside = where_both(data.used, between(data.reading, rails))
        options = replace(options, rails=rails, clipped=not np.array_equal(inside, data.used))
    used = where_both(data.used, between(data.reading, options.rails))
    if not np.array_equal(used, data.used):
        data = replace(data, used=used)
        check_data(data)
    return data, options, notices


def between(reading: FloatArray, rails: tuple[float, float] | None) -> BoolArray:
    """Readings that are finite and inside the rails, if there are any."""
    if rails is None:
        return where_finite(reading)
    return (reading > rails[0]) & (reading < rails[1])


def _settle_rails(
    data: CalibrationData, given: tuple[float, float] | None
) -> tuple[tuple[float, float] | None, list[Notice]]:
    """Return given rails, or those found at the extreme readings; ``None`` where none clips.

    Readings within three standard deviations of their noise from a clipping rail are left out as
    well: those whose noise happened to point inwards would bend the ends of the curve.
    """
    x, y = data.kept(data.reading), data.kept(data.reference)
    low, high = float(x.min()), float(x.max())
    margin, notices = 0.1 * (high - low), []
    rails = given or (low - margin, high + margin)
    for k, end in enumerate((low, high)):
        if given is not None:
            clips = x <= rails[0] if k == 0 else x >= rails[1]
            count, kind = int(np.count_nonzero(clips)), "rails"
        else:
            count, kind = _resting(x, y, end)
        if not count:
            continue
        inside = 0.0
        if count >= 3:
            kept = between(x, rails if given else (low, high))
            inside = 3.0 * _reading_noise(x[kept], y[kept])
        at = rails[k] if given else end
        rails = (at + inside, rails[1]) if k == 0 else (rails[0], at - inside)
        every = f"{low - margin:g}:{high + margin:g}"
        notices.append(_rails_notice(kind, count, at, inside, every))
    return (rails if given is not None or notices else None), notices


def _resting(x: FloatArray, y: FloatArray, end: float) -> tuple[int, str]:
    """Number of samples clipped at an extreme reading, and the code of the notice.

    Three or more samples are clipped if their references spread three times wider than those of the
    neighbouring readings do: by their scatter about a straight line, plus its slope over one step
    of the converter. A single sample is if it is off the course of its neighbours.
    """
    distinct = np.unique(x[:: max(x.size // 200_000, 1)])
    if distinct.size < 6:
        return 0, ""
    if end > distinct[0]:
        distinct = distinct[::-1]
    at, near = x == end, distinct[distinct != end][:_NEAR]
    count = int(np.count_nonzero(at))
    if count >= 3:
        beside = (x >= near.min()) & (x <= near.max())
        line = np.polynomial.Polynomial.fit(x[beside], y[beside], 1)
        scatter = float(np.std(y[beside] - line(x[beside])))
        slope = abs(float(line.convert().coef[-1]))
        finest = float(np.abs(np.diff(distinct)).min())
        return (count, "rails") if np.std(y[at]) > 3.0 * (scatter + slope * finest) else (0, "")
    means = np.array([y[x == v].mean() for v in near[:9]])
    off = _is_off_course(near[:9] - end, means - float(y[at].mean()))
    return (count, "rails-suspected") if off else (0, "")


def _is_off_course(x: FloatArray, y: FloatArray) -> bool:
    """Return whether an extreme at the origin does not continue its neighbours ``x``, ``y``.

    Neither a line nor a parabola leads there, and the step to it is out of proportion.
    """
    if x.size < 7:
        return False
    steps = np.abs(np.diff(y[:5], prepend=0.0) / np.diff(x[:5], prepend=0.0))
    if 1.0 / 3.0 < steps[0] / max(float(np.median(steps[1:])), 1e-300) < 3.0:
        return False
    for degree, points in ((1, 7), (2, 9)):
        columns = np.vander(x[:points] / x[-1], degree + 1, increasing=True)
        found = np.linalg.lstsq(columns, y[:points], rcond=None)[0]
        rest = y[:points] - columns @ found
        free = max(rest.size - degree - 1, 1)
        leverage = float(np.linalg.inv(columns.T @ columns)[0, 0])
        error = float(np.sqrt(rest @ rest / free * (1.0 + leverage)))
        if abs(found[0]) <= t_quantile(_SURE, free) * error + 1e-9 * np.ptp(y):
            return False
    return True


def _reading_noise(reading: FloatArray, reference: FloatArray) -> float:
    """Noise of the reading at a position [unit of the reading]; 0 where it cannot be told.

    In the order of the position, whose own noise counts as well.
    """
    if reading.size < 200:
        return 0.0
    x = reading[np.argsort(reference, kind="stable")]
    noise = noise_floor(x, 3)
    return noise if noise <= 0.01 * float(np.ptp(x)) else 0.0


def _rails_notice(kind: str, count: int, rail: float, inside: float, every: str) -> Notice:
    samples = "1 sample" if count == 1 else f"{count} samples"
    if kind == "rails-suspected":
        text = (
            f"the extreme reading {rail:g} looks clipped, as its position does not follow from "
            f"the readings beside it: {samples} left out. Give --rails {every} to keep all."
        )
        return Notice("rails-suspected", text)
    near = ""
    if inside:
        near = f", and those within {inside:.3g} of it, three standard deviations of the noise"
    text = f"{samples} at or beyond the reading {rail:g}{near}: left out, as a clipped reading "
    return Notice("rails", f"{text}says nothing about the position.")


# -------------------------------------------------------------------- scaled to order one


@dataclass(frozen=True)
class ScaledSamples:
    """Used samples scaled to order one: place and share of the rising branch, and position.

    Attributes
    ----------
    rows, few
        All samples in the order of the logs, and the same with those of one reading, or of one
        narrow bin, merged.
    low, span, base, stroke
        Lowest value and range of the reading, and of the reference [SI].
    output
        Reference of the first log.
    """

    rows: MapRows
    low: float
    span: float
    base: float
    stroke: float
    few: MapRows
    output: Signal

    @cached_property
    def edges(self) -> FloatArray | None:
        """Edges between the positions at which readings were taken."""
        return position_edges(self.few.x[:, 0], self.rows.y.size)

    @property
    def positions(self) -> int:
        """Number of positions of readings; in a sweep that of distinct readings."""
        return np.unique(self.few.x[:, 0]).size if self.edges is None else self.edges.size + 1

    def words(self, scaled: float) -> str:
        """A difference of positions in words."""
        return self.output.text(scaled * self.stroke)


def scale_samples(data: CalibrationData, dead_band: float | None = None) -> ScaledSamples:
    """Scale the used samples; without a dead band between branches there is one curve."""
    x, y = data.kept(data.reading), data.kept(data.reference)
    (low, high), (base, top) = ((float(v.min()), float(v.max())) for v in (x, y))
    span, stroke = high - low, top - base
    share = np.broadcast_to(1.0, x.shape) if dead_band is None else data.rising(dead_band)
    table, level = np.column_stack(((x - low) / span, share)), (y - base) / stroke
    rows = MapRows(table, level, np.broadcast_to(1.0, x.shape))
    return ScaledSamples(rows, low, span, base, stroke, _merged(rows), data.output)


def _merged(rows: MapRows) -> MapRows:
    """Rows at equal places, or of one narrow bin, merged into their means.

    Where the places are those of a converter the fit is exactly the same. Otherwise the bins are
    so narrow that the curve is straight within them.
    """
    if rows.y.size <= FINE:
        return MapRows(np.asarray(rows.x), np.asarray(rows.y), np.asarray(rows.count))
    distinct = np.unique(rows.x[:: max(rows.y.size // (8 * FINE), 1), 0])
    edges = np.linspace(0.0, 1.0, FINE + 1)
    if distinct.size <= FINE:
        edges = np.concatenate(([-1.0], 0.5 * (distinct[1:] + distinct[:-1]), [2.0]))
    t, share = rows.x.T
    place = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, edges.size - 2)
    key = place * 5 + np.round(share * 4.0).astype(np.int64)
    sums = np.array([np.bincount(key, values) for values in (None, t, share, rows.y)])
    count, *means = sums[:, sums[0] > 0.0]
    t, share, y = (m / count for m in means)
    return MapRows(np.column_stack((t, share)), y, count)


def check_both_directions(rows: MapRows) -> None:
    """Refuse two branches of a recording that moves one way only."""
    for name, share in (("rising", rows.x[:, 1]), ("falling", 1.0 - rows.x[:, 1])):
        there = share >= 0.999
        if np.count_nonzero(there) < 5 or np.ptp(rows.x[there, 0]) < 0.5:
            raise NotIdentifiedError(
                f"the data cannot determine the {name} branch: the reading hardly moves that way.",
                expected="Readings over at least half of the range in both directions.",
                remedy="Record a stroke there and back, or give --branches pooled.",
            )
