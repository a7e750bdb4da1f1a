"""Samples that are fitted: gathered, without rails, scaled, merged where they are many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ...errors import LogError, Notice, NotIdentifiedError
from ...experiment import Experiment, FloatArray
from .options import PotentiometerOptions
from .rails import between, find_rails, widen_rails
from .rational_bezier import CurveFit, Rows, Shape, group, merge

BoolArray = npt.NDArray[np.bool_]
COARSE, FINE = 600, 4096  # rows that searches and the final fit work on
MANY = 20_000  # rows that are worth merging


@dataclass(frozen=True)
class Data:
    """All logs in one row of samples; ``parts`` are the logs, ``used`` what is fitted."""

    reading: FloatArray
    reference: FloatArray
    parts: tuple[slice, ...]
    used: BoolArray
    timed: bool
    unit: str
    step: float
    suspects: tuple[float, ...] = ()

    def split(self, values: FloatArray) -> list[FloatArray]:
        """Values per log."""
        return [values[p] for p in self.parts]

    def kept(self, values: FloatArray) -> list[FloatArray]:
        """Values of the used samples per log that has any."""
        pieces = [values[p][self.used[p]] for p in self.parts]
        return [p for p in pieces if p.size]


def gather(experiments: Sequence[Experiment]) -> Data:
    """All samples of all logs, in order."""
    reading = np.concatenate([e["reading"] for e in experiments])
    reference = np.concatenate([e["reference"] for e in experiments])
    ends = np.cumsum([e["reading"].size for e in experiments])
    parts = tuple(slice(int(b - e["reading"].size), int(b)) for e, b in zip(experiments, ends))
    used = np.isfinite(reading) & np.isfinite(reference)
    timed = all(e.time.size > 0 for e in experiments)
    first = experiments[0].signals["reading"]
    return Data(reading, reference, parts, used, timed, first.unit, first.resolution)


def prepare(
    experiments: Sequence[Experiment], options: PotentiometerOptions
) -> tuple[Data, PotentiometerOptions, list[Notice]]:
    """All samples and which of them can be used; the options with the rails settled."""
    data = gather(experiments)
    check_data(data)
    notices: list[Notice] = []
    if options.clipped is None:
        rails, suspects = options.rails, list[float]()
        if rails is None:
            rails, suspects, notices = find_rails(
                data.reading, data.reference, data.used, data.step
            )
        else:
            rails, notices = widen_rails(data.reading, data.reference, data.used, rails)
        left_out = not between(data.reading, rails)[data.used].all()
        named = ",".join(repr(s) for s in suspects) or None
        options = replace(options, rails=rails, clipped=left_out, suspects=named)
    used = data.used & between(data.reading, options.rails)
    data = replace(data, used=used, suspects=options.suspected)
    check_data(data)
    return data, options, notices


def check_data(data: Data) -> None:
    """Refuse data that cannot determine any curve."""
    if not data.used.any():
        raise LogError(
            "no sample is left to fit.",
            expected="Samples with a reading inside the rails and a reference.",
            remedy="Correct --rails, --window or the columns.",
        )
    for name, values in (("reading", data.reading), ("reference", data.reference)):
        kept = values[data.used]
        if np.ptp(kept) <= 1e-12 * np.abs(kept).max():
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
    """

    rows: Rows
    low: float
    span: float
    base: float
    stroke: float
    merged: Rows
    key: npt.NDArray[np.intp] | None

    def evaluate(self, fit: CurveFit) -> FloatArray:
        """Value of a curve at all rows."""
        if self.key is None:
            return fit.evaluate(self.rows.t, self.rows.rising)
        return np.asarray(fit.evaluate(self.merged.t, self.merged.rising)[self.key])

    def squares(self, fit: CurveFit) -> float:
        """Weighted sum of squared residuals over all rows."""
        rest = self.rows.y - self.evaluate(fit)
        return float((self.rows.count * rest) @ rest)


def scale_samples(data: Data, rising: FloatArray | None = None) -> Scaled:
    """Scale the used samples; without a share of the rising branch there is one curve."""
    whole = bool(data.used.all())
    x = data.reading if whole else data.reading[data.used]
    y = data.reference if whole else data.reference[data.used]
    low, span, base, stroke = float(x.min()), float(np.ptp(x)), float(y.min()), float(np.ptp(y))
    one = np.ones(x.size)
    share = one if rising is None else rising[data.used]
    rows = Rows((x - low) / span, (y - base) / stroke, one, share)
    merged, key = rows, None
    if rising is None and x.size > MANY:
        places, found = group(x, data.step)
        if 4 * places.size < x.size:
            key, merged = found, merge(rows, (places - low) / span, found)
    return Scaled(rows, low, span, base, stroke, merged, key)


def sample_count(rows: Rows) -> int:
    """How many samples the rows stand for; one of little weight is one."""
    return int(np.maximum(rows.count, 1.0).sum())


def check_enough(rows: Rows, shape: Shape) -> None:
    """Refuse a curve with more unknowns than the samples can determine."""
    samples, distinct = sample_count(rows), int(np.unique(rows.t).size)
    needed = shape.unknowns // shape.branches
    if samples >= shape.unknowns + 2 and distinct >= needed:
        return
    lower = f"or give a --degree below {shape.degree}" if shape.degree > 1 else ""
    raise NotIdentifiedError(
        f"{samples} samples at {distinct} distinct readings cannot determine a curve of degree "
        f"{shape.degree}, which has {shape.unknowns} unknowns.",
        expected=f"At least {shape.unknowns + 2} samples at {needed} distinct readings.",
        remedy=" ".join(f"Record more positions {lower}".split()) + ".",
    )


def mean_ends(rows: Rows) -> tuple[float, float]:
    """Mean reference of the extreme readings."""
    return float(rows.y[rows.t == 0.0].mean()), float(rows.y[rows.t == 1.0].mean())
