"""Rational Bezier curves of one variable, and fitting them.

    y(t) = sum_i w_i B_i(t) P_i / sum_i w_i B_i(t),   B_i(t) = C(N, i) t^i (1 - t)^(N - i)

with ``t`` between 0 and 1 and positive weights: no poles, every value a mean of the control
points, and monotone when the control points are [1]_. Linear in the control points, so a
fit is variable projection with the logarithms of the weights as the nonlinear unknowns.
Only ratios of the weights matter; in fitting ``w_0 w_N = 1``, which treats both ends alike.

References
----------
.. [1] G. Farin, Curves and Surfaces for CAGD, 5th ed., 2002, chapter 13.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import comb
from typing import Any

import numpy as np
import numpy.typing as npt

from ...estimation.separable import Array, Basis, Problem, Search, Unknown, solve_from
from ...experiment import FloatArray

LOG_WEIGHT_LIMIT = float(np.log(50.0))

# ------------------------------------------------------------------------- the curve


def bernstein(t: npt.ArrayLike, degree: int) -> FloatArray:
    """Bernstein polynomials ``B_0 .. B_N``.

    Parameters
    ----------
    t : (...)
    degree
        ``N``.

    Returns
    -------
    (..., N + 1)
    """
    u = np.asarray(t, dtype=float)
    out = np.empty((*u.shape, degree + 1))
    rising, falling = np.ones_like(u), np.ones_like(u)
    for i in range(degree + 1):
        out[..., i] = comb(degree, i) * rising
        rising = rising * u
    for i in range(degree, -1, -1):
        out[..., i] *= falling
        falling = falling * (1.0 - u)
    return out


def rational_bezier(
    t: npt.ArrayLike, control_points: npt.ArrayLike, weights: npt.ArrayLike
) -> FloatArray:
    """Value of a rational Bezier curve.

    Parameters
    ----------
    t : (...)
        Clamped to 0..1.
    control_points, weights : (N + 1,)
        Weights are positive.

    Returns
    -------
    (...) [unit of the control points]
    """
    p, w = np.asarray(control_points, dtype=float), np.asarray(weights, dtype=float)
    b = bernstein(np.clip(t, 0.0, 1.0), p.size - 1) * w
    # taken from the first control point: a constant curve is exactly constant
    return np.asarray(p[0] + b @ (p - p[0]) / b.sum(axis=-1))


def rational_bezier_slope(
    t: npt.ArrayLike, control_points: npt.ArrayLike, weights: npt.ArrayLike
) -> FloatArray:
    """Derivative by ``t`` of a rational Bezier curve, arguments as for the curve.

    ``y' = sum_i w_i (P_i - y) B_i' / sum_i w_i B_i``.
    """
    p, w = np.asarray(control_points, dtype=float), np.asarray(weights, dtype=float)
    degree = p.size - 1
    u = np.clip(np.asarray(t, dtype=float), 0.0, 1.0)
    y = rational_bezier(u, p, w)
    lower = bernstein(u, degree - 1)
    zero = np.zeros((*u.shape, 1))
    slopes = degree * (np.concatenate((zero, lower), -1) - np.concatenate((lower, zero), -1))
    top = (w * (p - y[..., None]) * slopes).sum(axis=-1)
    return np.asarray(top / (bernstein(u, degree) @ w))


def invert_rational_bezier(
    values: npt.ArrayLike, control_points: npt.ArrayLike, weights: npt.ArrayLike
) -> FloatArray:
    """Find ``t`` with ``y(t) = value`` on a monotone curve.

    Bisection on ``sum_i w_i (P_i - y) B_i(t)``, numerator minus ``y`` times denominator,
    down to the spacing of floating point numbers.

    Parameters
    ----------
    values : (...)
        Values outside the curve give its nearest end.
    control_points, weights : (N + 1,)

    Returns
    -------
    (...) between 0 and 1.
    """
    p, w = np.asarray(control_points, dtype=float), np.asarray(weights, dtype=float)
    sign = 1.0 if p[-1] >= p[0] else -1.0
    y = np.asarray(values, dtype=float)
    gap = sign * w * (p - y[..., None])
    low, high = np.zeros_like(y), np.ones_like(y)
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = (bernstein(middle, p.size - 1) * gap).sum(axis=-1) < 0.0
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    middle = 0.5 * (low + high)
    at_start, at_end = gap[..., 0] >= 0.0, gap[..., -1] <= 0.0
    return np.asarray(np.where(at_start, 0.0, np.where(at_end, 1.0, middle)))


def is_monotone(control_points: npt.ArrayLike, weights: npt.ArrayLike) -> bool:
    """Whether a curve rises or falls all the way.

    Certain where the control points are in order; otherwise judged by its slope at 4001
    places.
    """
    p = np.asarray(control_points, dtype=float)
    steps = np.diff(p)
    if np.all(steps >= 0.0) or np.all(steps <= 0.0):
        return True
    slope = rational_bezier_slope(np.linspace(0.0, 1.0, 4001), p, weights)
    slope = slope if p[-1] >= p[0] else -slope
    return bool(slope.min() >= -1e-12 * np.abs(slope).max())


def power_coefficients(points: npt.ArrayLike) -> FloatArray:
    """Coefficients by ascending powers of ``t`` of ``sum_i c_i B_i(t)``, shape ``(N + 1,)``."""
    c = np.asarray(points, dtype=float)
    n = c.size - 1
    out = np.zeros(n + 1)
    for k in range(n + 1):
        out[k] = comb(n, k) * sum((-1) ** (k - i) * comb(k, i) * c[i] for i in range(k + 1))
    return out


def elevate(control_points: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the same curve with a degree of one more."""
    n = weights.size - 1
    part = np.arange(n + 2) / (n + 1)

    def raised(h: FloatArray) -> FloatArray:
        return np.asarray(part * np.append(0.0, h) + (1.0 - part) * np.append(h, 0.0))

    w = raised(weights)
    return raised(weights * control_points) / w, w


# ------------------------------------------------------------------------------- rows


@dataclass(frozen=True)
class Rows:
    """Data of a fit.

    Attributes
    ----------
    t, y : (n,)
        Position on the curve, and what was measured there.
    count : (n,)
        How many samples a row stands for.
    rising : (n,)
        Share of the rising branch: 1, 0, or between while the direction turns.
    """

    t: FloatArray
    y: FloatArray
    count: FloatArray
    rising: FloatArray

    def take(self, index: Any) -> Rows:
        """Return some of the rows."""
        return Rows(self.t[index], self.y[index], self.count[index], self.rising[index])


def group(values: FloatArray, step: float = 0.0) -> tuple[FloatArray, npt.NDArray[np.intp]]:
    """Distinct values in order, and which of them each value is.

    Parameters
    ----------
    values : (n,)
        Finite.
    step
        Distance of the codes of a converter, if known; counts need none. Codes are counted,
        everything else is sorted, which takes ten times longer.
    """
    low = float(values.min())
    for grid in (1.0, step):
        if grid <= 0.0 or float(np.ptp(values)) > 4e6 * grid:
            continue
        place = (values - low) / grid
        code = np.rint(place)
        if float(np.abs(place - code).max()) > 1e-6:
            continue
        key = code.astype(np.intp)
        count = np.bincount(key)
        there = np.flatnonzero(count)
        order = np.cumsum(count > 0) - 1
        first = np.empty(count.size)
        first[key] = values  # of codes apart by rounding any one will do
        return first[there], order[key]
    distinct, inverse = np.unique(values, return_inverse=True)
    return distinct, inverse


def merge(rows: Rows, places: FloatArray, key: npt.NDArray[np.intp]) -> Rows:
    """Rows at their distinct places: the same fit, as long as there is one branch."""
    count = np.asarray(np.bincount(key, rows.count, places.size), dtype=float)
    y = np.bincount(key, rows.y * rows.count, places.size) / np.where(count > 0.0, count, 1.0)
    there = count > 0.0
    return Rows(places[there], y[there], count[there], np.ones(int(there.sum())))


def compress(rows: Rows, limit: int) -> Rows:
    """Merge rows at equal positions, or of one narrow bin, into their means.

    Where the positions are those of a converter the fit is exactly the same. Otherwise
    the bins are ``1/limit`` wide and the curve is taken to be straight within them.
    """
    if rows.t.size <= limit:
        return rows
    few = np.unique(rows.t[:: max(rows.t.size // (8 * limit), 1)]).size <= limit
    key: npt.NDArray[np.int64] = np.minimum((rows.t * limit).astype(np.int64), limit - 1)
    if few:
        distinct, inverse = np.unique(rows.t, return_inverse=True)
        key = inverse if distinct.size <= limit else key
    turning = np.round(rows.rising * 4.0).astype(np.int64)
    key = key * 5 + turning
    _, key = group(key.astype(float))
    count = np.asarray(np.bincount(key, rows.count), dtype=float)

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(key, values * rows.count) / count)

    return Rows(mean(rows.t), mean(rows.y), count, mean(rows.rising))


# -------------------------------------------------------------------------------- fit


@dataclass(frozen=True)
class Shape:
    """What a curve may be.

    Attributes
    ----------
    degree
        ``N``.
    branches
        1, or 2 for a rising and a falling one.
    direction
        1 or -1 to keep the control points in that order, 0 for any.
    ends
        Values that the end control points are pinned to.
    rational
        Whether the weights are free (otherwise all are one: a polynomial).
    """

    degree: int
    branches: int = 1
    direction: int = 0
    ends: tuple[float, float] | None = None
    rational: bool = True

    @property
    def chained(self) -> int:
        """Number of control points placed by nonlinear fractions (pinned and in order)."""
        return self.degree - 1 if self.ends is not None and self.direction else 0

    @property
    def nonlinear(self) -> int:
        """Nonlinear unknowns of a branch."""
        return (self.degree if self.rational else 0) + self.chained

    @property
    def linear(self) -> int:
        """Linear unknowns of a branch."""
        if self.chained:
            return 0
        return self.degree - 1 if self.ends is not None else self.degree + 1

    @property
    def unknowns(self) -> int:
        """All unknowns."""
        return self.branches * (self.nonlinear + self.linear)

    def log_weights(self, own: Array) -> Array:
        """Logarithms of the weights of a branch from its nonlinear unknowns."""
        if not self.rational:
            return np.zeros(self.degree + 1)
        tilt = own[self.degree - 1]
        return np.concatenate(([-tilt], own[: self.degree - 1], [tilt]))

    def weight_unknowns(self, weights: FloatArray) -> FloatArray:
        """Inverse of `log_weights`, within the bounds."""
        log = np.log(weights)
        log = log - 0.5 * (log[0] + log[-1])
        return np.asarray(np.clip(log[1:], -LOG_WEIGHT_LIMIT, LOG_WEIGHT_LIMIT))

    def points(self, own: Array, ends: Array | None) -> tuple[Array, FloatArray]:
        """Offset and matrix that give the control points from the linear unknowns."""
        n = self.degree
        if ends is None:
            if not self.direction:
                return np.zeros(n + 1), np.eye(n + 1)
            steps = np.tril(np.ones((n + 1, n + 1))) * float(self.direction)
            steps[:, 0] = 1.0
            return np.zeros(n + 1), steps
        if not self.chained:
            offset = np.concatenate(([ends[0]], np.zeros(n - 1), [ends[1]]))
            return offset, np.eye(n + 1)[:, 1:n]
        chain = [ends[0]]
        for share in own[own.size - self.chained :]:
            chain.append(chain[-1] + share * (ends[1] - chain[-1]))
        return np.array([*chain, ends[1]]), np.zeros((n + 1, 0))

    def curves(self, eta: Array, linear: Array, ends: Array | None) -> list[tuple[Array, Array]]:
        """Control points and logarithms of the weights of each branch."""
        out = []
        for k in range(self.branches):
            own = eta[k * self.nonlinear : (k + 1) * self.nonlinear]
            offset, steps = self.points(own, ends)
            mine = linear[k * self.linear : (k + 1) * self.linear]
            out.append((offset + steps @ mine, self.log_weights(own)))
        return out

    def starts(self) -> list[FloatArray]:
        """Weights to start from: equal, one end heavy, the middle heavy or light."""
        if not self.rational:
            return [self._tile(np.zeros(0))]
        place = np.linspace(-1.0, 1.0, self.degree + 1)
        middle = 0.5 - place**2
        heavy = [0.0 * place, 1.2 * place, -1.2 * place, 1.2 * middle, -1.2 * middle]
        return [self._tile(self.weight_unknowns(np.exp(h))) for h in heavy]

    def start_at(self, curves: Sequence[tuple[FloatArray, FloatArray]]) -> FloatArray:
        """Start from control points and weights of a branch or two."""
        own = [self.weight_unknowns(w) if self.rational else np.zeros(0) for _, w in curves]
        if len(own) == 1:
            return self._tile(own[0])
        return np.concatenate([self._chain(o) for o in own])

    def _chain(self, own: FloatArray) -> FloatArray:
        return np.append(own, 1.0 / np.arange(self.chained + 1, 1, -1))

    def _tile(self, own: FloatArray) -> FloatArray:
        return np.tile(self._chain(own), self.branches)


class _CurveModel:
    """Columns of the curve for the solver."""

    def __init__(self, rows: Rows, shape: Shape) -> None:
        self.shape = shape
        self.bernstein = bernstein(rows.t, shape.degree)
        self.shares = _shares(rows.rising, shape.branches)
        self.ends = None if shape.ends is None else np.array(shape.ends)

    def basis(self, index: int, eta: Array) -> Basis:
        """Columns at given unknowns; there is one experiment only."""
        shape, n = self.shape, self.bernstein.shape[0]
        known: Array = np.zeros(n)
        columns = []
        for k, share in enumerate(self.shares):
            own = eta[k * shape.nonlinear : (k + 1) * shape.nonlinear]
            top = self.bernstein * np.exp(shape.log_weights(own))
            ratio = top / top.sum(axis=1)[:, None] * share
            offset, steps = shape.points(own, self.ends)
            known = known + ratio @ offset
            columns.append(ratio @ steps)
        return Basis(known, np.hstack(columns), np.zeros((n, 0)))


def _shares(rising: FloatArray, branches: int) -> list[FloatArray]:
    if branches == 1:
        return [np.ones((rising.size, 1))]
    return [rising[:, None], 1.0 - rising[:, None]]


@dataclass(frozen=True)
class CurveFit:
    """A fitted curve: ``curves`` holds control points and weights (first one is 1) per branch."""

    shape: Shape
    search: Search
    curves: list[tuple[FloatArray, FloatArray]] = field(default_factory=list)

    @property
    def cost(self) -> float:
        """Sum of squared residuals over the rows it was fitted to."""
        return self.search.best.cost

    @property
    def monotone(self) -> bool:
        """Whether every branch is monotone."""
        return all(is_monotone(p, w) for p, w in self.curves)

    def evaluate(self, t: FloatArray, rising: FloatArray) -> FloatArray:
        """Value of the curve, the branches blended by their share."""
        return blend([rational_bezier(t, p, w) for p, w in self.curves], rising)


def blend(values: Sequence[FloatArray], rising: npt.ArrayLike) -> FloatArray:
    """Blend a rising and a falling branch; a single one is returned as it is."""
    if len(values) == 1:
        return values[0]
    share = np.asarray(rising, dtype=float)
    return np.asarray(share * values[0] + (1.0 - share) * values[1])


def fit_shape(
    rows: Rows, shape: Shape, starts: Sequence[FloatArray], max_iterations: int = 80
) -> CurveFit:
    """Fit a curve of a given shape by variable projection."""
    limit = LOG_WEIGHT_LIMIT
    one = [Unknown(f"log_weight_{i}", -limit, limit) for i in range(shape.degree)]
    own = one if shape.rational else []
    own = [*own, *(Unknown(f"share_{i}", 0.0, 1.0) for i in range(shape.chained))]
    kept = shape.direction != 0 and shape.ends is None
    line = [Unknown(f"point_{i}", 0.0 if kept and i else -np.inf) for i in range(shape.linear)]
    problem = Problem(
        _CurveModel(rows, shape),
        [rows.y],
        own * shape.branches,
        line * shape.branches,
        [np.sqrt(rows.count)],
    )
    search = solve_from(problem, starts, max_iterations=max_iterations)
    ends = None if shape.ends is None else np.array(shape.ends)
    curves = shape.curves(search.best.eta, search.best.linear, ends)
    return CurveFit(shape, search, [(p, np.exp(lw - lw[0])) for p, lw in curves])


def fit_ladder(rows: Rows, shape: Shape) -> list[CurveFit]:
    """Fit every degree up to that of the shape, each also from the one before, elevated.

    More degrees then never fit worse.
    """
    fits: list[CurveFit] = []
    for degree in range(1, shape.degree + 1):
        now = replace(shape, degree=degree)
        starts = now.starts()
        if fits:
            starts.append(now.start_at([elevate(p, w) for p, w in fits[-1].curves]))
        fits.append(fit_shape(rows, now, starts))
    return fits


# ------------------------------------------------------------------- cross-validation


@dataclass(frozen=True)
class Score:
    """Cross-validated error of one degree: rms, and mean squares per fold."""

    degree: int
    rms: float
    squares: FloatArray


def cross_validate(rows: Rows, fits: Sequence[CurveFit]) -> list[Score]:
    """Predict contiguous stretches of the curve from the rest.

    The rows are cut into blocks in the order of ``t``; ten folds of them (fewer when the
    data are few) are left out one after the other. The two outermost blocks always stay
    in: the curve is never asked to extrapolate.
    """
    rows = rows.take(np.argsort(rows.t, kind="stable"))
    n = rows.t.size
    blocks = int(np.clip(n // 3, 4, 40))
    block = np.arange(n) * blocks // n
    folds = min(10, blocks - 2)
    fold = np.where((block == 0) | (block == blocks - 1), -1, (block - 1) % folds)
    out = []
    for fit in fits:
        start = [fit.shape.start_at(fit.curves)]
        squares = np.zeros(folds)
        for k in range(folds):
            rest, held = rows.take(fold != k), rows.take(fold == k)
            model = fit_shape(rest, fit.shape, start, 40)
            error = held.y - model.evaluate(held.t, held.rising)
            squares[k] = np.sum(held.count * error**2) / held.count.sum()
        out.append(Score(fit.shape.degree, float(np.sqrt(squares.mean())), squares))
    return out


def smallest_sufficient(scores: Sequence[Score], tolerance: float) -> int:
    """Smallest degree whose error is within one standard error of the best one's.

    The standard error is that of the mean over the folds; ``tolerance`` is a difference
    of mean squares that never matters.
    """
    best = min(scores, key=lambda s: s.rms)
    error = float(best.squares.std(ddof=1) / np.sqrt(best.squares.size))
    allowed = best.rms**2 + max(error, tolerance)
    return next(s.degree for s in scores if s.rms**2 <= allowed)


# -------------------------------------------------------------------------- derivatives


@dataclass(frozen=True)
class Coordinates:
    """Derivatives of control points and log weights by what was free in the fit.

    ``matrix`` has a row per control point and log weight ratio of every branch
    (``P_0..P_N, log w_0/w_0..log w_N/w_0``) and a column per free unknown; ``pinned`` the
    same with the two end values as columns, when they were pinned to measured values.
    """

    matrix: FloatArray
    pinned: FloatArray


def free_coordinates(fit: CurveFit) -> Coordinates:
    """Complex-step derivatives of the curve's numbers; unknowns on a bound count as fixed."""
    shape, best = fit.shape, fit.search.best
    ends = None if shape.ends is None else np.array(shape.ends, dtype=complex)
    step = 1e-30

    def numbers(eta: Array, linear: Array, at: Array | None) -> FloatArray:
        curves = shape.curves(eta, linear, at)
        flat = np.concatenate([np.concatenate((p, lw - lw[0])) for p, lw in curves])
        return np.asarray(np.imag(flat) / step)

    columns = []
    for j in np.flatnonzero(~best.active).tolist():
        moved = np.concatenate((best.eta, best.linear)).astype(complex)
        moved[j] += 1j * step
        columns.append(numbers(moved[: best.eta.size], moved[best.eta.size :], ends))
    pinned = []
    for j in range(0 if ends is None else 2):
        assert ends is not None
        at = ends.copy()
        at[j] += 1j * step
        pinned.append(numbers(best.eta.astype(complex), best.linear.astype(complex), at))
    size = 2 * (shape.degree + 1) * shape.branches
    return Coordinates(np.array(columns).reshape(-1, size).T, np.array(pinned).reshape(-1, size).T)


def curve_jacobian(fit: CurveFit, t: FloatArray, rising: FloatArray) -> FloatArray:
    """Derivative of the curve by control points and log weights, branch by branch.

    ``dy/dP_i = R_i`` and ``dy/d log w_i = R_i (P_i - y)`` with
    ``R_i = w_i B_i / sum_k w_k B_k``.
    """
    b = bernstein(t, fit.shape.degree)
    columns = []
    for (p, w), share in zip(fit.curves, _shares(rising, fit.shape.branches)):
        ratio = b * w
        ratio /= ratio.sum(axis=1)[:, None]
        y = ratio @ p
        columns += [ratio * share, ratio * (p - y[:, None]) * share]
    return np.hstack(columns)
