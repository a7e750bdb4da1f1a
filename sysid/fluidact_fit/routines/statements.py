"""Routines of one output that a controller calls, as plain data.

A block says with them what it does, once; every target of ``export`` writes the same routines
in its own language, and :mod:`.evaluate` runs them in double precision.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from .expression import Expression

Activation = Literal["relu", "tanh", "linear"]
Matrix = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Argument:
    """An input of a routine: beyond ``low`` and ``high`` it is clamped and a flag is set.

    Attributes
    ----------
    name, unit, about
        Words of the program, never of a file; SI.
    low, high
        Range [unit].
    recorded
        Whether the range is what the logs covered; otherwise it follows from other numbers.
    held
        Whether it rests for several calls in a row, as what is wanted does.
    measured
        Whether it is a reading, which beyond its range cannot be true; see :class:`Routine`.
    """

    name: str
    unit: str
    about: str
    low: float
    high: float
    recorded: bool = True
    held: bool = False
    measured: bool = False


@dataclass(frozen=True)
class State:
    """A number that is kept from one call to the next, and its value after a reset."""

    name: str
    initial: float = 0.0


@dataclass(frozen=True)
class Let:
    """A value under a name."""

    name: str
    value: Expression


@dataclass(frozen=True)
class Put:
    """A new value of a state; what follows sees it."""

    state: str
    value: Expression


@dataclass(frozen=True)
class Layer:
    """Outputs ``activation(weights @ inputs + biases)`` under a name.

    ``weights`` has the shape ``(units, inputs)``, ``biases`` ``(units,)``.
    """

    name: str
    weights: Matrix
    biases: tuple[float, ...]
    inputs: tuple[Expression, ...]
    activation: Activation


@dataclass(frozen=True)
class Solve:
    """The place ``name`` in ``[low, high]`` where a monotone ``value`` is ``target``.

    By halving: ``value`` is an expression in ``name``. An end where there is none between.
    """

    name: str
    low: float
    high: float
    body: tuple[Let, ...]
    value: Expression
    target: Expression
    rising: bool
    halvings: int = 30


@dataclass(frozen=True)
class Filter:
    """A linear difference equation in state space, its output under a name.

        y[k] = output @ x[k] + direct u[k]
        x[k+1] = x[k] + change @ x[k] + late u[k-delay-1] + soon u[k-delay]

    with ``change = A - 1`` so that an integrator stays one in any arithmetic. Before the first
    call everything is zero. Shapes are ``(n, n)``, ``(n,)``, ``(n,)`` and ``(n,)``.
    """

    name: str
    change: Matrix
    soon: tuple[float, ...]
    late: tuple[float, ...]
    output: tuple[float, ...]
    delay: int
    drive: Expression
    direct: float = 0.0


@dataclass(frozen=True)
class Flag:
    """Sets the flag of what lies outside where ``a < b``: no clamped argument tells of that."""

    a: Expression
    b: Expression


Statement = Let | Put | Layer | Solve | Filter | Flag


@dataclass(frozen=True)
class Routine:
    """One output of some arguments, and of the states that it keeps.

    Attributes
    ----------
    name, about
        Words of the program; the name is an identifier in every target.
    arguments
        In order.
    unit
        Of the output, SI.
    body, value
        Statements in order, and the output.
    states
        What is kept between calls.
    sample_time
        Period of the calls [s] of a routine with a :class:`Filter`; 0 where it does not matter.
    careful
        Whether nothing is computed from an argument that is no number, or from a reading beyond its
        range. Such a call sets the flag, of what is kept it changes only what ``interrupted`` says,
        and it returns the value, a state, as it stands. A routine that keeps nothing returns no
        number either.
    interrupted
        What changes then.
    """

    name: str
    about: str
    unit: str
    arguments: tuple[Argument, ...]
    body: tuple[Statement, ...]
    value: Expression
    states: tuple[State, ...] = ()
    sample_time: float = 0.0
    careful: bool = False
    interrupted: tuple[Put, ...] = ()

    @property
    def filters(self) -> tuple[Filter, ...]:
        """The difference equations in it."""
        return tuple(s for s in self.body if isinstance(s, Filter))

    @property
    def keeps(self) -> bool:
        """Return whether anything is kept between calls."""
        return bool(self.states or self.filters)


def as_matrix(values: npt.ArrayLike) -> Matrix:
    """A matrix of shape ``(m, n)`` as plain numbers."""
    return tuple(tuple(map(float, row)) for row in np.asarray(values, dtype=float))
