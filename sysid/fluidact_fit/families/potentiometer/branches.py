"""Two branches: the dead band between them and the direction of every sample."""

from __future__ import annotations

import numpy as np

from ...errors import NotIdentifiedError
from ...experiment import FloatArray
from ...family import Request
from .calibration import rising_share
from .data import COARSE, Data, scale_samples
from .options import PotentiometerOptions
from .rational_bezier import Rows, Shape, bernstein, compress, fit_shape
from .selection import highest_degree


def find_dead_band(data: Data, request: Request[PotentiometerOptions]) -> float:
    """Dead band that describes the data best [unit of the reading].

    The branches are taken to be polynomials of the pooled curve, nearly straight ones.
    """
    if "hysteresis_dead_band" in request.fixed:
        return float(request.fixed["hysteresis_dead_band"])
    if request.options.dead_band is not None:
        return request.options.dead_band
    scaled = scale_samples(data)
    shape = Shape(min(4, highest_degree(scaled.merged, 1)))
    pooled = fit_shape(compress(scaled.merged, COARSE), shape, shape.starts()[:1])
    steps = np.diff(np.unique(scaled.merged.t)) * scaled.span
    finest = max(2.0 * float(steps.min()), 2e-3 * scaled.span)
    part = max(data.parts, key=lambda p: p.stop - p.start)
    part = slice(part.start, min(part.stop, part.start + 30_000))
    used, x = data.used[part], data.reading[part]
    t = (x[used] - scaled.low) / scaled.span
    y = (data.reference[part][used] - scaled.base) / scaled.stroke
    b = bernstein(np.clip(pooled.evaluate(t, np.ones(t.size)), 0.0, 1.0), 4)
    best, found = np.inf, finest
    for band in finest * 2.0 ** np.arange(6):
        share = rising_share(x, band)[used, None]
        columns = np.hstack((b * share, b * (1.0 - share)))
        rest = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
        if rest @ rest < best * (1.0 - 1e-3):
            best, found = float(rest @ rest), float(band)
    return found


def rising_samples(data: Data, dead_band: float) -> FloatArray:
    """Share of the rising branch at every sample, each log from its own start."""
    return np.concatenate([rising_share(data.reading[p], dead_band) for p in data.parts])


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
