"""Building blocks of fixed-point code: named mantissas, their exponents, and tables.

A value is ``m 2^e`` with a mantissa ``m`` that the controller computes and an exponent ``e`` that
follows from the range of the value over all arguments.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import ceil, floor
from typing import Literal

import numpy as np

from ...experiment import FloatArray
from ...routines import Routine
from ...routines.expression import Expression, as_text
from ...routines.routine import Argument
from ..ranges import Range
from .fixed_table import WANTED, NotFixed, Piece, Table, exponent_for, range_of, tabulate
from .language import WIDTH, Names, wrapped

_WORDS = re.compile(r"\w+")
_OF_TABLES = ("place", "cell", "part", "low", "rise", "more")


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


@dataclass(frozen=True)
class Lookup:
    """A curve at a place: the name of a short value, and the table with its number."""

    place: str
    table: Table
    number: int


def _text_of(value: str | Lookup) -> str:
    """Text with the names that a step needs: a curve that is flat all over needs no place."""
    if isinstance(value, str):
        return value
    pieces = value.table.pieces
    return value.place if len(pieces) > 1 or pieces[0].shift >= 0 else ""


@dataclass(frozen=True)
class Line:
    """A step: the type and name of a value, what gives it, and what it is."""

    kind: str
    name: str
    value: str | Lookup
    about: str


@dataclass
class Sheet:
    """The statements of one function and its tables, while they are written.

    ``routine`` has the ranges of :func:`inward`; ``prefix`` begins every name outside of it.
    """

    routine: Routine
    prefix: str
    width: Width
    written: list[Line] = field(default_factory=list)
    word: str = "result"  # for what is written now
    subject: Expression | None = None
    done: dict[Expression, Value] = field(default_factory=dict)
    names: Names = field(init=False)

    def __post_init__(self) -> None:
        """Keep the names that are given already."""
        own = [a.name for a in self.routine.arguments]
        self.names = Names([*own, *(f"{name}_used" for name in own), *_OF_TABLES])

    tables: list[tuple[int, ...]] = field(default_factory=list)
    biases: dict[str, tuple[tuple[int, ...], ...]] = field(default_factory=dict)

    def new(self, text: str, exponent: int, found: Range, bits: int = 0, about: str = "") -> Value:
        """Write a value down; a short one if it says its bits."""
        if not np.isfinite(found.reach):
            raise NotFixed("a value in it has no bound over the ranges of the arguments")
        kind = f"int{bits + 1}_t" if bits else self.width.long
        name = self.name(kind, text, f"{about or self.about}, times 2^{-exponent}")
        return Value(name, exponent, found, bits or 2 * self.width.bits)

    @property
    def about(self) -> str:
        """Describe the current statement in the names of those before."""
        if self.subject is None:
            return "the result"
        known = {e: v.text for e, v in self.done.items() if v.text.isidentifier()}
        return as_text(self.subject, known)

    def name(self, kind: str, value: str | Lookup, about: str) -> str:
        """Write a step down; returns the name of what it gives."""
        line = Line(kind, self.names.new(self.word), value, about)
        self.written.append(line)
        return line.name

    def needed(self, used: str) -> list[Line]:
        """The steps that a text needs, in order."""
        wanted = set(_WORDS.findall(used))
        found = []
        for line in reversed(self.written):
            if line.name in wanted:
                found.append(line)
                wanted.update(_WORDS.findall(_text_of(line.value)))
        return found[::-1]

    def lines(self, used: str) -> list[str]:
        """The statements that a text needs, in order, each with what it computes."""
        found = []
        for line in self.needed(used):
            found += wrapped(f"/* {line.about} */", "", "   ", WIDTH - 4)
            if isinstance(line.value, Lookup):
                found += [f"{line.kind} {line.name};", *self._read_table(line.name, line.value)]
            else:
                found += wrapped(f"const {line.kind} {line.name} = {line.value};", "", None,
                                 WIDTH - 4)  # fmt: skip
        return found

    def constant(self, value: float) -> Value:
        """A number that takes the exponent of what it meets."""
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
            exponent = exponent_for(abs(v.constant), bits)
            text, found = self.long(v, exponent)
            v = self.new(text, exponent, found)
        if v.bits <= bits:
            return v
        exponent = max(exponent_for(v.range.reach, bits), v.exponent)
        text, found = self.long(v, exponent)
        about = f"{v.text if v.text.isidentifier() else self.about} in {bits + 1} bits"
        return self.new(f"(int{bits + 1}_t){text}", exponent, found, bits, about)

    def common(self, values: list[Value], reach: float) -> int:
        """Exponent for a sum, a comparison or a choice; ``reach`` is that of the result."""
        fine = [v.exponent for v in values if v.constant is None]
        if any(v.constant for v in values):
            fine.append(exponent_for(max(reach, *(v.range.reach for v in values)),
                                     self.width.bits + 5))  # fmt: skip
        most = max(reach, *(v.range.reach for v in values))
        return max(min(fine), exponent_for(most, 2 * self.width.bits))

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
        about = f"{self.about} by a table, times 2^{-table.exponent}"
        result = self.name("int16_t", Lookup(x.text, table, number), about)
        return Value(result, table.exponent, range_of(table, x.range, x.unit), 15)

    def _read_table(self, result: str, lookup: Lookup) -> list[str]:
        """The pieces of a table; the only one of a table stands in braces of its own."""
        lines, pieces = list[str](), lookup.table.pieces
        for k, piece in enumerate(pieces):
            last = k == len(pieces) - 1
            condition = f"if ({lookup.place} <= {self.width.literal(piece.last)}) "
            head = ("} else " if k else "") + ("" if last else condition) + "{"
            inside = self._piece(lookup.place, piece, lookup.number, result)
            lines += [head, *(f"    {line}" for line in inside)]
        return [*lines, "}"]

    def _piece(self, place: str, piece: Piece, number: int, result: str) -> list[str]:
        """Two neighbours in the table and the straight line between them."""
        name = f"table_{number}"

        def read(index: str) -> str:
            return f"{self.prefix.upper()}_READ({name}[{index}])"

        if piece.shift < 0:
            return [f"{result} = {read(str(piece.start))};"]
        start = str(piece.start)
        first = self.width.literal(piece.first)
        lines = [f"const uint16_t place = (uint16_t)({place} - {first});"]
        if piece.cells > 1:
            ahead = f"{start} + " if piece.start else ""
            lines.append(f"const uint16_t cell = (uint16_t)({ahead}(place >> {piece.shift}));")
            start = "cell"
        power = 16 - piece.shift
        part = f"(uint16_t)(place * {2**power}u)" if power else "place"
        following = "cell + 1" if start == "cell" else str(piece.start + 1)
        return [
            *lines,
            f"const uint16_t part = {part};",
            f"const int16_t low = {read(start)};",
            f"const int16_t rise = (int16_t)({read(following)} - low);",
            "const int32_t more = ((int32_t)rise * (int32_t)part) + INT32_C(0x8000);",
            f"{result} = (int16_t)(low + (int16_t)(more >> 16));",
        ]
