"""Common base of transfer-function families: the fit, the simulation, the model, the block.

A family is its transfer function of named values, its parameters, and where a search for them
begins.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from ...errors import Notice
from ...estimation.information import sensitivity
from ...estimation.named_model import NamedModel, Values
from ...estimation.parametric import Fitted
from ...estimation.response import fit_response
from ...estimation.response_model import (
    Beginning,
    ResponseOptions,
    ResponseTask,
    Searched,
)
from ...estimation.sampled import discretise
from ...estimation.transfer_model import ANY, TransferModel, TransferResponse, state_space
from ...experiment import Array, Experiment, Hold
from ...family import (
    Excitation,
    Family,
    Information,
    ParameterDocument,
    ParameterSpec,
    Plant,
    Request,
    Solution,
    UnmodelledEffect,
    Variant,
)
from .block import TransferBlock, TransferFunction

ASKED = ("none", "estimate")  # of a parameter that is estimated on request

T = TypeVar("T", bound=ResponseOptions)


def dead_time(before: str, remedy: str, *, optional: bool = False) -> ParameterSpec:
    """The dead time; ``before`` is what it passes before."""
    return ParameterSpec(
        "dead_time", "s", before, neutral=0.0, minimum=0.0, optional=optional, curved=True,
        remedy=remedy,
    )  # fmt: skip


def any_dead_time(step: float, span: float) -> Searched:
    """Search range of the dead time, for the scales of :func:`.time_scales`."""
    return Searched("dead_time", step, (0.0, 0.5 * span), max_half_width=0.25 * span)


class TransferFamily(TransferResponse[T], Family[T], Generic[T]):
    """Base of the transfer-function families.

    Attributes
    ----------
    dead_zone
        Whether the input passes ``dead_zone_negative`` and ``dead_zone_positive`` first.
    derived_units
        SI units of the derived numbers, by name.
    """

    dead_zone: ClassVar[bool] = False
    allows_for_input_noise = True
    next_experiment = Excitation("command")

    derived_units: ClassVar[Mapping[str, str]]

    @abstractmethod
    def coefficients(self, values: Values) -> tuple[list[Any], list[Any]]:
        """Numerator and denominator, falling powers of ``s``, without dead time and :attr:`gain`.

        Analytic in the values.
        """

    def notices(self, fitted: Fitted, options: T) -> list[Notice]:
        """Notices about the derived numbers."""
        return []

    def realise(self, values: Values) -> tuple[Array, Array, Array]:
        """State space of the :meth:`coefficients`."""
        return state_space(*self.coefficients(values))

    def transfer_function(self, values: Mapping[str, float]) -> TransferFunction:
        """The whole transfer function; a dead zone stands before it."""
        numerator, denominator = self.coefficients(values)
        gain = values[self.gain] if self.gain else 1.0
        return TransferFunction(
            tuple(gain * x for x in numerator), tuple(denominator), values.get("dead_time", 0.0)
        )

    def follow(self, values: Values, change: Mapping[str, float]) -> dict[str, float]:
        """Where a change of some values leads, straight on; see :class:`.NamedModel`."""
        return {n: values[n] + step for n, step in change.items()}

    def beginnings(self, values: Values, offset: bool) -> tuple[Array, Array, Sequence[int]]:
        """What runs may begin with, the output being ``C exp(A t) e_i`` for these states ``i``.

        They are as many whatever the values are, for derivatives are taken column by column. Any
        state by default; none whose response is constant where a run has an ``offset`` of its own.
        """
        a, _, c = self.realise(values)
        return a, c, range(c.size)

    def fastest(self, values: Values) -> float:
        """Largest pole [rad/s]."""
        return float(np.abs(np.linalg.eigvals(self.realise(values)[0])).max())

    def transfer_model(
        self, variant: Variant, experiments: Sequence[Experiment], begin: Beginning = ANY
    ) -> TransferModel:
        """The model of some experiments."""
        return TransferModel(self, variant, experiments, begin)

    def response(
        self, variant: Variant, experiments: Sequence[Experiment], begin: Beginning,
        names: tuple[str, ...],
    ) -> NamedModel:  # fmt: skip
        """The model as the estimation takes it; see :meth:`ResponseModel.response`."""
        return replace(super().response(variant, experiments, begin, names), follow=self.follow)

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request[T]
    ) -> Solution[T]:
        """Output-error fit from several starts; see :meth:`Family.estimate`."""
        found = fit_response(ResponseTask.of(self, variant, experiments, request))
        fitted, options = found.solved, found.settled(request.options)
        derived = fitted.derive(self.derived_units, lambda v: self.derived(v, options))
        return found.solution(
            self.simulate, experiments, variant, options, derived, self.notices(fitted, options)
        )

    def information(self, plant: Plant[T], experiment: Experiment) -> Information:
        """Sensitivities by complex steps; see :meth:`Family.information`."""
        v = plant.numbers
        model = TransferModel(self, plant.variant, [experiment])
        named = model.named([n for n in v if n != self.gain])
        return sensitivity(named, v, model.steady_level(0, v))

    def model(self, plant: Plant[T], sample_time: float, hold: Hold) -> dict[str, Any]:
        """The continuous transfer function, and the discrete one of a held input."""
        f = self.transfer_function(plant.numbers)
        parts = list(f.numerator), list(f.denominator), f.dead_time
        section = {"continuous": dict(zip(("numerator", "denominator", "dead_time"), parts))}
        if sample_time > 0.0:
            section["discrete"] = discretise(f.numerator, f.denominator, sample_time, f.dead_time)
        return section

    def unmodelled_effects(self, plant: Plant[T]) -> Sequence[UnmodelledEffect]:
        """Beginnings left out on request; see :meth:`Family.unmodelled_effects`."""
        return self.beginnings_left_out(plant)

    def prior_guess(
        self, name: str, plant: Plant[T], amplitude: tuple[float, float], sample_time: float
    ) -> float | None:
        """A dead time of one and a half samples; see :meth:`Family.prior_guess`."""
        return 1.5 * sample_time if name == "dead_time" else None

    def block(self, variant: Variant, document: ParameterDocument) -> TransferBlock:
        """The model that a controller steps; see :class:`TransferBlock`."""
        return TransferBlock(document, variant, self.transfer_function)
