"""What the file says of a trained network: parameters, errors, a polynomial beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import chain, combinations_with_replacement
from typing import Any

import numpy as np

from ...estimation.network import samples_last, thin
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
    net, s, x = fit.map.network, fit.map.scaling, fit.data.x[fit.data.used]
    for k, (w, b) in enumerate(zip(net.weights, net.biases), start=1):
        out[f"weights_{k}"] = Quantity(w.tolist(), "1")
        out[f"biases_{k}"] = Quantity(b.tolist(), "1")
    for name, value in (
        ("input_offset", s.offset.tolist()), ("input_scale", s.scale.tolist()),
        ("input_low", x.min(axis=0).tolist()), ("input_high", x.max(axis=0).tolist()),
        ("output_offset", s.base), ("output_scale", s.span),
    ):  # fmt: skip
        out[name] = Quantity(value, "1", "derived")
    return out


def fit_details(fit: Fit, certificate: Certificate, options: ForceMapOptions) -> dict[str, Any]:
    """Training, errors and certificate for the file."""
    data, net, rows, span = fit.data, fit.map.network, fit.rows, fit.rows.scaling.span
    error = data.y - fit.predicted
    held = np.full(data.y.size, np.nan)
    held[is_known(data.x, data.names) & np.isfinite(data.y)] = span * fit.trial.error
    judged, used = replace(data, used=np.isfinite(held)), data.used
    return {
        "method": "multi-start Levenberg-Marquardt, Huber cost",
        "target": options.target,
        "inputs": list(data.names),
        "input_units": list(data.units),
        "hidden": list(net.hidden),
        "activation": net.activation,
        "network_parameters": net.parameters,
        "multiplications": net.multiplications,
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
            "split_by": rows.split_by,
            "groups_held_out": rows.groups,
            "folds": len(rows.folds),
            **_scores(judged, held),
        },
        "cubic_polynomial": _polynomial(fit),
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


def _polynomial(fit: Fit) -> dict[str, Any]:
    """A cubic polynomial of the same inputs: in sample, by branch, and on the same folds."""
    data, s, rows = fit.data, fit.map.scaling, fit.rows
    z, t = s.inputs(data.x), s.output(data.y)
    error = s.span * (t - polynomial_fit(z[data.used], t[data.used])(z))
    held = np.full(rows.y.size, np.nan)
    for fold in rows.folds:
        rest = np.flatnonzero(~fold)
        rest = rest[thin(rest.size, 20_000)]
        held[fold] = rows.y[fold] - polynomial_fit(rows.x[rest], rows.y[rest])(rows.x[fold])
    return {
        "terms": len(polynomial_terms(data.x.shape[1], 3)),
        **_scores(data, error),
        "validation_rms": s.span * rms(held),
    }


def polynomial_terms(inputs: int, degree: int) -> list[tuple[int, ...]]:
    """Factors of all monomials of up to a degree: ``(), (0,), (0, 0), (0, 1) ...``."""
    choices = (combinations_with_replacement(range(inputs), d) for d in range(degree + 1))
    return list(chain.from_iterable(choices))


def polynomial_fit(
    x: FloatArray, y: FloatArray, degree: int = 3
) -> Callable[[FloatArray], FloatArray]:
    """Least-squares polynomial of all inputs, for comparison; returns it as a function."""
    terms = polynomial_terms(x.shape[1], degree)

    def columns(z: FloatArray) -> FloatArray:
        x = samples_last(z)
        found: dict[tuple[int, ...], FloatArray] = {(): np.ones(z.shape[0])}
        for t in terms[1:]:
            found[t] = found[t[:-1]] * x[t[-1]]
        return np.column_stack(list(found.values()))

    c = columns(x)
    # direction^2 = 1: columns repeat, and the shortest solution is as good as any
    weights = np.linalg.pinv(c.T @ c, rcond=1e-12, hermitian=True) @ (y @ c)
    return lambda z: np.asarray(columns(z) @ weights)
