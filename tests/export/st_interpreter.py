"""Runs the part of IEC 61131-3 Structured Text that exports use.

Strict where a compiler is: whatever is not declared, has another type, lies beyond an array or is
constant and assigned raises ``StructuredTextError``. LREAL is a Python float, DINT an int.
"""

from __future__ import annotations

import math
from typing import Any

from st_parser import FUNCTIONS, TYPES, Declaration, Parser, StructuredTextError


class Instance:
    """A function block with what it keeps; called with its inputs, it returns its outputs."""

    def __init__(self, parser: Parser, name: str) -> None:
        self.block, self.values = parser.blocks[name.upper()], dict[str, Any]()
        for key, d in self.block.variables.items():
            if d.kind in parser.blocks and not d.ranges:
                self.values[key] = Instance(parser, d.kind)
            elif d.kind in TYPES:
                self.values[key] = self.start(d)
            else:
                raise StructuredTextError(f"{d.kind} is no type")

    @staticmethod
    def start(d: Declaration) -> Any:
        count = math.prod(high - low + 1 for low, high in d.ranges)
        values = list(d.initial) if d.initial is not None else [TYPES[d.kind]()] * count
        return values if d.ranges else values[0]

    def __call__(self, **given: Any) -> dict[str, Any]:
        for key, d in self.block.variables.items():
            if d.section == "VAR_TEMP":
                self.values[key] = self.start(d)
        for key, value in given.items():
            d = self.declared(key.upper())
            if d.section != "VAR_INPUT" or type(value) is not TYPES[d.kind]:
                raise StructuredTextError(f"{key} := {value!r} is no input")
            self.values[key.upper()] = value
        self.run(self.block.body)
        return {
            key.lower(): self.values[key]
            for key, d in self.block.variables.items()
            if d.section == "VAR_OUTPUT"
        }

    def declared(self, name: str) -> Declaration:
        if name not in self.block.variables:
            raise StructuredTextError(f"{name} is not declared")
        return self.block.variables[name]

    def run(self, statements: list[Any]) -> None:
        for s in statements:
            if s[0] == "assign":
                self.assign(s[1], s[2], self.value(s[3]))
            elif s[0] == "call":
                self.values[s[1]](**{k: self.value(e) for k, e in s[2].items()})
            elif s[0] == "for":
                for k in range(self.whole(s[2]), self.whole(s[3]) + 1):
                    self.assign(s[1], [], k)
                    self.run(s[4])
            else:
                chosen = next((b for c, b in s[1] if self.truth(self.value(c))), s[2])
                self.run(chosen)

    def assign(self, name: str, subscripts: list[Any], value: Any) -> None:
        d = self.declared(name)
        if d.constant or d.section == "VAR_INPUT" or type(value) is not TYPES[d.kind]:
            raise StructuredTextError(f"{name} : {d.kind} cannot become {value!r}")
        if d.ranges:
            self.values[name][self.place(d, subscripts)] = value
        elif subscripts:
            raise StructuredTextError(f"{name} is no array")
        else:
            self.values[name] = value

    def place(self, d: Declaration, subscripts: list[Any]) -> int:
        if len(subscripts) != len(d.ranges):
            raise StructuredTextError(f"{len(subscripts)} subscripts for {d.ranges}")
        at = 0
        for e, (low, high) in zip(subscripts, d.ranges):
            k = self.whole(e)
            if not low <= k <= high:
                raise StructuredTextError(f"{k} is beyond {low}..{high}")
            at = at * (high - low + 1) + k - low
        return at

    def whole(self, e: Any) -> int:
        value = self.value(e)
        if type(value) is not int:
            raise StructuredTextError(f"{value!r} is no DINT")
        return value

    @staticmethod
    def truth(value: Any) -> bool:
        if type(value) is not bool:
            raise StructuredTextError(f"{value!r} is no BOOL")
        return value

    def value(self, e: Any) -> Any:
        match e:
            case ("constant", x):
                return x
            case ("variable", name, subscripts):
                d = self.declared(name)
                if bool(d.ranges) != bool(subscripts):
                    raise StructuredTextError(f"subscripts of {name}")
                return (
                    self.values[name][self.place(d, subscripts)] if d.ranges else self.values[name]
                )
            case ("output", name, field_name):
                inner = self.values[name]
                if inner.declared(field_name).section != "VAR_OUTPUT":
                    raise StructuredTextError(f"{name}.{field_name} is no output")
                return inner.values[field_name]
            case ("unary", "NOT", x):
                return not self.truth(self.value(x))
            case ("unary", "-", x):
                return self.number(-self.value(x))
            case ("function", name, given):
                return FUNCTIONS[name](*(self.real(self.value(g)) for g in given))
            case ("binary", sign, a, b):
                return self.binary(sign, self.value(a), self.value(b))
        raise StructuredTextError(repr(e))

    @staticmethod
    def number(value: Any) -> Any:
        if type(value) not in (int, float):
            raise StructuredTextError(f"{value!r} is no number")
        return value

    @staticmethod
    def real(value: Any) -> float:
        if type(value) is not float:
            raise StructuredTextError(f"{value!r} is no LREAL")
        return value

    def binary(self, sign: str, a: Any, b: Any) -> Any:
        if type(a) is not type(b):
            raise StructuredTextError(f"{a!r} {sign} {b!r}")
        if sign in ("OR", "AND", "XOR"):
            a, b = self.truth(a), self.truth(b)
            return {"OR": a or b, "AND": a and b, "XOR": a != b}[sign]
        if sign in ("=", "<>"):
            return (a == b) == (sign == "=")
        self.number(a)
        if sign in ("<", ">", "<=", ">="):
            return {"<": a < b, ">": a > b, "<=": a <= b, ">=": a >= b}[sign]
        if sign == "MOD":
            return math.fmod(a, b) if type(a) is float else int(math.fmod(a, b))
        if sign == "/":
            return self.real(a) / self.real(b)
        return {"+": a + b, "-": a - b, "*": a * b}[sign]
