"""Whether a parameter file still describes a machine, and what it predicts for a log."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import LogError, Notice, NotIdentifiedError, UsageError
from .experiment import Experiment, FloatArray, Signal
from .families import get_family
from .family import Family, Quantity, Role, Variant
from .fitting import fit
from .logs import Log, StepInput, share_columns
from .logs import experiments as experiments_of
from .logs.columns import find_column
from .quality import agreement
from .result import FitResult, Simulation
from .units import conversion_factor

if TYPE_CHECKING:
    from .parameters import ParameterDocument

RMSE_FACTOR = 2.0  # of the file's own rmse, plus one resolution step of the output
MOST_STD_ERRORS = 4.0
LEAST_RELATIVE = 0.02
_MOST_SAMPLES = 5_000_000


@dataclass(frozen=True)
class LogCheck:
    """One run of a log simulated with the file's parameters.

    ``rmse`` and ``limit`` are in ``unit``; ``within`` says whether the rmse is below.
    """

    file: str
    samples: int
    rmse: float
    limit: float
    unit: str
    fit_percent: float
    within: bool


@dataclass(frozen=True)
class Drift:
    """A parameter in the file and as the new logs have it [``unit``].

    ``combined_error`` is the root of the sum of both squared standard errors, ``sigmas``
    the distance in these, ``percent`` the distance relative to the file (``None`` where
    that is zero).
    """

    name: str
    unit: str
    before: float
    now: float
    combined_error: float
    sigmas: float
    percent: float | None
    moved: bool


@dataclass(frozen=True)
class Check:
    """The outcome of a check."""

    family: str
    fits: bool
    reasons: tuple[str, ...]
    logs: tuple[LogCheck, ...]
    drifts: tuple[Drift, ...]
    notices: tuple[Notice, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return plain mappings, lists, text and numbers."""
        found = asdict(self)
        return {**found, **{k: list(found[k]) for k in ("reasons", "logs", "drifts", "notices")}}


def roles_of(document: ParameterDocument) -> list[str]:
    """Names of the roles of a document's variant."""
    return [role.name for role in _variant(document, get_family(document.family)).roles]


def recall_columns(document: ParameterDocument, log: Log) -> Log:
    """Bind a log's columns as the file's own logs were bound, where nothing else was said.

    Of the logs in the provenance, the one counts of whose headers the log has most; for
    roles without one, columns named like the roles are taken as ever.
    """
    sources = document.provenance.logs
    if not sources:
        return log
    fitting = [_present(log, source.columns) for source in sources]
    best = max(range(len(sources)), key=lambda i: len(fitting[i]))
    known = _apply(log, fitting[best])
    timed = "time" in {*sources[best].columns, *log.bindings}
    if not timed and log.sample_time is None and sources[best].sample_time:
        known = replace(known, sample_time=sources[best].sample_time)
    return known


def _present(log: Log, columns: Mapping[str, Mapping[str, Any]]) -> dict[str, Mapping[str, Any]]:
    """Entries of a provenance that a log can follow and the user did not replace."""
    return {
        role: entry
        for role, entry in columns.items()
        if role not in log.bindings and ("header" not in entry or _has(log, role, entry["header"]))
    }


def _has(log: Log, role: str, header: str) -> bool:
    try:
        find_column(log, role, header)
    except LogError:
        return False
    return True


def _apply(log: Log, remembered: Mapping[str, Mapping[str, Any]]) -> Log:
    bindings, units = dict(log.bindings), dict(log.units)
    scales, steps, holds = dict(log.scales), dict(log.steps), dict(log.holds)
    for role, entry in remembered.items():
        if "hold" in entry and "step" not in entry:
            holds.setdefault(role, entry["hold"])
        if role in log.steps or (role == "time" and log.sample_time is not None):
            continue
        if "step" in entry:
            step = entry["step"]
            steps[role] = StepInput(step["from"], step["to"], step["at"])
        elif "header" in entry:
            bindings[role] = entry["header"]
        if not entry.get("assumed"):
            units.setdefault(role, entry["unit"])
        if "scale" in entry:
            scales.setdefault(role, entry["scale"])
    return replace(log, bindings=bindings, units=units, scales=scales, steps=steps, holds=holds)


def _variant(document: ParameterDocument, family: Family) -> Variant:
    """The variant of a document; a single one need not be named."""
    return next((v for v in family.variants if v.name == document.variant), family.variants[0])


def _options(document: ParameterDocument, family: Family) -> dict[str, Any]:
    return {**{o.name: o.default for o in family.options}, **(document.options or {})}


def simulate_log(document: ParameterDocument, log: Log) -> tuple[list[Simulation], list[Notice]]:
    """Simulate a document's model with the inputs of a log.

    Parameters
    ----------
    document
        The parameter file.
    log
        Its output role may be missing; ``measured`` is then NaN.

    Returns
    -------
    tuple
        One simulation per run, and the warnings of preparing the log.

    Raises
    ------
    UsageError, LogError
        When the log does not have what the model needs.
    """
    family = get_family(document.family)
    variant = _variant(document, family)
    roles = tuple(replace(r, required=r.required and not r.output) for r in variant.roles)
    runs, notices = experiments_of(log, replace(variant, roles=roles))
    options, values = _options(document, family), document.values()
    found = []
    for run in runs:
        simulated = np.asarray(family.simulate(variant, values, run, options), dtype=float)
        output = variant.output.name
        measured = run[output] if output in run else np.full(simulated.shape, np.nan)
        found.append(Simulation(run, simulated, measured))
    return found, notices


def simulate_steps(
    document: ParameterDocument,
    inputs: Mapping[str, StepInput],
    units: Mapping[str, str],
    duration: float,
    sample_time: float,
) -> list[Simulation]:
    """Simulate a document's model with inputs that step, without any log.

    Parameters
    ----------
    document
        The parameter file.
    inputs
        Role to step [SI, or the unit given].
    units
        Role to unit of its levels.
    duration, sample_time
        [s]

    Raises
    ------
    UsageError
        When an input is missing or there would be too many samples.
    """
    family = get_family(document.family)
    variant = _variant(document, family)
    roles = [r for r in variant.roles if r.name != "time" and not r.output]
    for role in roles:
        if role.required and role.name not in inputs:
            raise UsageError(
                f"the input '{role.name}' is missing.",
                remedy=f"Give --input {role.name}=FROM:TO[@T], or a LOG.",
            )
    samples = duration / sample_time
    if not 2 <= samples <= _MOST_SAMPLES:
        raise UsageError(
            f"{duration:g} s in steps of {sample_time:g} s are {samples:.3g} samples.",
            expected=f"Expected 2 to {_MOST_SAMPLES}.",
            remedy="Change --duration or --sample-time.",
        )
    time = sample_time * np.arange(round(samples) + 1, dtype=np.float64)
    signals = {r.name: _step(r, inputs[r.name], units, time) for r in roles if r.name in inputs}
    run = Experiment("inputs", 0, time, signals, sample_time, True)
    values, options = document.values(), _options(document, family)
    simulated = np.asarray(family.simulate(variant, values, run, options), dtype=float)
    return [Simulation(run, simulated, np.full(simulated.shape, np.nan))]


def _step(role: Role, step: StepInput, units: Mapping[str, str], time: FloatArray) -> Signal:
    """A stepped input: one node for a dynamic model, sample by sample for a static one."""
    factor = conversion_factor(units.get(role.name, role.unit), role.unit, f"--unit {role.name}")
    at, values = np.array([step.at]), np.array([step.end])
    if role.hold is None:
        at, values = time, np.where(time >= step.at, step.end, step.start)
    size = abs(step.end - step.start) * factor
    before = step.start * factor
    return Signal(role.name, at, values * factor, role.unit, "zoh", before, size)


def check_logs(
    document: ParameterDocument,
    logs: Sequence[Log],
    *,
    progress: Callable[[str], None] | None = None,
) -> Check:
    """Compare a parameter file with new logs of the machine.

    Parameters
    ----------
    document
        The parameter file.
    logs
        New logs.
    progress
        Called with a line of text now and then.

    Returns
    -------
    Check
        ``fits`` is false when the rmse of a run is above ``RMSE_FACTOR`` times the file's
        plus one resolution step of the output, or a parameter moved by more than
        ``MOST_STD_ERRORS`` combined standard errors and by more than ``LEAST_RELATIVE``.

    Raises
    ------
    UsageError, LogError
        When a log does not have what the model needs.
    """
    say = progress or (lambda message: None)
    logs = share_columns(logs)
    variant = _variant(document, get_family(document.family))
    say("simulating")
    simulations: list[Simulation] = []
    notices: list[Notice] = []
    for log in logs:
        some, said = simulate_log(document, log)
        simulations += some
        notices += said
    _require_output(logs, simulations, variant)
    say("fitting again")
    again, refused = _fit_again(document, logs, progress)
    masks = again.estimate.measured if again else [s.measured for s in simulations]
    checks = tuple(_check_log(document, s, m, variant) for s, m in zip(simulations, masks))
    drifts = _compare(document.quantities(), again.parameters) if again else ()
    reasons = _reasons(checks, drifts)
    every = tuple(dict.fromkeys([*notices, *refused]))
    return Check(document.family, not reasons, reasons, checks, drifts, every)


def _require_output(
    logs: Sequence[Log], simulations: Sequence[Simulation], variant: Variant
) -> None:
    for simulation in simulations:
        if variant.output.name not in simulation.experiment:
            raise LogError(
                f"no column is named '{variant.output.name}', so there is nothing to compare.",
                where=simulation.experiment.name,
                remedy=f"Give --column {variant.output.name}=HEADER (or #N).",
            )


def _fit_again(
    document: ParameterDocument, logs: Sequence[Log], progress: Callable[[str], None] | None
) -> tuple[FitResult | None, list[Notice]]:
    """Fit the same model to the new logs; ``None`` when they cannot determine it."""
    given = document.provenance.options or {}
    options: dict[str, Any] = {
        name.replace("-", "_"): tuple(value) if isinstance(value, list) else value
        for name, value in (document.options or {}).items()
    }
    try:
        result = fit(
            document.family,
            logs,
            fixed=given.get("fixed"),
            bounds={k: (v[0], v[1]) for k, v in (given.get("bounds") or {}).items()},
            seed=document.provenance.seed or 0,
            progress=progress,
            **options,
        )
    except NotIdentifiedError as error:
        text = " ".join(str(error).split())
        message = f"the parameters could not be compared, only the simulation was: {text}"
        return None, [Notice("not-compared", message)]
    return result, []


def _check_log(
    document: ParameterDocument, simulation: Simulation, mask: FloatArray, variant: Variant
) -> LogCheck:
    """Compare one run; samples that a fit leaves out (NaN in ``mask``) are left out."""
    measured = np.where(np.isfinite(mask), simulation.measured, np.nan)
    found = agreement([measured], [simulation.simulated])
    signal = simulation.experiment.signals[variant.output.name]
    limit = RMSE_FACTOR * document.fit.rmse.value + signal.resolution
    return LogCheck(
        file=simulation.experiment.name,
        samples=found.samples,
        rmse=found.rmse,
        limit=limit,
        unit=signal.unit,
        fit_percent=found.fit_percent,
        within=found.rmse <= limit,
    )


def _compare(before: Mapping[str, Quantity], now: Mapping[str, Quantity]) -> tuple[Drift, ...]:
    """Compare all numbers, list entries too, that both sides give a standard error."""
    drifts = []
    for name, old in before.items():
        new = now.get(name)
        if new is None or old.status != "estimated" or new.status != "estimated":
            continue
        parts = [np.atleast_1d(np.asarray(q, dtype=float)) for q in (
            old.value, new.value, _errors(old), _errors(new))]  # fmt: skip
        if len({p.shape for p in parts}) > 1 or parts[0].ndim > 1:
            continue
        labels = [name] if parts[0].size == 1 else [f"{name}[{i}]" for i in range(parts[0].size)]
        for label, a, b, error_a, error_b in zip(labels, *parts):
            if math.hypot(error_a, error_b) > 0.0:
                drifts.append(_drift(label, old.unit, a, b, math.hypot(error_a, error_b)))
    return tuple(drifts)


def _errors(quantity: Quantity) -> Any:
    return [] if quantity.std_error is None else quantity.std_error


def _drift(name: str, unit: str, before: float, now: float, error: float) -> Drift:
    sigmas = abs(now - before) / error
    relative = (now - before) / abs(before) if before else None
    moved = sigmas > MOST_STD_ERRORS and (relative is None or abs(relative) > LEAST_RELATIVE)
    percent = None if relative is None else 100.0 * float(relative)
    return Drift(name, unit, float(before), float(now), error, float(sigmas), percent, bool(moved))


def _reasons(logs: Sequence[LogCheck], drifts: Sequence[Drift]) -> tuple[str, ...]:
    found = [
        f"{log.file}: rmse {log.rmse:.4g} {log.unit} is above the limit of {log.limit:.4g} "
        f"{log.unit}."
        for log in logs
        if not log.within
    ]
    for drift in drifts:
        if drift.moved:
            by = "" if drift.percent is None else f" ({drift.percent:+.1f} %)"
            found.append(
                f"{drift.name} moved from {drift.before:.6g} to {drift.now:.6g} {drift.unit}{by}, "
                f"{drift.sigmas:.1f} combined standard errors."
            )
    return tuple(found)


def to_csv(document: ParameterDocument, simulations: Sequence[Simulation]) -> str:
    """Return simulations as CSV: time, signals, simulated output; all in SI."""
    text = io.StringIO()
    output = _variant(document, get_family(document.family)).output
    header = f"{output.name}_simulated [{output.unit}]"
    several = len(simulations) > 1
    for number, simulation in enumerate(simulations, start=1):
        columns = {**({"run": np.full(simulation.simulated.shape, number)} if several else {}),
                   **_columns(simulation.experiment, simulation.simulated, header)}  # fmt: skip
        if number == 1:
            text.write(",".join(columns) + "\n")
        for row in zip(*columns.values()):
            text.write(",".join(f"{value:.12g}" for value in row) + "\n")
    return text.getvalue()


def _columns(experiment: Experiment, simulated: FloatArray, header: str) -> dict[str, FloatArray]:
    """Columns by header, inputs that stepped written out on the samples."""
    columns: dict[str, FloatArray] = {}
    if experiment.time.size:
        columns["time [s]"] = experiment.time
    for role, signal in experiment.signals.items():
        columns[f"{role} [{signal.unit}]"] = experiment.sampled(role)
    columns[header] = simulated
    return columns
