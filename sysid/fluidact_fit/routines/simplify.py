"""Expressions without what changes nothing: products with one, sums with zero, equal choices.

What only constants enter is computed once, in double precision.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from .evaluate import RELATIONS, value_of
from .expression import Binary, Choose, Expression, Number, Unary, with_parts
from .statements import Filter, Flag, Layer, Let, Put, Routine, Solve, Statement

Rewrite = Callable[[Expression], Expression]


def simplify(e: Expression) -> Expression:
    """Return an expression of the same value for every finite number."""
    e = with_parts(e, simplify)
    match e:
        case Unary():
            return _unary(e)
        case Binary():
            return _binary(e)
        case Choose():
            return _choose(e)
    return e


def rewritten(routine: Routine, change: Rewrite) -> Routine:
    """Return a routine with all its expressions changed."""
    body = tuple(change_statement(s, change) for s in routine.body)
    return replace(routine, body=body, value=change(routine.value))


def change_statement(s: Statement, change: Rewrite, inside: bool = True) -> Statement:
    """Return a statement with its expressions changed, those inside a search only if asked for."""
    match s:
        case Let() | Put():
            return replace(s, value=change(s.value))
        case Layer():
            return replace(s, inputs=tuple(map(change, s.inputs)))
        case Solve():
            s = replace(s, target=change(s.target))
            if not inside:
                return s
            body = tuple(replace(let, value=change(let.value)) for let in s.body)
            return replace(s, body=body, value=change(s.value))
        case Filter():
            return replace(s, drive=change(s.drive))
        case Flag():
            return replace(s, a=change(s.a), b=change(s.b))
    raise TypeError(s)


def _is(e: Expression, value: float) -> bool:
    return isinstance(e, Number) and e.value == value


def _unary(e: Unary) -> Expression:
    x = e.x
    if isinstance(x, Number) and (e.function != "log" or x.value > 0.0):
        if e.function in ("neg", "abs"):
            same = e.function == "abs" and x.value >= 0.0
            return x if same else Number(float(value_of(e, {})))
        return Number(float(value_of(e, {})))
    if e.function == "neg":
        if isinstance(x, Unary) and x.function == "neg":
            return x.x
        if isinstance(x, Binary) and x.function == "-":
            return replace(x, a=x.b, b=x.a)
    return e


def _binary(e: Binary) -> Expression:
    a, b = e.a, e.b
    if isinstance(a, Number) and isinstance(b, Number) and not (e.function == "/" and not b.value):
        if e.function in ("min", "max"):
            return min(a, b, key=_number) if e.function == "min" else max(a, b, key=_number)
        return Number(float(value_of(e, {})))
    if e.function in ("min", "max"):
        return a if a == b else e
    if e.function == "+":
        return _sum(e)
    if e.function == "-":
        return _difference(e)
    return _product(e)


def _number(e: Expression) -> float:
    assert isinstance(e, Number)
    return e.value


def _sum(e: Binary) -> Expression:
    if _is(e.a, 0.0) or _is(e.b, 0.0):
        return e.b if _is(e.a, 0.0) else e.a
    if isinstance(e.b, Unary) and e.b.function == "neg":
        return Binary("-", e.a, e.b.x)
    return e


def _difference(e: Binary) -> Expression:
    if _is(e.b, 0.0):
        return e.a
    if _is(e.a, 0.0):
        return _unary(Unary("neg", e.b))
    if isinstance(e.b, Unary) and e.b.function == "neg":
        return Binary("+", e.a, e.b.x)
    return e


def _product(e: Binary) -> Expression:
    a, b = e.a, e.b
    if _is(a, 0.0) or (e.function == "*" and _is(b, 0.0)):
        return Number(0.0)
    for one, other in ((b, a), (a, b)) if e.function == "*" else ((b, a),):
        if _is(one, 1.0):
            return other
        if _is(one, -1.0):
            return _unary(Unary("neg", other))
    return e


def _choose(e: Choose) -> Expression:
    if e.yes == e.no:
        return e.yes
    if isinstance(e.a, Number) and isinstance(e.b, Number):
        return e.yes if RELATIONS[e.relation](e.a.value, e.b.value) else e.no
    return e
