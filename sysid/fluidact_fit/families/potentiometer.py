"""Potentiometer calibration: position as a rational Bezier curve of the raw reading.

    t = (reading - low) / (high - low), clamped to 0..1
    y = sum_i w_i B_i(t) P_i / sum_i w_i B_i(t)

A worn, loaded or saturating potentiometer needs polynomials of high degree, which ripple;
a rational curve of low degree with positive weights bends sharply and cannot have poles
[1]_. Linear in the control points, so the fit is a variable projection over the weights.

References
----------
.. [1] "Bezier Calibration Method", IEEE Instrumentation & Measurement Magazine 26(1), 2023,
   p. 44: handle points and weights fitted to a reference, end points free or fixed.
.. [2] G. Farin, Curves and Surfaces for CAGD, 5th ed., 2002, chapter 13.
.. [3] T. Hastie, R. Tibshirani, J. Friedman, The Elements of Statistical Learning, 2nd ed.,
   2009, section 7.10: cross-validation and the one-standard-error rule.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import LogError, Notice, NotIdentifiedError, UsageError
from ..estimation.parametric import check_request
from ..estimation.rails import find_rails, leave_out_rails
from ..estimation.rational_bezier import (
    LOG_WEIGHT_LIMIT,
    CurveFit,
    Rows,
    Score,
    Shape,
    bernstein,
    blend,
    compress,
    cross_validate,
    curve_jacobian,
    fit_ladder,
    fit_shape,
    free_coordinates,
    group,
    invert_rational_bezier,
    is_monotone,
    merge,
    power_coefficients,
    rational_bezier,
    rational_bezier_slope,
    smallest_sufficient,
)
from ..estimation.uncertainty import Uncertainty, covariance, t_quantile
from ..experiment import Experiment, FloatArray, Hold
from ..family import (
    Block,
    Curve,
    Estimate,
    Family,
    Option,
    ParameterSpec,
    Quantity,
    Request,
    Role,
    StaticView,
    Value,
    Variant,
)

__all__ = ["Potentiometer", "PotentiometerBlock", "rational_bezier", "rising_share"]

BoolArray = npt.NDArray[np.bool_]
_COARSE, _FINE = 600, 4096  # rows that searches and the final fit work on
_MANY = 20_000  # rows that are worth merging
_LONG, _BLOCKS = 200_000, 8  # rows from which the colour of residuals is that of an excerpt
_SECOND = ("", "_falling")


# -------------------------------------------------------------------- direction of motion


def rising_share(reading: npt.ArrayLike, dead_band: float, state: float = 0.0) -> FloatArray:
    """Share of the rising branch while a reading moves.

    After a reversal the share moves linearly with the reading and has changed over
    completely once the reading has moved by the dead band; then it is held.

    Parameters
    ----------
    reading : (n,)
    dead_band
        [unit of the reading]
    state
        -1 (falling) to 1 (rising) at the first reading; 0 is not known.

    Returns
    -------
    (n,) between 0 (falling) and 1 (rising).
    """
    values = np.asarray(reading, dtype=float)
    if not values.size:
        return np.zeros(0)
    moved = np.empty(values.size)
    moved[0] = 0.0
    np.subtract(values[1:], values[:-1], out=moved[1:])
    if not np.all(np.isfinite(moved)):  # a reading that is missing moves nothing
        there = np.flatnonzero(np.isfinite(values))
        moved[:] = 0.0
        moved[there[1:]] = np.diff(values[there])
    moved *= 2.0 / max(dead_band, 1e-300)
    at = np.flatnonzero(moved)
    states = [state]
    for step in moved[at].tolist():
        state += step
        if state > 1.0:
            state = 1.0
        elif state < -1.0:
            state = -1.0
        states.append(state)
    # between two moves the share stays
    length = np.diff(np.concatenate(([0], at, [values.size])))
    return 0.5 + 0.5 * np.repeat(np.array(states), length)


# ------------------------------------------------------------------ what a controller runs


class PotentiometerBlock(Block):
    """A calibrated potentiometer: reading in, metres out.

    With two branches an array is a recording, its direction found from the start; a
    controller that gets one reading at a time calls `step`, which remembers the direction.
    ``direction`` (1 rising, -1 falling, 0 between) overrides both.
    """

    family = "potentiometer"

    def __init__(self, parameters: Mapping[str, Value]) -> None:
        self.parameters = dict(parameters)
        low, high = np.asarray(parameters["reading_range"], dtype=float)
        self._low, self._span = float(low), float(high - low)
        self._curves = _curves(parameters)
        self._dead_band = _scalar(parameters.get("hysteresis_dead_band"))
        self.reset()

    def reset(self) -> None:
        """Forget the direction of motion."""
        self._last, self._state = float("nan"), 0.0

    def __call__(
        self, reading: npt.ArrayLike, direction: npt.ArrayLike | None = None
    ) -> float | FloatArray:
        """Position of a reading or an array of readings [m]; clamped to the reading range."""
        values = np.asarray(reading, dtype=float)
        y = self._value(self._place(values), self._share(values, direction))
        return float(y) if y.ndim == 0 else y

    def step(self, reading: float) -> float:
        """Position of the next reading of a controller [m]."""
        if len(self._curves) > 1:
            pair = np.array([reading if np.isnan(self._last) else self._last, reading])
            share = rising_share(pair, self._dead_band, self._state)[-1]
            self._last, self._state = reading, float(2.0 * share - 1.0)
        return float(self._value(self._place(np.asarray(reading)), 0.5 + 0.5 * self._state))

    def sensitivity(
        self, reading: npt.ArrayLike, direction: npt.ArrayLike | None = None
    ) -> float | FloatArray:
        """Change of position per reading [m per unit of the reading]; 0 beyond the range."""
        values = np.asarray(reading, dtype=float)
        t = self._place(values)
        slopes = [rational_bezier_slope(t, p, w) for p, w in self._curves]
        inside = (t == (values - self._low) / self._span).astype(float)
        s = np.asarray(blend(slopes, self._share(values, direction)) * inside / self._span)
        return float(s) if s.ndim == 0 else s

    def inverse(
        self, metres: npt.ArrayLike, direction: float = 0.0, *, clamp: bool = False
    ) -> float | FloatArray:
        """Reading at a position, to the spacing of floating point numbers.

        Parameters
        ----------
        metres : scalar or (n,)
        direction
            With two branches: 1 rising, -1 falling, 0 the mean of both.
        clamp
            Take the end of the range for positions beyond it.

        Raises
        ------
        ValueError
            When a position is beyond the range (unless clamped) or the curve turns back,
            so that a position has several readings.
        """
        y = np.asarray(metres, dtype=float)
        if not all(is_monotone(p, w) for p, w in self._curves):
            raise ValueError(
                "the curve is not monotone: one position has several readings. "
                "Fit again with --monotone."
            )
        share = 0.5 + 0.5 * float(np.clip(direction, -1.0, 1.0))
        ends = [float(self._value(np.asarray(t), share)) for t in (0.0, 1.0)]
        slack = 1e-12 * abs(ends[1] - ends[0])
        outside = ~((y >= min(ends) - slack) & (y <= max(ends) + slack))
        if np.any(np.isnan(y)) or (np.any(outside) and not clamp):
            first = float(y[outside].flat[0])
            raise ValueError(
                f"{first:g} m is outside the calibrated range {min(ends):g} to {max(ends):g} m. "
                "Give clamp=True to take the end of the range."
            )
        x = np.asarray(self._low + self._span * self._invert(y, share))
        return float(x) if x.ndim == 0 else x

    def _place(self, values: FloatArray) -> FloatArray:
        return np.asarray(np.clip((values - self._low) / self._span, 0.0, 1.0))

    def _share(self, values: FloatArray, direction: npt.ArrayLike | None) -> FloatArray:
        if direction is not None:
            return np.asarray(0.5 + 0.5 * np.clip(direction, -1.0, 1.0))
        if len(self._curves) == 1 or values.ndim == 0:
            return np.asarray(0.5)
        return rising_share(values, self._dead_band)

    def _value(self, t: FloatArray, share: npt.ArrayLike) -> FloatArray:
        return blend([rational_bezier(t, p, w) for p, w in self._curves], share)

    def _invert(self, y: FloatArray, share: float) -> FloatArray:
        if len(self._curves) == 1:
            return invert_rational_bezier(y, *self._curves[0])
        sign = np.sign(self._curves[0][0][-1] - self._curves[0][0][0])
        low, high = np.zeros_like(y), np.ones_like(y)
        for _ in range(60):
            t = 0.5 * (low + high)
            below = sign * (self._value(t, share) - y) < 0.0
            low, high = np.where(below, t, low), np.where(below, high, t)
        return np.asarray(0.5 * (low + high))


def _curves(parameters: Mapping[str, Value]) -> list[tuple[FloatArray, FloatArray]]:
    """Control points and weights of each branch in a file."""
    return [
        (
            np.asarray(parameters[f"control_points{s}"], dtype=float),
            np.asarray(parameters[f"weights{s}"], dtype=float),
        )
        for s in _SECOND
        if f"control_points{s}" in parameters
    ]


def _scalar(value: Value | None) -> float:
    return float(value) if isinstance(value, (int, float)) else 0.0


# ------------------------------------------------------------------------------- the data


@dataclass(frozen=True)
class _Data:
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


def _gather(experiments: Sequence[Experiment]) -> _Data:
    reading = np.concatenate([e["reading"] for e in experiments])
    reference = np.concatenate([e["reference"] for e in experiments])
    ends = np.cumsum([e["reading"].size for e in experiments])
    parts = tuple(slice(int(b - e["reading"].size), int(b)) for e, b in zip(experiments, ends))
    used = np.isfinite(reading) & np.isfinite(reference)
    timed = all(e.time.size > 0 for e in experiments)
    first = experiments[0].signals["reading"]
    return _Data(reading, reference, parts, used, timed, first.unit, first.resolution)


# --------------------------------------------------------------------------- the options


def _degree_wanted(options: Mapping[str, Any]) -> int:
    """Degree as a number; 0 for ``auto``."""
    text = str(options.get("degree") or "auto").strip().lower()
    if text == "auto":
        return 0
    if text.isdigit() and 1 <= int(text) <= 8:
        return int(text)
    raise UsageError(
        f"--degree {text}: no such degree",
        expected="auto, or a whole number from 1 to 8.",
        remedy="Give --degree auto to have it chosen by cross-validation.",
    )


def _rails_wanted(options: Mapping[str, Any]) -> tuple[float, float] | None:
    given = options.get("rails")
    if given is None:
        return None
    if isinstance(given, str):
        given = [float(side) if side.strip() else None for side in given.split(":")]
    low, high = given
    return (-np.inf if low is None else float(low), np.inf if high is None else float(high))


# ------------------------------------------------------------------------ what was fitted


@dataclass(frozen=True)
class _Scaled:
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


def _scale(data: _Data, rising: FloatArray | None = None) -> _Scaled:
    """Scale the used samples; without a share of the rising branch there is one curve."""
    whole = bool(data.used.all())
    x = data.reading if whole else data.reading[data.used]
    y = data.reference if whole else data.reference[data.used]
    low, span, base, stroke = float(x.min()), float(np.ptp(x)), float(y.min()), float(np.ptp(y))
    one = np.ones(x.size)
    share = one if rising is None else rising[data.used]
    rows = Rows((x - low) / span, (y - base) / stroke, one, share)
    merged, key = rows, None
    if rising is None and x.size > _MANY:
        places, found = group(x, data.step)
        if 4 * places.size < x.size:
            key, merged = found, merge(rows, (places - low) / span, found)
    return _Scaled(rows, low, span, base, stroke, merged, key)


def _check_data(data: _Data) -> None:
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


def _samples(rows: Rows) -> int:
    """How many samples the rows stand for; one of little weight is one."""
    return int(np.maximum(rows.count, 1.0).sum())


def _check_enough(rows: Rows, shape: Shape) -> None:
    """Refuse a curve with more unknowns than the samples can determine."""
    samples, distinct = _samples(rows), int(np.unique(rows.t).size)
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


def _highest_degree(rows: Rows, branches: int) -> int:
    """Highest degree that automatic choice tries: a quarter of the data are unknowns at most."""
    distinct = int(np.unique(rows.t).size)
    return int(np.clip((min(distinct, _samples(rows) / branches) / 2.0 - 1.0) // 2.0, 1, 5))


def _search_degree(rows: Rows, shape: Shape, request: Request) -> tuple[CurveFit, list[Score]]:
    """Fit all degrees up to the one wanted; without one, choose by cross-validation.

    Each branch is searched by itself, on the samples that are wholly its own; all samples
    and both branches come together in the final fit.
    """
    highest = shape.degree or _highest_degree(rows, shape.branches)
    request.progress(f"fitting curves up to degree {highest}")
    alone = replace(shape, degree=highest, branches=1)
    branches = [rows] if shape.branches == 1 else _separate(rows)
    coarse = [compress(r, _COARSE) for r in branches]
    ladders = [fit_ladder(r, alone) for r in coarse]
    scores: list[Score] = []
    degree = shape.degree
    if not degree:
        if highest > 1 and min(r.t.size for r in coarse) >= 12:
            scores = _pool([cross_validate(r, f) for r, f in zip(coarse, ladders)])
        degree = smallest_sufficient(scores, 1e-18) if scores else 1
    found = [ladder[degree - 1] for ladder in ladders]
    if shape.branches == 1 and rows.t.size <= _COARSE:
        return found[0], scores
    final = replace(shape, degree=degree)
    start = final.start_at([f.curves[0] for f in found])
    # with two branches a bin holds up to five rows
    fit = fit_shape(compress(rows, _FINE // (4 if shape.branches > 1 else 1)), final, [start])
    first = found[0].search
    search = replace(fit.search, tried=first.tried, agreeing=first.agreeing)
    return replace(fit, search=search), scores


def _separate(rows: Rows) -> list[Rows]:
    """Samples wholly on the rising and wholly on the falling branch."""
    one = np.ones(rows.t.size)
    whole = [rows.rising >= 0.999, rows.rising <= 0.001]
    return [replace(rows.take(w), rising=one[w]) for w in whole]


def _pool(scores: Sequence[Sequence[Score]]) -> list[Score]:
    """Cross-validated errors of all branches together, degree by degree."""
    pooled = []
    for alike in zip(*scores):
        squares = np.concatenate([s.squares for s in alike])
        pooled.append(Score(alike[0].degree, float(np.sqrt(squares.mean())), squares))
    return pooled


def _excess_tail(worse: float, better: float, extra: int, free: int) -> float:
    """Probability of an F statistic as large as that of a restricted fit."""
    from scipy.special import fdtrc

    if worse <= better or free < 1:
        return 1.0
    return float(fdtrc(extra, free, (worse - better) / extra / max(better / free, 1e-28)))


def _make_monotone(
    scaled: _Scaled, fit: CurveFit, wanted: bool | None
) -> tuple[CurveFit, list[Notice]]:
    """Keep the curve from turning back unless the data say that it does."""
    if fit.monotone or wanted is False:
        return fit, []
    rows = scaled.merged
    direction = 1 if np.polynomial.Polynomial.fit(rows.t, rows.y, 1).convert().coef[-1] > 0 else -1
    shape = replace(fit.shape, direction=direction)
    starts = [shape.start_at(fit.curves), *shape.starts()]
    bounded = fit_shape(compress(rows, _FINE), shape, starts)
    free, kept = scaled.squares(fit), scaled.squares(bounded)
    n = _samples(rows) - fit.shape.unknowns
    resisted = _excess_tail(kept, free, fit.shape.degree * fit.shape.branches, n) < 1e-3
    ratio = np.sqrt(kept / max(free, 1e-300))
    if wanted:
        if not resisted:
            return bounded, []
        return bounded, [
            Notice(
                "not-monotone",
                f"the data resist --monotone: the residuals of the monotone curve are "
                f"{ratio:.3g} times those of the free one. Give --no-monotone, or another degree.",
            )
        ]
    if not resisted:
        return bounded, []
    return fit, [
        Notice(
            "not-monotone",
            f"the curve of degree {fit.shape.degree} turns back within the range, so a position "
            f"may have two readings; kept monotone its residuals would be {ratio:.3g} times as "
            "large. Try another --degree, or give --monotone.",
        )
    ]


# --------------------------------------------------------------------------- uncertainty


@dataclass(frozen=True)
class _Spread:
    """Covariance of all control points and log weights of the branches, scaled units."""

    covariance: FloatArray
    uncertainty: Uncertainty

    def std_error(self) -> FloatArray:
        """Standard errors in the same order."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))


def _spread(fit: CurveFit, scaled: _Scaled, data: _Data) -> _Spread:
    coordinates = free_coordinates(fit)
    matrix = coordinates.matrix
    rest = scaled.rows.y - scaled.evaluate(fit)
    if fit.shape.ends is None and rest.size > _LONG:
        uncertainty = _long_uncertainty(fit, matrix, scaled, data, rest)
    else:
        rows, root = scaled.rows, np.sqrt(scaled.rows.count)
        jacobian = _jacobian(fit, scaled, slice(None)) @ matrix * root[:, None]
        if fit.shape.ends is not None:
            by_ends = curve_jacobian(fit, rows.t, rows.rising) @ coordinates.pinned
            jacobian = _with_measured_ends(jacobian, by_ends * root[:, None], rows.t)
            matrix = np.hstack((coordinates.pinned, matrix))
        cuts = np.cumsum([p.size for p in data.kept(data.reading)])[:-1]
        uncertainty = covariance(
            np.split(jacobian, cuts), np.split(rest * root, cuts), robust=data.timed
        )
    if not np.all(np.isfinite(uncertainty.covariance)):
        raise NotIdentifiedError(
            "the data cannot determine control_points: the curve does not depend on some of them.",
            expected="Nothing was written.",
            remedy="Give a lower --degree, or record the whole range in both directions.",
        )
    return _Spread(matrix @ uncertainty.covariance @ matrix.T, uncertainty)


def _jacobian(fit: CurveFit, scaled: _Scaled, part: slice) -> FloatArray:
    """Derivative of the curve at some rows by all its numbers."""
    if scaled.key is None:
        return curve_jacobian(fit, scaled.rows.t[part], scaled.rows.rising[part])
    table = curve_jacobian(fit, scaled.merged.t, scaled.merged.rising)
    return np.asarray(np.take(table, scaled.key[part], axis=0))


def _long_uncertainty(
    fit: CurveFit, matrix: FloatArray, scaled: _Scaled, data: _Data, rest: FloatArray
) -> Uncertainty:
    """Covariance of a long record: its colour is that of contiguous parts of it.

    With ``B = J'J`` of all rows and ``C`` the covariance and ``E = J'J`` of the excerpt,
    ``F = E^1/2 C E^1/2`` says how much more than white noise of one unit the residuals let
    through in every direction; the covariance of all is ``B^-1/2 F B^-1/2``.
    """
    rows = scaled.merged if scaled.key is not None else compress(scaled.rows, _FINE)
    degrees = rest.size - matrix.shape[1]
    variance = float((scaled.rows.count * rest) @ rest) / degrees
    j = curve_jacobian(fit, rows.t, rows.rising) @ matrix
    scale = np.linalg.norm(j, axis=0)
    scale[scale == 0.0] = 1.0
    j = j / scale
    both = j.T @ (j * rows.count[:, None])
    inner, order = variance * np.eye(scale.size), 0
    if data.timed:
        parts = _excerpt([p.size for p in data.kept(data.reading)])
        columns = [_jacobian(fit, scaled, p) @ matrix / scale for p in parts]
        found = covariance(columns, [rest[p] for p in parts])
        stacked = np.vstack(columns)
        part = stacked.T @ stacked
        if found.order and np.all(np.isfinite(found.covariance)):
            order = found.order
            root = _power(part, 0.5)
            inner = root @ found.covariance @ root * (variance / found.sigma**2)
    half = _power(both, -0.5)
    total = half @ inner @ half / np.outer(scale, scale)
    return Uncertainty(0.5 * (total + total.T), degrees, float(np.sqrt(variance)), order)


def _excerpt(sizes: Sequence[int]) -> list[slice]:
    """Contiguous parts of the logs, spread over all of them."""
    ends = np.cumsum(sizes)
    length = _LONG // 4 // _BLOCKS
    out = []
    for k in np.linspace(0, int(ends[-1]) - length, _BLOCKS).astype(int).tolist():
        log_end = int(ends[np.searchsorted(ends, k, side="right")])
        out.append(slice(k, min(k + length, log_end)))
    return [p for p in out if p.stop - p.start > 200]


def _power(matrix: FloatArray, exponent: float) -> FloatArray:
    """Symmetric power of a positive matrix; nothing in directions without any data."""
    values, vectors = np.linalg.eigh(matrix)
    floor = 1e-24 * float(values.max())
    with np.errstate(divide="ignore"):
        powers = np.where(values > floor, np.maximum(values, floor) ** exponent, 0.0)
    return np.asarray((vectors * powers) @ vectors.T)


def _with_measured_ends(jacobian: FloatArray, by_ends: FloatArray, t: FloatArray) -> FloatArray:
    """Jacobian of an ordinary fit with the covariance of one whose ends are measured means.

    The estimate is ``G e`` with the errors ``e``: the ends are means of some rows, the rest
    follows from them and from all rows. ``pinv(G)`` is a Jacobian whose least-squares
    estimate is ``G e``.
    """
    means = np.array([(t == end) / max(np.count_nonzero(t == end), 1) for end in (0.0, 1.0)])
    gains = np.linalg.pinv(jacobian) if jacobian.shape[1] else np.zeros((0, t.size))
    gains = np.vstack((means, gains - (gains @ by_ends) @ means))
    return np.asarray(np.linalg.pinv(gains))


def _drop_weights(scaled: _Scaled, fit: CurveFit, spread: _Spread) -> tuple[CurveFit, list[Notice]]:
    """Replace weights that the data say nothing about by ones.

    Every straight line, for one, is a curve of degree two with any of a family of weights.
    """
    half = t_quantile(0.975, spread.uncertainty.degrees) * spread.std_error()
    n = fit.shape.degree + 1
    unsure = [half[2 * n * k + n + i] for k in range(fit.shape.branches) for i in range(n)]
    if not fit.shape.rational or max(unsure) <= LOG_WEIGHT_LIMIT:
        return fit, []
    rows = scaled.merged
    shape = replace(fit.shape, rational=False)
    plain = fit_shape(compress(rows, _FINE), shape, shape.starts()[:1])
    extra = fit.shape.degree * fit.shape.branches
    tail = _excess_tail(
        scaled.squares(plain), scaled.squares(fit), extra, _samples(rows) - fit.shape.unknowns
    )
    lower = f"Give a --degree below {fit.shape.degree}, or --degree auto. "
    advice = lower if fit.shape.degree > 1 else ""
    if tail < 0.05:
        return fit, [
            Notice(
                "degree-too-high",
                "some weights are hardly determined: their 95 % intervals span more than a "
                f"factor of 50 either way. {advice}".rstrip(),
            )
        ]
    return plain, [
        Notice(
            "not-identified",
            "weights cannot be determined from these data: a polynomial describes them as well. "
            f"They are written as 1, status not_identified. {advice}A record of more samples "
            "over the whole range, the ends included, would determine them.",
        )
    ]


def _bound_notice(fit: CurveFit) -> list[Notice]:
    names = [
        f"log_weight of control point {i + 1}{' (falling)' if k else ''}"
        for k in range(fit.shape.branches)
        for i in range(fit.shape.degree if fit.shape.rational else 0)
        if fit.search.best.active[k * fit.shape.nonlinear + i]
    ]
    if not names:
        return []
    return [
        Notice(
            "weight-at-bound",
            f"{len(names)} of the weights rest on the bound of 50 that keeps the curve from "
            f"bending too sharply ({', '.join(names)}); their intervals do not count. "
            + ("Give another --degree." if fit.shape.degree > 1 else "Give --degree 2 or more."),
        )
    ]


# ----------------------------------------------------------------------------- the family


class Potentiometer(Family):
    """Rational Bezier calibration of a potentiometer."""

    name = "potentiometer"
    title = "Potentiometer: rational Bezier calibration of position from the raw reading"
    equation = (
        "reference = sum(weights[i] B_i(t) control_points[i]) / sum(weights[i] B_i(t)), "
        "t = (reading - reading_range[0]) / (reading_range[1] - reading_range[0])"
    )
    variants = (
        Variant(
            "potentiometer",
            (
                Role("reading", "1", "raw reading, in counts or volts"),
                Role("reference", "m", "true position, by laser or caliper", output=True),
                Role("time", "s", "time of each sample", required=False),
            ),
            (
                ParameterSpec(
                    "control_points", "m", "control points of the curve", rank=1,
                    remedy="Record more positions, spread over the whole range.",
                ),
                ParameterSpec(
                    "weights", "1", "weights of the control points, the first is 1",
                    minimum=1e-9, rank=1, neutral=1.0,
                    remedy="Record more positions, spread over the whole range.",
                ),
                ParameterSpec(
                    "reading_range", "1", "lowest and highest reading of the calibration",
                    rank=1, length=2, any_unit=True,
                ),
                ParameterSpec(
                    "control_points_falling", "m",
                    "control points of the falling branch (then the others are the rising one)",
                    rank=1, optional=True,
                ),
                ParameterSpec(
                    "weights_falling", "1", "weights of the falling branch, the first is 1",
                    minimum=1e-9, rank=1, neutral=1.0, optional=True,
                ),
                ParameterSpec(
                    "hysteresis_dead_band", "1",
                    "change of the reading after a reversal over which the branches change over",
                    minimum=0.0, optional=True, any_unit=True,
                ),
            ),
        ),
    )  # fmt: skip
    options = (
        Option("degree", "text", "degree of the curve, 1 to 8, or auto for cross-validation",
               default="auto"),
        Option("endpoints", "choice", "free, or fixed at the mean reference of the end readings",
               default="free", choices=("free", "fixed")),
        Option("branches", "choice", "one curve for both directions of motion, or one for each",
               default="pooled", choices=("pooled", "two")),
        Option("monotone", "flag", "keep the curve from turning back (default: unless the data "
               "say that it does)"),
        Option("rails", "range", "readings at or beyond these are clipped and left out"),
    )  # fmt: skip

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request
    ) -> Estimate:
        """Fit the curve; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        options = request.options
        data, notices = self._prepare(experiments, _rails_wanted(options))
        two = options.get("branches") == "two"
        band = self._dead_band(data, request) if two else 0.0
        scaled = _scale(data, _rising(data, band) if two else None)
        if two:
            _check_both_directions(scaled.rows)
        ends = _ends(scaled.merged) if options.get("endpoints") == "fixed" else None
        shape = Shape(_degree_wanted(options), 2 if two else 1, 0, ends)
        _check_enough(scaled.merged, shape if shape.degree else replace(shape, degree=1))
        scaled = _weigh_suspects(scaled, data, shape, request)
        fit, scores = _search_degree(scaled.merged, shape, request)
        fit, turned = _make_monotone(scaled, fit, options.get("monotone"))
        spread = _spread(fit, scaled, data)
        chosen, unsure = _drop_weights(scaled, fit, spread)
        if chosen is not fit:
            fit, turned = _make_monotone(scaled, chosen, options.get("monotone"))
            spread = _spread(fit, scaled, data)
        notices += [*turned, *unsure, *_bound_notice(fit)]
        parameters, order, matrix = _quantities(fit, spread, scaled)
        parameters["reading_range"] = Quantity(
            [scaled.low, scaled.low + scaled.span], data.unit, "derived"
        )
        if two:
            given = "hysteresis_dead_band" in request.fixed
            parameters["hysteresis_dead_band"] = Quantity(
                band, data.unit, "fixed" if given else "derived"
            )
        values = {k: q.value for k, q in parameters.items()}
        measured = np.where(data.used, data.reference, np.nan)
        return Estimate(
            {s.name: parameters[s.name] for s in variant.parameters if s.name in parameters},
            _derived(fit, spread, scaled),
            order,
            matrix,
            data.split(_simulate_all(data, values, two)),
            data.split(measured),
            notices,
            _details(fit, spread, scores, scaled),
        )

    @staticmethod
    def _prepare(
        experiments: Sequence[Experiment], rails: tuple[float, float] | None
    ) -> tuple[_Data, list[Notice]]:
        """All samples, and which of them can be used."""
        data = _gather(experiments)
        _check_data(data)
        if rails is None:
            used, suspects, notices = find_rails(data.reading, data.reference, data.used, data.step)
            data = replace(data, suspects=tuple(suspects))
        else:
            used, notices = leave_out_rails(data.reading, data.reference, data.used, *rails)
        data = replace(data, used=used)
        _check_data(data)
        return data, notices

    @staticmethod
    def _dead_band(data: _Data, request: Request) -> float:
        """Dead band that describes the data best [unit of the reading].

        The branches are taken to be polynomials of the pooled curve, nearly straight ones.
        """
        if "hysteresis_dead_band" in request.fixed:
            return float(request.fixed["hysteresis_dead_band"])
        scaled = _scale(data)
        shape = Shape(min(4, _highest_degree(scaled.merged, 1)))
        pooled = fit_shape(compress(scaled.merged, _COARSE), shape, shape.starts()[:1])
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

    def simulate(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> FloatArray:
        """Position from the readings; see :meth:`Family.simulate`."""
        return np.asarray(PotentiometerBlock(parameters)(experiment["reading"]))

    def model_section(
        self, variant: Variant, parameters: Mapping[str, Value], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """The curve, also as a ratio of polynomials by ascending powers of ``t``."""
        curves = _curves(parameters)
        section: dict[str, Any] = {
            "type": "rational-bezier",
            "degree": int(curves[0][0].size - 1),
            "monotone": all(is_monotone(p, w) for p, w in curves),
        }
        for branch, (p, w) in zip(("rising", "falling") if len(curves) > 1 else ("",), curves):
            ratio = {
                "ascending_numerator": power_coefficients(w * p).tolist(),
                "ascending_denominator": power_coefficients(w).tolist(),
            }
            section.update({branch: ratio} if branch else ratio)
        return {"curve": section}

    def static_view(
        self,
        variant: Variant,
        estimate: Estimate,
        experiments: Sequence[Experiment],
        options: Mapping[str, Any],
    ) -> StaticView:
        """Position over reading: the curve or both branches, and the control points."""
        data = _gather(experiments)
        values = {n: q.value for n, q in estimate.parameters.items()}
        low, high = np.asarray(values["reading_range"], dtype=float)
        t = np.linspace(0.0, 1.0, 500)
        branches = _curves(values)
        names = ("rising", "falling") if len(branches) > 1 else ("fitted curve",)
        points = branches[0][0]
        return StaticView(
            "reading", data.unit, "reference", "m",
            data.reading, data.reference, np.concatenate(list(estimate.simulated)),
            np.isfinite(np.concatenate(list(estimate.measured))),
            [
                Curve(name, low + (high - low) * t, rational_bezier(t, p, w))
                for name, (p, w) in zip(names, branches)
            ],
            # where their pull is strongest when all weights are equal
            Curve("control points", np.linspace(low, high, points.size), points)
            if len(branches) == 1
            else None,
        )  # fmt: skip

    def block(self, variant: Variant, document: Mapping[str, Any]) -> PotentiometerBlock:
        """Return the calibration that a controller calls."""
        return PotentiometerBlock({k: v["value"] for k, v in document["parameters"].items()})


def _rising(data: _Data, dead_band: float) -> FloatArray:
    return np.concatenate([rising_share(data.reading[p], dead_band) for p in data.parts])


def _simulate_all(data: _Data, values: Mapping[str, Value], two: bool) -> FloatArray:
    """Position of every reading, log by log where the direction counts."""
    block = PotentiometerBlock(values)
    if two:
        return np.concatenate([np.asarray(block(x)) for x in data.split(data.reading)])
    if data.reading.size > _MANY and np.all(np.isfinite(data.reading)):
        places, key = group(data.reading, data.step)
        return np.asarray(np.asarray(block(places))[key])
    return np.asarray(block(data.reading))


def _weigh_suspects(scaled: _Scaled, data: _Data, shape: Shape, request: Request) -> _Scaled:
    """Bound the pull of lone extremes that look clipped.

    They stay in, but a clipped reading far off the course of all others must not buy a
    degree or bend the end of the curve: its weight is ``1 / (1 + (r / 3 s)^2)`` with its
    distance ``r`` from the curve of the others and their scatter ``s``.
    """
    if not data.suspects or shape.branches > 1 or scaled.key is not None:
        return scaled
    rows = scaled.rows
    suspect = np.isin(data.reading[data.used], data.suspects)
    others = rows.take(~suspect)
    if _samples(others) < shape.unknowns + 4 or np.unique(others.t).size < 6:
        return scaled
    fit, _ = _search_degree(others, replace(shape, ends=None), request)
    rest = rows.y - fit.evaluate(rows.t, rows.rising)
    free = max(others.t.size - fit.shape.unknowns, 1)
    scatter = np.sqrt(float(rest[~suspect] @ rest[~suspect]) / free)
    share = rest / max(3.0 * scatter, 1e-300)
    weighted = replace(rows, count=np.where(suspect, 1.0 / (1.0 + share**2), 1.0))
    return replace(scaled, rows=weighted, merged=weighted)


def _check_both_directions(rows: Rows) -> None:
    for name, share in (("rising", rows.rising), ("falling", 1.0 - rows.rising)):
        there = share >= 0.999
        if np.count_nonzero(there) < 5 or np.ptp(rows.t[there]) < 0.5:
            raise NotIdentifiedError(
                f"the data cannot determine the {name} branch: the reading hardly moves that way.",
                expected="Readings over at least half of the range in both directions.",
                remedy="Record a stroke there and back, or give --branches pooled.",
            )


def _ends(rows: Rows) -> tuple[float, float]:
    """Mean reference of the extreme readings."""
    return float(rows.y[rows.t == 0.0].mean()), float(rows.y[rows.t == 1.0].mean())


# ------------------------------------------------------------------------------- results


def _quantities(
    fit: CurveFit, spread: _Spread, scaled: _Scaled
) -> tuple[dict[str, Quantity], tuple[str, ...], FloatArray]:
    """Parameters of all branches, and the covariance of those that were estimated.

    Weights are positive: their intervals are made of their logarithms.
    """
    quantile = t_quantile(0.975, spread.uncertainty.degrees)
    error = spread.std_error()
    out: dict[str, Quantity] = {}
    names: list[str] = []
    factors: list[FloatArray] = []
    n = fit.shape.degree + 1
    for k, (p, w) in enumerate(fit.curves):
        points, logs = error[2 * n * k :][:n] * scaled.stroke, error[2 * n * k + n :][:n]
        value = scaled.base + scaled.stroke * p
        half = quantile * points
        out[f"control_points{_SECOND[k]}"] = Quantity(
            value.tolist(), "m", "estimated", points.tolist(),
            np.column_stack((value - half, value + half)).tolist(), "wald",
        )  # fmt: skip
        out[f"weights{_SECOND[k]}"] = _weights(w, logs, quantile, fit.shape.rational)
        names += [f"control_points{_SECOND[k]}[{i}]" for i in range(n)]
        names += [f"weights{_SECOND[k]}[{i}]" for i in range(n)]
        factors += [np.full(n, scaled.stroke), w]
    scale = np.concatenate(factors)
    matrix = spread.covariance * np.outer(scale, scale)
    kept = np.flatnonzero(np.diag(spread.covariance) > 0.0)
    return out, tuple(names[i] for i in kept), matrix[np.ix_(kept, kept)]


def _weights(w: FloatArray, error: FloatArray, quantile: float, rational: bool) -> Quantity:
    if not rational:
        return Quantity(w.tolist(), "1", "not_identified")
    limit = 2.0 * LOG_WEIGHT_LIMIT + 1e-9
    low = np.exp(np.clip(np.log(w) - quantile * error, -limit, limit))
    high = np.exp(np.clip(np.log(w) + quantile * error, -limit, limit))
    bounds = np.column_stack((np.minimum(low, w), np.maximum(high, w)))
    return Quantity(w.tolist(), "1", "estimated", (w * error).tolist(), bounds.tolist(), "wald-log")


def _derived(fit: CurveFit, spread: _Spread, scaled: _Scaled) -> dict[str, Quantity]:
    """Stroke between the extreme readings, and the width of the hysteresis."""
    n = fit.shape.degree
    p = fit.curves[0][0]
    c = spread.covariance
    error = float(np.sqrt(max(c[0, 0] + c[n, n] - 2.0 * c[0, n], 0.0)))
    stroke = abs(float(p[-1] - p[0])) * scaled.stroke
    out = {"stroke": Quantity(stroke, "m", "derived", error * scaled.stroke)}
    if fit.shape.branches == 2:
        t = np.linspace(0.0, 1.0, 1001)
        rise, fall = (rational_bezier(t, points, w) for points, w in fit.curves)
        width = float(np.mean(np.abs(rise - fall))) * scaled.stroke
        out["hysteresis"] = Quantity(width, "m", "derived")
    return out


def _details(
    fit: CurveFit, spread: _Spread, scores: Sequence[Score], scaled: _Scaled
) -> dict[str, Any]:
    order = spread.uncertainty.order
    details: dict[str, Any] = {
        "method": "variable projection",
        "degree": fit.shape.degree,
        "degree_chosen_by": "cross-validation" if scores else "user or number of samples",
        "monotone": fit.monotone,
        "monotone_constraint": bool(fit.shape.direction),
        "starts": {
            "tried": fit.search.tried,
            "agreeing": fit.search.agreeing,
            "rivals": len(fit.search.rivals),
        },
        "iterations": fit.search.best.iterations,
        "converged": fit.search.best.converged,
        "residual_std": spread.uncertainty.sigma * scaled.stroke,
        "covariance": "white" if order == 0 else f"autoregressive residuals of order {order}",
    }
    if scores:
        details["cross_validation"] = [
            {
                "degree": s.degree,
                "rms": s.rms * scaled.stroke,
                "mean_square_std_error": float(
                    s.squares.std(ddof=1) / np.sqrt(s.squares.size) * scaled.stroke**2
                ),
            }
            for s in scores
        ]
    return details
