"""Samples that are fitted: gathered, checked, scaled, merged where they are many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ...errors import LogError, NotIdentifiedError
from ...estimation.blocks import joined
from ...experiment import BoolArray, Experiment, FloatArray, all_of, where_both, where_finite
from ...rows import by_rows
from .calibration import rising_share
from .rational_bezier import CurveFit, Rows, Shape
from .readings import Readings

COARSE, FINE = 600, 4096  # rows that searches and the final fit work on
MANY = 20_000  # rows that are worth merging
LONG = 200_000  # rows from which the colour of residuals is that of an excerpt
_BLOCKS = 8  # of an excerpt
_MOST_POSITIONS = 100  # beyond them readings are as good as a sweep
_BREAK = 4.0  # ratio of the gap between two positions to those between readings of one


@dataclass(frozen=True)
class Data:
    """All logs in one row of samples; ``parts`` are the logs, ``used`` what is fitted.

    ``in_order`` says that one sample follows the other in time: they have a time, or the
    reading goes to and fro. A table may have been sorted.
    """

    reading: FloatArray
    reference: FloatArray
    parts: tuple[slice, ...]
    used: BoolArray
    in_order: bool
    unit: str

    @cached_property
    def distinct(self) -> Readings:
        """Distinct readings of the used samples."""
        return Readings.of(self.kept(self.reading), self.kept(self.reference))

    def kept(self, values: FloatArray) -> FloatArray:
        """Values at the used samples."""
        return all_of(values, self.used)

    @property
    def sizes(self) -> list[int]:
        """Number of used samples of each log that has any."""
        counts = (int(np.count_nonzero(self.used[p])) for p in self.parts)
        return [n for n in counts if n]


def contiguous_parts(sizes: Sequence[int]) -> list[slice]:
    """The rows of every log; of long records contiguous parts, spread over all of them."""
    ends = np.cumsum(sizes).tolist()
    if ends[-1] <= LONG:
        return [slice(end - size, end) for end, size in zip(ends, sizes)]
    length = LONG // 4 // _BLOCKS
    out = []
    for k in np.linspace(0, ends[-1] - length, _BLOCKS).astype(int).tolist():
        log_end = ends[int(np.searchsorted(ends, k, side="right"))]
        out.append(slice(k, min(k + length, log_end)))
    return [p for p in out if p.stop - p.start > 200]


def gather(experiments: Sequence[Experiment]) -> Data:
    """All samples of all logs, in order."""
    reading = joined([e["reading"] for e in experiments])
    reference = joined([e["reference"] for e in experiments])
    ends = np.cumsum([e["reading"].size for e in experiments]).tolist()
    parts = tuple(slice(begin, end) for begin, end in pairwise([0, *ends]))
    used = where_both(where_finite(reading), where_finite(reference))
    timed = all(e.time.size > 0 for e in experiments)
    in_order = timed or _goes_to_and_fro([reading[p] for p in parts])
    unit = experiments[0].signals["reading"].unit
    return Data(reading, reference, parts, used, in_order, unit)


def _goes_to_and_fro(readings: Sequence[FloatArray]) -> bool:
    """Whether a reading rises as well as it falls."""
    return all(
        any(bool(way(x[:-1], x[1:]).any()) for x in readings) for way in (np.less, np.greater)
    )


def check_data(data: Data) -> None:
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


@dataclass(frozen=True)
class Scaled:
    """Used samples scaled to order one.

    ``rows`` are all of them, in the order of the logs; of long logs they are made where they are
    asked for. ``merged`` are those that share a reading in one, where that says the same, and
    ``scatter`` is the sum of the squares by which the samples of each of these miss their mean.
    """

    rows: Rows
    low: float
    span: float
    base: float
    stroke: float
    merged: Rows
    scatter: FloatArray | None = None

    @property
    def scattered(self) -> float:
        """Sum of squares that no curve explains: of samples beside their mean at one reading."""
        return 0.0 if self.scatter is None else float(self.scatter.sum())

    @cached_property
    def positions(self) -> npt.NDArray[np.intp] | None:
        """Which of the positions at which readings were taken each of ``merged`` belongs to."""
        return find_positions(self.merged.t, self.rows.t.size)

    def beside(self, fit: CurveFit) -> FloatArray:
        """What a curve leaves of all rows, shape ``(n,)``."""
        return by_rows(
            lambda t, y, rising: y - fit.evaluate(t, rising),
            self.rows.t, self.rows.y, self.rows.rising,
        )  # fmt: skip

    def squares(self, fit: CurveFit) -> float:
        """Weighted sum of squared residuals over all rows."""
        rest = self.merged.y - fit.evaluate(self.merged.t, self.merged.rising)
        return self.scattered + float((self.merged.count * rest) @ rest)


def scale_samples(data: Data, dead_band: float | None = None) -> Scaled:
    """Scale the used samples; without a dead band between branches there is one curve."""
    x, y = data.kept(data.reading), data.kept(data.reference)
    low, span, base, stroke = float(x.min()), float(np.ptp(x)), float(y.min()), float(np.ptp(y))
    alike = np.broadcast_to(1.0, x.shape)  # takes no memory
    share = alike
    if dead_band is not None:  # each log from its own start
        shares = [rising_share(data.reading[p], dead_band) for p in data.parts]
        share = data.kept(joined(shares))
    t, level = partial(_scaled, low=low, span=span), partial(_scaled, low=base, span=stroke)
    rows = Rows(by_rows(t, x), by_rows(level, y), alike, share)
    if dead_band is None and x.size > MANY and 4 * data.distinct.reading.size < x.size:
        found = data.distinct
        same = np.broadcast_to(1.0, found.count.shape)
        merged = Rows(t(found.reading), level(found.mean), found.count, same)
        return Scaled(rows, low, span, base, stroke, merged, found.scatter / stroke**2)
    return Scaled(rows, low, span, base, stroke, rows)


def _scaled(values: FloatArray, low: float, span: float) -> FloatArray:
    out = values - low
    out /= span
    return out


def find_positions(t: FloatArray, samples: int | None = None) -> npt.NDArray[np.intp] | None:
    """Which of the positions at which readings were taken each place belongs to, shape ``(n,)``.

    Readings that were taken at rest lie in groups, as far apart as the positions are and no
    wider than the noise: the gaps between sorted places then fall into small and large ones.
    ``None`` where they do not: a sweep, or one reading at each position. ``samples`` says how
    many there are where a place stands for several.
    """
    order = np.argsort(t, kind="stable")
    found = _divide(t[order], t.size if samples is None else samples)
    if found is None:
        return None
    key = np.empty(t.size, dtype=np.intp)
    key[order] = found
    return key


def _divide(places: FloatArray, samples: int) -> npt.NDArray[np.intp] | None:
    """The same for places in order, at each of which some of the samples lie."""
    gaps = np.diff(places)
    size = np.sort(gaps[gaps > 0.0])
    apart = 0.0
    if size.size:
        ratios = size[1:] / size[:-1]
        k = int(np.argmax(ratios)) if ratios.size else 0
        apart = float(size[k + 1]) if ratios.size and ratios[k] > _BREAK else float(size[0])
    groups = 1 + int(np.count_nonzero(gaps >= apart)) if apart else 0
    if not 3 <= groups <= min(_MOST_POSITIONS, samples // 2):
        return None
    if float(size[size >= apart].sum()) < 0.8 * float(size.sum()):
        return None
    return np.concatenate(([0], np.cumsum(gaps >= apart)))


def position_count(rows: Rows) -> int:
    """At how many positions the readings were taken; in a sweep at as many as there are."""
    key = find_positions(rows.t)
    return int(np.unique(rows.t).size if key is None else key.max() + 1)


def sample_count(rows: Rows) -> int:
    """How many samples the rows stand for; one of little weight is one."""
    return int(np.maximum(rows.count, 1.0).sum())


def check_enough(rows: Rows, shape: Shape) -> None:
    """Refuse a curve with more unknowns than the samples can determine."""
    samples, distinct = sample_count(rows), int(np.unique(rows.t).size)
    needed = shape.unknowns // shape.branches
    if samples >= shape.unknowns + 2 and distinct >= needed:
        return
    lower = f" or give a --degree below {shape.degree}" if shape.degree > 1 else ""
    raise NotIdentifiedError(
        f"{samples} samples at {distinct} distinct readings cannot determine a curve of degree "
        f"{shape.degree}, which has {shape.unknowns} unknowns.",
        expected=f"At least {shape.unknowns + 2} samples at {needed} distinct readings.",
        remedy=f"Record more positions{lower}.",
    )


def check_both_directions(rows: Rows) -> None:
    """Refuse two branches of a recording that moves one way only."""
    for name, share in (("rising", rows.rising), ("falling", 1.0 - rows.rising)):
        there = share >= 0.999
        if np.count_nonzero(there) < 5 or np.ptp(rows.t[there]) < 0.5:
            raise NotIdentifiedError(
                f"the data cannot determine the {name} branch: the reading hardly moves that way.",
                expected="Readings over at least half of the range in both directions.",
                remedy="Record a stroke there and back, or give --branches pooled.",
            )


def mean_ends(rows: Rows) -> tuple[float, float]:
    """Mean reference of the extreme readings."""
    return float(rows.y[rows.t == 0.0].mean()), float(rows.y[rows.t == 1.0].mean())
