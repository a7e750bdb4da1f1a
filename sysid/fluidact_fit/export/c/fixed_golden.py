"""Golden vectors of fixed point: mantissas, with what the code gives for them to the last bit."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...routines import Argument
from ..excitation import edges, edges_at_rest, ends, run, uniform
from ..golden import cover
from .fixed import Fixed
from .fixed_run import Program
from .fixed_table import Integers

_PLAIN = 6  # golden vectors that are drawn whatever they show
_MOST = 240
_TRIES = 2  # places at which ends of ranges are looked at
_FAR = 999  # mantissas beyond an end
_EACH = 6  # rows for every place of a table
_POOL = 3000  # arguments to choose from
_AROUND, _WITHIN = 64, 8  # of each edge, and this far in mantissas, what these do not show
_SEED = 20_262


def vectors_of(f: Fixed) -> list[list[int]]:
    """Golden vectors in mantissas: arguments, output and flag, as the integers of the code are.

    Raises
    ------
    AssertionError
        If one of them is farther from the model than the header says.
    """
    program, rng = Program.of(f), np.random.default_rng(_SEED)
    given, near = _pool(f, program, rng)
    units, due = 2.0 ** np.array(f.units), program(given)
    model, _ = run(f.routine, (given * units)[None])
    off = np.abs(due[0] * f.output.unit - model[0])[~due[1]]
    assert off.max(initial=0.0) <= f.bound + f.output.unit, "fixed point beyond its bound"
    around = np.repeat(near, _AROUND, axis=0)
    around = _held(around + rng.integers(-_WITHIN, _WITHIN + 1, around.shape))
    due_around, shows, rare = program(around), [], [given[:0]]
    for mutant in program.mutants():
        shows.append(_differs(mutant(given), due))
        if not shows[-1].any():
            rare.append(around[np.flatnonzero(_differs(mutant(around), due_around))[:1]])
    chosen = given[cover(shows, _PLAIN + 4 * _TRIES * len(units), _MOST)]
    rows = np.concatenate([chosen, np.unique(np.concatenate(rare), axis=0)[:_MOST]])
    return [list(map(int, row)) for row in np.column_stack([rows, *program(rows)])]


def _differs(found: tuple[Integers, Any], due: tuple[Integers, Any]) -> Any:
    return (found[0] != due[0]) | (found[1] != due[1])


def _held(rows: Integers) -> Integers:
    """Within what 16 bits hold."""
    return np.clip(rows, -32768, 32767)


def _pool(f: Fixed, program: Program, rng: np.random.Generator) -> tuple[Integers, Integers]:
    """Arguments in mantissas: both ends of every range, what lies beyond, and many within.

    Those at which a comparison turns out the other way are returned once more.
    """
    units = 2.0 ** np.array(f.units)
    low, high = np.array(f.ends).T
    place = {a.name: k for k, a in enumerate(f.routine.arguments)}

    def beyond(a: Argument, end: float, way: float) -> list[float]:
        del end
        k = place[a.name]
        inside = low[k] if way < 0.0 else high[k]
        return [(inside + way * off) * units[k] for off in (0, 1, _FAR)]

    at_ends = ends(f.routine, beyond, _TRIES, rng)
    within = uniform(f.routine, _POOL, rng)
    some = within[:400]
    near = np.concatenate([edges(f.routine, some), edges_at_rest(f.routine, some)])
    at_ends, within, near = (np.round(x / units).astype(int) for x in (at_ends, within, near))
    beside = near + rng.integers(-1, 2, near.shape)
    more = np.round(uniform(f.routine, 10 * _POOL, rng) / units).astype(int)
    spread = program.spread(np.clip(more, low, high), _EACH, rng)
    return _held(np.concatenate([at_ends, within, near, beside, spread])), near
