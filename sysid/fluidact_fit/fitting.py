"""The one way from logs to a result."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import ceil, inf
from typing import Any, TypeVar, cast

import numpy as np
from threadpoolctl import threadpool_limits

from .arguments import number_in_si, pair_in_si, require, require_given, shown
from .assessment import find_cause, find_implausible, most_outliers, set_aside
from .document_assembly import FitContext, make_parameter_document
from .errors import (
    LogError,
    Notice,
    NotIdentifiedError,
    ParameterFileError,
    UsageError,
    check_names,
)
from .estimation.budget import Budget, counting
from .estimation.inputs import settle_holds
from .experiment import Experiment
from .families import get_family
from .family import Family, FamilyOptions, ParameterDocument, Request, Solution, Variant
from .logs import (
    Log,
    LogLike,
    Reading,
    choose_variant,
    find_constant_signals,
    find_copied_rows,
    open_logs,
    provenance,
    refuse_fitted_rows,
    require_agreement,
    require_two_signals,
    share_columns,
)
from .logs import experiments as experiments_of
from .logs.experiments import LONGEST, SHORTEST
from .logs.kinds import check_window
from .logs.opening import in_seconds, listed_logs, window_in_seconds
from .logs.source import files_of
from .notices import is_note
from .other_structure import find_other_structure
from .outcome import Simulation
from .result import FitResult
from .specification import ParameterSpec, Role
from .units import after_number

_MOST_SAMPLES = 20_000_000  # of a fit: it keeps some 100 bytes of each
_AT_END = 1e-6  # of the width of given bounds, within which an estimate is at their end
_FEWEST = 8  # samples of a log that is fitted or judged
_ROUNDS = 3  # fits without outliers: one may have hidden the next

Window = tuple[float | None, float | None] | None
_F = TypeVar("_F", bound=Callable[..., Any])


def _on_one_thread(function: _F) -> _F:
    """Let a function compute on one thread, the examinations of a fit included.

    Matrices are small: sharing one out among threads costs more than the product, most of all on
    a busy machine, and the last digits would depend on how many there are.
    """
    return cast("_F", threadpool_limits.wrap(limits=1, user_api="blas")(function))


@_on_one_thread
def fit(
    family: str,
    logs: Sequence[LogLike] | Iterator[LogLike] | LogLike,
    *,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    scales: Mapping[str, float] | None = None,
    sample_time: float | None = None,
    window: tuple[float | None, float | None] | None = None,
    hold: Mapping[str, str] | None = None,
    fixed: Mapping[str, float | str] | None = None,
    start: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float | str, float | str]] | None = None,
    noise: Mapping[str, float | str] | None = None,
    validate: Sequence[LogLike] | LogLike = (),
    validate_window: tuple[float | None, float | None] | None = None,
    controller_sample_time: float | None = None,
    strict: bool = False,
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
        Paths, DataFrames, mappings of header to array, or logs that :func:`read_log` has read.
        Of those of an iterator nothing is kept but what is used, which halves the memory of long
        ones.
    columns, units, scales, sample_time
        How they and those of ``validate`` are read, where their columns are not named like the
        roles; see :func:`read_log`.
    window
        Part of the logs to fit [s], ``None`` for an open side.
    hold
        Role to ``"zoh"``, ``"foh"``, ``"smooth"`` or ``"auto"``, instead of the family's default.
    fixed, start, bounds
        By parameter name, in SI or as text with a unit: ``{"dead_time": "12 ms"}``.
    noise
        Standard deviation of white noise on a measured input by role, likewise; 0 where it is
        exact. What is not given is judged from the logs.
    validate
        Logs to validate the result with; they are not fitted.
    validate_window
        Validate with this part of ``validate`` [s], or of the logs that are fitted, whose
        ``window`` then has to leave it out.
    controller_sample_time
        Sample time of the discrete model in the file [s]; default: that of the log.
    strict
        Refuse a result with any warning or note.
    seed
        Seed of the random numbers.
    command
        Written into the file as its provenance.
    progress
        Called with progress messages.
    **options
        The family's own options, with underscores for hyphens, and how logs are read
        (:class:`.logs.Reading`: ``exclude``, ``set``, ``invalid``, ...).

    Returns
    -------
    FitResult

    Raises
    ------
    UsageError, LogError, NotIdentifiedError
        With what was found, where, and what to do.
    StrictError
        When there is a warning or a note under ``strict``.
    """
    require("text", family=family)
    require("truth", strict=strict)
    require_given("mapping", hold=hold, bounds=bounds)
    require_given("function", progress=progress)
    require_given("text", command=command)
    chosen = get_family(family)
    how = {name: options.pop(name) for name in Reading.__annotations__ if name in options}
    units_of = units_of_numbers(chosen)
    units_of_roles = _units_by_name(r for v in chosen.variants for r in v.roles)
    require("seed", seed=seed)
    request = Request(
        options=chosen.options_type.read(options),
        fixed=numbers_in_si("--fix", fixed, units_of),
        start=numbers_in_si("--start", start, units_of),
        bounds={
            name: pair_in_si(f"--bounds {name}={shown(pair)}", pair, units_of.get(name, ()))
            for name, pair in (bounds or {}).items()
        },
        noise=numbers_in_si("--noise", noise, units_of_roles),
        seed=seed,
        progress=progress or (lambda message: None),
    )
    for option, named in (("--fix", fixed), ("--start", start), ("--bounds", bounds)):
        check_names(option, "single-valued parameter", named or {}, units_of)
    if controller_sample_time is not None:
        controller_sample_time = in_seconds("controller_sample_time", controller_sample_time)
        require("number", controller_sample_time=controller_sample_time)
        _check_period(controller_sample_time, LONGEST)
    window, validate_window = window_in_seconds(window), window_in_seconds(validate_window)
    check_window(window)
    check_window(validate_window, "validate_window")
    how |= {"columns": columns, "units": units, "scales": scales, "sample_time": sample_time}
    judged, part = _to_judge(logs, validate, window, validate_window)
    given = _open(  # the logs themselves are not kept
        chosen, request, open_logs(logs, once=True, beside=judged, **how, window=window),
        open_logs(judged, once=True, beside=listed_logs(logs), **how, window=part), hold or {},
    )  # fmt: skip
    experiments, notices = given.experiments, list(given.notices)
    if controller_sample_time is not None:
        _check_period(controller_sample_time, _longest(experiments))
    variant = given.variant.measured_in({r: u for e in experiments for r, u in e.units.items()})
    others: list[Experiment] = []
    more: list[Notice] = []
    if given.judged:
        # their inputs move as those of the fit were settled to
        holds = {r: x.hold for r, x in experiments[0].signals.items() if x.hold is not None}
        others, more = _prepare(_hold(given.judged, holds), given.variant)
        refuse_fitted_rows(given.variant, experiments, others)
    request.progress("fitting")
    with _naming_what_was_read(notices):
        solution = _solve(chosen, variant, experiments, request, advise=True)
    with _blaming_the_numbers():
        sources, declared = given.sources, given.declared
        found = _without_outliers(
            FitContext(chosen, variant, sources, declared, experiments, request, solution)
        )
        validation: list[Simulation] = []
        if others:
            request.progress("validating")
            notices += more
            validation = found.validate(others)
        document, said = make_parameter_document(
            found, validation, notices, controller_sample_time, command
        )
        pairs = list(zip(found.experiments, found.simulated, strict=True))
        view = chosen.static_view(found.plant, pairs)
        result = FitResult(
            family, variant, found.solution, found.fitted, validation, document, said, view,
            given.inputs,
        )  # fmt: skip
    if strict:
        result.raise_for_notices()
    return result


def _to_judge(
    logs: Any, validate: Any, window: Window, validate_window: Window
) -> tuple[list[LogLike], Window]:
    """Logs to validate with, and their part: where none are given, another part of those fitted."""
    if validate_window is None or listed_logs(validate):
        return listed_logs(validate), validate_window
    (a, b), (c, d) = _ends(window), _ends(validate_window)
    if max(a, c) < min(b, d):
        raise UsageError(
            "--validate-window holds seconds that are fitted.",
            expected="Expected two parts of the log that do not overlap.",
            remedy="Give --window as well, so that it leaves out what --validate-window names.",
        )
    if isinstance(logs, Iterator):
        raise UsageError(
            "--validate-window needs the logs twice, and an iterator gives them once.",
            remedy="Give the logs as a list.",
        )
    return listed_logs(logs), validate_window


def _ends(window: Window) -> tuple[float, float]:
    low, high = window or (None, None)
    return -inf if low is None else low, inf if high is None else high


@dataclass(frozen=True)
class _Opened:
    """Experiments to fit, logs that judge the fit, their files, and notices about them."""

    variant: Variant
    experiments: list[Experiment]
    notices: list[Notice]
    sources: list[dict[str, Any]]
    declared: frozenset[str]
    judged: list[Log]
    inputs: list[str]


def _open(
    family: Family[FamilyOptions],
    request: Request[FamilyOptions],
    given: Sequence[Log],
    validate: Sequence[Log],
    holds: Mapping[str, str],
) -> _Opened:
    """Turn the logs that are to be fitted into experiments."""
    if not given:
        raise UsageError("no log was given", remedy="Give at least one CSV file.")
    together = share_columns(_hold([*given, *validate], holds))
    opened, judged = together[: len(given)], together[len(given) :]
    variant = choose_variant(opened, family.variants_for(request.options))
    _check_noise(request.noise, family, variant)
    require_agreement(together, variant)
    experiments, notices = _prepare(opened, variant)
    sources = [
        provenance(log, [e for e in experiments if e.log == i]) for i, log in enumerate(opened)
    ]
    declared = frozenset(role for log in opened for role in log.holds)
    inputs = [os.path.abspath(p) for log in together if log.sha256 for p in files_of(log.path)]
    return _Opened(variant, experiments, notices, sources, declared, judged, inputs)


def units_of_numbers(family: Family[Any]) -> dict[str, list[str]]:
    """Single-valued parameter to the SI units that it has in the variants of a family."""
    return _units_by_name(p for v in family.variants for p in v.parameters if p.rank == 0)


def _units_by_name(declared: Iterable[ParameterSpec | Role]) -> dict[str, list[str]]:
    """Name of a parameter or role to the SI units that it has in the variants of a family."""
    out: dict[str, list[str]] = {}
    for one in declared:
        out.setdefault(one.name, []).append(one.unit)
    return out


def numbers_in_si(
    option: str, given: Mapping[str, Any] | None, units_of: Mapping[str, Sequence[str]]
) -> dict[str, float]:
    """Values by name as finite numbers in SI; ``UsageError`` for anything else."""
    given = {} if given is None else given
    if not isinstance(given, Mapping) or not all(isinstance(n, str) for n in given):
        raise UsageError(
            f"{option}={shown(given)} is not a mapping of name to number.",
            remedy="Give one, as {'dead_time': 0.012}.",
        )
    return {
        name: number_in_si(f"{option} {name}={shown(value)}", value, units_of.get(name, ()))
        for name, value in given.items()
    }


def _check_period(sample_time: float, longest: float) -> None:
    """Refuse a period that no controller has, as those of logs are refused."""
    if not SHORTEST <= sample_time <= longest:
        raise UsageError(
            f"--controller-sample-time {sample_time:g} is impossible",
            expected=f"Expected {SHORTEST:g} to {longest:g} s"
            f"{'' if longest == LONGEST else ', what the longest run lasts'}.",
            remedy="Give the period of the controller in seconds.",
        )


def _longest(experiments: Sequence[Experiment]) -> float:
    """Longest duration of a run [s]."""
    return max((float(e.time[-1] - e.time[0]) for e in experiments if e.time.size), default=LONGEST)


def _check_noise(
    noise: Mapping[str, float], family: Family[FamilyOptions], variant: Variant
) -> None:
    """Refuse noise of what is no input of the model, and levels that are impossible."""
    if noise and not family.allows_for_input_noise:
        raise UsageError(
            f"--noise is not used by {family.name}: its estimate cannot take the noise of an input "
            "from the user.",
            remedy="Leave it out.",
        )
    inputs = [r.name for r in variant.driving]
    for role, sigma in noise.items():
        if role not in inputs:
            raise UsageError(
                f"--noise {role}=...: '{role}' is not an input of the model",
                expected="Its inputs are: " + (", ".join(inputs) or "none") + ".",
                remedy="Noise of the output is estimated from the residual and is not given.",
            )
        if sigma < 0.0:
            raise UsageError(
                f"--noise {role}={sigma:g}: a standard deviation is not negative",
                remedy="Give it in SI, 0 for an exact input.",
            )


@_on_one_thread
def refit(
    document: ParameterDocument,
    logs: Sequence[Log],
    *,
    fixed: Mapping[str, float] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Solution[Any]:
    """Fit the model of a parameter file to other logs, with everything settled as it was.

    Parameters
    ----------
    document
        The file: its family, options, fixed values and bounds.
    logs
        Logs with their columns bound.
    fixed
        Parameters that are held as well, by name [SI].

    Returns
    -------
    Solution

    Raises
    ------
    NotIdentifiedError
        When these logs cannot determine the parameters.
    """
    family = get_family(document.family)
    plant = document.plant(family)
    given = document.provenance.options or {}
    request = Request(
        options=plant.options,
        fixed={**(given.get("fixed") or {}), **(fixed or {})},
        bounds={k: (v[0], v[1]) for k, v in (given.get("bounds") or {}).items()},
        noise=given.get("noise") or {},
        seed=document.provenance.seed or 0,
        progress=progress or (lambda message: None),
    )
    experiments, _ = _prepare(logs, plant.variant)
    return _solve(family, plant.variant, experiments, request)


def _solve(
    family: Family[FamilyOptions],
    variant: Variant,
    experiments: Sequence[Experiment],
    request: Request[FamilyOptions],
    *,
    advise: bool = False,
) -> Solution[FamilyOptions]:
    """Let the family fit; where the arithmetic fails, the data are to blame.

    With ``advise`` a refusal looks for another structure that describes the samples.
    """
    samples = sum(e.samples for e in experiments)
    if samples > _MOST_SAMPLES:
        raise LogError(
            f"the logs hold {samples} samples",
            expected=f"A fit takes {_MOST_SAMPLES} at most. Nothing was written.",
            remedy="Fit a part (--window), or fewer logs: that many samples of the same motion "
            "say no more about the machine.",
        )
    try:
        with _blaming_the_numbers(), counting(samples) as budget:
            found = family.estimate(variant, experiments, request)
            bounded = list(_at_given_bounds(found, request.bounds))
            return _with_search_cost(replace(found, notices=[*bounded, *found.notices]), budget)
    except (NotIdentifiedError, LogError, UsageError) as error:
        causes = find_implausible(family, request.options, variant, experiments)
        if not causes and isinstance(error, NotIdentifiedError):
            causes = [c for c in (find_cause(variant, experiments),) if c is not None]
        if not causes:
            if not isinstance(error, NotIdentifiedError):
                raise
            remedy, option = error.remedy, ""
            if request.given:
                remedy += f"\nOr these logs contradict {request.given}: try without."
            elif advise and (other := find_other_structure(family, variant, experiments, request)):
                option = other.option
                remedy = f"{other.remedy}\nOtherwise: {remedy}"
            raise NotIdentifiedError(
                error.what, where=error.where, expected=error.expected, remedy=remedy, option=option
            ) from error
        raise type(error)(
            " ".join([*(c.words for c in causes), error.what]), where=error.where,
            expected="Nothing was written.", remedy="\n".join(c.remedy for c in causes),
        ) from error  # fmt: skip


def _at_given_bounds(
    found: Solution[FamilyOptions], bounds: Mapping[str, tuple[float, float]]
) -> Iterator[Notice]:
    """Warn of estimates that end where the user's bounds do: the data ask for more."""
    for name, ends in bounds.items():
        known = found.parameters.get(name)
        if known is None or known.status != "estimated":
            continue
        width = _AT_END * (ends[1] - ends[0])
        # wide bounds are not reached by what is many errors away
        if isinstance(known.std_error, float):
            width = min(width, max(known.std_error, _AT_END * abs(known.number)))
        reached = next((end for end in ends if abs(known.number - end) <= width), None)
        if reached is not None:
            yield Notice(
                "at-given-bound",
                f"{name} ends at {reached:.6g}{after_number(known.unit)}, where its --bounds do: "
                "the data ask for a value beyond, and the other parameters make up for it. Widen "
                "the bounds; if they are right, look for what the model lacks.",
            )


def _with_search_cost(found: Solution[FamilyOptions], budget: Budget) -> Solution[FamilyOptions]:
    """The estimate with what its search has cost, where it has simulated anything."""
    if not budget.spent:
        return found
    search = {"simulations": ceil(budget.spent), "at_most": budget.at_most}
    said = [_search_bounded(budget)] if budget.exhausted else []
    return replace(
        found, details={**found.details, "search": search}, notices=[*found.notices, *said]
    )


def _search_bounded(budget: Budget) -> Notice:
    return Notice(
        "search-bounded",
        f"the search was ended after {ceil(budget.spent)} simulations of the logs, of the "
        f"{budget.at_most} that a fit may take: a longer one may find better values. Give --start "
        "values near the right ones, or hold what is known with --fix.",
    )


def _without_outliers(found: FitContext) -> FitContext:
    """Fit again without the outliers that decide; the first fit where that settles nothing."""
    now, samples = found, sum(e.samples for e in found.experiments)
    for _ in range(_ROUNDS + 1):
        found.request.progress("examining the fit")
        more = now.examination.outliers
        if more is None:
            return found
        gone = tuple({o.reading: o for o in (*now.outliers, *more)}.values())
        if not more:
            return now
        if len(gone) > most_outliers(samples):
            return found
        runs = set_aside(now.experiments, more)
        try:
            solution = _solve(found.family, found.variant, runs, found.request)
        except NotIdentifiedError:
            return found
        now = replace(now, experiments=runs, solution=solution, outliers=gone)
    return found


@contextmanager
def _naming_what_was_read(notices: Sequence[Notice]) -> Iterator[None]:
    """Name what reading warned of first, where nothing can be determined: it may be the cause.

    So it may be where options do not fit the logs, as one that needs a time that is not in order.
    """
    try:
        yield
    except (NotIdentifiedError, UsageError) as error:
        found = [n.message for n in notices if not is_note(n.code)]
        if not found:
            raise
        words = {"expected": error.expected, "remedy": "\n".join([*found, error.remedy])}
        if isinstance(error, NotIdentifiedError):
            words["option"] = error.option
        raise type(error)(error.what, where=error.where, **words) from error


@contextmanager
def _blaming_the_numbers() -> Iterator[None]:
    """Refuse where the arithmetic fails or a result is not finite, and name what may be why."""
    try:
        yield
    except (
        np.linalg.LinAlgError,
        ArithmeticError,  # overflow, division by zero
        ParameterFileError,
    ) as error:
        found = str(error)
        if isinstance(error, ParameterFileError):
            if not any("finite" in words or "in SI" in words for _, words in error.problems):
                raise
            found = "; ".join(f"{path} {message}" for path, message in error.problems[:3])
        raise NotIdentifiedError(
            f"the computation broke down ({found}).",
            expected="Nothing was written. Values that differ by too many orders of magnitude do "
            "that, and so does a search that is led far astray.",
            remedy="Check --unit and --scale of the columns, and --fix, --start and --bounds (SI); "
            "if they are right, give --start values near the right ones.",
        ) from error


def _hold(logs: Sequence[Log], holds: Mapping[str, str]) -> list[Log]:
    return [replace(log, holds={**log.holds, **holds}) for log in logs]


def _prepare(logs: Sequence[Log], variant: Variant) -> tuple[list[Experiment], list[Notice]]:
    """Turn all logs into experiments."""
    require_agreement(logs, variant)
    found: list[Experiment] = []
    notices: list[Notice] = []
    for index, log in enumerate(logs):
        some, said = experiments_of(log, variant, index=index)
        _require_samples(log, variant, some)
        require_two_signals(log, variant, some)
        found += some
        notices += [*log.notices, *said]
    if not found:
        raise LogError(
            "no run of any log can be used",
            where=logs[0].name,
            remedy="See the warnings above; `fluidact-fit inspect` shows what is in a log.",
        )
    notices += find_constant_signals(variant, found)
    notices += find_copied_rows(variant, found)
    return settle_holds(found), notices


def _require_samples(log: Log, variant: Variant, found: Sequence[Experiment]) -> None:
    """Refuse a log of motion that is too short for any model to leave a residual."""
    timed = any(role.name == "time" and role.required for role in variant.roles)
    samples = sum(e.samples for e in found)
    if timed and samples < _FEWEST:
        raise LogError(
            f"only {samples} {'sample' if samples == 1 else 'samples'} can be used.",
            where=log.name,
            expected=f"Expected {_FEWEST} or more.",
            remedy="Record longer or sample faster; check --window where it was given.",
        )
