"""Static routines in Q15 fixed point: integers of 16 bits in and out, and no ``float``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ...experiment import FloatArray
from ...routines import Machine, Routine
from ...routines.expression import Expression
from ...routines.routine import Flag, Layer, Let, Solve
from ..ranges import boxes
from .fixed_code import Code
from .fixed_sheet import Value, Width, exponent_of, inward
from .fixed_table import NotFixed, turns

WANTED = 1e-3  # of full scale: above this error wider factors are tried
LARGEST = 1e-2  # of full scale: above this error a routine is left out
_NARROW, _WIDE = Width(15), Width(31)


@dataclass(frozen=True)
class Fixed:
    """A routine in fixed point.

    Attributes
    ----------
    routine
        With ranges that the mantissas of its arguments hold.
    code
        Its lines and tables.
    output
        The int16 that is returned.
    flags
        Conditions that set the flag, beside clamped arguments.
    scale
        Range of the output over the arguments [its unit].
    """

    routine: Routine
    code: Code
    output: Value
    flags: tuple[str, ...]
    scale: float

    @property
    def name(self) -> str:
        """Name of the function."""
        return f"{self.code.prefix}_{self.routine.name}_q15"

    @property
    def bound(self) -> float:
        """Largest error for arguments that are exactly their mantissas [unit of the output]."""
        return float(np.max(self.output.range.error)) * (1.0 + 1e-9)

    @property
    def complete(self) -> bool:
        """Return whether the bound comes from going through every argument there is."""
        return not self.code.done

    @property
    def ends(self) -> tuple[tuple[int, int], ...]:
        """Ends of the ranges of the arguments, in units of their exponents."""
        return tuple(
            (round(a.low / 2.0**e), round(a.high / 2.0**e))
            for a, e in zip(self.routine.arguments, self.units)
        )

    @property
    def units(self) -> tuple[int, ...]:
        """Exponents of the arguments."""
        return tuple(exponent_of(a) for a in self.routine.arguments)


@dataclass(frozen=True)
class Omitted:
    """A routine that is not in the export, and why."""

    name: str
    why: str


def fixed(routine: Routine, prefix: str) -> Fixed | Omitted:
    """Write a routine in fixed point: as one table, by its operations, or with wider factors."""
    if routine.keeps:
        return Omitted(routine.name, "it keeps something from call to call")
    narrow = inward(routine)
    scale = _scale(narrow)
    if not (0.0 < scale < np.inf):
        why = "is the same everywhere" if scale == 0.0 else "has no bound"
        return Omitted(routine.name, f"its value {why}")
    best: Fixed | None = None
    why = ""
    for attempt in _attempts(narrow, prefix):
        try:
            code, output, flags = attempt()
        except NotFixed as problem:
            why = why or str(problem)
            continue
        found = Fixed(narrow, code, output, flags, scale)
        if best is None or found.bound < best.bound:
            best = found
        if best.bound <= WANTED * scale:
            return best
    if best is None:
        return Omitted(routine.name, why)
    if best.bound > LARGEST * scale:
        share = 100.0 * best.bound / scale
        return Omitted(routine.name, f"its error could be {share:.2g} % of full scale")
    return best


_Attempt = Callable[[], tuple[Code, Value, tuple[str, ...]]]


def _attempts(routine: Routine, prefix: str) -> Iterator[_Attempt]:
    flagged = any(isinstance(s, Flag) for s in routine.body)
    if len(routine.arguments) == 1 and not flagged:
        yield lambda: _as_table(routine, prefix)
    yield lambda: _by_operations(routine, prefix, _NARROW)
    yield lambda: _by_operations(routine, prefix, _WIDE)


def _as_table(routine: Routine, prefix: str) -> tuple[Code, Value, tuple[str, ...]]:
    """The whole routine of one argument as a table, its error found by going through all."""
    code = Code(routine, prefix, _NARROW)
    ((argument, x),) = code.arguments.items()
    machine = Machine(routine)

    def curve(v: FloatArray) -> FloatArray:
        return np.asarray(machine(**{argument: v})[0])

    def corners(v: FloatArray) -> set[int]:
        if any(isinstance(s, Layer | Solve) for s in routine.body):
            return set()
        names: dict[str, FloatArray] = {argument: v}
        expressions: list[Expression] = [routine.value]
        for s in routine.body:
            if isinstance(s, Let):
                expressions.append(s.value)
        return turns(expressions, code.known(names), v.size)

    return code, code.lookup(x, code.table(x, curve, corners)), ()


def _by_operations(
    routine: Routine, prefix: str, width: Width
) -> tuple[Code, Value, tuple[str, ...]]:
    code = Code(routine, prefix, width)
    flags = [code.condition(s.a, "<", s.b)[0] for s in routine.body if isinstance(s, Flag)]
    return code, code.short(code.value(routine.value), 15), tuple(flags)


def _scale(routine: Routine) -> float:
    """Range of the output over the corners of the boxes; the true one is no smaller."""
    of = boxes(routine)
    machine = Machine(routine)
    ends = [np.asarray(machine(**{k: getattr(r, end) for k, r in of.items()})[0])
            for end in ("low", "high")]  # fmt: skip
    return float(np.ptp(np.concatenate([np.atleast_1d(e) for e in ends])))
