"""What the residuals of a curve show: positions it misses, and a direction of motion.

Readings at one position share the error of its reference, and a curve that is too stiff misses
all of them alike: they count as one observation then. With ``B`` positions (or stretches of a
sweep), ``p`` unknowns and ``n`` samples the mean squares

    between = sum_b n_b mean_b(r)^2 / (B - p),   within = sum_b sum (r - mean_b(r))^2 / (n - B)

agree where every sample has an error of its own [1]_; where ``between`` is the larger one, the
covariance is that of samples with its variance.

References
----------
.. [1] N. Draper, H. Smith, Applied Regression Analysis, 3rd ed., 1998, section 2.1: lack of
   fit and pure error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ...errors import Notice
from ...estimation.blocks import joined
from ...estimation.noise import noise_floor
from ...estimation.uncertainty import Uncertainty, covariance, enlarge
from ...experiment import FloatArray, all_of, where_finite
from ...rows import blocks
from .calibration import rising_share
from .data import Data, Scaled, contiguous_parts
from .rational_bezier import CurveFit, Rows

_STRETCHES = 60  # of a sweep
_BY_CHANCE = 0.01  # probability of a ratio of mean squares that is no accident
_SURELY = 1e-6
_MATTERS = 2e-3  # part of the stroke
_TWO_LEVELS = -1.35  # excess kurtosis of residuals
_TREMBLE = 8.0  # standard deviations of a reading that it has to move to have a direction
_APART = 5.0  # standard errors of a difference between both directions


@dataclass(frozen=True)
class Misfit:
    """Residuals by position: mean squares between and within, and how probable their ratio is.

    ``rms`` is what the curve misses the positions by beyond the scatter, all scaled; ``worst`` is
    the place of the largest miss and ``at_rest`` whether readings were taken at rest.
    """

    between: float
    within: float
    probability: float
    degrees: int
    rms: float
    worst: float
    at_rest: bool

    @property
    def matters(self) -> bool:
        """Whether the miss is larger than the scatter, and a part of the stroke worth saying."""
        return self.rms > _MATTERS and self.rms**2 > self.within


def find_misfit(fit: CurveFit, scaled: Scaled) -> Misfit | None:
    """Compare the scatter of positions with that of readings; ``None`` where they are few."""
    from scipy.special import fdtrc

    rows, samples = scaled.merged, scaled.rows.t.size
    rest, unknowns = rows.y - fit.evaluate(rows.t, rows.rising), fit.shape.unknowns
    key = scaled.positions
    at_rest = key is not None
    if key is None:
        key = _stretches(rows, samples)
    size = np.bincount(key, rows.count)
    mean = np.bincount(key, rest * rows.count) / np.maximum(size, 1e-300)
    degrees, free = size.size - unknowns, samples - size.size
    if degrees < 1 or free < 10:
        return None
    between = float(size @ mean**2) / degrees
    within = (scaled.scattered + float(rows.count @ (rest - mean[key]) ** 2)) / free
    floor = 1e-28  # what rounding leaves
    probability = float(fdtrc(degrees, free, (between + floor) / (within + floor)))
    rms = float(np.sqrt(max(between - within, 0.0) * degrees / max(float(size.sum()), 1.0)))
    worst = int(np.argmax(np.abs(mean) * np.sqrt(size)))
    there = key == worst
    place = float(np.average(rows.t[there], weights=np.maximum(rows.count[there], 1.0)))
    return Misfit(between, within, probability, degrees, rms, place, at_rest)


def _stretches(rows: Rows, samples: int) -> npt.NDArray[np.intp]:
    """Stretches of a sweep of equally many samples; those of equal readings stay together."""
    count = max(min(_STRETCHES, samples // 5), 1)
    shares = np.arange(1, count) / count
    place = (samples - 1) * shares
    before = np.floor(place).astype(np.int64)
    if rows.t.size < samples:  # in order, as many samples each as it counts
        ends = np.cumsum(rows.count)
        low, high = (rows.t[np.searchsorted(ends, before + k, side="right")] for k in (0, 1))
        edges = low + (place - before) * (high - low)
    else:
        edges = np.quantile(rows.t, shares)
    key = np.searchsorted(np.unique(edges), rows.t, side="right")
    used = np.bincount(key) > 0
    return (np.cumsum(used) - 1)[key]


def widen(spread: Uncertainty, white: Uncertainty, misfit: Misfit | None) -> Uncertainty:
    """Covariance that allows for errors which all readings at a position share.

    ``white`` is the covariance of independent samples, of the same unknowns.
    """
    if misfit is None or misfit.probability > _BY_CHANCE:
        return spread
    if not (misfit.at_rest or misfit.matters):
        return spread  # a sweep tells noise from misfit by neighbours only: less sure
    shared = np.diag(white.covariance) * (misfit.between / max(white.sigma**2, 1e-300))
    return replace(
        spread,
        covariance=enlarge(spread.covariance, shared),
        degrees=min(spread.degrees, misfit.degrees),
    )


def misfit_notice(misfit: Misfit | None, scaled: Scaled, unit: str) -> list[Notice]:
    """Warn of a curve that misses positions by more than their readings scatter."""
    if misfit is None or misfit.probability > _SURELY:
        return []
    if not misfit.matters:
        return []
    reading = scaled.low + misfit.worst * scaled.span
    common = (
        ", or the reference at a position is off by that much, which more readings there do not "
        "mend" if misfit.at_rest else ""
    )  # fmt: skip
    text = (
        f"the curve misses the readings by {_mm(misfit.rms, scaled)} (RMS), while readings beside "
        f"each other scatter by {_mm(np.sqrt(misfit.within), scaled)}, most of all at a reading of "
        f"{reading:.6g} {unit}".removesuffix(" 1")
        + f": it cannot follow the sensor{common}. "
        "Look at the picture (--plot); try a higher --degree, or fit only the range that you use "
        "(--rails)."
    )
    return [Notice("curve-misses", text)]


def _two_groups_notice(rest: FloatArray, scaled: Scaled) -> list[Notice]:
    """Warn of residuals in two groups: both directions in a log that was sorted.

    The excess kurtosis of a normal scatter is 0, of that of a coarse converter -1.2, of two
    levels, one up to twice as frequent as the other, -1.5 to -2.
    """
    n = rest.size
    if n < 100:
        return []
    mean = sum(float(rest[at].sum()) for at in blocks(n)) / n
    variance, fourth = (
        sum(float(np.sum((rest[at] - mean) ** k)) for at in blocks(n)) / n for k in (2, 4)
    )
    kurtosis = fourth / max(variance**2, 1e-300) - 3.0
    if kurtosis > _TWO_LEVELS or np.sqrt(variance) < _MATTERS:
        return []
    text = (
        f"the curve is off by some {_mm(np.sqrt(variance), scaled)} to one side or the other, and "
        "by little else: the position depends on the direction in which the reading moved (play "
        "in the coupling), or there are too few positions for the curve. Give the rows in the "
        "order in which they were recorded and --branches=two, or record more positions."
    )
    return [Notice("directions-differ", text)]


def _one_way() -> Notice:
    return Notice(
        "one-direction",
        "the reading moves in one direction only: whether it depends on the direction, by play in "
        "the coupling or a delay between the two signals, cannot be seen, and the curve holds for "
        "this direction. Record strokes to and fro.",
    )


def _mm(scaled_length: float, scaled: Scaled) -> str:
    return f"{1e3 * scaled_length * scaled.stroke:.3g} mm"


def direction_notice(
    fit: CurveFit, jacobian: Callable[[slice], FloatArray], scaled: Scaled, data: Data
) -> list[Notice]:
    """Warn of one curve for two directions that differ by more than their scatter.

    The residual is regressed on the direction in which the reading moves, the unknowns of the
    curve beside it; ``jacobian`` gives their derivatives at some rows, shape ``(n, p)``.
    """
    if fit.shape.branches > 1:
        return []
    readings = [data.reading[p] for p in data.parts]
    tremble = _TREMBLE * max(noise_floor(all_of(x, where_finite(x))) for x in readings)
    band = 5e-3 * scaled.span
    shares = [rising_share(x, max(tremble, band)) for x in readings]
    share, rest = data.kept(joined(shares)), scaled.beside(fit)
    ways = sorted((np.count_nonzero(share > 0.9), np.count_nonzero(share < 0.1)))
    if ways[0] < 10:
        sweep = ways[1] > 0.9 * share.size and scaled.positions is None
        one_way = [_one_way()] if sweep and not ways[0] else []
        return _two_groups_notice(rest, scaled) or one_way
    if tremble > band:
        # of the reading before: one that is too high by chance both looks like rising and lies
        # beside the curve
        for x in shares:
            x[1:] = x[:-1].copy()
        share = data.kept(joined(shares))
    parts = contiguous_parts(data.sizes)
    columns = np.vstack([np.column_stack((jacobian(p), share[p] - 0.5)) for p in parts])
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    columns /= scale
    target = np.concatenate([rest[p] for p in parts])
    found = np.linalg.lstsq(columns, target, rcond=1e-10)[0]
    left = target - columns @ found
    cuts = np.cumsum([p.stop - p.start for p in parts])[:-1]
    spread = covariance(np.split(columns, cuts), np.split(left, cuts))
    error = float(np.sqrt(spread.covariance[-1, -1]))
    width = abs(float(found[-1]) / scale[-1])
    if not abs(found[-1]) > _APART * error or width < max(0.5 * spread.sigma, 0.5 * _MATTERS):
        return []
    text = (
        f"at one reading the position differs by {_mm(width, scaled)} between rising and falling "
        f"readings, while each direction scatters by {_mm(spread.sigma, scaled)}: one curve for "
        "both is off by half of that or more. Give --branches=two, or look for play in the "
        "coupling and for a delay between the two signals."
    )
    return [Notice("directions-differ", text)]
