"""Samples to fit: gathered, without clipped readings, checked, scaled and merged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import sqrt

import numpy as np

from ...errors import LogError, Notice, NotIdentifiedError
from ...estimation.blocks import joined
from ...estimation.map import MapRows, are_in_order, position_edges
from ...estimation.noise import noise_floor, white_noise
from ...estimation.uncertainty import t_quantile
from ...experiment import (
    Array,
    BoolArray,
    Experiment,
    FloatArray,
    Signal,
    all_of,
    where_both,
    where_finite,
)
from ...rows import middle_of
from .calibration import is_share_known, rising_share
from .options import PotentiometerOptions

FINE = 4096  # parts of the range whose samples are merged for searches
_SAMPLES = 30_000  # that a dead band or a shift is found by
_NEAR = 21  # distinct readings next to an extreme one that it is compared with
_SURE = 0.995  # confidence that an extreme reading is off the course of its neighbours


@dataclass(frozen=True)
class CalibrationData:
    """Samples of all logs, one after the other; those that are fitted also scaled to order one.

    Attributes
    ----------
    reading, reference
        Shape ``(n,)`` each [SI].
    parts
        Rows of every log.
    used
        Mask of the samples that are fitted, shape ``(n,)``.
    in_order
        Whether samples follow one another in time; see :func:`.are_in_order`.
    unit, output
        Unit of the reading, and reference of the first log.
    dead_band
        Change of the reading over which the branches change over; ``None`` for one curve.
    """

    reading: FloatArray
    reference: FloatArray
    parts: tuple[slice, ...]
    used: BoolArray
    in_order: bool
    unit: str
    output: Signal
    dead_band: float | None = None

    def kept(self, values: Array) -> Array:
        """Values at the used samples."""
        return all_of(values, self.used)

    def by_log(self, values: FloatArray) -> list[FloatArray]:
        """Values of used samples, cut into the logs that have any."""
        sizes = [int(np.count_nonzero(self.used[p])) for p in self.parts]
        return [v for v in np.split(values, np.cumsum(sizes)[:-1]) if len(v)]

    def rising(self, dead_band: float) -> FloatArray:
        """Share of the rising branch of the used samples; each log from its own start."""
        shares = [rising_share(self.reading[p], dead_band) for p in self.parts]
        return self.kept(joined(shares))

    def has_branch(self, dead_band: float) -> BoolArray:
        """Mask ``(n,)`` without the beginnings of logs that may belong to either branch."""
        return joined([is_share_known(self.reading[p], dead_band) for p in self.parts])

    def with_branches(self, dead_band: float) -> CalibrationData:
        """The samples, of which two branches are fitted to those that belong to one of them."""
        used = where_both(self.used, self.has_branch(dead_band))
        return replace(self, dead_band=dead_band, used=used)

    @cached_property
    def readings(self) -> tuple[float, float]:
        """Lowest reading that is used, and the range of all of them."""
        return _lowest_and_range(self.kept(self.reading))

    @cached_property
    def positions(self) -> tuple[float, float]:
        """Lowest reference that is used, and the range of all of them [SI]."""
        return _lowest_and_range(self.kept(self.reference))

    @cached_property
    def rows(self) -> MapRows:
        """Used samples by log: place and share of the rising branch, and position."""
        (low, span), (base, stroke) = self.readings, self.positions
        t, y = (self.kept(self.reading) - low) / span, (self.kept(self.reference) - base) / stroke
        one = np.broadcast_to(1.0, t.shape)
        share = one if self.dead_band is None else self.rising(self.dead_band)
        return MapRows(np.column_stack((t, share)), y, one)

    @cached_property
    def noise(self) -> float:
        """White noise of the readings [their unit]; 0 where their order says nothing of it.

        No more than there is in the order of the positions: a log may visit those at random.
        """
        if not self.in_order:
            return 0.0
        known = [all_of(x, where_finite(x)) for x in (self.reading[p] for p in self.parts)]
        x, y = (self.kept(v)[middle_of(self.rows.y.size)] for v in (self.reading, self.reference))
        in_time = max(white_noise(x[middle_of(x.size)]) for x in known)
        return min(_noise_at_position(x, y), in_time)

    def disturbed(self, draws: int) -> Iterator[MapRows]:
        """The rows with the noise of the readings added twice more, and with its reverse.

        The shift at the ends of a curve grows by less than the square of the noise: once more would
        show 0.6 of it.
        """
        rng, (t, share) = np.random.default_rng(0), self.rows.x[self.sparse].T
        for _ in range(draws):
            drawn = sqrt(2.0) * self.noise * rng.standard_normal(self.reading.size)
            for noise in (drawn, -drawn):  # what is linear in the noise cancels
                moved = t + self.kept(noise)[self.sparse] / self.readings[1]
                if self.dead_band is not None:
                    other = replace(self, reading=self.reading + noise)
                    share = other.rising(self.dead_band)[self.sparse]
                yield replace(
                    self.rows.take(self.sparse),
                    x=np.column_stack((np.clip(moved, 0.0, 1.0), share)),
                )

    @property
    def sparse(self) -> slice:
        """Rows of a long record that tell as much of a few numbers as all of them."""
        return slice(None, None, 1 + self.rows.y.size // _SAMPLES)

    @cached_property
    def few(self) -> MapRows:
        """The rows of one narrow part of the range, in which any curve is straight, as their mean.

        The readings of a converter are in parts of their own: the fit is exactly the same.
        """
        rows, (t, share) = self.rows, self.rows.x.T
        if rows.y.size <= FINE:
            return rows
        key = (t * FINE).astype(np.int64) * 5 + np.round(share * 4.0).astype(np.int64)
        sums = np.array([np.bincount(key, values) for values in (None, t, share, rows.y)])
        count, *means = sums[:, sums[0] > 0.0]
        t, share, y = (m / count for m in means)
        return MapRows(np.column_stack((t, share)), y, count)

    @cached_property
    def edges(self) -> FloatArray | None:
        """Edges between the positions at which readings were taken, ``None`` for a sweep."""
        return position_edges(self.few.x[:, 0], self.rows.y.size)

    @property
    def branches(self) -> int:
        """Number of curves."""
        return 1 if self.dead_band is None else 2

    @property
    def places(self) -> int:
        """Number of positions of readings, in a sweep of distinct readings, that a branch has."""
        distinct = np.unique(self.few.x[:, 0]).size
        places = distinct if self.edges is None else self.edges.size + 1
        return min(places, self.rows.y.size // self.branches)

    def words(self, scaled: float) -> str:
        """A difference of positions in words."""
        return self.output.text(scaled * self.positions[1])


def _lowest_and_range(values: FloatArray) -> tuple[float, float]:
    low = float(values.min())
    return low, float(values.max()) - low


def gather(experiments: Sequence[Experiment]) -> CalibrationData:
    """All samples of all logs, in order."""
    readings = [e["reading"] for e in experiments]
    reading, reference = joined(readings), joined([e["reference"] for e in experiments])
    ends = np.cumsum([0, *(x.size for x in readings)]).tolist()
    parts = tuple(slice(begin, end) for begin, end in pairwise(ends))
    used = where_both(where_finite(reading), where_finite(reference))
    in_order = are_in_order(experiments, "reading")
    first = experiments[0].signals
    unit = first["reading"].unit
    return CalibrationData(reading, reference, parts, used, in_order, unit, first["reference"])


def prepare(
    experiments: Sequence[Experiment], options: PotentiometerOptions
) -> tuple[CalibrationData, PotentiometerOptions, list[Notice]]:
    """All samples and which of them can be used; the options with the rails settled.

    Raises
    ------
    LogError, NotIdentifiedError
        When no sample is left, or none of them differ: no curve can be determined.
    """
    data, notices = gather(experiments), list[Notice]()
    rails = options.rails
    if options.clipped is None and data.used.any():
        rails, notices = _settle_rails(data, rails)
    used = where_both(data.used, between(data.reading, rails))
    if options.clipped is None:
        options = replace(options, rails=rails, clipped=not np.array_equal(used, data.used))
    data = replace(data, used=used)
    if not used.any():
        raise LogError(
            "no sample is left to fit.",
            expected="Samples with a reading inside the rails and a reference.",
            remedy="Correct --rails, --window or the columns.",
        )
    for name, (low, span), values in (
        ("reading", data.readings, data.reading), ("reference", data.positions, data.reference),
    ):  # fmt: skip
        if span <= 1e-12 * max(low + span, -low):
            kept = data.kept(values)
            raise NotIdentifiedError(
                f"the {name} is {kept[0]:g} in all {kept.size} samples.",
                expected="A calibration needs readings at several positions.",
                remedy="Move the potentiometer over its whole range while recording.",
            )
    return data, options, notices


def check_both_directions(data: CalibrationData) -> None:
    """Refuse two branches of a recording that moves one way only."""
    rows = data.rows
    for name, share in (("rising", rows.x[:, 1]), ("falling", 1.0 - rows.x[:, 1])):
        there = share >= 0.999
        if np.count_nonzero(there) < 5 or np.ptp(rows.x[there, 0]) < 0.5:
            raise NotIdentifiedError(
                f"the data cannot determine the {name} branch: the reading hardly moves that way.",
                expected="Readings over at least half of the range in both directions.",
                remedy="Record a stroke there and back, or give --branches pooled.",
            )


# ---------------------------------------------------------------------- clipped readings


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
    ends, notices = (float(x.min()), float(x.max())), list[Notice]()
    margin = 0.1 * (ends[1] - ends[0])
    widest = (ends[0] - margin, ends[1] + margin)
    rails = list(given or widest)
    suspected = []
    for k, sign in enumerate((1.0, -1.0)):
        at = rails[k] if given else ends[k]
        kind = "rails" if given else _how_clipped(x, y, at)
        count = int(np.count_nonzero(sign * (x - at) <= 0.0))
        if not (kind and count):
            continue
        kept = between(x, given or ends)
        inside = 3.0 * _reading_noise(x[kept], y[kept]) if count >= 3 else 0.0
        rails[k] = at + sign * inside
        samples = "1 sample" if count == 1 else f"{count} samples"
        near = f", and those within {inside:.3g} of it, three standard deviations of the noise"
        if kind == "rails":
            notices.append(Notice(
                "rails",
                f"{samples} at or beyond the reading {at:g}{near * (inside > 0.0)}: left out, as a "
                "clipped reading says nothing about the position.",
            ))  # fmt: skip
        else:
            suspected.append(f"{at:g} ({samples})")
    if suspected:
        notices.append(Notice(
            "rails-suspected",
            "extreme readings that look clipped, as their positions do not follow from the "
            f"readings beside them, are left out: {' and '.join(suspected)}. Give "
            f"--rails {widest[0]:g}:{widest[1]:g} to keep all.",
        ))  # fmt: skip
    return ((rails[0], rails[1]) if given or notices else None), notices


def _how_clipped(x: FloatArray, y: FloatArray, end: float) -> str:
    """Code of the notice of an extreme reading that is clipped; empty where it is not.

    Three or more samples are clipped if their references spread three times wider than those of the
    neighbouring readings do: by their scatter about a straight line, plus its slope over one step
    of the converter. A single sample is if it is off the course of its neighbours.
    """
    distinct = np.unique(x[:: max(x.size // 200_000, 1)])
    if distinct.size < 6:
        return ""
    if end > distinct[0]:
        distinct = distinct[::-1]
    at, near = x == end, distinct[distinct != end][:_NEAR]
    if np.count_nonzero(at) >= 3:
        beside = (x >= near.min()) & (x <= near.max())
        line = np.polynomial.Polynomial.fit(x[beside], y[beside], 1)
        scatter = float(np.std(y[beside] - line(x[beside])))
        slope = abs(float(line.convert().coef[-1]))
        finest = float(np.abs(np.diff(distinct)).min())
        return "rails" if np.std(y[at]) > 3.0 * (scatter + slope * finest) else ""
    means = np.array([y[x == v].mean() for v in near[:9]])
    off = _is_off_course(near[:9] - end, means - float(y[at].mean()))
    return "rails-suspected" if off else ""


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
    """Noise of the reading at a position [unit of the reading]; 0 where it cannot be told."""
    if reading.size < 200:
        return 0.0
    noise = _noise_at_position(reading, reference)
    return noise if noise <= 0.01 * float(np.ptp(reading)) else 0.0


def _noise_at_position(reading: FloatArray, reference: FloatArray) -> float:
    """Noise of the reading in the order of the position, whose own noise counts as well."""
    return noise_floor(reading[np.argsort(reference, kind="stable")], 3)
