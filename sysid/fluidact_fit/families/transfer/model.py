"""A small transfer function as a model of runs: dead time, dead zone, initial state, offset.

A family gives its state space ``(A, B, C)`` as a function of named values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np

from ...estimation.blocks import condense
from ...estimation.grid import Grid, make_grid
from ...estimation.inputs import PiecewiseInput, apply_dead_zone, piecewise
from ...estimation.least_squares import project_out
from ...estimation.linear import forced_pieces, free_pieces, states_at_nodes
from ...estimation.named_model import NamedModel, Values
from ...estimation.problem import Basis, real_if_real
from ...estimation.response_model import Beginning
from ...experiment import Array, Experiment, FloatArray, Signal
from ...family import Simulated
from ...rows import blocks, is_repeated, repeated, side_by_side

T = TypeVar("T")
Realisation = Callable[[Values], tuple[Array, Array, Array]]
ANY = Beginning()
_FEWEST = 4  # samples that are left of a run


@dataclass(frozen=True)
class Free:
    """A system of which some states stand for all that a run may have begun with.

    ``y = C exp(A t) e_i`` for every state ``i`` of ``states``; they are as many whatever the
    values are, for derivatives are taken column by column. ``b`` is the input of the system where
    it is the very one that is driven.
    """

    a: Array
    c: Array
    states: tuple[int, ...]
    b: Array | None = None


def any_start(a: Array, b: Array, c: Array) -> Free:
    """Every state of a system by itself."""
    return Free(a, c, tuple(range(c.size)), b)


@dataclass(frozen=True)
class _Prepared:
    """Input and grids of one experiment, computed once.

    ``rest`` says that the run starts at rest, as a step that was not recorded does;
    ``log`` is the position of its offset among those shared by several runs, or None; ``own`` says
    that it has one to itself;
    ``unseen`` samples at its start are not described, ``parts`` are the blocks of the others.
    """

    u: PiecewiseInput
    nodes: Grid
    samples: Grid
    rest: bool
    log: int | None
    own: bool
    unseen: int
    parts: tuple[slice, ...]


class TransferModel:
    """``y(t) = gain * C x(t - dead_time) + offset``, ``x' = A x + B w(u)``.

    The initial state is free for every run, unless its input is a step from rest or ``begin``
    says so. There is an offset for every run, for every log, or none.

    Parameters
    ----------
    experiments
        With the roles ``input_role`` and ``output_role``.
    realise
        ``values -> (A, B, C)``, analytic; balanced so that ``A`` has equal entries.
    beginnings
        ``beginnings(values)``: what a run with an offset of its own may have begun with. A
        state whose free response is a constant, like the position of a free mass, is not
        among them: the offset already stands for it.
    gain
        Name of the parameter that multiplies the response, or None when the gain is
        part of the realisation.
    dead_zone
        Whether the input passes ``dead_zone_negative`` and ``dead_zone_positive``.
        Without one, the response is to the departure of the input from its first value,
        and the level goes into the offset where there is one.
    begin
        What the runs begin with; the initial state is that of the first sample described.
    """

    def __init__(
        self,
        experiments: Sequence[Experiment],
        input_role: str,
        output_role: str,
        realise: Realisation,
        beginnings: Callable[[Values], Free],
        begin: Beginning = ANY,
        *,
        gain: str | None = None,
        dead_zone: bool = False,
    ) -> None:
        self.begin = begin
        self.realise, self.gain, self.dead_zone = realise, gain, dead_zone
        self.beginnings = beginnings
        self.resolutions = [
            e.signals[output_role].resolution for e in experiments if output_role in e
        ]
        self.levels = [input_level(e.signals[input_role]) for e in experiments]
        self.logs = [e.log for e in experiments]
        several = [k for k in dict.fromkeys(self.logs) if self.logs.count(k) > 1]
        self.several = several if begin.offset == "log" else []
        self.prepared = [self._prepare(e, input_role) for e in experiments]
        self.measured = [
            e[output_role][p.unseen :]
            for e, p in zip(experiments, self.prepared)
            if output_role in e
        ]
        self._known: dict[tuple[str, int], tuple[bytes, Any]] = {}

    def _prepare(self, experiment: Experiment, role: str) -> _Prepared:
        signal = experiment.signals[role]
        u = piecewise(signal, level=0.0 if self.dead_zone else input_level(signal))
        rest = self.begin.rest or signal.time.size == 1
        time, unseen = experiment.time, 0
        if not rest:  # a few are left of a run that ends before
            end = time[0] + self.begin.unrecorded
            unseen = max(min(int(np.searchsorted(time, end)), time.size - _FEWEST), 0)
        samples = make_grid(time[unseen:])
        same = unseen == 0 and (
            signal.time is experiment.time or np.array_equal(signal.time, experiment.time)
        )
        log = self.several.index(experiment.log) if experiment.log in self.several else None
        own = log is None and self.begin.offset != "none"
        nodes = samples if same else make_grid(u.nodes)
        parts = tuple(blocks(samples.instants.size))
        return _Prepared(u, nodes, samples, rest, log, own, unseen, parts)

    def columns(self, index: int, values: Values) -> Basis:
        """Forced response, free responses and offset of one experiment."""
        found = list(self.pieces(index, values))
        if len(found) == 1:
            return found[0]
        return Basis(*(np.concatenate(x) for x in zip(*((b.known, b.shared, b.local)
                                                        for b in found))))  # fmt: skip

    def pieces(self, index: int, values: Values) -> Iterator[Basis]:
        """The same for consecutive blocks of samples."""
        p = self.prepared[index]
        a, b, c = map(real_if_real, self.realise(values))
        forced = forced_pieces(
            a, b, c, p.u, p.nodes, p.samples, p.parts, dead_time=values.get("dead_time", 0.0),
            shape=self._shape(index, values),
            run=partial(self._states, index, a, b) if len(p.parts) == 1 else None,
        )  # fmt: skip
        for y, local in zip(forced, self._local(index, values), strict=True):
            offsets = np.zeros((y.size, len(self.several)))
            if p.log is not None:
                offsets[:, p.log] = 1.0
            if self.gain is None:
                yield Basis(y, offsets, local)
            else:
                if self.begin.offset == "none":
                    y = y + self.levels[index]
                yield Basis(repeated(np.zeros(()), y.size), side_by_side(y, offsets), local)

    def _shape(
        self, index: int, values: Values
    ) -> Callable[[PiecewiseInput], PiecewiseInput] | None:
        """Static characteristic in front of the linear model."""
        if not self.dead_zone:
            return None
        edges = real_if_real(np.array([values[f"dead_zone_{s}"] for s in ("negative", "positive")]))

        def shape(u: PiecewiseInput) -> PiecewiseInput:
            return apply_dead_zone(u, *edges)

        if len(self.prepared[index].parts) > 1:
            return shape
        return lambda u: self._remember(("shape", index), [edges], lambda: shape(u))

    def _states(
        self, index: int, a: Array, b: Array, u: PiecewiseInput, nodes: Grid, start: Array | None
    ) -> Array:
        """States at some nodes; dead times differ in the output equation alone."""

        def compute() -> Array:
            return states_at_nodes(a, b, u, nodes, start)

        if self.dead_zone:
            return compute()
        return self._remember(("states", index), (a, b), compute)

    def responses(self, index: int, values: Values) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Forced response and free responses without the offset of one run, block by block."""
        own = self.prepared[index].own
        for basis in self.pieces(index, values):
            local = np.asarray(basis.local[:, :-1] if own else basis.local)
            if self.gain is None:
                yield np.asarray(basis.known), local
            else:
                yield float(values[self.gain]) * basis.shared[:, 0], local

    def steady_level(self, index: int, values: Values) -> float:
        """Steady output at the level that the input of a run starts from; part of an offset.

        Zero where there is no offset: the response then holds it.
        """
        if self.gain is None or self.begin.offset == "none":
            return 0.0
        return float(values[self.gain]) * self.levels[index]

    def free_responses(self, index: int, values: Values) -> Iterator[FloatArray]:
        """Free responses without the offset of one run, block by block."""
        own = self.prepared[index].own
        return (np.asarray(x[:, :-1] if own else x) for x in self._local(index, values))

    def _local(self, index: int, values: Values) -> Iterator[Array]:
        """Columns of the unknowns that belong to one run: initial state and own offset."""
        p = self.prepared[index]
        # an offset that is not the run's own stands for no initial state
        free = self.beginnings(values) if p.own else any_start(*self.realise(values))
        for part, every in zip(p.parts, self._free(index, free), strict=True):
            count, own = part.stop - part.start, np.ones(int(p.own))
            if every is None:
                yield repeated(own, count)
            elif is_repeated(every):
                yield repeated(np.concatenate((every[0, free.states], own)), count)
            else:
                yield side_by_side(every[:, free.states], repeated(own, count))

    def _free(self, index: int, free: Free) -> Iterator[Array | None]:
        """Free responses; none of a run that starts at rest."""
        p, a, c = self.prepared[index], free.a, free.c
        if p.rest:
            yield from (None for _ in p.parts)
            return
        driven = None
        if free.b is not None and p.nodes.distinct.size == 1:
            driven = free.b, p.u.coefficients.shape[1] - 1
        pieces = free_pieces(a, c, p.samples, p.parts, driven)
        if len(p.parts) > 1:
            yield from pieces
        else:
            of = (a, c) if driven is None else (a, c, driven[0])
            yield self._remember(("free", index), of, lambda: next(pieces))

    def _remember(self, key: tuple[str, int], of: Sequence[Array], compute: Callable[[], T]) -> T:
        """Compute unless the last real matrices were the same; complex ones never come again."""
        if any(np.iscomplexobj(x) for x in of):
            return compute()
        now = b"".join(x.tobytes() for x in of)
        known = self._known.get(key)
        if known is None or known[0] != now:
            known = self._known[key] = (now, compute())
        found: T = known[1]
        return found

    def named(self, nonlinear: Sequence[str]) -> NamedModel:
        """The model in the form the estimation takes."""
        linear = () if self.gain is None else (self.gain,)
        return NamedModel(
            tuple(nonlinear), linear, self.columns, self.measured,
            nuisance=tuple(f"offset[{k}]" for k in self.several),
            resolutions=self.resolutions, logs=self.logs, pieces=self.pieces,
        )  # fmt: skip


def input_level(signal: Signal) -> float:
    """The level of rest that a signal starts from [unit of the signal]."""
    stepped = signal.time.size == 1
    return signal.before if stepped else float(signal.values[0])


def simulate_transfer(
    model: TransferModel, values: Values, offset: float | None
) -> list[Simulated]:
    """Outputs of all runs, offset by log and initial state by run fitted to their outputs.

    What answers to an input before the run is NaN. Runs without a recorded output start at
    rest, where the output is ``gain`` times the input's first value plus ``offset``.
    """
    runs = range(len(model.prepared))
    if not model.measured:
        return [
            Simulated(
                np.concatenate([known for known, _ in model.responses(i, values)])
                + (model.steady_level(i, values) + (offset or 0.0)),
                offset=offset or 0.0,
            )
            for i in runs
        ]
    owners = model.logs if model.begin.offset == "log" else list(runs)
    none = model.begin.offset == "none"
    out: dict[int, Simulated] = {}
    for owner in dict.fromkeys(owners):
        own = [i for i in runs if owners[i] == owner]
        prepared = [model.prepared[i] for i in own]
        outputs = [np.full(p.unseen + p.samples.instants.size, np.nan) for p in prepared]
        forced = [y[p.unseen :] for p, y in zip(prepared, outputs, strict=True)]
        found = _fit_offset(
            [condense(_columns(model, i, values, y)) for i, y in zip(own, forced, strict=True)],
            none,
        )
        for i, y, output, unknowns in zip(own, forced, outputs, found, strict=True):
            _add_beginnings(model, i, values, y, unknowns)
            level = None if none else float(unknowns[-1]) - model.steady_level(i, values)
            out[i] = Simulated(output, offset=level)
    return [out[i] for i in runs]


def _columns(
    model: TransferModel, index: int, values: Values, forced: FloatArray
) -> Iterator[FloatArray]:
    """Free responses, a constant, and what both are to explain, block by block.

    The response to the input, shape ``(n,)``, is kept in ``forced``.
    """
    for part, (known, free) in zip(model.prepared[index].parts, model.responses(index, values)):
        forced[part] = known
        rest = model.measured[index][part] - known
        yield side_by_side(free, np.ones(rest.size), rest)


def _add_beginnings(
    model: TransferModel, index: int, values: Values, forced: FloatArray, unknowns: FloatArray
) -> None:
    """Add initial state and offset of a run to its response to the input."""
    p = model.prepared[index]
    for part, free in zip(p.parts, model.free_responses(index, values), strict=True):
        forced[part] += free @ unknowns[:-1] + unknowns[-1]


def _fit_offset(runs: Sequence[FloatArray], none: bool) -> list[FloatArray]:
    """Least squares of one constant for all runs, or ``none``, and free responses for each.

    ``runs`` are tables of free responses, a constant and the rest; returned are the unknowns of
    every run. The constant is found first, from what the free responses cannot explain.
    """
    if len(runs) == 1 and not none:
        found = np.linalg.lstsq(runs[0][:, :-1], runs[0][:, -1], rcond=None)[0]
        return [np.asarray(found, dtype=np.float64)]
    left = [project_out(x[:, -2:], x[:, :-2]) for x in runs]
    power = 0.0 if none else sum(float(p[:, 0] @ p[:, 0]) for p in left)
    level = sum(float(p[:, 0] @ p[:, 1]) for p in left) / power if power > 0.0 else 0.0
    out = []
    for x in runs:
        free = np.linalg.lstsq(x[:, :-2], x[:, -1] - level * x[:, -2], rcond=None)[0]
        out.append(np.append(free, level))
    return out
