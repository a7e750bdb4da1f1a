"""Needs and results of a family as plain data: roles, parameters, values with uncertainty.

Below everything else, so that the parameter file and the families speak of the same things
without knowing each other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Any, ClassVar, Generic, Literal, Protocol, TypeVar

import numpy as np

from .experiment import BoolArray, Experiment, FloatArray, Hold
from .options import FamilyOptions

Value = float | list[float] | list[list[float]]
STEP = 1e-30  # complex step: no cancellation, so it can be as small as one likes
Status = Literal["estimated", "fixed", "derived", "not_identified"]
# what is only read may hold the options of any family
ReadT = TypeVar("ReadT", bound=FamilyOptions, covariant=True)


@dataclass(frozen=True)
class Role:
    """A quantity that a family needs from a log.

    ``hold`` is the default intersample behaviour of a role that drives the model and
    ``None`` for all others. ``output`` marks the role that is compared with the model.
    ``alternatives`` are SI units of other dimensions that are accepted as well: a valve
    may be commanded in volts, amperes or as a number. ``gauge`` marks a pressure that the
    equation counts from the atmosphere. ``opposes`` says that more of it takes from the output.
    """

    name: str
    unit: str
    description: str
    required: bool = True
    hold: Hold | None = None
    output: bool = False
    alternatives: tuple[str, ...] = ()
    gauge: bool = False
    opposes: bool = False


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
    increasing
        Whether the entries of a list have to increase.
    remedy
        The experiment that determines the parameter, a whole sentence.
    optional
        Whether a file may lack it (a ``viscous`` replaced by two one-sided values).
    ratio
        Where the unit depends on the log (the gain of a valve): the roles whose units it is the
        quotient of, one after the other; ``"1"`` stands for a number and ``"s"`` for seconds.
        ``unit`` is then that of the roles' first units.
    curved
        Whether the cost over this parameter has kinks, so that its interval is found by
        profiling the likelihood (a dead time, an edge of a dead zone).
    threshold
        ``"positive"`` or ``"negative"`` for a level of the drive at which the motion changes
        abruptly: a designed experiment passes it slowly in that direction.
    base
        Parameter that a threshold cannot lie below.
    general
        Parameter that stands for this one where a fit did not ask for it (``viscous`` for both
        directions).
    searched
        Whether a search ends at it, which a start and bounds are for: an offset that follows from
        the other values may only be given.
    """

    name: str
    unit: str
    description: str
    neutral: float | None = None
    minimum: float = -np.inf
    maximum: float = np.inf
    rank: Literal[0, 1, 2] = 0
    length: int | None = None
    increasing: bool = False
    remedy: str = ""
    optional: bool = False
    ratio: tuple[str, ...] | None = None
    curved: bool = False
    threshold: Literal["", "positive", "negative"] = ""
    base: str = ""
    general: str = ""
    searched: bool = True

    def unit_for(self, units: Mapping[str, str]) -> str:
        """Unit of the parameter where the roles have these units; other roles their first."""
        if self.ratio is None or not all(role in units for role in self.roles_of_unit):
            return self.unit
        return reduce(quotient_unit, (units.get(role, role) for role in self.ratio))

    @property
    def roles_of_unit(self) -> list[str]:
        """Roles on whose units that of the parameter depends."""
        return [role for role in self.ratio or () if role not in ("1", "s")]


@dataclass(frozen=True)
class Variant:
    """A set of roles with the parameter table that goes with it.

    Most families have one. ``ball-screw`` has a rotary one (torque, angle, inertia)
    and a linear one (force, position, mass). Of the roles in ``alike`` only the ratio matters:
    they may be in any quantity that they accept, but all of them in the same; ``unlike`` is what to
    do where they are not. ``equation`` is the family's in the names of these roles, empty where the
    family's has them.
    """

    name: str
    roles: tuple[Role, ...]
    parameters: tuple[ParameterSpec, ...]
    alike: tuple[str, ...] = ()
    unlike: str = ""
    equation: str = ""

    def role(self, name: str) -> Role:
        """Return the role of that name; raises ``KeyError`` when there is none."""
        return next(r for r in self.roles if r.name == name)

    def parameter(self, name: str) -> ParameterSpec:
        """Return the parameter of that name; raises ``KeyError`` when there is none."""
        return next(p for p in self.parameters if p.name == name)

    def measured_in(self, units: Mapping[str, str]) -> Variant:
        """The variant with the SI units that logs have its roles in, and parameters alike."""
        roles = tuple(replace(r, unit=units.get(r.name, r.unit)) for r in self.roles)
        specs = tuple(replace(p, unit=p.unit_for(units)) for p in self.parameters)
        return replace(self, roles=roles, parameters=specs)

    @property
    def output(self) -> Role:
        """The role that is compared with the model."""
        return next(r for r in self.roles if r.output)

    @property
    def driving(self) -> tuple[Role, ...]:
        """Roles that drive the model: those with a hold, but for the output."""
        return tuple(r for r in self.roles if r.hold is not None and not r.output)

    @property
    def leading(self) -> str:
        """Role that drives the output and moves along with it; empty where there is none.

        It is the first one: what else drives a model may act against its output.
        """
        return next((r.name for r in self.driving[:1] if not r.opposes), "")


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

    @property
    def number(self) -> float:
        """The value of a single-valued parameter; ``TypeError`` for a list."""
        if isinstance(self.value, list):
            raise TypeError("a list is not a single number")
        return float(self.value)


@dataclass(frozen=True)
class Plant(Generic[ReadT]):
    """A model with its numbers, as a fit or a file gives them.

    Attributes
    ----------
    values
        As written in the file [SI].
    options
        As settled by the fit: nothing is chosen anew.
    """

    variant: Variant
    values: Mapping[str, Value]
    options: ReadT

    @property
    def numbers(self) -> dict[str, float]:
        """The single-valued parameters [SI]."""
        return scalars(self.values)


@dataclass(frozen=True)
class Request(Generic[ReadT]):
    """Choices of the user: everything of a fit that is not data.

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

    @property
    def given(self) -> str:
        """Values and bounds of the user, as options; they may be what the data contradict."""
        fixed = [f"--fix {name}={value:g}" for name, value in self.fixed.items()]
        bounds = [f"--bounds {n}={low:g}:{high:g}" for n, (low, high) in self.bounds.items()]
        return " ".join([*fixed, *bounds])


@dataclass(frozen=True)
class Structure:
    """A form of a family's equation that can be compared with its other forms on the same logs.

    Attributes
    ----------
    name
        What it is, a few words: ``"second order with dead time"``.
    options
        Settings of the family's options that select it, by name; forms that differ in an option
        all set it.
    fixed
        Parameters that it leaves out, by name, at the value without effect [SI].
    instead
        Whether it is tried where a form that differs in one option is refused: a fit of it has to
        be quick.
    """

    name: str
    options: Mapping[str, str] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)
    instead: bool = False


@dataclass(frozen=True)
class NoiseLevel:
    """White noise on a measured input.

    ``sigma`` is its standard deviation [SI], ``relative`` the standard error of ``sigma**2`` as a
    part of it: 0 where it was given.
    """

    sigma: float
    relative: float = 0.0


@dataclass(frozen=True)
class Simulated:
    """Output of the model for one run.

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
    used: BoolArray | None = None
    offset: float | None = None
    also: Mapping[str, FloatArray] = field(default_factory=dict)


Simulate = Callable[[Plant[Any], Sequence[Experiment]], Sequence[Simulated]]
Response = Callable[[Sequence[Experiment], Simulate], Sequence[Mapping[str, FloatArray]]]


@dataclass(frozen=True)
class UnmodelledEffect:
    """An effect that a machine may show and for which the model has no parameter.

    Attributes
    ----------
    name, words, remedy
        What it is called in the file, what follows "the data fit better if" (or what gives that
        for a size), and what to do.
    response
        Derivatives of the channels of every experiment by its size, shape ``(n,)`` [SI] each, of
        the experiments and what simulates them near the fit. A channel without stays as it is.
        Shape ``(n, q)`` where it is a combination of several directions, such as initial states.
    unit
        Of its size; where it is ``of`` a role, that of the role.
    positive
        Whether its size cannot be negative, as that of friction cannot.
    offered
        Whether an option has it estimated: of effects that look alike it is named first.
    shaped
        Whether it describes a shape. No machine is perfectly even, so that small changes of a
        parameter do not count.
    """

    name: str
    words: str | Callable[[float], str]
    remedy: str
    response: Response
    unit: str = "1"
    positive: bool = False
    offered: bool = False
    shaped: bool = False
    of: str = ""


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


class Described(Protocol):
    """Facts about a family that a reader of parameter files needs."""

    name: str
    title: str
    equation: str
    variants: tuple[Variant, ...]
    options_type: type[FamilyOptions]
    steady_offset: ClassVar[bool]

    def variant(self, name: str | None) -> Variant:
        """The variant of that name; a single one need not be named."""
        ...

    def model(self, plant: Plant[FamilyOptions], sample_time: float, hold: Hold) -> dict[str, Any]:
        """Return the ``model`` part that belongs to the values."""
        ...

    def derived(self, values: Mapping[str, Any], options: FamilyOptions) -> Mapping[str, Any]:
        """Return the derived numbers that follow from the values alone."""
        ...


def propagate(
    function: Callable[[Mapping[str, Any]], Mapping[str, Any]],
    values: Mapping[str, Any],
    names: Sequence[str],
    covariance: FloatArray,
) -> dict[str, tuple[float, float | None]]:
    """Numbers computed from values, each with its standard error by the delta method.

    Parameters
    ----------
    function
        Analytic in its values; its gradient is taken by complex steps.
    values, names, covariance
        All values, those that were estimated, and their covariance, shape ``(p, p)``. A number in
        which none of them enters has no standard error.
    """
    rows = {}
    for name in names:
        moved = function({**values, name: values[name] + 1j * STEP})
        rows[name] = {key: float(np.imag(value)) / STEP for key, value in moved.items()}
    out = {}
    for key, value in function(values).items():
        gradient = np.array([rows[name].get(key, 0.0) for name in names])
        variance = float(gradient @ covariance @ gradient) if gradient.any() else None
        error = None if variance is None else float(np.sqrt(max(variance, 0.0)))
        out[key] = float(value), error
    return out


def entry_name(name: str, at: Sequence[int]) -> str:
    """Name of an entry of a parameter: ``weights_1[2][0]``, the name itself for a number."""
    return name + "".join(f"[{k}]" for k in at)


def scalars(parameters: Mapping[str, Value]) -> dict[str, float]:
    """The single-valued parameters of a file."""
    return {k: float(v) for k, v in parameters.items() if not isinstance(v, list)}


def quotient_unit(top: str, bottom: str) -> str:
    """Unit of a quotient of two quantities, for example ``Pa/V``."""
    if top == bottom:
        return "1"
    return top if bottom == "1" else f"{top}/{bottom}"
