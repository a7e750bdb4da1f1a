"""A small transfer function as a model of runs: dead time, dead zone, initial state, offset.

A family gives its state space ``(A, B, C)`` as a function of named values.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ...estimation.inputs import PiecewiseInput, apply_dead_zone, piecewise
from ...estimation.linear import (
    Grid,
    forced_response,
    free_response,
    make_grid,
    states_at_nodes,
)
from ...estimation.parametric import NamedModel, Values
from ...estimation.separable import Basis, project_out
from ...experiment import Experiment, FloatArray, Signal
from ...family import Simulated

Array = npt.NDArray[Any]
Realisation = Callable[[Values], tuple[Array, Array, Array]]


@dataclass(frozen=True)
class _Prepared:
    """Input and grids of one experiment, computed once.

    ``rest`` says that the run starts at rest, as a step that was not recorded does;
    ``log`` is the position of its offset among those shared by several runs, or None;
    ``used`` are its samples that the model describes.
    """

    u: PiecewiseInput
    nodes: Grid
    samples: Grid
    rest: bool
    log: int | None
    used: npt.NDArray[np.bool_]


class TransferModel:
    """``y(t) = gain * C x(t - dead_time) + offset``, ``x' = A x + B w(u)``.

    The initial state is free for every run, unless its input is a step from rest or
    ``rest`` says so. The offset is free for every run, or for every log where
    ``common_offset`` says so.

    Parameters
    ----------
    experiments
        With the roles ``input_role`` and ``output_role``.
    realise
        ``values -> (A, B, C)``, analytic; balanced so that ``A`` has equal entries.
    gain
        Name of the parameter that multiplies the response, or None when the gain is
        part of the realisation.
    dead_zone
        Whether the input passes ``dead_zone_negative`` and ``dead_zone_positive``.
        Without one, the response is to the departure of the input from its first value,
        and the level goes into the offset.
    confounded
        States whose free response is a constant, like the position of a free mass: the
        offset already stands for them.
    unrecorded
        How long the output of a run answers to the input before it [s]: what was measured
        until then is left out, and the initial state is that of the first sample after it.
    """

    def __init__(
        self,
        experiments: Sequence[Experiment],
        input_role: str,
        output_role: str,
        realise: Realisation,
        *,
        gain: str | None = None,
        dead_zone: bool = False,
        confounded: Callable[[Values], tuple[int, ...]] = lambda values: (),
        rest: bool = False,
        common_offset: bool = False,
        unrecorded: float = 0.0,
    ) -> None:
        self.rest, self.common_offset, self.unrecorded = rest, common_offset, unrecorded
        self.realise, self.gain, self.dead_zone = realise, gain, dead_zone
        self.confounded = confounded
        self.resolutions = [
            e.signals[output_role].resolution for e in experiments if output_role in e
        ]
        self.levels = [input_level(e.signals[input_role]) for e in experiments]
        self.logs = [e.log for e in experiments]
        several = [k for k in dict.fromkeys(self.logs) if self.logs.count(k) > 1]
        self.several = several if common_offset else []
        self.prepared = [self._prepare(e, input_role) for e in experiments]
        self.measured = [
            e[output_role][p.used] for e, p in zip(experiments, self.prepared) if output_role in e
        ]
        self._known: dict[tuple[str, int], tuple[bytes, Array]] = {}

    def _prepare(self, experiment: Experiment, role: str) -> _Prepared:
        signal = experiment.signals[role]
        u = piecewise(signal, level=0.0 if self.dead_zone else input_level(signal))
        rest = self.rest or signal.time.size == 1
        used = np.ones(experiment.time.size, dtype=bool)
        if self.unrecorded > 0.0 and not rest:
            used = ~answers_to_the_past(experiment, self.unrecorded)
        samples = make_grid(experiment.time[used])
        same = used.all() and (
            signal.time is experiment.time or np.array_equal(signal.time, experiment.time)
        )
        log = self.several.index(experiment.log) if experiment.log in self.several else None
        nodes = samples if same else make_grid(u.nodes)
        return _Prepared(u, nodes, samples, rest, log, used)

    def columns(self, index: int, values: Values) -> Basis:
        """Forced response, free responses and offset of one experiment."""
        p = self.prepared[index]
        a, b, c = self.realise(values)
        u = p.u
        if self.dead_zone:
            u = apply_dead_zone(u, values["dead_zone_negative"], values["dead_zone_positive"])
        states = None
        if u is p.u:  # dead times differ in the output equation alone
            states = self._remember(
                ("states", index), (a, b), lambda: states_at_nodes(a, b, u, p.nodes)
            )
        y = forced_response(
            a, b, c, u, p.samples.instants,
            dead_time=values.get("dead_time", 0.0), grid=p.nodes, states=states,
        )  # fmt: skip
        local = self._local(index, a, c, values)
        offsets = np.zeros((y.size, len(self.several)))
        if p.log is not None:
            offsets[:, p.log] = 1.0
        if self.gain is None:
            return Basis(y, offsets, local)
        return Basis(np.zeros(y.size), np.column_stack((y, offsets)), local)

    def response(self, index: int, values: Values) -> tuple[FloatArray, FloatArray, float]:
        """Forced response, free responses without the offset, and steady level of one run."""
        basis = self.columns(index, values)
        p = self.prepared[index]
        local = basis.local if p.log is not None else basis.local[:, :-1]
        if self.gain is None:
            return np.asarray(basis.known), np.asarray(local), 0.0
        gain = float(values[self.gain])
        return gain * basis.shared[:, 0], np.asarray(local), gain * self.levels[index]

    def _local(self, index: int, a: Array, c: Array, values: Values) -> Array:
        """Columns of the unknowns that belong to one run: initial state and own offset."""
        p = self.prepared[index]
        columns: list[Array] = []
        if not p.rest:
            free = self._remember(("free", index), (a, c), lambda: free_response(a, c, p.samples))
            skip = self.confounded(values) if p.log is None else ()
            # as many columns whatever the values: derivatives are taken column by column
            columns += [free[:, i] * (i not in skip) for i in range(free.shape[1])]
        if p.log is None:
            columns.append(np.ones(p.samples.instants.size))
        return np.column_stack(columns) if columns else np.zeros((p.samples.instants.size, 0))

    def _remember(
        self, key: tuple[str, int], of: Sequence[Array], compute: Callable[[], Array]
    ) -> Array:
        """Compute unless the last real matrices were the same; complex ones never come again."""
        if any(np.iscomplexobj(x) for x in of):
            return compute()
        now = b"".join(x.tobytes() for x in of)
        known = self._known.get(key)
        if known is None or known[0] != now:
            known = self._known[key] = (now, compute())
        return known[1]

    def named(self, nonlinear: Sequence[str]) -> NamedModel:
        """The model in the form the estimation takes."""
        linear = () if self.gain is None else (self.gain,)
        return NamedModel(
            tuple(nonlinear), linear, self.columns, self.measured,
            nuisance=tuple(f"offset[{k}]" for k in self.several),
            resolutions=self.resolutions, logs=self.logs,
        )  # fmt: skip


def input_level(signal: Signal) -> float:
    """The level of rest that a signal starts from [unit of the signal]."""
    stepped = signal.time.size == 1
    return signal.before if stepped else float(signal.values[0])


def time_scales(experiments: Sequence[Experiment]) -> tuple[float, float]:
    """Shortest sample time and longest duration of the logs [s]."""
    return min(e.sample_time for e in experiments), max(float(np.ptp(e.time)) for e in experiments)


def answers_to_the_past(experiment: Experiment, unrecorded: float) -> npt.NDArray[np.bool_]:
    """Samples within ``unrecorded`` [s] of the start; none of a run not even twice as long."""
    since = experiment.time - experiment.time[0]
    return np.asarray((since < unrecorded) & (since[-1] > 2.0 * unrecorded))


def are_short(experiments: Sequence[Experiment]) -> bool:
    """Whether the runs hold too few samples to have offsets and initial states of their own.

    In a run of ten samples that begins with the step these would explain the whole response. In
    a run of a hundred or more they cost next to nothing.
    """
    return sum(e.samples for e in experiments) < 100 * len(experiments)


def simulate_transfer(
    model: TransferModel, values: Values, offset: float | None = None
) -> list[Simulated]:
    """Outputs of all runs, offset by log and initial state by run fitted to their outputs.

    What answers to an input before the run is NaN. Runs without a recorded output start at
    rest, where the output is ``gain`` times the input's first value plus ``offset``.
    """
    parts = [model.response(i, values) for i in range(len(model.prepared))]
    if not model.measured:
        return [
            Simulated(known + level + (offset or 0.0), offset=offset or 0.0)
            for known, _, level in parts
        ]
    out: list[Simulated | None] = [None] * len(parts)
    described = [p.used for p in model.prepared]
    owners = model.logs if model.common_offset else list(range(len(parts)))
    for owner in dict.fromkeys(owners):
        runs = [i for i, other in enumerate(owners) if other == owner]
        rest = [model.measured[i] - parts[i][0] for i in runs]
        level, fitted = _fit_offset(rest, [parts[i][1] for i in runs])
        for i, extra in zip(runs, fitted):
            output = np.full(described[i].size, np.nan)
            output[described[i]] = parts[i][0] + extra
            out[i] = Simulated(output, offset=level - parts[i][2])
    return [s for s in out if s is not None]


def _fit_offset(
    rest: Sequence[FloatArray], free: Sequence[FloatArray]
) -> tuple[float, list[FloatArray]]:
    """Least squares of one constant for all runs and free responses for each.

    The constant is found first, from what the free responses cannot explain.
    """
    if len(rest) == 1:
        columns = np.column_stack((np.ones(rest[0].size), free[0]))
        found = np.linalg.lstsq(columns, rest[0], rcond=None)[0]
        return float(found[0]), [np.asarray(columns @ found)]
    left = [project_out(np.column_stack((r, np.ones(r.size))), f) for r, f in zip(rest, free)]
    power = sum(float(p[:, 1] @ p[:, 1]) for p in left)
    level = sum(float(p[:, 1] @ p[:, 0]) for p in left) / power if power > 0.0 else 0.0
    out = []
    for r, f in zip(rest, free):
        found = np.linalg.lstsq(f, r - level, rcond=None)[0]
        out.append(np.asarray(level + f @ found))
    return level, out
