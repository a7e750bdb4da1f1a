"""Routines: their statements, and a draft of one while it is written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from .expression import Expression, Item, Name, Operand, wrap
from .simplify import rewritten, simplify
from .statements import (
    Activation,
    Argument,
    Filter,
    Flag,
    Layer,
    Let,
    Matrix,
    Put,
    Routine,
    Solve,
    State,
    Statement,
    as_matrix,
)

__all__ = [
    "Activation", "Argument", "Draft", "Filter", "Flag", "Layer", "Let", "Matrix", "Put", "Routine",
    "Solve", "State", "Statement", "as_matrix",
]  # fmt: skip


@dataclass
class Draft:
    """A routine while it is written.

    ``name``, ``about``, ``unit`` and ``careful`` are those of the routine.
    """

    name: str
    about: str
    unit: str
    sample_time: float = 0.0
    arguments: list[Argument] = field(default_factory=list)
    states: list[State] = field(default_factory=list)
    body: list[Statement] = field(default_factory=list)
    careful: bool = False
    interrupted: list[Put] = field(default_factory=list)

    def argument(self, argument: Argument) -> Name:
        """Take an argument."""
        self.arguments.append(argument)
        return Name(argument.name)

    def let(self, name: str, value: Operand) -> Name:
        """Give a value a name, so that it is computed once."""
        self.body.append(Let(name, wrap(value)))
        return Name(name)

    def state(self, name: str, initial: float = 0.0) -> Name:
        """Keep a number."""
        self.states.append(State(name, initial))
        return Name(name)

    def put(self, state: Name, value: Operand) -> None:
        """Change what is kept."""
        self.body.append(Put(state.name, wrap(value)))

    def interrupt(self, state: Name, value: Operand) -> None:
        """Change what is kept where there is nothing to compute from."""
        self.interrupted.append(Put(state.name, wrap(value)))

    def layer(
        self, name: str, weights: npt.ArrayLike, biases: npt.ArrayLike,
        inputs: Sequence[Expression], activation: Activation,
    ) -> tuple[Item, ...]:  # fmt: skip
        """Add a layer of a network; returns its outputs."""
        b = tuple(np.asarray(biases, dtype=float).tolist())
        self.body.append(Layer(name, as_matrix(weights), b, tuple(inputs), activation))
        return tuple(Item(name, k) for k in range(len(b)))

    def solve(self, statement: Solve) -> Name:
        """Add a search for a place."""
        self.body.append(statement)
        return Name(statement.name)

    def filter(self, statement: Filter) -> Name:
        """Add a difference equation."""
        self.body.append(statement)
        return Name(statement.name)

    def flag(self, a: Operand, b: Operand) -> None:
        """Tell of ``a < b`` as of an argument outside its range."""
        self.body.append(Flag(wrap(a), wrap(b)))

    def returns(self, value: Operand) -> Routine:
        """Finish; what changes nothing is left out."""
        routine = Routine(
            self.name, self.about, self.unit, tuple(self.arguments), tuple(self.body),
            wrap(value), tuple(self.states), self.sample_time, self.careful,
            tuple(self.interrupted),
        )  # fmt: skip
        return rewritten(routine, simplify)
