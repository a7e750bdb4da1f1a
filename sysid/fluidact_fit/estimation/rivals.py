"""Rivals of a fit: other values, far from the best, that explain the logs as well.

See ``docs/theory/responses.md``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..units import after_number
from .named_model import NamedModel, bind
from .parametric import Fitted, cost_units
from .response_model import ResponseTask, T
from .results import undetermined_error
from .separable import profile
from .significance import CERTAIN, DECISIVE
from .starts import time_scales
from .uncertainty import widen_by

Correct = Callable[[Fitted], Fitted] | None

_FAST = 0.8  # pole times sample time up to which samples distinguish frequencies
_SIMILAR = 0.1  # relative distance up to which two optima share one wide interval


def judge_rivals(
    task: ResponseTask[T], end: Fitted, fitted: Fitted, model: NamedModel,
    places: Sequence[Mapping[str, float]], correct: Correct,
) -> Fitted:  # fmt: skip
    """Refuse a parameter with two distant values that the data cannot distinguish.

    Values near each other share one wide interval; those that ``correct``, which allows for noise
    of an input, takes to the same estimate count as one. ``places`` are the ends of a rough search.

    Raises
    ------
    NotIdentifiedError
        Naming both, and how much faster sampling has to be.
    """
    best = fitted.search.best
    names = [n for n in fitted.names if n in fitted.unknowns][: best.eta.size]
    unit = np.nanmedian(cost_units(fitted.solution, fitted.covariance))
    held = {n: v for n, v in fitted.values.items() if n in task.unknowns and n not in names}
    problem = bind(model, task.unknowns, held)
    errors = np.array([fitted.std_error(n) for n in names])
    points = [problem.vector({**p, **held}) for p in places]
    far = [eta for eta in points if np.any(np.abs(eta - best.eta) > CERTAIN * errors)]
    rivals = [(s.eta, s.cost) for s in fitted.search.rivals]
    for eta, cost in [*rivals, *zip(far, profile(problem, np.array(far)))]:
        if cost - best.cost >= DECISIVE * unit:
            continue
        change = eta - best.eta
        apart = [k for k in range(len(names)) if abs(change[k]) > CERTAIN * errors[k]]
        if not apart or _leads_to(end, fitted, correct, dict(zip(names, eta))):
            continue
        if all(abs(change[k]) <= _SIMILAR * abs(best.eta[k]) for k in apart):
            end = _widened(end, dict(zip(names, change.tolist())))
            continue
        _refuse(task, fitted, apart, dict(zip(names, eta)))
    return end


def _refuse(
    task: ResponseTask[T], fitted: Fitted, apart: list[int], rival: Mapping[str, float]
) -> None:
    """Refuse one of the parameters, of indices ``apart``, in which two equally good fits differ."""
    names = list(rival)
    # a neutral value cannot be written where the data allow two others
    apart.sort(key=lambda k: fitted.specs[names[k]].neutral is not None)
    name = names[apart[0]]
    spec, step = fitted.specs[name], time_scales(task.experiments)[0]
    fast = step * max(task.model.fastest({**fitted.values, **at}) for at in (fitted.values, rival))
    reason = (
        f"{fitted.values[name]:.3g} and {rival[name]:.3g}{after_number(spec.unit)} explain "
        "these samples equally well"
    )
    if fast > _FAST:
        reason += (
            ", because the output has answered before the next sample is taken. Sample at "
            f"least {max(2, int(np.ceil(fast / _FAST)))} times faster"
        )
    raise undetermined_error(spec, f"{reason}.")


def _widened(fitted: Fitted, change: Mapping[str, float]) -> Fitted:
    """Return the fit with errors that cover a change of its values, either way."""
    d = np.array([change.get(n, 0.0) for n in fitted.names])
    intervals = {n: x for n, x in fitted.intervals.items() if n not in change}
    return replace(fitted, covariance=widen_by(fitted.covariance, d), intervals=intervals)


def _leads_to(end: Fitted, plain: Fitted, correct: Correct, rival: Mapping[str, float]) -> bool:
    """Return whether a rival leads to the same estimate once input noise is allowed for."""
    if correct is None:
        return False
    other = correct(replace(plain, values={**plain.values, **rival}))
    return end.names == other.names and all(
        abs(end.values[n] - other.values[n]) <= end.std_error(n) for n in end.names
    )
