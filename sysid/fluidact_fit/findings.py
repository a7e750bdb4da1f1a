"""From an estimate to the document: what is reported is computed from what is written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from .assessment import diagnose, judge, residual_whiteness
from .errors import Notice
from .experiment import Experiment, Hold
from .families import get_family
from .family import (
    Estimate,
    Family,
    FamilyOptions,
    ParameterDocument,
    Request,
    Simulated,
    Variant,
)
from .logs import Log, provenance
from .outcome import Simulation, agreement
from .parameters import make_document
from .version import __version__


@dataclass(frozen=True)
class Findings:
    """An estimate with everything that it came from."""

    family: Family[FamilyOptions]
    variant: Variant
    logs: Sequence[Log]
    experiments: Sequence[Experiment]
    request: Request[FamilyOptions]
    estimate: Estimate[FamilyOptions]

    def simulate(
        self, experiments: Sequence[Experiment], offset: float | None = None
    ) -> list[Simulated]:
        """What the model gives with the values and options that are written."""
        e = self.estimate
        return self.family.simulate(self.variant, e.values, experiments, e.options, offset)

    def compare(
        self, experiments: Sequence[Experiment], found: Sequence[Simulated]
    ) -> list[Simulation]:
        """Simulations beside what was measured."""
        output = self.variant.output.name
        return [Simulation.of(e, s, output) for e, s in zip(experiments, found, strict=True)]


def mean_offset(family: Family[FamilyOptions], fitted: Sequence[Simulation]) -> float | None:
    """Offset of the output at rest, mean over all samples; ``None`` where it means nothing."""
    known = [(s.offset, s.experiment.samples) for s in fitted if s.offset is not None]
    if not family.steady_offset or not known:
        return None
    offsets, samples = zip(*known)
    return float(np.average(offsets, weights=samples))


def make_parameter_document(
    found: Findings,
    fitted: Sequence[Simulation],
    validation: Sequence[Simulation],
    notices: Sequence[Notice],
    sample_time: float | None,
    command: str | None,
) -> tuple[ParameterDocument, list[Notice]]:
    """Assemble and check the parameter document; returns it with all warnings."""
    family, variant, estimate, request = found.family, found.variant, found.estimate, found.request
    unit = found.experiments[0].signals[variant.output.name].unit
    declared = {role for log in found.logs for role in log.holds}
    details, warned = diagnose(family, variant, estimate, fitted, declared)
    overall = agreement([s.measured for s in fitted], [s.simulated for s in fitted])
    white = residual_whiteness(fitted, len(estimate.covariance_order))
    notices = _distinct([*notices, *estimate.notices, *warned])
    verdict, reasons = judge(overall, notices, details.get("residual_to_noise"), white)
    every = _distinct([*notices, *reasons])
    period = sample_time
    if period is None:
        period = min((e.sample_time for e in found.experiments), default=0.0)
    model = family.model(
        variant, estimate.values, estimate.options, float(period), _hold(variant, fitted)
    )
    offset = mean_offset(family, fitted)
    if offset is not None:
        model["output_offset"] = offset
    document = {
        "format": "fluidact-parameters",
        "format_version": 1,
        "family": family.name,
        "variant": variant.name,
        "options": estimate.options.given(),
        "parameters": dict(estimate.parameters),
        "derived": dict(estimate.derived),
        "covariance": {
            "order": list(estimate.covariance_order),
            "matrix": np.asarray(estimate.covariance).tolist(),
        },
        "model": model,
        "validity": _validity(variant, fitted),
        "fit": {
            "samples": overall.samples,
            "rmse": {"value": overall.rmse, "unit": unit},
            "fit_percent": overall.fit_percent,
            "residual_whiteness": {
                "statistic": white.statistic,
                "p_value": white.p_value,
                "lags": white.lags,
            },
            "verdict": verdict,
            "logs": [_log_entry(s, unit) for s in fitted],
            "details": {
                **estimate.details,
                **details,
                "residual_sum_of_squares": overall.sum_of_squares,
                "output_resolution": _resolution(variant, fitted),
            },
        },
        "validation": [_log_entry(s, unit) for s in validation],
        "warnings": every,
        "provenance": {
            "tool": {"name": "fluidact-fit", "version": __version__},
            "created": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
            "command": command or f"fluidact_fit.fit({family.name!r}, ...)",
            "seed": request.seed,
            "logs": [
                provenance(log, [e for e in found.experiments if e.log == i])
                for i, log in enumerate(found.logs)
            ],
            "options": {
                key: {k: list(v) if isinstance(v, tuple) else v for k, v in given.items()}
                for key, given in (
                    ("fixed", request.fixed),
                    ("start", request.start),
                    ("bounds", request.bounds),
                )
                if given
            },
        },
    }
    if not estimate.covariance_order:
        del document["covariance"]
    return make_document(document, get_family), every


def _distinct(notices: Sequence[Notice]) -> list[Notice]:
    return list(dict.fromkeys(notices))


def _resolution(variant: Variant, fitted: Sequence[Simulation]) -> float:
    """Coarsest step of a converter that the logs show in the output [SI]."""
    name = variant.output.name
    return max(s.experiment.signals[name].resolution for s in fitted)


def _hold(variant: Variant, fitted: Sequence[Simulation]) -> Hold:
    """Hold of the first role that drives the model."""
    for role in variant.driving:
        if role.name in fitted[0].experiment:
            return fitted[0].experiment.signals[role.name].hold or "zoh"
    return "zoh"


def _log_entry(s: Simulation, unit: str) -> dict[str, Any]:
    """One row of ``fit.logs`` or ``validation``."""
    a = s.agreement
    return {
        "file": s.experiment.name,
        "samples": a.samples,
        "left_out": s.left_out or None,
        "offset": None if s.offset is None else {"value": s.offset, "unit": unit},
        "rmse": {"value": a.rmse, "unit": unit},
        "fit_percent": a.fit_percent,
    }


def _validity(variant: Variant, fitted: Sequence[Simulation]) -> dict[str, Any]:
    """Range of every role over the samples that were used."""
    out = {}
    for role in variant.roles:
        if role.name == "time":
            continue
        lows, highs, unit = [], [], role.unit
        for e, y in ((s.experiment, s.measured) for s in fitted):
            if role.name not in e:
                continue
            s = e.signals[role.name]
            used = s.values[np.isfinite(y)] if s.values.size == y.size else s.values
            ends = np.append(used, s.before) if s.values.size == 1 else used
            if ends.size:
                lows.append(float(f"{ends.min():.12g}"))  # 1.1035 bar is 110350 Pa, not less
                highs.append(float(f"{ends.max():.12g}"))
                unit = s.unit
        if lows:
            out[role.name] = {"low": min(lows), "high": max(highs), "unit": unit}
    return out
