"""Samples that are fitted: gathered, checked, scaled, merged where they are many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ...errors import LogError, NotIdentifiedError
from ...estimation.blocks import joined
from ...experiment import BoolArray, Experiment, FloatArray, all_of
from .calibration import rising_share
from .rational_bezier import CurveFit, Rows, Shape, group

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
    def grouped(self) -> tuple[FloatArray, npt.NDArray[np.intp]]:
        """Distinct readings of the used samples in order, and which of them each one is."""
        return group(self.kept(self.reading))

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
    used = np.isfinite(reading) & np.isfinite(reference)
    timed = all(e.time.size > 0 for e in experiments)
    in_order = timed or _goes_to_and_fro([reading[p] for p in parts])
    unit = experiments[0].signals["reading"].unit
    return Data(reading, reference, parts, used, in_order, unit)


def _goes_to_and_fro(readings: Sequence[FloatArray]) -> bool:
    """Whether a reading rises as well as it falls."""
    steps = np.concatenate([np.diff(x) for x in readings])
    return bool(np.nanmin(steps, initial=0.0) < 0.0 < np.nanmax(steps, initial=0.0))


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

    ``rows`` are all of them, in the order of the logs. ``merged`` are those that share a
    reading in one, where that says the same: ``key`` tells which of them a row went into.
    ``grouped`` are the distinct places of many rows in order, and which of them each row is at.
    """

    rows: Rows
    low: float
    span: float
    base: float
    stroke: float
    merged: Rows
    key: npt.NDArray[np.intp] | None
    grouped: tuple[FloatArray, npt.NDArray[np.intp]] | None = None

    @cached_property
    def positions(self) -> npt.NDArray[np.intp] | None:
        """Which of the positions at which readings were taken each row belongs to."""
        if self.grouped is None:
            return find_positions(self.rows.t)
        places, key = self.grouped
        found = _divide(places, key.size)
        return None if found is None else found[key]

    def evaluate(self, fit: CurveFit) -> FloatArray:
        """Value of a curve at all rows."""
        if self.key is None:
            return fit.evaluate(self.rows.t, self.rows.rising)
        return np.asarray(fit.evaluate(self.merged.t, self.merged.rising)[self.key])

    def squares(self, fit: CurveFit) -> float:
        """Weighted sum of squared residuals over all rows."""
        rest = self.rows.y - self.evaluate(fit)
        return float((self.rows.count * rest) @ rest)


def scale_samples(data: Data, dead_band: float | None = None) -> Scaled:
    """Scale the used samples; without a dead band between branches there is one curve."""
    x, y = data.kept(data.reading), data.kept(data.reference)
    low, span, base, stroke = float(x.min()), float(np.ptp(x)), float(y.min()), float(np.ptp(y))
    alike = np.broadcast_to(1.0, x.shape)  # takes no memory
    share = alike
    if dead_band is not None:  # each log from its own start
        shares = [rising_share(data.reading[p], dead_band) for p in data.parts]
        share = np.concatenate(shares)[data.used]
    rows = Rows(_scaled(x, low, span), _scaled(y, base, stroke), alike, share)
    if dead_band is None and x.size > MANY:
        readings, key = data.grouped
        grouped = _scaled(readings, low, span), key
        if 4 * readings.size < x.size:
            return Scaled(rows, low, span, base, stroke, rows.merge(key), key, grouped)
        return Scaled(rows, low, span, base, stroke, rows, None, grouped)
    return Scaled(rows, low, span, base, stroke, rows, None)


def _scaled(values: FloatArray, low: float, span: float) -> FloatArray:
    out = values - low
    out /= span
    return out


def find_positions(t: FloatArray) -> npt.NDArray[np.intp] | None:
    """Which of the positions at which readings were taken each place belongs to, shape ``(n,)``.

    Readings that were taken at rest lie in groups, as far apart as the positions are and no
    wider than the noise: the gaps between sorted places then fall into small and large ones.
    ``None`` where they do not: a sweep, or one reading at each position.
    """
    order = np.argsort(t, kind="stable")
    found = _divide(t[order], t.size)
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
