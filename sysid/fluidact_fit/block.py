"""Interface of a loaded parameter file to controllers: one base for every family."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from math import isfinite
from numbers import Real
from typing import Any, NamedTuple, Self
from warnings import warn

import numpy as np
import numpy.typing as npt

from .errors import ExtrapolationWarning, NotIdentifiedError, UsageError
from .experiment import Experiment, FloatArray, Hold
from .parameters.document import ParameterDocument
from .presentation import Presented
from .routines.routine import Argument, Routine
from .specification import Role, Value, Variant, scalars
from .units import after_number

# Of a document and logs: what they give when simulated. Blocks themselves read no logs.
LogSimulator = Callable[..., Any]
_NEAR = 0.05  # part of the width of a range that the noise of another log may leave it by


class ValidRange(NamedTuple):
    """Range of a role that the fitted data covered [unit]."""

    low: float
    high: float
    unit: str

    def left_by(self, values: npt.ArrayLike) -> FloatArray:
        """Values that leave the range by more than noise may; NaN is none of them."""
        v = np.asarray(values, dtype=float)
        slack = max(_NEAR * (self.high - self.low), 1e-9 * max(abs(self.low), abs(self.high)))
        return np.asarray(v[(v < self.low - slack) | (v > self.high + slack)])

    def departure(
        self, role: str, values: npt.ArrayLike, text: Callable[[float], str] | None = None
    ) -> str:
        """Say where values leave the range, as ``text`` has them; empty where they do not."""
        beyond = self.left_by(values)
        if not beyond.size:
            return ""
        far = beyond.flat[np.argmax(np.abs(beyond - 0.5 * (self.low + self.high)))]
        shown, low, high = map(text or self._text, (far, self.low, self.high))
        return (
            f"{role} = {shown} is outside {low} to {high}, the range of the fitted data: the model "
            "extrapolates"
        )

    def _text(self, value: float) -> str:
        return f"{value:.6g}{after_number(self.unit)}"


def are_samples(given: Any) -> bool:
    """Return whether something is samples of one signal, and no log."""
    if isinstance(given, list | tuple):
        return bool(given) and all(isinstance(value, Real) for value in given)
    named = getattr(getattr(given, "dtype", None), "names", None)
    return getattr(given, "ndim", None) == 1 and not named


def valid_ranges(document: ParameterDocument) -> Mapping[str, ValidRange]:
    """Role to the range that the data of a document covered."""
    return {r: ValidRange(v.low, v.high, v.unit) for r, v in document.validity.items()}


class Port(NamedTuple):
    """Name and unit of the input or output of a block."""

    role: str
    unit: str

    def __str__(self) -> str:
        return f"{self.role} [{self.unit}]"


class Parameters(Mapping[str, Value]):
    """Parameters by name [SI]; one that was not identified is given on request only."""

    def __init__(self, document: ParameterDocument, variant: Variant) -> None:
        self._values = document.values()
        self._variant = variant
        self.refused = frozenset(
            n for n, p in document.parameters.items() if p.status == "not_identified"
        )

    def __getitem__(self, name: str) -> Value:
        if name in self.refused:
            remedy = self._variant.parameter(name).remedy
            raise NotIdentifiedError(
                f"{name} was not identified: {self._values[name]!r} stands in the file in place "
                "of a value that the data could not determine",
                expected=remedy,
                remedy="To use the model with that value anyway, load it with "
                f"accept_not_identified=[{name!r}] (or True).",
            )
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __repr__(self) -> str:
        shown = ", ".join(
            f"{n}=not identified" if n in self.refused else f"{n}={_brief(v)}"
            for n, v in self._values.items()
        )
        return f"<Parameters {shown}>"


def _brief(value: Value) -> str:
    return f"[{len(value)}]" if isinstance(value, list) else f"{value:.6g}"


def as_motion_state(direction: npt.ArrayLike) -> FloatArray:
    """Motion state of a call, from -1 (unloading) to 1 (loading).

    Raises
    ------
    UsageError
        For any other: logs may write 2 for unloading, and here it would be a number.
    """
    state = np.asarray(direction, dtype=float)
    if (np.abs(state) > 1.0).any():
        raise UsageError(
            f"a motion state of {state[np.abs(state) > 1.0].flat[0]:g}",
            expected="Expected 1 loading, -1 unloading, or 0 where it is not known.",
            remedy="Give -1 where a log has 2.",
        )
    return state


class Block(Presented, ABC):
    """A loaded model. Static maps are called with arrays; dynamic blocks step once per sample.

    Attributes
    ----------
    family
        Name of the model family.
    document
        The whole parameter document: units, uncertainty, warnings, provenance.
    parameters
        Values by name [SI]. Looking up one that the data could not determine raises
        ``NotIdentifiedError`` unless it was accepted, and so does every use of the model
        that needs it.
    not_identified
        Names of the parameters that the data could not determine.
    validity
        Role to the range that the data covered; outside it the model extrapolates.
    offset
        Output at rest without input, mean over the fitted logs [unit of the output].
    watching
        Whether the use of the model beyond ``validity`` gives an ``ExtrapolationWarning``, once
        per role: of a block that ``load`` returned.
    """

    watching = False

    def __init__(self, document: ParameterDocument, variant: Variant) -> None:
        self.family = document.family
        self.document = document
        self.variant = variant
        self.parameters = Parameters(document, variant)
        self.not_identified = tuple(n for n in self.parameters if n in self.parameters.refused)
        self.validity = valid_ranges(document)
        self.offset = float(document.model.get("output_offset", 0.0))
        self._told: set[str] = set()
        self.log_simulator: LogSimulator | None = None  # set by what loads the block

    def __repr__(self) -> str:
        ports = " -> ".join(str(port) for port in (self.input, self.output) if port)
        words = [f"{self.family}: {ports}", f"verdict {self.verdict}"]
        if self.not_identified:
            words.append(f"not identified: {', '.join(self.not_identified)}")
        text = f"<{type(self).__name__} {', '.join(words)}>"
        return text if len(text) < 200 else text[:196] + "...>"

    @property
    def input(self) -> Port | None:
        """Input of the model: its first role with a hold, or the argument of a map.

        Roles that a log may lack drive nothing. ``None`` where nothing does.
        """
        needed = [r for r in self.variant.roles if r.required and not r.output]
        roles = [r for r in needed if r.hold] or [r for r in needed if r.name != "time"]
        return self._port(roles[0]) if roles else None

    @property
    def output(self) -> Port:
        """Output of the model."""
        return self._port(self.variant.output)

    def _port(self, role: Role) -> Port:
        known = self.validity.get(role.name)
        return Port(role.name, known.unit if known else role.unit)

    def accept(self, names: bool | Collection[str]) -> None:
        """Allow the use of parameters that were not identified: these, or all (``True``).

        Raises
        ------
        UsageError
            When a name is not among them.
        """
        given = set(self.not_identified if names is True else names or ())
        unknown = sorted(given - set(self.parameters))
        if unknown:
            raise UsageError(
                f"accept_not_identified names {unknown[0]!r}, which is not a parameter of the file",
                expected="Not identified: " + (", ".join(self.not_identified) or "none") + ".",
            )
        self.parameters.refused = self.parameters.refused - given

    def simulate(self, values: Any, time: npt.ArrayLike | None = None, **how: Any) -> Any:
        """Simulate logs, or samples of the input, as :meth:`.result.FitResult.simulate` does.

        Parameters
        ----------
        values
            Logs as :func:`.fit` takes them, columns bound as those of the fit were unless ``how``
            says otherwise; or samples of the input, shape ``(n,)`` [unit of the input].
        time
            Instants of the samples, shape ``(n,)`` [s].
        **how
            How logs are read (:class:`.logs.Reading`), or what ``simulate_samples`` takes.

        Returns
        -------
        list of Simulation, or (n,)
            One entry per run of the logs; of samples, the output.

        Raises
        ------
        LogError, UsageError
            When a log does not have what the model needs, or the model takes no samples.
        NotIdentifiedError
            When a parameter was not identified and not accepted.
        """
        if time is None and not are_samples(values) and self.log_simulator is not None:
            for name in self.parameters:
                self.parameters[name]  # refuses one that was not identified
            return self.log_simulator(self.document, values, **how)
        if not isinstance(self, SampleSimulator):
            raise UsageError(
                f"a model of {self.family} does not simulate samples of one input.",
                expected="Expected logs: paths, DataFrames or mappings of header to array.",
                remedy="Give logs, or use the methods of the model itself.",
            )
        return np.asarray(self.simulate_samples(values, time, **how))

    def numbers(self) -> dict[str, float]:
        """Every single-valued parameter [SI].

        Raises
        ------
        NotIdentifiedError
            When one of them was not identified and not accepted.
        """
        return scalars(self.parameters)

    def outside(self, role: str, value: npt.ArrayLike) -> Any:
        """Return whether values lie outside the range that the data covered.

        Parameters
        ----------
        role
            For example ``"force"``.
        value
            [SI unit of the role]; NaN is outside.

        Returns
        -------
        bool, or an array of the shape of ``value``

        Raises
        ------
        UsageError
            When the file holds no range of that role.
        """
        v, r = np.asarray(value, dtype=float), self._range(role)
        out = ~((v >= r.low) & (v <= r.high))
        return bool(out) if out.ndim == 0 else out

    def watch(self, **values: npt.ArrayLike) -> None:
        """Warn where values by role are the first beyond the range that the data covered."""
        if not self.watching:
            return
        for role, value in values.items():
            known = self.validity.get(role)
            if known is None or role in self._told:
                continue
            if text := known.departure(role, value):
                self._told.add(role)
                message = f"{self.family}: {text}. This is said once."
                warn(message, ExtrapolationWarning, stacklevel=3)

    def sample(self, role: str, value: float) -> float:
        """Return the next sample of a role, held against its range.

        Raises
        ------
        ValueError
            When it is not a finite number; the block is then as it was.
        """
        if not isinstance(value, Real):
            raise UsageError(f"{role} = {value!r} is not a number")
        number = float(value)
        if not isfinite(number):
            raise ValueError(
                f"{role} = {number} is not a finite number. The block is as before: hold its last "
                "output, and step again with the next good sample."
            )
        if self.watching and role not in self._told:
            self.watch(**{role: number})
        return number

    def _range(self, role: str) -> ValidRange:
        """Range of a role (``UsageError`` when the file holds none)."""
        if role not in self.validity:
            raise UsageError(
                f"the parameter file holds no range of {role!r}",
                expected="Ranges it holds: " + (", ".join(self.validity) or "none") + ".",
            )
        return self.validity[role]

    def reset(self) -> None:
        """Return to rest; a static map has nothing to return from."""
        return

    def argument(self, role: str, about: str) -> Argument:
        """Argument of a routine, with the range of a role that the data covered.

        Raises
        ------
        UsageError
            When the file holds no range of that role.
        """
        known = self._range(role)
        return Argument(role, known.unit, about, known.low, known.high)

    def rate_argument(self, role: str, place: str, about: str) -> Argument:
        """Argument that is a velocity; a stroke in 0.1 s where it was computed from a place.

        Raises
        ------
        UsageError
            When the file holds no range of either role.
        """
        if role in self.validity:
            return self.argument(role, about)
        way = self._range(place)
        most = 10.0 * (way.high - way.low)
        return Argument(role, f"{way.unit}/s", about, -most, most, recorded=False)

    @abstractmethod
    def routines(self) -> Sequence[Routine]:
        """Return what a controller calls, in a form that ``export`` writes in other languages.

        Raises
        ------
        NotIdentifiedError
            When it needs a parameter that was not identified and not accepted.
        UsageError
            When the file lacks what it needs otherwise.
        """

    def methods(self) -> Mapping[str, Callable[..., Any]]:
        """Methods that compute what routines do, by their names; tests hold exports against them.

        They take the arguments of the routine in its order, as numbers.
        """
        return {}

    @abstractmethod
    def predict(self, experiment: Experiment) -> FloatArray:
        """Output at the samples of an experiment, from its inputs alone and from rest.

        Returns
        -------
        (n,) [SI unit of the output]
        """


class SteppedBlock(Block):
    """A block that steps once per sample.

    Attributes
    ----------
    sample_time
        Period of :meth:`step` [s]; 0 when the file holds none.
    """

    def __init__(self, document: ParameterDocument, variant: Variant) -> None:
        super().__init__(document, variant)
        self.sample_time = float(document.model.get("discrete", {}).get("sample_time", 0.0))
        self._begin()

    def with_sample_time(self, sample_time: float) -> Self:
        """Return the same model, at rest, stepping at another period [s]."""
        if not isinstance(sample_time, Real) or not 0.0 < float(sample_time) < np.inf:
            raise UsageError(f"sample_time {sample_time!r} is not a positive number")
        other = copy(self)
        other.parameters = copy(self.parameters)
        other.sample_time = float(sample_time)
        other._begin()
        return other

    def _need_sample_time(self, missing: str) -> None:
        """Raise where the file holds none; ``missing`` is what it lacks."""
        if self.sample_time <= 0.0:
            raise UsageError(
                f"the parameter file holds no {missing}",
                remedy="Use with_sample_time(...), or fit with --controller-sample-time.",
            )

    @abstractmethod
    def _begin(self) -> None:
        """Be at rest, as before the first step."""

    def step(self, value: float) -> float:
        """Take the input of this sample and return the output at the same instant.

        The input acts until the next call, one ``sample_time`` later.

        Parameters
        ----------
        value
            [unit of the input]

        Returns
        -------
        float
            [unit of the output]

        Raises
        ------
        ValueError
            When the input is not a finite number; the state is then as before.
        UsageError
            When the file holds no sample time.
        """
        return self._step(self.sample(self.variant.driving[0].name, value))

    @abstractmethod
    def _step(self, value: float) -> float:
        """Advance by one sample; the input is finite."""


@dataclass(frozen=True)
class LinearModel:
    """``x' = a x + b w(t - dead_time)``, ``y = c x``, with a dead zone or a curve before it.

    Attributes
    ----------
    a, b, c
        Shapes ``(n, n)``, ``(n,)`` and ``(n,)``.
    dead_time
        [s]
    dead_zone
        Negative and positive edge [unit of the input]; ``None`` without one.
    gain
        Steady output per input; ``None`` for an integrating model.
    curve
        What acts on the model, of the input, where that is more than a dead zone. It keeps its
        states from one change of the input to the next.
    rest
        Input under which the model is at rest [unit of the input].
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    dead_time: float
    dead_zone: tuple[float, float] | None
    gain: float | None
    curve: Routine | None = None
    rest: float = 0.0


class LinearBlock(SteppedBlock):
    """A block that is a continuous linear model but for what stands before it."""

    @abstractmethod
    def linear_model(self) -> LinearModel:
        """Return the continuous model."""


class SampleSimulator(ABC):
    """A block of one input that simulates samples of it."""

    @abstractmethod
    def simulate_samples(
        self,
        values: npt.ArrayLike,
        time: npt.ArrayLike | None = None,
        *,
        hold: Hold = "zoh",
        before: float | None = None,
        output: float | None = None,
    ) -> FloatArray:
        """Simulate a whole record; the state of :meth:`.SteppedBlock.step` is not touched.

        Parameters
        ----------
        values : (n,)
            Input [unit of the input].
        time : (n,), optional
            Instants [s], evenly spaced or not; one ``sample_time`` apart when left out.
        hold
            How the input moves between instants: ``"zoh"``, ``"foh"`` (straight lines),
            ``"smooth"`` or ``"auto"`` (smooth where the samples show it, else straight lines).
        before
            Input before the first sample; the first value when left out.
        output
            Output before the first sample.

        Returns
        -------
        (n,)
            Output [unit of the output].
        """


@dataclass(frozen=True)
class DryDrive:
    """``J v' = u - b v - F_k(sign v)`` in motion; at rest between the static levels.

    Pairs hold the backward direction first; all friction is a magnitude.

    Attributes
    ----------
    inertia
        [unit of ``quantity``]
    quantity
        Name and unit of the inertia: a mass on a linear axis.
    viscous
        [unit of the input per velocity]
    coulomb, breakaway
        Kinetic and static levels [unit of the input].
    """

    inertia: float
    quantity: Port
    viscous: tuple[float, float]
    coulomb: tuple[float, float]
    breakaway: tuple[float, float]


class FlowBlock(Block):
    """A block of a cylinder whose two chambers are fed through flows that are known."""

    @abstractmethod
    def plant_flows(self) -> tuple[Routine, Routine]:
        """Flow into chamber 1 and out of chamber 2, of command and its pressure, at any pressure.

        Raises
        ------
        UsageError
            When the file does not know both.
        """


class DryDriveBlock(SteppedBlock):
    """A block that is one mass or inertia with dry friction."""

    @abstractmethod
    def dry_drive(self) -> DryDrive:
        """Return the continuous model."""
