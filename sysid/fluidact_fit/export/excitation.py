"""Arguments that make a routine do all it can: ends of ranges, edges from both sides, sequences."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..experiment import FloatArray
from ..routines import Argument, Filter, Machine, Routine
from ..routines.evaluate import DOUBLE, Arithmetic

Rounded = Callable[[FloatArray], FloatArray]
Beyond = Callable[[Argument, float, float], Sequence[float]]
_PROBE = 400  # rows among which those without a flag are looked for
LONGEST = 40  # dead time of what sequences are looked for with [calls]
_PAIRS = 6  # of rows on both sides, for each comparison
_BISECTIONS = 60
_FEWEST = 100  # sequences: of more, two rest at an end of all ranges
_LATE, _LATE_BISECTIONS = 4, 30  # calls of a comparison in a sequence
_NEAR = (0.0, 1e-6, 1e-4, 1e-3, 3e-3, 1e-2)  # of the way from an edge to where it began


def uniform(routine: Routine, count: int, rng: np.random.Generator) -> FloatArray:
    """Arguments drawn over their ranges, one in eight at an end, at zero or close to one.

    Of one row in eight all are: a product of arguments has to be small, too.

    Returns
    -------
    (count, k)
    """
    columns, whole = [], rng.uniform(0.0, 1.0, count) < 0.125
    for a in routine.arguments:
        span = a.high - a.low
        values = a.low + span * rng.uniform(0.0, 1.0, count)
        marks = np.array([a.low, a.high, np.clip(0.0, a.low, a.high)])
        off = span * 10.0 ** rng.uniform(-8.0, -1.0, count) * rng.choice([-1.0, 0.0, 1.0], count)
        special = np.clip(rng.choice(marks, count) + off, a.low, a.high)
        columns.append(np.where(whole | (rng.uniform(0.0, 1.0, count) < 0.125), special, values))
    return np.column_stack(columns) if columns else np.zeros((count, 0))


def hurried(routine: Routine) -> Routine:
    """The routine with dead times of at most :data:`LONGEST` calls: longer ones show no more."""
    body = tuple(
        replace(s, delay=min(s.delay, LONGEST)) if isinstance(s, Filter) else s
        for s in routine.body
    )
    return replace(routine, body=body)


def dead_time(routine: Routine) -> int:
    """Longest dead time of a routine, in calls."""
    return max((f.delay for f in routine.filters), default=0)


def ends(routine: Routine, beyond: Beyond, tries: int, rng: np.random.Generator) -> FloatArray:
    """Values at both ends of every range; the other arguments set no flag, if that can be.

    Parameters
    ----------
    routine
        What is called.
    beyond
        Gives the values for an argument, its end, and 1 or -1 for the way out of the range.
    tries
        Rows for each value.

    Returns
    -------
    (n, k)
    """
    found, rows = [], uniform(routine, _PROBE, rng)
    for j, a in enumerate(routine.arguments):
        for end, way in ((a.low, -1.0), (a.high, 1.0)):
            rows[:, j] = end
            clear = np.flatnonzero(~run(routine, rows[None])[1][0])
            for place in rng.choice(clear if clear.size else len(rows), tries):
                for value in beyond(a, end, way):
                    found.append(rows[place].copy())
                    found[-1][j] = value
        rows[:, j] = uniform(routine, _PROBE, rng)[:, j]
    return np.array(found).reshape(-1, len(routine.arguments))


def edges(routine: Routine, rows: FloatArray) -> FloatArray:
    """Arguments at which a comparison of a first call turns out the other way, from both sides.

    Found by bisection between rows on either side, for every comparison that the rows tell apart.
    """
    cases: list[tuple[int, int, int]] = []
    pick = np.arange(_PAIRS)
    for number, sides in enumerate(_sides(routine, rows)):
        yes, no = np.flatnonzero(sides), np.flatnonzero(~sides)
        if yes.size and no.size:
            cases += zip(pick * 0 + number, yes[pick % yes.size], no[(7 * pick) % no.size])
    if not cases:
        return rows[:0]
    which, yes, no = np.array(cases).T
    start, stop, place = rows[yes], rows[no], np.arange(len(cases))
    a, b = start.copy(), stop.copy()
    for _ in range(_BISECTIONS):
        middle = 0.5 * (a + b)
        here = _sides(routine, middle)[which, place][:, None]
        a, b = np.where(here, middle, a), np.where(here, b, middle)
    shares = [(a + share * (start - a), b + share * (stop - b)) for share in _NEAR]
    return np.concatenate([side for sides in shares for side in sides])


def edges_at_rest(routine: Routine, rows: FloatArray) -> FloatArray:
    """Edges among rows of which one argument after the other is zero: branches of rest."""
    found = [rows[:0]]
    for j, a in enumerate(routine.arguments):
        if len(routine.arguments) > 1 and a.low <= 0.0 <= a.high:
            still = rows.copy()
            still[:, j] = 0.0
            found.append(edges(routine, still))
    return np.concatenate(found)


def edge_sequences(routine: Routine, found: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Sequences in which a comparison of a later call turns out just so, or just the other way.

    Found by bisection between two sequences on either side, for every comparison at some calls.

    Returns
    -------
    (calls, n, k)
    """
    sides = _sides_of_sequences(routine, found)  # (calls, comparisons, sequences)
    calls, comparisons, _ = sides.shape
    cases = []
    for number in range(comparisons):
        for call in rng.permutation(np.arange(1, calls))[:_LATE]:
            yes, no = np.flatnonzero(sides[call, number]), np.flatnonzero(~sides[call, number])
            if yes.size and no.size:
                cases.append((call, number, rng.choice(yes), rng.choice(no)))
    if not cases:
        return found[:, :0]
    at, which, yes, no = np.array(cases).T
    start, stop = found[:, yes], found[:, no]
    a, b, place = start.copy(), stop.copy(), np.arange(len(cases))
    for _ in range(_LATE_BISECTIONS):
        middle = 0.5 * (a + b)
        here = _sides_of_sequences(routine, middle)[at, which, place][:, None]
        a, b = np.where(here, middle, a), np.where(here, b, middle)
    shares = [a + share * (start - a) for share in _NEAR[2:]]
    return np.concatenate([*shares, *(b + share * (stop - b) for share in _NEAR[2:])], axis=1)


def _sides_of_sequences(routine: Routine, arguments: FloatArray) -> Any:
    """Smaller side of every comparison, shape ``(calls, comparisons, sequences)``."""
    calls, count = arguments.shape[:2]
    seen: list[Any] = []

    def watch(a: Any, b: Any) -> None:
        seen.append(np.broadcast_to(np.less(a, b), (count,)))

    run(routine, arguments, replace(DOUBLE, watch=watch))
    return np.array(seen, dtype=bool).reshape(calls, -1, count)


def _sides(routine: Routine, rows: FloatArray) -> Any:
    """Smaller side of every comparison, shape ``(comparisons, rows)``."""
    seen: list[Any] = []

    def watch(a: Any, b: Any) -> None:
        seen.append(np.broadcast_to(np.less(a, b), (len(rows),)))
        seen.append(np.broadcast_to(np.greater(a, b), (len(rows),)))

    run(routine, rows[None], replace(DOUBLE, watch=watch))
    return np.array(seen, dtype=bool).reshape(-1, len(rows))


def sequences(
    routine: Routine, calls: int, count: int, rng: np.random.Generator, marks: FloatArray
) -> FloatArray:
    """Arguments of ``count`` sequences of calls: steps, walks, cycles, noise, and a follower.

    Returns
    -------
    (calls, count, k)
        ``marks`` are rows that steps go to as well.
    """
    found = np.empty((calls, count, len(routine.arguments)))
    for s in range(count):
        for j, a in enumerate(routine.arguments):
            levels = marks[:, j] if len(marks) and rng.uniform() < 0.3 else None
            values = _course(a.low, a.high, calls, rng, levels, held=a.held)
            alike = [i for i, b in enumerate(routine.arguments[:j]) if b.unit == a.unit]
            if alike and rng.uniform() < 0.5:  # what is measured follows what is wanted
                off = 10.0 ** rng.uniform(-5.0, -1.0) * (a.high - a.low)
                other = found[:, s, alike[-1]]
                if rng.uniform() < 0.5:
                    other = np.full(calls, other[rng.integers(calls)])
                values = np.clip(other + off * rng.choice([-1.0, 1.0]), a.low, a.high)
            found[:, s, j] = values
    for s, end in enumerate(("low", "high")):  # what accumulates, does so most there
        if count > _FEWEST:
            found[:, s] = [getattr(a, end) for a in routine.arguments]
    return found


def _course(
    low: float, high: float, calls: int, rng: np.random.Generator, levels: FloatArray | None,
    held: bool,
) -> FloatArray:  # fmt: skip
    span = high - low

    def level(n: int) -> FloatArray:
        return rng.choice(levels, n) if levels is not None else low + span * rng.uniform(0, 1, n)

    style = rng.choice(["steps", "walk", "cycle", "noise", "rest", "ends"])
    if held and style in ("walk", "cycle", "noise"):
        style = "steps"
    if style == "noise":
        return level(calls)
    if style in ("steps", "ends"):
        mean = rng.choice([2, 5, 20, 100])
        places = level(calls) if style == "steps" else rng.choice([low, high], calls)
        return np.asarray(places[np.cumsum(rng.uniform(0.0, 1.0, calls) < 1.0 / mean)
                                 .clip(0, calls - 1)])  # fmt: skip
    if style == "rest":
        return np.full(calls, level(1)[0])
    size = span * 10.0 ** rng.uniform(-4.0, -0.3)
    if style == "walk":
        return np.clip(level(1)[0] + np.cumsum(rng.uniform(-size, size, calls)), low, high)
    period = rng.uniform(4.0, 60.0)
    wave = np.sin(2.0 * np.pi * (np.arange(calls) / period + rng.uniform()))
    return np.clip(level(1)[0] + size * wave, low, high)


def run(
    routine: Routine, arguments: FloatArray, arithmetic: Arithmetic = DOUBLE
) -> tuple[FloatArray, Any]:
    """Outputs and flags of sequences of calls, each after a reset.

    Parameters
    ----------
    routine, arithmetic
        What is called, and in which arithmetic.
    arguments : (calls, count, k)

    Returns
    -------
    (calls, count), (calls, count)
    """
    machine, names = Machine(routine, arithmetic), [a.name for a in routine.arguments]
    shape = arguments.shape[:2]
    outputs, flags = np.empty(shape), np.empty(shape, dtype=bool)
    with np.errstate(all="ignore"):
        for k, row in enumerate(arguments):
            outputs[k], flags[k] = machine(**dict(zip(names, row.T)))
    return outputs, flags
