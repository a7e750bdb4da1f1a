"""Output-error fits of responses in time: one estimator for every family that declares one.

A family declares its model as a function of named values, what of it is searched for and where a
search may begin (:class:`ResponseModel`). The search is staged: an excerpt of the logs tells the
valleys of the cost, part of long logs leads closer, all samples decide. See
``docs/theory/responses.md``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from ..errors import Notice
from ..experiment import Experiment, FloatArray, Signal
from ..options import FamilyOptions, choice, settled
from ..specification import Quantity, Request, Simulate, Variant
from ..units import after_number
from .input_noise import InputNoise, moving_inputs
from .named_input_noise import correct_named
from .named_model import NamedModel, bind, check_request, make_unknowns
from .noise import noise_floor
from .parametric import DECIDED, DECISIVE, Fitted, fit_named, information_units
from .problem import Basis, Problem, StationaryPoint, Unknown
from .results import Refusal, refuse
from .separable import Search, evaluate, profile, solve, solve_from
from .solution import NoiseModel, Solution, make_solution
from .starts import dead_time_axis, excerpt, grid_search, time_scales
from .uncertainty import middle_of, t_quantile
from .whitening import Whitening

_EXCERPT = 1500  # samples of the logs on which starts are searched for
_REACH = 8  # times as long a part, of which bursts of samples make up the excerpt
_RESTING = 8  # first samples of an input that is taken to have been at rest before
_MANY = 200_000  # samples beyond which the start is refined on a quarter of that first
_LONGER = 800_000  # samples of a closer start, where there are far more
_RIVALS = 6  # places far from the best that are searched
_OTHER = 4.0  # standard errors by which a value is another one
_NEAR = 10.0  # times the best cost, within which a rival may be
_FAST = 0.8  # pole times sample time, up to which samples tell one frequency from another
_SIMILAR = 0.1  # of a value: two optima as near as that are one wide interval
_BLOCKS = 30  # of consecutive samples, whose costs show how sure the difference of two fits is
_FEW_STEPS = 3.0  # sample times of a dead time that leaves no more than as many samples undescribed
_AT_REST = 0.1  # of the usual change of an input from one sample to the next
_LONG_ENOUGH = 1000  # samples that show what is usual
_HUBER = 4.0  # robust standard deviations from which a residual counts less
_ROUNDS = 6  # of reweighting, and of finding how much of the runs answers to the time before
_NEGLIGIBLE = 0.25  # standard errors that noise of the input may make without being allowed for
_POOR = 0.05  # of the power of the output, left by a search that may have missed the place
_LATER = 0.25  # of the longest log, the start of which a search leaves out
_SURE = 4.0  # standard errors of a level at rest
_EARLIER = (1.0, 0.7, 0.4)  # of a dead time, from which that of a fit without offset is sought


@dataclass(frozen=True)
class Beginning:
    """Initial conditions of the runs of a fit.

    Attributes
    ----------
    rest
        Whether all begin at rest; else with any state.
    offset
        Whether every run has an output offset of its own, every log one for its runs, or none.
    unrecorded
        Time at the start of every run during which the output answers to an input before it [s].
        What was measured then is left out.
    """

    rest: bool = False
    offset: str = "run"
    unrecorded: float = 0.0


@dataclass(frozen=True)
class ResponseOptions(FamilyOptions):
    """Choices about the runs of every response."""

    start_state: str | None = choice(
        None, ("rest", "free"), "whether the runs begin at rest or in any state",
        formerly="initial-state",
    )  # fmt: skip
    offset: str | None = choice(None, ("none", "free"), "whether the output has an offset")
    offset_of: str | None = settled(
        "choice",
        "whether each run has its own output offset or, where runs are short, each log",
        choices=("run", "log"),
    )
    unrecorded: float | None = settled(
        "float",
        "time at the start of every run during which the output answers to an input before it",
        unit="s", minimum=0.0,
    )  # fmt: skip
    residual_limit: float | None = settled(
        "float", "residual of the output beyond which a sample counts less", minimum=0.0
    )

    @property
    def beginning(self) -> Beginning:
        """The choices as a fit has settled them."""
        offset = "none" if self.offset == "none" else self.offset_of or "run"
        return Beginning(self.start_state == "rest", offset, self.unrecorded or 0.0)


@dataclass(frozen=True)
class Searched:
    """Search range of a nonlinear parameter [SI].

    Attributes
    ----------
    scale, limits
        Typical size and search range.
    axis
        Values to try first, shape ``(k,)``; dead times are tried in proportion to the lag.
    sensible
        Half-width beyond which an interval is useless; the estimate itself when ``None``.
    idle
        Value at which it has no effect on the logs at hand.
    """

    name: str
    scale: float = 1.0
    limits: tuple[float, float] = (-np.inf, np.inf)
    axis: FloatArray = field(default_factory=lambda: np.zeros(1))
    sensible: float | None = None
    idle: float | None = None


@dataclass(frozen=True)
class Plan:
    """Plan of the search for the parameters of one set of logs.

    Attributes
    ----------
    searched
        Nonlinear parameters of the model.
    lag
        Slowest response time [s] at a point of the axes: dead times are tried in proportion.
    fixed
        Values held although the user did not fix them.
    refusals
        Parameters known beforehand to be undetermined.
    """

    searched: Sequence[Searched]
    lag: Callable[[Mapping[str, float]], float] = lambda at: 0.0
    fixed: Mapping[str, float] = field(default_factory=dict)
    refusals: Sequence[Refusal] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the nonlinear parameters."""
        return tuple(s.name for s in self.searched)


T = TypeVar("T", bound=ResponseOptions)


class ResponseModel(ABC, Generic[T]):
    """Declaration of a family whose response is fitted.

    Attributes
    ----------
    gain
        Parameter that multiplies the response; ``None`` where it is part of the states.
    common_offset
        Whether short runs of a log can share an offset.
    robust
        Whether samples far off count less, by Huber's weights.
    allows_for_input_noise
        Whether the estimate takes noise of measured inputs into account.
    reach
        Times as long as an excerpt is the part of a long log that its samples are spread over. A
        dead time needs a long one, an output that adds up what the start is wrong by a short one.
    """

    gain: ClassVar[str | None] = None
    common_offset: ClassVar[bool] = True
    robust: ClassVar[bool] = False
    allows_for_input_noise: ClassVar[bool] = False
    reach: ClassVar[int] = _REACH

    @abstractmethod
    def plan(self, experiments: Sequence[Experiment], request: Request[T]) -> Plan:
        """Return the plan of the fit of these logs."""

    @abstractmethod
    def response(
        self, variant: Variant, experiments: Sequence[Experiment], begin: Beginning,
        names: tuple[str, ...],
    ) -> NamedModel:  # fmt: skip
        """The model of some experiments; ``names`` are its nonlinear parameters."""

    @abstractmethod
    def fastest(self, values: Mapping[str, float]) -> float:
        """Largest pole of the model [rad/s]."""

    def starts(
        self, fit: ResponseFit[T], experiments: Sequence[Experiment], begin: Beginning
    ) -> list[dict[str, float]]:
        """Return starts: the valleys of the cost over a grid, best first."""
        step, span = time_scales(experiments)
        held = fit.held

        def dead_times(at: Mapping[str, float]) -> FloatArray:
            return dead_time_axis(step, 0.5 * span, fit.plan.lag({**held, **at}))

        axes = {s.name: s.axis for s in fit.plan.searched}
        return grid_search(fit.problem(experiments, begin), axes, dead_times)

    def elsewhere(self, values: Mapping[str, float], step: float) -> list[dict[str, float]]:
        """Far from some values, others that samples every ``step`` [s] may not tell from them."""
        return []


def are_short(experiments: Sequence[Experiment]) -> bool:
    """Return whether the runs hold too few samples to have offsets and initial states of their own.

    In a run of ten samples that begins with the step these would explain the whole response. In
    a run of a hundred or more they cost next to nothing.
    """
    return sum(e.samples for e in experiments) < 100 * len(experiments)


@dataclass(frozen=True)
class Response(Generic[T]):
    """A finished fit.

    Attributes
    ----------
    fitted, model
        The estimate, and the model with the weights of its samples.
    begin
        What the runs were taken to begin with.
    limit
        Residual from which samples count less; ``None`` where all count alike.
    """

    fitted: Fitted
    model: NamedModel
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
        fitted, output = self.fitted, variant.output.name
        parameters, names, covariance = fitted.quantities(variant.parameters, experiments[0].units)
        table, drift = fitted.compare_logs(experiments)
        details = {**fitted.details(), **table}
        jacobians, weights = fitted.sensitivity(), self.model.weights
        if weights:
            details["samples_of_less_weight"] = [int(np.sum(np.asarray(w) < 1.0)) for w in weights]
            jacobians = [j / np.reshape(w, (-1, 1)) for j, w in zip(jacobians, weights)]
        return make_solution(
            simulate, experiments, variant, options, parameters, names,
            NoiseModel(covariance, fitted.independent, fitted.input_noise),
            jacobians=[{output: j} for j in jacobians], derived=derived,
            notices=[*fitted.notices, *drift, *notices], details=details,
        )  # fmt: skip


# ------------------------------------------------------------------------------------ the fit


@dataclass(frozen=True)
class ResponseFit(Generic[T]):
    """A staged fit: look for starts, refine them on part of long logs, then fit everything."""

    model: ResponseModel[T]
    variant: Variant
    experiments: Sequence[Experiment]
    request: Request[T]
    plan: Plan

    @classmethod
    def of(
        cls, model: ResponseModel[T], variant: Variant, experiments: Sequence[Experiment],
        request: Request[T], plan: Plan | None = None,
    ) -> ResponseFit[T]:  # fmt: skip
        """The fit that a request asks for; the family plans it unless it has done so."""
        check_request(variant.parameters, request)
        plan = plan or model.plan(experiments, request)
        request = replace(request, fixed={**plan.fixed, **request.fixed})
        return cls(model, variant, experiments, request, plan)

    @cached_property
    def unknowns(self) -> dict[str, Unknown]:
        """Unknowns by name, in the range of the search."""
        searched = self.plan.searched
        every = (*self.plan.names, self.model.gain) if self.model.gain else self.plan.names
        scales, limits = {s.name: s.scale for s in searched}, {s.name: s.limits for s in searched}
        return make_unknowns(self.variant.parameters, every, scales, self.request, limits)

    @cached_property
    def held(self) -> dict[str, float]:
        """Values that are known beforehand not to be estimated."""
        refused = {r.parameter: float(r.hold or 0.0) for r in self.plan.refusals}
        return {**refused, **self.request.fixed}

    @property
    def output(self) -> str:
        """Role of the output."""
        return self.variant.output.name

    @property
    def _are_very_long(self) -> bool:
        """Return whether a longer part than the first is still a small part of the logs."""
        return sum(e.samples for e in self.experiments) > 8 * _LONGER

    def named(self, experiments: Sequence[Experiment], begin: Beginning) -> NamedModel:
        """The model of some experiments."""
        return self.model.response(self.variant, experiments, begin, self.plan.names)

    def problem(self, experiments: Sequence[Experiment], begin: Beginning) -> Problem:
        """The solver's problem of some experiments."""
        return bind(self.named(experiments, begin), self.unknowns, self.held)

    def run(self) -> Response[T]:
        """Fit, from a search for starts to the judgement of rivals."""
        few = excerpt(self.experiments, self.output, _EXCERPT, self.model.reach)
        self.request.progress("searching for a start")
        begin = self._begin(few)
        problem, starts = self.problem(few, begin), self._starts(few, begin)
        search = self._look_elsewhere(problem, self._search(problem, starts))
        # some rivals are the best one again, not quite settled
        optima = _apart(np.array([s.eta for s in (search.best, *search.rivals)]))
        places = [self._values(problem, eta) for eta in optima]
        if search.best.cost > _POOR * _power(few, self.output):
            places += self._later(few, begin)
        begin, places = self._cut(few, begin, places)
        ends, part = places[:3], None
        if sum(e.samples for e in self.experiments) > _MANY:
            part = self.named(self._part(_MANY // 4), begin)
            ends = self._closer(part, ends)
            if self._are_very_long and any(s.idle is not None for s in self.plan.searched):
                # with edges in it the model is far from linear: from farther off, each step over
                # everything would be followed by others
                ends = self._closer(self.named(self._part(_LONGER), begin), ends)
        self.request.progress("fitting")
        fitted, model, begin = self._fit(ends, part, begin, starts)
        chosen, values, said = self._examine_offset(fitted, model, begin)
        if chosen != begin:
            fitted, model, begin = self._fit([values], part, chosen, starts)
        fitted = replace(fitted, notices=[*fitted.notices, *said])
        if self._are_very_long:
            part = self.named(self._part(_LONGER), begin)
        end, correct = self._allow_for_input_noise(fitted, begin)
        end = self._judge_rivals(end, fitted, model, places, part, correct)
        tried = replace(end.search, tried=search.tried, agreeing=search.agreeing)
        return Response(replace(end, search=tried), model, begin, self._limit(fitted, model))

    def _part(self, samples: int) -> list[Experiment]:
        return excerpt(self.experiments, self.output, samples)

    def _values(self, problem: Problem, eta: FloatArray) -> dict[str, float]:
        return {**self.held, **dict(zip((u.name for u in problem.nonlinear), eta.tolist()))}

    def _closer(
        self, part: NamedModel, starts: Sequence[Mapping[str, float]]
    ) -> list[dict[str, float]]:
        """The best that a part leads to from some starts."""
        problem = bind(part, self.unknowns, self.held)
        found = solve_from(problem, [_vector(problem, s) for s in starts], tolerance=1e-2)
        return [self._values(problem, found.best.eta)]

    def _starts(self, some: Sequence[Experiment], begin: Beginning) -> list[dict[str, float]]:
        """Return starts; the user's own take precedence."""
        return [{**s, **self.request.start} for s in self.model.starts(self, some, begin)]

    def _search(self, problem: Problem, starts: Sequence[Mapping[str, float]]) -> Search:
        """Solve roughly from every start."""
        return solve_from(problem, [_vector(problem, s) for s in starts], tolerance=1e-2)

    def _look_elsewhere(self, problem: Problem, search: Search) -> Search:
        """Search again where the family knows of rivals, as long as better ones are found there.

        The cost is looked at first: only what comes near the best is worth a search.
        """
        step = time_scales(self.experiments)[0]
        for _ in range(3):
            best = search.best
            values = self._values(problem, best.eta)
            points = [p for p in self.model.elsewhere(values, step) if not set(p) & set(self.held)]
            if not points:
                return search
            starts = np.array([_vector(problem, {**values, **p}) for p in points])
            costs = profile(problem, starts)
            near = _apart(starts[np.argsort(costs)][: np.sum(costs < _NEAR * best.cost)])
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

    def _fit(
        self, ends: Sequence[Mapping[str, float]], part: NamedModel | None, begin: Beginning,
        starts: Sequence[Mapping[str, float]],
    ) -> tuple[Fitted, NamedModel, Beginning]:  # fmt: skip
        """Fit everything, until what answers to the time before the runs is left out."""
        searched = self.plan.searched
        # long logs are begun near their end, or every step takes too long
        again = starts if sum(e.samples for e in self.experiments) <= _MANY else ()
        for _ in range(_ROUNDS):
            model = self._weighed(self.named(self.experiments, begin), ends)
            fitted = fit_named(
                model, self.variant.parameters, self.request, self.unknowns, ends, part=part,
                again=again, refusals=self.plan.refusals,
                sensible={s.name: s.sensible for s in searched if s.sensible is not None},
                idle={s.name: s.idle for s in searched if s.idle is not None},
            )  # fmt: skip
            needed = self._unrecorded(self.experiments, begin, fitted.values)
            if needed <= begin.unrecorded:
                break
            begin, ends = replace(begin, unrecorded=needed), [fitted.values]
        return fitted, model, begin

    # ---------------------------------------------------------------- what the runs begin with

    def _begin(self, few: Sequence[Experiment]) -> Beginning:
        """Return the user's start of the runs, and otherwise that of the excerpt."""
        options = self.request.options
        begin = options.beginning
        if options.offset != "none" and options.offset_of is None:
            begin = replace(begin, offset=self._owner)
        if options.start_state is None:
            rest = _are_stepped(self.experiments) or self._starts_at_rest(few, begin)
            begin = replace(begin, rest=rest)
        return begin

    @property
    def _owner(self) -> str:
        """Return the owner of an offset."""
        return "log" if self.model.common_offset and are_short(self.experiments) else "run"

    def _starts_at_rest(self, few: Sequence[Experiment], begin: Beginning) -> bool:
        """Return whether short runs are taken to start at rest.

        In a long run the initial state costs nothing and is always free. In a run of ten
        samples that begins with the step, a free initial state explains the whole response;
        it is then freed only when the Bayes criterion asks for it.
        """
        role = self.variant.driving[0].name
        if not are_short(few) or not all(_may_rest(e.signals[role]) for e in few):
            return False
        scores = []
        for rest in (True, False):
            own = replace(begin, rest=rest)
            problem = self.problem(few, own)
            search = self._search(problem, self._starts(few, own))
            count = sum(search.best.local_counts) + len(problem.nonlinear)
            rows = problem.rows
            scores.append(rows * np.log(max(search.best.cost, 1e-300)) + count * np.log(rows))
        return bool(scores[0] <= scores[1])

    def _unrecorded(
        self, experiments: Sequence[Experiment], begin: Beginning, values: Mapping[str, float]
    ) -> float:
        """Duration of the response to an input before the runs [s]; 0 where it is at rest.

        For as long as the dead time the output of a run follows an input that was not recorded.
        No initial state can stand for that: where anything moves meanwhile, the fit has to leave
        it out, and somewhat more than the dead time, which is not known exactly.
        """
        dead_time, step = values.get("dead_time", 0.0), time_scales(experiments)[0]
        given = self.request.options.unrecorded
        if given is not None or begin.rest or dead_time < max(_FEW_STEPS * step, begin.unrecorded):
            return begin.unrecorded
        role = self.variant.driving[0].name
        quiet = all(
            e.signals[role].time.size == 1
            or (_is_quiet(e[self.output], int(np.sum(e.time - e.time[0] < dead_time)))
                and _is_quiet(e[role], _RESTING))
            for e in experiments
        )  # fmt: skip
        return begin.unrecorded if quiet else 1.1 * dead_time + 2.0 * step

    def _later(self, few: Sequence[Experiment], begin: Beginning) -> list[dict[str, float]]:
        """End of a search that leaves out what a long dead time cannot describe.

        The samples within it would speak against the very dead time that they answer to.
        """
        late = "dead_time" in self.plan.names and "dead_time" not in self.held
        if not late or begin.rest or self.request.options.unrecorded is not None:
            return []
        begin = replace(begin, unrecorded=_LATER * time_scales(few)[1])
        problem = self.problem(few, begin)
        found = self._search(problem, self._starts(few, begin))
        return [self._values(problem, s.eta) for s in (found.best, *found.rivals)]

    def _cut(
        self, few: Sequence[Experiment], begin: Beginning, places: list[dict[str, float]]
    ) -> tuple[Beginning, list[dict[str, float]]]:
        """Order places by how well they describe the excerpt, each without what it cannot.

        A long dead time leaves few samples to be described. Those that it leaves out count with
        the variance of the output, so that costs of different samples can be compared.
        """
        begins = [replace(begin, unrecorded=self._unrecorded(few, begin, p)) for p in places]
        if all(b == begin for b in begins):
            return begin, places
        rows = sum(e[self.output].size for e in few)
        power = _power(few, self.output) / rows
        found = []
        for place, own in zip(places, begins):
            problem = self.problem(few, own)
            best = solve(problem, _vector(problem, place), tolerance=1e-2)
            left = rows - problem.rows
            length = problem.rows * np.log(best.cost / problem.rows) + left * np.log(power)
            found.append((length, own, self._values(problem, best.eta)))
        found.sort(key=lambda x: x[0])
        begin = found[0][1]
        return begin, [p for _, own, p in found if own.unrecorded <= begin.unrecorded]

    # ------------------------------------------------------------------------ weights of samples

    def _weighed(self, model: NamedModel, ends: Sequence[Mapping[str, float]]) -> NamedModel:
        """The model with the weights of samples that are settled from some ends."""
        if not self.model.robust:
            return model
        problem = bind(model, self.unknowns, self.held)
        starts = [_vector(problem, {**s, **self.request.start}) for s in ends]
        weights = [np.ones(y.size) for y in model.measured]
        for _ in range(_ROUNDS):
            found = solve_from(replace(problem, weights=weights), starts, tolerance=1e-3).best
            rest = [y - m for y, m in zip(model.measured, found.simulate(), strict=True)]
            new, _ = huber_weights(rest, self.request.options.residual_limit)
            change = max(float(np.abs(a - b).max()) for a, b in zip(new, weights))
            if change < 0.05:
                break
            weights, starts = new, [found.eta]
        return replace(model, weights=weights)

    def _limit(self, fitted: Fitted, model: NamedModel) -> float | None:
        """Residual from which samples of a robust fit count less."""
        if not self.model.robust:
            return None
        rest = [y - m for y, m in zip(model.measured, fitted.solution.simulate(), strict=True)]
        return huber_weights(rest, self.request.options.residual_limit)[1]

    # ------------------------------------------------------------------------------------- offset

    def _examine_offset(
        self, fitted: Fitted, model: NamedModel, begin: Beginning
    ) -> tuple[Beginning, dict[str, float], list[Notice]]:
        """Compare the fit with one without its offset, or with one where it has none.

        Runs at rest show their offset before they respond. Where it contradicts that of the fit,
        which then stands for what the model lacks, there is none, unless the user says so.

        Returns
        -------
        What to begin with, the values of that fit, and a warning where the choice matters.
        """
        if not self.model.gain or not begin.rest:
            return begin, dict(fitted.values), []
        other = replace(begin, offset=self._owner if begin.offset == "none" else "none")
        held = {n: v for n, v in fitted.values.items() if n not in fitted.names}
        problem = bind(self.named(self.experiments, other), self.unknowns, held)
        late = fitted.values.get("dead_time", 0.0)  # between samples the cost has a valley each
        starts = [{**fitted.values, "dead_time": share * late} for share in _EARLIER]
        found = solve_from(problem, [_vector(problem, x) for x in starts], tolerance=1e-3).best
        names = [u.name for u in (*problem.nonlinear, *problem.linear) if u.name in fitted.names]
        values = dict(zip(names, (*found.eta.tolist(), *found.linear.tolist())))
        moved = [n for n in names if abs(values[n] - fitted.values[n]) > fitted.half_width(n)]
        quiet = [_before_response(model.columns(k, fitted.values)) & _before_response(
                 model.columns(k, {**fitted.values, **values}))
                 for k in range(len(self.experiments))]  # fmt: skip
        now, error = _level(fitted.solution.residuals, quiet)
        then, its = _level(found.residuals, quiet)
        if not moved or not np.isfinite(error) or abs(then) > max(_SURE * its, abs(now)):
            return begin, dict(fitted.values), []
        better = abs(now) > _SURE * error and abs(then) < 0.5 * abs(now)
        switched = self.request.options.offset is None and other.offset == "none" and better
        most = max(moved, key=lambda n: abs(values[n] - fitted.values[n]) / fitted.half_width(n))
        unit = after_number(fitted.specs[most].unit)
        with_it, without = values[most], fitted.values[most]
        if other.offset == "none":
            with_it, without = without, with_it
        notice = Notice(
            "offset-matters",
            f"{most} is {with_it:.3g}{unit} with an offset of the output and {without:.3g} without "
            "one, further apart than its interval. What the runs show before they respond "
            f"{'speaks against' if better else 'does not exclude'} the other: check the zero of "
            "the sensors, and choose with --offset none or --offset free.",
        )
        return (other, {**fitted.values, **values}, [notice]) if switched else (
            begin, dict(fitted.values), [notice])  # fmt: skip

    # ------------------------------------------------------------------------- noise of the input

    def _allow_for_input_noise(self, fitted: Fitted, begin: Beginning) -> tuple[Fitted, Correct]:
        """The fit corrected for the noise of a measured input, and what corrects another.

        Nothing does where it does not matter, or cannot be allowed for.
        """
        experiments, plain = self.experiments, fitted
        rows, roles = sum(e.samples for e in experiments), moving_inputs(experiments)
        if not roles or not fitted.names or not self.model.allows_for_input_noise:
            return fitted, None
        role = roles[0]
        given = self.request.noise.get(role)
        if rows > _MANY or rows < 200 * len(experiments):
            said = [_not_allowed_for(role)] if given else []
            return replace(fitted, notices=[*fitted.notices, *said]), None

        def build(
            held: Mapping[str, float], some: Sequence[Experiment], white: Sequence[Whitening]
        ) -> Problem:
            model = replace(self.named(some, begin).without_linear(), whiten=white)
            return bind(model, self.unknowns, held)

        refused = {n: r.value(fitted.specs[n]) for n, r in fitted.refused.items()}
        at_hand = partial(build, {**self.held, **refused, **self.request.fixed})
        names = [u.name for u in at_hand(experiments, ()).nonlinear]
        eta = np.array([fitted.values[n] for n in names])
        errors = np.array([fitted.std_error(n) for n in names])
        noise = InputNoise.seen(experiments, role, self.request.seed, given)
        if noise.sigma and noise.effect(at_hand, eta, errors) < _NEGLIGIBLE:
            noise, given = replace(noise, sigma=0.0), noise.sigma
        if noise.sigma and given is None:
            noise = noise.supported(at_hand, eta)
        found: dict[str, Any] = {
            "role": role, "sigma": noise.sigma or given or 0.0,
            "unit": experiments[0].signals[role].unit,
        }  # fmt: skip
        if noise.sigma == 0.0:
            return replace(plain, remarks={"input_noise": found}), None
        found["treatment"] = "residual whitened, score corrected"
        sensible = {s.name: s.sensible for s in self.plan.searched if s.sensible is not None}

        def correct(other: Fitted) -> Fitted:
            self.request.progress("allowing for the noise of the input")
            return correct_named(
                noise, build, other, refusals=self.plan.refusals, sensible=sensible
            )

        return replace(correct(fitted), remarks={"input_noise": found}), correct

    # ------------------------------------------------------------------------------------- rivals

    def _judge_rivals(
        self, end: Fitted, fitted: Fitted, model: NamedModel,
        places: Sequence[Mapping[str, float]], part: NamedModel | None, correct: Correct,
    ) -> Fitted:  # fmt: skip
        """Refuse what has two values, far apart, that the data cannot tell from each other.

        Two that are near each other make one wide interval. ``places`` are where a rough search
        ended. A closer one may slide from there, along a valley that hardly falls, to the best:
        what they cost tells whether it does. Those that are out of the question on ``part`` of
        long logs need no look at the others. Nor do those that are the same end: noise of an input
        that is averaged between samples makes a dead time of half a sample look better, until it
        is allowed for.

        Raises
        ------
        NotIdentifiedError
            Naming both, and how much faster sampling has to be.
        """
        best = fitted.search.best
        names = [n for n in fitted.names if n in fitted.unknowns][: best.eta.size]
        unit = np.nanmedian(information_units(fitted.solution, fitted.covariance))
        held = {n: v for n, v in fitted.values.items() if n in self.unknowns and n not in names}
        problem = bind(model, self.unknowns, held)
        errors = np.array([fitted.std_error(n) for n in names])
        points = [_vector(problem, {**p, **held}) for p in places]
        far = [eta for eta in points if np.any(np.abs(eta - best.eta) > _OTHER * errors)]
        if part is not None and far:
            some = bind(part.scaled(fitted.factors), self.unknowns, held)
            least, *others = profile(some, np.array([best.eta, *far]))
            far = [eta for eta, cost in zip(far, others) if cost - least < DECIDED * unit]
        rivals = [(s.eta, s.cost) for s in fitted.search.rivals]
        for eta, cost in [*rivals, *zip(far, profile(problem, np.array(far)))]:
            if cost - best.cost >= DECISIVE * unit or _is_surely_worse(problem, eta, best):
                continue
            change = eta - best.eta
            apart = [k for k in range(len(names)) if abs(change[k]) > _OTHER * errors[k]]
            if not apart or _leads_to(end, fitted, correct, dict(zip(names, eta))):
                continue
            if all(abs(change[k]) <= _SIMILAR * abs(best.eta[k]) for k in apart):
                end = _widened(end, dict(zip(names, change.tolist())))
                continue
            self._refuse(fitted, apart, dict(zip(names, eta)))
        return end

    def _refuse(self, fitted: Fitted, apart: list[int], rival: Mapping[str, float]) -> None:
        """Refuse one of the values that two fits which explain the logs alike do not share."""
        names = list(rival)
        # a value to fall back on is none where the data allow two others
        apart.sort(key=lambda k: fitted.specs[names[k]].neutral is not None)
        name = names[apart[0]]
        spec, step = fitted.specs[name], time_scales(self.experiments)[0]
        fast = step * max(
            self.model.fastest({**fitted.values, **at}) for at in (fitted.values, rival)
        )
        reason = (
            f"{fitted.values[name]:.3g} and {rival[name]:.3g}{after_number(spec.unit)} explain "
            "these samples equally well"
        )
        if fast > _FAST:
            reason += (
                ", because the output has answered before the next sample is taken. Sample at "
                f"least {max(2, int(np.ceil(fast / _FAST)))} times faster"
            )
        refuse(replace(spec, neutral=None), f"{reason}.")


Correct = Callable[[Fitted], Fitted] | None


def _power(experiments: Sequence[Experiment], output: str) -> float:
    """Sum of squares of the outputs about the mean of every run [square of the unit]."""
    return float(sum(e[output].size * np.var(e[output]) for e in experiments))


def _before_response(basis: Basis) -> npt.NDArray[np.bool_]:
    """Mask of the samples of a run at rest before its response, shape ``(n,)``."""
    return np.cumsum(np.abs(np.diff(basis.shared[:, 0], prepend=basis.shared[0, 0]))) == 0.0


def _level(
    residuals: Sequence[FloatArray], where: Sequence[npt.NDArray[np.bool_]]
) -> tuple[float, float]:
    """Mean of some residuals and its standard error, infinite of fewer than three."""
    values = np.concatenate([r[k] for r, k in zip(residuals, where, strict=True)])
    if values.size < 3:
        return 0.0, np.inf
    return float(values.mean()), float(values.std(ddof=1)) / np.sqrt(values.size)


def _is_surely_worse(problem: Problem, eta: FloatArray, best: StationaryPoint) -> bool:
    """Return whether the squares of the residuals at ``eta`` are larger all along the logs.

    That tells two fits apart whatever the residuals are, noise or what both models lack, where
    their costs alone would have to be compared with noise that is white [1]_.

    References
    ----------
    .. [1] Q. H. Vuong, "Likelihood ratio tests for model selection and non-nested hypotheses",
       Econometrica 57, 1989.
    """
    other = evaluate(problem, eta).residuals
    worse = np.concatenate([np.square(a) - np.square(b) for a, b in zip(other, best.residuals)])
    sums = np.array([float(x.sum()) for x in np.array_split(worse, _BLOCKS)])
    error = float(sums.std(ddof=1)) / np.sqrt(_BLOCKS)
    return bool(sums.mean() > t_quantile(0.999, _BLOCKS - 1) * error)


def _widened(fitted: Fitted, change: Mapping[str, float]) -> Fitted:
    """The fit with errors that hold whatever lies within a change of its values, both ways."""
    d = np.array([change.get(n, 0.0) for n in fitted.names])
    intervals = {n: x for n, x in fitted.intervals.items() if n not in change}
    return replace(fitted, covariance=fitted.covariance + np.outer(d, d) / 3.0, intervals=intervals)


def _leads_to(end: Fitted, plain: Fitted, correct: Correct, rival: Mapping[str, float]) -> bool:
    """Return whether a rival of a plain fit comes to the same end once noise is allowed for."""
    if correct is None:
        return False
    other = correct(replace(plain, values={**plain.values, **rival}))
    return end.names == other.names and all(
        abs(end.values[n] - other.values[n]) <= end.std_error(n) for n in end.names
    )


def _not_allowed_for(role: str) -> Notice:
    return Notice(
        "input-noise-left",
        f"the noise of '{role}' given with --noise could not be allowed for: that takes at least "
        f"200 samples a run, and {_MANY} at most in all. Record longer runs, or cut the log with "
        "--window.",
    )


def huber_weights(
    rest: Sequence[FloatArray], limit: float | None
) -> tuple[list[FloatArray], float]:
    """Roots of Huber's weights, ``(n_i,)``, and the residual from which a sample counts less.

    ``rest`` is what a model leaves, ``(n_i,)`` each; without a ``limit`` it follows from that.
    """
    if limit is None:
        limit = _HUBER * 1.4826 * float(np.median(np.abs(np.concatenate(rest))))
    return [np.sqrt(np.minimum(1.0, limit / np.maximum(np.abs(r), 1e-300))) for r in rest], limit


def fit_robustly(columns: FloatArray, values: FloatArray, limit: float | None) -> FloatArray:
    """Least squares ``(q,)`` in which residuals beyond ``limit`` count less; all alike if None."""
    weights = np.ones(values.size)
    for _ in range(_ROUNDS):
        found = np.linalg.lstsq(columns * weights[:, None], values * weights, rcond=None)[0]
        if limit is None:
            break
        (weights,), _ = huber_weights([values - columns @ found], limit)
    return np.asarray(found)


def _is_quiet(values: FloatArray, count: int) -> bool:
    """Return whether the first ``count`` values show only noise; fewer than three count as quiet.

    They must neither scatter more than the noise nor lie on a slope.
    """
    early = values[:count]
    if early.size < 3:
        return True
    noise = noise_floor(values[middle_of(values.size)], 4)
    t = np.linspace(-1.0, 1.0, early.size)
    slope = float(t @ early) / np.sqrt(float(t @ t))
    allowed = 1.0 + 6.0 * np.sqrt(2.0 / early.size)
    return bool(np.var(early) <= noise**2 * allowed and abs(slope) <= 3.0 * noise)


def _may_rest(signal: Signal) -> bool:
    """True if an input may have been at rest before its first sample: it does not move there yet.

    One that is held may have stepped at any of its samples.
    """
    change = np.abs(np.diff(signal.values[:_LONG_ENOUGH]))
    if signal.hold == "zoh" or change.size < 2:
        return True
    return bool(change[0] <= _AT_REST * np.median(change) + 3.0 * noise_floor(signal.values, 4))


def _are_stepped(experiments: Sequence[Experiment]) -> bool:
    """True if the input of every run is a step that was not recorded: it was at rest before."""
    return all(any(s.time.size == 1 for s in e.signals.values()) for e in experiments)


def _apart(points: FloatArray) -> list[FloatArray]:
    """The first few of points, best first, that are not close to one another."""
    out: list[FloatArray] = []
    for point in points:
        if not any(np.all(np.abs(point - p) <= 0.15 * np.abs(p)) for p in out):
            out.append(point)
    return out[:_RIVALS]


def _vector(problem: Problem, start: Mapping[str, float]) -> FloatArray:
    return np.array([start[u.name] for u in problem.nonlinear])
