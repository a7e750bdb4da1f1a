"""Reads the part of IEC 61131-3 Structured Text that exports use, from the text alone."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

TOKEN = re.compile(
    r"(?P<skip>\s+|\(\*.*?\*\)|\{[^{}]*\})|(?P<real>\d+\.\d+(?:E[+-]?\d+)?)|(?P<int>\d+)"
    r"|(?P<word>[A-Za-z][A-Za-z0-9]*(?:_[A-Za-z0-9]+)*)(?![A-Za-z0-9_])"
    r"|(?P<sign>:=|\.\.|<=|>=|<>|[-+*/()\[\],;:.<>=])",
    re.DOTALL,
)
FUNCTIONS: Mapping[str, Callable[..., float]] = {
    "ABS": abs, "SQRT": math.sqrt, "EXP": math.exp, "LN": math.log, "MIN": min, "MAX": max,
    "LIMIT": lambda low, x, high: min(max(x, low), high),
}  # fmt: skip
_WORDS = """
VAR VAR_INPUT VAR_OUTPUT VAR_TEMP VAR_GLOBAL CONSTANT END_VAR FUNCTION_BLOCK ARRAY OF IF THEN
END_FUNCTION_BLOCK ELSIF ELSE END_IF FOR TO BY DO END_FOR NOT AND OR XOR MOD TRUE FALSE LREAL REAL
BOOL DINT INT STEP TIME DATE ON AT S R SEL WHILE REPEAT CASE EXIT RETURN
"""
KEYWORDS = frozenset(_WORDS.split())
TYPES: Mapping[str, type] = {"LREAL": float, "BOOL": bool, "DINT": int}


class StructuredTextError(Exception):
    """What a compiler or the controller would object to."""


def tokens(text: str) -> list[tuple[str, str]]:
    """Kind and text of every token; comments and pragmas are left out."""
    found, at = [], 0
    while at < len(text):
        match = TOKEN.match(text, at)
        if match is None:
            raise StructuredTextError(f"no token: {text[at : at + 40]!r}")
        at, kind = match.end(), str(match.lastgroup)
        if kind != "skip":
            found.append((kind, match[0].upper() if kind == "word" else match[0]))
        elif "(*" in match[0][2:] or not match[0].isascii():
            raise StructuredTextError(f"comment: {match[0]!r}")
    return found


@dataclass
class Declaration:
    """A variable: its type, the ranges of an array, and its value before the first call."""

    kind: str
    ranges: tuple[tuple[int, int], ...]
    initial: list[Any] | None
    constant: bool = False
    section: str = ""


@dataclass
class Block:
    """A function block as it is declared."""

    variables: dict[str, Declaration] = field(default_factory=dict)
    body: list[Any] = field(default_factory=list)


class Parser:
    """Recursive descent; statements and expressions become tuples."""

    LEVELS = (("OR",), ("XOR",), ("AND",), ("=", "<>"), ("<", ">", "<=", ">="), ("+", "-"),
              ("*", "/", "MOD"))  # fmt: skip

    def __init__(self, text: str) -> None:
        self.tokens, self.at = [*tokens(text), ("end", "")], 0
        self.constants: dict[str, Declaration] = {}
        self.blocks: dict[str, Block] = {}
        while self.peek() != "":
            if self.peek() == "VAR_GLOBAL":
                self.variables(self.constants)
            else:
                self.block()

    def peek(self) -> str:
        return self.tokens[self.at][1]

    def next(self, *wanted: str) -> str:
        kind, word = self.tokens[self.at]
        if wanted and word not in wanted and kind not in wanted:
            near = " ".join(w for _, w in self.tokens[max(self.at - 8, 0) : self.at + 3])
            raise StructuredTextError(f"{word!r} where {wanted} is expected: {near}")
        self.at += 1
        return word

    def skip(self, *words: str) -> bool:
        if self.peek() in words:
            self.at += 1
            return True
        return False

    def identifier(self) -> str:
        name = self.next("word")
        if name in KEYWORDS or name in FUNCTIONS:
            raise StructuredTextError(f"{name} is no identifier")
        return name

    def block(self) -> None:
        self.next("FUNCTION_BLOCK")
        name, block = self.identifier(), Block()
        if name in self.blocks:
            raise StructuredTextError(f"{name} is declared twice")
        while self.peek() in ("VAR", "VAR_INPUT", "VAR_OUTPUT", "VAR_TEMP"):
            self.variables(block.variables)
        block.body = self.statements("END_FUNCTION_BLOCK")
        self.next("END_FUNCTION_BLOCK")
        self.blocks[name] = block

    def variables(self, into: dict[str, Declaration]) -> None:
        section, constant = self.next(), self.skip("CONSTANT")
        while not self.skip("END_VAR"):
            name = self.identifier()
            if name in into:
                raise StructuredTextError(f"{name} is declared twice")
            self.next(":")
            into[name] = self.declaration()
            into[name].section, into[name].constant = section, constant
            self.next(";")

    def declaration(self) -> Declaration:
        ranges: list[tuple[int, int]] = []
        if self.skip("ARRAY"):
            self.next("[")
            while not ranges or self.skip(","):
                low = int(self.next("int"))
                self.next("..")
                ranges.append((low, int(self.next("int"))))
            self.next("]")
            self.next("OF")
        kind = self.next("word")
        initial = None
        if self.skip(":="):
            initial = self.initial(kind, bool(ranges))
            if len(initial) != math.prod(high - low + 1 for low, high in ranges):
                raise StructuredTextError(f"{len(initial)} values for {ranges}")
        return Declaration(kind, tuple(ranges), initial)

    def initial(self, kind: str, several: bool) -> list[Any]:
        if not several:
            return [self.constant(kind)]
        self.next("[")
        values = [self.constant(kind)]
        while self.skip(","):
            values.append(self.constant(kind))
        self.next("]")
        return values

    def constant(self, kind: str) -> Any:
        sign = -1 if self.skip("-") else 1
        if kind == "BOOL":
            return self.next("TRUE", "FALSE") == "TRUE"
        return sign * (int(self.next("int")) if kind == "DINT" else float(self.next("real")))

    def statements(self, *ends: str) -> list[Any]:
        found = []
        while self.peek() not in ends:
            if self.skip("IF"):
                found.append(self.if_statement())
            elif self.skip("FOR"):
                found.append(self.for_statement())
            else:
                found.append(self.simple_statement())
        return found

    def if_statement(self) -> Any:
        ways = []
        while not ways or self.skip("ELSIF"):
            condition = self.expression()
            self.next("THEN")
            ways.append((condition, self.statements("ELSIF", "ELSE", "END_IF")))
        otherwise = self.statements("END_IF") if self.skip("ELSE") else []
        self.next("END_IF")
        self.next(";")  # IEC 61131-3 asks for it behind every statement
        return "if", ways, otherwise

    def for_statement(self) -> Any:
        counter = self.identifier()
        self.next(":=")
        first = self.expression()
        self.next("TO")
        last = self.expression()
        self.next("DO")
        body = self.statements("END_FOR")
        self.next("END_FOR")
        self.next(";")
        return "for", counter, first, last, body

    def simple_statement(self) -> Any:
        name = self.identifier()
        if self.skip("("):
            given = {}
            while not self.skip(")"):
                key = self.identifier()
                self.next(":=")
                given[key] = self.expression()
                self.skip(",")
            self.next(";")
            return "call", name, given
        subscripts = self.subscripts()
        self.next(":=")
        value = self.expression()
        self.next(";")
        return "assign", name, subscripts, value

    def subscripts(self) -> list[Any]:
        found: list[Any] = []
        if self.skip("["):
            while not found or self.skip(","):
                found.append(self.expression())
            self.next("]")
        return found

    def expression(self, level: int = 0) -> Any:
        if level == len(self.LEVELS):
            return self.unary()
        found = self.expression(level + 1)
        while self.peek() in self.LEVELS[level]:
            found = ("binary", self.next(), found, self.expression(level + 1))
        return found

    def unary(self) -> Any:
        if self.peek() in ("-", "NOT"):
            return "unary", self.next(), self.unary()
        kind = self.tokens[self.at][0]
        word = self.next("real", "int", "word", "(")
        if kind in ("real", "int"):
            return "constant", float(word) if kind == "real" else int(word)
        if word == "(":
            found = self.expression()
            self.next(")")
            return found
        if word in ("TRUE", "FALSE"):
            return "constant", word == "TRUE"
        if word in FUNCTIONS:
            self.next("(")
            given = [self.expression()]
            while self.skip(","):
                given.append(self.expression())
            self.next(")")
            return "function", word, given
        if word in KEYWORDS:
            raise StructuredTextError(f"{word} is no value")
        if self.skip("."):
            return "output", word, self.identifier()
        return "variable", word, self.subscripts()
