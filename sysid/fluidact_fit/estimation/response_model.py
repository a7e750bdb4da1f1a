"""Declaration of a family whose response in time is fitted, and the task of one fit.

A family gives its model as a function of named values, the parameters to search for, and starts
(:class:`ResponseModel`). :func:`.fit_response` does the rest.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Generic, TypeVar

import numpy as np

from ..experiment import Experiment, FloatArray
from ..options import FamilyOptions, choice, settled
from ..specification import Request, Variant
from .named_model import NamedModel, bind, check_request, make_unknowns
from .problem import Problem, Unknown
from .results import Refusal, held_by
from .separable import Search, solve_from
from .starts import dead_time_axis, grid_search, time_scales

_REACH = 8  # length of the part of a log that an excerpt is spread over, per length of that


@dataclass(frozen=True)
class Beginning:
    """Initial conditions of the runs of a fit.

    Attributes
    ----------
    rest
        Whether all begin at rest; else with any state.
    offset
        ``"run"`` where every run has an output offset, ``"log"`` where every log has one, or
        ``"none"``.
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
    max_half_width
        Half-width beyond which a 95 % interval is useless; the estimate itself when ``None``.
    no_effect_at
        Value without effect on these logs.
    """

    name: str
    scale: float = 1.0
    limits: tuple[float, float] = (-np.inf, np.inf)
    axis: FloatArray = field(default_factory=lambda: np.zeros(1))
    max_half_width: float | None = None
    no_effect_at: float | None = None


@dataclass(frozen=True)
class Plan:
    """Plan of the search for the parameters of one set of logs.

    Attributes
    ----------
    searched
        Nonlinear parameters of the model, with those that an option frees (:meth:`asked_for`).
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

    @property
    def max_half_widths(self) -> dict[str, float]:
        """Half-widths of intervals beyond which a parameter is refused, by name."""
        return {s.name: s.max_half_width for s in self.searched if s.max_half_width is not None}

    @property
    def no_effect_at(self) -> dict[str, float]:
        """Values at which a parameter has no effect, by name."""
        return {s.name: s.no_effect_at for s in self.searched if s.no_effect_at is not None}

    def asked_for(self, variant: Variant, request: Request[ResponseOptions]) -> Plan:
        """The plan without what an option has estimated on request, where it is not.

        The model lacks an optional parameter then, and has another at its neutral value.
        """
        unasked = request.options.unasked - request.fixed.keys()
        specs = [s for s in variant.parameters if s.name in unasked]
        lacking = {s.name for s in specs if s.optional}
        return replace(
            self,
            searched=[s for s in self.searched if s.name not in lacking],
            fixed={**{s.name: s.neutral or 0.0 for s in specs if not s.optional}, **self.fixed},
        )


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
        Length of the part of a long log over which the samples of an excerpt are spread, per length
        of the excerpt. A dead time needs a long part, an output that accumulates errors of a start
        a short one.
    many_minima
        Whether the cost at a start says little about the optimum that a search from it finds.
    """

    gain: ClassVar[str | None] = None
    common_offset: ClassVar[bool] = True
    robust: ClassVar[bool] = False
    allows_for_input_noise: ClassVar[bool] = False
    reach: ClassVar[int] = _REACH
    many_minima: ClassVar[bool] = False

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
        self, task: ResponseTask[T], experiments: Sequence[Experiment], begin: Beginning
    ) -> list[dict[str, float]]:
        """Return starts: the valleys of the cost over a grid, best first."""
        step, span = time_scales(experiments)
        held = task.held

        def dead_times(at: Mapping[str, float]) -> FloatArray:
            return dead_time_axis(step, 0.5 * span, task.plan.lag({**held, **at}))

        axes = {s.name: s.axis for s in task.plan.searched}
        return grid_search(task.problem(experiments, begin), axes, dead_times)

    def alternative_starts(
        self, values: Mapping[str, float], step: float
    ) -> list[dict[str, float]]:
        """Return distant values that samples every ``step`` [s] may not tell from these."""
        return []


@dataclass(frozen=True)
class ResponseTask(Generic[T]):
    """Logs to be fitted, the user's request, and the family's plan for them."""

    model: ResponseModel[T]
    variant: Variant
    experiments: Sequence[Experiment]
    request: Request[T]
    plan: Plan

    @classmethod
    def of(
        cls, model: ResponseModel[T], variant: Variant, experiments: Sequence[Experiment],
        request: Request[T], plan: Plan | None = None,
    ) -> ResponseTask[T]:  # fmt: skip
        """Return the task of a request; the family makes the ``plan`` if none is given."""
        check_request(variant.parameters, request)
        plan = (plan or model.plan(experiments, request)).asked_for(variant, request)
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
        """Values that are held from the start, by name [SI]."""
        return {**held_by(self.plan.refusals), **self.request.fixed}

    @property
    def output(self) -> str:
        """Role of the output."""
        return self.variant.output.name

    def named(self, experiments: Sequence[Experiment], begin: Beginning) -> NamedModel:
        """The model of some experiments."""
        return self.model.response(self.variant, experiments, begin, self.plan.names)

    def problem(self, experiments: Sequence[Experiment], begin: Beginning) -> Problem:
        """The solver's problem of some experiments."""
        return bind(self.named(experiments, begin), self.unknowns, self.held)

    @property
    def owner(self) -> str:
        """Owner of an output offset: ``"run"`` or, where runs are short, ``"log"``."""
        return "log" if self.model.common_offset and are_short(self.experiments) else "run"

    def values(self, problem: Problem, eta: FloatArray) -> dict[str, float]:
        """Every searched and held value, from the solution of a problem."""
        return {**self.held, **problem.named(eta)}

    def starts(self, some: Sequence[Experiment], begin: Beginning) -> list[dict[str, float]]:
        """Starts of the family; the user's own take precedence."""
        return [{**s, **self.request.start} for s in self.model.starts(self, some, begin)]

    def search(self, problem: Problem, starts: Sequence[Mapping[str, float]]) -> Search:
        """Solve roughly from every start."""
        return solve_from(problem, [problem.vector(s) for s in starts], tolerance=1e-2)


def are_short(experiments: Sequence[Experiment]) -> bool:
    """Return whether runs have too few samples for offsets and initial states of their own.

    In a run of ten samples that begins with the step these would explain the whole response. In a
    run of a hundred or more they cost hardly any accuracy.
    """
    return sum(e.samples for e in experiments) < 100 * len(experiments)
