"""Starts of a search: an excerpt of the logs, and the valleys of its cost over a grid."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ..experiment import Experiment, FloatArray
from .budget import exhausted
from .problem import Problem
from .separable import profile

_BURST = 8  # consecutive samples of an excerpt
_VALLEYS = 4  # of a grid search, from which a fit begins
Row = tuple[FloatArray, list[dict[str, float]], FloatArray]  # dead times, points and costs


def time_scales(experiments: Sequence[Experiment]) -> tuple[float, float]:
    """Shortest sample time and longest duration of the logs [s]."""
    return min(e.sample_time for e in experiments), max(
        float(e.time[-1] - e.time[0]) for e in experiments
    )


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
    order = problem.names
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
    """Mask of the points in one row of the grid that are no worse than their neighbours."""
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


def excerpt(
    experiments: Sequence[Experiment], output: str, samples: int, reach: int = 1
) -> list[Experiment]:
    """Return the most eventful parts of the logs, for starting searches.

    Searching for a start on a million samples or a hundred runs takes minutes and gains nothing:
    the full fit that follows uses them all. Bursts of samples are taken all along parts that are
    ``reach`` times as long: dead times may be far longer than a burst.
    """
    lively = sorted(experiments, key=lambda e: -float(np.ptp(e[output])))
    taken: list[Experiment] = []
    for e in lively:
        if len(taken) >= 2 and sum(t.samples for t in taken) >= samples:
            break
        taken.append(_in_bursts(_liveliest_part(e, output, samples * reach), samples))
        if len(taken) >= 24:
            break
    return taken


def _in_bursts(experiment: Experiment, samples: int) -> Experiment:
    """The run with bursts of about so many samples of its output, and all of its inputs."""
    every = -(-experiment.samples // samples)
    if every < 2:
        return experiment
    kept = np.flatnonzero(np.arange(experiment.samples) // _BURST % every == 0)
    time, signals = experiment.time[kept], dict(experiment.signals)
    for role, s in signals.items():
        if s.hold is None:
            signals[role] = replace(s, time=time, values=s.values[kept])
    return replace(experiment, time=time, signals=signals, uniform=False)


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
