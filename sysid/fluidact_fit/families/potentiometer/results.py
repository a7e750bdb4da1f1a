"""Entries of the file about a fitted curve."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...estimation.uncertainty import model_of_residuals, t_quantile
from ...experiment import FloatArray
from ...family import Quantity
from .calibration import SECOND
from .data import ScaledSamples
from .fit import CurveFit, is_rising_or_falling, std_errors
from .rational_bezier import LOG_WEIGHT_LIMIT, curves_of, rational_bezier


def curve_quantities(
    found: CurveFit, scaled: ScaledSamples
) -> tuple[dict[str, Quantity], tuple[str, ...], FloatArray]:
    """Parameters of all branches, names and covariance of those estimated.

    Weights are positive: their intervals are made of their logarithms.
    """
    quantile, n = t_quantile(0.975, found.spread.degrees), found.model.degree + 1
    errors = std_errors(found.spread, n - 1)
    out: dict[str, Quantity] = {}
    names: list[str] = []
    scales: list[FloatArray] = []
    for suffix, (p, w), (points, logs) in zip(SECOND, curves_of(found.fit), errors):
        error = points * scaled.stroke
        value, half = scaled.base + scaled.stroke * p, quantile * error
        out[f"control_points{suffix}"] = Quantity(
            value.tolist(), scaled.output.unit, "estimated", error.tolist(),
            np.column_stack((value - half, value + half)).tolist(), "wald",
        )  # fmt: skip
        out[f"weights{suffix}"] = Quantity(w.tolist(), "1", "not_identified")
        if found.model.rational:
            limit = 2.0 * LOG_WEIGHT_LIMIT + 1e-9
            ends = np.log(w)[:, None] + np.outer(quantile * logs, (-1.0, 1.0))
            interval = np.exp(np.clip(ends, -limit, limit))
            interval = np.column_stack(
                (np.minimum(interval[:, 0], w), np.maximum(interval[:, 1], w))
            )
            out[f"weights{suffix}"] = Quantity(
                w.tolist(), "1", "estimated", (w * logs).tolist(), interval.tolist(), "wald-log"
            )
        names += [f"control_points{suffix}[{i}]" for i in range(n)]
        names += [f"weights{suffix}[{i}]" for i in range(n)]
        scales += [np.full(n, scaled.stroke), w]
    scale = np.concatenate(scales)
    matrix = found.spread.covariance * np.outer(scale, scale)
    kept = np.flatnonzero(np.diag(matrix) > 0.0)
    return out, tuple(names[i] for i in kept), matrix[np.ix_(kept, kept)]


def derived_quantities(found: CurveFit, scaled: ScaledSamples) -> dict[str, Quantity]:
    """Stroke between the extreme readings, and the width of the hysteresis."""
    n, curves = found.model.degree, curves_of(found.fit)
    c = found.spread.covariance
    error = float(np.sqrt(max(c[0, 0] + c[n, n] - 2.0 * c[0, n], 0.0)))
    found_sizes = {name: size * scaled.stroke for name, size in sizes_of(curves).items()}
    errors = {"stroke": error * scaled.stroke}
    return {
        name: Quantity(size, scaled.output.unit, "derived", errors.get(name))
        for name, size in found_sizes.items()
    }


def sizes_of(curves: Sequence[tuple[FloatArray, FloatArray]]) -> dict[str, float]:
    """Stroke between the extreme readings and, of two branches, the width of the hysteresis.

    ``curves`` are control points and weights of each, shape ``(n,)``.
    """
    points = curves[0][0]
    out = {"stroke": abs(float(points[-1] - points[0]))}
    if len(curves) == 2:
        rise, fall = (rational_bezier(np.linspace(0.0, 1.0, 1001), *c) for c in curves)
        out["hysteresis"] = float(np.mean(np.abs(rise - fall)))
    return out


def fit_details(found: CurveFit, scaled: ScaledSamples) -> dict[str, Any]:
    """Degree, starts and residuals for the file."""
    fit, spread = found.fit, found.spread
    details: dict[str, Any] = {
        "degree": found.model.degree,
        "degree_chosen_by": "cross-validation" if found.scores else "user or number of samples",
        "monotone": is_rising_or_falling(fit),
        "monotone_constraint": bool(found.model.direction),
        "starts": {"tried": fit.tried, "agreeing": fit.agreeing},
        "iterations": fit.iterations,
        "converged": fit.converged,
        "residual_std": spread.sigma * scaled.stroke,
        "covariance": model_of_residuals(spread.order),
    }
    if found.scores:
        details["cross_validation"] = [
            {"degree": k, "rms": float(np.sqrt(square)) * scaled.stroke}
            for k, square in found.scores
        ]
    return details
