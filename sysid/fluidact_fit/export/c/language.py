"""Words of C99: literals, identifiers, long lines, and what functions share."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...routines import Routine
from ...routines.expression import Binary, Choose, Expression, Number, walk
from ...routines.routine import Layer, Matrix, Solve, Statement, as_matrix
from ...routines.sharing import expressions_of

WIDTH = 100
_C_WORDS = """
state outside beyond row column sum k abs acos asin atan ceil cos exp fabs floor fmod log
main pow sin sqrt tan tanh index time signal double float int long short auto break case
char const continue default do else enum extern for goto if inline register restrict
return signed sizeof static struct switch typedef union unsigned void volatile while y0 y1
yn j0 j1 jn gamma div
"""
_TAKEN = frozenset(_C_WORDS.split())


@dataclass(frozen=True)
class Precision:
    """The type of all numbers, and what ends their literals and the names of functions."""

    type: Literal["float", "double"]
    suffix: Literal["f", ""]

    def literal(self, value: float) -> str:
        """A constant, to the last digit that the type holds."""
        value = value + 0.0  # no zero has a sign
        if np.isnan(value):
            return "NAN"
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


class Names:
    """Identifiers of one function: none is given twice, none hides one of C."""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self._taken = {*_TAKEN, *taken}

    def new(self, wanted: str) -> str:
        """Return the wanted identifier where it is free, else one that resembles it."""
        name, number = wanted, 0
        while name in self._taken:
            number += 1
            name = f"{wanted}_{number}"
        self._taken.add(name)
        return name


def helpers(routines: Sequence[Routine], prefix: str, precision: Precision) -> list[str]:
    """Functions that those of the routines call."""
    real, lines = precision.type, list[str]()
    if any(r.arguments for r in routines):
        lines += [
            f"static {real} {prefix}_within({real} given, {real} low, {real} high, int *beyond)",
            "{",
            f"    {real} found = given;",
            "    if (!(given >= low)) { /* also what is not a number */",
            "        found = low;",
            "        *beyond = 1;",
            "    } else if (given > high) {",
            "        found = high;",
            "        *beyond = 1;",
            "    } else {",
            "        /* it is within the range */",
            "    }",
            "    return found;",
            "}",
            "",
        ]
    for name, relation in (("min", "<"), ("max", ">")):
        if any(uses(r, name) for r in routines):
            lines += [
                f"static {real} {prefix}_{name}({real} a, {real} b)", "{",
                f"    return (a {relation} b) ? a : b;", "}", "",
            ]  # fmt: skip
    return lines


def wrapped(line: str, indent: str, further: str | None = None, width: int = WIDTH) -> list[str]:
    """A line of C, broken at blanks where it is long."""
    within = indent + "    " if further is None else further
    return textwrap.wrap(
        line, width, initial_indent=indent, subsequent_indent=within,
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip


def unread(lines: Sequence[str], names: Iterable[str]) -> list[str]:
    """The lines of a function, with no variable for an argument that nothing depends on.

    It is still held against its range, for the flag.
    """
    text = "\n".join(lines)
    for name in names:
        if len(re.findall(rf"\b{name}\b", text)) == 1:
            text = re.sub(rf"const \w+ {name} = ", "(void)", text)
    return text.split("\n")


def uses(routine: Routine, function: str) -> bool:
    """Return whether a routine needs a function of two numbers, such as ``min``."""
    found = (routine.value, *(e for s in routine.body for e in _expressions(s)))
    return any(
        isinstance(part, Binary) and part.function == function for e in found for part in walk(e)
    )


def _expressions(s: Statement) -> Iterator[Expression]:
    yield from expressions_of(s)
    if isinstance(s, Solve):
        yield s.value
        yield from (let.value for let in s.body)
