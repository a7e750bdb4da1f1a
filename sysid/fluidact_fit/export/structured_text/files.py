"""The whole text of a Structured Text export: header, constants, function blocks, self-test."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...experiment import FloatArray
from ...routines import Routine
from ..excitation import run
from ..golden import Golden, golden
from ..target import Code, Entry, without_reading
from .blocks import FunctionBlock, described
from .words import INDENT, Names, array, block_comment, comment, literal, section, wrapped

# Of the largest output: far above what libraries of controllers differ by, and the resolution
# of a search by halving.
_TOLERANCE = 1e-8


def text_of(code: Code) -> str:
    """Return the text of ``NAME.st``."""
    names = Names()
    blocks = [FunctionBlock(names.new(f"FB_{code.name}_{r.name}"), r) for r in code.routines]
    test = names.new(f"FB_{code.name}_selftest")
    parts = [block_comment(_header(code, blocks, test)), _constants(code)]
    parts += [b.lines() for b in blocks]
    parts.append(_self_test(test, blocks))
    return "\n\n".join("\n".join(p) for p in parts) + "\n"


def _header(code: Code, blocks: Sequence[FunctionBlock], test: str) -> list[str]:
    lines = [
        f"{code.name}: {code.title}, in double precision (LREAL), for IEC 61131-3 Structured "
        "Text as TwinCAT 3 reads it.",
        *([code.about] if code.about else []),
        *code.origin_lines,
        *code.remarks,
        "",
        "All quantities are SI. An argument beyond its range is clamped and sets the output "
        "outside. Of the texts of the parameter file only those above and its units are in "
        "here, as plain ASCII.",
        "",
        f"Put the constants into a global variable list and every function block into one of its "
        f"own. Call {test} once: passed is TRUE when every golden vector of the Python model "
        "holds on this controller.",
    ]
    for b in blocks:
        lines += ["", f"{b.name} [{b.routine.unit}]: {b.routine.about}"]
        lines += [f"- {name} {described(a)}" for name, a in zip(b.inputs, b.routine.arguments)]
        lines += [without_reading(b.routine)] if b.routine.careful else []
    return lines


def _constants(code: Code) -> list[str]:
    """Numbers as global constants: a matrix as it is, without the shape beside it; no words."""
    names, lines = Names(), ["{attribute 'qualified_only'}", "VAR_GLOBAL CONSTANT"]
    for entry in code.numbers:
        if not isinstance(entry.value, str) and entry.parameter in ("", entry.key):
            lines += _constant(names.new(entry.key), entry)
    return [*lines, "END_VAR"]


def _constant(name: str, entry: Entry) -> list[str]:
    how = f"; {entry.how}" if entry.how else ""
    note = f"{INDENT}{comment(f'[{entry.unit or 1}] {entry.description}{how}')}"
    if isinstance(entry.value, list):
        flat = [literal(v) for v in entry.value]
        return [note, *array(name, flat, entry.shape, "LREAL")]
    if isinstance(entry.value, int):
        return [note, f"{INDENT}{name} : DINT := {entry.value:d};"]
    return [note, f"{INDENT}{name} : LREAL := {literal(float(entry.value))};"]


def _self_test(name: str, blocks: Sequence[FunctionBlock]) -> list[str]:
    names, tables, instances, body = Names(), list[str](), list[str](), list[str]()
    for own in ("passed", "failures", "k"):
        names.new(own)
    for b in blocks:
        vectors = golden(b.routine, _tolerance)
        block = names.new(f"{b.routine.name}_block")
        kept = [names.new(f"{b.routine.name}_{w}") for w in (*b.inputs, "value", "outside")]
        instances.append(f"{INDENT}{block} : {b.name};")
        tables += _tables(kept, vectors)
        body += _calls(b, block, kept, vectors)
    about = ["Golden vectors of the Python model, run in one call. failures counts those missed."]
    return [
        *block_comment(about),
        f"FUNCTION_BLOCK {name}",
        *section("VAR_OUTPUT", [f"{INDENT}passed : BOOL;", f"{INDENT}failures : DINT;"]),
        *section("VAR", instances),
        *section("VAR CONSTANT", tables),
        *section("VAR_TEMP", [f"{INDENT}k : DINT;"]),
        "failures := 0;",
        *body,
        "passed := (failures = 0);",
        "END_FUNCTION_BLOCK",
    ]


def _tolerance(routine: Routine, arguments: FloatArray) -> float:
    return float(_TOLERANCE * np.abs(run(routine, arguments)[0]).max())


def _tables(kept: Sequence[str], vectors: Golden) -> list[str]:
    """One table for each argument, one for the outputs and one for the flags."""
    count, lines = [len(vectors.outputs)], list[str]()
    for name, column in zip(kept, [*vectors.arguments.T, vectors.outputs]):
        lines += array(name, [literal(v) for v in column], count, "LREAL")
    flags = ["TRUE" if out else "FALSE" for out in vectors.outside]
    return [*lines, *array(kept[-1], flags, count, "BOOL")]


def _calls(b: FunctionBlock, block: str, kept: Sequence[str], vectors: Golden) -> list[str]:
    given = [f"{name} := {table}[k]" for name, table in zip(b.inputs, kept)]
    if b.routine.keeps:
        given.append(f"reset := ((k MOD {vectors.length}) = 0)")
    allowed = literal(vectors.tolerance)
    wanted, beyond = kept[-2:]
    test = f"NOT (ABS({block}.value - {wanted}[k]) <= {allowed}) OR {block}.outside <> {beyond}[k]"
    return [
        f"FOR k := 0 TO {len(vectors.outputs) - 1} DO",
        *wrapped(f"{block}({', '.join(given)});", 1),
        *wrapped(f"IF {test} THEN", 1),
        f"{INDENT * 2}failures := failures + 1;",
        f"{INDENT}END_IF;",
        "END_FOR;",
    ]
