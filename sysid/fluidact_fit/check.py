"""Check of a parameter file against new logs of its machine."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Unpack

import numpy as np

from .alignment import Estimates, align
from .assessment.policy import FIT_WEAK
from .document_assembly import limits_of
from .errors import MismatchError, Notice, NotIdentifiedError, UsageError, in_python, listed
from .families import get_family
from .family import Quantity
from .fitting import refit
from .logs import Log, LogLike, Reading
from .parameter_table import recorded_units
from .parameters.document import ParameterDocument
from .presentation import ParametersLike, document_of, weak_file
from .recall import open_as_fitted, recall_logs
from .simulation import prepare_logs, simulate_runs, variant_of
from .tables import Shown, Table, format_number, format_spread, percent_text
from .units import after_number, display_unit

MOST_STD_ERRORS = 4.0
LEAST_RELATIVE = 0.02
_NAMED = 4  # logs of a message


@dataclass(frozen=True)
class LogCheck:
    """One run of a log simulated with the file's parameters.

    ``rmse`` and ``limit`` are in ``unit``; ``within`` says whether the rmse is below. ``spread``
    is the rms [``unit``] by which the errors of the file's parameters move the simulated output:
    it is asked for, and part of the limit, where the rmse would be above it otherwise.
    """

    file: str
    samples: int
    rmse: float
    limit: float
    unit: str
    fit_percent: float
    within: bool
    spread: float = 0.0

    @property
    def tells(self) -> bool:
        """Return whether the output moves by more than any model may miss it by."""
        left = 1.0 - self.fit_percent / 100.0
        return left <= 0.0 or self.rmse > left * self.limit


@dataclass(frozen=True)
class Drift:
    """A parameter in the file and in the new logs [``unit``].

    ``combined_error`` is the standard error of the difference, ``sigmas`` the distance in these,
    ``percent`` the distance relative to the file (``None`` where that is zero). ``held`` are
    parameters that the new logs cannot tell: ``now`` is the value with these as in the file.
    """

    name: str
    unit: str
    before: float
    now: float
    combined_error: float
    sigmas: float
    percent: float | None
    moved: bool
    held: tuple[str, ...] = ()


@dataclass(frozen=True)
class Check(Shown):
    """The outcome of a check [SI]; its tables are in the ``recorded_units`` where these suit."""

    family: str
    fits: bool
    reasons: tuple[str, ...]
    logs: tuple[LogCheck, ...]
    drifts: tuple[Drift, ...]
    notices: tuple[Notice, ...]
    recorded_units: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return plain mappings, tuples, text and numbers."""
        return asdict(self)

    def table(self) -> Table:
        """Return the parameters in the file and in the new logs, as a table that shows itself."""
        head = ("parameter", "file", "now", "combined error", "unit", "std errors", "moved by", "")
        rows = tuple(_drift_cells(d, self.recorded_units) for d in self.drifts)
        return Table(head, rows, right=(1, 2, 5, 6), drop=(3,))

    def log_table(self) -> Table:
        """Return how well the file describes every run, as a table that shows itself."""
        rows = tuple(
            (log.file, percent_text(log.fit_percent), *_rmse_and_limit(log, self.recorded_units),
             "" if log.within else "TOO LARGE")
            for log in self.logs
        )  # fmt: skip
        return Table(("log", "fit", "rmse", "limit", ""), rows, right=(1, 2, 3))

    def parts(self) -> list[Table | str]:
        """Return verdict, agreement with the logs, drift of the parameters, and what was said."""
        notices = (f"({n.code}) {in_python(n.message)}" for n in self.notices)
        said = "\n".join([*self.reasons, *notices])
        return [f"{self.family}: {self.headline}", self.log_table(), self.table(), said]

    @property
    def headline(self) -> str:
        """The outcome, a clause: a log in which nothing happens contradicts no model."""
        if not self.fits:
            return "the model no longer fits"
        percents = [log.fit_percent for log in self.logs if log.fit_percent is not None]
        weak = not self.drifts and percents and max(percents) < FIT_WEAK
        if weak or not any(log.tells for log in self.logs):
            return "these logs do not contradict the model, and show too little to confirm it"
        return "the model still fits"

    def raise_for_mismatch(self, where: str = "") -> None:
        """Refuse a model that no longer fits, ``where`` being what holds it.

        Raises
        ------
        MismatchError
            When it does not; the reasons are in it.
        """
        if not self.fits:
            raise MismatchError(
                "the model no longer fits.",
                where=where,
                expected="\n".join(self.reasons),
                remedy="Look at what changed in the machine, then fit again.",
            )


def _rmse_and_limit(log: LogCheck, units: Sequence[str]) -> tuple[str, str]:
    """Both with one unit, or they could not be compared at a glance."""
    shown = display_unit(log.unit, max(log.rmse, log.limit), units)
    unit = after_number(shown.unit)
    return f"{log.rmse * shown.factor:.4g}{unit}", f"{log.limit * shown.factor:.4g}{unit}"


def _drift_cells(d: Drift, units: Sequence[str]) -> tuple[str, ...]:
    shown = display_unit(d.unit, max(abs(d.before), abs(d.now)), units)
    error = d.combined_error * shown.factor
    return (
        d.name,
        format_number(d.before * shown.factor, error),
        format_number(d.now * shown.factor, error),
        f"± {format_spread(error)}",
        shown.unit,
        f"{d.sigmas:.1f}",
        "" if d.percent is None else percent_text(d.percent, "+.2f"),
        "MOVED" if d.moved else "",
    )


def check(
    params: ParametersLike,
    logs: Sequence[LogLike] | LogLike,
    *,
    progress: Callable[[str], None] | None = None,
    **reading: Unpack[Reading],
) -> Check:
    """Check whether parameters still describe the machine that recorded some logs.

    Each log is simulated with the parameters, and the family is fitted again to compare them; see
    :func:`check_logs` for when they no longer fit. Nothing is raised for that: look at ``fits``,
    or call ``raise_for_mismatch()``.

    Parameters
    ----------
    params
        A parameter file, or a result or model.
    logs
        Paths, DataFrames, mappings of header to array, or logs that have been read. Their columns
        are those the parameters were fitted with, unless ``reading`` says otherwise.
    progress
        Called with progress messages.
    **reading
        How logs are read, as for a fit (:class:`.logs.Reading`).

    Raises
    ------
    ParameterFileError
        When the file is not valid.
    UsageError, LogError
        When a log does not have what the model needs.
    NotIdentifiedError
        When there is nothing to compare.
    """
    document = document_of(params, get_family)
    opened = open_as_fitted(document, logs, **reading)
    if not opened:
        raise UsageError("no log was given.", expected="Expected one log or more.")
    return check_logs(document, opened, progress=progress)


def check_logs(
    document: ParameterDocument,
    logs: Sequence[Log],
    *,
    progress: Callable[[str], None] | None = None,
) -> Check:
    """Compare a parameter file with new logs of the machine.

    Parameters that the file has estimated and the new logs cannot tell are held at the values of
    the file, and the others compared with these held; the errors of the difference are then those
    of both, with what the file does not know of the parameters held.

    It no longer ``fits`` when the file's own verdict is ``fail``, the rmse of a run is above its
    limit (:func:`.limits_of`), or a parameter moved by more than ``MOST_STD_ERRORS`` combined
    standard errors and by more than ``LEAST_RELATIVE``.
    Parameters that depend on what a log covered are compared over what is common.

    Raises
    ------
    UsageError, LogError
        When a log does not have what the model needs.
    """
    say = progress or (lambda message: None)
    say("simulating")
    logs = recall_logs(document, logs)
    variant = variant_of(document)
    runs, notices = prepare_logs(document, logs, output=True)
    notices = [*weak_file(document), *notices]
    simulations = simulate_runs(document, runs)
    drifts: tuple[Drift, ...] = ()
    before = document.quantities()
    if any(q.std_error is not None for q in before.values() if q.status == "estimated"):
        say("fitting again")
        try:
            refitted = _refit(document, logs, progress)
            (own, new), about = align(
                get_family(document.family), [Estimates.of(document), refitted.found]
            )
            drifts = _compare(own, replace(refitted, found=new))
            notices += _partly_compared(refitted.held, logs)
            notices += [Notice("compared-in-common", f"{about}.")] if about else []
        except NotIdentifiedError as error:
            text = " ".join(f"{error.what} {error.remedy}".split())
            message = f"only the simulation was compared, not the parameters: {text}"
            notices.append(Notice("not-compared", message))
    unit = simulations[0].experiment.signals[variant.output.name].unit if simulations else ""
    checks = tuple(
        LogCheck(s.experiment.name, s.agreement.samples, s.rmse, limit, unit,
                 s.agreement.fit_percent, s.rmse <= limit, spread)
        for s, (limit, spread) in zip(simulations, limits_of(document, simulations))
    )  # fmt: skip
    notices += _uncertain(checks, bool(drifts))
    if not drifts and not any(c.samples for c in checks):
        _refuse_empty(checks)
    units = recorded_units(document)
    reasons = (*_never_fitted(document), *_reasons(checks, drifts, units))
    return Check(
        document.family, not reasons, reasons, checks, drifts, tuple(dict.fromkeys(notices)), units
    )


def _uncertain(checks: Sequence[LogCheck], compared: bool) -> list[Notice]:
    """Say which logs the file predicts too poorly for their rmse to tell anything."""
    files = [c.file for c in checks if c.within and c.spread]
    if not files:
        return []
    return [
        Notice(
            "prediction-uncertain",
            f"{', '.join(files)}: the errors of the file's parameters move the simulated output "
            "by as much as it is off, so the rmse does not tell whether the machine has changed"
            + ("; the parameters are compared. " if compared else ". ")
            + "A file fitted to several logs predicts better.",
        )
    ]


def _refuse_empty(checks: Sequence[LogCheck]) -> None:
    raise NotIdentifiedError(
        "the model describes no sample of the logs, and they determine no parameter.",
        where=", ".join(dict.fromkeys(c.file for c in checks)),
        expected="Nothing was compared.",
        remedy="Check with logs that move the machine as those of the fit did.",
    )


@dataclass(frozen=True)
class _Refitted:
    """Parameters of the new logs, ``held`` ones at the values of the file.

    ``slopes`` are the changes of the others per change of a held one.
    """

    found: Estimates
    held: tuple[str, ...] = ()
    slopes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def _refit(
    document: ParameterDocument, logs: Sequence[Log], progress: Callable[[str], None] | None
) -> _Refitted:
    """Fit the new logs, with what they cannot tell held as in the file."""
    before = document.quantities()
    numbers = _numbers({n: q for n, q in before.items() if q.status == "estimated"})
    held: dict[str, float] = {}
    found = Estimates.of_fit(refit(document, logs, progress=progress))
    while more := {
        n: v for n, v in numbers.items() if n not in held and _is_lost(found.quantities.get(n))
    }:
        held |= more
        found = _refit_with(document, logs, held, progress)
    slopes = {}
    for name, value in held.items():
        step = _error_of(before[name]) or abs(value) * 1e-3
        if step > 0.0:
            changed = _refit_with(document, logs, {**held, name: value + step}, progress)
            after = _numbers(changed.quantities)
            slopes[name] = {
                n: (after[n] - now) / step
                for n, now in _numbers(found.quantities).items()
                if n in numbers and n not in held
            }
    return _Refitted(found, tuple(held), slopes)


def _refit_with(
    document: ParameterDocument,
    logs: Sequence[Log],
    held: Mapping[str, float],
    progress: Callable[[str], None] | None,
) -> Estimates:
    """Fit with parameters held; some families cannot hold every one."""
    try:
        return Estimates.of_fit(refit(document, logs, fixed=held, progress=progress))
    except UsageError as error:
        raise NotIdentifiedError(
            f"they cannot determine {', '.join(held)}, and there is no fit with these held as in "
            f"the file ({error.what})."
        ) from error


def _numbers(quantities: Mapping[str, Quantity]) -> dict[str, float]:
    return {n: float(q.value) for n, q in quantities.items() if not isinstance(q.value, list)}


def _is_lost(q: Quantity | None) -> bool:
    return q is not None and q.status == "not_identified"


def _error_of(q: Quantity) -> float:
    return q.std_error if isinstance(q.std_error, float) else 0.0


def _partly_compared(held: Sequence[str], logs: Sequence[Log]) -> list[Notice]:
    if not held:
        return []
    names, one = ", ".join(held), len(held) == 1
    return [
        Notice(
            "compared-in-part",
            f"{listed([log.name for log in logs], _NAMED)} cannot "
            f"determine {names}: {'it is' if one else 'they are'} held as in the file, and the "
            f"other parameters are compared with {'that' if one else 'those'}.",
        )
    ]


def _compare(own: Estimates, refitted: _Refitted) -> tuple[Drift, ...]:
    """Compare all numbers, list entries too, that have a standard error on both sides."""
    drifts = []
    for name, old in own.quantities.items():
        new = refitted.found.quantities.get(name)
        if new is None or old.status != "estimated" or new.status != "estimated":
            continue
        if name in refitted.held:
            continue
        errors = ([] if q.std_error is None else q.std_error for q in (old, new))
        parts = [np.atleast_1d(np.asarray(q, dtype=float)) for q in (old.value, new.value, *errors)]
        if len({p.shape for p in parts}) > 1 or parts[0].ndim > 1:
            continue
        labels = [name] if parts[0].size == 1 else [f"{name}[{i}]" for i in range(parts[0].size)]
        slopes = {held: own[name] for held, own in refitted.slopes.items() if own.get(name)}
        for label, a, b, error_a, error_b in zip(labels, *parts):
            of_file = _combined(own, label, slopes) if slopes else error_a
            if (error := math.hypot(of_file, error_b)) > 0.0:
                drifts.append(_drift(label, old.unit, a, b, error, tuple(slopes)))
    return tuple(drifts)


def _combined(own: Estimates, name: str, slopes: Mapping[str, float]) -> float:
    """Standard error of what the file expects of a parameter with others held."""
    weights = {name: -1.0, **slopes}
    if not set(weights) <= set(own.order):
        return math.hypot(*(w * _error_of(own.quantities[n]) for n, w in weights.items()))
    at = [own.order.index(n) for n in weights]
    matrix = own.covariance[np.ix_(at, at)]
    w = np.array(list(weights.values()))
    return math.sqrt(max(float(w @ matrix @ w), 0.0))


def _drift(
    name: str, unit: str, before: float, now: float, error: float, held: tuple[str, ...]
) -> Drift:
    sigmas = abs(now - before) / error
    relative = (now - before) / abs(before) if before else None
    moved = sigmas > MOST_STD_ERRORS and (relative is None or abs(relative) > LEAST_RELATIVE)
    percent = None if relative is None else 100.0 * float(relative)
    return Drift(
        name, unit, float(before), float(now), error, float(sigmas), percent, bool(moved), held
    )


def _never_fitted(document: ParameterDocument) -> tuple[str, ...]:
    """A file that did not describe the logs it was fitted to describes no others."""
    if document.fit.verdict != "fail":
        return ()
    percent = percent_text(document.fit.fit_percent)
    return (f"the file has the verdict FAIL: it did not describe its own logs (fit {percent}).",)


def _reasons(
    logs: Sequence[LogCheck], drifts: Sequence[Drift], units: Sequence[str]
) -> tuple[str, ...]:
    found = [
        "{}: rmse {} is above the limit of {}.".format(log.file, *_rmse_and_limit(log, units))
        for log in logs
        if not log.within
    ]
    for drift in drifts:
        if drift.moved:
            _, before, now, _, unit, sigmas, percent, _ = _drift_cells(drift, units)
            by = f" ({percent})" if percent else ""
            given = f", with {', '.join(drift.held)} as in the file" if drift.held else ""
            found.append(
                f"{drift.name} moved from {before} to {now}{after_number(unit)}{by}, {sigmas} "
                f"combined standard errors{given}."
            )
    return tuple(found)
