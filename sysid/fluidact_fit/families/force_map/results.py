"""What the file says of a trained network: parameters and errors."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...experiment import FloatArray
from ...family import Quantity
from .certificates import Certificate, certificate_details
from .data import Data, is_known
from .options import ForceMapOptions
from .training import Fit
from .validation import rms


def file_parameters(fit: Fit) -> dict[str, Quantity]:
    """Layers and scalings as they stand in the file."""
    out: dict[str, Quantity] = {}
    for k, (w, b) in enumerate(zip(fit.network.weights, fit.network.biases), start=1):
        out[f"weights_{k}"] = Quantity(w.tolist(), "1")
        out[f"biases_{k}"] = Quantity(b.tolist(), "1")
    s, x = fit.scaling, fit.data.x[fit.data.used]
    for name, value in (
        ("input_offset", s.offset), ("input_scale", s.scale),
        ("input_low", x.min(axis=0)), ("input_high", x.max(axis=0)),
    ):  # fmt: skip
        out[name] = Quantity(value.tolist(), "1", "derived")
    out["output_offset"] = Quantity(s.base, "1", "derived")
    out["output_scale"] = Quantity(s.span, "1", "derived")
    return out


def fit_details(fit: Fit, certificate: Certificate, options: ForceMapOptions) -> dict[str, Any]:
    """Training, errors and certificate for the file."""
    data, span, rows = fit.data, fit.scaling.span, fit.rows
    error = data.y - fit.predicted
    held = np.full(data.y.size, np.nan)
    held[is_known(data.x, data.names) & np.isfinite(data.y)] = span * fit.trial.error
    judged = replace(data, used=np.isfinite(held))
    used = data.used
    return {
        "method": "multi-start Levenberg-Marquardt, Huber cost",
        "target": options.target,
        "inputs": list(data.names),
        "input_units": list(data.units),
        "hidden": list(fit.network.hidden),
        "activation": fit.network.activation,
        "network_parameters": fit.network.parameters,
        "multiplications": fit.network.multiplications,
        "training": {
            "starts": fit.found.tried,
            "weight_decay": fit.trial.decay,
            "huber_limit": fit.found.limit * span,
            "iterations": fit.iterations,
        },
        "spikes": fit.spikes,
        "correlation": float(np.corrcoef(data.y[used], fit.predicted[used])[0, 1]),
        "branches": _scores(data, error),
        "validation": {
            "split_by": rows.split.by,
            "groups_held_out": rows.split.groups,
            "folds": len(rows.split.folds),
            **_scores(judged, held),
        },
        "certificate": certificate_details(certificate, data, options.driver),
        **fit.tables,
    }


def _scores(data: Data, error: FloatArray) -> dict[str, Any]:
    """Errors over all used samples, by branch, and well within the branches [SI]."""
    out: dict[str, Any] = {"rmse": rms(error[data.used])}
    for name, sign in (("loading", 1.0), ("unloading", -1.0)):
        branch = data.used & (data.direction == sign)
        if branch.any():
            inside = branch & data.settled
            out[name] = {"samples": int(branch.sum()), "rmse": rms(error[branch])}
            if inside.any():
                out[name]["in_branch_rmse"] = rms(error[inside])
    return out
