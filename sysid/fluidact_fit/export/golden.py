"""Golden vectors: arguments, with what the Python model gives for them in double precision.

They are chosen among many so that every constant of the routine shows: with any of them changed
by one per cent the output is off by more than the self-test allows, or the flag is another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..experiment import FloatArray
from ..routines import Argument, Routine
from .excitation import (
    Rounded,
    dead_time,
    edge_sequences,
    edges,
    edges_at_rest,
    ends,
    hurried,
    run,
    sequences,
    uniform,
)
from .mutants import Mutant, mutants_of
from .rounding import robust

Tolerance = Callable[[Routine, FloatArray], float]

_SEED = 20_260
_PROBE = 400  # among which edges are looked for
_TRIES = 3  # places at which ends of ranges are looked at
_POOL = 2000  # arguments to choose from
_SEQUENCES = 64  # or sequences
_MORE = 2000  # sequences among which what no other shows is looked for
_RARE = 20  # of them are taken for each
_CALLS = 24  # of a sequence, beside what a dead time takes
_INTERRUPTED = 24  # of them, of a careful routine, by a call with nothing to compute from
_PLAIN = 6  # vectors of a static routine that are drawn whatever they show
_CLEAR = 2.5  # times the tolerance: how far a changed constant has to move the output
_MOST = 80  # vectors, or
_MOST_SEQUENCES = 10
_BESIDE = 2.0**-22  # of an end: what lies beyond it and is told from it
_FAR = 0.2  # of a range


@dataclass(frozen=True)
class Golden:
    """Calls in order.

    Attributes
    ----------
    arguments : (n, k)
        In the order of the routine [its units].
    outputs, outside : (n,)
        Output [its unit], and whether the flag is set. Where it is set by more than the
        clamping of an argument the output is not defined by the model.
    length
        Calls from one reset to the next; the first is one.
    tolerance
        What outputs may differ by [unit of the output].
    """

    arguments: FloatArray
    outputs: FloatArray
    outside: npt.NDArray[np.bool_]
    length: int
    tolerance: float


def golden(
    routine: Routine, tolerance: Tolerance, rounded: Rounded = np.asarray, *, nan: bool = False
) -> Golden:
    """Choose golden vectors.

    Parameters
    ----------
    routine
        What is called.
    tolerance
        Gives what an output may differ by, for arguments ``(calls, count, k)``.
    rounded
        Turns values into what the target's arithmetic holds, so that both get the same arguments.
    nan
        Whether the target can write what is not a number. A careful routine gets it as well.
    """
    rng, quick = np.random.default_rng(_SEED), hurried(routine)
    pool, count = _pool(quick, rng, rounded, nan)
    fine = _usable(quick, pool)
    pool, wanted = pool[:, fine], int(fine[:count].sum())
    allowed = tolerance(quick, pool)
    if routine.keeps and (more := _rare(quick, pool, allowed, rng, rounded)).size:
        pool = np.concatenate([pool, more], axis=1)
        allowed = max(allowed, tolerance(quick, more))
    chosen = pool[:, _chosen(quick, pool, allowed, wanted)]
    rest = dead_time(routine) - dead_time(quick)
    if rest:  # until the last output has come
        chosen = np.concatenate([chosen, np.repeat(chosen[-1:], rest, axis=0)])
        chosen = chosen[:, _usable(routine, chosen)]
        allowed = max(allowed, tolerance(routine, chosen))
    in_order = (x.swapaxes(0, 1) for x in (chosen, *run(routine, chosen)))
    arguments, values, flags = (x.reshape(-1, *x.shape[2:]) for x in in_order)
    return Golden(arguments, values, flags.astype(bool), len(chosen), allowed)


def _usable(routine: Routine, pool: FloatArray) -> Any:
    """Sequences of numbers of which rounding decides nothing; all, if there are none."""
    fine = robust(routine, pool) & np.isfinite(run(routine, pool)[0]).all(axis=0)
    return fine if fine.any() else ~fine


def _pool(
    routine: Routine, rng: np.random.Generator, rounded: Rounded, nan: bool
) -> tuple[FloatArray, int]:
    """Return the candidates, ``(calls, count, k)``, and how many of the first are always taken."""
    plain = uniform(routine, _POOL, rng)
    at_ends, some = _ends(routine, rng, 1), plain[:_PROBE]
    near = np.concatenate([edges(routine, some), edges_at_rest(routine, some)])
    if not routine.keeps:
        more = _ends(routine, rng, _TRIES)
        rows = np.concatenate([at_ends, plain[:_PLAIN], more, near, plain[_PLAIN:]])
        return rounded(rows)[None], len(at_ends) + _PLAIN
    if routine.careful and nan:
        at_ends = _with_nan(at_ends, rng)
    late = dead_time(routine)
    calls = max(_CALLS + late + late // 2, len(at_ends) + late + 4)
    found = sequences(routine, calls, _SEQUENCES, rng, near)
    found[1 : 1 + len(at_ends), 0] = at_ends
    found[: len(at_ends), 1] = at_ends[::-1]  # begins where there may be nothing to compute from
    if routine.careful:
        for s in range(2, 2 + _INTERRUPTED):
            found[rng.integers(1, calls - 1), s] = at_ends[-1]
    late_edges = edge_sequences(routine, found[:, 1:], rng)
    return rounded(np.concatenate([found, late_edges], axis=1)), 1


def _rare(
    routine: Routine, pool: FloatArray, allowed: float, rng: np.random.Generator, rounded: Rounded
) -> FloatArray:
    """Sequences that show what none of the pool does, such as a speed that only a jump tells of.

    Where the output rests at a limit most of the time, few of all sequences show it.
    """
    hidden = [m for m, s in zip(mutants_of(routine), _shows(routine, pool, allowed)) if not s.any()]
    if not hidden:
        return pool[:, :0]
    more = rounded(sequences(routine, len(pool), _MORE, rng, pool[:0, 0]))
    seen = _shows(routine, more, allowed, hidden)
    places = np.unique([k for s in seen for k in np.flatnonzero(s)[:_RARE]]).astype(int)
    more = more[:, places]
    if not places.size:
        return more
    fine = robust(routine, more) & np.isfinite(run(routine, more)[0]).all(axis=0)
    return more[:, fine]


def _with_nan(rows: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The rows, and one more for each argument, which is no number there."""
    more = rows[rng.choice(len(rows), rows.shape[1])]
    np.fill_diagonal(more, np.nan)
    return np.concatenate([rows, more])


def _ends(routine: Routine, rng: np.random.Generator, tries: int) -> FloatArray:
    """Both ends of every range and what lies just beyond them, and all far beyond."""

    def beyond(a: Argument, end: float, way: float) -> tuple[float, float]:
        return end, end + way * max(abs(end) * _BESIDE, (a.high - a.low) * _BESIDE * 1e-3)

    low, high = (np.array([getattr(a, e) for a in routine.arguments]) for e in ("low", "high"))
    far = _FAR * (high - low)
    return np.vstack([ends(routine, beyond, tries, rng), low - far, high + far])


def _chosen(routine: Routine, pool: FloatArray, allowed: float, wanted: int) -> list[int]:
    """Places in the pool that together tell every mutant from the routine, if any can."""
    shows = list(_shows(routine, pool, allowed))
    return cover(shows, wanted, _MOST_SEQUENCES if len(pool) > 1 else _MOST + wanted)


def _shows(
    routine: Routine, pool: FloatArray, allowed: float, mutants: Sequence[Mutant] | None = None
) -> Iterator[Any]:
    """For each mutant the places in the pool that tell it from the routine, ``(n,)``."""
    outputs, outside = run(routine, pool)
    for mutant in mutants_of(routine) if mutants is None else mutants:
        other, flags = run(mutant.routine, pool)
        off = ~(np.abs(other - outputs) <= _CLEAR * allowed) | (flags != outside)
        yield off.any(axis=0)


def cover(shows: Sequence[Any], wanted: int, most: int) -> list[int]:
    """Choose the first ``wanted`` places and those that show what these do not.

    ``shows`` holds for each thing to be seen the places at which it is, ``(n,)``.
    """
    chosen = list(range(wanted))
    left = np.array([s for s in shows if s.any() and not s[:wanted].any()], dtype=bool)
    while len(left) and len(chosen) < most:
        best = int(left.sum(axis=0).argmax())
        chosen.append(best)
        left = left[~left[:, best]]
    return chosen
