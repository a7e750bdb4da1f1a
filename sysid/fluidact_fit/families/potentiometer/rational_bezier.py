"""Rational Bezier curves of one variable, and what a fit knows them by.

    y(t) = sum_i w_i B_i(t) P_i / sum_i w_i B_i(t),   B_i(t) = C(N, i) t^i (1 - t)^(N - i)

with ``t`` between 0 and 1 and positive weights: no poles, every value a mean of the control
points, and monotone when the control points are [1]_.

References
----------
.. [1] G. Farin, Curves and Surfaces for CAGD, 5th ed., 2002, chapter 13.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np
import numpy.typing as npt

from ...estimation.map import MapRows
from ...experiment import BoolArray, FloatArray
from ...rows import blocks

LOG_WEIGHT_LIMIT = float(np.log(50.0))  # keeps a curve from bending too sharply

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
    """Return whether a curve rises or falls all the way.

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
    return np.array([comb(c.size - 1, k) * np.diff(c, k)[0] for k in range(c.size)])


def express(points: FloatArray, degree: int, low: float = 0.0, high: float = 1.0) -> FloatArray:
    """Coefficients ``(degree + 1,)`` of the same ``sum_i c_i B_i(t)``, at no lower a degree.

    With other ends they are those where ``t`` runs from ``low`` to ``high``.
    """
    place = np.linspace(0.0, 1.0, degree + 1)
    values = bernstein(low + (high - low) * place, points.size - 1) @ points
    return np.asarray(np.linalg.solve(bernstein(place, degree), values))


def blend(values: Sequence[FloatArray], rising: npt.ArrayLike) -> FloatArray:
    """Blend a rising and a falling branch; a single one is returned as it is."""
    if len(values) == 1:
        return values[0]
    share = np.asarray(rising, dtype=float)
    return np.asarray(share * values[0] + (1.0 - share) * values[1])


# ------------------------------------------------------------------------ what is fitted


@dataclass(frozen=True)
class BezierModel:
    """One or two branches of a degree as a map of place and share of the rising branch.

    Unknowns of a branch are its control points and the logarithms of its weights. Only ratios of
    weights matter: ``w_0 w_N = 1`` treats both ends alike. A ``direction`` of 1 or -1 keeps the
    control points in that order: the first one and steps of that sign are the unknowns then.
    Without ``rational`` all weights are one, a polynomial.
    """

    degree: int
    branches: int = 1
    direction: int = 0
    rational: bool = True

    @property
    def unknowns(self) -> int:
        """Number of unknowns of all branches."""
        return self.branches * (self.degree + 1 + (self.degree if self.rational else 0))

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Steps of a monotone curve have one sign, weights are limited."""
        least, limit = 0.0 if self.direction else -np.inf, LOG_WEIGHT_LIMIT
        n, weights = self.degree, self.degree if self.rational else 0
        low, high = [-np.inf, *[least] * n, *[-limit] * weights], [np.inf] * (n + 1)
        return np.tile(low, self.branches), np.tile([*high, *[limit] * weights], self.branches)

    @cached_property
    def linear(self) -> BoolArray:
        """The control points, unless they are kept in order."""
        own = np.arange(self.unknowns // self.branches) <= self.degree
        return np.tile(own & (self.direction == 0), self.branches)

    @cached_property
    def expansion(self) -> FloatArray:
        """Control points and ``log w_i / w_0`` of a branch per unknown, ``(2 (N + 1), q)``."""
        n = self.degree
        out = np.zeros((2 * (n + 1), self.unknowns // self.branches))
        out[: n + 1, : n + 1] = np.eye(n + 1)
        if self.direction:
            out[: n + 1, : n + 1] = self.direction * np.tril(np.ones((n + 1, n + 1)))
            out[: n + 1, 0] = 1.0
        if self.rational:  # the last unknown tilts both ends
            out[n + 2 :, n + 1 :] = np.eye(n)
            out[n + 2 :, -1] += 1.0
        return out

    def curves(self, theta: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
        """Control points and weights, the first one 1, of every branch."""
        each = (np.split(self.expansion @ own, 2) for own in np.split(theta, self.branches))
        return [(points, np.exp(logs)) for points, logs in each]

    def value(self, theta: FloatArray, x: FloatArray) -> FloatArray:
        """The curve, its branches blended by their share."""
        return blend([rational_bezier(x[:, 0], p, w) for p, w in self.curves(theta)], x[:, 1])

    def slopes(self, theta: FloatArray, x: FloatArray) -> FloatArray:
        """Derivatives by the unknowns, through control points and log weights.

        ``dy/dP_i = R_i`` and ``dy/d log w_i = R_i (P_i - y)`` with
        ``R_i = w_i B_i / sum_k w_k B_k``.
        """
        curves, out = self.curves(theta), np.empty((self.unknowns, len(x)))
        for at in blocks(len(x)):
            b, share = bernstein(x[at, 0], self.degree), x[at, 1]
            shares = [np.ones(1)] if self.branches == 1 else [share, 1.0 - share]
            for own, (p, w), share in zip(np.split(out, self.branches), curves, shares):
                ratio = b * w
                ratio /= ratio.sum(axis=1)[:, None]
                logs = ratio * (p - (ratio @ p)[:, None])
                own[:, at] = (np.hstack((ratio, logs)) @ self.expansion).T * share
        return out.T

    def start(self, rows: MapRows, weights: Sequence[FloatArray]) -> FloatArray:
        """Unknowns with given weights of the branches; the control points that fit best."""
        table = np.zeros((self.branches, self.expansion.shape[1]))
        points = np.tile(np.arange(table.shape[1]) <= self.degree, self.branches)
        if self.rational:
            logs = np.log(weights)
            logs -= 0.5 * (logs[:, :1] + logs[:, -1:])
            table[:, self.degree + 1 :] = logs[:, 1:]
        theta, root = np.clip(table.ravel(), *self.bounds), np.sqrt(rows.count)
        columns = self.slopes(theta, rows.x)[:, points] * root[:, None]
        theta[points] = np.linalg.lstsq(columns, rows.y * root, rcond=None)[0]
        return np.clip(theta, *self.bounds)

    def starts(self, rows: MapRows) -> list[FloatArray]:
        """Weights to start from: equal, one end heavy, the middle heavy or light."""
        place = np.linspace(-1.0, 1.0, self.degree + 1)
        middle = 0.5 - place**2
        heavy = [0.0 * place, 1.2 * place, -1.2 * place, 1.2 * middle, -1.2 * middle]
        kinds = heavy if self.rational else heavy[:1]
        return [self.start(rows, [np.exp(h)] * self.branches) for h in kinds]
