"""Expressions in fixed point: three-address C on integers, with a bound of its errors.

Sums and comparisons are made on long
mantissas of twice the bits of a factor, so that only the factors of a product, divisors and
arguments of functions are rounded, to half a unit each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import ceil, floor, frexp

import numpy as np

from ...experiment import FloatArray
from ...routines.evaluate import value_of
from ...routines.expression import (
    Binary,
    Choose,
    Expression,
    Item,
    Name,
    Number,
    Relation,
    Unary,
    walk,
)
from ...routines.routine import Layer, Let
from ...routines.sharing import word_of
from ..ranges import Range, boxes, choose, extreme, minus, over, plus, times, unary
from .fixed_layer import write_layer
from .fixed_sheet import Sheet, Value, exponent_of
from .fixed_table import NotFixed, exponent_for, turns
from .language import fold

_LOWEST_POWER = 12.0  # exp falls to 6e-6 of its largest value over that; below it stays there
_MIRRORED: Mapping[Relation, Relation] = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}
_COSTS = {"exp": 6, "log": 6, "sqrt": 6, "/": 6, "*": 2, "min": 1, "max": 1, "abs": 1}
_DEAR = 6  # a curve of one number is a table from there on
_GOOD = 2.0**-11  # of the range of a curve: error of a table that is worth having


class _Known(dict[str, FloatArray]):
    """Values of names; those that a routine computes are computed when they are asked for."""

    def __init__(self, given: Mapping[str, FloatArray], lets: Mapping[str, Expression]) -> None:
        super().__init__(given)
        self.lets = lets

    def __missing__(self, name: str) -> FloatArray:
        self[name] = found = np.asarray(value_of(self.lets[name], self))
        return found


@dataclass
class Code(Sheet):
    """One routine, its expressions written down once each."""

    layers: dict[str, list[Value]] = field(default_factory=dict)

    @cached_property
    def lets(self) -> Mapping[str, Expression]:
        """Assignments of the routine."""
        return {s.name: s.value for s in self.routine.body if isinstance(s, Let)}

    @cached_property
    def arguments(self) -> Mapping[str, Value]:
        """The arguments, clamped."""
        of = boxes(self.routine)
        return {
            a.name: Value(f"{a.name}_used", exponent_of(a), of[a.name], 15)
            for a in self.routine.arguments
        }

    def value(self, e: Expression) -> Value:
        """Write an expression down, once."""
        if e not in self.done:
            before = self.word, self.subject
            named = (name for name, value in self.lets.items() if value == e)
            self.word = next(named, "") or word_of(e)
            self.subject = e
            self.done[e] = self._value(e)
            self.word, self.subject = before
        return self.done[e]

    def _value(self, e: Expression) -> Value:
        match e:
            case Number():
                return self.constant(e.value)
            case Name():
                if e.name in self.arguments:
                    return self.arguments[e.name]
                if e.name not in self.lets:
                    raise NotFixed("it searches for a place on a curve of several arguments")
                return self.value(self.lets[e.name])
            case Item():
                return self._item(e)
        found = self._curve(e)
        if found is not None:
            return found
        match e:
            case Unary():
                return self._unary(e)
            case Choose():
                return self._choose(e)
            case Binary():
                return self._binary(e)
        raise TypeError(e)

    def _item(self, e: Item) -> Value:
        if e.name not in self.layers:
            (layer,) = (s for s in self.routine.body if isinstance(s, Layer) and s.name == e.name)
            folded, condition = fold(layer), ""
            inputs = [self.short(self.value(x)) for x in folded.inputs]
            if folded.switch:
                switch = folded.switch
                condition, a, b = self.condition(switch.a, switch.relation, switch.b)
                if np.any(a.error + b.error > 0.0):
                    raise NotFixed("what chooses between the biases of a layer is rounded")
            self.layers[e.name] = write_layer(self, layer, folded, inputs, condition)
        return self.layers[e.name][e.index]

    def _binary(self, e: Binary) -> Value:
        a, b = self.value(e.a), self.value(e.b)
        if a.constant is not None and b.constant is not None:
            folded = Binary(e.function, Number(a.constant), Number(b.constant))
            return self.constant(float(value_of(folded, {})))
        match e.function:
            case "*":
                return self._product(a, b, e.a == e.b)
            case "/":
                return self._quotient(a, b)
        rule: Callable[[Range, Range], Range] = {
            "+": plus, "-": minus,
            "min": lambda x, y: extreme(x, y, "min"), "max": lambda x, y: extreme(x, y, "max"),
        }[e.function]  # fmt: skip
        exponent = self.common([a, b], rule(a.range, b.range).reach)
        (left, x), (right, y) = self.long(a, exponent), self.long(b, exponent)
        if e.function in ("+", "-"):
            return self.new(f"{left} {e.function} {right}", exponent, rule(x, y))
        sign = "<" if e.function == "min" else ">"
        return self.new(f"({left} {sign} {right}) ? {left} : {right}", exponent, rule(x, y))

    def _product(self, a: Value, b: Value, square: bool) -> Value:
        if a.constant is not None:
            a, b = b, a
        if b.constant is not None:
            return self._scaled(a, b.constant)
        x, y = self.short(a), self.short(b)
        found = times(x.range, y.range)
        if square:
            found = replace(found, low=np.maximum(found.low, 0.0))
        long = self.width.long
        return self.new(f"({long}){x.text} * {y.text}", x.exponent + y.exponent, found)

    def _scaled(self, a: Value, factor: float) -> Value:
        """Product with a constant; a power of two only moves the exponent."""
        if factor == 0.0:
            return self.constant(0.0)
        fraction, power = frexp(abs(factor))
        exact = np.array([factor])
        if fraction == 0.5:
            found = times(a.range, Range(exact, exact, np.zeros(1)))
            moved = replace(a, exponent=a.exponent + power - 1, range=found)
            if factor > 0.0:
                return moved
            return self.new(f"-({self.width.long}){a.text}", moved.exponent, found)
        exponent = exponent_for(abs(factor), self.width.bits)
        mantissa = round(factor / 2.0**exponent)
        off = np.array([abs(mantissa * 2.0**exponent - factor)])
        x = self.short(a)
        text = f"({self.width.long}){x.text} * {self.width.literal(mantissa)}"
        return self.new(text, x.exponent + exponent, times(x.range, Range(exact, exact, off)))

    def _quotient(self, a: Value, b: Value) -> Value:
        if b.constant is not None:
            return self._scaled(a, 1.0 / b.constant)
        y = self.short(b)
        found, bits = over(a.range, y.range), 2 * self.width.bits
        if not np.isfinite(found.reach):
            raise NotFixed("a divisor in it can be zero within the errors of this arithmetic")
        exponent = max(exponent_for(a.range.reach, bits),
                       exponent_for(found.reach, bits) + y.exponent)  # fmt: skip
        text, x = self.long(a, exponent)
        found = over(x, y.range).wider(2.0 ** (exponent - y.exponent))  # it is cut off
        return self.new(f"{text} / {y.text}", exponent - y.exponent, found)

    def _unary(self, e: Unary) -> Value:
        x = self.value(e.x)
        if x.constant is not None:
            return self.constant(float(value_of(Unary(e.function, Number(x.constant)), {})))
        long = f"({self.width.long})"
        match e.function:
            case "neg":
                return self.new(f"-{long}{x.text}", x.exponent, unary("neg", x.range))
            case "abs":
                text = f"({x.text} < 0) ? -{long}{x.text} : {long}{x.text}"
                return self.new(text, x.exponent, unary("abs", x.range))
            case "sqrt":
                return self._root(x)
        cut, exact = 0.0, unary(e.function, x.range)
        if e.function == "exp":
            lowest = float(x.range.high.max()) - _LOWEST_POWER
            if x.range.low.min() < lowest:
                cut = float(np.exp(lowest))
                x = self._at_least(x, lowest)
        near, alone = self.short(x, 15), Unary(e.function, Name("x"))
        table = self.table(near, lambda v: np.asarray(value_of(alone, {"x": v})))
        found = unary(e.function, near.range).wider(table.error + cut)
        return replace(self.lookup(near, table), range=replace(found, low=exact.low))

    def _at_least(self, x: Value, lowest: float) -> Value:
        level = self.constant(lowest)
        found = extreme(x.range, level.range, "max")
        exponent = self.common([x, level], found.reach)
        (left, a), (right, b) = self.long(x, exponent), self.long(level, exponent)
        return self.new(f"({left} > {right}) ? {left} : {right}", exponent, extreme(a, b, "max"))

    def _root(self, x: Value) -> Value:
        exponent = exponent_for(x.range.reach, 2 * self.width.bits)
        exponent += exponent % 2
        text, near = self.long(x, exponent)
        found = unary("sqrt", near).wider(2.0 ** (exponent // 2))  # it is cut off
        call = f"{self.prefix}_sqrt{self.width.bits}({text})"
        return self.new(call, exponent // 2, found, self.width.bits)

    # -------------------------------------------------------------------------- choices

    def condition(
        self, a: Expression, relation: Relation, b: Expression
    ) -> tuple[str, Range, Range]:
        """Text and both sides of a comparison; that of an argument with a number is exact."""
        left, right = self.value(a), self.value(b)
        if left.constant is not None and right in self.arguments.values():
            text, second, first = self.condition(b, _MIRRORED[relation], a)
            return text, first, second
        if right.constant is not None and left in self.arguments.values():
            ratio = min(max(right.constant / left.unit, -1e5), 1e5)
            edge = ceil(ratio) if relation in ("<", ">=") else floor(ratio)
            text = f"{left.text} {relation} {self.width.literal(edge)}"
            return text, left.range, right.range
        if left.constant is not None and right.constant is not None:
            holds = value_of(Choose(Number(left.constant), relation, Number(right.constant),
                                    Number(1.0), Number(0.0)), {})  # fmt: skip
            return str(int(holds)), left.range, right.range
        exponent = self.common([left, right], 0.0)
        (x, p), (y, q) = self.long(left, exponent), self.long(right, exponent)
        return f"{x} {relation} {y}", p, q

    def _choose(self, e: Choose) -> Value:
        text, *sides = self.condition(e.a, e.relation, e.b)
        yes, no = self.value(e.yes), self.value(e.no)
        both = choose(e, (sides[0], sides[1]), yes.range, no.range)
        if yes.constant is not None and no.constant is not None:
            exponent = exponent_for(both.reach, self.width.bits)
        else:
            exponent = self.common([yes, no], both.reach)
        (left, x), (right, y) = self.long(yes, exponent), self.long(no, exponent)
        found = choose(e, (sides[0], sides[1]), x, y)
        return self.new(f"({text}) ? {left} : {right}", exponent, found)

    # --------------------------------------------------------------------------- curves

    def _curve(self, e: Expression) -> Value | None:
        """A table where a dear expression depends on a single number."""
        parts = set(walk(e))
        free = {p.name for p in parts if isinstance(p, Name | Item)}
        if (
            self.width.bits > 15 or sum(map(_cost, parts)) < _DEAR
            or any(isinstance(p, Item) for p in parts)
        ):  # fmt: skip
            return None
        behind = self._arguments_of(e)
        over_names = behind if len(behind) == 1 else free
        if len(over_names) != 1:
            return None
        (name,) = over_names
        x = self.short(self.value(Name(name)), 15)

        def curve(v: FloatArray) -> FloatArray:
            return np.asarray(value_of(e, self.known({name: v})))

        followed = [e, *(self.lets[n] for n in free if n in self.lets and n != name)]
        try:
            table = self.table(x, curve, lambda v: turns(followed, self.known({name: v}), v.size))
        except NotFixed:
            return None
        if table.error > _GOOD * float(np.ptp(table.values)):
            return None
        return self.lookup(x, table)

    def known(self, given: Mapping[str, FloatArray]) -> Mapping[str, FloatArray]:
        """Values of these names and of everything that the routine names."""
        return _Known(given, self.lets)

    def _arguments_of(self, e: Expression) -> set[str]:
        found: set[str] = set()
        for p in walk(e):
            if isinstance(p, Name):
                inside = self.lets.get(p.name)
                found |= {p.name} if inside is None else self._arguments_of(inside)
        return found


def _cost(e: Expression) -> int:
    match e:
        case Unary():
            return _COSTS.get(e.function, 0)
        case Choose():
            return 1
        case Binary():
            if e.function in ("*", "/") and (isinstance(e.a, Number) or isinstance(e.b, Number)):
                return _COSTS["/"] if e.function == "/" and isinstance(e.a, Number) else 1
            return _COSTS.get(e.function, 0)
    return 0
