"""From an estimate to the document: what is reported is computed from what is written."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import cached_property, partial
from typing import Any

import numpy as np

from .assessment import (
    Examination,
    Outlier,
    examine,
    find_cause,
    judge,
    outlier_notice,
    residual_whiteness,
)
from .assessment.policy import FIT_POOR, LOG_MISSED, LOG_SPREADS
from .errors import LogError, Notice, listed
from .experiment import Experiment, Hold, all_of, where_finite
from .families import get_family
from .family import (
    Family,
    FamilyOptions,
    ParameterDocument,
    Plant,
    Request,
    Simulated,
    Solution,
    Variant,
)
from .outcome import Simulation, agreement, common_level, pair
from .parameters import make_document
from .parameters.draws import draw_document
from .parameters.rounding import round_numbers
from .version import __version__

_NAMED = 5  # logs of a message
_DRAWS = 16


@dataclass(frozen=True)
class FitContext:
    """A solution with everything that it came from.

    ``sources`` are the entries of the logs for the file, ``declared`` the roles whose hold the
    user has given. The logs themselves are not kept: their numbers stand in the experiments.
    """

    family: Family[FamilyOptions]
    variant: Variant
    sources: Sequence[Mapping[str, Any]]
    declared: Collection[str]
    experiments: Sequence[Experiment]
    request: Request[FamilyOptions]
    solution: Solution[FamilyOptions]
    outliers: Sequence[Outlier] = ()

    @cached_property
    def plant(self) -> Plant[FamilyOptions]:
        """The model with the values and options that are written."""
        return self.solution.plant

    @cached_property
    def simulated(self) -> list[Simulated]:
        """Simulated outputs for the logs."""
        return [run.simulated for run in self.solution.runs]

    @cached_property
    def fitted(self) -> list[Simulation]:
        """The same, beside what was measured."""
        found = pair(self.experiments, self.simulated, self.variant)
        level = common_level(found)
        return [replace(s, level=level) for s in found]

    @cached_property
    def examination(self) -> Examination:
        """Examination of the fit; the derivatives that it needs are not kept."""
        return examine(self.family, self.variant, self.solution, self.fitted, self.declared)

    @cached_property
    def offset(self) -> float | None:
        """Offset of the output at rest, mean over all samples; ``None`` where it means nothing."""
        known = [(s.offset, s.experiment.samples) for s in self.fitted if s.offset is not None]
        if not self.family.steady_offset or not known:
            return None
        offsets, samples = zip(*known)
        return float(np.average(offsets, weights=samples))

    def validate(self, others: Sequence[Experiment]) -> list[Simulation]:
        """Simulate runs that were not fitted."""
        found = self.family.simulate(self.plant, others, self.offset)
        return pair(others, found, self.variant, self.fitted[0].level)


def limits_of(document: ParameterDocument, runs: Sequence[Simulation]) -> list[tuple[float, float]]:
    """Limits of the rmse of runs that were not fitted, and effects of parameter errors [SI].

    A limit is ``LOG_MISSED`` times the rmse of the noisiest log that was fitted, plus one step of
    the output. Where a run exceeds it, the second number is the effect of the errors of the
    parameters on its output (RMS), which the limit then allows for; otherwise it is 0.
    """
    family = get_family(document.family)
    variant, rng = family.variant(document.variant), np.random.default_rng(0)
    output, offset = variant.output.name, document.model.get("output_offset")
    fitted = [document.fit.rmse, *(log.rmse for log in document.fit.logs)]
    noise = LOG_MISSED * max(rmse.value for rmse in fitted if rmse is not None)
    limits = [noise + s.experiment.signals[output].resolution for s in runs]
    far = [s for s, limit in zip(runs, limits) if s.rmse > limit]
    squares = dict.fromkeys(map(id, far), 0.0)
    for _ in range(_DRAWS if far else 0):
        plant = draw_document(document, variant, rng).plant(family)
        try:
            drawn = family.simulate(plant, [s.experiment for s in far], offset)
        except (LogError, np.linalg.LinAlgError, ArithmeticError):
            continue  # no finite motion: nothing that a machine does
        for s, other in zip(far, drawn):
            moved = (other.output - s.simulated)[np.isfinite(s.measured)]
            moved = moved[np.isfinite(moved)]
            squares[id(s)] += float(np.mean(moved**2)) / _DRAWS if moved.size else 0.0
    spreads = [float(np.sqrt(squares.get(id(s), 0.0))) for s in runs]
    return [(float(np.hypot(a, LOG_SPREADS * b)), b) for a, b in zip(limits, spreads)]


def _missed_validation(document: ParameterDocument, runs: Sequence[Simulation]) -> list[Notice]:
    """Warn of runs that were not fitted and are missed by more than any that was."""
    limits = [limit for limit, _ in limits_of(document, runs)]
    far = [(s.rmse, limit, s.experiment) for s, limit in zip(runs, limits) if s.rmse > limit]
    if not far:
        return []
    rmse, limit, e = max(far, key=lambda entry: entry[0] / entry[1])
    signal = e.signals[get_family(document.family).variant(document.variant).output.name]
    more = f" ({e.name})" if len(far) > 1 else ""
    return [
        Notice(
            "validation-missed",
            f"{listed([e.name for *_, e in far], _NAMED)}: the model misses the output by "
            f"{signal.text(rmse)} RMS{more}, for {signal.text(limit)} that the fitted logs and the "
            "errors of the parameters explain. Check that columns, units and the state of the "
            "machine are those of the fit, and that the log stays within the range that it covers.",
        )
    ]


def make_parameter_document(
    found: FitContext,
    validation: Sequence[Simulation],
    notices: Sequence[Notice],
    sample_time: float | None,
    command: str | None,
) -> tuple[ParameterDocument, list[Notice]]:
    """Assemble and check the parameter document; returns it with all warnings."""
    family, variant, solution, request = found.family, found.variant, found.solution, found.request
    fitted = found.fitted
    output = variant.output.name
    unit = found.experiments[0].signals[output].unit
    details, warned = found.examination.details, found.examination.notices
    if found.outliers:
        details = {**details, "outliers": [o.entry for o in found.outliers]}
        warned = [*warned, outlier_notice(found.outliers)]
    level, overall = fitted[0].level, agreement(fitted)
    white = residual_whiteness(fitted, len(solution.names))
    unused = _unused_logs(fitted)
    notices = list(dict.fromkeys([*notices, *unused, *solution.notices, *warned]))
    judged = partial(
        judge, overall, residual_to_noise=details.get("residual_to_noise"), white=white,
        cause=find_cause(variant, found.experiments) if overall.fit_percent < FIT_POOR else None,
        given=request.given,
    )  # fmt: skip
    verdict, reasons = judged(notices)
    every = list(dict.fromkeys([*reasons, *notices]))  # what the verdict is about comes first
    period = min(e.sample_time for e in found.experiments) if sample_time is None else sample_time
    model = family.model(found.plant, float(period), _hold(variant, fitted))
    if found.offset is not None:
        model["output_offset"] = found.offset
    document = {
        "format": "fluidact-parameters",
        "format_version": 1,
        "family": family.name,
        "variant": variant.name,
        "options": solution.options.given(),
        "parameters": dict(solution.parameters),
        "derived": dict(solution.derived),
        "covariance": {
            "order": list(solution.names),
            "matrix": np.asarray(solution.covariance).tolist(),
        },
        "model": model,
        "validity": _validity(variant, fitted) | _computed(solution),
        "fit": round_numbers(
            {
                "samples": overall.samples,
                "rmse": {"value": overall.rmse, "unit": unit},
                "fit_percent": overall.fit_percent,
                "level": None if level is None else {"value": level, "unit": unit},
                "residual_whiteness": asdict(white),
                "verdict": verdict,
                "logs": [_log_entry(s, unit) for s in fitted],
                "details": {
                    **solution.details,
                    **details,
                    "residual_sum_of_squares": overall.sum_of_squares,
                    "output_resolution": max(
                        e.signals[output].resolution for e in found.experiments
                    ),
                },
            }
        ),
        "validation": round_numbers([_log_entry(s, unit) for s in validation]),
        "warnings": every,
        "provenance": {
            "tool": {"name": "fluidact-fit", "version": __version__},
            "created": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
            "command": command or f"fluidact_fit.fit({family.name!r}, ...)",
            "seed": request.seed,
            "logs": list(found.sources),
            "options": {
                key: getattr(request, key)
                for key in ("fixed", "start", "bounds", "noise")
                if getattr(request, key)
            },
        },
    }
    if not solution.names:
        del document["covariance"]
    made = make_document(document, get_family)
    if missed := _missed_validation(made, validation):
        every += missed
        document["warnings"] = every
        document["fit"]["verdict"] = judged([*notices, *missed])[0]
        made = make_document(document, get_family)
    return made, every


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
        "rmse": {"value": a.rmse, "unit": unit} if a.samples else None,
        "fit_percent": a.fit_percent if a.samples else None,
    }


def _unused_logs(fitted: Sequence[Simulation]) -> list[Notice]:
    """Name the logs of which no sample was used."""
    used: dict[int, int] = {}
    names: dict[int, str] = {}
    for s in fitted:
        log = s.experiment.log
        used[log] = used.get(log, 0) + int(np.count_nonzero(where_finite(s.residual)))
        names.setdefault(log, s.experiment.name)
    idle = [names[log] for log, count in used.items() if not count]
    if not idle:
        return []
    return [
        Notice(
            "log-unused",
            f"{len(idle)} of {len(used)} logs have no sample that the model describes and add "
            f"nothing to this fit: {listed(idle, _NAMED)}.",
        )
    ]


def _computed(solution: Solution[FamilyOptions]) -> dict[str, Any]:
    """Range of what was computed from the logs over the samples that were used."""
    return {
        name: {"low": float(f"{low:.6g}"), "high": float(f"{high:.6g}"), "unit": unit}
        for name, (low, high, unit) in solution.covered.items()
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
            used = all_of(s.values, where_finite(y)) if s.values.size == y.size else s.values
            ends = np.append(used, s.before) if s.values.size == 1 else used
            if ends.size:
                lows.append(float(f"{ends.min():.12g}"))  # 1.1035 bar is 110350 Pa, not less
                highs.append(float(f"{ends.max():.12g}"))
                unit = s.unit
        if lows:
            out[role.name] = {"low": min(lows), "high": max(highs), "unit": unit}
    return out
