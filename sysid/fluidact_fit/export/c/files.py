"""The three files of a C export: header, source and self-test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import ROUND_CEILING, Context

import numpy as np

from ...routines import Routine
from ..golden import golden
from ..rounding import CALLS, UNIT, error_bound, inward, single
from ..target import Code
from .constants import macros_of
from .language import SINGLE, Writer, uses

_CALLS = 24  # golden vectors of a routine
_READERS = {"READ": "pgm_read_float"}


@dataclass(frozen=True)
class Function:
    """A routine with its C and the bound of its rounding errors [unit of its output]."""

    routine: Routine
    writer: Writer
    bound: float

    @classmethod
    def of(cls, routine: Routine, prefix: str) -> Function:
        """Make the function of a routine."""
        narrow = inward(routine)
        return cls(narrow, Writer(narrow, prefix, SINGLE), error_bound(narrow))


def at_most(value: float) -> str:
    """A bound to two digits, rounded up."""
    upwards = Context(prec=2, rounding=ROUND_CEILING).create_decimal_from_float(value)
    return f"{float(upwards):.2g}"


def comment(lines: Sequence[str]) -> list[str]:
    """A block comment."""
    return ["/*", *(f" * {line}".rstrip() for line in lines), " */"]


def header(code: Code, functions: Sequence[Function]) -> str:
    """``NAME.h``: what can be called, with ranges, units and the bounds of the errors."""
    guard = f"{code.name.upper()}_H"
    words = [
        f"{code.name}: {code.title}, in single precision",
        "",
        *code.remarks,
        *([""] if code.remarks else []),
        "All quantities are SI. An argument beyond its range is clamped and sets *outside to 1,",
        "which may be a null pointer. No memory is allocated and no function is recursive.",
    ]
    lines = [*comment(words), f"#ifndef {guard}", f"#define {guard}", ""]
    lines += [*macros_of(code), ""] if code.numbers else []
    for f in functions:
        lines += [*comment(_describe(f)), *f.writer.structure(), f"{f.writer.signature};", ""]
    return "\n".join([*lines, "#endif", ""])


def _describe(f: Function) -> list[str]:
    r = f.routine
    lines = [r.about, ""]
    for a in r.arguments:
        kind = "range of the logs" if a.recorded else "not recorded, derived"
        lines.append(f"{a.name} [{a.unit}]: {a.about}; {a.low:.9g} to {a.high:.9g} ({kind})")
    lines += ["", f"Returns [{r.unit}]."]
    if r.sample_time:
        lines.append(f"Call it every {r.sample_time:.9g} s.")
    within = f" in the first {CALLS} calls after a reset" if r.keeps else ""
    if np.isfinite(f.bound):
        lines.append(
            f"Differs from the model in double precision by at most {at_most(f.bound)}{within}"
        )
        lines.append("(rounding analysis over the ranges above).")
    else:
        lines.append("The ranges above allow no bound of the rounding errors.")
    return lines


def macros(code: Code, readers: Mapping[str, str]) -> list[str]:
    """Where tables are kept, and how they are read: on an AVR from flash.

    ``readers`` are functions of ``avr/pgmspace.h`` by the name of the macro.
    """
    name = code.name.upper()
    return [
        "#if defined(__AVR__)",
        "#include <avr/pgmspace.h>",
        f"#define {name}_TABLE PROGMEM",
        *(f"#define {name}_{macro}(entry) {f}(&(entry))" for macro, f in readers.items()),
        "#else",
        f"#define {name}_TABLE",
        *(f"#define {name}_{macro}(entry) (entry)" for macro in readers),
        "#endif",
        "",
    ]


def source(code: Code, functions: Sequence[Function]) -> str:
    """``NAME.c``: the functions and their tables."""
    lines = [f'#include "{code.file}.h"', "", "#include <math.h>", "", *macros(code, _READERS)]
    for name, relation in (("min", "<"), ("max", ">")):
        if any(uses(f.routine, name) for f in functions):
            lines += [
                f"static float {code.name}_{name}(float a, float b)", "{",
                f"    return a {relation} b ? a : b;", "}", "",
            ]  # fmt: skip
    for f in functions:
        for part in ([*f.writer.tables()], f.writer.reset(), f.writer.function()):
            lines += [*part, ""] if part else []
    return "\n".join(lines)


def self_test(code: Code, functions: Sequence[Function]) -> str:
    """``NAME_selftest.c``: ``main`` returns 0 when every golden vector holds."""
    lines = [
        *comment([f"{code.name}: golden vectors of the Python model. main returns 0 when all hold,",
                  "otherwise the number of the function that failed."]),
        f'#include "{code.file}.h"', "", "#include <math.h>", "", *macros(code, _READERS),
    ]  # fmt: skip
    for number, f in enumerate(functions, start=1):
        lines += _test_of(code, f, number)
    lines += ["int main(void)", "{"]
    lines += [f"    if (!test_{n}()) return {n};" for n in range(1, len(functions) + 1)]
    return "\n".join([*lines, "    return 0;", "}", ""])


def _test_of(code: Code, f: Function, number: int) -> list[str]:
    r, table = f.routine, f"{code.name.upper()}_TABLE"
    vectors = golden(r, _CALLS, single)
    columns = np.column_stack((vectors.arguments, vectors.outputs, vectors.outside))
    rows = ",\n    ".join("{" + ", ".join(map(SINGLE.literal, row)) + "}" for row in columns)
    count, width = columns.shape
    largest = np.abs(vectors.outputs).max()
    allowed = SINGLE.literal((f.bound + UNIT * largest) * (1.0 + 4.0 * UNIT))
    read = [f"{code.name.upper()}_READ(vectors_{number}[k][{j}])" for j in range(width)]
    call = ", ".join((["&state"] if r.keeps else []) + read[:-2] + ["&outside"])
    state = [f"    {f.writer.name}_state state;"] if r.keeps else []
    reset = [f"    {f.writer.name}_reset(&state);"] if r.keeps else []
    return [
        f"static const float vectors_{number}[{count}][{width}] {table} = {{\n    {rows}}};",
        "",
        f"static int test_{number}(void)",
        "{",
        *state,
        "    int k, outside;",
        "",
        *reset,
        f"    for (k = 0; k < {count}; k++) {{",
        f"        const float found = {f.writer.name}({call});",
        f"        const int beyond = {read[-1]} > 0.5f;",
        "",
        f"        if (!(fabsf(found - {read[-2]}) <= {allowed}) || outside != beyond) return 0;",
        "    }",
        "    return 1;",
        "}",
        "",
    ]
