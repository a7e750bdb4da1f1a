"""Expressions over single numbers, as plain data that every language can be written from.

Only what all targets have: the four operations, minimum and maximum, and a few functions. There
is no ``tanh`` and no ``expm1``: IEC 61131-3 has neither, and small C libraries lack the second.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

Function1 = Literal["neg", "abs", "sqrt", "exp", "log"]
Function2 = Literal["+", "-", "*", "/", "min", "max"]
Relation = Literal["<", "<=", ">", ">="]
Operand: TypeAlias = "Expression | float"


class Expression:
    """A number that is computed; built with the operators of Python."""

    def __add__(self, other: Operand) -> Expression:
        """Sum."""
        return Binary("+", self, wrap(other))

    def __radd__(self, other: float) -> Expression:
        """Sum."""
        return Binary("+", wrap(other), self)

    def __sub__(self, other: Operand) -> Expression:
        """Difference."""
        return Binary("-", self, wrap(other))

    def __rsub__(self, other: float) -> Expression:
        """Difference."""
        return Binary("-", wrap(other), self)

    def __mul__(self, other: Operand) -> Expression:
        """Product."""
        return Binary("*", self, wrap(other))

    def __rmul__(self, other: float) -> Expression:
        """Product."""
        return Binary("*", wrap(other), self)

    def __truediv__(self, other: Operand) -> Expression:
        """Quotient."""
        return Binary("/", self, wrap(other))

    def __rtruediv__(self, other: float) -> Expression:
        """Quotient."""
        return Binary("/", wrap(other), self)

    def __neg__(self) -> Expression:
        """Opposite."""
        return Unary("neg", self)

    def __abs__(self) -> Expression:
        """Magnitude."""
        return Unary("abs", self)


@dataclass(frozen=True)
class Number(Expression):
    """A constant; ``name`` is what code calls it, and no part of what it is."""

    value: float
    name: str = field(default="", compare=False)


@dataclass(frozen=True)
class Name(Expression):
    """An argument, a value computed before, or a state."""

    name: str


@dataclass(frozen=True)
class Item(Expression):
    """One entry of the outputs of a layer."""

    name: str
    index: int


@dataclass(frozen=True)
class Unary(Expression):
    """A function of one number."""

    function: Function1
    x: Expression


@dataclass(frozen=True)
class Binary(Expression):
    """A function of two numbers."""

    function: Function2
    a: Expression
    b: Expression


@dataclass(frozen=True)
class Choose(Expression):
    """``yes`` where ``a relation b`` holds, otherwise ``no``; both are defined everywhere.

    ``jumps`` says that the equation itself jumps there: on which side a number falls that is
    computed, and lies within rounding of the boundary, is then nobody's error.
    """

    a: Expression
    relation: Relation
    b: Expression
    yes: Expression
    no: Expression
    jumps: bool = False


def parts_of(e: Expression) -> tuple[Expression, ...]:
    """Return the operands of an expression."""
    match e:
        case Unary():
            return (e.x,)
        case Binary():
            return e.a, e.b
        case Choose():
            return e.a, e.b, e.yes, e.no
    return ()


def walk(e: Expression) -> Iterator[Expression]:
    """Yield an expression and everything in it; names are not followed."""
    yield e
    for part in parts_of(e):
        yield from walk(part)


def with_parts(e: Expression, change: Callable[[Expression], Expression]) -> Expression:
    """Return an expression whose parts are changed."""
    match e:
        case Unary():
            return replace(e, x=change(e.x))
        case Binary():
            return replace(e, a=change(e.a), b=change(e.b))
        case Choose():
            a, b, yes, no = map(change, parts_of(e))
            return replace(e, a=a, b=b, yes=yes, no=no)
    return e


def as_text(e: Expression, known: Mapping[Expression, str] | None = None) -> str:
    """Return an expression as a reader writes it; parts that are ``known`` by their names."""

    def part(x: Expression, enclose: bool = True) -> str:
        if known and x in known:
            return known[x]
        text = as_text(x, known)
        plain = not isinstance(x, Binary | Choose) or (
            isinstance(x, Binary) and x.function in ("min", "max")
        )
        return text if plain or not enclose else f"({text})"

    match e:
        case Number():
            return e.name or f"{e.value:.6g}"
        case Name():
            return e.name
        case Item():
            return f"{e.name}[{e.index}]"
        case Unary():
            return f"-{part(e.x)}" if e.function == "neg" else f"{e.function}({part(e.x, False)})"
        case Binary() if e.function in ("min", "max"):
            return f"{e.function}({part(e.a, False)}, {part(e.b, False)})"
        case Binary():
            return f"{part(e.a)} {e.function} {part(e.b)}"
        case Choose():
            condition = f"{part(e.a, False)} {e.relation} {part(e.b, False)}"
            return f"{part(e.yes)} where {condition}, else {part(e.no)}"
    raise TypeError(e)


def wrap(value: Operand) -> Expression:
    """Return a constant as an expression."""
    return value if isinstance(value, Expression) else Number(float(value))


def constant(name: str, value: float) -> Number:
    """Return a constant that code calls by a name, in small letters."""
    return Number(float(value), name)


def minimum(a: Operand, b: Operand) -> Expression:
    """Return the smaller one."""
    return Binary("min", wrap(a), wrap(b))


def maximum(a: Operand, b: Operand) -> Expression:
    """Return the larger one."""
    return Binary("max", wrap(a), wrap(b))


def sqrt(x: Expression) -> Expression:
    """Square root; the argument is never negative."""
    return Unary("sqrt", x)


def exp(x: Expression) -> Expression:
    """Exponential function."""
    return Unary("exp", x)


def log(x: Expression) -> Expression:
    """Natural logarithm; the argument is positive."""
    return Unary("log", x)


def choose(
    a: Operand, relation: Relation, b: Operand, yes: Operand, no: Operand, *, jumps: bool = False
) -> Expression:
    """Return ``yes`` where ``a relation b`` holds, otherwise ``no``; see :class:`Choose`."""
    return Choose(wrap(a), relation, wrap(b), wrap(yes), wrap(no), jumps)


def by_sign(
    x: Expression, positive: Operand, negative: Operand, zero: Operand = 0.0, *, jumps: bool = False
) -> Expression:
    """Return one of three by the sign of ``x``; for ``jumps`` see :class:`Choose`."""
    other = choose(x, "<", 0.0, negative, zero, jumps=jumps)
    return choose(x, ">", 0.0, positive, other, jumps=jumps)


def polynomial(coefficients: Sequence[float], x: Expression, name: str = "") -> Expression:
    """Sum of ``coefficients[k] x^k``, by the scheme of Horner; they are called ``name_k``."""
    terms = [Number(c, name and f"{name}_{k}") for k, c in enumerate(coefficients)]
    *rest, last = terms
    value: Expression = last
    for c in reversed(rest):
        value = value * x + c
    return value
