"""Structured Text of routines drawn at random: the same numbers to the last bit."""

from __future__ import annotations

from random import Random
from typing import Any

import pytest
from st_interpreter import Instance
from st_parser import Parser

from fluidact_fit.export.structured_text.blocks import FunctionBlock
from fluidact_fit.routines import Argument, Machine, Routine, maximum, minimum
from fluidact_fit.routines.expression import Binary, Choose, Expression, Name, Number, Unary
from fluidact_fit.routines.routine import Draft

CONSTANTS = (-1.5, 2.25, 0.0, -0.0, 1e-7, 3.0)


def draw(rng: Random, depth: int, names: list[str]) -> Expression:
    """Only what IEEE 754 rounds in one way, so that both have to agree exactly."""

    def part() -> Expression:
        return draw(rng, depth - 1, names)

    if depth == 0 or rng.random() < 0.15:
        named = rng.random() < 0.7
        return Name(rng.choice(names)) if named else Number(rng.choice(CONSTANTS))
    kind: Any = rng.choice(
        ["+", "-", "*", "-", "/", "min", "max", "neg", "abs", "choose", "choose"]
    )
    if kind == "choose":
        return Choose(part(), rng.choice(["<", "<=", ">", ">="]), part(), part(), part())
    if kind in ("neg", "abs"):
        return Unary(kind, part())
    return Binary(kind, part(), abs(part()) + 0.5 if kind == "/" else part())


def routine_of(rng: Random) -> Routine:
    """Names are given again and again, to values as to arguments and states."""
    draft, names = Draft("f", "", "1"), ["a", "b", "kept"]
    for name in names[:2]:
        draft.argument(Argument(name, "1", "made up", -2.0, 3.0))
    kept = draft.state("kept", 0.5)
    for _ in range(rng.randrange(5)):
        value = minimum(maximum(draw(rng, 4, names), -9.0), 9.0)
        if rng.random() < 0.3:
            draft.put(kept, value)
        else:
            names.append(rng.choice(["p", "q", "a", "kept", "step"]))
            draft.let(names[-1], value)
        if rng.random() < 0.3:
            draft.flag(draw(rng, 2, names), draw(rng, 2, names))
    return draft.returns(draw(rng, 5, names))


@pytest.mark.parametrize("seed", range(5))
def test_random_routines_give_the_same_to_the_last_bit(seed: int) -> None:
    rng = Random(seed)
    for _ in range(20):
        routine = routine_of(rng)
        text = "\n".join(FunctionBlock("FB_test", routine).lines())
        instance, machine = Instance(Parser(text), "FB_test"), Machine(routine)
        for call in range(10):
            a, b = rng.uniform(-3.0, 4.0), rng.uniform(-3.0, 4.0)
            value, outside = machine(a=a, b=b)
            found = instance(a=a, b=b, reset=call == 0)
            assert found == {"value": float(value), "outside": bool(outside)}, text
