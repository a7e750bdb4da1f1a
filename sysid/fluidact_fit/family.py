"""The contract that every model family fills in.

A family is one file in ``families`` and one line in its registry. Everything else
(the subcommand and its help, the parameter names a file may hold, the JSON Schema,
the generic tests) iterates over the registry and knows families only through the
types below.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from .errors import Notice
from .experiment import Experiment, FloatArray, Hold

if TYPE_CHECKING:
    from .estimation.information import Information

Value = float | list[float] | list[list[float]]
Status = Literal["estimated", "fixed", "derived", "not_identified"]


@dataclass(frozen=True)
class Role:
    """A quantity that a family needs from a log.

    ``hold`` is the default intersample behaviour of a role that drives the model and
    ``None`` for all others. ``output`` marks the role that is compared with the model.
    ``alternatives`` are SI units of other dimensions that are accepted as well: a valve
    may be commanded in volts, amperes or as a number.
    """

    name: str
    unit: str
    description: str
    required: bool = True
    hold: Hold | None = None
    output: bool = False
    alternatives: tuple[str, ...] = ()


@dataclass(frozen=True)
class ParameterSpec:
    """A parameter as it stands in the file.

    Attributes
    ----------
    name, unit, description
        As written; SI.
    neutral
        The value written when the data cannot determine it; ``None`` when it has no
        neutral value, in which case the run ends without a file.
    minimum, maximum
        Closed physical range every file has to respect.
    rank
        0 for a number, 1 for a list, 2 for a list of lists.
    length
        Required length of a list, ``None`` when free.
    remedy
        The experiment that determines the parameter, a whole sentence.
    optional
        Whether a file may lack it (a ``viscous`` replaced by two one-sided values).
    any_unit
        Whether the unit depends on the log (the gain of a valve); its dimension is then
        not checked.
    """

    name: str
    unit: str
    description: str
    neutral: float | None = None
    minimum: float = -np.inf
    maximum: float = np.inf
    rank: Literal[0, 1, 2] = 0
    length: int | None = None
    remedy: str = ""
    optional: bool = False
    any_unit: bool = False


@dataclass(frozen=True)
class Option:
    """A family's own option; becomes ``--name`` on the command line.

    ``kind`` is ``"choice"``, ``"float"``, ``"int"``, ``"flag"``, ``"text"`` or
    ``"range"`` (``LOW:HIGH``). A value of ``None`` means: not given.
    """

    name: str
    kind: Literal["choice", "float", "int", "flag", "text", "range"]
    help: str
    default: Any = None
    choices: tuple[str, ...] = ()
    unit: str = ""
    minimum: float = -np.inf


@dataclass(frozen=True)
class Variant:
    """A set of roles with the parameter table that goes with it.

    Most families have one. ``ball-screw`` has a rotary one (torque, angle, inertia)
    and a linear one (force, position, mass).
    """

    name: str
    roles: tuple[Role, ...]
    parameters: tuple[ParameterSpec, ...]

    def role(self, name: str) -> Role:
        """Return the role of that name; raises ``KeyError`` when there is none."""
        return next(r for r in self.roles if r.name == name)

    @property
    def output(self) -> Role:
        """The role that is compared with the model."""
        return next(r for r in self.roles if r.output)


@dataclass(frozen=True)
class Request:
    """What the user chose: everything of a fit that is not data.

    ``fixed``, ``start`` and ``bounds`` are in SI and keyed by parameter name;
    ``options`` holds the family's own options by name, defaults filled in.
    """

    options: Mapping[str, Any] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    seed: int = 0
    progress: Callable[[str], None] = lambda message: None


@dataclass(frozen=True)
class Quantity:
    """One parameter of a result.

    ``method`` says how the interval was made (``"wald"``, ``"profile"``, ...).
    """

    value: Value
    unit: str
    status: Status = "estimated"
    std_error: Value | None = None
    ci95: Any | None = None
    method: str | None = None


@dataclass(frozen=True)
class Estimate:
    """What a family returns from a fit.

    Attributes
    ----------
    parameters
        Every parameter of the variant's table (optional ones when used), by name.
    derived
        Numbers computed from them, with their own uncertainty.
    covariance_order, covariance
        Names (list entries as ``control_points[2]``) and the matrix, shape ``(p, p)``
        [product of the units]. Both empty when there is no covariance.
    simulated
        Model output per experiment at the log's own instants, shape ``(n_i,)`` [SI].
    measured
        What it is compared with, same shapes. NaN where a sample was left out.
    notices
        Warnings.
    details
        Anything else worth keeping in the file under ``fit`` (method, starts, filter).
    sensitivity
        Optional: derivative of every experiment's output by the first entries of
        ``covariance_order``, unknowns of single logs projected out, shape ``(n_i, q)``.
        Lets the fit be examined without being repeated.
    options
        Options that the fit settled, such as a size that was asked for as ``auto``: the
        file holds them, and simulation sees them, in place of the user's.
    """

    parameters: Mapping[str, Quantity]
    derived: Mapping[str, Quantity]
    covariance_order: tuple[str, ...]
    covariance: FloatArray
    simulated: Sequence[FloatArray]
    measured: Sequence[FloatArray]
    notices: Sequence[Notice] = ()
    details: Mapping[str, Any] = field(default_factory=dict)
    sensitivity: Sequence[FloatArray] = ()
    options: Mapping[str, Any] = field(default_factory=dict)


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


class Block(ABC):
    """What a controller holds after loading a parameter file.

    Static maps are called with arrays; dynamic blocks step once per sample.
    """

    family: str
    parameters: Mapping[str, Value]


class Family(ABC):
    """A model family: equation, roles, parameters, estimation, and what a controller runs.

    Subclasses set the class attributes and fill in the abstract methods. The equation
    itself is a plain function of the module that can be used without any fitter.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    equation: ClassVar[str]
    variants: ClassVar[tuple[Variant, ...]]
    options: ClassVar[tuple[Option, ...]] = ()

    def variants_for(self, options: Mapping[str, Any]) -> tuple[Variant, ...]:
        """Variants that can be meant under the given options; usually all of them."""
        return self.variants

    @abstractmethod
    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request
    ) -> Estimate:
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
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> FloatArray:
        """Simulate the output of an experiment from its inputs, shape ``(n,)`` [SI].

        Offset and initial state, which belong to a log and not to the machine, are
        fitted to the experiment's own output when it has one.
        """

    def model_section(
        self, variant: Variant, parameters: Mapping[str, Value], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """Return the ``model`` part of the file: what a controller runs."""
        return {}

    def information(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> Information | None:
        """Return what an experiment would tell about the parameters, from its inputs alone.

        ``None`` for a family that cannot say: its next experiment cannot be designed.
        """
        return None

    def static_view(
        self,
        variant: Variant,
        estimate: Estimate,
        experiments: Sequence[Experiment],
        options: Mapping[str, Any],
    ) -> StaticView | None:
        """Return what a picture of a static map shows, ``None`` for a dynamic model."""
        return None

    def block(self, variant: Variant, document: Mapping[str, Any]) -> Block | None:
        """Return the object that ``fluidact_fit.load`` gives a controller."""
        return None
