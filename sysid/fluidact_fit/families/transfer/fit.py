"""Output-error fits of small transfer functions: where they begin, and their stages."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ...errors import Notice
from ...estimation.input_noise import InputNoise, moving_inputs
from ...estimation.named_input_noise import correct_named
from ...estimation.named_model import NamedModel, bind
from ...estimation.noise import noise_floor
from ...estimation.parametric import DECIDED, DECISIVE, Fitted, fit_named, information_units
from ...estimation.price import exhausted
from ...estimation.problem import Problem, Unknown
from ...estimation.results import Refusal, refuse
from ...estimation.separable import Search, profile, solve_from
from ...estimation.uncertainty import middle_of
from ...estimation.whitening import Whitening
from ...experiment import Experiment, FloatArray
from ...family import FamilyOptions, ParameterSpec, Request
from ...units import after_number
from .model import answers_to_the_past, are_short

_MANY = 200_000  # samples beyond which the start is refined on a quarter of that first
_LONGER = 800_000  # samples of a closer start, where there are far more
_NEGLIGIBLE = 0.25  # standard errors that noise of the input may make without being allowed for
_VALLEYS = 4  # of a grid search, from which the fit begins
_RIVALS = 6  # places far from the best that are searched
_OTHER = 4.0  # standard errors by which a value is another one
_NEAR = 10.0  # times the best cost, within which a rival may be
_FAST = 0.8  # pole times sample time, up to which samples tell one frequency from another
Row = tuple[FloatArray, list[dict[str, float]], FloatArray]  # dead times, points and costs


def grid_search(
    problem: Problem,
    axes: Mapping[str, FloatArray],
    dead_times: Callable[[Mapping[str, float]], FloatArray],
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
        slow plant needs fewer.
    """
    order = [u.name for u in problem.nonlinear]
    if not order:  # everything but gains and offsets is fixed
        return [{}]
    outer = [n for n in order if n != "dead_time"]
    rows: dict[tuple[int, ...], Row] = {}
    for index in np.ndindex(*(len(axes[n]) for n in outer)):
        point = {n: float(axes[n][k]) for n, k in zip(outer, index)}
        inner = dead_times(point) if "dead_time" in order else np.zeros(1)
        points = [{**point, "dead_time": float(x)} for x in inner]
        costs = profile(problem, np.array([[p[n] for n in order] for p in points]))
        rows[index] = inner, points, costs
        if exhausted():
            break
    found = []
    for index, (_, points, costs) in rows.items():
        for k in np.flatnonzero(_valleys(rows, index)):
            found.append((float(costs[k]), {n: points[k][n] for n in order}))
    found.sort(key=lambda pair: pair[0])
    return [point for _, point in found[:_VALLEYS]]


def _valleys(rows: Mapping[tuple[int, ...], Row], index: tuple[int, ...]) -> npt.NDArray[np.bool_]:
    """Which points of one row of the grid are no worse than their neighbours."""
    inner, _, own = rows[index]
    around = np.concatenate(([np.inf], own, [np.inf]))
    valley = np.isfinite(own) & (own <= around[:-2]) & (own <= around[2:])
    for axis, k in enumerate(index):
        for other in (k - 1, k + 1):
            beside = rows.get((*index[:axis], other, *index[axis + 1 :]))
            if beside is not None:  # which has dead times of its own
                valley &= own <= np.interp(inner, beside[0], beside[2])
    return np.asarray(valley)


def dead_time_axis(step: float, longest: float, lag: float) -> FloatArray:
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


def unrecorded_time(
    experiments: Sequence[Experiment], output: str, values: Mapping[str, float], rest: bool
) -> float | None:
    """How long the output answers to an input before the run [s]; ``None`` where it is at rest.

    For as long as the dead time the output of a run follows an input that was not recorded. No
    initial state can stand for that, and where the output moves meanwhile, the fit has to leave
    it out: somewhat more than the dead time, which is not known exactly.
    """
    dead_time, step = values.get("dead_time", 0.0), min(e.sample_time for e in experiments)
    unrecorded = 1.1 * dead_time + 2.0 * step
    if rest or dead_time < 3.0 * step:
        return None
    for e in experiments:
        early = e[output][: answers_to_the_past(e, dead_time)]
        if early.size < 3 or any(s.time.size == 1 for s in e.signals.values()):
            continue
        noise = noise_floor(e[output][middle_of(e.samples)], 4)
        if np.var(early) > noise**2 * (1.0 + 6.0 * np.sqrt(2.0 / early.size)):
            return float(unrecorded)
    return None


@dataclass(frozen=True)
class TransferFit:
    """A staged fit: look for starts, refine them on an excerpt, then fit everything.

    Attributes
    ----------
    make
        ``make(experiments, rest)`` builds the model of some experiments; ``rest`` takes
        them all to start at rest.
    find_starts
        ``find_starts(experiments, rest)`` returns start values of the nonlinear
        parameters, best first; a ``--start`` wins.
    output
        Role of the output.
    sensible, idle, refusals
        As in :func:`.parametric.fit_named`; every refused parameter has a value to hold.
    elsewhere
        ``elsewhere(values)`` returns other values, far away, that may explain the samples too.
    fastest
        ``fastest(values)``: the largest pole of the model [rad/s].
    """

    make: Callable[[Sequence[Experiment], bool], NamedModel]
    find_starts: Callable[[Sequence[Experiment], bool], list[dict[str, float]]]
    experiments: Sequence[Experiment]
    output: str
    specs: Sequence[ParameterSpec]
    request: Request[FamilyOptions]
    unknowns: Mapping[str, Unknown]
    sensible: Mapping[str, float]
    idle: Mapping[str, float]
    refusals: Sequence[Refusal]
    elsewhere: Callable[[Mapping[str, float]], list[dict[str, float]]]
    fastest: Callable[[Mapping[str, float]], float]

    @property
    def _refused(self) -> dict[str, float]:
        """Values at which refused parameters are held."""
        return {r.parameter: float(r.hold or 0.0) for r in self.refusals}

    @property
    def _are_very_long(self) -> bool:
        """Whether a longer part than the first is still a small part of the logs."""
        return sum(e.samples for e in self.experiments) > 8 * _LONGER

    @property
    def _held(self) -> dict[str, float]:
        return {**self._refused, **self.request.fixed}

    def run(self, rest: bool | None) -> tuple[Fitted, bool]:
        """The fit, and whether the runs were taken to start at rest.

        ``rest`` says whether they do, where that is known.
        """
        few, held = _shorten(self.experiments, self.output), self._held
        self.request.progress("searching for a start")
        if rest is None:
            rest = self._starts_at_rest(few)
        problem, search = self._search(few, rest)
        search = self._look_elsewhere(problem, search)
        names = [u.name for u in problem.nonlinear]
        # some rivals are the best one again, not quite settled
        optima = _apart(np.array([s.eta for s in (search.best, *search.rivals)]))
        places = [{**held, **dict(zip(names, eta))} for eta in optima]
        ends = places[:3]
        part: NamedModel | None = None
        if sum(e.samples for e in self.experiments) > _MANY:
            part = self._part(_MANY // 4, rest)
            ends = self._closer(part, ends)
            if self.idle and self._are_very_long:
                # with edges in it the model is far from linear: from farther off, each step over
                # everything would be followed by others
                ends = self._closer(self._part(_LONGER, rest), ends)
        self.request.progress("fitting")
        model = self.make(self.experiments, rest)
        fitted = self._fit(model, ends, part)
        if self._are_very_long:
            part = self._part(_LONGER, rest)
        said, found, correct = self._look_for_input_noise(fitted, rest)
        end = correct(fitted) if correct else replace(fitted, notices=[*fitted.notices, *said])
        self._refuse_ambiguous(
            fitted, model, places, part, partial(_leads_to, end, fitted, correct)
        )
        tried = replace(end.search, tried=search.tried, agreeing=search.agreeing)
        return replace(end, search=tried, remarks=found), rest

    def _part(self, samples: int, rest: bool) -> NamedModel:
        """The model of part of the logs."""
        return self.make(_shorten(self.experiments, self.output, samples), rest)

    def _closer(
        self, part: NamedModel, starts: Sequence[Mapping[str, float]]
    ) -> list[dict[str, float]]:
        """The best that a part leads to from some starts."""
        problem = bind(part, self.unknowns, self._held)
        found = solve_from(problem, [_vector(problem, s) for s in starts], tolerance=1e-2)
        names = [u.name for u in problem.nonlinear]
        return [{**self._held, **dict(zip(names, found.best.eta))}]

    def _fit(
        self, model: NamedModel, starts: Sequence[Mapping[str, float]], part: NamedModel | None
    ) -> Fitted:
        return fit_named(
            model, self.specs, self.request, self.unknowns, starts,
            refusals=self.refusals, sensible=self.sensible, idle=self.idle, part=part,
        )  # fmt: skip

    def _search(self, experiments: Sequence[Experiment], rest: bool) -> tuple[Problem, Search]:
        """Solve roughly from every start."""
        problem = bind(self.make(experiments, rest), self.unknowns, self._held)
        starts = [{**s, **self.request.start} for s in self.find_starts(experiments, rest)]
        return problem, solve_from(problem, [_vector(problem, s) for s in starts], tolerance=1e-2)

    def _look_elsewhere(self, problem: Problem, search: Search) -> Search:
        """Search again where the family knows of rivals, as long as better ones are found there.

        The cost is looked at first: only what comes near the best is worth a search.
        """
        names = [u.name for u in problem.nonlinear]
        for _ in range(3):
            best = search.best
            values = {**self._held, **dict(zip(names, best.eta))}
            points = [p for p in self.elsewhere(values) if not set(p) & set(self._held)]
            if not points:
                return search
            starts = np.array([_vector(problem, {**values, **p}) for p in points])
            costs = profile(problem, starts)
            near = _apart(starts[np.argsort(costs)][: np.sum(costs < _NEAR * best.cost)])
            if not near:
                return search
            every = [best.eta, *(s.eta for s in search.rivals), *near]
            found = solve_from(problem, every, tolerance=1e-2)
            tried = search.tried + len(near)
            again = found.best.cost < best.cost * (1.0 - 1e-3)
            search = replace(found, tried=tried, agreeing=max(search.agreeing, found.agreeing))
            if not again:
                break
        return search

    def _refuse_ambiguous(
        self,
        fitted: Fitted,
        model: NamedModel,
        places: Sequence[Mapping[str, float]],
        part: NamedModel | None,
        is_the_same: Callable[[Mapping[str, float]], bool],
    ) -> None:
        """Refuse what has two values, far apart, that the data cannot tell from each other.

        ``places`` are where a rough search ended. A closer one may slide from there, along a
        valley that hardly falls, to the best: what they cost tells whether it does. Those that are
        out of the question on ``part`` of long logs need no look at the others. Nor do those that
        are the same end: noise of an input that is averaged between samples makes a dead time of
        half a sample look better, until it is allowed for.

        Raises
        ------
        NotIdentifiedError
            Naming both, and how much faster sampling has to be.
        """
        best = fitted.search.best
        names = [n for n in fitted.names if n in fitted.unknowns][: best.eta.size]
        unit = np.nanmedian(information_units(fitted.solution, fitted.covariance))
        step = min(e.sample_time for e in self.experiments)
        held = {n: v for n, v in fitted.values.items() if n in self.unknowns and n not in names}
        problem = bind(model, self.unknowns, held)
        errors = np.array([fitted.std_error(n) for n in names])
        points = [_vector(problem, {**p, **held}) for p in places]
        far = [eta for eta in points if np.any(np.abs(eta - best.eta) > _OTHER * errors)]
        if part is not None and far:
            some = bind(part.scaled(fitted.factors), self.unknowns, held)
            least, *others = profile(some, np.array([best.eta, *far]))
            far = [eta for eta, cost in zip(far, others) if cost - least < DECIDED * unit]
        rivals = [(s.eta, s.cost) for s in fitted.search.rivals]
        for eta, cost in [*rivals, *zip(far, profile(problem, np.array(far)))]:
            if cost - best.cost >= DECISIVE * unit:
                continue
            apart = [k for k in range(len(names)) if abs(eta[k] - best.eta[k]) > _OTHER * errors[k]]
            if not apart or is_the_same(dict(zip(names, eta))):
                continue
            # a value to fall back on is none where the data allow two others
            apart.sort(key=lambda k: fitted.specs[names[k]].neutral is not None)
            k = apart[0]
            spec = fitted.specs[names[k]]
            fast = max(
                self.fastest({**fitted.values, **dict(zip(names, at))}) for at in (best.eta, eta)
            )
            reason = (
                f"{best.eta[k]:.3g} and {eta[k]:.3g}{after_number(spec.unit)} explain these "
                "samples equally well"
            )
            if fast * step > _FAST:
                times = max(2, int(np.ceil(fast * step / _FAST)))
                reason += (
                    ", because the output has answered before the next sample is taken. Sample at "
                    f"least {times} times faster"
                )
            refuse(replace(spec, neutral=None), f"{reason}.")

    def _starts_at_rest(self, experiments: Sequence[Experiment]) -> bool:
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
            problem, search = self._search(experiments, rest)
            count = sum(search.best.local_counts) + len(problem.nonlinear)
            scores.append(total * np.log(max(search.best.cost, 1e-300)) + count * np.log(total))
        return bool(scores[0] <= scores[1])

    def _look_for_input_noise(
        self, fitted: Fitted, rest: bool
    ) -> tuple[list[Notice], dict[str, Any], Callable[[Fitted], Fitted] | None]:
        """What is to be said of the noise of a measured input, and what corrects a fit for it.

        Nothing does where it does not matter, or cannot be allowed for.
        """
        experiments = self.experiments
        rows, roles = sum(e.samples for e in experiments), moving_inputs(experiments)
        if not roles or not fitted.names:
            return [], {}, None
        role, seed = roles[0], self.request.seed
        given = self.request.noise.get(role)
        if rows > _MANY or rows < 200 * len(experiments):
            said = [_not_allowed_for(role)] if given else []
            return said, {}, None

        def build(
            held: Mapping[str, float], some: Sequence[Experiment], white: Sequence[Whitening]
        ) -> Problem:
            model = replace(self.make(some, rest).without_linear(), whiten=white)
            return bind(model, self.unknowns, held)

        if given is None:
            noise = InputNoise.seen(experiments, role, seed)
        else:
            noise = InputNoise(experiments, role, given, seed=seed)
        unit = experiments[0].signals[role].unit
        held = {**self._refused, **{n: r.value(fitted.specs[n]) for n, r in fitted.refused.items()}}
        at_hand = partial(build, {**held, **self.request.fixed})
        names = [u.name for u in at_hand(experiments, ()).nonlinear]
        eta = np.array([fitted.values[n] for n in names])
        errors = np.array([fitted.std_error(n) for n in names])
        found: dict[str, Any] = {"role": noise.role, "sigma": noise.sigma, "unit": unit}
        if noise.sigma == 0.0 or noise.effect(at_hand, eta, errors) < _NEGLIGIBLE:
            return [], {"input_noise": found}, None
        if given is None:
            noise = noise.supported(at_hand, eta)
            found["sigma"] = noise.sigma
        if noise.sigma == 0.0:
            return [], {"input_noise": found}, None
        found["treatment"] = "residual whitened, score corrected"

        def correct(plain: Fitted) -> Fitted:
            self.request.progress("allowing for the noise of the input")
            return correct_named(
                noise, build, plain, refusals=self.refusals, sensible=self.sensible
            )

        return [], {"input_noise": found}, correct


def _leads_to(
    end: Fitted,
    plain: Fitted,
    correct: Callable[[Fitted], Fitted] | None,
    rival: Mapping[str, float],
) -> bool:
    """Whether a rival of a plain fit comes to the same end once noise is allowed for."""
    if correct is None:
        return False
    other = correct(replace(plain, values={**plain.values, **rival}))
    return end.names == other.names and all(
        abs(end.values[n] - other.values[n]) <= end.std_error(n) for n in end.names
    )


def _not_allowed_for(role: str) -> Notice:
    return Notice(
        "input-noise-left",
        f"the noise of '{role}' given with --noise could not be allowed for: that takes at least "
        f"200 samples a run, and {_MANY} at most in all. Record longer runs, or cut the log with "
        "--window.",
    )


def _apart(points: FloatArray) -> list[FloatArray]:
    """The first few of points, best first, that are not close to one another."""
    out: list[FloatArray] = []
    for point in points:
        if not any(np.all(np.abs(point - p) <= 0.15 * np.abs(p)) for p in out):
            out.append(point)
    return out[:_RIVALS]


def _vector(problem: Problem, start: Mapping[str, float]) -> FloatArray:
    return np.array([start[u.name] for u in problem.nonlinear])


def _shorten(
    experiments: Sequence[Experiment], output: str, samples: int = 1500
) -> list[Experiment]:
    """The most eventful parts of the logs, for starting searches.

    Searching for a start on a million samples or a hundred runs costs minutes and buys
    nothing: the full fit that follows uses them all.
    """
    lively = sorted(experiments, key=lambda e: -float(np.ptp(e[output])))
    taken: list[Experiment] = []
    for e in lively:
        if len(taken) >= 2 and sum(t.samples for t in taken) >= samples:
            break
        taken.append(_liveliest_part(e, output, samples))
        if len(taken) >= 24:
            break
    return taken


def _liveliest_part(experiment: Experiment, output: str, samples: int) -> Experiment:
    n = experiment.samples
    if n <= samples:
        return experiment
    begins = np.unique(np.linspace(0, n - samples, 12).astype(int))
    y = experiment[output]
    begin = int(max(begins, key=lambda b: float(np.std(y[b : b + samples]))))
    part = slice(begin, begin + samples)
    signals = {}
    for role, s in experiment.signals.items():
        if s.time is experiment.time or s.values.size == n:
            signals[role] = replace(
                s, time=s.time[part], values=s.values[part], before=float(s.values[begin])
            )
        else:
            signals[role] = s
    return replace(experiment, time=experiment.time[part], signals=signals)
