"""Numbers as they are written: to a few digits beyond their standard errors.

Everything else in a file (model, derived numbers, errors of the fit) is computed from the
rounded values, so that a reader who computes it again finds the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import floor, log10
from typing import Any

import numpy as np

from ..experiment import FloatArray
from ..specification import Quantity

BEYOND = 4  # digits of a value beyond the first one of its standard error
_LEAST = 4  # digits of a value, however large its standard error
_OF_ERRORS = 5  # digits of a standard error
_OF_COVARIANCE = (6, 9, 12, 17)  # digits, of which the first that keep the matrix positive
_NEGATIVE = -1e-9  # eigenvalue of the correlations that rounding may leave


def round_quantity(q: Quantity) -> Quantity:
    """Return a quantity with value, standard error and interval rounded for the file.

    The value keeps ``BEYOND`` digits beyond the first of its standard error. A quantity without a
    standard error is returned as it is.
    """
    if q.std_error is None:
        return q
    value, error = np.asarray(q.value, dtype=float), np.asarray(q.std_error, dtype=float)
    places = np.frompyfunc(_places, 2, 1)(value, error)
    ends = None
    if q.ci95 is not None:
        pairs = np.asarray(q.ci95, dtype=float)
        ends = _rounded(pairs, np.broadcast_to(np.expand_dims(places, -1), pairs.shape)).tolist()
    return Quantity(
        _rounded(value, places).tolist(), q.unit, q.status, significant(error, _OF_ERRORS).tolist(),
        ends, q.method,
    )  # fmt: skip


def round_covariance(matrix: FloatArray) -> FloatArray:
    """Return a covariance, shape ``(p, p)``, to as few digits as keep it positive semidefinite."""
    if not matrix.size:
        return matrix
    for digits in _OF_COVARIANCE:
        rounded = significant(matrix, digits)
        spread = np.sqrt(np.maximum(np.diag(rounded), np.finfo(float).tiny))
        scaled = rounded / np.outer(spread, spread)
        if not np.isfinite(scaled).all() or np.linalg.eigvalsh(scaled)[0] >= _NEGATIVE:
            break
    return rounded


def significant(values: Any, digits: int) -> FloatArray:
    """Return numbers of any shape, rounded to so many significant digits."""
    values = np.asarray(values, dtype=float)
    return np.array([float(f"{x:.{digits}g}") for x in values.flat]).reshape(values.shape)


def round_numbers(tree: Any, digits: int = 10) -> Any:
    """Return plain data (mappings, lists, numbers, text) with all floats rounded."""
    if isinstance(tree, float):
        return float(f"{tree:.{digits}g}")
    if isinstance(tree, Mapping):
        return {key: round_numbers(value, digits) for key, value in tree.items()}
    if isinstance(tree, list | tuple):
        return [round_numbers(value, digits) for value in tree]
    return tree


def _places(value: float, error: float) -> int | None:
    """Decimal places to which a value is rounded, ``None`` for a value without an error."""
    if not (error > 0.0 and np.isfinite(error) and np.isfinite(value)):
        return None
    places = BEYOND - floor(log10(error))
    if value != 0.0:
        places = max(places, _LEAST - 1 - floor(log10(abs(value))))
    return places


def _rounded(values: FloatArray, places: Any) -> FloatArray:
    return np.array(
        [x if p is None else round(float(x), p) for x, p in zip(values.flat, np.ravel(places))]
    ).reshape(values.shape)
