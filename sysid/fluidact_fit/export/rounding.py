"""How far single-precision code can lie from the model: a bound, made with the file.

Every value carries its range and the largest error that rounding can have given it [1]_:
``fl(a o b) = (a o b)(1 + d)`` with ``|d| <= u = 2^-24``, and what both operands carry goes on to
the first order and beyond. The ranges of the arguments are cut into boxes, because the range of
``a - a`` over a wide box is not zero. Functions of the C library are trusted to two units
in the last place.

References
----------
.. [1] N. Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., 2002, chapters 2 to 4.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..experiment import FloatArray
from ..routines import Routine
from ..routines.evaluate import value_of
from ..routines.expression import Binary, Choose, Expression, Item, Name, Number, Unary
from ..routines.routine import Filter, Flag, Layer, Let, Put, Solve

UNIT = 2.0**-24
LIBRARY = 4.0 * UNIT  # two units in the last place
CALLS = 1000  # from a reset, for a routine whose error can grow from call to call
_BOXES = {0: 1, 1: 4096, 2: 80, 3: 20, 4: 10}  # along each argument
_CELLS = 4096  # of a curve that is searched


@dataclass(frozen=True)
class Range:
    """Lowest and highest exact value, and largest error of the computed one; shape ``(boxes,)``."""

    low: FloatArray
    high: FloatArray
    error: FloatArray

    @property
    def size(self) -> FloatArray:
        """Largest magnitude of the exact value."""
        return np.maximum(np.abs(self.low), np.abs(self.high))

    def rounded(self, unit: float = UNIT) -> Range:
        """After a last rounding of the computed value."""
        return replace(self, error=self.error + unit * (self.size + self.error))

    def hull(self) -> Range:
        """All boxes as one."""
        ends = self.low.min(), self.high.max(), self.error.max()
        return Range(*(np.array([float(e)]) for e in ends))


def single(values: FloatArray) -> FloatArray:
    """Nearest numbers of single precision, in double precision."""
    return np.asarray(values, dtype=np.float32).astype(float)


def constant(value: float) -> Range:
    """A number of the source code."""
    v = np.array([value])
    return Range(v, v, np.abs(single(v) - v))


def inward(routine: Routine) -> Routine:
    """The routine with ranges of its arguments that single precision holds, just inside."""
    arguments = []
    for a in routine.arguments:
        low, high = np.float32(a.low), np.float32(a.high)
        low = np.nextafter(low, np.float32(np.inf)) if float(low) < a.low else low
        high = np.nextafter(high, np.float32(-np.inf)) if float(high) > a.high else high
        arguments.append(replace(a, low=float(low), high=float(high)))
    return replace(routine, arguments=tuple(arguments))


# -------------------------------------------------------------------------- expressions


def _times(a: Range, b: Range) -> Range:
    ends = np.stack(np.broadcast_arrays(
        a.low * b.low, a.low * b.high, a.high * b.low, a.high * b.high))  # fmt: skip
    error = a.size * b.error + b.size * a.error + a.error * b.error
    return Range(ends.min(axis=0), ends.max(axis=0), error)


def _over(a: Range, b: Range) -> Range:
    least = np.where(b.low > 0.0, b.low, np.where(b.high < 0.0, -b.high, 0.0)) - b.error
    with np.errstate(divide="ignore", invalid="ignore"):
        safe = np.where(least > 0.0, 1.0, np.inf)
        ends = np.stack(np.broadcast_arrays(
            a.low / b.low, a.low / b.high, a.high / b.low, a.high / b.high))  # fmt: skip
        low = np.where(least > 0.0, ends.min(axis=0), -np.inf)
        high = np.where(least > 0.0, ends.max(axis=0), np.inf)
        most = np.maximum(np.abs(low), np.abs(high))
        error = np.where(least > 0.0, (a.error + most * b.error) / np.abs(least), np.inf) * safe
    return Range(low, high, error)


def _extreme(a: Range, b: Range, pick: str) -> Range:
    better = np.minimum if pick == "min" else np.maximum
    low, high = better(a.low, b.low), better(a.high, b.high)
    left, right = (a, b) if pick == "min" else (b, a)
    only_left = left.high + left.error < right.low - right.error
    only_right = right.high + right.error < left.low - left.error
    error = np.where(only_left, left.error, np.where(only_right, right.error,
                     np.maximum(a.error, b.error)))  # fmt: skip
    return Range(low, high, error)


def _unary(function: str, x: Range) -> Range:
    if function == "neg":
        return Range(-x.high, -x.low, x.error)
    if function == "abs":
        low = np.where((x.low <= 0.0) & (x.high >= 0.0), 0.0,
                       np.minimum(np.abs(x.low), np.abs(x.high)))  # fmt: skip
        return Range(low, x.size, x.error)
    if function == "sqrt":
        low, high = np.sqrt(np.maximum(x.low, 0.0)), np.sqrt(np.maximum(x.high, 0.0))
        error = np.minimum(np.sqrt(x.error), x.error / np.maximum(low, 1e-300))
        return Range(low, high, error).rounded(LIBRARY)
    with np.errstate(divide="ignore", over="ignore"):
        if function == "exp":
            low, high = np.exp(x.low), np.exp(x.high)
            return Range(low, high, high * np.expm1(x.error)).rounded(LIBRARY)
        least = np.maximum(x.low - x.error, 0.0)
        return Range(np.log(x.low), np.log(x.high), x.error / least).rounded(LIBRARY)


def _choose(e: Choose, names: Mapping[str, Range | list[Range]]) -> Range:
    a, b = range_of(e.a, names), range_of(e.b, names)
    yes, no = range_of(e.yes, names), range_of(e.no, names)
    if e.relation in (">", ">="):
        a, b = b, a  # now it asks whether a lies below b
    slack = a.error + b.error
    strict = e.relation in ("<", ">")
    surely = a.high + slack < b.low if strict else a.high + slack <= b.low
    never = a.low - slack >= b.high if strict else a.low - slack > b.high
    jump = np.maximum(np.abs(yes.high - no.low), np.abs(no.high - yes.low))
    both = np.maximum(yes.error, no.error) + np.where(slack > 0.0, jump, 0.0)
    pick = [surely, never]
    return Range(
        np.select(pick, [yes.low, no.low], np.minimum(yes.low, no.low)),
        np.select(pick, [yes.high, no.high], np.maximum(yes.high, no.high)),
        np.select(pick, [yes.error, no.error], both),
    )


def range_of(e: Expression, names: Mapping[str, Range | list[Range]]) -> Range:
    """Range and error of an expression where the names have these."""
    match e:
        case Number():
            return constant(e.value)
        case Name():
            found = names[e.name]
            assert isinstance(found, Range)
            return found
        case Item():
            layer = names[e.name]
            assert isinstance(layer, list)
            return layer[e.index]
        case Unary():
            return _unary(e.function, range_of(e.x, names))
        case Choose():
            return _choose(e, names)
        case Binary():
            a, b = range_of(e.a, names), range_of(e.b, names)
            match e.function:
                case "+":
                    return Range(a.low + b.low, a.high + b.high, a.error + b.error).rounded()
                case "-":
                    return Range(a.low - b.high, a.high - b.low, a.error + b.error).rounded()
                case "*":
                    return _times(a, b).rounded()
                case "/":
                    return _over(a, b).rounded()
            return _extreme(a, b, e.function)
    raise TypeError(e)


# --------------------------------------------------------------------------- statements


def _layer(s: Layer, names: Mapping[str, Range | list[Range]]) -> list[Range]:
    inputs = [range_of(e, names) for e in s.inputs]
    terms = len(inputs) + 2  # a constant and a product each, and the sums
    growth = terms * UNIT / (1.0 - terms * UNIT)
    found = []
    for row, bias in zip(s.weights, s.biases):
        low = high = np.array([bias])
        carried, size = np.zeros(1), np.array([abs(bias)])
        for w, x in zip(row, inputs):
            low = low + (w * x.low if w >= 0.0 else w * x.high)
            high = high + (w * x.high if w >= 0.0 else w * x.low)
            carried, size = carried + abs(w) * x.error, size + abs(w) * (x.size + x.error)
        z = Range(low, high, carried + growth * size)
        if s.activation == "relu":
            z = _extreme(z, constant(0.0), "max")
        elif s.activation == "tanh":  # its slope is at most 1
            z = Range(np.tanh(low), np.tanh(high), z.error).rounded(LIBRARY)
        found.append(z)
    return found


def _solve(s: Solve, names: Mapping[str, Range | list[Range]]) -> Range:
    """Place on a monotone curve: what both sides of the equation carry, over the slope."""
    around = {k: v.hull() for k, v in names.items() if isinstance(v, Range)}
    edges = np.linspace(s.low, s.high, _CELLS + 1)
    here: dict[str, Range | list[Range]] = dict(around)
    width = (s.high - s.low) * UNIT
    here[s.name] = Range(edges[:-1], edges[1:], np.full(_CELLS, width))
    for let in s.body:
        here[let.name] = range_of(let.value, here)
    value, target = range_of(s.value, here), range_of(s.target, names)
    slopes = []
    for ends in product(*((v.low[0], v.high[0]) for v in around.values())):
        at: dict[str, object] = {**dict(zip(around, ends)), s.name: edges}
        for let in s.body:
            at[let.name] = value_of(let.value, at)
        slopes.append(np.abs(np.diff(value_of(s.value, at))).min() * _CELLS / (s.high - s.low))
    with np.errstate(divide="ignore"):
        off = (value.error.max() + target.error) / np.float64(0.5 * min(slopes))
    error = np.minimum(off + (s.high - s.low) * 2.0 ** -min(s.halvings, 23), s.high - s.low)
    return Range(np.full(1, s.low), np.full(1, s.high), error)


def _filter(s: Filter, drive: Range) -> Range:
    """Output of a difference equation: what every step adds, through the rest of the response."""
    change, output = np.array(s.change), np.abs(s.output)
    soon, late = np.array(s.soon), np.array(s.late)
    a = np.eye(len(output)) + change
    largest, noise = float(drive.size.max()), float(drive.error.max())
    reach = np.abs(soon) * largest + np.abs(late) * largest
    response, states, through = soon + late, reach.copy(), np.zeros(len(output))
    power = np.eye(len(output))
    for _ in range(CALLS):
        through = through + np.abs(np.array(s.output) @ power)
        response, power = a @ response, power @ a
        states = states + np.abs(response) * largest
    terms = len(output) + 5
    step = states + np.abs(change) @ states + reach
    local = terms * UNIT * step + (np.abs(soon) + np.abs(late)) * noise
    most = float(output @ states) + abs(s.direct) * largest
    error = through @ local + terms * UNIT * most + abs(s.direct) * noise
    return Range(np.array([-most]), np.array([most]), np.array([error]))


def _walk(routine: Routine, names: dict[str, Range | list[Range]]) -> Range:
    """Output of a routine where its arguments and states have these ranges."""
    for s in routine.body:
        match s:
            case Let() | Put():
                names[s.name if isinstance(s, Let) else s.state] = range_of(s.value, names)
            case Layer():
                names[s.name] = _layer(s, names)
            case Solve():
                names[s.name] = _solve(s, names)
            case Filter():
                names[s.name] = _filter(s, range_of(s.drive, names))
            case Flag():
                continue
    return range_of(routine.value, names)


def _boxes(routine: Routine) -> dict[str, Range | list[Range]]:
    """Arguments in every combination of their parts; zero is an edge."""
    count = _BOXES.get(len(routine.arguments), 8)
    cuts = []
    for a in routine.arguments:
        edges = np.linspace(a.low, a.high, count + 1)
        if a.low < 0.0 < a.high:
            edges = np.unique(np.append(edges, 0.0))
        cuts.append((edges[:-1], edges[1:]))
    low = np.meshgrid(*(c[0] for c in cuts), indexing="ij")
    high = np.meshgrid(*(c[1] for c in cuts), indexing="ij")
    return {
        a.name: Range(x.ravel(), y.ravel(), np.zeros(x.size))
        for a, x, y in zip(routine.arguments, low, high)
    }


def error_bound(routine: Routine) -> float:
    """Largest difference of single-precision code from the model, within the ranges [its unit].

    For a routine that keeps something: in the first :data:`CALLS` calls after a reset.

    Parameters
    ----------
    routine
        With ranges that single precision holds, see :func:`inward`.
    """
    states = {s.name: constant(s.initial) for s in routine.states}
    if states:
        whole = {
            a.name: Range(np.array([a.low]), np.array([a.high]), np.zeros(1))
            for a in routine.arguments
        }
        for _ in range(CALLS):
            names: dict[str, Range | list[Range]] = {**whole, **states}
            _walk(routine, names)
            wider = {k: _join(states[k], names[k]) for k in states}
            if all(_same(states[k], wider[k]) for k in states):
                break
            states = wider
    found = _walk(routine, {**_boxes(routine), **states})
    return float(np.max(found.error))


def _join(a: Range, b: Range | list[Range]) -> Range:
    assert isinstance(b, Range)
    b = b.hull()
    return Range(np.minimum(a.low, b.low), np.maximum(a.high, b.high),
                 np.maximum(a.error, b.error))  # fmt: skip


def _same(a: Range, b: Range) -> bool:
    return bool(a.low == b.low and a.high == b.high and a.error == b.error)
