"""Linear least squares: columns of any scale, bounds, and what a span explains."""

from __future__ import annotations

import numpy as np

from ..experiment import Array, BoolArray, FloatArray

NEGLIGIBLE = 1e-10  # part of the largest singular value below which a direction is none


def lengths(columns: FloatArray) -> FloatArray:
    """Euclidean lengths of columns, shape ``(q,)``; :func:`numpy.linalg.norm` takes four times."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->j", columns, columns)))


def column_scales(columns: FloatArray) -> FloatArray:
    """Lengths of columns, 1 where a column is zero, shape ``(q,)``."""
    size = lengths(columns)
    return np.where(size == 0.0, 1.0, size)


def orthonormal(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of the span of some columns; negligible directions are left out."""
    norms = lengths(columns)
    some = norms > 0.0
    used = columns / norms if some.all() else columns[:, some] / norms[some]
    if used.shape[1] <= 1:
        return used
    q, r = np.linalg.qr(used)
    size = np.abs(np.diag(r))
    if size.min() > NEGLIGIBLE * size.max():
        return q
    left, singular, _ = np.linalg.svd(used, full_matrices=False)
    return left[:, singular > NEGLIGIBLE * singular[0]]


def project_out(rows: FloatArray, columns: FloatArray) -> FloatArray:
    """Remove from ``rows``, shape ``(n, p)``, what ``columns``, ``(n, q)``, explain."""
    return without(orthonormal(columns), rows)


def without(q: FloatArray, rows: Array) -> Array:
    """Remove the part of rows that lies in the span of an orthonormal ``q``."""
    return np.asarray(rows - q @ (q.T @ rows)) if q.shape[1] else rows


def scaled_least_squares(a: FloatArray, y: FloatArray, rcond: float = 1e-12) -> FloatArray:
    """Least squares ``min |y - a x|`` whose columns may differ by many orders of magnitude.

    ``a`` has shape ``(n, q)``, ``y`` ``(n,)`` or ``(n, p)``; ``rcond`` is the smallest singular
    value of the columns, each of length one, that counts.
    """
    scale = column_scales(a)
    return np.asarray((np.linalg.lstsq(a / scale, y, rcond=rcond)[0].T / scale).T)


def solve_normal(normal: FloatArray, right: FloatArray, rcond: float = 1e-12) -> FloatArray:
    """Solve normal equations ``(q, q)`` of unknowns of any size; the shortest where singular."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    found = np.linalg.lstsq(normal / np.outer(scale, scale), right / scale, rcond=rcond)[0]
    return np.asarray(found / scale)


def scaled_inverse(matrix: FloatArray, least: float, part: float) -> tuple[FloatArray, BoolArray]:
    """Inverse ``(p, p)`` where there is one, and which unknowns hang on a direction without.

    Unknowns of any size are scaled first. A direction without has less than ``least`` of the
    largest eigenvalue; an unknown hangs on it that is more than ``part`` of it.
    """
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    known = values > least * values.max(initial=0.0)
    vague = np.any(np.abs(vectors[:, ~known]) > part, axis=1) | (np.diag(matrix) <= 0.0)
    found = (vectors[:, known] / values[known]) @ vectors[:, known].T
    return found / np.outer(scale, scale), vague


def bounded_least_squares(
    a: FloatArray, y: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Least squares ``min |y - a x|`` with bounds, and which entries are at one.

    Parameters
    ----------
    a : (n, q)
    y : (n,)
    low, high : (q,)
    """
    if a.shape[1] == 1:  # a gain alone: no decomposition needed
        column = a[:, 0]
        square = float(column @ column)
        best = float(column @ y) / square if square > 0.0 else 0.0
        x = np.clip(np.array([best]), low, high)
        return x, (x != best) | (low == high)
    x = scaled_least_squares(a, y, 1e-13)
    active = np.zeros(x.size, dtype=bool)
    if np.all(x >= low) and np.all(x <= high):
        return x, active | (low == high)
    from scipy.optimize import lsq_linear

    scale = column_scales(a)
    width = np.where(high > low, high, np.nextafter(low, np.inf))
    found = lsq_linear(a / scale, y, bounds=(low * scale, width * scale), method="bvls")
    return np.clip(found.x / scale, low, high), found.active_mask != 0
