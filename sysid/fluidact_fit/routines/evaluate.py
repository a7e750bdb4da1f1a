"""Routines run: in double precision, what every export is compared with, or in single precision.

Every operation is done in the order in which the exports do it.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np

from .expression import Binary, Choose, Expression, Item, Name, Number, Unary, parts_of
from .statements import Filter, Flag, Layer, Let, Put, Routine, Solve, Statement

_UNARY: Mapping[str, Callable[[Any], Any]] = {
    "neg": operator.neg, "abs": abs, "sqrt": np.sqrt, "exp": np.exp, "log": np.log,
}  # fmt: skip
_BINARY: Mapping[str, Callable[[Any, Any], Any]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv,
    "min": np.minimum, "max": np.maximum,
}  # fmt: skip
RELATIONS: Mapping[str, Callable[[Any, Any], Any]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
}  # fmt: skip
_ACTIVATION: Mapping[str, Callable[[Any], Any]] = {
    "relu": lambda z: np.maximum(z, z.dtype.type(0.0)), "tanh": np.tanh, "linear": lambda z: z,
}  # fmt: skip
Formula = Callable[[Mapping[str, Any]], Any]
Watch = Callable[[Any, Any], None]


@dataclass(frozen=True)
class Arithmetic:
    """The type of all numbers, and who is asked at a comparison.

    Attributes
    ----------
    real
        Type of every number and of every intermediate result.
    decide
        Told of every :class:`.Choose` with both sides of its comparison and what that gives;
        returns what is taken.
    watch
        Told of both sides of every comparison, those of minima, maxima and flags included.
    halvings
        Largest number of halvings that the type can tell apart.
    """

    real: Any = np.float64
    decide: Callable[[Choose, Any, Any, Any], Any] | None = None
    watch: Watch | None = None
    halvings: int = 1000


DOUBLE = Arithmetic()
SINGLE_HALVINGS = 24
SINGLE = Arithmetic(np.float32, halvings=SINGLE_HALVINGS)


class Machine:
    """A routine with its states, as it runs in a controller.

    Parameters
    ----------
    routine
        What is called.
    arithmetic
        Double precision, if none is given.
    """

    def __init__(self, routine: Routine, arithmetic: Arithmetic = DOUBLE) -> None:
        self.routine, self.arithmetic = routine, arithmetic
        # by identity of an expression, which is kept so that no other one can have the same
        self._formulas: dict[int, tuple[Expression, Formula]] = {}
        self.reset()

    def reset(self) -> None:
        """Return to the state before the first call."""
        real = self.arithmetic.real
        self.states: dict[str, Any] = {s.name: real(s.initial) for s in self.routine.states}
        self.memory: dict[str, tuple[list[Any], list[Any]]] = {
            f.name: ([real(0.0)] * len(f.output), [real(0.0)] * (f.delay + 1))
            for f in self.routine.filters
        }

    def __call__(self, **values: Any) -> tuple[Any, Any]:
        """Return the output and whether any argument lay beyond its range.

        Arrays go through at once: calls of one moment, each with its own states.
        """
        real = self.arithmetic.real
        names: dict[str, Any] = dict(self.states)
        outside: Any = False
        unreadable: Any = False
        for a in self.routine.arguments:
            given, low, high = real(values[a.name]), real(a.low), real(a.high)
            inside = (given >= low) & (given <= high)
            if inside is np.True_:  # the usual case of a single call
                names[a.name] = given
                continue
            outside = outside | ~inside
            unreadable = unreadable | (~inside if a.measured else np.isnan(given))
            names[a.name] = np.where(given > high, high, np.where(inside, given, low))
        if unreadable is False or not (self.routine.careful and np.any(unreadable)):
            return self._computed(names, outside)
        before = dict(self.states)
        lines = {name: (list(x), list(line)) for name, (x, line) in self.memory.items()}
        value, outside = self._computed(names, outside)
        return self._interrupt(unreadable, (before, lines), value), outside

    def _computed(self, names: dict[str, Any], outside: Any) -> tuple[Any, Any]:
        for s in self.routine.body:
            if isinstance(s, Flag):
                a, b = self._value(s.a, names), self._value(s.b, names)
                if self.arithmetic.watch is not None:
                    self.arithmetic.watch(a, b)
                outside = outside | (a < b)
            else:
                self._run(s, names)
        return self._value(self.routine.value, names), outside

    def _interrupt(self, unreadable: Any, before: tuple[Any, Any], value: Any) -> Any:
        """Return to what was kept before, where there was nothing to compute from."""
        states, lines = before
        kept = states | {s.state: self._value(s.value, states) for s in self.routine.interrupted}
        for name, now in self.states.items():
            self.states[name] = np.where(unreadable, kept[name], now)
        for name, parts in self.memory.items():
            for now, old in zip(parts, lines[name]):
                now[:] = [np.where(unreadable, b, a) for a, b in zip(now, old)]
        held = self._value(self.routine.value, states) if self.routine.keeps else np.nan
        return np.where(unreadable, self.arithmetic.real(held), value)

    def _value(self, e: Expression, names: Mapping[str, Any]) -> Any:
        if id(e) not in self._formulas:
            self._formulas[id(e)] = e, compiled(e, self.arithmetic)
        return self._formulas[id(e)][1](names)

    def _run(self, s: Statement, names: dict[str, Any]) -> None:
        match s:
            case Let():
                names[s.name] = self._value(s.value, names)
            case Put():
                names[s.state] = self.states[s.state] = self._value(s.value, names)
            case Layer():
                names[s.name] = self._layer(s, names)
            case Solve():
                names[s.name] = self._solve(s, names)
            case Filter():
                names[s.name] = self._step(s, self._value(s.drive, names))

    def _layer(self, s: Layer, names: Mapping[str, Any]) -> Any:
        real = self.arithmetic.real
        inputs = np.broadcast_arrays(*(self._value(e, names) for e in s.inputs))
        sums = []
        for row, bias in zip(s.weights, s.biases):
            z = np.full(inputs[0].shape, bias, dtype=real)
            for w, x in zip(row, inputs):
                z = z + real(w) * x
            sums.append(z)
        return _ACTIVATION[s.activation](np.stack(sums))

    def _solve(self, s: Solve, names: Mapping[str, Any]) -> Any:
        real = self.arithmetic.real
        target = np.asarray(self._value(s.target, names), dtype=real)
        low, high = np.full(target.shape, s.low, real), np.full(target.shape, s.high, real)
        half = real(0.5)
        for _ in range(min(s.halvings, self.arithmetic.halvings)):
            middle = half * (low + high)
            here = {**names, s.name: middle}
            for let in s.body:
                here[let.name] = self._value(let.value, here)
            value = self._value(s.value, here)
            below = value < target if s.rising else value > target
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return half * (low + high)

    def _step(self, f: Filter, drive: Any) -> Any:
        x, line = self.memory[f.name]
        line.append(drive)
        y = self._sum([*zip(f.output, x), (f.direct, drive)])
        late, soon = line.pop(0), line[0]
        moves = [
            self._sum([*zip(row, x), (f.late[k], late), (f.soon[k], soon)])
            for k, row in enumerate(f.change)
        ]
        x[:] = [value + move for value, move in zip(x, moves)]
        return y

    def _sum(self, terms: Sequence[tuple[float, Any]]) -> Any:
        """Sum of products, those with zero left out, from the left to the right."""
        real = self.arithmetic.real
        products = [real(c) * x for c, x in terms if c != 0.0]
        total = products[0] if products else real(0.0)
        for product in products[1:]:
            total = total + product
        return total


def value_of(e: Expression, names: Mapping[str, Any], arithmetic: Arithmetic = DOUBLE) -> Any:
    """Value of an expression where the names have these values."""
    return compiled(e, arithmetic)(names)


def compiled(e: Expression, arithmetic: Arithmetic = DOUBLE) -> Formula:
    """Function that gives the value of an expression for the values of its names."""

    def part(x: Expression) -> Formula:
        return compiled(x, arithmetic)

    match e:
        case Number():
            constant = arithmetic.real(e.value)
            return lambda names: constant
        case Name():
            return itemgetter(e.name)
        case Item():
            name, index = e.name, e.index
            return lambda names: names[name][index]
        case Unary():
            function, x = _UNARY[e.function], part(e.x)
            if e.function == "abs" and arithmetic.watch is not None:
                x = _watched(arithmetic.watch, x)
            return lambda names: function(x(names))
        case Binary():
            rule, a, b = _BINARY[e.function], part(e.a), part(e.b)
            if e.function in ("min", "max") and arithmetic.watch is not None:
                rule = _watching(arithmetic.watch, rule)
            return lambda names: rule(a(names), b(names))
        case Choose():
            return _chosen(e, arithmetic, *map(part, parts_of(e)))
    raise TypeError(e)


def _watched(watch: Watch, x: Formula) -> Formula:
    def value(names: Mapping[str, Any]) -> Any:
        found = x(names)
        watch(found, 0.0)
        return found

    return value


def _watching(watch: Watch, rule: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    def value(a: Any, b: Any) -> Any:
        watch(a, b)
        return rule(a, b)

    return value


def _chosen(
    e: Choose, arithmetic: Arithmetic, a: Formula, b: Formula, yes: Formula, no: Formula
) -> Formula:
    relation, watch, decide = RELATIONS[e.relation], arithmetic.watch, arithmetic.decide

    def value(names: Mapping[str, Any]) -> Any:
        left, right = a(names), b(names)
        holds = relation(left, right)
        if watch is None and decide is None and isinstance(holds, np.bool_):
            return yes(names) if holds else no(names)
        if watch is not None:
            watch(left, right)
        if decide is not None:
            holds = decide(e, left, right, holds)
        return np.where(holds, yes(names), no(names))

    return value
