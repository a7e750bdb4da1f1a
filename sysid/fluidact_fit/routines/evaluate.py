"""Routines run in double precision: what every export is compared with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..experiment import FloatArray
from .expression import Binary, Choose, Expression, Item, Name, Number, Unary
from .routine import Filter, Flag, Layer, Let, Put, Routine, Solve, Statement

_UNARY: Mapping[str, Callable[[Any], Any]] = {
    "neg": np.negative, "abs": np.abs, "sqrt": np.sqrt, "exp": np.exp, "log": np.log,
}  # fmt: skip
_BINARY: Mapping[str, Callable[[Any, Any], Any]] = {
    "+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "min": np.minimum,
    "max": np.maximum,
}  # fmt: skip
RELATIONS: Mapping[str, Callable[[Any, Any], Any]] = {
    "<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal,
}  # fmt: skip
_ACTIVATION: Mapping[str, Callable[[Any], Any]] = {
    "relu": lambda z: np.maximum(z, 0.0), "tanh": np.tanh, "linear": lambda z: z,
}  # fmt: skip


class Machine:
    """A routine with its states, as it runs in a controller."""

    def __init__(self, routine: Routine) -> None:
        self.routine = routine
        self.reset()

    def reset(self) -> None:
        """Return to the state before the first call."""
        self.states: dict[str, Any] = {s.name: s.initial for s in self.routine.states}
        self.memory = {
            f.name: (np.zeros(len(f.output)), [0.0] * (f.delay + 1)) for f in self.routine.filters
        }

    def __call__(self, **values: Any) -> tuple[Any, Any]:
        """Return the output and whether any argument lay beyond its range.

        Arrays go through at once where nothing is kept between calls.
        """
        names: dict[str, Any] = dict(self.states)
        outside: Any = False
        for a in self.routine.arguments:
            given = np.asarray(values[a.name], dtype=float)
            inside = (given >= a.low) & (given <= a.high)
            outside = outside | ~inside
            names[a.name] = np.where(given > a.high, a.high, np.where(inside, given, a.low))
        for s in self.routine.body:
            if isinstance(s, Flag):
                outside = outside | (value_of(s.a, names) < value_of(s.b, names))
            else:
                self._run(s, names)
        return value_of(self.routine.value, names), outside

    def _run(self, s: Statement, names: dict[str, Any]) -> None:
        match s:
            case Let():
                names[s.name] = value_of(s.value, names)
            case Put():
                names[s.state] = self.states[s.state] = value_of(s.value, names)
            case Layer():
                x = np.broadcast_arrays(*(value_of(e, names) for e in s.inputs))
                z = np.tensordot(np.array(s.weights), np.stack(x), 1)
                z = z + np.reshape(s.biases, (-1, *[1] * (z.ndim - 1)))
                names[s.name] = _ACTIVATION[s.activation](z)
            case Solve():
                names[s.name] = _solve(s, names)
            case Filter():
                names[s.name] = self._step(s, float(value_of(s.drive, names)))

    def _step(self, f: Filter, drive: float) -> float:
        x, line = self.memory[f.name]
        line.append(drive)
        y = float(np.array(f.output) @ x) + f.direct * drive
        late, soon = line.pop(0), line[0]
        x += np.array(f.change) @ x + np.array(f.late) * late + np.array(f.soon) * soon
        return y


def value_of(e: Expression, names: Mapping[str, Any]) -> Any:
    """Value of an expression where the names have these values."""
    match e:
        case Number():
            return e.value
        case Name():
            return names[e.name]
        case Item():
            return names[e.name][e.index]
        case Unary():
            return _UNARY[e.function](value_of(e.x, names))
        case Binary():
            return _BINARY[e.function](value_of(e.a, names), value_of(e.b, names))
        case Choose():
            holds = RELATIONS[e.relation](value_of(e.a, names), value_of(e.b, names))
            return np.where(holds, value_of(e.yes, names), value_of(e.no, names))
    raise TypeError(e)


def _solve(s: Solve, names: Mapping[str, Any]) -> FloatArray:
    target = np.asarray(value_of(s.target, names), dtype=float)
    low, high = np.full(target.shape, s.low), np.full(target.shape, s.high)
    for _ in range(s.halvings):
        middle = 0.5 * (low + high)
        here = {**names, s.name: middle}
        for let in s.body:
            here[let.name] = value_of(let.value, here)
        value = value_of(s.value, here)
        below = value < target if s.rising else value > target
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray(0.5 * (low + high))
