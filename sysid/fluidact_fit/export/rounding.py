"""How far single-precision code can lie from the model: a bound, made with the file.

Every operation adds ``fl(a o b) = (a o b)(1 + d)`` with ``|d| <= u = 2^-24`` [1]_ to what its
operands carry (:mod:`.ranges`). Functions of the C library are trusted to two units in the last
place.

References
----------
.. [1] N. Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., 2002, chapters 2 to 4.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from ..experiment import FloatArray
from ..routines import Routine
from ..routines.evaluate import value_of
from ..routines.expression import Binary, Choose, Expression, Item, Name, Number, Unary
from ..routines.routine import Filter, Flag, Layer, Let, Put, Solve
from .ranges import Range, boxes, choose, extreme, minus, over, plus, times, unary

UNIT = 2.0**-24
LIBRARY = 4.0 * UNIT  # two units in the last place
CALLS = 1000  # from a reset, for a routine whose error can grow from call to call
_CELLS = 4096  # of a curve that is searched


def single(values: FloatArray) -> FloatArray:
    """Nearest numbers of single precision, in double precision."""
    return np.asarray(values, dtype=np.float32).astype(float)


def constant(value: float) -> Range:
    """A number of the source code."""
    v = np.array([value])
    error = np.abs(single(v) - v)
    return Range(v, v, error, bool(float(value).is_integer() and not error))


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
            found = unary(e.function, range_of(e.x, names))
            return found if e.function in ("neg", "abs") else found.rounded(LIBRARY)
        case Choose():
            sides = range_of(e.a, names), range_of(e.b, names)
            return choose(e, sides, range_of(e.yes, names), range_of(e.no, names))
        case Binary():
            a, b = range_of(e.a, names), range_of(e.b, names)
            match e.function:
                case "+":
                    return plus(a, b).rounded(UNIT)
                case "-":
                    return minus(a, b).rounded(UNIT)
                case "*":
                    return times(a, b).rounded(UNIT)
                case "/":
                    return over(a, b).rounded(UNIT)
            return extreme(a, b, e.function)
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
            z = extreme(z, constant(0.0), "max")
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
    found = _walk(routine, {**boxes(routine), **states})
    return float(np.max(found.error))


def _join(a: Range, b: Range | list[Range]) -> Range:
    assert isinstance(b, Range)
    b = b.hull()
    return Range(np.minimum(a.low, b.low), np.maximum(a.high, b.high),
                 np.maximum(a.error, b.error), a.whole and b.whole)  # fmt: skip


def _same(a: Range, b: Range) -> bool:
    return bool(a.low == b.low and a.high == b.high and a.error == b.error)
