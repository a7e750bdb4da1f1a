"""Statements of routines in the words of a language; of the branches of a choice one is run."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from ..routines import Argument, Filter, Routine, Solve
from ..routines.expression import Choose, Expression, Item, walk
from ..routines.statements import Flag, Layer, Let, Put, Statement

INDENT = "    "


@dataclass(frozen=True)
class Words:
    """Keywords of branches, assignment, and ``either`` between conditions of which one is enough.

    ``not_a_number`` and ``not_within`` are conditions on an argument and the ends of its range,
    ``flagged`` sets the flag, and ``stands`` is what is done where nothing is computed.
    """

    first: str
    further: str
    otherwise: str
    end: str
    put: str
    either: str
    not_a_number: str
    not_within: str
    flagged: str
    stands: tuple[str, ...]


class Branches(ABC):
    """Writes the statements of a routine in a language with these words."""

    words: ClassVar[Words]
    routine: Routine
    _depth: int
    _context = ""  # name of what is computed
    _whole = False  # while a condition is written that no statement can stand before
    _known: dict[str, str]  # name in the routine: what holds it now
    _states: dict[str, str]
    _ends: dict[str, tuple[str, str, str]]  # of an argument: as given, and ends of its range

    @abstractmethod
    def _say(self, *lines: str) -> None:
        """Add lines at the depth of the branch."""

    @abstractmethod
    def _assign(self, target: str, e: Expression) -> None:
        """Give a variable a value."""

    @abstractmethod
    def _side(self, e: Expression) -> str:
        """Side of a comparison."""

    @abstractmethod
    def _let(self, s: Let) -> None:
        """Give a new variable a value."""

    @abstractmethod
    def _layer(self, s: Layer) -> None:
        """Write a layer of a network."""

    @abstractmethod
    def _solve(self, s: Solve) -> None:
        """Write a search; see :meth:`_halve`."""

    @abstractmethod
    def _filter(self, s: Filter) -> None:
        """Write a difference equation."""

    def _compute(self) -> None:
        """Write all statements; where there may be nothing to compute from, in a branch."""
        r, words = self.routine, self.words
        if r.careful and r.keeps:
            self._say(words.first.format(words.either.join(map(self._unreadable, r.arguments))))
            self._depth += 1
            self._say(*words.stands)
            for put in r.interrupted:
                self._assign(self._states[put.state], put.value)
            self._depth -= 1
            self._say(words.otherwise)
            self._depth += 1
        for s in r.body:
            self._run(s)
        if r.careful and r.keeps:
            self._depth -= 1
            self._say(words.end)

    def _unreadable(self, a: Argument) -> str:
        """Condition under which nothing is computed from an argument."""
        condition = self.words.not_within if a.measured else self.words.not_a_number
        return condition.format(*self._ends[a.name])

    def _numbers_only(self, result: str) -> None:
        """No number where an argument is none."""
        for a in self.routine.arguments:
            put = self.words.put.format(result, self._ends[a.name][0])
            condition = self.words.first.format(self._unreadable(a))
            self._say(condition, INDENT + put, self.words.end)

    def _run(self, s: Statement) -> None:
        self._context = s.state if isinstance(s, Put) else getattr(s, "name", "limit")
        match s:
            case Let():
                self._let(s)
            case Put():
                self._assign(self._states[s.state], s.value)
                self._known[s.state] = self._states[s.state]
            case Flag():
                flagged = INDENT + self.words.flagged
                self._say(self.words.first.format(self._condition(s)), flagged, self.words.end)
            case Layer():
                self._layer(s)
            case Solve():
                self._solve(s)
            case Filter():
                self._filter(s)

    def _halve(self, s: Solve, names: tuple[str, str, str, str], *last: str) -> None:
        """Write the inside of the loop of a search.

        ``names`` are those of the place, the target and the ends between which it lies; ``last``
        stands at the end.
        """
        (place, target, low, high), words, before = names, self.words, dict(self._known)
        self._known[s.name] = place
        self._depth += 1
        for let in s.body:
            self._run(let)
        self._context = s.name
        below = f"{self._side(s.value)} {'<' if s.rising else '>'} {target}"
        self._say(
            words.first.format(below), INDENT + words.put.format(low, place),
            words.otherwise, INDENT + words.put.format(high, place), words.end, *last,
        )  # fmt: skip
        self._depth -= 1
        self._known = {**before, s.name: place}

    def _condition(self, e: Choose | Flag) -> str:
        relation = e.relation if isinstance(e, Choose) else "<"
        return f"{self._side(e.a)} {relation} {self._side(e.b)}"

    def _branch(self, target: str, e: Choose) -> None:
        """Give a variable a value by branches; a choice that follows a choice is one of them."""
        word, rest = self.words.first, e
        while True:
            self._whole = word != self.words.first
            condition = self._condition(rest)
            self._whole = False
            self._say(word.format(condition))
            self._nested(target, rest.yes)
            # a condition that is a choice itself needs statements before it
            if not isinstance(rest.no, Choose) or has_choice(rest.no.a) or has_choice(rest.no.b):
                break
            word, rest = self.words.further, rest.no
        self._say(self.words.otherwise)
        self._nested(target, rest.no)
        self._say(self.words.end)

    def _nested(self, target: str, e: Expression) -> None:
        self._depth += 1
        self._assign(target, e)
        self._depth -= 1

    def _array_of(self, inputs: Sequence[Expression]) -> str:
        """The array that holds the inputs of a layer: that of the layer before; empty if none."""
        first = inputs[0]
        if isinstance(first, Item) and all(e == Item(first.name, k) for k, e in enumerate(inputs)):
            return self._known[first.name]
        return ""


def has_choice(e: Expression) -> bool:
    """Return whether a choice stands anywhere in an expression."""
    return any(isinstance(part, Choose) for part in walk(e))
