"""Whether a parameter file still describes a machine."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from .errors import LogError, Notice, NotIdentifiedError
from .experiment import Experiment
from .family import Quantity, Variant
from .fitting import refit
from .logs import Log
from .outcome import Simulation
from .parameters.document import ParameterDocument
from .simulation import prepare_logs, recall_logs, simulate_runs, variant_of

RMSE_FACTOR = 2.0  # of the file's own rmse, plus one resolution step of the output
MOST_STD_ERRORS = 4.0
LEAST_RELATIVE = 0.02


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
    """A parameter in the file and in the new logs [``unit``].

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
        """Return plain mappings, tuples, text and numbers."""
        return asdict(self)


def check_logs(
    document: ParameterDocument,
    logs: Sequence[Log],
    *,
    progress: Callable[[str], None] | None = None,
) -> Check:
    """Compare a parameter file with new logs of the machine.

    It no longer ``fits`` when the rmse of a run is above ``RMSE_FACTOR`` times the file's plus one
    resolution step of the output, or a parameter moved by more than ``MOST_STD_ERRORS`` combined
    standard errors and by more than ``LEAST_RELATIVE``.

    Raises
    ------
    UsageError, LogError
        When a log does not have what the model needs.
    """
    say = progress or (lambda message: None)
    say("simulating")
    logs = recall_logs(document, logs)
    variant = variant_of(document)
    runs, notices = prepare_logs(document, logs)
    _require_output(runs, variant)
    simulations = simulate_runs(document, runs)
    drifts: tuple[Drift, ...] = ()
    before = document.quantities()
    if any(q.std_error is not None for q in before.values() if q.status == "estimated"):
        say("fitting again")
        try:
            drifts = _compare(before, refit(document, logs, progress=progress))
        except NotIdentifiedError as error:
            text = " ".join(error.text.split())
            message = f"only the simulation was compared, not the parameters: {text}"
            notices.append(Notice("not-compared", message))
    checks = tuple(_check_log(document, s, variant) for s in simulations)
    reasons = _reasons(checks, drifts)
    return Check(
        document.family, not reasons, reasons, checks, drifts, tuple(dict.fromkeys(notices))
    )


def _require_output(runs: Sequence[Experiment], variant: Variant) -> None:
    for run in runs:
        if variant.output.name not in run:
            raise LogError(
                f"no column is named '{variant.output.name}', so there is nothing to compare with.",
                where=run.name,
                remedy=f"Give --column {variant.output.name}=HEADER (or #N).",
            )


def _check_log(document: ParameterDocument, simulation: Simulation, variant: Variant) -> LogCheck:
    """Compare one run over the samples that the model claims to describe."""
    found = simulation.agreement
    signal = simulation.experiment.signals[variant.output.name]
    limit = RMSE_FACTOR * document.fit.rmse.value + signal.resolution
    return LogCheck(simulation.experiment.name, found.samples, found.rmse, limit, signal.unit,
                    found.fit_percent, found.rmse <= limit)  # fmt: skip


def _compare(before: Mapping[str, Quantity], now: Mapping[str, Quantity]) -> tuple[Drift, ...]:
    """Compare all numbers, list entries too, that have a standard error on both sides."""
    drifts = []
    for name, old in before.items():
        new = now.get(name)
        if new is None or old.status != "estimated" or new.status != "estimated":
            continue
        errors = ([] if q.std_error is None else q.std_error for q in (old, new))
        parts = [np.atleast_1d(np.asarray(q, dtype=float)) for q in (old.value, new.value, *errors)]
        if len({p.shape for p in parts}) > 1 or parts[0].ndim > 1:
            continue
        labels = [name] if parts[0].size == 1 else [f"{name}[{i}]" for i in range(parts[0].size)]
        for label, a, b, error_a, error_b in zip(labels, *parts):
            if (error := math.hypot(error_a, error_b)) > 0.0:
                drifts.append(_drift(label, old.unit, a, b, error))
    return tuple(drifts)


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
