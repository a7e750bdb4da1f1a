"""Initial conditions of the runs of a response: rest or any state, unrecorded input, offset.

See ``docs/theory/responses.md``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ..errors import Notice
from ..experiment import Experiment, FloatArray, Signal
from ..rows import middle_of
from ..units import after_number, as_time
from .named_model import NamedModel, bind
from .noise import noise_floor
from .parametric import Fitted
from .problem import Basis
from .response_model import Beginning, ResponseTask, T, are_short
from .separable import solve, solve_from
from .significance import CERTAIN
from .starts import time_scales

_RESTING = 8  # first samples that show whether an input was at rest before
_MARGIN = 2.0  # samples more than a dead time covers that are left out
_AT_REST = 0.1  # share of the usual change of an input between samples that counts as rest
_LONG_ENOUGH = 1000  # samples that show the usual change
_EARLIER = (1.0, 0.7, 0.4)  # shares of a dead time at which a fit without offset is begun


def choose_beginning(task: ResponseTask[T], few: Sequence[Experiment]) -> Beginning:
    """Return the initial conditions that the user gave, or those that an excerpt shows."""
    options = task.request.options
    begin = options.beginning
    if options.offset != "none" and options.offset_of is None:
        begin = replace(begin, offset=task.owner)
    if options.start_state is None:
        # a lone sample of an input is a step that was not recorded: it was at rest before
        stepped = all(any(s.time.size == 1 for s in e.signals.values()) for e in task.experiments)
        rest = stepped or _starts_at_rest(task, few, begin)
        begin = replace(begin, rest=rest)
    return begin


def _starts_at_rest(task: ResponseTask[T], few: Sequence[Experiment], begin: Beginning) -> bool:
    """Return whether runs are short and the Bayes criterion prefers a start from rest."""
    role = task.variant.driving[0].name
    if not are_short(few) or not all(_may_rest(e.signals[role]) for e in few):
        return False
    scores = []
    for rest in (True, False):
        own = replace(begin, rest=rest)
        problem = task.problem(few, own)
        search = task.search(problem, task.starts(few, own))
        count = sum(search.best.local_counts) + len(problem.nonlinear)
        rows = problem.rows
        scores.append(rows * np.log(max(search.best.cost, 1e-300)) + count * np.log(rows))
    return bool(scores[0] <= scores[1])


def unrecorded_time(
    task: ResponseTask[T],
    experiments: Sequence[Experiment],
    begin: Beginning,
    values: Mapping[str, float],
) -> float:
    """Duration of the response to an input before the runs, with a margin [s]; 0 from rest."""
    dead_time, step = values.get("dead_time", 0.0), time_scales(experiments)[0]
    given = task.request.options.unrecorded
    if given is not None or begin.rest or not dead_time or dead_time < begin.unrecorded:
        return begin.unrecorded
    role = task.variant.driving[0].name
    quiet = all(
        e.signals[role].time.size == 1
        or (_is_quiet(e[role], _RESTING) and _stays_quiet(e, task.output, role, dead_time))
        for e in experiments
    )
    return begin.unrecorded if quiet else 1.1 * dead_time + _MARGIN * step


def unrecorded_notice(task: ResponseTask[T], begin: Beginning) -> Iterator[Notice]:
    """Report the part of the runs that responds to earlier inputs and was left out."""
    if not begin.unrecorded:
        return
    runs = task.experiments
    left = sum(int(np.sum(e.time - e.time[0] < begin.unrecorded)) for e in runs)
    yield Notice(
        "beginning-left-out",
        f"the first {as_time(begin.unrecorded)} of every run ({left} of "
        f"{sum(e.samples for e in runs)} samples) answer to an input before the log began, and "
        "were left out. Begin recording at rest; if the logs do, give --start-state rest.",
    )


def cut_unrecorded(
    task: ResponseTask[T],
    few: Sequence[Experiment],
    begin: Beginning,
    places: list[dict[str, float]],
) -> tuple[Beginning, list[dict[str, float]]]:
    """Order places by how well they describe the excerpt, each without its unrecorded time.

    Samples that a place leaves out count with the variance of the output.
    """
    begins = [replace(begin, unrecorded=unrecorded_time(task, few, begin, p)) for p in places]
    if all(b == begin for b in begins):
        return begin, places
    rows = sum(e[task.output].size for e in few)
    least = np.finfo(float).tiny  # power of an output that never moves
    power = sum(e[task.output].size * float(np.var(e[task.output])) for e in few) / rows
    found = []
    for place, own in zip(places, begins):
        problem = task.problem(few, own)
        best = solve(problem, problem.vector(place), tolerance=1e-2)
        left = rows - problem.rows
        length = problem.rows * np.log(max(best.cost / problem.rows, least))
        length += left * np.log(max(power, least))
        found.append((length, own, task.values(problem, best.eta)))
    found.sort(key=lambda x: x[0])
    # rivals that differ by less than the margin are compared on the same samples
    most = found[0][1].unrecorded + _MARGIN * time_scales(task.experiments)[0]
    kept = [(own, p) for _, own, p in found if own.unrecorded <= most]
    return max((own for own, _ in kept), key=lambda own: own.unrecorded), [p for _, p in kept]


def examine_offset(
    task: ResponseTask[T], fitted: Fitted, model: NamedModel, begin: Beginning
) -> tuple[Beginning, dict[str, float], list[Notice]]:
    """Compare the fit with one without its offset, or with one where it has none.

    Returns
    -------
    The initial conditions, the values of that fit, and a warning where the choice matters.
    """
    if not task.model.gain or not begin.rest:
        return begin, dict(fitted.values), []
    other = replace(begin, offset=task.owner if begin.offset == "none" else "none")
    held = {n: v for n, v in fitted.values.items() if n not in fitted.names}
    problem = bind(task.named(task.experiments, other), task.unknowns, held)
    late = fitted.values.get("dead_time", 0.0)  # between samples the cost has a valley each
    starts = [{**fitted.values, "dead_time": share * late} for share in _EARLIER]
    found = solve_from(problem, [problem.vector(x) for x in starts], tolerance=1e-3).best
    every = problem.named((*found.eta, *found.linear))
    values = {n: v for n, v in every.items() if n in fitted.names}
    moved = [n for n in values if abs(values[n] - fitted.values[n]) > fitted.half_width(n)]
    quiet = [_before_response(model.columns(k, fitted.values)) & _before_response(
             model.columns(k, {**fitted.values, **values}))
             for k in range(len(task.experiments))]  # fmt: skip
    now, error = _level(fitted.solution.residuals, quiet)
    then, its = _level(found.residuals, quiet)
    if not moved or not np.isfinite(error) or abs(then) > max(CERTAIN * its, abs(now)):
        return begin, dict(fitted.values), []
    better = abs(now) > CERTAIN * error and abs(then) < 0.5 * abs(now)
    switched = task.request.options.offset is None and other.offset == "none" and better
    most = max(moved, key=lambda n: abs(values[n] - fitted.values[n]) / fitted.half_width(n))
    unit = after_number(fitted.specs[most].unit)
    with_it, without = values[most], fitted.values[most]
    if other.offset == "none":
        with_it, without = without, with_it
    notice = Notice(
        "offset-matters",
        f"{most} is {with_it:.3g}{unit} with an offset of the output and {without:.3g} without "
        "one, further apart than its interval. What the runs show before they respond "
        f"{'speaks against' if better else 'does not exclude'} the other: check the zero of "
        "the sensors, and choose with --offset none or --offset free.",
    )
    return (other, {**fitted.values, **values}, [notice]) if switched else (
        begin, dict(fitted.values), [notice])  # fmt: skip


def _before_response(basis: Basis) -> npt.NDArray[np.bool_]:
    """Mask of the samples of a run at rest before its response, shape ``(n,)``."""
    response = basis.shared[0]
    return np.cumsum(np.abs(np.diff(response, prepend=response[0]))) == 0.0


def _level(
    residuals: Sequence[FloatArray], where: Sequence[npt.NDArray[np.bool_]]
) -> tuple[float, float]:
    """Mean of some residuals and its standard error, infinite of fewer than three."""
    values = np.concatenate([r[k] for r, k in zip(residuals, where, strict=True)])
    if values.size < 3:
        return 0.0, np.inf
    return float(values.mean()), float(values.std(ddof=1)) / np.sqrt(values.size)


def _stays_quiet(experiment: Experiment, output: str, role: str, dead_time: float) -> bool:
    """Return whether an output is quiet for the dead time and half as long as its input rests.

    Of an input that stepped just before its first sample the output shows it once the dead time is
    over.
    """
    values, time = experiment[role], experiment.time - experiment.time[0]
    noise = noise_floor(values[middle_of(values.size)], 4)
    moved = np.abs(values - np.mean(values[:_RESTING])) > 5.0 * noise
    rest = time[int(np.argmax(moved))] if moved.any() else time[-1]
    return _is_quiet(experiment[output], int(np.sum(time < dead_time + 0.5 * rest)))


def _is_quiet(values: FloatArray, count: int) -> bool:
    """Return whether the first ``count`` values show only noise; fewer than three count as quiet.

    They must neither scatter more than the noise nor lie on a slope.
    """
    early = values[:count]
    if early.size < 3:
        return True
    noise = noise_floor(values[middle_of(values.size)], 4)
    t = np.linspace(-1.0, 1.0, early.size)
    slope = float(t @ early) / np.sqrt(float(t @ t))
    allowed = 1.0 + 6.0 * np.sqrt(2.0 / early.size)
    return bool(np.var(early) <= noise**2 * allowed and abs(slope) <= 3.0 * noise)


def _may_rest(signal: Signal) -> bool:
    """Return whether an input may have been at rest before its first sample.

    It does not move there yet, or is held and may have stepped at any of its samples.
    """
    change = np.abs(np.diff(signal.values[:_LONG_ENOUGH]))
    if signal.hold == "zoh" or change.size < 2:
        return True
    return bool(change[0] <= _AT_REST * np.median(change) + 3.0 * noise_floor(signal.values, 4))
