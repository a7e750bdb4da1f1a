"""Fit of a model with named physical parameters, with intervals and refusals.

A family describes its model as a function of named values. Holding, seeding and bounding
parameters, refusing those that the data cannot determine, and turning the covariance into intervals
happen here for all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from ..errors import Notice
from ..experiment import Experiment, FloatArray
from ..options import FamilyOptions
from ..rows import square_sum
from ..specification import NoiseLevel, ParameterSpec, Request
from ..units import after_number, as_share
from .agreement_of_logs import LogDisagreement, compare_logs
from .blocks import condensed
from .least_squares import scaled_least_squares
from .named_model import NamedModel, bind
from .problem import StationaryPoint, Unknown
from .profile_likelihood import Interval, profile_interval
from .results import Refusal, Solved, determine, find_uninformative
from .separable import Search, solve, solve_from
from .significance import DECIDED, DECISIVE
from .uncertainty import Uncertainty, information_units, model_of_residuals, t_quantile

PROFILED = 50_000  # rows beyond which a parabola is trusted: errors are small there
_NEAR_LIMIT = 0.1  # of a value: closer to the limit of the search it may have been stopped there
_DAMPING_NEAR_END = 1e-10  # of a search that begins near its end


@dataclass(frozen=True)
class Fitted(Solved):
    """A finished search: values by name, covariance, and the quality of the search.

    Attributes
    ----------
    order
        Of the autoregression of the residuals, as in :class:`.uncertainty.Uncertainty`.
    from_scores
        Whether the covariance is that of the scores, without a model of the residuals: the rows are
        not samples of the output alone, and :meth:`sensitivity` is empty.
    search, solution
        The search, and its best point.
    specs, unknowns
        Parameters of the family, and unknowns of the model, by name.
    factors
        Weights by log that make its residuals as large as those of the others.
    logs
        The log of every experiment.
    extra_details
        Further entries of :meth:`details`.
    input_noise
        Noise on inputs that the estimate allows for, by role.
    """

    order: int = 0
    from_scores: bool = False
    search: Search = field(kw_only=True)
    solution: StationaryPoint = field(kw_only=True)
    specs: Mapping[str, ParameterSpec] = field(kw_only=True)
    unknowns: Mapping[str, Unknown] = field(kw_only=True)
    notices: list[Notice] = field(default_factory=list)
    extra_details: Mapping[str, Any] = field(default_factory=dict)
    factors: Mapping[int, float] = field(default_factory=dict)
    logs: Sequence[int] = ()
    input_noise: Mapping[str, NoiseLevel] = field(default_factory=dict)

    def _reported(self) -> list[int]:
        return [k for k, n in enumerate(self.names) if n in self.specs]

    def sensitivity(self) -> list[FloatArray]:
        """Derivatives of every output by the reported parameters, shape ``(n_i, q)`` each.

        Nuisance unknowns are projected out; empty where the covariance is that of the scores.
        """
        if self.from_scores:
            return []  # also where the score was corrected for noise of an input
        kept = self._reported()
        other = [k for k in range(len(self.names)) if k not in kept]
        parts = self.solution.jacobian
        if other:
            table = condensed(parts)
            found = scaled_least_squares(table[:, other], table[:, kept])
            parts = [j[:, kept] - j[:, other] @ found for j in parts]
        if not self.factors:
            return list(parts)
        return [j / self.factors[k] for j, k in zip(parts, self.logs)]

    def compare_logs(
        self, experiments: Sequence[Experiment]
    ) -> tuple[dict[str, Any], list[Notice]]:
        """Leave-one-log-out errors and drift as entries for the file, and warnings."""
        logs, kept = [e.log for e in experiments], self._reported()
        if len(set(logs)) < 2 or not kept or self.from_scores:
            return {}, []
        label = {e.log: e.log_name for e in experiments}
        jacobian = [j[:, kept] for j in self.solution.jacobian]
        names = [self.names[k] for k in kept]
        drifts, errors = compare_logs(jacobian, self.solution.residuals, logs, names)
        table: dict[str, Any] = {
            "drift": [{"file": label[row.pop("log")], **row} for row in map(asdict, drifts)]
        }
        if len(errors) > 2:
            table["leave_one_log_out"] = [
                {"file": label[k], "rmse": error} for k, error in errors.items()
            ]
        return table, [
            n for d in drifts for n in _drift_notice(d, label[d.log], self.values[d.parameter])
        ]

    def details(self) -> dict[str, Any]:
        """Details of the search, for the file."""
        return {
            "method": "output error",
            "starts": {
                "tried": self.search.tried,
                "agreeing": self.search.agreeing,
                "rivals": len(self.search.rivals),
            },
            "iterations": self.solution.iterations,
            "converged": self.solution.converged,
            "covariance": self._covariance_name(),
            **self.extra_details,
        }

    def _covariance_name(self) -> str:
        """Noise model of the residuals, as the file says it."""
        if self.input_noise:
            return "scores corrected for the noise of an input"
        if self.from_scores:
            return "long-run variance of the scores"
        return model_of_residuals(self.order)


def _drift_notice(drift: LogDisagreement, label: str, value: float) -> Iterator[Notice]:
    """Warn of a drift that is significant, and large enough to matter."""
    if drift.p_value >= 1e-3 or abs(drift.difference) <= 5e-3 * abs(value):
        return
    yield Notice(
        "log-differs",
        f"{label} does not agree with the other logs: its own {drift.parameter} "
        f"differs by {drift.difference:+.3g}{as_share(drift.difference, value)}, "
        f"{abs(drift.deviations):.1f} "
        f"standard errors (p = {drift.p_value:.1g}). Check whether it comes from the same "
        "machine in the same state; leave it out or fit it separately.",
    )


def fit_named(
    model: NamedModel,
    specs: Sequence[ParameterSpec],
    request: Request[FamilyOptions],
    unknowns: Mapping[str, Unknown],
    starts: Sequence[Mapping[str, float]],
    *,
    refusals: Sequence[Refusal] = (),
    max_half_widths: Mapping[str, float] | None = None,
    no_effect_at: Mapping[str, float] | None = None,
    part: NamedModel | None = None,
    again: Sequence[Mapping[str, float]] = (),
) -> Fitted:
    """Fit a named model and refuse what the data do not determine.

    Parameters
    ----------
    model, unknowns
        The model and its unknowns.
    starts
        Start values of the nonlinear parameters; the user's ``--start`` wins.
    refusals
        Parameters known beforehand to be undetermined.
    max_half_widths
        Half-widths of 95 % intervals beyond which a parameter is refused, by name (default: its own
        value).
    no_effect_at
        Values at which a parameter has no effect on these logs, by name, such as the edge of a dead
        zone at the largest input. One that does not fit far better than that is refused.
    part
        The same model of part of long logs. A parameter that it decides needs no look at the rest.
    again
        Further starts once something is refused: a search may have dragged other parameters along
        with it.
    """
    by_name = {s.name: s for s in specs}
    every = (*model.nonlinear, *model.linear)
    fixed = {n: float(request.fixed[n]) for n in every if n in request.fixed}
    known = {*fixed, *(r.parameter for r in refusals)}

    def solve_with(held: Mapping[str, float]) -> _Attempt:
        some = starts if known.issuperset(held) else (*starts, *again)
        return _attempt(model, unknowns, held, [{**s, **request.start} for s in some])

    def undetermined(attempt: _Attempt) -> list[Refusal]:
        silent = _without_effect(attempt, unknowns, by_name, no_effect_at or {}, part)
        ends = at_limits(attempt.solved, by_name, unknowns, request)
        return silent or ends or find_uninformative(attempt.solved, by_name, max_half_widths or {})

    found = determine(solve_with, undetermined, by_name, fixed=fixed, refusals=refusals)
    attempt, solved = found.solution, found.solution.solved
    values = {n: float(v) for n, v in solved.values.items()} | fixed
    values |= {n: r.value(by_name[n]) for n, r in found.refused.items()}
    fitted = Fitted(
        values, solved.names, solved.covariance, solved.degrees, fixed, found.refused,
        independent=solved.independent,
        order=attempt.uncertainty.order, from_scores=attempt.uncertainty.from_scores,
        search=attempt.search, solution=attempt.best, specs=by_name,
        unknowns=unknowns, notices=found.notices, factors=attempt.factors, logs=model.logs,
    )  # fmt: skip
    if fitted.from_scores:
        return fitted
    return replace(fitted, intervals=_examine_intervals(attempt, fitted))


def at_limits(
    solved: Solved,
    specs: Mapping[str, ParameterSpec],
    unknowns: Mapping[str, Unknown],
    request: Request[FamilyOptions],
) -> list[Refusal]:
    """Refuse a parameter that ends at the limit of the search: it was stopped, not measured.

    So was one that stops just short of the limit, if its interval reaches across. The ends of the
    physical range, and bounds that the user gave, are results like any other.
    """
    for name in solved.names:
        if name not in specs or name in request.bounds:
            continue
        value, u, spec = float(solved.values[name]), unknowns[name], specs[name]
        near = min(solved.half_width(name), _NEAR_LIMIT * abs(value))
        if (value - near <= u.low and u.low > spec.minimum) or (
            value + near >= u.high and u.high < spec.maximum
        ):
            return [at_end_of_search(name, value, spec.unit)]
    return []


def at_end_of_search(name: str, value: float, unit: str) -> Refusal:
    """Make the refusal of a parameter that ends at the limit of its search [``unit``]."""
    return Refusal(
        name,
        f"it ends at {value:.3g}{after_number(unit)}, at the search limit. If the true value "
        f"lies beyond, give --bounds {name}=LOW:HIGH.",
    )


@dataclass(frozen=True)
class _Attempt:
    """One fit with some parameters held; ``fair`` weighs the logs by their noise."""

    fair: NamedModel
    held: Mapping[str, float]
    search: Search
    best: StationaryPoint
    factors: Mapping[int, float]
    uncertainty: Uncertainty
    solved: Solved


def _attempt(
    model: NamedModel,
    unknowns: Mapping[str, Unknown],
    held: Mapping[str, float],
    starts: Sequence[Mapping[str, float]],
) -> _Attempt:
    """Solve from every start, weigh the logs, and take the covariance."""
    problem = bind(model, unknowns, held)
    begin = [problem.vector(s) for s in starts]
    rows = sum(y.size for y in model.measured)
    # part of a long log was usually fitted before: the starts are near, or a step is rejected
    limits: dict[str, Any] = (
        {"tolerance": 1e-3, "damping": _DAMPING_NEAR_END} if rows > PROFILED else {}
    )
    search = solve_from(problem, begin, **limits)
    best, fair = search.best, model
    factors = _balance(model, best)
    if factors:
        fair = model.scaled(factors)
        best = solve(bind(fair, unknowns, held), best.eta, **limits)
    found = fair.uncertainty(best)
    names = (*problem.names, *(u.name for u in problem.linear))
    values = dict(zip(names, (*best.eta, *best.linear)))
    solved = Solved(values, names, found.covariance, found.degrees, independent=found.independent)
    return _Attempt(fair, held, search, best, factors, found, solved)


def _without_effect(
    attempt: _Attempt,
    unknowns: Mapping[str, Unknown],
    specs: Mapping[str, ParameterSpec],
    no_effect_at: Mapping[str, float],
    part: NamedModel | None,
) -> list[Refusal]:
    """Refuse parameters that explain the data hardly better than without any effect.

    The likelihood ratio decides. An interval cannot: near the value at which a parameter ceases to
    act, a few samples of noise give it a sharp but accidental optimum. A parameter that ``part`` of
    the logs shows far beyond doubt is not tested on all of them, which can only add to it.
    """
    out = []
    order = [n for n in attempt.solved.names if n in attempt.fair.nonlinear]
    units = cost_units(attempt.best, attempt.solved.covariance) if no_effect_at else np.zeros(0)
    units = np.nan_to_num(units, nan=float(np.nanmin(units, initial=np.inf)))
    for name, value in no_effect_at.items():
        if name not in order:
            continue
        unit = units[order.index(name)]
        if part is not None:
            some = part.scaled(attempt.factors)
            own = solve(bind(some, unknowns, attempt.held), attempt.best.eta, tolerance=0.05)
            if _idle_rise(some, unknowns, attempt, (name, value), own.cost, unit) > DECIDED:
                continue
        rise = _idle_rise(attempt.fair, unknowns, attempt, (name, value), attempt.best.cost, unit)
        if rise < DECISIVE:
            out.append(no_effect(specs[name], value, unknowns[name].low))
    return out


def no_effect(spec: ParameterSpec, value: float, low: float) -> Refusal:
    """Make the refusal of a parameter that may as well be at the ``value`` without effect.

    ``low`` is the lower limit of its search.
    """
    if value == low and spec.neutral == spec.minimum:  # the limit is that of no effect
        return Refusal(spec.name, "the data are explained as well without it.")
    reason = (
        f"the data are explained as well if it lies beyond {value:.3g} {spec.unit}, where these "
        "logs end."
    )
    return Refusal(spec.name, reason, value)


def _idle_rise(
    model: NamedModel,
    unknowns: Mapping[str, Unknown],
    attempt: _Attempt,
    at: tuple[str, float],
    cost: float,
    unit: float,
) -> float:
    """Rise of the cost above ``cost``, in ``unit``, with a parameter at a value."""
    order = [n for n in attempt.solved.names if n in model.nonlinear]
    problem = bind(model, unknowns, {**attempt.held, at[0]: at[1]})
    begin = np.delete(attempt.best.eta, order.index(at[0]))
    for limit in (3, 20):  # most are decided at once
        found = solve(problem, begin, tolerance=0.05, max_iterations=limit)
        rise = (found.cost - cost) / unit
        if rise > DECIDED:
            break
        begin = found.eta
    return float(rise)


def cost_units(solution: StationaryPoint, found: FloatArray) -> FloatArray:
    """As :func:`.information_units`, of a solution with local unknowns."""
    local = sum(solution.local_counts)
    return information_units(solution.jacobian, solution.residuals, found, local)


def _balance(model: NamedModel, solution: StationaryPoint) -> dict[int, float]:
    """Factors by log that make the residuals of all logs equally large; empty for none.

    With equal weights a log of twice the noise spoils the information of a better one. Logs too
    short to show their noise, and noise levels within 10 % of each other, stay as they are.
    """
    every = list(dict.fromkeys(model.logs))
    if len(every) < 2:
        return {}
    rows = dict.fromkeys(every, 0.0)
    cost = dict(rows)
    for r, k, local in zip(solution.residuals, model.logs, solution.local_counts):
        rows[k] += r.size - local
        cost[k] += square_sum(r)
    sigma = {k: np.sqrt(cost[k] / max(rows[k], 1.0)) for k in every}
    if min(rows.values()) < 100 or not 0.0 < 1.1 * min(sigma.values()) < max(sigma.values()):
        return {}
    common = float(np.sqrt(sum(cost.values()) / sum(rows.values())))
    return {k: float(np.clip(common / sigma[k], 0.1, 10.0)) for k in every}


def _examine_intervals(attempt: _Attempt, fitted: Fitted) -> dict[str, Interval]:
    """Profile-likelihood intervals, by name, of parameters whose cost need not be a parabola.

    It has kinks where the specification says ``curved``, and one side is missing within three
    standard errors of a bound.
    """
    model, held = attempt.fair, attempt.held
    if sum(y.size for y in model.measured) > PROFILED:
        return {}
    out = {}
    quantile = t_quantile(0.975, fitted.degrees)
    units = cost_units(fitted.solution, fitted.covariance)
    for k, name in enumerate(fitted.names):
        if name not in model.nonlinear or name not in fitted.specs:
            continue
        value, se = fitted.values[name], fitted.std_error(name)
        u = fitted.unknowns[name]
        near = min(value - u.low, u.high - value) < 3.0 * se
        if se <= 0.0 or not (near or fitted.specs[name].curved):
            continue
        if not np.isfinite(units[k]):
            continue
        rise = _make_rise(model, fitted, held, name, units[k])
        out[name] = profile_interval(rise, value, se, quantile, (u.low, u.high))
    return out


def _make_rise(
    model: NamedModel, fitted: Fitted, held: Mapping[str, float], name: str, variance: float
) -> Callable[[float], float]:
    """Return the root of the rise of the profiled cost, as :func:`profile_interval` takes it."""
    order = [n for n in fitted.names if n in model.nonlinear]
    covariance_of = fitted.covariance
    k = fitted.names.index(name)

    def rise(x: float) -> float:
        problem = bind(model, fitted.unknowns, {**held, name: x})
        step = (x - fitted.values[name]) / covariance_of[k, k]
        start = [
            fitted.values[n] + step * covariance_of[fitted.names.index(n), k]
            for n in order
            if n != name
        ]
        found = solve(problem, np.array(start), tolerance=0.05, max_iterations=12)
        return float(np.sqrt(max(found.cost - fitted.solution.cost, 0.0) / variance))

    return rise
