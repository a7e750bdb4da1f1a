"""Expressions as C99: numbers by their names, long parts as statements, choices as branches.

Numbers other than 0, 1, 2 and a half stand under names: those of the parameters where the header
has them, else of the routine.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from ...routines import Routine
from ...routines.expression import Binary, Choose, Expression, Item, Name, Number, Unary
from ...routines.routine import State
from ...routines.sharing import shared, word_of
from ..branches import Branches, Words, has_choice
from .language import Names, Precision, wrapped

_OPERATORS = {"+": "+", "-": "-", "*": "*", "/": "/"}
_PLAIN = (0.0, 0.5, 1.0, 2.0)  # numbers that say nothing of a machine
_LONG = 84  # signs of an expression: what is longer and part of another gets a name


class Expressions(Branches):
    """Expressions of a routine, and the statements that they need before them.

    Parameters
    ----------
    routine
        What is written; what it computes twice is computed once.
    prefix
        Begins every name that it gives.
    precision
        Of all numbers.
    macros
        Numbers that the header names.
    """

    words = Words(
        "if ({}) {{", "}} else if ({}) {{", "} else {", "}", "{} = {};", " || ",
        "!(({0} >= {1}) || ({0} < {1}))", "!(({0} >= {1}) && ({0} <= {2}))", "beyond = 1;",
        ("/* nothing to compute from: the last output stands */", "beyond = 1;"),
    )  # fmt: skip

    def __init__(
        self, routine: Routine, prefix: str, precision: Precision,
        macros: Mapping[str, float] | None = None,
    ) -> None:  # fmt: skip
        self.routine, self.prefix, self.precision = shared(routine), prefix, precision
        named, times = macros or {}, Counter((macros or {}).values())
        # two parameters of one value: which is meant is not known
        self._macros = {value: name for name, value in named.items() if times[value] == 1}
        self._constants: dict[str, float] = {}
        self._named = dict(named)
        self._names = Names(a.name for a in routine.arguments)
        self._states = {s.name: f"state->{s.name}" for s in routine.states}
        self._known = dict(self._states)
        self._body: list[str] = []
        self._depth = 1

    @property
    def name(self) -> str:
        """Name of the function."""
        return f"{self.prefix}_{self.routine.name}"

    # ------------------------------------------------------------------------- constants

    def _number(self, value: float, name: str = "") -> str:
        """A number by its name; negative ones in parentheses."""
        if abs(value) in _PLAIN and not name:
            text = self.precision.literal(abs(value))
            return f"(-{text})" if value < 0.0 else text
        for sign, text in ((1.0, "{}"), (-1.0, "(-{})")):
            own = f"{self.prefix}_{name}".upper()
            if self._named.get(own) == sign * value:
                return text.format(own)
            if sign * value in self._macros:
                return text.format(self._macros[sign * value])
        if value < 0.0:
            return f"(-{self._number(-value, name)})"
        wanted = f"{self.name}_{name or self._context}".upper()
        number, macro = 0, wanted
        while macro in self._named or self._constants.get(macro, value) != value:
            number += 1
            macro = f"{wanted}_{number}"
        self._constants[macro] = value
        return macro

    def _start_of(self, s: State) -> str:
        """Value of a state after a reset, by its name where it belongs to the machine."""
        plain = abs(s.initial) in _PLAIN
        return self._number(s.initial, "" if plain else f"{s.name}_start")

    def _limit(self, value: float, name: str) -> str:
        """A number that has a name even where it is a plain one, such as the end of a range."""
        macro = f"{self.name}_{name}".upper()
        self._constants[macro] = value
        return macro

    # ----------------------------------------------------------------------- expressions

    def _say(self, *lines: str) -> None:
        for line in lines:
            indent = "    " * self._depth + line[: len(line) - len(line.lstrip())]
            self._body += wrapped(line.lstrip(), indent)

    def _text_of(self, e: Expression) -> str:
        """An expression that stands alone."""
        text = self._written(e)
        return text[1:-1] if isinstance(e, Binary | Choose) and _enclosed(text) else text

    def _text(self, e: Expression) -> str:
        """An expression, in parentheses where it has an operator.

        What is long becomes a statement that stands before.
        """
        text = self._written(e)
        if len(text) > _LONG and isinstance(e, Unary | Binary) and not self._whole:
            name = self._names.new(word_of(e))
            bare = text[1:-1] if _enclosed(text) else text
            self._say(f"const {self.precision.type} {name} = {bare};")
            return name
        return text

    def _written(self, e: Expression) -> str:
        match e:
            case Number():
                return self._number(e.value, e.name)
            case Name():
                return self._known[e.name]
            case Item():
                return f"{self._known[e.name]}[{e.index}]"
            case Unary(function="neg"):
                return f"(-{self._text(e.x)})"
            case Unary():
                function = "fabs" if e.function == "abs" else e.function
                return f"{function}{self.precision.suffix}({self._text_of(e.x)})"
            case Binary() if e.function in _OPERATORS:
                return f"({self._left(e)} {e.function} {self._text(e.b)})"
            case Binary():
                return f"{self.prefix}_{e.function}({self._text_of(e.a)}, {self._text_of(e.b)})"
            case Choose():
                if _is_short(e):
                    return f"(({self._condition(e)}) ? {self._text(e.yes)} : {self._text(e.no)})"
                chosen = self._names.new("chosen")
                self._assign(chosen, e, declare=True)
                return chosen
        raise TypeError(e)

    def _left(self, e: Binary) -> str:
        """The left side of an operator; a chain of one operator needs no parentheses."""
        text = self._text(e.a)
        if isinstance(e.a, Binary) and e.a.function == e.function and _enclosed(text):
            return text[1:-1]
        return text

    def _side(self, e: Expression) -> str:
        return self._text(e)

    def _assign(self, target: str, e: Expression, declare: bool = False) -> None:
        """Give a variable a value: a long choice by branches, of which one is computed."""
        if not isinstance(e, Choose) or _is_short(e):
            kind = f"const {self.precision.type} " if declare else ""
            self._say(f"{kind}{target} = {self._text_of(e)};")
            return
        if declare:
            self._say(f"{self.precision.type} {target};")
        self._branch(target, e)

    def _sum(self, terms: Sequence[tuple[float, str, str]]) -> str:
        """Sum of products with constants, by value and name; those with zero are left out."""
        products = [
            x if c == 1.0 else f"({self._number(c, f'{self._context}_{name}')} * {x})"
            for c, name, x in terms
            if c != 0.0
        ]
        if len(products) == 1 and _enclosed(products[0]):
            return products[0][1:-1]
        return " + ".join(products) or self.precision.literal(0.0)


def _is_short(e: Choose) -> bool:
    """Return whether a choice is between values that are at hand."""
    if has_choice(e.a) or has_choice(e.b):
        return False
    return all(isinstance(x, Number | Name | Item) or _is_negated(x) for x in (e.yes, e.no))


def _is_negated(e: Expression) -> bool:
    return isinstance(e, Unary) and e.function == "neg" and isinstance(e.x, Name)


def _enclosed(text: str) -> bool:
    """Return whether the first parenthesis of a text is closed by its last sign."""
    depth = 0
    for k, sign in enumerate(text):
        depth += {"(": 1, ")": -1}.get(sign, 0)
        if depth == 0:
            return k == len(text) - 1 and text[0] == "("
    return False
