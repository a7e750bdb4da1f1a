"""What transfer-function families share: the fit, the simulation, the model, the block.

A family is its equation (a state space as a function of named values), its parameters, and
where a search for them begins.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from ...errors import Notice
from ...estimation.discrete import discretise
from ...estimation.information import sensitivity
from ...estimation.named_model import Values, bind, check_request, make_unknowns
from ...estimation.parametric import Fitted
from ...estimation.problem import Unknown
from ...estimation.results import Refusal
from ...estimation.unmodelled_effects import soft_edges
from ...experiment import Experiment, FloatArray, Hold
from ...family import (
    Excitation,
    Family,
    FamilyOptions,
    Information,
    NoiseModel,
    ParameterDocument,
    Plant,
    Quantity,
    Request,
    Simulated,
    Solution,
    UnmodelledEffect,
    Variant,
    make_solution,
)
from ...options import settled
from .block import TransferBlock
from .fit import TransferFit, dead_time_axis, grid_search, unrecorded_time
from .model import Free, TransferModel, any_start, are_short, simulate_transfer, time_scales


@dataclass(frozen=True)
class TransferOptions(FamilyOptions):
    """What the fit of every transfer function settles."""

    initial_state: str | None = settled(
        "choice", "whether the runs begin at rest or in any state", choices=("free", "rest")
    )
    offset_of: str | None = settled(
        "choice",
        "whether each run has its own output offset, or, where runs are short, each log",
        choices=("run", "log"),
    )
    unrecorded: float | None = settled(
        "float",
        "time at the start of every run during which the output answers to an input before it",
        unit="s", minimum=0.0,
    )  # fmt: skip


@dataclass(frozen=True)
class Searched:
    """How a nonlinear parameter is searched for [SI].

    Attributes
    ----------
    scale, limits
        Typical size and search range.
    axis
        Values to try first, shape ``(k,)``; dead times are tried in proportion to the lag.
    sensible
        Half-width beyond which an interval is useless; the value found when ``None``.
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
    """How the search for the parameters of one set of logs goes.

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
    lag: Callable[[Mapping[str, float]], float]
    fixed: Mapping[str, float] = field(default_factory=dict)
    refusals: Sequence[Refusal] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the nonlinear parameters."""
        return tuple(s.name for s in self.searched)

    @property
    def axes(self) -> dict[str, FloatArray]:
        """Values to try first."""
        return {s.name: s.axis for s in self.searched}


ASKED = ("none", "estimate")  # of a parameter that is estimated on request

T = TypeVar("T", bound=TransferOptions)


class TransferFamily(Family[T], Generic[T]):
    """Base of the transfer-function families.

    Attributes
    ----------
    gain
        Name of the parameter that multiplies the response, ``None`` where it is part of
        the state space.
    dead_zone
        Whether the input passes ``dead_zone_negative`` and ``dead_zone_positive`` first.
    """

    gain: ClassVar[str | None] = None
    dead_zone: ClassVar[bool] = False
    allows_for_input_noise = True

    @staticmethod
    @abstractmethod
    def realise(values: Values) -> tuple[Any, Any, Any]:
        """State space ``(A, B, C)``, analytic in the values; of unit gain where there is one."""

    @abstractmethod
    def coefficients(self, values: Mapping[str, float]) -> tuple[list[float], list[float]]:
        """Numerator and denominator, falling powers of ``s``."""

    @abstractmethod
    def plan(self, experiments: Sequence[Experiment], request: Request[T]) -> Plan:
        """How the fit of these logs begins."""

    @abstractmethod
    def derive(self, fitted: Fitted, options: T) -> tuple[dict[str, Quantity], list[Notice]]:
        """Numbers computed from the parameters, and what is to be said of them."""

    def starts(
        self,
        variant: Variant,
        plan: Plan,
        experiments: Sequence[Experiment],
        rest: bool,
        unknowns: Mapping[str, Unknown],
        request: Request[T],
    ) -> list[dict[str, float]]:
        """Where to begin: the valleys of the cost over a grid, best first."""
        step, span = time_scales(experiments)
        model = self.transfer_model(variant, experiments, rest).named(plan.names)
        return grid_search(
            bind(model, unknowns, request.fixed),
            plan.axes,
            lambda at: dead_time_axis(step, 0.5 * span, plan.lag({**request.fixed, **at})),
        )

    def elsewhere(self, values: Values, step: float) -> list[dict[str, float]]:
        """Far from some values, others that samples every ``step`` [s] may not tell from them."""
        return []

    def beginnings(self, values: Values) -> Free:
        """What a run with an offset of its own may have begun with; any state."""
        return any_start(*self.realise(values))

    def transfer_model(
        self,
        variant: Variant,
        experiments: Sequence[Experiment],
        rest: bool = False,
        common_offset: bool = False,
        unrecorded: float = 0.0,
    ) -> TransferModel:
        """The model of some experiments, as the estimation takes it."""
        return TransferModel(
            experiments,
            variant.driving[0].name,
            variant.output.name,
            self.realise,
            self.beginnings,
            gain=self.gain,
            dead_zone=self.dead_zone,
            rest=rest,
            common_offset=common_offset,
            unrecorded=unrecorded,
        )

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request[T]
    ) -> Solution[T]:
        """Output-error fit from several starts; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        plan = self.plan(experiments, request)
        request = replace(request, fixed={**plan.fixed, **request.fixed})
        every = (*plan.names, self.gain) if self.gain else plan.names
        scales = {s.name: s.scale for s in plan.searched}
        limits = {s.name: s.limits for s in plan.searched}
        unknowns = make_unknowns(variant.parameters, every, scales, request, limits)
        state, owner = request.options.initial_state, request.options.offset_of
        common = are_short(experiments) if owner is None else owner == "log"

        def run(unrecorded: float, still: bool | None) -> tuple[Fitted, bool]:
            def make(some: Sequence[Experiment], rest: bool) -> TransferModel:
                return self.transfer_model(variant, some, rest, common, unrecorded)

            return TransferFit(
                lambda some, rest: make(some, rest).named(plan.names),
                lambda some, rest: self.starts(variant, plan, some, rest, unknowns, request),
                experiments,
                variant.output.name,
                variant.parameters,
                request,
                unknowns,
                {s.name: s.sensible for s in plan.searched if s.sensible is not None},
                {s.name: s.idle for s in plan.searched if s.idle is not None},
                plan.refusals,
                partial(self.elsewhere, step=time_scales(experiments)[0]),
                lambda values: float(np.abs(np.linalg.eigvals(self.realise(values)[0])).max()),
            ).run(still)

        unrecorded = request.options.unrecorded
        fitted, rest = run(unrecorded or 0.0, None if state is None else state == "rest")
        if unrecorded is None:
            unrecorded = unrecorded_time(experiments, variant.output.name, fitted.values, rest)
            if unrecorded is not None:
                fitted, rest = run(unrecorded, rest)
        parameters, order, covariance = fitted.quantities(variant.parameters, experiments[0].units)
        table, drift = fitted.compare_logs(experiments)
        derived, said = self.derive(fitted, request.options)
        settled = replace(
            request.options,
            initial_state="rest" if rest else "free",
            offset_of="log" if common else "run",
            unrecorded=unrecorded,
        )
        return make_solution(
            self.simulate,
            experiments,
            variant,
            settled,
            parameters,
            order,
            NoiseModel(covariance, fitted.degrees, fitted.independent, fitted.input_noise),
            jacobians=[{variant.output.name: j} for j in fitted.sensitivity()],
            derived=derived,
            notices=[*fitted.notices, *drift, *said],
            details={**fitted.details(), **table},
        )

    def simulate(
        self, plant: Plant[T], experiments: Sequence[Experiment], offset: float | None = None
    ) -> list[Simulated]:
        """Output from the input; see :meth:`Family.simulate`."""
        output, options = plant.variant.output.name, plant.options
        unrecorded, rest = options.unrecorded, options.initial_state == "rest"
        compared = all(output in e for e in experiments)
        if unrecorded is None and compared:  # other logs may have been cut in motion
            unrecorded = unrecorded_time(experiments, output, plant.numbers, rest)
        model = self.transfer_model(
            plant.variant,
            experiments,
            rest,
            options.offset_of == "log",
            (unrecorded or 0.0) if compared else 0.0,
        )
        return simulate_transfer(model, plant.numbers, offset)

    def information(self, plant: Plant[T], experiment: Experiment) -> Information:
        """Sensitivities by complex steps; see :meth:`Family.information`."""
        v = plant.numbers
        model = self.transfer_model(plant.variant, [experiment])
        level = v[self.gain] * model.levels[0] if self.gain else 0.0
        return sensitivity(model.named([n for n in v if n != self.gain]), v, level)

    def model(self, plant: Plant[T], sample_time: float, hold: Hold) -> dict[str, Any]:
        """Dead zone, continuous transfer function, and the discrete one of a held input."""
        v = plant.numbers
        numerator, denominator = self.coefficients(v)
        dead_time = v.get("dead_time", 0.0)
        section: dict[str, Any] = {}
        if self.dead_zone:
            section["input_nonlinearity"] = {
                "dead_zone_negative": v["dead_zone_negative"],
                "dead_zone_positive": v["dead_zone_positive"],
                "slope": 1.0,
            }
        section["continuous"] = {
            "numerator": numerator, "denominator": denominator, "dead_time": dead_time,
        }  # fmt: skip
        if sample_time > 0.0:
            section["discrete"] = discretise(numerator, denominator, sample_time, dead_time)
        return section

    def unmodelled_effects(self, plant: Plant[T]) -> Sequence[UnmodelledEffect]:
        """Soft edges of a dead zone; see :meth:`Family.unmodelled_effects`."""
        if not self.dead_zone:
            return []
        v, (role,) = plant.numbers, plant.variant.driving
        return [soft_edges(plant, role.name, (v["dead_zone_negative"], v["dead_zone_positive"]))]

    def excitation(self, variant: Variant, document: ParameterDocument) -> Excitation:
        """A command, played to the input; see :meth:`Family.excitation`."""
        return Excitation("command")

    def suppose(
        self, name: str, plant: Plant[T], amplitude: tuple[float, float], sample_time: float
    ) -> float | None:
        """A dead zone of a fifth of the range, a dead time of one and a half samples."""
        sides = {"dead_zone_negative": amplitude[0], "dead_zone_positive": amplitude[1]}
        if name in sides:
            return 0.2 * sides[name]
        return 1.5 * sample_time if name == "dead_time" else None

    def block(self, variant: Variant, document: ParameterDocument) -> TransferBlock:
        """The model that a controller steps; see :class:`TransferBlock`."""
        return TransferBlock(document, variant, self.coefficients)
