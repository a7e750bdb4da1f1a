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
from dataclasses import dataclass, replace
from math import comb
from typing import Any

import numpy as np
import numpy.typing as npt

from ...estimation.problem import Basis, Problem, Unknown
from ...estimation.separable import Search, solve_from
from ...experiment import Array, FloatArray
from ...rows import blocks
from .readings import group

LOG_WEIGHT_LIMIT = float(np.log(50.0))
_FEW = 24  # rows that are left out one by one
_COMPARED = 1e-2  # standard errors to which degrees are settled that are compared
_PREDICTED = 0.03  # standard errors to which a fit is settled that only predicts a fold

# ------------------------------------------------------------------------- the curve


def bernstein(t: npt.ArrayLike, degree: int) -> FloatArray:
    """Bernstein polynomials ``B_0 .. B_N`` at ``t`` (...), shape ``(..., N + 1)``.

    Each of them lies together in memory: work on the whole of one is several times as quick as on
    the few of one sample.
    """
    u = np.asarray(t, dtype=float)
    out = np.ones((degree + 1, u.size))
    rising, left = u.ravel(), 1.0 - u.ravel()
    falling = np.ones(u.size)
    for i in range(1, degree + 1):
        np.multiply(out[i - 1], rising, out=out[i])
    for i in range(degree - 1, -1, -1):
        falling *= left
        out[i] *= comb(degree, i) * falling
    return np.asarray(np.moveaxis(out.reshape(degree + 1, *u.shape), 0, -1))


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
    u = np.asarray(t, dtype=float)
    places, out = u.ravel(), np.empty(u.size)
    for at in blocks(u.size):  # the polynomials of a long record are many times as long
        b = bernstein(np.clip(places[at], 0.0, 1.0), p.size - 1)
        # taken from the first control point: a constant curve is exactly constant
        out[at] = p[0] + b @ (w * (p - p[0])) / (b @ w)
    return out.reshape(u.shape)


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
    slopes = -degree * np.diff(bernstein(u, degree - 1), prepend=0.0, append=0.0)
    top = (w * (p - y[..., None]) * slopes).sum(axis=-1)
    return np.asarray(top / (bernstein(u, degree) @ w))


def is_monotone(control_points: npt.ArrayLike, weights: npt.ArrayLike) -> bool:
    """Whether a curve rises or falls all the way.

    Certain where the control points are in order, otherwise judged by 4001 slopes.
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


def elevate(points: FloatArray) -> FloatArray:
    """Coefficients of the same ``sum_i c_i B_i(t)`` at a degree of one more."""
    share = np.arange(points.size + 1) / points.size
    return np.asarray(share * np.append(0.0, points) + (1.0 - share) * np.append(points, 0.0))


# ------------------------------------------------------------------------------- rows


@dataclass(frozen=True)
class Rows:
    """Data of a fit, all of shape ``(n,)``.

    ``t`` and ``y`` are a place on the curve and what was measured there, ``count`` says how many
    samples a row stands for, ``rising`` is the share of the rising branch: 1, 0, or between while
    the direction turns.
    """

    t: FloatArray
    y: FloatArray
    count: FloatArray
    rising: FloatArray

    def take(self, index: npt.NDArray[Any]) -> Rows:
        """Return some of the rows."""
        return Rows(self.t[index], self.y[index], self.count[index], self.rising[index])


def compress(rows: Rows, limit: int) -> Rows:
    """Merge rows at equal positions, or of one narrow bin, into their means.

    Where the positions are those of a converter the fit is exactly the same. Otherwise
    the bins are ``1/limit`` wide and the curve is taken to be straight within them.
    """
    if rows.t.size <= limit:
        return rows
    distinct = np.unique(rows.t[:: max(rows.t.size // (8 * limit), 1)])
    if distinct.size <= limit:
        distinct = group(np.asarray(rows.t))[0]
    sums = np.zeros((4, 5 * limit))
    for at in blocks(rows.t.size):
        t, count = rows.t[at], rows.count[at]
        if distinct.size <= limit:
            place = np.searchsorted(distinct, t)
        else:
            place = np.minimum((t * limit).astype(np.int64), limit - 1)
        key = place * 5 + np.round(rows.rising[at] * 4.0).astype(np.int64)
        weighted = count, t * count, rows.y[at] * count, rows.rising[at] * count
        for total, values in zip(sums, weighted, strict=True):
            total += np.bincount(key, values, minlength=total.size)
    count, *means = sums[:, sums[0] > 0.0]
    t, y, rising = (m / count for m in means)
    return Rows(t, y, count, rising)


# -------------------------------------------------------------------------------- fit


@dataclass(frozen=True)
class Shape:
    """What a curve may be.

    It has the ``degree`` and one or two ``branches``. ``direction`` keeps the control points in
    that order (1 or -1; 0 is any), ``ends`` pins the outer ones. Without ``rational`` all weights
    are one: a polynomial.
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
        if not self.rational:
            return np.zeros(0)
        log = np.log(weights)
        log = log - 0.5 * (log[0] + log[-1])
        return np.asarray(np.clip(log[1:], -LOG_WEIGHT_LIMIT, LOG_WEIGHT_LIMIT))

    def points(self, own: Array, ends: Array | None = None) -> tuple[Array, FloatArray]:
        """Offset and matrix that give the control points from the linear unknowns.

        ``own`` are the nonlinear unknowns of the branch, ``ends`` replace the pinned ones.
        """
        n = self.degree
        if self.ends is None:
            steps = np.eye(n + 1)
            if self.direction:
                steps = np.tril(np.ones((n + 1, n + 1))) * float(self.direction)
                steps[:, 0] = 1.0
            return np.zeros(n + 1), steps
        first, last = self.ends if ends is None else ends
        if not self.chained:
            return np.array([first, *np.zeros(n - 1), last]), np.eye(n + 1)[:, 1:n]
        chain = [first]
        for share in own[own.size - self.chained :]:
            chain.append(chain[-1] + share * (last - chain[-1]))
        return np.array([*chain, last]), np.zeros((n + 1, 0))

    def curves(
        self, eta: Array, linear: Array, ends: Array | None = None
    ) -> list[tuple[Array, Array]]:
        """Control points and logarithms of the weights of each branch."""
        out = []
        for own, mine in zip(np.split(eta, self.branches), np.split(linear, self.branches)):
            offset, steps = self.points(own, ends)
            out.append((offset + steps @ mine, self.log_weights(own)))
        return out

    def starts(self) -> list[FloatArray]:
        """Weights to start from: equal, one end heavy, the middle heavy or light."""
        place = np.linspace(-1.0, 1.0, self.degree + 1)
        middle = 0.5 - place**2
        heavy = [0.0 * place, 1.2 * place, -1.2 * place, 1.2 * middle, -1.2 * middle]
        return [self.start_at([np.exp(h)]) for h in (heavy if self.rational else heavy[:1])]

    def start_at(self, weights: Sequence[FloatArray]) -> FloatArray:
        """Start from the weights of each branch, or from one set of weights for all."""
        even = 1.0 / np.arange(self.chained + 1, 1, -1)
        own = [np.append(self.weight_unknowns(w), even) for w in weights]
        return np.concatenate(own * (self.branches // len(own)))


class _CurveModel:
    """Columns of the curve for the solver."""

    def __init__(self, rows: Rows, shape: Shape) -> None:
        self.shape = shape
        self.bernstein = bernstein(rows.t, shape.degree)
        self.shares = _shares(rows.rising, shape.branches)

    def basis(self, index: int, eta: Array) -> Basis:
        """Columns at given unknowns; there is one experiment only."""
        n = self.bernstein.shape[0]
        known: Array = np.zeros(n)
        columns = []
        for own, share in zip(np.split(eta, self.shape.branches), self.shares):
            top = self.bernstein * np.exp(self.shape.log_weights(own))
            ratio = top / top.sum(axis=1)[:, None] * share
            offset, steps = self.shape.points(own)
            known = known + ratio @ offset
            columns.append(ratio @ steps)
        return Basis(known, np.hstack(columns), np.zeros((n, 0)))


def _shares(rising: FloatArray, branches: int) -> list[FloatArray]:
    """Shares of the branches, shape ``(n, 1)`` each."""
    if branches == 1:
        return [np.ones((rising.size, 1))]
    return [rising[:, None], 1.0 - rising[:, None]]


@dataclass(frozen=True)
class CurveFit:
    """A fitted curve: ``curves`` holds control points and weights (first one is 1) per branch."""

    shape: Shape
    search: Search
    curves: list[tuple[FloatArray, FloatArray]]

    @property
    def weights(self) -> list[FloatArray]:
        """Weights of each branch."""
        return [w for _, w in self.curves]

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
    rows: Rows, shape: Shape, starts: Sequence[FloatArray], tolerance: float = 1e-5
) -> CurveFit:
    """Fit a curve of a given shape by variable projection; see :func:`.separable.solve`."""
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
    search = solve_from(problem, starts, max_iterations=80, tolerance=tolerance)
    curves = shape.curves(search.best.eta, search.best.linear)
    return CurveFit(shape, search, [(p, np.exp(lw - lw[0])) for p, lw in curves])


def fit_ladder(rows: Rows, shape: Shape) -> list[CurveFit]:
    """Fit every degree up to that of the shape, each also from the one before, elevated.

    More degrees then never fit worse. They are settled as far as a comparison of degrees needs.
    """
    fits: list[CurveFit] = []
    for degree in range(1, shape.degree + 1):
        now = replace(shape, degree=degree)
        starts = now.starts()
        if fits:
            starts.append(now.start_at([elevate(w) for w in fits[-1].weights]))
        fits.append(fit_shape(rows, now, starts, _COMPARED))
    return fits


# ------------------------------------------------------------------- cross-validation


@dataclass(frozen=True)
class Score:
    """Cross-validated error of one degree: the mean square of each fold."""

    degree: int
    squares: FloatArray

    @property
    def rms(self) -> float:
        """Root of the mean over the folds."""
        return float(np.sqrt(self.squares.mean()))

    @property
    def std_error(self) -> float:
        """Standard error of the mean square."""
        return float(self.squares.std(ddof=1) / np.sqrt(self.squares.size))


def cross_validate(
    rows: Rows, fits: Sequence[CurveFit], place: npt.NDArray[np.intp] | None = None
) -> list[Score]:
    """Predict contiguous stretches of the curve from the rest.

    The rows are cut into blocks in the order of ``t``, of few rows each is one; ``place``,
    where given, says which block each row belongs to. Ten folds of them (fewer when the
    data are few) are left out one after the other. The two outermost blocks always stay
    in: the curve is never asked to extrapolate.
    """
    n = rows.t.size
    if place is None:
        blocks = n if n <= _FEW else int(np.clip(n // 3, 4, 40))
        block = np.empty(n, dtype=np.intp)
        block[np.argsort(rows.t, kind="stable")] = np.arange(n) * blocks // n
    else:
        block, blocks = place, int(place.max()) + 1
    folds = min(10, blocks - 2)
    fold = np.where((block == 0) | (block == blocks - 1), -1, (block - 1) % folds)
    out = []
    for fit in fits:
        start = [fit.shape.start_at(fit.weights)]
        squares = np.zeros(folds)
        for k in range(folds):
            rest, held = rows.take(fold != k), rows.take(fold == k)
            model = fit_shape(rest, fit.shape, start, _PREDICTED)
            error = held.y - model.evaluate(held.t, held.rising)
            squares[k] = np.sum(held.count * error**2) / held.count.sum()
        out.append(Score(fit.shape.degree, squares))
    return out


def smallest_sufficient(scores: Sequence[Score]) -> int:
    """Smallest degree whose mean square is within one standard error of the best one's."""
    best = min(scores, key=lambda s: s.rms)
    allowed = best.rms**2 + max(best.std_error, 1e-18)  # what rounding leaves of exact data
    return next(s.degree for s in scores if s.rms**2 <= allowed)


# -------------------------------------------------------------------------- derivatives


def free_coordinates(fit: CurveFit) -> FloatArray:
    """Derivatives of control points and log weights by what was free in the fit.

    By complex steps; unknowns on a bound count as fixed. There is a row per control point and
    log weight ratio of every branch (``P_0..P_N, log w_0/w_0..log w_N/w_0``) and a column per
    free unknown, the two end values first where they were pinned to measured ones.
    """
    shape, best, step = fit.shape, fit.search.best, 1e-30
    at = np.concatenate((shape.ends or (), best.eta, best.linear)).astype(complex)
    pinned = at.size - best.active.size
    cuts = [pinned, pinned + best.eta.size]
    columns = []
    for j in (*range(pinned), *(pinned + np.flatnonzero(~best.active))):
        moved = at.copy()
        moved[j] += 1j * step
        ends, eta, linear = np.split(moved, cuts)
        curves = shape.curves(eta, linear, ends)
        flat = np.concatenate([np.concatenate((p, lw - lw[0])) for p, lw in curves])
        columns.append(np.imag(flat) / step)
    return np.array(columns).reshape(-1, 2 * (shape.degree + 1) * shape.branches).T


def curve_jacobian(fit: CurveFit, t: FloatArray, rising: FloatArray) -> FloatArray:
    """Derivative of the curve by control points and log weights, branch by branch.

    ``dy/dP_i = R_i`` and ``dy/d log w_i = R_i (P_i - y)`` with
    ``R_i = w_i B_i / sum_k w_k B_k``.
    """
    b = bernstein(t, fit.shape.degree).T
    m, branches = fit.shape.degree + 1, fit.shape.branches
    out = np.empty((2 * m * branches, b.shape[1]))  # every column together, as of `bernstein`
    for k, ((p, w), share) in enumerate(zip(fit.curves, _shares(rising, branches))):
        points, logs = out[2 * m * k : 2 * m * (k + 1)].reshape(2, m, -1)
        np.multiply(b, w[:, None], out=points)
        points /= points.sum(axis=0)
        np.subtract(p[:, None], p @ points, out=logs)
        logs *= points
        if branches > 1:
            points *= share[:, 0]
            logs *= share[:, 0]
    return out.T
