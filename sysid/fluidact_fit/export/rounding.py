"""Error of single-precision code against the model, measured when the file is made.

The routine is run in single precision, operation by operation as the C code does it, beside double
precision: for a static one at :data:`DRAWS` arguments, for one that keeps something in sequences
of :data:`CALLS` calls. What is stated is :data:`MARGIN` times the largest difference found, twice
that of sequences, for arguments that were not drawn and for C libraries and compilers that round
otherwise. An interval
analysis holds with certainty and is 100 to 6,000 times too large, because it adds up what cancels.

Where the equation itself jumps, the side that is taken within rounding of the edge is decided by
rounding: how high those jumps are is found by taking the other side of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from ..experiment import FloatArray
from ..routines import Routine
from ..routines.evaluate import DOUBLE, SINGLE, Arithmetic
from ..routines.expression import Choose, choose
from ..routines.statements import Flag, Let
from .excitation import edges, hurried, run, sequences, uniform

UNIT = 2.0**-24
CALLS = 1000  # from a reset, for a routine whose error can grow from call to call
MARGIN = 3.0
MARGIN_OF_SEQUENCES = 2.0  # every one of them is the largest of many calls
DRAWS = 200_000
_SEQUENCES = 256
_PROBE = 400  # rows among which edges are looked for
_MOST_JUMPS = 6
_SEED = 20_261
_CLEAR = 16.0  # times what rounding moves a side of a comparison, for other compilers


@dataclass(frozen=True)
class Error:
    """Differences from the model in double precision [unit of the output].

    Attributes
    ----------
    rounding
        Largest one where all jumps are taken as the model takes them, with the margin.
    jump
        Largest one where rounding decides at the edge of a jump; 0 without jumps.
    """

    rounding: float
    jump: float

    @property
    def total(self) -> float:
        """Bound of both together."""
        return self.rounding + self.jump


def single(values: FloatArray) -> FloatArray:
    """Nearest numbers of single precision, in double precision."""
    with np.errstate(over="ignore"):
        return np.asarray(values, dtype=np.float32).astype(float)


def inward(routine: Routine) -> Routine:
    """The routine with ranges of its arguments that single precision holds, just inside."""
    arguments = []
    for a in routine.arguments:
        low, high = np.float32(a.low), np.float32(a.high)
        low = np.nextafter(low, np.float32(np.inf)) if float(low) < a.low else low
        high = np.nextafter(high, np.float32(-np.inf)) if float(high) > a.high else high
        arguments.append(replace(a, low=float(low), high=float(high)))
    return replace(routine, arguments=tuple(arguments))


def error_of(routine: Routine) -> Error:
    """Measure the error of single-precision code within the ranges.

    Parameters
    ----------
    routine
        With ranges that single precision holds, see :func:`inward`.
    """
    routine = hurried(routine)  # so that something comes out within the calls
    arguments = single(_arguments(routine))
    return Error(difference(routine, arguments), _jump(routine, arguments))


def difference(routine: Routine, arguments: FloatArray) -> float:
    """Largest error over sequences of calls, with the margin; jumps as the model takes them.

    Infinite where single precision cannot hold what is computed.
    """
    exact, computed, agree = both(routine, arguments)
    off = np.abs(computed - exact)[agree]
    if not np.all(np.isfinite(off)):
        return float("inf")
    # the last rounding of the output, which the few that were drawn need not have had
    margin = MARGIN_OF_SEQUENCES if len(arguments) >= CALLS else MARGIN
    return margin * float(off.max(initial=0.0)) + UNIT * float(np.abs(exact).max(initial=0.0))


def both(routine: Routine, arguments: FloatArray) -> tuple[FloatArray, FloatArray, Any]:
    """Outputs in double and in single precision, and where both took the same side of all jumps.

    ``arguments`` has the shape ``(calls, count, k)``, the others ``(calls, count)``.
    """
    sides: list[Any] = []

    def note(e: Choose, a: Any, b: Any, holds: Any) -> Any:
        del a, b
        if e.jumps:
            sides.append(holds)
        return holds

    exact, _ = run(routine, arguments, replace(DOUBLE, decide=note))
    taken, sides[:] = list(sides), []
    computed, _ = run(routine, arguments, replace(SINGLE, decide=note))
    shape = arguments.shape[:2]
    if not taken:
        return exact, computed, np.ones(shape, dtype=bool)
    each = len(taken) // shape[0]
    same = [np.broadcast_to(np.equal(p, q), shape[1:]) for p, q in zip(taken, sides)]
    agree = np.array(same).reshape(shape[0], each, -1).all(axis=1)
    return exact, computed, np.logical_and.accumulate(agree, axis=0)


def robust(routine: Routine, arguments: FloatArray, least: float = 1e-4) -> Any:
    """Sequences in which no jump and no flag is decided by rounding; shape ``(count,)``.

    ``least`` is how far both sides have to differ, relative to the larger one; where numbers that
    nearly cancel stand on a side, rounding moves it by more, and so far as well.
    """
    body = [_as_jump(s) if isinstance(s, Flag) else s for s in routine.body]
    routine = replace(routine, body=tuple(body))
    margins: list[tuple[Any, Any]] = []

    def note(e: Choose, a: Any, b: Any, holds: Any) -> Any:
        if e.jumps:
            margins.append((np.subtract(a, b, dtype=float), np.maximum(np.abs(a), np.abs(b))))
        return holds

    run(routine, arguments, replace(DOUBLE, decide=note))
    exact, margins[:] = list(margins), []
    run(routine, arguments, replace(SINGLE, decide=note))
    fine = np.ones(arguments.shape[1], dtype=bool)
    for (apart, size), (rounded, _) in zip(exact, margins):
        moved = np.abs(rounded - apart)
        usual = float(np.median(moved[np.isfinite(moved)])) if np.isfinite(moved).any() else 0.0
        enough = np.maximum(least * size, _CLEAR * np.maximum(moved, usual))
        fine &= (np.abs(apart) > enough) | (size == 0.0)
    return fine


def _as_jump(flag: Flag) -> Let:
    """A flag as a choice, which can be watched; its name can be that of no other statement."""
    return Let(f"{id(flag)}", choose(flag.a, "<", flag.b, 1.0, 0.0, jumps=True))


def _arguments(routine: Routine) -> FloatArray:
    """Draw arguments, shape ``(calls, count, k)``."""
    rng = np.random.default_rng(_SEED)
    near = edges(routine, uniform(routine, _PROBE, rng))
    if routine.keeps:
        return sequences(routine, CALLS, _SEQUENCES, rng, near)
    return np.concatenate([uniform(routine, DRAWS, rng), near])[None]


def _jump(routine: Routine, arguments: FloatArray) -> float:
    """Largest change of the output where jumps are taken the other way, in all combinations."""
    few = arguments[:200, :: max(arguments.shape[1] // 2000, 1)]
    jumps: list[Choose] = []

    def note(e: Choose, a: Any, b: Any, holds: Any) -> Any:
        del a, b
        if e.jumps and e not in jumps:
            jumps.append(e)
        return holds

    exact, _ = run(routine, few, replace(DOUBLE, decide=note))
    found = [np.abs(run(routine, few, turned)[0] - exact).max() for turned in _turned(jumps)]
    return float(max(found, default=0.0))


def _turned(jumps: list[Choose]) -> Iterator[Arithmetic]:
    for turn in product((False, True), repeat=min(len(jumps), _MOST_JUMPS)):
        others = [e for e, other in zip(jumps, turn) if other]
        if others:

            def decide(e: Choose, a: Any, b: Any, holds: Any, others: Any = others) -> Any:
                del a, b
                return np.logical_not(holds) if e in others else holds

            yield replace(DOUBLE, decide=decide)
