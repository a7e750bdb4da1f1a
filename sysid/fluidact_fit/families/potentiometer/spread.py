"""Covariance of the curve's numbers, also of long records and of measured ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...errors import NotIdentifiedError
from ...estimation.uncertainty import Uncertainty, covariance
from ...experiment import FloatArray
from ...rows import blocks, by_rows, is_long, may_keep_aside
from .data import FINE, LONG, Data, Scaled, contiguous_parts
from .misfit import Misfit, widen
from .rational_bezier import CurveFit, Rows, compress, curve_jacobian, free_coordinates


def find_spread(
    fit: CurveFit, scaled: Scaled, data: Data, misfit: Misfit | None = None
) -> Uncertainty:
    """Covariance of all control points and log weights of the branches, scaled units.

    Refuses a curve that the data do not determine.
    """
    matrix = free_coordinates(fit)
    rest = scaled.beside(fit)
    if fit.shape.ends is None and rest.size > LONG:
        uncertainty = _long_uncertainty(fit, matrix, scaled, data, rest)
    else:
        root = np.sqrt(scaled.rows.count)
        jacobian = _jacobian(fit, scaled, slice(None)) @ matrix * root[:, None]
        if fit.shape.ends is not None:
            jacobian = _with_measured_ends(jacobian[:, 2:], jacobian[:, :2], scaled.rows.t)
        cuts = np.cumsum(data.sizes)[:-1]
        parts = np.split(jacobian, cuts), np.split(rest * root, cuts)
        white = covariance(*parts, robust=False)
        uncertainty = covariance(*parts, small_sample=True) if data.in_order else white
        uncertainty = widen(uncertainty, white, misfit)
    if not np.all(np.isfinite(uncertainty.covariance)):
        raise NotIdentifiedError(
            "the data cannot determine control_points: the curve does not depend on some of them.",
            expected="Nothing was written.",
            remedy="Give a lower --degree, or record the whole range in both directions.",
        )
    return replace(uncertainty, covariance=matrix @ uncertainty.covariance @ matrix.T)


def free_jacobian(fit: CurveFit, scaled: Scaled, part: slice) -> FloatArray:
    """Derivative of the curve at some rows by what was free in the fit, shape ``(n, p)``."""
    return np.asarray(_jacobian(fit, scaled, part) @ free_coordinates(fit))


def sensitivity(
    fit: CurveFit, spread: Uncertainty, scaled: Scaled, readings: Sequence[FloatArray]
) -> list[FloatArray]:
    """Derivatives of the positions by what was estimated, shape ``(n, q)`` of every log.

    Of long logs with one free curve, where as many differences of simulations as there are
    parameters take several times as long; none of others, which are examined by those.
    """
    if not is_long(sum(x.size for x in readings)) or fit.shape.branches > 1 or fit.shape.ends:
        return []
    ((p, w),) = fit.curves
    kept = np.flatnonzero(np.diag(spread.covariance) > 0.0)
    per_value = np.concatenate((np.ones(p.size), scaled.stroke / w))

    def derivatives(reading: FloatArray) -> FloatArray:
        t = np.clip((reading - scaled.low) / scaled.span, 0.0, 1.0)
        columns = curve_jacobian(fit, t, np.ones(t.size)).T[kept]
        columns *= per_value[kept, None]
        return columns.T

    tables = [by_rows(derivatives, x) for x in readings]
    return [np.asarray(j) if may_keep_aside(j.size) else j for j in tables]


def std_errors(spread: Uncertainty, degree: int) -> FloatArray:
    """Standard errors of the control points and of the log weights, ``(branches, 2, N + 1)``."""
    errors = np.sqrt(np.maximum(np.diag(spread.covariance), 0.0))
    return np.asarray(errors.reshape(-1, 2, degree + 1))


def _jacobian(fit: CurveFit, scaled: Scaled, part: slice) -> FloatArray:
    """Derivative of the curve at some rows by all its numbers."""
    return curve_jacobian(fit, scaled.rows.t[part], scaled.rows.rising[part])


def _long_uncertainty(
    fit: CurveFit, matrix: FloatArray, scaled: Scaled, data: Data, rest: FloatArray
) -> Uncertainty:
    """Covariance of a long record: its colour is that of contiguous parts of it.

    With ``B = J'J`` of all rows and ``C`` the covariance and ``E = J'J`` of the excerpt,
    ``F = E^1/2 C E^1/2`` says how much more than white noise of one unit the residuals let
    through in every direction; the covariance of all is ``B^-1/2 F B^-1/2``.
    """
    rows = scaled.merged if scaled.scatter is not None else compress(scaled.rows, FINE)
    degrees = rest.size - matrix.shape[1]
    variance = scaled.squares(fit) / degrees
    both, scale = _products(fit, matrix, rows)
    inner, order = variance * np.eye(scale.size), 0
    if data.in_order:
        parts = contiguous_parts(data.sizes)
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


def _products(fit: CurveFit, matrix: FloatArray, rows: Rows) -> tuple[FloatArray, FloatArray]:
    """Products of the columns of the derivatives, and the scale by which each was divided."""
    products, squares = np.zeros((matrix.shape[1], matrix.shape[1])), np.zeros(matrix.shape[1])
    for at in blocks(rows.t.size):
        j = curve_jacobian(fit, rows.t[at], rows.rising[at]) @ matrix
        products += j.T @ (j * rows.count[at, None])
        squares += np.sum(j**2, axis=0)
    scale = np.where(squares > 0.0, np.sqrt(squares), 1.0)
    return products / np.outer(scale, scale), scale


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
