"""Output-error fits of responses in time, for every family that declares a response model.

The search is staged: an excerpt of the logs shows the valleys of the cost, part of long logs leads
closer, and all samples decide. See ``docs/theory/responses.md``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Generic

import numpy as np

from ..errors import Notice
from ..experiment import Experiment, FloatArray
from ..rows import LONG
from ..specification import Quantity, Simulate, Variant
from .input_noise import InputNoise, moving_inputs
from .named_input_noise import correct_named
from .named_model import NamedModel, bind
from .parametric import Fitted, fit_named
from .problem import Problem
from .response_model import Beginning, ResponseTask, T
from .rivals import Correct, judge_rivals
from .robust_weights import ROUNDS, huber_weights
from .run_beginnings import (
    choose_beginning,
    cut_unrecorded,
    examine_offset,
    unrecorded_notice,
    unrecorded_time,
)
from .separable import Search, profile, solve_from
from .solution import NoiseModel, Solution, make_solution
from .starts import excerpt, time_scales
from .whitening import Whitening

_EXCERPT = 1500  # samples of the logs on which starts are searched for
_RIVALS = 6  # distinct points that are followed
_RIVAL_COST = 10.0  # multiple of the best cost up to which a point may lead to a rival
_SMOOTH = 0.02  # ratio of squared changes of residuals to their squares that shows no noise
_ROUNDS = 6  # of cutting off the response to the time before the runs
_NEGLIGIBLE = 0.25  # error by noise of the input [standard errors] that is not allowed for


@dataclass(frozen=True)
class Response(Generic[T]):
    """A finished fit.

    Attributes
    ----------
    solved
        The estimate.
    weights
        Of the samples, as in :class:`.NamedModel`.
    begin
        What the runs were taken to begin with.
    limit
        Residual from which samples count less; ``None`` where all count alike.
    """

    solved: Fitted
    weights: Sequence[FloatArray | float]
    begin: Beginning
    limit: float | None = None

    def settled(self, options: T) -> T:
        """The options with what the fit has chosen."""
        begin = self.begin
        return replace(
            options,
            start_state="rest" if begin.rest else "free",
            offset="none" if begin.offset == "none" else "free",
            offset_of=None if begin.offset == "none" else begin.offset,
            unrecorded=begin.unrecorded or None,
            residual_limit=self.limit,
        )

    def solution(
        self,
        simulate: Simulate,
        experiments: Sequence[Experiment],
        variant: Variant,
        options: T,
        derived: Mapping[str, Quantity],
        notices: Sequence[Notice] = (),
    ) -> Solution[T]:
        """Return the solution to examine and write; ``options`` are settled."""
        fitted, output = self.solved, variant.output.name
        parameters, names, covariance = fitted.quantities(variant.parameters, experiments[0].units)
        table, drift = fitted.compare_logs(experiments)
        details = {**fitted.details(), **table}
        jacobians = fitted.sensitivity()
        if self.weights:
            less = [int(np.sum(np.asarray(w) < 1.0)) for w in self.weights]
            details["samples_of_less_weight"] = less
            jacobians = [j / np.reshape(w, (-1, 1)) for j, w in zip(jacobians, self.weights)]
        return make_solution(
            simulate, experiments, variant, options, parameters, names,
            NoiseModel(covariance, fitted.independent, fitted.input_noise),
            jacobians=[{output: j} for j in jacobians], derived=derived,
            notices=[*fitted.notices, *drift, *notices], details=details,
        )  # fmt: skip


def fit_response(task: ResponseTask[T]) -> Response[T]:
    """Fit a response: search for starts, fit, allow for input noise, and judge rivals."""
    few = excerpt(task.experiments, task.output, _EXCERPT, task.model.reach)
    task.request.progress("searching for a start")
    begin = choose_beginning(task, few)
    problem, starts = task.problem(few, begin), task.starts(few, begin)
    search = _search_alternatives(task, problem, task.search(problem, starts))
    # some rivals are the best optimum again, not fully converged
    optima = _apart(np.array([s.eta for s in (search.best, *search.rivals)]))
    places = [task.values(problem, eta) for eta in optima]
    begin, places = cut_unrecorded(task, few, begin, places)
    part, ends = None, places[:3]
    if sum(e.samples for e in task.experiments) > LONG:
        part = task.named(excerpt(task.experiments, task.output, LONG), begin)
        problem = bind(part, task.unknowns, task.held)
        found = task.search(problem, places)
        best, *places = (task.values(problem, s.eta) for s in (found.best, *found.rivals))
        ends = [best, *places[:2]]
    task.request.progress("fitting")
    fitted, model, begin = _fit(task, ends, part, begin, starts)
    chosen, values, said = examine_offset(task, fitted, model, begin)
    if chosen != begin:
        fitted, model, begin = _fit(task, [values], part, chosen, starts)
    fitted = replace(fitted, notices=[*fitted.notices, *said, *unrecorded_notice(task, begin)])
    end, correct = _allow_for_input_noise(task, fitted, begin)
    end = judge_rivals(task, end, fitted, model, places, correct)
    tried = replace(end.search, tried=search.tried, agreeing=search.agreeing)
    limit = _limit(task, fitted, model)
    return Response(replace(end, search=tried), model.weights, begin, limit)


def _search_alternatives(task: ResponseTask[T], problem: Problem, search: Search) -> Search:
    """Search from starts where the family expects rivals, as long as better optima are found.

    Only starts with a cost near the best are searched from, unless the residual of the best is no
    noise and the family has many minima.
    """
    step = time_scales(task.experiments)[0]
    for _ in range(3):
        best = search.best
        values = task.values(problem, best.eta)
        points = [
            p for p in task.model.alternative_starts(values, step) if not set(p) & set(task.held)
        ]
        if not points:
            return search
        starts = np.array([problem.vector({**values, **p}) for p in points])
        costs = profile(problem, starts)
        rough = task.model.many_minima and _is_smooth(best.residuals)
        most = np.inf if rough else _RIVAL_COST * best.cost
        near = _apart(starts[np.argsort(costs)][: np.sum(costs < most)])
        if not near:
            return search
        every = [best.eta, *(s.eta for s in search.rivals), *near]
        found = solve_from(problem, every, tolerance=1e-2)
        tried = search.tried + len(near)
        again = found.best.cost < best.cost * (1.0 - 1e-3)
        search = replace(found, tried=tried, agreeing=max(search.agreeing, found.agreeing))
        if not again:
            break
    return search


def _is_smooth(residuals: Sequence[FloatArray]) -> bool:
    """Return whether residuals hardly change from sample to sample (von Neumann's ratio)."""
    changes = sum(float(np.sum(np.diff(r) ** 2)) for r in residuals)
    return changes < _SMOOTH * sum(float(r @ r) for r in residuals)


def _fit(
    task: ResponseTask[T], ends: Sequence[Mapping[str, float]], part: NamedModel | None,
    begin: Beginning, starts: Sequence[Mapping[str, float]],
) -> tuple[Fitted, NamedModel, Beginning]:  # fmt: skip
    """Fit all samples, repeatedly until the response to inputs before the runs is left out."""
    # searches on long logs begin near their end only: every step takes long
    again = starts if sum(e.samples for e in task.experiments) <= LONG else ()
    for _ in range(_ROUNDS):
        model = _weighed(task, task.named(task.experiments, begin), ends)
        fitted = fit_named(
            model, task.variant.parameters, task.request, task.unknowns, ends, part=part,
            again=again, refusals=task.plan.refusals,
            max_half_widths=task.plan.max_half_widths,
            no_effect_at=task.plan.no_effect_at,
        )  # fmt: skip
        needed = unrecorded_time(task, task.experiments, begin, fitted.values)
        if needed <= begin.unrecorded:
            break
        begin, ends = replace(begin, unrecorded=needed), [fitted.values]
    return fitted, model, begin


def _weighed(
    task: ResponseTask[T], model: NamedModel, ends: Sequence[Mapping[str, float]]
) -> NamedModel:
    """The model with robust weights of its samples, iterated from given ``ends``."""
    if not task.model.robust:
        return model
    problem = bind(model, task.unknowns, task.held)
    starts = [problem.vector({**s, **task.request.start}) for s in ends]
    weights = [np.ones(y.size) for y in model.measured]
    for _ in range(ROUNDS):
        found = solve_from(replace(problem, weights=weights), starts, tolerance=1e-3).best
        rest = [y - m for y, m in zip(model.measured, problem.simulate(found), strict=True)]
        new, _ = huber_weights(rest, task.request.options.residual_limit)
        change = max(float(np.abs(a - b).max()) for a, b in zip(new, weights))
        if change < 0.05:
            break
        weights, starts = new, [found.eta]
    return replace(model, weights=weights)


def _limit(task: ResponseTask[T], fitted: Fitted, model: NamedModel) -> float | None:
    """Residual from which samples of a robust fit count less; ``None`` where all count alike."""
    if not task.model.robust:
        return None
    held = {n: v for n, v in fitted.values.items() if n not in fitted.names}
    found = bind(model, task.unknowns, held).simulate(fitted.solution)
    rest = [y - m for y, m in zip(model.measured, found, strict=True)]
    return huber_weights(rest, task.request.options.residual_limit)[1]


def _allow_for_input_noise(
    task: ResponseTask[T], fitted: Fitted, begin: Beginning
) -> tuple[Fitted, Correct]:
    """Correct the fit for noise of a measured input; returned with it is the correction itself.

    There is none where the noise does not matter, or cannot be allowed for.
    """
    experiments, plain = task.experiments, fitted
    rows, roles = sum(e.samples for e in experiments), moving_inputs(experiments)
    if not roles or not fitted.names or not task.model.allows_for_input_noise:
        return fitted, None
    role = roles[0]
    given = task.request.noise.get(role)
    if rows > LONG or rows < 200 * len(experiments):
        said = [_not_allowed_for(role)] if given else []
        return replace(fitted, notices=[*fitted.notices, *said]), None

    def build(
        held: Mapping[str, float], some: Sequence[Experiment], white: Sequence[Whitening]
    ) -> Problem:
        model = replace(task.named(some, begin).without_linear(), whiten=white)
        return bind(model, task.unknowns, held)

    refused = {n: r.value(fitted.specs[n]) for n, r in fitted.refused.items()}
    at_hand = partial(build, {**task.held, **refused, **task.request.fixed})
    problem = at_hand(experiments, ())
    eta = problem.vector(fitted.values)
    errors = np.array([fitted.std_error(n) for n in problem.names])
    noise = InputNoise.seen(experiments, role, task.request.seed, given)
    if noise.sigma and noise.effect(at_hand, eta, errors) < _NEGLIGIBLE:
        noise, given = replace(noise, sigma=0.0), noise.sigma
    if noise.sigma and given is None:
        noise = noise.supported(at_hand, eta)
    found: dict[str, Any] = {
        "role": role, "sigma": noise.sigma or given or 0.0,
        "unit": experiments[0].signals[role].unit,
    }  # fmt: skip
    if noise.sigma == 0.0:
        return replace(plain, extra_details={"input_noise": found}), None
    found["treatment"] = "residual whitened, score corrected"

    def correct(other: Fitted) -> Fitted:
        task.request.progress("allowing for the noise of the input")
        return correct_named(
            noise, build, other, refusals=task.plan.refusals,
            max_half_widths=task.plan.max_half_widths,
            no_effect_at=task.plan.no_effect_at,
        )  # fmt: skip

    return replace(correct(fitted), extra_details={"input_noise": found}), correct


def _not_allowed_for(role: str) -> Notice:
    return Notice(
        "input-noise-left",
        f"the noise of '{role}' given with --noise could not be allowed for: that takes at least "
        f"200 samples a run, and {LONG} at most in all. Record longer runs, or cut the log with "
        "--window.",
    )


def _apart(points: FloatArray) -> list[FloatArray]:
    """The first points, best first, that are not close to one another."""
    out: list[FloatArray] = []
    for point in points:
        if not any(np.all(np.abs(point - p) <= 0.15 * np.abs(p)) for p in out):
            out.append(point)
    return out[:_RIVALS]
