"""A small transfer function as a model of runs: dead time, dead zone, initial state, offset.

A family gives its coefficients as a function of named values (:class:`Law`).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import numpy as np

from ..experiment import Array, Experiment, FloatArray, Signal
from ..rows import repeated
from ..specification import Plant, Simulated, UnmodelledEffect, Variant
from .elimination import Eliminated
from .grid import Grid, make_grid
from .inputs import PiecewiseInput, apply_dead_zone, piecewise
from .linear import forced_response, free_response
from .named_model import NamedModel, Values, bind
from .problem import Basis, real_if_real
from .response_model import Beginning, ResponseModel, ResponseOptions
from .robust_weights import ROUNDS, huber_weights
from .unmodelled_effects import initial_states, output_offset

OptionsT = TypeVar("OptionsT", bound=ResponseOptions)
EDGES = ("dead_zone_negative", "dead_zone_positive")
ANY = Beginning()
AT_REST = Beginning(rest=True, offset="none")
_FEWEST = 4  # samples that are left of a run


class Law(Protocol):
    """What is linear of a family, as its model needs it."""

    gain: ClassVar[str | None]
    dead_zone: ClassVar[bool]

    def realise(self, values: Values) -> tuple[Array, Array, Array]:
        """State space of unit gain."""
        ...

    def beginnings(self, values: Values, offset: bool) -> tuple[Array, Array, Sequence[int]]:
        """``(A, C)`` and those of its states that a run may begin with."""
        ...


def state_space(numerator: Sequence[Any], denominator: Sequence[Any]) -> tuple[Array, Array, Array]:
    """``(A, B, C)`` of a strictly proper transfer function, falling powers of ``s``.

    Analytic in the coefficients, which are of order one in the scale of time that is chosen. The
    first state is the output, the next ones its derivatives, but for the numerator.
    """
    lead, *others = denominator
    monic, order = [d / lead for d in others], len(others)
    rate = max(abs(d) ** (1.0 / k) for k, d in enumerate(monic, 1)) or 1.0
    last = np.array([-d * rate ** (1 - k) for k, d in enumerate(monic, 1)])
    a, b = np.zeros((order, order), last.dtype), np.zeros(order)
    a.flat[1 :: order + 1] = b[-1] = rate
    a[-1] = last[::-1]
    given = [x / lead * rate ** (k - order) for k, x in enumerate(reversed(numerator))]
    return a, b, np.array([*given, *[0.0] * (order - len(given))])


@dataclass(frozen=True)
class _Prepared:
    """Input and grids of one experiment, computed once.

    ``rest`` says that the run starts at rest, as a step that was not recorded does;
    ``log`` is the position of its offset among those shared by several runs, or None; ``own`` says
    that it has one to itself;
    ``unseen`` samples at its start are not described, and are in ``time`` but not in ``samples``.
    Where the input has the same instants, ``time`` is the array of ``nodes``.
    """

    u: PiecewiseInput
    nodes: Grid
    time: FloatArray
    samples: Grid
    rest: bool
    log: int | None
    own: bool
    unseen: int


class TransferModel:
    """``y(t) = gain * C x(t - dead_time) + offset``, ``x' = A x + B w(u)``.

    The initial state is free for every run, unless its input is a step from rest or ``begin``
    says so. There is an offset for every run, for every log, or none.

    Parameters
    ----------
    law
        The family. Without a dead zone the response is to the departure of the input from its
        first value, and the level goes into the offset where there is one.
    variant, experiments
        The roles, and the runs to be described; the output was recorded in all of them or in none.
    begin
        What the runs begin with; the initial state is that of the first sample described.
    """

    def __init__(
        self, law: Law, variant: Variant, experiments: Sequence[Experiment],
        begin: Beginning = ANY,
    ) -> None:  # fmt: skip
        self.law, self.begin = law, begin
        drive, output = variant.driving[0].name, variant.output.name
        recorded = [e for e in experiments if output in e]
        self.resolutions = [e.signals[output].resolution for e in recorded]
        self.levels = [self.level(e.signals[drive]) for e in experiments]
        self.logs = [e.log for e in experiments]
        several = [k for k in dict.fromkeys(self.logs) if self.logs.count(k) > 1]
        self.several = several if begin.offset == "log" else []
        self.prepared = [self._prepare(e, drive) for e in experiments]
        self.measured = [e[output][p.unseen :] for e, p in zip(recorded, self.prepared)]
        self._free: dict[int, tuple[bytes, Array]] = {}  # by run, with its matrices

    def level(self, signal: Signal) -> float:
        """Level of an input from which the response departs [its unit]."""
        return 0.0 if self.law.dead_zone else input_level(signal)

    def read(self, signal: Signal) -> PiecewiseInput:
        """The input over time, about its level."""
        return piecewise(signal, level=self.level(signal))

    def _prepare(self, experiment: Experiment, role: str) -> _Prepared:
        signal = experiment.signals[role]
        u = self.read(signal)
        rest = self.begin.rest or signal.time.size == 1
        time, unseen = experiment.time, 0
        if not rest:  # a few are left of a run that ends before
            end = time[0] + self.begin.unrecorded
            unseen = max(min(int(np.searchsorted(time, end)), time.size - _FEWEST), 0)
        whole = make_grid(time)
        same = u.nodes is time or np.array_equal(u.nodes, time)
        log = self.several.index(experiment.log) if experiment.log in self.several else None
        own = log is None and self.begin.offset != "none"
        return _Prepared(
            u, whole if same else make_grid(u.nodes), time,
            make_grid(time[unseen:]) if unseen else whole, rest, log, own, unseen,
        )  # fmt: skip

    def columns(self, index: int, values: Values) -> Basis:
        """Forced response, free responses and offset of one experiment."""
        p = self.prepared[index]
        y, local = self.forced(index, values), self._local(index, values)
        offsets = [repeated(k == p.log, y.size) for k in range(len(self.several))]
        if self.law.gain is None:
            return Basis(y, offsets, local)
        if self.begin.offset == "none":
            y = y + self.levels[index]
        return Basis(repeated(0.0, y.size), [y, *offsets], local)

    def forced(self, index: int, values: Values) -> Array:
        """Response of one run to its input, of unit gain, shape ``(n,)``."""
        p, u = self.prepared[index], self.prepared[index].u
        a, b, c = map(real_if_real, self.law.realise(values))
        if self.law.dead_zone:
            edges = real_if_real(np.array([values[n] for n in EDGES]))
            u = apply_dead_zone(u, *edges)
        y = forced_response(
            a, b, c, u, p.time, dead_time=values.get("dead_time", 0.0), grid=p.nodes
        )
        return y[p.unseen :]

    def steady_level(self, index: int, values: Values) -> float:
        """Steady output at the level that the input of a run starts from; part of an offset.

        Zero where there is no offset: the response then holds it.
        """
        if self.law.gain is None or self.begin.offset == "none":
            return 0.0
        return float(values[self.law.gain]) * self.levels[index]

    def _local(self, index: int, values: Values) -> list[Array]:
        """Columns of the unknowns that belong to one run: initial state and own offset."""
        p = self.prepared[index]
        offset = [repeated(1.0, p.samples.instants.size)] if p.own else []
        if p.rest:
            return offset
        a, c, states = self.law.beginnings(values, p.own)
        of = a.tobytes() + c.tobytes()
        known = self._free.get(index)
        if known is None or known[0] != of:
            known = of, free_response(a, c, p.samples, states)
            if not np.iscomplexobj(known[1]):  # complex ones never come again
                self._free[index] = known
        return [*known[1], *offset]

    def named(self, nonlinear: Sequence[str]) -> NamedModel:
        """The model in the form the estimation takes."""
        linear = () if self.law.gain is None else (self.law.gain,)
        return NamedModel(
            tuple(nonlinear), linear, self.columns, self.measured,
            nuisance=tuple(f"offset[{k}]" for k in self.several),
            resolutions=self.resolutions, logs=self.logs,
        )  # fmt: skip

    def fitted(self, values: Values, limit: float | None = None) -> Iterator[Simulated]:
        """Outputs of all runs, offset by log and initial state by run fitted to what was recorded.

        Samples off by more than a ``limit`` count less for these. What answers to an input before
        the run is NaN.
        """
        problem = bind(self.named([n for n in values if n != self.law.gain]), {}, values)
        fit = Eliminated(problem, np.zeros(0))
        for _ in range(ROUNDS if limit is not None else 0):
            rest = [y - s for y, s in zip(problem.measured, fit.simulate(), strict=True)]
            weights = huber_weights(rest, limit)[0]
            if all(w.min(initial=1.0) == 1.0 for w in weights):
                break
            problem = replace(problem, weights=weights)
            fit = Eliminated(problem, fit.eta, fit.bases)
        for i, (p, simulated) in enumerate(zip(self.prepared, fit.simulate(), strict=True)):
            offset = None
            if p.own or p.log is not None:
                offset = float(fit.local[i][-1] if p.log is None else fit.linear[p.log])
                offset -= self.steady_level(i, values)
            yield Simulated(np.append(np.full(p.unseen, np.nan), simulated), offset=offset)

    def combined(self, values: Values) -> FloatArray:
        """Output of the first run, all that belongs to it alone being zero."""
        b = self.columns(0, values)
        linear = np.array([values[self.law.gain]] if self.law.gain else [])
        return np.asarray(b.combined(linear, np.zeros(len(b.local))))


def input_level(signal: Signal) -> float:
    """The level of rest that a signal starts from [unit of the signal]."""
    stepped = signal.time.size == 1
    return signal.before if stepped else float(signal.values[0])


class TransferResponse(ResponseModel[OptionsT], Generic[OptionsT]):
    """Declaration of a family whose response is that of a :class:`TransferModel`."""

    @abstractmethod
    def transfer_model(
        self, variant: Variant, experiments: Sequence[Experiment], begin: Beginning = ANY
    ) -> TransferModel:
        """The model of some experiments."""

    def response(
        self, variant: Variant, experiments: Sequence[Experiment], begin: Beginning,
        names: tuple[str, ...],
    ) -> NamedModel:  # fmt: skip
        """The model as the estimation takes it; see :meth:`ResponseModel.response`."""
        return self.transfer_model(variant, experiments, begin).named(names)

    def simulate(
        self, plant: Plant[OptionsT], experiments: Sequence[Experiment], offset: float | None = None
    ) -> list[Simulated]:
        """Output from the input; see :meth:`.Family.simulate`."""
        v, variant, options, start = plant.numbers, plant.variant, plant.options, offset or 0.0
        recorded, out = [e for e in experiments if variant.output.name in e], []
        model = self.transfer_model(variant, recorded, options.beginning)
        fitted = model.fitted(v, options.residual_limit)
        for e in experiments:
            if variant.output.name in e:
                out.append(next(fitted))
            else:
                alone = self.transfer_model(variant, [e], AT_REST).combined(v)
                out.append(Simulated(alone + start, offset=start))
        return out

    def beginnings_left_out(self, plant: Plant[OptionsT]) -> list[UnmodelledEffect]:
        """Offsets and initial states that a fit did not ask for, or was not to have."""
        begin, output = plant.options.beginning, plant.variant.output.name
        out = [output_offset(output)] if begin.offset == "none" else []
        if begin.rest:
            out.append(initial_states(output, partial(self._free_responses, plant)))
        return out

    def _free_responses(self, plant: Plant[OptionsT], experiment: Experiment) -> FloatArray:
        """Output after unit states, shape ``(n, states)``."""
        begin = replace(plant.options.beginning, rest=False, unrecorded=0.0)
        model = self.transfer_model(plant.variant, [experiment], begin)
        local = model.columns(0, plant.numbers).local
        return np.reshape(local[: len(local) - model.prepared[0].own], (-1, experiment.samples)).T
