"""Golden vectors: arguments, with what the Python model gives for them in double precision."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..experiment import FloatArray
from ..routines import Argument, Machine, Routine

_BEYOND = 0.2  # of a range: how far arguments go over its ends
_SEED = 20_260
_RESTS = 4  # calls for which what is held stays as it is


@dataclass(frozen=True)
class Golden:
    """Calls in order, the first after a reset.

    Attributes
    ----------
    arguments : (n, k)
        In the order of the routine [its units].
    outputs, outside : (n,)
        Output [its unit], and whether the flag is set. Where it is set by more than the
        clamping of an argument the output is not defined by the model.
    """

    arguments: FloatArray
    outputs: FloatArray
    outside: npt.NDArray[np.bool_]


def golden(
    routine: Routine,
    count: int = 24,
    rounded: Callable[[FloatArray], FloatArray] = np.asarray,
) -> Golden:
    """Return golden vectors: both ends of every range, zero, a step beyond, and the middle.

    Parameters
    ----------
    routine
        What is called; its states go on from call to call.
    count
        Number of calls.
    rounded
        Turns values ``(n,)`` into what the target's arithmetic holds, so that both get the
        same arguments.
    """
    rng = np.random.default_rng(_SEED)
    columns = [rounded(_column(a, count, rng)) for a in routine.arguments]
    arguments = np.column_stack(columns)
    machine = Machine(routine)
    names = [a.name for a in routine.arguments]
    calls = [machine(**dict(zip(names, row))) for row in arguments]
    return Golden(
        arguments,
        np.array([float(y) for y, _ in calls]),
        np.array([bool(out) for _, out in calls]),
    )


def _column(a: Argument, count: int, rng: np.random.Generator) -> FloatArray:
    """Values of an argument, ``(count,)``."""
    if a.held:
        values = _column(replace(a, held=False), -(-count // _RESTS), rng)
        return np.repeat(values, _RESTS)[:count]
    span = a.high - a.low
    values = a.low + span * rng.uniform(0.0, 1.0, count)
    if a.name == "direction":
        return rng.choice([-1.0, 1.0], count)
    ends = [a.low, a.high, np.clip(0.0, a.low, a.high)]
    far = [a.low - _BEYOND * span, a.high + _BEYOND * span]
    place = rng.permutation(count)[:5]
    values[place] = [*ends, *far][: len(place)]
    return values
