"""A block as a functional mock-up unit: its variables, and the C between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ...routines import Argument, Routine


@dataclass(frozen=True)
class Setting:
    """A parameter that can be set before the start, or a constant.

    ``value`` is in ``unit``; both texts may come from a file.
    """

    name: str
    unit: str
    about: str
    value: float
    minimum: float | None = None


@dataclass(frozen=True)
class Result:
    """An output, and the inputs on which it depends at once; a flag has no unit."""

    name: str
    unit: str | None
    about: str
    depends: tuple[str, ...] = ()


@dataclass
class Model:
    """Variables in the order of their value references, and C.

    Attributes
    ----------
    inputs, parameters, outputs, flags
        In order.
    headers
        Files of the library that the code includes, each after the ``constants`` before it.
    constants, functions
        Lines of C: what comes before the headers, and after them.
    called
        Routines that the headers call.
    memory
        Fields of the struct of what is kept between steps.
    begin, evaluate, advance
        Statements of the three functions that :file:`fmi2_unit.h` asks for.
    """

    inputs: list[Argument] = field(default_factory=list)
    parameters: list[Setting] = field(default_factory=list)
    outputs: list[Result] = field(default_factory=list)
    flags: list[Result] = field(default_factory=list)
    headers: list[str] = field(default_factory=list)
    constants: list[str] = field(default_factory=list)
    functions: list[str] = field(default_factory=list)
    called: list[Routine] = field(default_factory=list)
    memory: list[str] = field(default_factory=list)
    begin: list[str] = field(default_factory=list)
    evaluate: list[str] = field(default_factory=list)
    advance: list[str] = field(default_factory=list)

    def take(self, argument: Argument, routine: str) -> tuple[str, str]:
        """Take an argument of a routine; returns the name of the input and its C.

        Arguments of one name and unit are one input, whose range is that of all of them. A name
        that is taken otherwise gets that of the routine before it.
        """
        taken = {r.name for r in (*self.outputs, *self.flags)}
        for name in (argument.name, f"{routine}_{argument.name}"):
            known = [a for a in self.inputs if a.name == name]
            if known and known[0].unit == argument.unit:
                k = self.inputs.index(known[0])
                low, high = min(known[0].low, argument.low), max(known[0].high, argument.high)
                self.inputs[k] = Argument(name, argument.unit, known[0].about, low, high)
                return name, f"reals[{k}]"
            if not known and name not in taken:
                break
        self.inputs.append(
            Argument(name, argument.unit, argument.about, argument.low, argument.high)
        )
        return name, f"reals[{len(self.inputs) - 1}]"

    def output(self, result: Result, flag: Result) -> tuple[str, str]:
        """Add an output with the flag of its inputs; returns the C of both places."""
        self.outputs.append(result)
        self.flags.append(flag)
        return self.place(len(self.outputs) - 1), f"booleans[{len(self.flags) - 1}]"

    @staticmethod
    def place(output: int) -> str:
        """C of an output, by number."""
        return f"reals[MODEL_OUTPUTS + {output}]"

    def parameter(self, setting: Setting) -> str:
        """Add a parameter; returns its C."""
        self.parameters.append(setting)
        return f"reals[MODEL_INPUTS + {len(self.parameters) - 1}]"


@dataclass(frozen=True)
class Unit:
    """A model with what is said of it.

    Attributes
    ----------
    name
        Identifier.
    about, remarks
        Lines of text.
    model
        Variables and code.
    constants
        Variables that never change.
    period
        Step that suits the model [s]; 0 for none.
    """

    name: str
    about: str
    remarks: Sequence[str]
    model: Model
    constants: Sequence[Setting]
    period: float


def start_of(argument: Argument) -> float:
    """Value of an input until it is set: zero, where its range holds it."""
    return min(max(0.0, argument.low), argument.high)


def table(name: str, values: npt.ArrayLike) -> str:
    """A constant array of one or two dimensions in C."""
    array = np.asarray(values, dtype=float)
    rows = [", ".join(map(number, row)) for row in np.atleast_2d(array)]
    inner = rows[0] if array.ndim == 1 else ", ".join(f"{{{row}}}" for row in rows)
    shape = "".join(f"[{n}]" for n in array.shape)
    return f"static const double {name}{shape} = {{{inner}}};"


def number(value: float) -> str:
    """A constant of C, to the last digit."""
    text = f"{value:.17g}"
    return text if any(c in text for c in ".e") else f"{text}.0"
