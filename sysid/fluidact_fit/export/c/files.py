"""The three files of a C export: header, source and self-test."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import ROUND_CEILING, Context

import numpy as np

from ...errors import UsageError
from ...routines import Routine
from ...routines.sharing import shared
from ..golden import golden
from ..rounding import CALLS, Error, difference, error_of, inward, single
from ..target import Code, without_reading
from .constants import Macro
from .language import SINGLE, helpers, wrapped
from .writer import Writer

_READERS = {"READ": "pgm_read_float"}
_ABOUT_TEST = (
    "golden vectors of the Python model. main returns 0 when all hold, otherwise the number of "
    "the function that failed; the last number stands for the macros of the header."
)


@dataclass(frozen=True)
class Function:
    """A routine with its C and the errors of single precision [unit of its output]."""

    routine: Routine
    writer: Writer
    error: Error

    @property
    def bound(self) -> float:
        """Largest error, that of a jump included."""
        return self.error.total

    @classmethod
    def of(cls, routine: Routine, prefix: str, macros: Sequence[Macro] = ()) -> Function:
        """Make the function of a routine.

        Raises
        ------
        UsageError
            When a number of it is beyond single precision.
        """
        narrow = inward(shared(routine))
        error = error_of(narrow)
        if not np.isfinite(error.total):
            raise UsageError(
                f"{routine.name} of {prefix} cannot be computed in single precision: a number in "
                "it is beyond 3.4e38 within the ranges of its arguments.",
                remedy="Correct the parameter file, or choose a target with double precision: "
                "st, matlab, fmu.",
            )
        known = {m.name: m.value for m in macros if isinstance(m.value, float)}
        return cls(narrow, Writer(narrow, prefix, SINGLE, known), error)


def at_most(value: float) -> str:
    """A bound to two digits, rounded up."""
    upwards = Context(prec=2, rounding=ROUND_CEILING).create_decimal_from_float(value)
    return f"{float(upwards):.2g}"


def comment(lines: Sequence[str]) -> list[str]:
    """A block comment."""
    return ["/*", *(f" * {line}".rstrip() for line in lines), " */"]


def header(code: Code, functions: Sequence[Function], macros: Sequence[Macro]) -> str:
    """``NAME.h``: what can be called, with ranges, units and the bounds of the errors."""
    words = [
        f"{code.name}: {code.title}, in single precision",
        *preamble(code),
        "All quantities are SI. An argument beyond its range is clamped and sets *outside to 1,",
        "which may be a null pointer. No memory is allocated and no function is recursive.",
    ]
    lines = [line for m in macros for line in m.lines]
    lines += [""] if lines else []
    for f in functions:
        lines += [*comment(_describe(f)), *f.writer.structure(), *f.writer.prototype(), ""]
    return "\n".join([*guarded(code, comment(words), lines), ""])


def preamble(code: Code) -> list[str]:
    """Comment of every file: its origin, and the warnings that were accepted."""
    parts = [part for part in (code.origin_lines, code.remarks) if part]
    return [line for part in ([], *parts) for line in (*part, "")]


def guarded(code: Code, words: Sequence[str], lines: Sequence[str]) -> list[str]:
    """A header that may be included twice, and from C++."""
    guard = f"{code.name.upper()}_H"
    return [
        *words, f"#ifndef {guard}", f"#define {guard}", "",
        "#ifdef __cplusplus", 'extern "C" {', "#endif", "",
        *lines,
        "#ifdef __cplusplus", "}", "#endif", "", "#endif",
    ]  # fmt: skip


def _describe(f: Function) -> list[str]:
    r = f.routine
    lines = [*textwrap.wrap(r.about, 94), ""]
    for a in r.arguments:
        kind = "range of the logs" if a.recorded else "not recorded, derived"
        text = f"{a.name} [{a.unit}]: {a.about}; {a.low + 0.0:.9g} to {a.high:.9g} ({kind})"
        lines += textwrap.wrap(text, 94, subsequent_indent="    ")
    lines += ["", f"Returns [{r.unit}]."]
    if r.careful:
        lines += textwrap.wrap(without_reading(r), 94)
    if r.sample_time:
        lines.append(f"Call it every {r.sample_time:.9g} s.")
    within = f" in the first {CALLS} calls after a reset" if r.keeps else ""
    text = f"Differs from the model in double precision by at most {at_most(f.bound)}{within}"
    if f.error.jump:
        text += (
            f": {at_most(f.error.rounding)} by rounding, and {at_most(f.error.jump)} where rounding"
            " decides on which side of a jump of the equation a value falls"
        )
    times = "twice" if r.keeps else "three times"
    text += f" ({times} the largest difference found over many arguments)."
    return [*lines, *textwrap.wrap(text, 94)]


def table_macros(code: Code, readers: Mapping[str, str]) -> list[str]:
    """Macros for the storage of tables and their access: on an AVR in flash.

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


def read_macro(code: Code, macro: str, reader: str) -> list[str]:
    """Macro that reads tables of one more type."""
    name = f"{code.name.upper()}_{macro}(entry)"
    return [
        "#if defined(__AVR__)", f"#define {name} {reader}(&(entry))", "#else",
        f"#define {name} (entry)", "#endif", "",
    ]  # fmt: skip


def source(code: Code, functions: Sequence[Function]) -> str:
    """``NAME.c``: the functions and their tables."""
    lines = [
        *comment([f"{code.name}: {code.title}, in single precision", *preamble(code)[:-1]]),
        f'#include "{code.file}.h"', "", "#include <math.h>", "#include <stddef.h>", "",
    ]  # fmt: skip
    text = [*helpers([f.writer.routine for f in functions], code.name, SINGLE)]
    for f in functions:
        for part in ([*f.writer.tables()], f.writer.reset(), f.writer.function()):
            text += [*part, ""] if part else []
    reads = any(f"{code.name.upper()}_READ(" in line for line in text)
    return "\n".join([*lines, *(table_macros(code, _READERS) if reads else []), *text])


def self_test(code: Code, functions: Sequence[Function], macros: Sequence[Macro]) -> str:
    """``NAME_selftest.c``: ``main`` returns 0 when every golden vector holds."""
    lines = [
        *comment([*textwrap.wrap(f"{code.name}: {_ABOUT_TEST}", 94), *preamble(code)[:-1]]),
        f'#include "{code.file}.h"', "", "#include <math.h>", "",
        *table_macros(code, _READERS),
    ]  # fmt: skip
    for number, f in enumerate(functions, start=1):
        lines += _test_of(code, f, number)
    lines += macros_test(code, macros, len(functions))
    return "\n".join([*lines, *main_of(len(functions) + any(m.single for m in macros)), ""])


def main_of(count: int) -> list[str]:
    """``main``, which calls all tests in order."""
    lines = ["int main(void)", "{", "    int failed = 0;", ""]
    for n in range(count, 0, -1):
        lines += [f"    if (test_{n}() == 0) {{", f"        failed = {n};", "    }"]
    return [*lines, "    return failed;", "}"]


def table(head: str, rows: Sequence[str]) -> list[str]:
    """An array with its rows, one or more lines each."""
    last = len(rows) - 1
    lines = [wrapped(f"{row}{',' if k < last else ''}", "    ", "     ", 96)
             for k, row in enumerate(rows)]  # fmt: skip
    return [f"{head} = {{", *(line for row in lines for line in row), "};", ""]


def _test_of(code: Code, f: Function, number: int) -> list[str]:
    r, place = f.routine, f"{code.name.upper()}_TABLE"
    vectors = golden(r, lambda of, given: float(at_most(difference(of, given))), single, nan=True)
    columns = np.column_stack((vectors.arguments, vectors.outputs, vectors.outside))
    rows = ["{" + ", ".join(map(SINGLE.literal, row)) + "}" for row in columns]
    count, width = columns.shape
    read = [f"{code.name.upper()}_READ(vectors_{number}[k][{j}])" for j in range(width)]
    call = ", ".join((["&state"] if r.keeps else []) + read[:-2] + ["&outside"])
    state = [f"    {f.writer.name}_state state;"] if r.keeps else []
    reset = f"{f.writer.name}_reset(&state);"
    again = [
        f"        if ((k % {vectors.length}) == 0) {{", f"            {reset}", "        }",
    ] if r.keeps and count > vectors.length else []  # fmt: skip
    vectors_of = table(f"static const float vectors_{number}[{count}][{width}] {place}", rows)
    return [
        f"static int test_{number}(void)",
        "{",
        *(f"    {line}" for line in vectors_of[:-1]),
        *state,
        "    int held = 1;",
        "    int k;",
        "    int outside;",
        "",
        *([f"    {reset}"] if r.keeps else []),
        f"    for (k = 0; k < {count}; k++) {{",
        *again,
        *wrapped(f"const float found = {f.writer.name}({call});", "        "),
        f"        const float off = fabsf(found - {read[-2]});",
        f"        const float flag = fabsf((float)outside - {read[-1]});",
        "",
        f"        if (!(off <= {SINGLE.literal(vectors.tolerance)}) || (flag > 0.0f)) {{",
        "            held = 0;",
        "        }",
        "    }",
        "    return held;",
        "}",
        "",
    ]


def macros_test(code: Code, macros: Sequence[Macro], count: int, read: str = "READ") -> list[str]:
    """Hold the macros of the header against their numbers: the test behind ``count`` others."""
    known = [m for m in macros if m.single]
    if not known:
        return []
    name, number = code.name.upper(), count + 1
    lines = [
        "static int same(const float *given, const float *due, int count)", "{",
        "    int held = 1;", "    int k;", "", "    for (k = 0; k < count; k++) {",
        f"        if ({name}_{read}(given[k]) != {name}_{read}(due[k])) {{",
        "            held = 0;", "        }", "    }", "    return held;", "}", "",
    ]  # fmt: skip
    scalars = [m for m in known if not isinstance(m.value, list)]
    groups = [(m.name.lower(), m.name, m.value) for m in known if isinstance(m.value, list)]
    if scalars:
        given = "{" + ", ".join(m.name for m in scalars) + "}"
        groups.append(("numbers", given, [float(m.value) for m in scalars]))  # type: ignore[arg-type]
    lines += [f"static int test_{number}(void)", "{"]
    for group, given, values in groups:
        assert isinstance(values, list)
        head, size = f"static const float {group}", f"[{len(values)}] {name}_TABLE"
        lines += wrapped(f"{head}_given{size} = {given};", "    ")
        due = table(f"{head}_due{size}", [", ".join(map(SINGLE.literal, values))])
        lines += [f"    {line}" for line in due[:-1]]
    lines += ["    int held = 1;", ""]
    for group, _, values in groups:
        lines += [
            f"    if (same({group}_given, {group}_due, {len(values)}) == 0) {{",
            "        held = 0;", "    }",
        ]  # fmt: skip
    return [*lines, "    return held;", "}", ""]
