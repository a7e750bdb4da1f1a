"""A model as a function of named values, its unknowns, and checks of requests."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import UsageError, check_names
from ..experiment import Array, FloatArray
from ..options import FamilyOptions
from ..specification import ParameterSpec, Request
from ..units import after_number
from .problem import Basis, Problem, StationaryPoint, Unknown
from .uncertainty import Uncertainty, covariance, score_covariance
from .whitening import Whitening

Values = Mapping[str, Any]


@dataclass(frozen=True)
class NamedModel:
    """A model as a family writes it down.

    Attributes
    ----------
    nonlinear, linear
        Names of the parameters that enter nonlinearly, and of those that multiply a
        column each, in the order of the columns of ``Basis.shared``.
    columns
        ``columns(index, values) -> Basis``, analytic in every nonlinear value.
    slopes
        Optional ``slopes(index, values, names)``: the columns and the derivatives of ``known`` by
        the named values, shape ``(p, n)``, of models of which nothing else depends on them.
    measured
        Outputs per experiment, shape ``(n_i,)`` [SI].
    weights
        As in :class:`.problem.Problem`.
    nuisance
        Names of further linear unknowns, whose columns follow those of ``linear``. They
        are always free and never reported.
    resolutions
        Per experiment the step of the converter that logged the output [SI], 0 when
        unknown.
    whiten
        Filters of the residuals, as in :class:`.problem.Problem`.
    logs
        Per experiment the number of its log, when logs may differ in noise: those with
        more of it then weigh less.
    sigma_floor
        As in :func:`.uncertainty.covariance`.
    channels
        Rows of each experiment that hold different functions of the same samples. Their
        errors are not independent; the covariance is then taken from the scores.
    follow
        Optional ``follow(values, change) -> values`` that a change of some leads to; see
        :func:`.minimise.minimise`.
    """

    nonlinear: tuple[str, ...]
    linear: tuple[str, ...]
    columns: Callable[[int, Values], Basis]
    measured: Sequence[FloatArray]
    slopes: Callable[[int, Values, Sequence[str]], tuple[Basis, FloatArray]] | None = None
    weights: Sequence[FloatArray | float] = ()
    nuisance: tuple[str, ...] = ()
    resolutions: Sequence[float] = ()
    whiten: Sequence[Whitening] = ()
    logs: Sequence[int] = ()
    sigma_floor: float = 0.0
    channels: Sequence[Sequence[slice]] = ()
    follow: Callable[[Values, Mapping[str, float]], Mapping[str, float]] | None = None

    def scaled(self, factors: Mapping[int, float]) -> NamedModel:
        """Return the model with the residuals of every log multiplied by its factor."""
        if not factors:
            return self
        before = self.weights or [1.0] * len(self.measured)
        return replace(
            self,
            weights=[w * factors.get(k, 1.0) for w, k in zip(before, self.logs)],
            resolutions=[r * factors.get(k, 1.0) for r, k in zip(self.resolutions, self.logs)],
        )

    def uncertainty(self, solution: StationaryPoint) -> Uncertainty:
        """Covariance of ``(eta, linear)`` at a solution."""
        if self.channels and len(self.channels[0]) > 1:
            return score_covariance(solution.jacobian, solution.residuals, self.channels)
        readings = list(zip(self.measured, self.resolutions))
        if self.weights:  # as the residuals are
            readings = [(w * y, step) for w, (y, step) in zip(self.weights, readings)]
        return covariance(
            solution.jacobian,
            solution.residuals,
            local_unknowns=sum(solution.local_counts),
            sigma_floor=self.sigma_floor,
            small_sample=True,
            readings=readings,
        )

    def without_linear(self) -> NamedModel:
        """Return the model with its linear parameters appended to the nonlinear ones."""

        def columns(index: int, values: Values) -> Basis:
            own = [values[n] for n in self.linear]
            return self.columns(index, values).holding([*own, *[None] * len(self.nuisance)])

        names = (*self.nonlinear, *self.linear)
        return replace(self, nonlinear=names, linear=(), columns=columns, slopes=None)

    @property
    def every_linear(self) -> tuple[str, ...]:
        """Linear parameters and nuisance unknowns, in the order of the columns."""
        return (*self.linear, *self.nuisance)


class _HeldModel:
    """A `NamedModel` with some values held, as the solver needs it; see :class:`.problem.Model`."""

    def __init__(self, model: NamedModel, held: Mapping[str, float]) -> None:
        self.model, self.held = model, held
        self.names = [n for n in model.nonlinear if n not in held]
        self.sizes = [held.get(n) for n in model.every_linear]
        if model.slopes is not None:
            self.slopes = self._slopes

    def _values(self, eta: Array) -> Values:
        """Values by name; only one that is moved by a complex step is complex."""
        whole = [x.real if x.imag == 0.0 else x for x in eta]
        return {**self.held, **dict(zip(self.names, whole))}

    def follow(self, eta: FloatArray, step: FloatArray) -> FloatArray:
        """Values, shape ``(p,)``, that a step leads to; see :func:`.minimise.minimise`."""
        assert self.model.follow is not None
        change = dict(zip(self.names, step.tolist()))
        found = self.model.follow(self._values(eta), change)
        return np.array([found[n] for n in self.names])

    def basis(self, index: int, eta: Array) -> Basis:
        """Columns of the free unknowns; those of held ones are part of the known output."""
        return self.model.columns(index, self._values(eta)).holding(self.sizes)

    def _slopes(self, index: int, eta: FloatArray) -> FloatArray:
        assert self.model.slopes is not None
        return self.model.slopes(index, self._values(eta), self.names)[1]


def bind(model: NamedModel, unknowns: Mapping[str, Unknown], held: Mapping[str, float]) -> Problem:
    """Make the solver's problem of a model with some parameters held."""
    view = _HeldModel(model, held)
    linear = [unknowns[n] for n in model.linear if n not in held]
    nuisance = [Unknown(n) for n in model.nuisance]
    return Problem(
        view, model.measured, [unknowns[n] for n in view.names], [*linear, *nuisance],
        model.weights, model.whiten, channels=max(map(len, model.channels), default=1),
        follow=view.follow if model.follow else None,
    )  # fmt: skip


def make_unknowns(
    specs: Sequence[ParameterSpec],
    names: Sequence[str],
    scales: Mapping[str, float],
    request: Request[FamilyOptions],
    limits: Mapping[str, tuple[float, float]] | None = None,
) -> dict[str, Unknown]:
    """Unknowns with the physical range, the search range and the user's bounds applied.

    The request has passed :func:`check_request`.
    """
    by_name = {s.name: s for s in specs}
    out = {}
    for name in names:
        low, high = by_name[name].minimum, by_name[name].maximum
        if limits and name in limits:
            low, high = max(low, limits[name][0]), min(high, limits[name][1])
        low, high = request.bounds.get(name, (low, high))
        out[name] = Unknown(name, low, high, abs(scales.get(name, 1.0)) or 1.0)
    return out


def check_form(
    given: Collection[str], form: str, names: Collection[str], option: str, chosen: str
) -> None:
    """Reject numbers of ``form``, or of one of its directions, where it is not among ``names``.

    Raises
    ------
    UsageError
        Naming the ``option`` that decides, of which ``chosen`` was given.
    """
    for name in (form, f"{form}_negative", f"{form}_positive"):
        if name in given and name not in names:
            other = "symmetric" if name == form else "asymmetric"
            raise UsageError(
                f"{name} is no parameter with --{option}={chosen}",
                remedy=f"Give --{option}={other}, or leave {name} out.",
            )


def check_request(specs: Sequence[ParameterSpec], request: Request[FamilyOptions]) -> None:
    """Reject impossible names and values in ``--fix``, ``--start`` and ``--bounds``.

    Raises
    ------
    UsageError
        Naming the option, the parameters there are, and the possible range.
    """
    by_name = {s.name: s for s in specs}
    known = [s.name for s in specs if s.rank == 0]
    for option, given in (
        ("--fix", request.fixed),
        ("--start", request.start),
        ("--bounds", request.bounds),
    ):
        check_names(option, "single-valued parameter", given, known)
        for name, value in given.items():
            spec = by_name[name]
            if option != "--fix" and not spec.searched:
                raise UsageError(
                    f"{option} {name}=...: it is not searched for from a start, and has no bounds",
                    remedy=f"Leave {option} {name} out, or give --fix {name}=VALUE.",
                )
            pair = value if isinstance(value, tuple) else (value, value)
            if not (spec.minimum <= pair[0] and pair[1] <= spec.maximum):
                raise UsageError(
                    f"{option} {_as_given(spec, pair)} is outside the possible range",
                    expected=f"Expected {_range_of(spec)}.",
                    remedy="Give a value inside it, in SI or with its unit.",
                )
    if both := sorted(request.fixed.keys() & request.start.keys()):
        raise UsageError(
            f"--start {both[0]}=... means nothing with --fix {both[0]}=...: what is held is not "
            "searched for",
            remedy="Leave one of the options out.",
        )
    for option, values in (("--fix", request.fixed), ("--start", request.start)):
        for name in values.keys() & request.bounds.keys():
            pair, spec = request.bounds[name], by_name[name]
            if not pair[0] <= values[name] <= pair[1]:
                raise UsageError(
                    f"{option} {_as_given(spec, (values[name],))} lies outside --bounds "
                    f"{_as_given(spec, pair)}",
                    remedy="Give a value between the bounds, or leave one of the options out.",
                )


def _as_given(spec: ParameterSpec, values: Iterable[float]) -> str:
    """A value of a parameter or the ends of its bounds, as an option has them, with its unit."""
    ends = ":".join(f"{end:g}" for end in dict.fromkeys(values))
    unit = after_number(spec.unit)
    return f'"{spec.name}={ends}{unit}"' if unit else f"{spec.name}={ends}"


def _range_of(spec: ParameterSpec) -> str:
    """The possible values of a parameter with its unit, in words."""
    unit = after_number(spec.unit)
    if np.isinf(spec.maximum):
        return f"{spec.minimum:g}{unit} or more"
    if np.isinf(spec.minimum):
        return f"{spec.maximum:g}{unit} or less"
    return f"{spec.minimum:g} to {spec.maximum:g}{unit}"
