"""Output-error fits of small transfer functions, shared by the families that have one.

A family gives its state space ``(A, B, C)`` as a function of named values; the dead time,
the dead zone at the input, the initial state and the offset of every log are dealt with
here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import Notice
from ..experiment import Experiment, FloatArray
from ..family import FamilyOptions, ParameterSpec, Request, Simulated
from .information import project_out
from .input_noise import (
    extrapolate_bias,
    moving_inputs,
    share_of_residual,
    whitening,
)
from .inputs import PiecewiseInput, apply_dead_zone, piecewise
from .linear import Grid, forced_response, free_response, make_grid, states_at_nodes
from .noise import noise_floor
from .parametric import (
    Fitted,
    NamedModel,
    Values,
    bind,
    fit_named,
    input_level,
    shorten,
)
from .results import Refusal
from .separable import Basis, Problem, Search, Unknown, evaluate, profile, solve_from
from .uncertainty import enlarge

Array = npt.NDArray[Any]
_MANY = 200_000  # samples beyond which the start is refined on a quarter of that first
Realisation = Callable[[Values], tuple[Array, Array, Array]]


@dataclass(frozen=True)
class _Prepared:
    """Input and grids of one experiment, computed once.

    ``rest`` says that the run starts at rest, as a step that was not recorded does;
    ``log`` is the position of its offset among those shared by several runs, or None.
    """

    u: PiecewiseInput
    nodes: Grid
    samples: Grid
    rest: bool
    log: int | None


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
    ) -> None:
        self.rest, self.common_offset = rest, common_offset
        self.realise, self.gain, self.dead_zone = realise, gain, dead_zone
        self.confounded = confounded
        self.measured = [e[output_role] for e in experiments if output_role in e]
        self.resolutions = [
            e.signals[output_role].resolution for e in experiments if output_role in e
        ]
        self.levels = [input_level(e.signals[input_role]) for e in experiments]
        self.logs = [e.log for e in experiments]
        several = [k for k in dict.fromkeys(self.logs) if self.logs.count(k) > 1]
        self.several = several if common_offset else []
        self.prepared = [self._prepare(e, input_role) for e in experiments]
        self._states: dict[int, tuple[bytes, Array]] = {}
        self._free: dict[int, tuple[bytes, Array]] = {}

    def _prepare(self, experiment: Experiment, role: str) -> _Prepared:
        signal = experiment.signals[role]
        u = piecewise(signal, level=0.0 if self.dead_zone else input_level(signal))
        samples = make_grid(experiment.time)
        same = signal.time is experiment.time or np.array_equal(signal.time, experiment.time)
        log = self.several.index(experiment.log) if experiment.log in self.several else None
        nodes = samples if same else make_grid(u.nodes)
        return _Prepared(u, nodes, samples, self.rest or signal.time.size == 1, log)

    def columns(self, index: int, values: Values) -> Basis:
        """Forced response, free responses and offset of one experiment."""
        p = self.prepared[index]
        a, b, c = self.realise(values)
        u = p.u
        if self.dead_zone:
            u = apply_dead_zone(u, values["dead_zone_negative"], values["dead_zone_positive"])
        states = None
        if u is p.u:  # dead times differ in the output equation alone
            states = _remember(
                self._states, index, (a, b), lambda: states_at_nodes(a, b, u, p.nodes)
            )
        y = forced_response(
            a, b, c, u, p.samples.instants,
            dead_time=values.get("dead_time", 0.0), grid=p.nodes, states=states,
        )  # fmt: skip
        local = self._local(index, a, c, values)
        if not self.several:
            if self.gain is None:
                return Basis(y, np.zeros((y.size, 0)), local)
            return Basis(np.zeros(y.size), y[:, None], local)
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
            free = _remember(self._free, index, (a, c), lambda: free_response(a, c, p.samples))
            skip = self.confounded(values) if p.log is None else ()
            columns += [free[:, i] for i in range(free.shape[1]) if i not in skip]
        if p.log is None:
            columns.append(np.ones(p.samples.instants.size))
        if not columns:
            return np.zeros((p.samples.instants.size, 0))
        return np.column_stack(columns)

    def named(self, nonlinear: Sequence[str]) -> NamedModel:
        """The model in the form the estimation takes."""
        linear = () if self.gain is None else (self.gain,)
        nuisance = tuple(f"offset[{k}]" for k in self.several)
        return NamedModel(
            tuple(nonlinear),
            linear,
            self.columns,
            self.measured,
            nuisance=nuisance,
            resolutions=self.resolutions,
            logs=self.logs,
        )


def _remember(
    memory: dict[int, tuple[bytes, Array]],
    index: int,
    of: Sequence[Array],
    compute: Callable[[], Array],
) -> Array:
    """Compute unless the last real matrices were the same; complex ones never come again."""
    if any(np.iscomplexobj(x) for x in of):
        return compute()
    key = b"".join(x.tobytes() for x in of)
    known = memory.get(index)
    if known is None or known[0] != key:
        known = memory[index] = (key, compute())
    return known[1]


def grid_search(
    problem: Problem,
    axes: Mapping[str, FloatArray],
    dead_times: Callable[[Mapping[str, float]], FloatArray] | None = None,
    held: Mapping[str, float] | None = None,
    keep: int = 4,
) -> list[dict[str, float]]:
    """Profile the cost over a grid and return the distinct valleys, best first.

    A valley is a grid point that is no worse than its neighbours along every axis: dead
    times and natural frequencies have several.

    Parameters
    ----------
    axes
        Values to try of every nonlinear unknown but the dead time, shape ``(k,)`` each.
    dead_times
        Dead times to try [s] at a point of the other axes, ascending, shape ``(k,)``; a
        slow plant needs fewer. ``held`` holds values that are no unknowns, for its use.
    """
    order = [u.name for u in problem.nonlinear]
    if not order:  # everything but gains and offsets is fixed
        return [{}]
    outer = [n for n in order if n != "dead_time" or dead_times is None]
    shape = tuple(len(axes[n]) for n in outer)
    rows, costs = [], []
    for index in np.ndindex(shape):
        point = {n: float(axes[n][k]) for n, k in zip(outer, index)}
        inner = np.zeros(1)
        if dead_times is not None and "dead_time" in order:
            inner = dead_times({**(held or {}), **point})
        row = [{**point, "dead_time": float(x)} for x in inner]
        rows.append((inner, row))
        costs.append(profile(problem, np.array([[r[n] for n in order] for r in row])))
    found = []
    for flat, index in enumerate(np.ndindex(shape)):
        inner, row = rows[flat]
        for k in np.flatnonzero(_valleys(index, shape, inner, rows, costs, flat)):
            found.append((float(costs[flat][k]), {n: row[k][n] for n in order}))
    found.sort(key=lambda pair: pair[0])
    return [point for _, point in found[:keep]]


def _valleys(
    index: tuple[int, ...],
    shape: tuple[int, ...],
    inner: FloatArray,
    rows: Sequence[tuple[FloatArray, Any]],
    costs: Sequence[FloatArray],
    flat: int,
) -> npt.NDArray[np.bool_]:
    """Which points of one row of the grid are no worse than their neighbours."""
    own = costs[flat]
    around = np.concatenate(([np.inf], own, [np.inf]))
    valley = np.isfinite(own) & (own <= around[:-2]) & (own <= around[2:])
    for axis, size in enumerate(shape):
        for other in (index[axis] - 1, index[axis] + 1):
            if 0 <= other < size:
                there = int(np.ravel_multi_index((*index[:axis], other, *index[axis + 1 :]), shape))
                # rows have dead times of their own
                valley &= own <= np.interp(inner, rows[there][0], costs[there])
    return valley


def fit_transfer(
    make: Callable[[Sequence[Experiment], bool], NamedModel],
    experiments: Sequence[Experiment],
    output: str,
    specs: Sequence[ParameterSpec],
    request: Request[FamilyOptions],
    unknowns: Mapping[str, Unknown],
    find_starts: Callable[[Sequence[Experiment], bool], list[dict[str, float]]],
    *,
    sensible: Mapping[str, float] | None = None,
    refusals: Sequence[Refusal] = (),
    rest: bool | None = None,
) -> tuple[Fitted, bool]:
    """Staged fit: look for starts, refine them on an excerpt, then fit everything.

    Parameters
    ----------
    make
        ``make(experiments, rest)`` builds the model of some experiments; ``rest`` takes
        them all to start at rest.
    find_starts
        ``find_starts(experiments, rest)`` returns start values of the nonlinear
        parameters, best first; a ``--start`` wins.
    sensible, refusals
        As in :func:`.parametric.fit_named`.
    rest
        Whether the runs start at rest, where that is known.

    Returns
    -------
    tuple
        The fit, and whether the runs were taken to start at rest.
    """
    held = dict(request.fixed)
    for r in refusals:
        held.setdefault(r.parameter, r.hold if r.hold is not None else 0.0)
    few = shorten(experiments, output)
    request.progress("searching for a start")
    if rest is None:
        rest = _starts_at_rest(make, few, find_starts, unknowns, held, request)
    problem, search = _search(make, few, find_starts, unknowns, held, request, rest)
    names = [u.name for u in problem.nonlinear]
    finalists = [{**held, **dict(zip(names, s.eta))} for s in (search.best, *search.rivals[:1])]
    if sum(e.samples for e in experiments) > _MANY:
        middle = bind(make(shorten(experiments, output, samples=_MANY // 4), rest), unknowns, held)
        closer = solve_from(middle, [_vector(middle, s) for s in finalists], tolerance=1e-2)
        finalists = [{**held, **dict(zip(names, closer.best.eta))}]
    request.progress("fitting")
    fitted = fit_named(
        make(experiments, rest),
        specs,
        request,
        unknowns,
        finalists,
        refusals=refusals,
        sensible=sensible,
    )
    factors = fitted.factors
    fitted, found = _allow_for_input_noise(
        lambda some: make(some, rest).scaled(factors), experiments, specs, request, unknowns,
        fitted, refusals, sensible,
    )  # fmt: skip
    tried = replace(fitted.search, tried=search.tried, agreeing=search.agreeing)
    return replace(fitted, search=tried, remarks=found), rest


def _allow_for_input_noise(
    make: Callable[[Sequence[Experiment]], NamedModel],
    experiments: Sequence[Experiment],
    specs: Sequence[ParameterSpec],
    request: Request[FamilyOptions],
    unknowns: Mapping[str, Unknown],
    fitted: Fitted,
    refusals: Sequence[Refusal],
    sensible: Mapping[str, float] | None,
) -> tuple[Fitted, dict[str, Any]]:
    """Whiten the residual and remove the bias when noise of a measured input matters."""
    rows = sum(e.samples for e in experiments)
    roles = moving_inputs(experiments)
    if not roles or rows > _MANY or rows < 200 * len({e.log for e in experiments}):
        return fitted, {}
    role = roles[0]
    sigma = float(np.median([noise_floor(e[role], 4) for e in experiments]))
    rng = np.random.default_rng(request.seed)
    held = {n: v for n, v in fitted.values.items() if n not in fitted.names}
    for r in refusals:
        held[r.parameter] = r.hold if r.hold is not None else held.get(r.parameter, 0.0)

    def build(some: Sequence[Experiment]) -> Problem:
        return bind(make(some), unknowns, held)

    share = share_of_residual(build, experiments, fitted.solution, role, sigma, rng)
    unit = experiments[0].signals[role].unit
    found = {"input_noise": {"role": role, "sigma": sigma, "unit": unit, "share": share}}
    if share < 0.25:
        return fitted, found
    request.progress("allowing for the noise of the input")
    values = {**held, **fitted.values}
    noise = float(np.median([noise_floor(y, 4) for y in make(experiments).measured]))
    plain = fitted.solution
    for _ in range(2):
        a = whitening(build, experiments, plain, role, sigma, noise, rng)
        white = _whitened(make, a)
        fitted = fit_named(
            white(experiments), specs, request, unknowns, [values],
            refusals=refusals, sensible=sensible,
        )  # fmt: skip
        values = {**values, **fitted.values}
        plain = evaluate(build(experiments), fitted.solution.eta)

    def build_white(some: Sequence[Experiment]) -> Problem:
        return bind(white(some), unknowns, held)

    corrected, notice = _remove_bias(build_white, experiments, fitted, role, sigma, unit, rng)
    found["input_noise"]["treatment"] = "residual whitened, bias removed by extrapolation"
    return replace(corrected, notices=[*corrected.notices, *notice]), found


def _whitened(
    make: Callable[[Sequence[Experiment]], NamedModel], a: FloatArray
) -> Callable[[Sequence[Experiment]], NamedModel]:
    """The same model with its residual whitened by an autoregression, its weights settled."""
    return lambda some: replace(make(some), whiten=a, logs=())


def _remove_bias(
    build: Callable[[Sequence[Experiment]], Problem],
    experiments: Sequence[Experiment],
    fitted: Fitted,
    role: str,
    sigma: float,
    unit: str,
    rng: np.random.Generator,
) -> tuple[Fitted, list[Notice]]:
    """Subtract the bias by input noise and say how much it was."""
    bias, spread = extrapolate_bias(build, experiments, fitted.solution, role, sigma, rng)
    values = dict(fitted.values)
    said = []
    for name, b in zip(fitted.names, bias):
        if name in fitted.unknowns and name in values:
            u = fitted.unknowns[name]
            values[name] = float(np.clip(values[name] - b, u.low, u.high))
            said.append((abs(b) / max(fitted.std_error(name), 1e-300), name, b))
    size, name, b = max(said)
    # scatter by the input, plus what a residual of white noise would add by itself
    total = enlarge(fitted.uncertainty.covariance, np.diag(spread))
    out = replace(fitted, values=values, uncertainty=replace(fitted.uncertainty, covariance=total))
    notice = Notice(
        "input-noise",
        f"'{role}' carries noise of about {sigma:.2g} {unit} rms, which an output-error fit takes "
        f"for signal. The residual was whitened and the bias removed (largest for {name}: "
        f"{b:+.3g}, {size:.1f} standard errors). A cleaner sensor would narrow the intervals.",
    )
    return out, [notice]


def _search(
    make: Callable[[Sequence[Experiment], bool], NamedModel],
    experiments: Sequence[Experiment],
    find_starts: Callable[[Sequence[Experiment], bool], list[dict[str, float]]],
    unknowns: Mapping[str, Unknown],
    held: Mapping[str, float],
    request: Request[FamilyOptions],
    rest: bool,
) -> tuple[Problem, Search]:
    """Solve roughly from every start."""
    problem = bind(make(experiments, rest), unknowns, held)
    starts = [{**s, **request.start} for s in find_starts(experiments, rest)]
    return problem, solve_from(problem, [_vector(problem, s) for s in starts], tolerance=1e-2)


def are_short(experiments: Sequence[Experiment]) -> bool:
    """Whether the runs hold too few samples to have offsets and initial states of their own.

    In a run of ten samples that begins with the step these would explain the whole response. In
    a run of a hundred or more they cost next to nothing.
    """
    return sum(e.samples for e in experiments) < 100 * len(experiments)


def _starts_at_rest(
    make: Callable[[Sequence[Experiment], bool], NamedModel],
    experiments: Sequence[Experiment],
    find_starts: Callable[[Sequence[Experiment], bool], list[dict[str, float]]],
    unknowns: Mapping[str, Unknown],
    held: Mapping[str, float],
    request: Request[FamilyOptions],
) -> bool:
    """Whether short runs are taken to start at rest.

    In a long run the initial state costs nothing and is always free. In a run of ten
    samples that begins with the step, a free initial state explains the whole response;
    it is then freed only when the Bayes criterion asks for it.
    """
    total = sum(e.samples for e in experiments)
    if not are_short(experiments) or all(
        any(s.time.size == 1 for s in e.signals.values()) for e in experiments
    ):
        return False
    scores = []
    for rest in (True, False):
        problem, search = _search(make, experiments, find_starts, unknowns, held, request, rest)
        count = sum(search.best.local_counts) + len(problem.nonlinear)
        scores.append(total * np.log(max(search.best.cost, 1e-300)) + count * np.log(total))
    return bool(scores[0] <= scores[1])


def _vector(problem: Problem, start: Mapping[str, float]) -> FloatArray:
    return np.array([start[u.name] for u in problem.nonlinear])


def simulate_transfer(
    model: TransferModel, values: Values, offset: float | None = None
) -> list[Simulated]:
    """Outputs of all runs, offset by log and initial state by run fitted to their outputs.

    Runs without a recorded output start at rest, where the output is ``gain`` times the
    input's first value plus ``offset``.
    """
    parts = [model.response(i, values) for i in range(len(model.prepared))]
    if not model.measured:
        return [
            Simulated(known + level + (offset or 0.0), offset=offset or 0.0)
            for known, _, level in parts
        ]
    out: list[Simulated | None] = [None] * len(parts)
    owners = model.logs if model.common_offset else list(range(len(parts)))
    for owner in dict.fromkeys(owners):
        runs = [i for i, other in enumerate(owners) if other == owner]
        rest = [model.measured[i] - parts[i][0] for i in runs]
        level, fitted = _fit_offset(rest, [parts[i][1] for i in runs])
        for i, extra in zip(runs, fitted):
            out[i] = Simulated(parts[i][0] + extra, offset=level - parts[i][2])
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


def time_scales(experiments: Sequence[Experiment]) -> tuple[float, float]:
    """Shortest sample time and longest duration of the logs [s]."""
    return min(e.sample_time for e in experiments), max(float(np.ptp(e.time)) for e in experiments)


def dead_time_axis(step: float, longest: float, lag: float = 0.0) -> FloatArray:
    """Dead times to try [s]: at half samples while short, geometrically spaced when long.

    A plant with a slow ``lag`` [s] responds to a shift by a small share of it with a small
    change, so steps need not be finer than a third of it. Whole samples are avoided: the
    slope of the cost jumps there, and a search that starts on the wrong side stays.
    """
    out = [min(0.25 * step, longest)]
    while out[-1] < longest:
        width = 0.5 * step if out[-1] < 12.0 * step else 0.33 * out[-1]
        out.append(min(out[-1] + max(width, 0.3 * min(lag, longest)), longest))
    return np.array(out)
