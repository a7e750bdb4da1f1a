"""Expressions in fixed point: three-address C on integers, with a bound of its errors.

A value is ``m 2^e`` with a mantissa ``m`` that the controller computes and an exponent ``e`` that
follows from the range of the value over all arguments. Sums and comparisons are made on long
mantissas of twice the bits of a factor, so that only the factors of a product, divisors and
arguments of functions are rounded, to half a unit each.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import ceil, floor, frexp
from typing import Literal

import numpy as np
import numpy.typing as npt

from ...experiment import FloatArray
from ...routines import Routine
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
)
from ...routines.routine import Argument, Layer, Let
from ..ranges import Range, boxes, choose, extreme, minus, over, plus, times, unary
from .fixed_table import WANTED, NotFixed, Piece, Table, exponent_for, parts_of, tabulate, turns

_LOWEST_POWER = 12.0  # exp falls to 6e-6 of its largest value over that; below it stays there
_COSTS = {"exp": 6, "log": 6, "sqrt": 6, "/": 6, "*": 2, "min": 1, "max": 1, "abs": 1}
_DEAR = 6  # a curve of one number is a table from there on
_GOOD = 2.0**-11  # of the range of a curve: error of a table that is worth having
_WORDS = re.compile(r"\w+")


@dataclass(frozen=True)
class Width:
    """Bits of a factor without its sign, and the types of factors and of everything else."""

    bits: Literal[15, 31]

    @property
    def short(self) -> str:
        """Type of a factor."""
        return f"int{self.bits + 1}_t"

    @property
    def long(self) -> str:
        """Type of sums and products."""
        return f"int{2 * self.bits + 2}_t"

    def literal(self, mantissa: int) -> str:
        """A constant of the long type."""
        text = f"INT{2 * self.bits + 2}_C({abs(mantissa)})"
        return f"(-{text})" if mantissa < 0 else text


@dataclass(frozen=True)
class Value:
    """A mantissa under a name in the C code; ``bits`` hold it without its sign."""

    text: str
    exponent: int
    range: Range
    bits: int
    constant: float | None = None

    @property
    def unit(self) -> float:
        """Value of one unit of the mantissa."""
        return float(2.0**self.exponent)


def exponent_of(a: Argument) -> int:
    """Exponent of an argument."""
    return exponent_for(max(abs(a.low), abs(a.high)))


def inward(routine: Routine) -> Routine:
    """The routine with ranges of its arguments that their mantissas hold, just inside."""
    found = []
    for a in routine.arguments:
        unit = 2.0 ** exponent_of(a)
        low, high = ceil(a.low / unit) * unit, floor(a.high / unit) * unit
        found.append(replace(a, low=low, high=max(low, high)))
    return replace(routine, arguments=tuple(found))


class _Known(dict[str, FloatArray]):
    """Values of names; those that a routine computes are computed when they are asked for."""

    def __init__(self, given: Mapping[str, FloatArray], lets: Mapping[str, Expression]) -> None:
        super().__init__(given)
        self.lets = lets

    def __missing__(self, name: str) -> FloatArray:
        self[name] = found = np.asarray(value_of(self.lets[name], self))
        return found


@dataclass
class Code:
    """One routine, with ranges from :func:`inward`, while it is written."""

    routine: Routine
    prefix: str
    width: Width
    written: list[tuple[str, list[str]]] = field(default_factory=list)
    tables: list[tuple[int, ...]] = field(default_factory=list)
    biases: dict[str, tuple[tuple[int, ...], ...]] = field(default_factory=dict)
    done: dict[Expression, Value] = field(default_factory=dict)
    layers: dict[str, list[Value]] = field(default_factory=dict)

    # ---------------------------------------------------------------------------- values

    @cached_property
    def lets(self) -> Mapping[str, Expression]:
        """What the routine names."""
        return {s.name: s.value for s in self.routine.body if isinstance(s, Let)}

    @cached_property
    def arguments(self) -> Mapping[str, Value]:
        """The arguments, clamped."""
        of = boxes(self.routine)
        return {
            a.name: Value(a.name, exponent_of(a), of[a.name], 15) for a in self.routine.arguments
        }

    def new(self, text: str, exponent: int, found: Range, bits: int = 0) -> Value:
        """Write a value down; a short one if it says its bits."""
        if not np.isfinite(found.reach):
            raise NotFixed("a value in it has no bound over the ranges of the arguments")
        kind = f"int{bits + 1}_t" if bits else self.width.long
        name = self.name(f"const {kind} {{}} = {text};")
        return Value(name, exponent, found, bits or 2 * self.width.bits)

    def name(self, *lines: str) -> str:
        """Write statements down; ``{}`` in the first one is the name that they define."""
        name = f"v{len(self.written)}"
        self.written.append((name, [lines[0].replace("{}", name), *lines[1:]]))
        return name

    def lines(self, used: str) -> list[str]:
        """The statements that a text needs, in order."""
        wanted = set(_WORDS.findall(used))
        found: list[list[str]] = []
        for name, lines in reversed(self.written):
            if name in wanted:
                found.append(lines)
                wanted.update(_WORDS.findall(" ".join(lines)))
        return [line for lines in reversed(found) for line in lines]

    def _constant(self, value: float) -> Value:
        exact = np.array([value])
        return Value("", 0, Range(exact, exact, np.zeros(1)), 0, value)

    def long(self, v: Value, exponent: int) -> tuple[str, Range]:
        """Text and range of a value as a long mantissa of that exponent, rounded if need be."""
        literal = self.width.literal
        if v.constant is not None:
            mantissa = round(v.constant / 2.0**exponent)
            error = abs(mantissa * 2.0**exponent - v.constant)
            return literal(mantissa), v.range.wider(error)
        text = v.text if v.bits == 2 * self.width.bits else f"({self.width.long}){v.text}"
        up = v.exponent - exponent
        if up >= 0:
            return (f"({text} * {literal(2**up)})" if up else text), v.range
        if -up > v.bits:
            return literal(0), v.range.wider(v.range.reach)
        return f"(({text} + {literal(2 ** (-up - 1))}) >> {-up})", v.range.wider(
            2.0 ** (exponent - 1)
        )

    def short(self, v: Value, bits: int = 0) -> Value:
        """A value as a factor of so many bits; without, those of the width."""
        bits = bits or self.width.bits
        if v.constant is not None:
            v = self.new(*self._at(v, exponent_for(abs(v.constant), bits)))
        if v.bits <= bits:
            return v
        exponent = max(exponent_for(v.range.reach, bits), v.exponent)
        text, found = self.long(v, exponent)
        return self.new(f"(int{bits + 1}_t){text}", exponent, found, bits)

    def _at(self, v: Value, exponent: int) -> tuple[str, int, Range]:
        text, found = self.long(v, exponent)
        return text, exponent, found

    def common(self, values: list[Value], reach: float) -> int:
        """Exponent for a sum, a comparison or a choice; ``reach`` is that of the result."""
        fine = [v.exponent for v in values if v.constant is None]
        if any(v.constant for v in values):
            fine.append(exponent_for(max(reach, *(v.range.reach for v in values)),
                                     self.width.bits + 5))  # fmt: skip
        most = max(reach, *(v.range.reach for v in values))
        return max(min(fine), exponent_for(most, 2 * self.width.bits))

    # ----------------------------------------------------------------------- expressions

    def value(self, e: Expression) -> Value:
        """Write an expression down, once."""
        if e not in self.done:
            self.done[e] = self._value(e)
        return self.done[e]

    def _value(self, e: Expression) -> Value:
        match e:
            case Number():
                return self._constant(e.value)
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
        from .fixed_layer import write_layer

        if e.name not in self.layers:
            (layer,) = (s for s in self.routine.body if isinstance(s, Layer) and s.name == e.name)
            self.layers[e.name] = write_layer(self, layer)
        return self.layers[e.name][e.index]

    def _binary(self, e: Binary) -> Value:
        a, b = self.value(e.a), self.value(e.b)
        if a.constant is not None and b.constant is not None:
            folded = Binary(e.function, Number(a.constant), Number(b.constant))
            return self._constant(float(value_of(folded, {})))
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
        return self.new(f"{left} {sign} {right} ? {left} : {right}", exponent, rule(x, y))

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
            return self._constant(0.0)
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
            return self._constant(float(value_of(Unary(e.function, Number(x.constant)), {})))
        long = f"({self.width.long})"
        match e.function:
            case "neg":
                return self.new(f"-{long}{x.text}", x.exponent, unary("neg", x.range))
            case "abs":
                text = f"{x.text} < 0 ? -{long}{x.text} : {long}{x.text}"
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
        level = self._constant(lowest)
        found = extreme(x.range, level.range, "max")
        exponent = self.common([x, level], found.reach)
        (left, a), (right, b) = self.long(x, exponent), self.long(level, exponent)
        return self.new(f"{left} > {right} ? {left} : {right}", exponent, extreme(a, b, "max"))

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
        if right.constant is not None and left.text in self.arguments:
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
        both = choose(e.relation, (sides[0], sides[1]), yes.range, no.range)
        if yes.constant is not None and no.constant is not None:
            exponent = exponent_for(both.reach, self.width.bits)
        else:
            exponent = self.common([yes, no], both.reach)
        (left, x), (right, y) = self.long(yes, exponent), self.long(no, exponent)
        found = choose(e.relation, (sides[0], sides[1]), x, y)
        return self.new(f"{text} ? {left} : {right}", exponent, found)

    # --------------------------------------------------------------------------- curves

    def _curve(self, e: Expression) -> Value | None:
        """A table where a dear expression depends on a single number."""
        parts = set(parts_of(e))
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
        for p in parts_of(e):
            if isinstance(p, Name):
                inside = self.lets.get(p.name)
                found |= {p.name} if inside is None else self._arguments_of(inside)
        return found

    def table(
        self, x: Value, curve: Callable[[FloatArray], FloatArray],
        corners: Callable[[FloatArray], set[int]] = lambda v: set(), wanted: float = WANTED,
    ) -> Table:  # fmt: skip
        """A table of a curve over all mantissas that a short value can have."""
        low, high = float(x.range.low.min()), float(x.range.high.max())
        off = float(x.range.error.max())
        first, last = floor((low - off) / x.unit), ceil((high + off) / x.unit)
        places = np.clip(np.arange(first, last + 1) * x.unit, low, high)
        values = np.broadcast_to(curve(places), places.shape)
        if not np.all(np.isfinite(values)):
            raise NotFixed("a curve in it has no bound over the ranges of the arguments")
        return tabulate(first, values, corners(places), wanted)

    def lookup(self, x: Value, table: Table) -> Value:
        """Read a table at a short value."""
        if table.entries not in self.tables:
            self.tables.append(table.entries)
        number = self.tables.index(table.entries)
        result = self.name("int16_t {};")
        lines = self.written[-1][1]
        for k, piece in enumerate(table.pieces):
            head = "else " if k else ""
            if k < len(table.pieces) - 1:
                head += f"if ({x.text} <= {self.width.literal(piece.last)}) "
            inside = self._piece(x, piece, number, result)
            lines += [head + "{", *(f"    {line}" for line in inside), "}"]
        return Value(result, table.exponent, _range_of(x, table), 15)

    def _piece(self, x: Value, piece: Piece, number: int, result: str) -> list[str]:
        """Two neighbours in the table and the straight line between them."""
        name = f"{self.prefix}_{self.routine.name}_table_{number}"

        def read(index: str) -> str:
            return f"{self.prefix.upper()}_READ({name}[{index}])"

        if piece.shift < 0:
            return [f"{result} = {read(str(piece.start))};"]
        start = str(piece.start)
        first = self.width.literal(piece.first)
        lines = [f"const uint16_t place = (uint16_t)({x.text} - {first});"]
        if piece.cells > 1:
            lines.append(f"const uint16_t cell = (uint16_t)({start} + (place >> {piece.shift}));")
            start = "cell"
        power = 16 - piece.shift
        part = f"(uint16_t)(place * {2**power}u)" if power else "place"
        following = "cell + 1" if start == "cell" else str(piece.start + 1)
        return [
            *lines,
            f"const uint16_t part = {part};",
            f"const int16_t low = {read(start)};",
            f"const int16_t rise = (int16_t)({read(following)} - low);",
            "const int32_t more = (int32_t)rise * part + INT32_C(0x8000);",
            f"{result} = (int16_t)(low + (int16_t)(more >> 16));",
        ]


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


def _range_of(x: Value, table: Table) -> Range:
    """Range of a table's curve over the boxes, with what an error of the place does to it."""
    first = table.pieces[0].first
    last = table.values.size - 1
    start = np.clip(np.floor(x.range.low / x.unit).astype(np.int64) - first, 0, last)
    stop = np.clip(np.ceil(x.range.high / x.unit).astype(np.int64) - first, 0, last)
    lows, highs = [table.values], [table.values]  # over windows of 1, 2, 4 ... places
    while 2 ** len(lows) <= table.values.size:
        half = 2 ** (len(lows) - 1)
        lows.append(np.minimum(lows[-1][:-half], lows[-1][half:]))
        highs.append(np.maximum(highs[-1][:-half], highs[-1][half:]))

    def extremes(
        start: npt.NDArray[np.int64], stop: npt.NDArray[np.int64]
    ) -> tuple[FloatArray, FloatArray]:
        level = np.floor(np.log2(stop - start + 1.0)).astype(int)
        low, high = np.empty(start.shape), np.empty(start.shape)
        for k in np.unique(level):
            at = level == k
            left, right = start[at], stop[at] - 2**k + 1
            low[at] = np.minimum(lows[k][left], lows[k][right])
            high[at] = np.maximum(highs[k][left], highs[k][right])
        return low, high

    low, high = extremes(start, stop)
    error = np.full(low.shape, table.error)
    off = x.range.error
    if off.max() > 0.0:
        reach = np.ceil(off / x.unit).astype(np.int64)
        wide = extremes(np.clip(start - reach, 0, last), np.clip(stop + reach, 0, last))
        places = np.arange(last + 1)
        most = int(reach.max())
        around = extremes(np.clip(places - most, 0, last), np.clip(places + most, 0, last))
        steepest = float(np.max(np.maximum(around[1] - table.values, table.values - around[0])))
        error = error + np.minimum(steepest, wide[1] - wide[0])
    return Range(low, high, error)
