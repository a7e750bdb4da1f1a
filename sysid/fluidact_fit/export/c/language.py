"""Routines as C99: expressions and statements, in single or in double precision."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...routines import Routine
from ...routines.expression import Binary, Choose, Expression, Item, Name, Number, Unary
from ...routines.routine import (
    Filter,
    Flag,
    Layer,
    Let,
    Matrix,
    Put,
    Solve,
    Statement,
    as_matrix,
)

_OPERATORS = {"+": "+", "-": "-", "*": "*", "/": "/"}
_DEEPEST = 24  # halvings that single precision can tell apart


@dataclass(frozen=True)
class Precision:
    """The type of all numbers, and what ends their literals and the names of functions."""

    type: Literal["float", "double"]
    suffix: Literal["f", ""]

    def literal(self, value: float) -> str:
        """A constant, to the last digit that the type holds."""
        text = f"{np.float32(value):.9g}" if self.suffix else f"{value:.17g}"
        if not any(c in text for c in ".e"):
            text += ".0"
        return text + self.suffix


SINGLE, DOUBLE = Precision("float", "f"), Precision("double", "")


@dataclass(frozen=True)
class Folded:
    """A layer whose input of two values, if it has one, is part of its biases: a row for each."""

    weights: Matrix
    biases: Matrix
    inputs: tuple[Expression, ...]
    switch: Choose | None = None


def fold(layer: Layer) -> Folded:
    """Draw the first input that is one of two constants into the biases."""
    for k, e in enumerate(layer.inputs):
        if isinstance(e, Choose) and isinstance(e.yes, Number) and isinstance(e.no, Number):
            column = np.array([row[k] for row in layer.weights])
            biases = [layer.biases + column * end.value for end in (e.yes, e.no)]
            rest = np.delete(np.array(layer.weights), k, axis=1)
            inputs = layer.inputs[:k] + layer.inputs[k + 1 :]
            if inputs:
                return Folded(as_matrix(rest), as_matrix(biases), inputs, e)
    return Folded(layer.weights, (layer.biases,), layer.inputs)


@dataclass(frozen=True)
class Writer:
    """One routine as lines of C; ``prefix`` begins every name that it gives."""

    routine: Routine
    prefix: str
    precision: Precision

    @property
    def name(self) -> str:
        """Name of the function."""
        return f"{self.prefix}_{self.routine.name}"

    # ----------------------------------------------------------------------- expressions

    def expression(self, e: Expression) -> str:
        """An expression, in parentheses where it needs them."""
        match e:
            case Number():
                text = self.precision.literal(e.value)
                return f"({text})" if e.value < 0.0 else text
            case Name():
                return self._name(e.name)
            case Item():
                return f"{e.name}[{e.index}]"
            case Unary():
                return self._unary(e)
            case Binary():
                a, b = self.expression(e.a), self.expression(e.b)
                if e.function in _OPERATORS:
                    return f"({a} {e.function} {b})"
                return f"{self.prefix}_{e.function}({a}, {b})"
            case Choose():
                condition = f"{self.expression(e.a)} {e.relation} {self.expression(e.b)}"
                return f"(({condition}) ? {self.expression(e.yes)} : {self.expression(e.no)})"
        raise TypeError(e)

    def _name(self, name: str) -> str:
        kept = any(s.name == name for s in self.routine.states)
        return f"state->{name}" if kept else name

    def _unary(self, e: Unary) -> str:
        x = self.expression(e.x)
        if e.function == "neg":
            return f"(-{x})"
        function = "fabs" if e.function == "abs" else e.function
        return f"{function}{self.precision.suffix}({x})"

    def _table(self, values: Sequence[float]) -> str:
        return "{" + ", ".join(map(self.precision.literal, values)) + "}"

    # ------------------------------------------------------------------------ statements

    def tables(self) -> Iterator[str]:
        """Constant arrays that the function reads."""
        for s in self.routine.body:
            if isinstance(s, Layer):
                folded = fold(s)
                yield self._list(f"{self.name}_{s.name}_weights", folded.weights)
                yield self._matrix(f"{self.name}_{s.name}_biases", folded.biases)

    def _list(self, name: str, rows: Matrix) -> str:
        """A matrix as one list, its rows in order: walking along it takes no index of two."""
        real, place = self.precision.type, f"{self.prefix.upper()}_TABLE"
        text = ",\n    ".join(self._table(row)[1:-1] for row in rows)
        size = len(rows) * len(rows[0])
        return f"static const {real} {name}[{size}] {place} = {{\n    {text}}};"

    def _matrix(self, name: str, rows: Matrix) -> str:
        real, place = self.precision.type, f"{self.prefix.upper()}_TABLE"
        text = ",\n    ".join(self._table(row) for row in rows)
        shape = f"[{len(rows)}][{len(rows[0])}]"
        return f"static const {real} {name}{shape} {place} = {{\n    {text}}};"

    def _read(self, table: str) -> str:
        return f"{self.prefix.upper()}_READ({table})"

    def statement(self, s: Statement) -> list[str]:
        """A statement of the routine."""
        match s:
            case Let():
                return [f"const {self.precision.type} {s.name} = {self.expression(s.value)};"]
            case Put():
                return [f"state->{s.state} = {self.expression(s.value)};"]
            case Flag():
                return [f"if ({self.expression(s.a)} < {self.expression(s.b)}) beyond = 1;"]
            case Layer():
                return self._layer(s)
            case Solve():
                return self._solve(s)
            case Filter():
                return self._filter(s)
        raise TypeError(s)

    def _layer(self, s: Layer) -> list[str]:
        real, folded = self.precision.type, fold(s)
        n, m = len(folded.inputs), len(s.biases)
        first = folded.inputs[0]
        lines, x = [], f"{s.name}_inputs"
        if isinstance(first, Item) and folded.inputs == tuple(
            Item(first.name, k) for k in range(n)
        ):
            x = first.name
        else:
            lines.append(f"const {real} {x}[{n}] = {{")
            lines += [f"    {self.expression(e)}," for e in folded.inputs]
            lines.append("};")
        side = "0"
        if folded.switch:
            e, side = folded.switch, f"{s.name}_side"
            condition = f"{self.expression(e.a)} {e.relation} {self.expression(e.b)}"
            lines.append(f"const int {side} = {condition} ? 0 : 1;")
        zero, table = self.precision.literal(0.0), f"{self.name}_{s.name}"
        out = {
            "relu": f"sum > {zero} ? sum : {zero}",
            "tanh": f"tanh{self.precision.suffix}(sum)",
            "linear": "sum",
        }[s.activation]
        return [
            *lines,
            f"const {real} *{s.name}_weight = {table}_weights;",
            f"{real} {s.name}[{m}];",
            f"for (row = 0; row < {m}; row++) {{",
            f"    {real} sum = {self._read(f'{table}_biases[{side}][row]')};",
            f"    for (column = 0; column < {n}; column++, {s.name}_weight++)",
            f"        sum += {self._read(f'*{s.name}_weight')} * {x}[column];",
            f"    {s.name}[row] = {out};",
            "}",
        ]

    def _solve(self, s: Solve) -> list[str]:
        real, literal = self.precision.type, self.precision.literal
        inner = [line for let in s.body for line in self.statement(let)]
        count = min(s.halvings, _DEEPEST) if self.precision.suffix else s.halvings
        beyond = "<" if s.rising else ">"
        return [
            f"{real} {s.name} = {literal(0.5 * (s.low + s.high))};",
            "{",
            f"    const {real} target = {self.expression(s.target)};",
            f"    {real} below = {literal(s.low)}, above = {literal(s.high)};",
            f"    for (row = 0; row < {count}; row++) {{",
            *(f"        {line}" for line in inner),
            f"        if ({self.expression(s.value)} {beyond} target) below = {s.name};",
            f"        else above = {s.name};",
            f"        {s.name} = {literal(0.5)} * (below + above);",
            "    }",
            "}",
        ]

    def _filter(self, s: Filter) -> list[str]:
        real, n, literal = self.precision.type, len(s.output), self.precision.literal
        x = f"state->{s.name}"
        sums = [f"{literal(c)} * {x}[{k}]" for k, c in enumerate(s.output) if c != 0.0]
        sums += [f"{literal(s.direct)} * {s.name}_drive"] if s.direct else []
        lines = [
            f"const {real} {s.name}_drive = {self.expression(s.drive)};",
            f"const {real} {s.name} = {' + '.join(sums) or literal(0.0)};",
        ]
        moves = []
        for k in range(n):
            terms = [f"{literal(c)} * {x}[{j}]" for j, c in enumerate(s.change[k]) if c != 0.0]
            terms += [f"{literal(s.late[k])} * {s.name}_late"] if s.late[k] != 0.0 else []
            terms += [f"{literal(s.soon[k])} * soon"] if s.soon[k] != 0.0 else []
            moves.append(f"const {real} move_{k} = {' + '.join(terms) or literal(0.0)};")
        if any(s.late):
            lines.append(f"const {real} {s.name}_late = {x}_line[state->{s.name}_at];")
        lines += [
            f"{x}_line[state->{s.name}_at] = {s.name}_drive;",
            f"state->{s.name}_at = (state->{s.name}_at + 1) % {s.delay + 1};",
            "{",
            f"    const {real} soon = {x}_line[state->{s.name}_at];"
            if s.delay
            else f"    const {real} soon = {x}_line[0];",
            *(f"    {line}" for line in moves),
            *(f"    {x}[{k}] += move_{k};" for k in range(n)),
            "}",
        ]
        return lines

    # -------------------------------------------------------------------------- function

    @property
    def signature(self) -> str:
        """The function without its end."""
        real = self.precision.type
        arguments = [f"{self.name}_state *state"] if self.routine.keeps else []
        arguments += [f"{real} {a.name}" for a in self.routine.arguments]
        return f"{real} {self.name}({', '.join(arguments)}, int *outside)"

    def structure(self) -> list[str]:
        """The type of what is kept between calls, and how it is reset; empty without."""
        if not self.routine.keeps:
            return []
        real = self.precision.type
        fields = [f"    {real} {s.name};" for s in self.routine.states]
        for f in self.routine.filters:
            fields.append(f"    {real} {f.name}[{len(f.output)}];")
            fields.append(f"    {real} {f.name}_line[{f.delay + 1}];")
            fields.append(f"    int {f.name}_at;")
        kind = f"{self.name}_state"
        return [
            "typedef struct {",
            *fields,
            f"}} {kind};",
            f"void {self.name}_reset({kind} *state);",
        ]

    def reset(self) -> list[str]:
        """The function that resets what is kept; empty without."""
        if not self.routine.keeps:
            return []
        literal = self.precision.literal
        lines = [f"    state->{s.name} = {literal(s.initial)};" for s in self.routine.states]
        loops = [(f.name, len(f.output)) for f in self.routine.filters]
        loops += [(f"{f.name}_line", f.delay + 1) for f in self.routine.filters]
        for name, size in loops:
            lines.append(f"    for (k = 0; k < {size}; k++) state->{name}[k] = {literal(0.0)};")
        lines += [f"    state->{f.name}_at = 0;" for f in self.routine.filters]
        head = ["    int k;", ""] if loops else []
        return [f"void {self.name}_reset({self.name}_state *state)", "{", *head, *lines, "}"]

    def function(self) -> list[str]:
        """The function itself."""
        r, counters = self.routine, []
        if any(isinstance(s, Layer | Solve) for s in r.body):
            counters.append("row")
        if any(isinstance(s, Layer) for s in r.body):
            counters.append("column")
        lines = ["int beyond = 0;"]
        lines += [f"int {', '.join(counters)};"] if counters else []
        for a in r.arguments:
            low, high = self.precision.literal(a.low), self.precision.literal(a.high)
            lines.append(f"if (!({a.name} >= {low})) {{ {a.name} = {low}; beyond = 1; }}")
            lines.append(f"if ({a.name} > {high}) {{ {a.name} = {high}; beyond = 1; }}")
        lines += [line for s in r.body for line in self.statement(s)]
        lines.append("if (outside) *outside = beyond;")
        lines.append(f"return {self.expression(r.value)};")
        return [self.signature, "{", *(f"    {line}" for line in lines), "}"]


def uses(routine: Routine, function: str) -> bool:
    """Whether a routine needs a function of two numbers, such as ``min``."""
    found: list[Expression] = [routine.value]
    for s in routine.body:
        match s:
            case Let() | Put():
                found.append(s.value)
            case Layer():
                found += s.inputs
            case Solve():
                found += [s.value, s.target, *(let.value for let in s.body)]
            case Filter():
                found.append(s.drive)
            case Flag():
                found += [s.a, s.b]
    while found:
        e = found.pop()
        match e:
            case Unary():
                found.append(e.x)
            case Binary():
                if e.function == function:
                    return True
                found += [e.a, e.b]
            case Choose():
                found += [e.a, e.b, e.yes, e.no]
    return False
