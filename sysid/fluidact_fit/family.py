"""The contract that every model family fills in.

A family is one file or package in ``families`` and one line in its registry. Everything else
(the subcommand and its help, the parameter names a file may hold, the JSON Schema, the
generic tests) iterates over the registry and knows families only through the types below.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, Literal, Self, TypeVar

import numpy as np

from .block import Block
from .estimation.blocks import joined
from .estimation.solution import NoiseModel, Solution, make_solution
from .experiment import BoolArray, Experiment, FloatArray, Hold
from .options import FamilyOptions
from .parameters.document import ParameterDocument
from .rows import LONG
from .specification import (
    Information,
    NoiseLevel,
    ParameterSpec,
    Plant,
    Quantity,
    Request,
    Role,
    Simulate,
    Simulated,
    Status,
    Structure,
    UnmodelledEffect,
    Value,
    Variant,
    scalars,
)

__all__ = [
    "Block", "Curve", "Excitation", "Family", "FamilyOptions", "Information", "NoiseLevel",
    "NoiseModel", "ParameterDocument", "ParameterSpec", "PhysicsView", "Plant", "Quantity",
    "Request", "Role", "Simulate", "Simulated", "Solution", "StaticView", "Status", "Structure",
    "UnmodelledEffect", "Value", "Variant", "make_solution", "scalars",
]  # fmt: skip

OptionsT = TypeVar("OptionsT", bound=FamilyOptions)
Runs = Sequence[tuple[Experiment, Simulated]]  # of a picture, each with its simulation


@dataclass(frozen=True)
class Excitation:
    """Design of the next experiment of a machine.

    Attributes
    ----------
    kind
        ``"command"`` plays a waveform to the driving role, ``"strokes"`` moves at constant
        speeds back and forth, ``"points"`` holds a static map at chosen points; ``"none"``
        means that it cannot be designed.
    reason
        Why it cannot be designed, a clause.
    fastest
        Lowest and highest speed of strokes [m/s or rad/s].
    slowest
        Speed above which a fit keeps samples [m/s or rad/s].
    noise
        Standard deviation of the output about the static map [SI].
    options
        Options with which strokes are judged, where they differ from those of the file.
    """

    kind: Literal["command", "strokes", "points", "none"]
    reason: str = ""
    fastest: tuple[float, float] = (0.0, 0.0)
    slowest: float = 0.0
    noise: float = 0.0
    options: FamilyOptions | None = None


@dataclass(frozen=True)
class Curve:
    """A line or a set of points of a picture: ``x`` and ``y`` of one shape [SI]."""

    label: str
    x: FloatArray
    y: FloatArray


@dataclass(frozen=True)
class StaticView:
    """Content of a picture of a static map: output over one quantity, without time.

    Attributes
    ----------
    x_name, x_unit, y_name, y_unit
        What the axes are; SI.
    x, measured, fitted
        The samples and the model at them, shape ``(n,)`` each [SI].
    used
        Which samples were fitted, shape ``(n,)``, boolean.
    curves
        The fitted curve or lines, as finely as they should be drawn.
    points
        Points that define the curve, for example control points.
    """

    x_name: str
    x_unit: str
    y_name: str
    y_unit: str
    x: FloatArray
    measured: FloatArray
    fitted: FloatArray
    used: BoolArray
    curves: Sequence[Curve] = ()
    points: Curve | None = None

    @classmethod
    def over(
        cls, runs: Runs, x: str, y: str, curves: Sequence[Curve], points: Curve | None = None
    ) -> Self:
        """The view of a role ``y`` over a role ``x``, as runs recorded and a model simulated them.

        Samples count that both hold and the simulation describes.
        """
        units, role = runs[0][0].units, joined([e.sampled(x) for e, _ in runs])
        measured, fitted = joined([e.sampled(y) for e, _ in runs]), [s.output for _, s in runs]
        described = [
            np.ones(s.output.size, dtype=bool) if s.used is None else s.used for _, s in runs
        ]
        used = np.isfinite(role) & np.isfinite(measured) & joined(described)
        return cls(x, units[x], y, units[y], role, measured, joined(fitted), used, curves, points)


@dataclass(frozen=True)
class PhysicsView:
    """The law inside a dynamic model, drawn without time beside what was measured of it.

    Attributes
    ----------
    title
        What is shown, a few words.
    x_name, x_unit, y_name, y_unit
        What the axes are; SI.
    samples
        What was measured, as points; those at NaN are left out.
    curves
        The law, as finely as it should be drawn; lines end at NaN.
    """

    title: str
    x_name: str
    x_unit: str
    y_name: str
    y_unit: str
    samples: Curve
    curves: Sequence[Curve]


class Family(ABC, Generic[OptionsT]):
    """A model family: equation, roles, parameters, estimation, and what a controller runs.

    Subclasses set the class attributes and fill in the abstract methods. The equation
    itself is a plain function of the module that can be used without any fitter.

    Attributes
    ----------
    name
        Kebab-case; the subcommand and what a file names.
    title, equation
        For people: one line each.
    variants
        Sets of roles with the parameter tables that go with them.
    options_type
        The family's own options (:mod:`.options`).
    block_type
        What a controller gets, where :meth:`block` does not choose.
    steady_offset
        Whether the output carries an offset at rest that a controller needs, such as the
        pressure at which a valve idles. The file then holds its mean over the logs.
    allows_for_input_noise
        Whether the estimate takes noise of measured inputs into account, as ``--noise`` gives it.
    examined
        Samples of every run by which the examinations that simulate judge what is always there:
        all that count where simulations are cheap, fewer where each takes its time.
    next_experiment
        How the next experiment is designed, where that does not depend on the file.
    structures
        Forms of the equation among which logs can choose (:mod:`.structures`), the simplest
        first; none where there is one form only.
    """

    name: str
    title: str
    equation: str
    variants: tuple[Variant, ...]
    options_type: type[OptionsT]
    block_type: ClassVar[type[Block]]
    steady_offset: ClassVar[bool] = False
    allows_for_input_noise: ClassVar[bool] = False
    examined: ClassVar[int] = LONG
    next_experiment: ClassVar[Excitation] = Excitation(
        "none", "the family cannot predict what an experiment would show"
    )
    structures: ClassVar[tuple[Structure, ...]] = ()

    def variants_for(self, options: OptionsT) -> tuple[Variant, ...]:
        """Variants that can be meant under the given options; usually all of them."""
        return self.variants

    def variant(self, name: str | None) -> Variant:
        """The variant of that name; without one, the first.

        Raises
        ------
        KeyError
            When the family has none of that name: what people write is checked before.
        """
        if name is None:
            return self.variants[0]
        return {v.name: v for v in self.variants}[name]

    @abstractmethod
    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request[OptionsT]
    ) -> Solution[OptionsT]:
        """Fit the family to the experiments.

        Raises
        ------
        NotIdentifiedError
            When the data cannot determine a parameter that has no neutral value.
        LogError
            When the data cannot be used at all.
        """

    @abstractmethod
    def simulate(
        self, plant: Plant[OptionsT], experiments: Sequence[Experiment], offset: float | None = None
    ) -> list[Simulated]:
        """Simulate the outputs of experiments from their inputs.

        Offset and initial state, which belong to a log and not to the machine, are fitted
        to the experiment's own output where it has one (runs of one log share their
        offset). Where it has none the run starts from rest, about ``offset`` [SI].
        """

    def block(self, variant: Variant, document: ParameterDocument) -> Block:
        """Return the object that ``fluidact_fit.load`` gives a controller."""
        return self.block_type(document, variant)

    def model(self, plant: Plant[OptionsT], sample_time: float, hold: Hold) -> dict[str, Any]:
        """Return the ``model`` part of the file: what a controller runs.

        It has to change with every parameter: a reader compares it with the parameters, so
        that neither can be edited alone.
        """
        return {}

    def derived(self, values: Mapping[str, Any], options: OptionsT) -> Mapping[str, Any]:
        """Return the derived numbers that follow from parameters and options alone, by name.

        They are analytic in the values, for standard errors. A reader computes them again.
        """
        return {}

    def information(self, plant: Plant[OptionsT], experiment: Experiment) -> Information | None:
        """Return the information that an experiment would give, from its inputs alone.

        ``None`` for a family that cannot say: its next experiment cannot be designed.
        """
        return None

    def unmodelled_effects(self, plant: Plant[OptionsT]) -> Sequence[UnmodelledEffect]:
        """Return effects that every fit is tested for, besides parameters, delays and lags."""
        return ()

    def excitation(self, variant: Variant, document: ParameterDocument) -> Excitation:
        """Return how the next experiment can be designed from a file of this family."""
        return self.next_experiment

    def prior_guess(
        self, name: str, plant: Plant[OptionsT], amplitude: tuple[float, float], sample_time: float
    ) -> float | None:
        """Plausible value of a parameter that was not identified, to design an experiment with.

        Parameters
        ----------
        name, plant
            The parameter, and the model of the file with earlier guesses.
        amplitude
            Lowest and highest value of the driving role [SI].
        sample_time
            [s]

        Returns
        -------
        float or None
            ``None`` where nothing is plausible: the design then leaves it out.
        """
        return None

    def in_common(
        self, values: Sequence[Mapping[str, Value]]
    ) -> tuple[Sequence[Mapping[str, Value]], str]:
        """Return parameters of several fits over what all of them cover, to compare them.

        Returns
        -------
        The values by name, without those that have nothing in common, and a sentence on what is
        common; empty where the parameters do not depend on what a log covered.
        """
        return values, ""

    def static_view(self, plant: Plant[OptionsT], runs: Runs) -> StaticView | None:
        """Return what a picture of a static map shows, ``None`` for a dynamic model.

        ``runs`` are experiments, each with what :meth:`simulate` gave for it.
        """
        return None

    def physics_view(self, plant: Plant[OptionsT], runs: Runs) -> PhysicsView | None:
        """Return the law inside a dynamic model as a picture shows it, ``None`` for none.

        Parameters are those of :meth:`static_view`.
        """
        return None
