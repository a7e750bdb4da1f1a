"""Choices as branches of statements, of which one is run, in the words of a language."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from ..routines.expression import Choose, Expression, walk


@dataclass(frozen=True)
class Words:
    """Keywords of branches: first, further, last, and the end."""

    first: str
    further: str
    otherwise: str
    end: str


class Branches(ABC):
    """Writes statements of a language whose branches have these words."""

    words: ClassVar[Words]
    _depth: int
    _whole = False  # while a condition is written that no statement can stand before

    @abstractmethod
    def _say(self, *lines: str) -> None:
        """Add lines at the depth of the branch."""

    @abstractmethod
    def _assign(self, target: str, e: Expression) -> None:
        """Give a variable a value."""

    @abstractmethod
    def _condition(self, e: Choose) -> str:
        """The comparison of a choice."""

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


def has_choice(e: Expression) -> bool:
    """Return whether a choice stands anywhere in an expression."""
    return any(isinstance(part, Choose) for part in walk(e))
