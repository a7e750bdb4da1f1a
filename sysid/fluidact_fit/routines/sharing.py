"""Routines whose repeated parts are computed once, under a name of their own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from .expression import (
    Binary,
    Choose,
    Expression,
    Item,
    Name,
    Number,
    Unary,
    parts_of,
    walk,
    with_parts,
)
from .simplify import change_statement
from .statements import Filter, Flag, Layer, Let, Put, Routine, Solve, Statement

_WORDS = {
    "+": "sum", "-": "difference", "*": "product", "/": "quotient", "min": "lower",
    "max": "upper", "sqrt": "root", "exp": "power", "log": "logarithm", "abs": "size",
    "neg": "opposite",
}  # fmt: skip
_RESULT = "result of a routine"  # no identifier, so that no other name is like it


@dataclass(frozen=True)
class _Use:
    """An expression where it stands: its names with what they hold there."""

    key: Expression
    expression: Expression
    statement: int
    certain: bool


def shared(routine: Routine) -> Routine:
    """Return a routine of the same results in which nothing is computed twice or in vain."""
    routine = replace(routine, body=tuple(_needed(routine)))
    taken = {a.name for a in routine.arguments} | {s.name for s in routine.states}
    taken |= {getattr(s, "name", "") for s in routine.body}
    taken |= {let.name for s in routine.body if isinstance(s, Solve) for let in s.body}
    body: list[Statement] = []
    for s in routine.body:
        if isinstance(s, Solve):
            ahead, s = _searched(s, taken)
            body += ahead
        body.append(s)
    *body, last = _shared([*body, Let(_RESULT, routine.value)], taken)
    assert isinstance(last, Let)
    return replace(routine, body=tuple(body), value=last.value)


def _needed(routine: Routine) -> list[Statement]:
    """The statements that the result, a flag or the next call depends on."""
    found, read = list[Statement](), _names(routine.value)
    for s in reversed(routine.body):
        if isinstance(s, Let | Layer | Solve) and s.name not in read:
            continue
        found.append(s)
        inside = (s.value, *(let.value for let in s.body)) if isinstance(s, Solve) else ()
        read = read.union(*map(_names, (*expressions_of(s), *inside)))
    return found[::-1]


def expressions_of(s: Statement) -> tuple[Expression, ...]:
    """The expressions of a statement; of a search what it looks for."""
    match s:
        case Let() | Put():
            return (s.value,)
        case Layer():
            return s.inputs
        case Solve():
            return (s.target,)
        case Filter():
            return (s.drive,)
        case Flag():
            return s.a, s.b
    raise TypeError(s)


def _shared(statements: Sequence[Statement], taken: set[str]) -> list[Statement]:
    """Give names to what is repeated, the largest first."""
    found = list(statements)
    while True:
        uses = [u for k, s in enumerate(_versions(found)) for u in _uses(k, *s)]
        counts = Counter(u.key for u in uses)
        certain = {u.key for u in uses if u.certain}
        repeated = [
            u for u in uses if counts[u.key] > 1 and (u.key in certain or not _is_partial(u.key))
        ]
        if not repeated:
            return found
        best = max(repeated, key=lambda u: _size(u.key))
        let = Let(_new_name(best.expression, taken), best.expression)
        # within one statement a name holds one value: the expression itself says where it stands
        for k in {u.statement for u in uses if u.key == best.key}:
            found[k] = change_statement(found[k], partial(_named, let), inside=False)
        found.insert(best.statement, let)


def _versions(
    statements: Sequence[Statement],
) -> Iterator[tuple[Statement, Mapping[str, int]]]:
    """Statements with how often each name had been given a value before."""
    known: Counter[str] = Counter()
    for s in statements:
        yield s, Counter(known)
        name = s.state if isinstance(s, Put) else getattr(s, "name", "")
        known[name] += 1


def _uses(number: int, s: Statement, known: Mapping[str, int]) -> Iterator[_Use]:
    """Every part of a statement that is worth a name."""
    for e in expressions_of(s):
        for part, certain in _parts(e, certain=True):
            yield _Use(_versioned(part, known), part, number, certain)


def _parts(e: Expression, certain: bool) -> Iterator[tuple[Expression, bool]]:
    if _worth(e):
        yield e, certain
    for k, part in enumerate(parts_of(e)):
        yield from _parts(part, certain and not (isinstance(e, Choose) and k > 1))


def _worth(e: Expression) -> bool:
    if isinstance(e, Unary) and e.function in ("neg", "abs"):
        return bool(parts_of(e.x))
    return isinstance(e, Unary | Binary | Choose)


def _versioned(e: Expression, known: Mapping[str, int]) -> Expression:
    """An expression whose names say which value they mean."""
    if isinstance(e, Name | Item):
        return replace(e, name=f"{e.name} {known[e.name]}")
    return with_parts(e, lambda part: _versioned(part, known))


def _named(let: Let, e: Expression) -> Expression:
    """The expression with a name for what stands under it."""
    return Name(let.name) if e == let.value else with_parts(e, partial(_named, let))


def _is_partial(e: Expression) -> bool:
    """Return whether some numbers have no result."""
    return any(
        part.function in ("sqrt", "exp", "log") if isinstance(part, Unary)
        else isinstance(part, Binary) and part.function == "/" and not isinstance(part.b, Number)
        for part in walk(e)
    )  # fmt: skip


def _size(e: Expression) -> int:
    return sum(1 for _ in walk(e))


def word_of(e: Expression) -> str:
    """A word for what an expression computes."""
    return _WORDS[e.function] if isinstance(e, Unary | Binary) else "chosen"


def _new_name(e: Expression, taken: set[str]) -> str:
    base = word_of(e)
    name, number = base, 0
    while name in taken:
        number += 1
        name = f"{base}_{number}"
    taken.add(name)
    return name


# ------------------------------------------------------------------------------- searches


def _searched(s: Solve, taken: set[str]) -> tuple[list[Let], Solve]:
    """A search with what does not change in it computed before, and nothing in it twice."""
    inner = {s.name, *(let.name for let in s.body)}
    ahead: list[Let] = []

    def outside(e: Expression) -> Expression:
        if not _worth(e) or not _names(e):
            return e
        if not (_names(e) & inner) and not _is_partial(e):
            known = next((let for let in ahead if let.value == e), None)
            if known is None:
                known = Let(_new_name(e, taken), e)
                ahead.append(known)
            return Name(known.name)
        return with_parts(e, outside)

    lets = [replace(let, value=outside(let.value)) for let in s.body]
    *body, last = _shared([*lets, Let(_RESULT, outside(s.value))], taken)
    assert isinstance(last, Let)
    return ahead, replace(s, body=tuple(b for b in body if isinstance(b, Let)), value=last.value)


def _names(e: Expression) -> set[str]:
    return {part.name for part in walk(e) if isinstance(part, Name | Item)}
