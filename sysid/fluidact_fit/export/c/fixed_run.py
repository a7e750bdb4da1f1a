"""Fixed-point C run in Python, to the last bit: what the self-test expects of every controller.

The statements of a sheet are read as the C that they are, over arrays of int64. No intermediate
result leaves its type, as the bounds of :mod:`.fixed_code` see to; casts are done.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..mutants import SHARE
from .fixed import Fixed
from .fixed_sheet import Line, Lookup
from .fixed_table import Integers

_TOKEN = re.compile(r"\d+u?|0x[0-9a-fA-F]+|\w+|>>|<=|>=|[-+*/()<>?:,\[\]]")
_CONSTANT = re.compile(r"(?<![\w.])(?:INT(?:32|64)_C\()?(\d+)(?=[u)]|\b)")
_TYPES: Mapping[str, Any] = {
    f"{sign}int{bits}_t": getattr(np, f"{sign}int{bits}")
    for sign in ("", "u")
    for bits in (16, 32, 64)
}
_LEVELS: tuple[Mapping[str, Callable[[Any, Any], Any]], ...] = (
    {"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal},
    {">>": np.right_shift},
    {"+": np.add, "-": np.subtract},
    {"*": np.multiply, "/": lambda a, b: np.sign(a) * np.sign(b) * (np.abs(a) // np.abs(b))},
)


@dataclass(frozen=True)
class Program:
    """A function in fixed point, ready to run.

    Attributes
    ----------
    arguments
        Names with the ends of their ranges.
    lines
        Statements in order, tables with their entries.
    output, flags
        Name of the result, and conditions that set the flag.
    biases
        Of layers that choose between two rows of them.
    """

    arguments: tuple[tuple[str, int, int], ...]
    lines: tuple[Line, ...]
    output: str
    flags: tuple[str, ...]
    biases: Mapping[str, tuple[tuple[int, ...], ...]]

    @classmethod
    def of(cls, f: Fixed) -> Program:
        """Take what a function needs of its sheet."""
        ends = tuple((a.name, *ends_of) for a, ends_of in zip(f.routine.arguments, f.ends))
        return cls(ends, tuple(f.code.needed(" ".join([f.output.text, *f.flags]))),
                   f.output.text, f.flags, dict(f.code.biases))  # fmt: skip

    def __call__(self, rows: Integers) -> tuple[Integers, Any]:
        """Outputs and flags for arguments ``(n, k)``."""
        names, outside = self._names(rows)
        for condition in self.flags:
            outside |= np.asarray(self._value(condition, names), dtype=bool)
        found = np.broadcast_to(self._value(self.output, names), (len(rows),))
        return found.astype(np.int64), outside

    def _names(self, rows: Integers) -> tuple[dict[str, Any], Any]:
        """Return the outputs of every step, and which arguments were clamped."""
        names: dict[str, Any] = {}
        outside = np.zeros(len(rows), dtype=bool)
        for (name, low, high), given in zip(self.arguments, rows.T.astype(np.int64)):
            names[f"{name}_used"] = np.clip(given, low, high)
            outside |= (given < low) | (given > high)
        anywhere = np.zeros(len(rows), dtype=np.int64)  # in a curve that is flat all over
        for line in self.lines:
            if isinstance(line.value, Lookup):
                place = names.get(line.value.place, anywhere)
                names[line.name] = _looked_up(line.value, place)
            else:
                names[line.name] = self._value(line.value, names)
        return names, outside

    def spread(self, rows: Integers, each: int, rng: np.random.Generator) -> Integers:
        """Some of the rows: a few for each place of every table that is read with them."""
        names = self._names(rows)[0]
        wanted: set[int] = set()
        for line in self.lines:
            if isinstance(line.value, Lookup) and line.value.place in names:
                cells = np.broadcast_to(_cells(line.value, names[line.value.place]), len(rows))
                for _ in range(each):
                    order = rng.permutation(len(rows))
                    wanted.update(order[np.unique(cells[order], return_index=True)[1]].tolist())
        return rows[sorted(wanted)]

    def _value(self, text: str, names: Mapping[str, Any]) -> Any:
        return _Reader(text, names, self.biases).choice()

    def mutants(self) -> Iterable[Program]:
        """Yield the function with every constant changed by a share of it, where that is a unit.

        Powers of two stay: they are units, halves of units and shifts.
        """
        for k, (name, low, high) in enumerate(self.arguments):
            for ends in [(x, high) for x in _others(low)] + [(low, x) for x in _others(high)]:
                changed = (*self.arguments[:k], (name, *ends), *self.arguments[k + 1 :])
                yield replace(self, arguments=changed)
        for k, line in enumerate(self.lines):
            for value in _changed_line(line):
                lines = (*self.lines[:k], replace(line, value=value), *self.lines[k + 1 :])
                yield replace(self, lines=lines)
        for k, condition in enumerate(self.flags):
            for text in _changed_text(condition):
                yield replace(self, flags=(*self.flags[:k], text, *self.flags[k + 1 :]))
        for layer, rows in self.biases.items():
            for i, row in enumerate(rows):
                for j, bias in enumerate(row):
                    for other in _others(bias):
                        new = (*rows[:i], (*row[:j], other, *row[j + 1 :]), *rows[i + 1 :])
                        yield replace(self, biases={**self.biases, layer: new})


def _others(number: int) -> set[int]:
    """A number one per cent larger and smaller, as far as whole numbers tell that."""
    return {round(number * (1.0 + s)) for s in (SHARE, -SHARE)} - {number}


def _changed_line(line: Line) -> Iterable[str | Lookup]:
    value = line.value
    if isinstance(value, Lookup):
        entries = value.table.entries
        for k, entry in enumerate(entries):
            for other in _others(entry):
                table = replace(value.table, entries=(*entries[:k], other, *entries[k + 1 :]))
                yield replace(value, table=table)
        pieces = value.table.pieces
        for k, piece in enumerate(pieces[:-1]):
            for other in _others(piece.last):
                changed = (*pieces[:k], replace(piece, last=other), *pieces[k + 1 :])
                yield replace(value, table=replace(value.table, pieces=changed))
        return
    yield from _changed_text(value)


def _changed_text(text: str) -> Iterable[str]:
    for found in _CONSTANT.finditer(text):
        number = int(found[1])
        if number & (number - 1):
            for other in _others(number):
                yield f"{text[: found.start(1)]}{other}{text[found.end(1) :]}"


def _cells(lookup: Lookup, place: Any) -> Integers:
    """C code that finds the table entry before a place."""
    found = np.zeros(np.shape(place), dtype=np.int64)
    for piece in lookup.table.pieces:
        here = np.asarray(place) >= piece.first
        step = (np.asarray(place) - piece.first) >> max(piece.shift, 0)
        found = np.where(here, piece.start + np.minimum(step, max(piece.cells - 1, 0)), found)
    return found


def _looked_up(lookup: Lookup, place: Any) -> Integers:
    """Compute as the C code of :meth:`.Sheet.lookup` does."""
    entries = np.array(lookup.table.entries, dtype=np.int64)
    found = np.zeros(np.shape(place), dtype=np.int64)
    rest = np.ones(np.shape(place), dtype=bool)
    pieces = lookup.table.pieces
    for piece in pieces:
        here = rest if piece is pieces[-1] else rest & (place <= piece.last)
        rest = rest & ~here
        if piece.shift < 0:
            found[here] = entries[piece.start]
            continue
        u = (place[here] - piece.first) & 0xFFFF
        cell = np.minimum(u >> piece.shift, piece.cells - 1) if piece.cells > 1 else 0 * u
        part = (u << (16 - piece.shift)) & 0xFFFF
        low, above = entries[piece.start + cell], entries[piece.start + cell + 1]
        found[here] = low + (((above - low) * part + 0x8000) >> 16)
    return found


def _whole_root(radicand: Any) -> Integers:
    """Whole part of a square root of up to 62 bits: the nearest double, put right by one."""
    root = np.asarray(np.sqrt(radicand)).astype(np.int64)
    root -= root * root > radicand
    return root + ((root + 1) * (root + 1) <= radicand)


class _Reader:
    """An expression of C over arrays, read from the left to the right."""

    def __init__(
        self, text: str, names: Mapping[str, Any],
        biases: Mapping[str, tuple[tuple[int, ...], ...]],
    ) -> None:  # fmt: skip
        self.tokens, self.at = _TOKEN.findall(text), 0
        self.names, self.biases = names, biases

    def _next(self) -> str:
        self.at += 1
        return str(self.tokens[self.at - 1])

    def _is(self, *words: str) -> bool:
        return self.at < len(self.tokens) and self.tokens[self.at] in words

    def _expect(self, word: str) -> None:
        found = self._next()
        if found != word:
            raise ValueError(f"{found} where {word} was expected")

    def choice(self) -> Any:
        """Read a choice, or what binds more."""
        condition = self._level(0)
        if not self._is("?"):
            return condition
        self._next()
        yes = self.choice()
        self._expect(":")
        return np.where(condition, yes, self.choice())

    def _level(self, level: int) -> Any:
        if level == len(_LEVELS):
            return self._factor()
        value = self._level(level + 1)
        while self._is(*_LEVELS[level]):
            operator = _LEVELS[level][self._next()]
            value = operator(value, self._level(level + 1))
        return value

    def _factor(self) -> Any:
        word = self._next()
        if word == "-":
            return -self._factor()
        if word == "(":
            if self._is(*_TYPES):
                kind = _TYPES[self._next()]
                self._expect(")")
                return np.asarray(self._factor()).astype(kind).astype(np.int64)
            value = self.choice()
            self._expect(")")
            return value
        if word[0].isdigit():
            return np.int64(int(word.rstrip("u"), 0))
        if not self._is("("):
            return self.names[word]
        self._next()
        value = self._bias() if word.endswith("_READ_LONG") else self.choice()
        self._expect(")")
        if "_sqrt" in word:
            return _whole_root(np.maximum(value, 0))
        return value

    def _bias(self) -> Any:
        """``table[row][column]`` of the biases of a layer."""
        table = self._next()
        indices = []
        for _ in range(2):
            self._expect("[")
            indices.append(self.choice())
            self._expect("]")
        rows = self.biases[table.removesuffix("_biases")]
        return np.array(rows, dtype=np.int64)[np.asarray(indices[0], dtype=int), int(indices[1])]
