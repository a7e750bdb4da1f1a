"""Routines that take no time: what they give for the present inputs."""

from __future__ import annotations

from collections.abc import Sequence

from ...routines import Routine
from ..c.language import DOUBLE, helpers
from ..c.writer import Writer
from .model import Model, Result


def add_maps(model: Model, routines: Sequence[Routine], name: str) -> None:
    """Add an output and a flag for every routine, and the functions that the plant calls.

    A routine that keeps something between its calls is called once in every communication step;
    asking for its output in between changes nothing.
    """
    writers = [Writer(r, name, DOUBLE) for r in routines]
    called = [Writer(r, name, DOUBLE) for r in model.called]
    model.functions += _helpers([*model.called, *routines], name)
    for writer in (*called, *writers):
        for lines in (writer.structure()[:-1], list(writer.tables()), writer.reset()):
            model.functions += [*lines, ""] if lines else []
        model.functions += [*writer.function(), ""]
    committed = [_add(model, writer) for writer in writers]
    kept = [call for call in committed if call]
    if kept:
        model.advance += ["model_outputs(memory, reals, booleans);", *kept]


def _helpers(routines: Sequence[Routine], name: str) -> list[str]:
    lines = [f"#define {name.upper()}_READ(entry) (entry)", f"#define {name.upper()}_TABLE", ""]
    return lines + helpers(routines, name, DOUBLE)


def _add(model: Model, writer: Writer) -> str:
    """Add one routine; returns the statement that lets it go on, empty where it keeps nothing."""
    r = writer.routine
    taken = [model.take(a, r.name) for a in r.arguments]
    inputs = tuple(name for name, _ in taken)
    about = f"whether an input of {r.name}_value is beyond its range, and taken at the end of it"
    place, flag = model.output(
        Result(f"{r.name}_value", r.unit, r.about, inputs),
        Result(f"{r.name}_outside", None, about, inputs),
    )
    given = [c for _, c in taken] + [f"&{flag}"]
    if not r.keeps:
        model.evaluate.append(f"{place} = {writer.name}({', '.join(given)});")
        return ""
    kind = f"{writer.name}_state"
    model.memory.append(f"{kind} {r.name};")
    model.begin.append(f"{writer.name}_reset(&memory->{r.name});")
    model.evaluate += [
        "{",
        f"    {kind} draft = memory->{r.name};",
        f"    {place} = {writer.name}({', '.join(['&draft', *given])});",
        "}",
    ]
    return f"{place} = {writer.name}({', '.join([f'&memory->{r.name}', *given])});"
