"""The contract that every model family fills in.

A family is one file or package in ``families`` and one line in its registry. Everything else
(the subcommand and its help, the parameter names a file may hold, the JSON Schema, the
generic tests) iterates over the registry and knows families only through the types below.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, Literal, TypeVar

import numpy as np
import numpy.typing as npt

from .block import Block
from .errors import Notice
from .experiment import Experiment, FloatArray, Hold
from .options import FamilyOptions
from .parameters.document import ParameterDocument
from .specification import (
    ParameterSpec,
    Plant,
    Quantity,
    ReadT,
    Role,
    Status,
    Value,
    Variant,
    scalars,
)

__all__ = [
    "Block", "Curve", "Departure", "Estimate", "Excitation", "Family", "FamilyOptions",
    "Information", "ParameterDocument", "ParameterSpec", "Plant", "Quantity", "Request", "Role",
    "Simulate", "Simulated", "StaticView", "Status", "Value", "Variant", "scalars",
]  # fmt: skip

OptionsT = TypeVar("OptionsT", bound=FamilyOptions)
Simulate = Callable[[Plant[Any], Sequence[Experiment]], Sequence["Simulated"]]


@dataclass(frozen=True)
class Departure:
    """A way in which a machine may depart from the model, that no parameter stands for.

    Attributes
    ----------
    name, words, remedy
        What it is called in the file, what follows "the data fit better if", and what to do.
    response
        Derivatives of the channels of every experiment by its size, shape ``(n,)`` [SI] each, of
        the experiments and what simulates them near the fit. A channel without stays as it is.
    unit
        Of its size; where it is ``of`` a role, that of the role.
    positive
        Whether its size cannot be negative, as that of friction cannot.
    """

    name: str
    words: str
    remedy: str
    response: Callable[[Sequence[Experiment], Simulate], Sequence[Mapping[str, FloatArray]]]
    unit: str = "1"
    positive: bool = False
    of: str = ""


@dataclass(frozen=True)
class Request(Generic[ReadT]):
    """What the user chose: everything of a fit that is not data.

    ``fixed``, ``start`` and ``bounds`` are in SI and keyed by parameter name; ``noise`` is the
    standard deviation of white noise on measured inputs, in SI and keyed by role.
    """

    options: ReadT
    fixed: Mapping[str, float] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0
    progress: Callable[[str], None] = lambda message: None


@dataclass(frozen=True)
class NoiseLevel:
    """White noise on a measured input.

    ``sigma`` is its standard deviation [SI], ``relative`` the standard error of ``sigma**2`` as a
    part of it: 0 where it was given.
    """

    sigma: float
    relative: float = 0.0


@dataclass(frozen=True)
class Estimate(Generic[ReadT]):
    """What a family returns from a fit.

    What the model gives with these values is not part of it: that is computed by
    :meth:`Family.simulate` from what is written, once for all readers.

    Attributes
    ----------
    parameters
        Every parameter of the variant's table (optional ones when used), by name.
    derived
        Numbers computed from them, with their own uncertainty.
    covariance_order, covariance
        Names (list entries as ``control_points[2]``) and the matrix, shape ``(p, p)``
        [product of the units]. Both empty when there is no covariance.
    options
        The options with everything settled that the fit chose: sizes asked for as ``auto``,
        dead bands and filters found from the noise. The file holds them.
    notices
        Warnings.
    details
        Anything else worth keeping in the file under ``fit`` (method, starts, filter). Tables
        under ``comparisons``, rows by title, are shown by the report.
    sensitivity
        Optional: derivative of every experiment's output by the first entries of
        ``covariance_order``, unknowns of single logs projected out, shape ``(n_i, q)``.
        Lets the fit be examined without being repeated.
    sensitivity_also
        The same of other channels that were fitted beside the output, by role, one mapping
        per experiment; :meth:`Family.simulate` gives what the model says of them.
    nearby
        Optional: simulates the experiments, or their beginnings, with slightly other values, inputs
        or options as :meth:`Family.simulate` does, but what belongs to single logs to first order
        from the fit. For families that would search for it at length.
    represented
        Optional: the same with what stands in for measured inputs that carry noise in their
        place. For families that estimate with instruments: the noise of such an input is in the
        residual and in every derivative of the output alike, but not in these.
    input_noise
        Noise on measured inputs that the estimate allows for, by role. The residual then holds
        what the model makes of it.
    independent
        How many independent samples would show the size of the errors as well as the residuals
        that the covariance was made of; infinite where those are white or more is known of them.
    """

    parameters: Mapping[str, Quantity]
    derived: Mapping[str, Quantity]
    covariance_order: tuple[str, ...]
    covariance: FloatArray
    options: ReadT
    notices: Sequence[Notice] = ()
    details: Mapping[str, Any] = field(default_factory=dict)
    sensitivity: Sequence[FloatArray] = ()
    sensitivity_also: Sequence[Mapping[str, FloatArray]] = ()
    nearby: Callable[[Plant[ReadT], Sequence[Experiment]], list[Simulated]] | None = None
    represented: Callable[[Plant[ReadT], Sequence[Experiment]], list[Simulated]] | None = None
    input_noise: Mapping[str, NoiseLevel] = field(default_factory=dict)
    independent: float = np.inf

    @property
    def values(self) -> dict[str, Value]:
        """Plain values by name."""
        return {k: q.value for k, q in self.parameters.items()}

    def plant(self, variant: Variant) -> Plant[ReadT]:
        """The model with the numbers that are written."""
        return Plant(variant, self.values, self.options)


@dataclass(frozen=True)
class Simulated:
    """What the model gives for one run.

    Attributes
    ----------
    output
        At the log's own instants, shape ``(n,)`` [SI].
    used
        Samples that the model claims to describe, shape ``(n,)``; ``None`` means all. Slow
        samples of a friction map and clipped readings are excluded.
    offset
        Offset of the output that belongs to this log [SI]; ``None`` where there is none.
    also
        Other measured channels that the model gives, by role, shape ``(n,)`` each [SI]. They
        are judged as the output is.
    """

    output: FloatArray
    used: npt.NDArray[np.bool_] | None = None
    offset: float | None = None
    also: Mapping[str, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True)
class Information:
    """Sensitivity of one experiment's output to the parameters.

    Attributes
    ----------
    names
        Of the columns of ``jacobian``.
    jacobian
        Derivative of the output, unknowns of the log projected out, shape ``(n, p)``
        [unit of the output per unit of the parameter].
    output
        Simulated output from rest, shape ``(n,)`` [SI].
    floor
        Standard errors of parameters that are bracketed and not fitted: a static level
        lies between two commanded ones, however small the noise [unit of the parameter].
    """

    names: tuple[str, ...]
    jacobian: FloatArray
    output: FloatArray
    floor: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Excitation:
    """How the next experiment of a machine can be designed.

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
    """What a picture of a static map shows: output over one quantity, without time.

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
    used: npt.NDArray[np.bool_]
    curves: Sequence[Curve] = ()
    points: Curve | None = None


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
    steady_offset
        Whether the output carries an offset at rest that a controller needs, such as the
        pressure at which a valve idles. The file then holds its mean over the logs.
    allows_for_input_noise
        Whether the estimate takes noise of measured inputs into account, as ``--noise`` gives it.
    examined
        Samples of every run by which the examinations that simulate judge what is always there:
        all that count where simulations are cheap, fewer where each takes its time.
    """

    name: str
    title: str
    equation: str
    variants: tuple[Variant, ...]
    options_type: type[OptionsT]
    steady_offset: ClassVar[bool] = False
    allows_for_input_noise: ClassVar[bool] = False
    examined: ClassVar[int] = 200_000

    def variants_for(self, options: OptionsT) -> tuple[Variant, ...]:
        """Variants that can be meant under the given options; usually all of them."""
        return self.variants

    def variant(self, name: str | None) -> Variant:
        """The variant of that name; a single one need not be named."""
        return next((v for v in self.variants if v.name == name), self.variants[0])

    @abstractmethod
    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request[OptionsT]
    ) -> Estimate[OptionsT]:
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

    @abstractmethod
    def block(self, variant: Variant, document: ParameterDocument) -> Block:
        """Return the object that ``fluidact_fit.load`` gives a controller."""

    def model(self, plant: Plant[OptionsT], sample_time: float, hold: Hold) -> dict[str, Any]:
        """Return the ``model`` part of the file: what a controller runs.

        It has to change with every parameter: a reader compares it with the parameters, so
        that neither can be edited alone.
        """
        return {}

    def information(self, plant: Plant[OptionsT], experiment: Experiment) -> Information | None:
        """Return the information that an experiment would give, from its inputs alone.

        ``None`` for a family that cannot say: its next experiment cannot be designed.
        """
        return None

    def departures(self, plant: Plant[OptionsT]) -> Sequence[Departure]:
        """Return what every fit is to be tested for, beside parameters, delays and lags."""
        return ()

    def excitation(self, variant: Variant, document: ParameterDocument) -> Excitation:
        """Return how the next experiment can be designed from a file of this family."""
        return Excitation("none", "the family cannot predict what an experiment would show")

    def suppose(
        self, name: str, plant: Plant[OptionsT], amplitude: tuple[float, float], sample_time: float
    ) -> float | None:
        """Plausible value of a parameter that was not identified, to design an experiment for.

        Parameters
        ----------
        name, plant
            The parameter, and the model of the file with what was supposed before.
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

    def static_view(
        self,
        plant: Plant[OptionsT],
        experiments: Sequence[Experiment],
        simulated: Sequence[Simulated],
    ) -> StaticView | None:
        """Return what a picture of a static map shows, ``None`` for a dynamic model.

        ``simulated`` is what :meth:`simulate` gave for the experiments.
        """
        return None
