"""Routines with one constant changed, or one rule forgotten: what a self-test has to find."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from ..routines import Routine
from ..routines.expression import Expression, Number, with_parts
from ..routines.routine import Filter, Flag, Layer, Let, Put, Solve, Statement

SHARE = 0.01  # by which a constant is changed
STRUCTURAL = (0.0, 0.5, 1.0, 2.0)  # of an equation rather than of a machine

Key = tuple[Any, ...]
Value = Callable[[Key, float], float]


@dataclass(frozen=True)
class Mutant:
    """A routine in which one constant is another, or one rule is left out."""

    constant: str
    routine: Routine


def mutants_of(routine: Routine, share: float = SHARE) -> Iterator[Mutant]:
    """Yield a routine with each of its constants larger, and smaller, by a share of it.

    Zeros stay, and so do 1, 2 and 1/2 where no name says that they belong to the machine. Of a
    careful one, also as if it were not, and without each of what an interruption changes.
    """
    if routine.careful:
        yield Mutant("careful", replace(routine, careful=False))
    for k, put in enumerate(routine.interrupted):
        others = (*routine.interrupted[:k], *routine.interrupted[k + 1 :])
        yield Mutant(f"interrupted.{put.state}", replace(routine, interrupted=others))
    keys: dict[Key, float] = {}

    def note(key: Key, value: float) -> float:
        if value != 0.0 and not (key[0] == "number" and not key[1] and abs(value) in STRUCTURAL):
            keys[key] = value
        return value

    _changed(routine, note)
    for key in keys:
        for factor in (1.0 + share, 1.0 - share):

            def change(k: Key, value: float, key: Key = key, factor: float = factor) -> float:
                return value * factor if k == key else value

            name = ".".join(str(part) for part in key if part != "")
            yield Mutant(f"{name} x {factor:g}", _changed(routine, change))


def _changed(routine: Routine, value: Value) -> Routine:
    arguments = tuple(
        replace(a, low=value(("low", a.name), a.low), high=value(("high", a.name), a.high))
        for a in routine.arguments
    )
    states = tuple(replace(s, initial=value(("state", s.name), s.initial)) for s in routine.states)
    body = tuple(_statement(s, f"statement {k}", value) for k, s in enumerate(routine.body))
    return replace(
        routine, arguments=arguments, states=states, body=body,
        value=_expression(routine.value, "value", value),
    )  # fmt: skip


def _expression(e: Expression, place: str, value: Value) -> Expression:
    if isinstance(e, Number):
        key = ("number", e.name, "" if e.name else place, abs(e.value))
        return replace(e, value=value(key, e.value))
    return with_parts(e, lambda part: _expression(part, place, value))


def _statement(s: Statement, place: str, value: Value) -> Statement:
    def of(e: Expression) -> Expression:
        return _expression(e, place, value)

    def row(name: str, numbers: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(value((place, name, k), v) for k, v in enumerate(numbers))

    match s:
        case Let() | Put():
            return replace(s, value=of(s.value))
        case Flag():
            return replace(s, a=of(s.a), b=of(s.b))
        case Layer():
            weights = tuple(row(f"weights[{k}]", w) for k, w in enumerate(s.weights))
            inputs = tuple(map(of, s.inputs))
            return replace(s, weights=weights, biases=row("biases", s.biases), inputs=inputs)
        case Solve():
            lets = tuple(replace(let, value=of(let.value)) for let in s.body)
            low, high = row("range", (s.low, s.high))
            return replace(s, body=lets, value=of(s.value), target=of(s.target), low=low, high=high)
        case Filter():
            (direct,) = row("direct", (s.direct,))
            return replace(
                s, change=tuple(row(f"change[{k}]", c) for k, c in enumerate(s.change)),
                soon=row("soon", s.soon), late=row("late", s.late), output=row("output", s.output),
                direct=direct, drive=of(s.drive),
            )  # fmt: skip
    raise TypeError(s)
