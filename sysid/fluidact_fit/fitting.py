"""The one way from logs to a result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from os import PathLike
from typing import Any, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from .diagnosis import diagnose
from .errors import LogError, Notice, NotIdentifiedError, UsageError
from .estimation.inputs import interpolation, is_smooth
from .experiment import Experiment, FloatArray, Hold
from .families import get_family
from .family import Estimate, Family, Request, Value, Variant
from .logs import Log, choose_variant, provenance, read_log, share_columns
from .logs import experiments as experiments_of
from .quality import agreement, judge, residual_whiteness
from .result import FitResult, Simulation

LogLike = Log | str | PathLike[str]
_FEWEST = 8  # samples of a log that is fitted or judged


def fit(
    family: str,
    logs: Sequence[LogLike] | LogLike,
    *,
    hold: Mapping[str, str] | None = None,
    fixed: Mapping[str, float] | None = None,
    start: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    validate: Sequence[LogLike] = (),
    controller_sample_time: float | None = None,
    seed: int = 0,
    command: str | None = None,
    progress: Callable[[str], None] | None = None,
    **options: Any,
) -> FitResult:
    """Fit a model family to one or several logs of the same hardware.

    Physical parameters are shared by all logs; initial states and offsets are free per
    run.

    Parameters
    ----------
    family
        Name of the family, for example ``"hydrostatic"``.
    logs
        Logs, or paths of CSV files whose columns are named like the roles.
    hold
        Role to ``"zoh"`` or ``"foh"``, instead of the family's default.
    fixed, start, bounds
        By parameter name, SI.
    validate
        Logs that are judged with the result and never fitted.
    controller_sample_time
        Period of the discrete model in the file [s]; the log's own when left out.
    seed
        For whatever is random.
    command
        Written into the file as its provenance.
    progress
        Called with a line of text now and then.
    **options
        The family's own options, with underscores for hyphens.

    Returns
    -------
    FitResult

    Raises
    ------
    UsageError, LogError, NotIdentifiedError
        With what was found, where, and what to do.
    """
    chosen = get_family(family)
    given = [logs] if isinstance(logs, Log | str | PathLike) else list(logs)
    if not given:
        raise UsageError("no log was given", remedy="Give at least one CSV file.")
    judged = [_open(log, hold) for log in validate]
    together = share_columns([*(_open(log, hold) for log in given), *judged])
    opened, judged = together[: len(given)], together[len(given) :]
    settings = _options(chosen, options)
    variant = choose_variant(opened, chosen.variants_for(settings))
    experiments, notices = _prepare(opened, variant)
    request = Request(
        options=settings,
        fixed=dict(fixed or {}),
        start=dict(start or {}),
        bounds=dict(bounds or {}),
        seed=seed,
        progress=progress or (lambda message: None),
    )
    estimate = _estimate(chosen, variant, experiments, request)
    request = replace(request, options={**request.options, **estimate.options})
    validation, more = _validate(chosen, variant, estimate, judged, request)
    notices = _distinct([*notices, *more, *estimate.notices])
    document, notices = _document(
        chosen, variant, estimate, experiments, opened, validation, notices, request,
        controller_sample_time, command,
    )  # fmt: skip
    return FitResult(family, variant, estimate, experiments, validation, document, notices)


def _estimate(
    family: Family, variant: Variant, experiments: Sequence[Experiment], request: Request
) -> Estimate:
    """Let the family fit; values so far apart that arithmetic fails are the data's fault."""
    try:
        # Matrices are small: sharing one out among threads costs more than the product, most
        # of all on a busy machine, and the last digits would depend on how many there are.
        with threadpool_limits(limits=1, user_api="blas"):
            return family.estimate(variant, experiments, request)
    except (np.linalg.LinAlgError, OverflowError, FloatingPointError) as error:
        raise NotIdentifiedError(
            f"the computation broke down ({error}).",
            expected="Some values are too far apart to be computed with. Nothing was written.",
            remedy="Check --unit and --scale of the columns, and --fix, --start and --bounds (SI).",
        ) from error


def _open(log: LogLike, hold: Mapping[str, str] | None) -> Log:
    opened = log if isinstance(log, Log) else read_log(log)
    return replace(opened, holds={**opened.holds, **hold}) if hold else opened


def _prepare(logs: Sequence[Log], variant: Variant) -> tuple[list[Experiment], list[Notice]]:
    """Turn all logs into experiments."""
    found: list[Experiment] = []
    notices: list[Notice] = []
    for index, log in enumerate(logs):
        some, said = experiments_of(log, variant, index=index)
        _require_samples(log, variant, some)
        found += some
        notices += [*log.notices, *said]
    if not found:
        raise LogError(
            "no run of any log can be used",
            where=logs[0].name,
            remedy="See the warnings above; `fluidact-fit inspect` shows what is in a log.",
        )
    return settle_holds(found), notices


def _require_samples(log: Log, variant: Variant, found: Sequence[Experiment]) -> None:
    """Refuse a log of motion that is too short for any model to leave a residual."""
    timed = any(role.name == "time" and role.required for role in variant.roles)
    samples = sum(e.samples for e in found)
    if timed and samples < _FEWEST:
        raise LogError(
            f"only {samples} {'sample' if samples == 1 else 'samples'} can be used.",
            where=log.name,
            expected=f"Expected {_FEWEST} or more in the course of time.",
            remedy="Record longer or sample faster; check --window where it was given.",
        )


def settle_holds(experiments: Sequence[Experiment]) -> list[Experiment]:
    """Decide once for all logs how a signal with hold ``foh`` moves between its samples."""
    roles = {r for e in experiments for r, s in e.signals.items() if s.hold == "foh"}
    moves: dict[str, Literal["linear", "cubic"]] = {
        role: "cubic"
        if is_smooth([e.signals[role] for e in experiments if role in e])
        else "linear"
        for role in roles
    }
    return [
        replace(
            e,
            signals={
                r: replace(s, moves=moves[r]) if r in moves and s.hold == "foh" else s
                for r, s in e.signals.items()
            },
        )
        for e in experiments
    ]


def _distinct(notices: Sequence[Notice]) -> list[Notice]:
    return list(dict.fromkeys(notices))


def _options(family: Family, given: Mapping[str, Any]) -> dict[str, Any]:
    """The family's options with defaults, hyphens as on the command line."""
    out = {o.name: o.default for o in family.options}
    for name, value in given.items():
        key = name.replace("_", "-")
        if key not in out:
            raise UsageError(
                f"{family.name} has no option {key!r}",
                expected="Its options are: " + (", ".join(out) or "none") + ".",
            )
        option = next(o for o in family.options if o.name == key)
        if option.choices and value not in option.choices:
            raise UsageError(
                f"{key} cannot be {value!r}", expected="One of " + ", ".join(option.choices) + "."
            )
        out[key] = value
    return out


def values_of(estimate: Estimate) -> dict[str, Value]:
    """Plain values of an estimate by name."""
    return {k: q.value for k, q in estimate.parameters.items()}


def _validate(
    family: Family,
    variant: Variant,
    estimate: Estimate,
    logs: Sequence[Log],
    request: Request,
) -> tuple[list[Simulation], list[Notice]]:
    """Simulate logs that were not fitted."""
    if not logs:
        return [], []
    experiments, notices = _prepare(logs, variant)
    out = []
    for e in experiments:
        simulated = family.simulate(variant, values_of(estimate), e, request.options)
        out.append(Simulation(e, simulated, e[variant.output.name]))
    return out, notices


def _document(
    family: Family,
    variant: Variant,
    estimate: Estimate,
    experiments: Sequence[Experiment],
    logs: Sequence[Log],
    validation: Sequence[Simulation],
    notices: Sequence[Notice],
    request: Request,
    sample_time: float | None,
    command: str | None,
) -> tuple[dict[str, Any], list[Notice]]:
    """Assemble the parameter document."""
    from . import __version__

    values = values_of(estimate)
    unit = _output_unit(variant, experiments)
    declared = {role for log in logs for role in log.holds}
    found, warned = diagnose(family, variant, estimate, experiments, request, declared)
    notices = _distinct([*notices, *warned])
    overall = agreement(estimate.measured, estimate.simulated)
    white = residual_whiteness(
        estimate.measured, estimate.simulated, len(estimate.covariance_order)
    )
    verdict, reasons = judge(overall, notices, found.get("residual_to_noise"), white)
    every = _distinct([*notices, *reasons])
    period = sample_time
    if period is None:
        period = min((e.sample_time for e in experiments), default=0.0)
    document = {
        "format": "fluidact-parameters",
        "format_version": 1,
        "family": family.name,
        "variant": variant.name,
        "options": {k: v for k, v in request.options.items() if v is not None},
        "parameters": dict(estimate.parameters),
        "derived": dict(estimate.derived),
        "covariance": {
            "order": list(estimate.covariance_order),
            "matrix": np.asarray(estimate.covariance).tolist(),
        },
        "model": family.model_section(variant, values, float(period), _hold(variant, experiments)),
        "validity": _validity(variant, experiments, estimate.measured),
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
            "logs": [
                _log_entry(e, y, m, unit)
                for e, y, m in zip(experiments, estimate.measured, estimate.simulated)
            ],
            "details": {
                **estimate.details,
                **found,
                "residual_sum_of_squares": overall.sum_of_squares,
            },
        },
        "validation": [_log_entry(s.experiment, s.measured, s.simulated, unit) for s in validation],
        "warnings": every,
        "provenance": {
            "tool": {"name": "fluidact-fit", "version": __version__},
            "created": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
            "command": command or f"fluidact_fit.fit({family.name!r}, ...)",
            "seed": request.seed,
            "logs": [
                _provenance(log, [e for e in experiments if e.log == i])
                for i, log in enumerate(logs)
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
    from .parameters import make_document

    return make_document(document).to_dict(), every


def _provenance(log: Log, experiments: Sequence[Experiment]) -> dict[str, Any]:
    """Entry of one log, with how its moving inputs were taken to move."""
    entry = provenance(log, experiments)
    for role, signal in experiments[0].signals.items() if experiments else ():
        if signal.hold == "foh":
            entry["columns"][role]["interpolation"] = interpolation(signal)
    return entry


def _output_unit(variant: Variant, experiments: Sequence[Experiment]) -> str:
    return experiments[0].signals[variant.output.name].unit


def _hold(variant: Variant, experiments: Sequence[Experiment]) -> Hold:
    """Hold of the first role that drives the model."""
    for role in variant.roles:
        if role.hold and role.name in experiments[0]:
            return experiments[0].signals[role.name].hold or role.hold
    return "zoh"


def _log_entry(
    experiment: Experiment, measured: FloatArray, simulated: FloatArray, unit: str
) -> dict[str, Any]:
    """One row of ``fit.logs`` or ``validation``."""
    a = agreement([measured], [simulated])
    return {
        "file": experiment.name,
        "samples": a.samples,
        "rmse": {"value": a.rmse, "unit": unit},
        "fit_percent": a.fit_percent,
    }


def _validity(
    variant: Variant, experiments: Sequence[Experiment], measured: Sequence[FloatArray]
) -> dict[str, Any]:
    """Range of every role over the samples that were used."""
    out = {}
    for role in variant.roles:
        if role.name == "time":
            continue
        lows, highs, unit = [], [], role.unit
        for e, y in zip(experiments, measured):
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
