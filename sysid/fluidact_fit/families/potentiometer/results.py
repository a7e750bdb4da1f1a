"""Entries of the file about a fitted curve."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...estimation.uncertainty import model_of_residuals, t_quantile
from ...experiment import FloatArray
from ...family import Quantity
from .calibration import SECOND, Calibration
from .data import CalibrationData
from .fit import CurveFit, std_errors
from .rational_bezier import LOG_WEIGHT_LIMIT


def curve_quantities(
    found: CurveFit, data: CalibrationData
) -> tuple[dict[str, Quantity], tuple[str, ...], FloatArray]:
    """Parameters of all branches, names and covariance of those estimated.

    Weights are positive: their intervals are made of their logarithms.
    """
    (base, stroke), model = data.positions, found.fit.model
    quantile, n = t_quantile(0.975, found.spread.degrees), model.degree + 1
    limit = 2.0 * LOG_WEIGHT_LIMIT + 1e-9
    out: dict[str, Quantity] = {}
    names: list[str] = []
    each = zip(SECOND, model.curves(found.fit.theta), std_errors(found.spread, model.degree))
    for suffix, (p, w), (error, of_weights) in each:
        value = base + stroke * p
        ends = value[:, None] + np.outer(quantile * error, (-1.0, 1.0))
        out[f"control_points{suffix}"] = Quantity(
            value.tolist(), data.output.unit, "estimated", error.tolist(), ends.tolist(), "wald"
        )
        out[f"weights{suffix}"] = Quantity(w.tolist(), "1", "not_identified")
        if model.rational:
            log = np.log(w)[:, None]
            ends = np.clip(log + np.outer(quantile * of_weights / w, (-1.0, 1.0)), -limit, limit)
            ends = w[:, None] * np.exp(ends - log)
            out[f"weights{suffix}"] = Quantity(
                w.tolist(), "1", "estimated", of_weights.tolist(), ends.tolist(), "wald-log"
            )
        for name in ("control_points", "weights"):
            names += [f"{name}{suffix}[{i}]" for i in range(n)]
    kept = np.flatnonzero(np.diag(found.spread.covariance) > 0.0)
    return out, tuple(names[i] for i in kept), found.spread.covariance[np.ix_(kept, kept)]


def derived_quantities(
    found: CurveFit, data: CalibrationData, calibration: Calibration
) -> dict[str, Quantity]:
    """Sizes of the calibration; the stroke, a difference of two control points, with its error."""
    c, n = found.spread.covariance, found.fit.model.degree
    error = float(np.sqrt(max(c[0, 0] + c[n, n] - 2.0 * c[0, n], 0.0)))
    return {
        name: Quantity(size, data.output.unit, "derived", error if name == "stroke" else None)
        for name, size in calibration.sizes.items()
    }


def fit_details(found: CurveFit, data: CalibrationData) -> dict[str, Any]:
    """Starts and residuals for the file, and the errors of all degrees on folds held out."""
    fit, spread, stroke = found.fit, found.spread, data.positions[1]
    details: dict[str, Any] = {
        "monotone_constraint": bool(fit.model.direction),
        "starts": {"tried": fit.tried, "agreeing": fit.agreeing},
        "iterations": fit.iterations,
        "converged": fit.converged,
        "residual_std": spread.sigma * stroke,
        "covariance": model_of_residuals(spread.order),
    }
    if found.scores:
        details["cross_validation"] = [
            {"degree": k, "rms": float(np.sqrt(squares.mean())) * stroke}
            for k, squares in enumerate(found.scores, start=1)
        ]
    return details
