"""What the file says of a fitted curve, and its positions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...estimation.uncertainty import Uncertainty, t_quantile
from ...experiment import FloatArray
from ...family import Quantity
from .calibration import SECOND
from .data import Scaled
from .rational_bezier import LOG_WEIGHT_LIMIT, CurveFit, Score, rational_bezier
from .spread import std_errors


def fit_quantities(
    fit: CurveFit, spread: Uncertainty, scaled: Scaled
) -> tuple[dict[str, Quantity], tuple[str, ...], FloatArray]:
    """Parameters of all branches, and the covariance of those that were estimated.

    Weights are positive: their intervals are made of their logarithms.
    """
    quantile = t_quantile(0.975, spread.degrees)
    n = fit.shape.degree + 1
    out: dict[str, Quantity] = {}
    names: list[str] = []
    factors: list[FloatArray] = []
    for suffix, (p, w), (points, logs) in zip(SECOND, fit.curves, std_errors(spread, n - 1)):
        error = points * scaled.stroke
        value, half = scaled.base + scaled.stroke * p, quantile * error
        out[f"control_points{suffix}"] = Quantity(
            value.tolist(), "m", "estimated", error.tolist(),
            np.column_stack((value - half, value + half)).tolist(), "wald",
        )  # fmt: skip
        out[f"weights{suffix}"] = _weights(w, logs, quantile, fit.shape.rational)
        names += [
            f"{kind}{suffix}[{i}]" for kind in ("control_points", "weights") for i in range(n)
        ]
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


def derived_quantities(fit: CurveFit, spread: Uncertainty, scaled: Scaled) -> dict[str, Quantity]:
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


def fit_details(
    fit: CurveFit, spread: Uncertainty, scores: Sequence[Score], scaled: Scaled
) -> dict[str, Any]:
    """Method, degree, starts and residuals for the file."""
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
        "residual_std": spread.sigma * scaled.stroke,
        "covariance": f"autoregressive residuals of order {spread.order}"
        if spread.order
        else "white",
    }
    if scores:
        details["cross_validation"] = [
            {
                "degree": s.degree,
                "rms": s.rms * scaled.stroke,
                "mean_square_std_error": s.std_error * scaled.stroke**2,
            }
            for s in scores
        ]
    return details
