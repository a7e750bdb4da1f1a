"""The three files of a C export in fixed point: header, source and self-test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import floor

import numpy as np

from ...errors import UsageError
from ...experiment import FloatArray
from ...routines.routine import Argument
from ..golden import golden
from ..target import Code
from .constants import macros_of
from .files import at_most, comment, table_macros
from .fixed import Fixed, Omitted, fixed

_READERS = {"READ": "(int16_t)pgm_read_word", "READ_LONG": "(int32_t)pgm_read_dword"}
_TABLE_LINE = 12


def write(code: Code) -> Mapping[str, bytes]:
    """Return ``NAME.h``, ``NAME.c`` and ``NAME_selftest.c``.

    Raises
    ------
    UsageError
        If no routine of the file can be had in fixed point.
    """
    tried = [fixed(r, code.name) for r in code.routines]
    functions = [f for f in tried if isinstance(f, Fixed)]
    omitted = [f for f in tried if isinstance(f, Omitted)]
    if not functions:
        raise UsageError(
            f"nothing of {code.file} ({code.title}) can be had in fixed point: "
            + "; ".join(f"{o.name}, because {o.why}" for o in omitted),
            expected="A static map within one per cent of full scale was expected.",
            remedy="Export it with --arithmetic float32.",
        )
    files = {
        f"{code.file}.h": _header(code, functions, omitted),
        f"{code.file}.c": _source(code, functions),
        f"{code.file}_selftest.c": _self_test(code, functions),
    }
    return {name: "\n".join([*lines, ""]).encode("ascii") for name, lines in files.items()}


def signature(f: Fixed) -> str:
    """The function without its end."""
    arguments = "".join(f"int16_t {a.name}, " for a in f.routine.arguments)
    return f"int16_t {f.name}({arguments}int *outside)"


def _header(code: Code, functions: Sequence[Fixed], omitted: Sequence[Omitted]) -> list[str]:
    guard = f"{code.name.upper()}_H"
    words = [
        f"{code.name}: {code.title}, in fixed point",
        "",
        *code.remarks,
        *([""] if code.remarks else []),
        "All quantities are SI. Each is an int16_t times a power of two whose exponent is given",
        "below. An argument beyond its range is clamped and sets *outside to 1, which may be a",
        "null pointer. No memory is allocated and no function is recursive.",
        *(f"Left out: {o.name}, because {o.why}." for o in omitted),
    ]
    lines = [*comment(words), f"#ifndef {guard}", f"#define {guard}", "", "#include <stdint.h>"]
    lines += ["", *(line for m in macros_of(code) for line in m.lines)] if code.numbers else []
    for f in functions:
        base = f"{code.name}_{f.routine.name}".upper()
        lines += ["", *comment(_describe(f))]
        lines += [f"#define {base}_{a.name.upper()}_EXPONENT ({e})"
                  for a, e in zip(f.routine.arguments, f.units)]  # fmt: skip
        lines += [f"#define {base}_EXPONENT ({f.output.exponent})", f"{signature(f)};"]
    return [*lines, "", "#endif"]


def _describe(f: Fixed) -> list[str]:
    r = f.routine
    lines = [r.about, ""]
    for a, e in zip(r.arguments, f.units):
        kind = "range of the logs" if a.recorded else "not recorded, derived"
        lines.append(f"{a.name} [{a.unit}]: {a.about}; {a.low:.9g} to {a.high:.9g} ({kind}),")
        low, high = _ends(a, e)
        lines.append(f"    given as the integer nearest to {a.name} * 2^{-e}: {low} to {high}")
    share = at_most(100.0 * f.bound / f.scale)
    proof = "interval bounds over the ranges above"
    if f.complete:
        proof = "every one of them was tried"
    lines += [
        "",
        f"Returns [{r.unit}] * 2^{-f.output.exponent}: multiply by 2^{f.output.exponent}.",
        f"Differs from the model in double precision by at most {at_most(f.bound)}, {share} % of",
        f"full scale ({f.scale:.4g}), at the arguments that the integers stand for",
        f"({proof}).",
    ]
    if f.code.width.bits > 15:
        lines.append(
            "Factors of 16 bits are too few: 32 are used, slower than float on 8-bit chips."
        )
    return lines


def _ends(a: Argument, exponent: int) -> tuple[int, int]:
    return round(a.low / 2.0**exponent), round(a.high / 2.0**exponent)


def _source(code: Code, functions: Sequence[Fixed]) -> list[str]:
    lines = [
        f'#include "{code.file}.h"', "",
        "#if (-3 >> 1) != -2",
        "#error a shift of a negative number to the right has to keep its sign",
        "#endif", "",
        *table_macros(code, _READERS),
    ]  # fmt: skip
    written = [(f, _function(f)) for f in functions]
    text = "\n".join(line for _, function in written for line in function)
    for bits in (15, 31):
        if f"{code.name}_sqrt{bits}(" in text:
            lines += _square_root(code.name, bits)
    for f, function in written:
        for number, entries in enumerate(f.code.tables):
            name = f"{code.name}_{f.routine.name}_table_{number}"
            if f"{name}[" in text:
                lines += _table(code, name, entries)
        for layer, rows in f.code.biases.items():
            name = f"{code.name}_{f.routine.name}_{layer}_biases"
            text_of = ["{" + ", ".join(map(str, row)) + "}" for row in rows]
            inside = ",\n    ".join(text_of)
            head = f"static const int32_t {name}[{len(rows)}][{len(rows[0])}]"
            lines += [f"{head} {code.name.upper()}_TABLE = {{\n    {inside}}};", ""]
        lines += function
    return lines


def _table(code: Code, name: str, entries: Sequence[int]) -> list[str]:
    rows = [entries[k : k + _TABLE_LINE] for k in range(0, len(entries), _TABLE_LINE)]
    inside = ",\n    ".join(", ".join(map(str, row)) for row in rows)
    head = f"static const int16_t {name}[{len(entries)}] {code.name.upper()}_TABLE"
    return [f"{head} = {{\n    {inside}}};", ""]


def _square_root(name: str, bits: int) -> list[str]:
    """Whole part of a square root, two bits of the radicand at a time."""
    long, short = 2 * bits + 2, bits + 1
    kind = f"uint{long}_t"
    return [
        f"static int{short}_t {name}_sqrt{bits}(int{long}_t radicand)",
        "{",
        f"    {kind} rest = radicand > 0 ? ({kind})radicand : 0;",
        f"    {kind} root = 0, bit = UINT{long}_C(1) << {2 * bits - 2};",
        "",
        "    while (bit) {",
        "        if (rest >= root + bit) {",
        "            rest -= root + bit;",
        "            root = (root >> 1) + bit;",
        "        } else {",
        "            root >>= 1;",
        "        }",
        "        bit >>= 2;",
        "    }",
        f"    return (int{short}_t)root;",
        "}",
        "",
    ]


def _function(f: Fixed) -> list[str]:
    lines = ["int beyond = 0;"]
    for a, e in zip(f.routine.arguments, f.units):
        low, high = _ends(a, e)
        lines.append(f"if ({a.name} < {low}) {{ {a.name} = {low}; beyond = 1; }}")
        lines.append(f"if ({a.name} > {high}) {{ {a.name} = {high}; beyond = 1; }}")
    lines += f.code.lines(" ".join([f.output.text, *f.flags]))
    lines += [f"if ({condition}) beyond = 1;" for condition in f.flags]
    lines += ["if (outside) *outside = beyond;", f"return {f.output.text};"]
    return [signature(f), "{", *(f"    {line}" for line in lines), "}", ""]


def _self_test(code: Code, functions: Sequence[Fixed]) -> list[str]:
    lines = [
        *comment([f"{code.name}: golden vectors of the Python model. main returns 0 when all hold,",
                  "otherwise the number of the function that failed."]),
        f'#include "{code.file}.h"', "", *table_macros(code, _READERS),
    ]  # fmt: skip
    for number, f in enumerate(functions, start=1):
        lines += _test_of(code, f, number)
    lines += ["int main(void)", "{"]
    lines += [f"    if (!test_{n}()) return {n};" for n in range(1, len(functions) + 1)]
    return [*lines, "    return 0;", "}"]


def vectors_of(f: Fixed) -> list[list[int]]:
    """Golden vectors in mantissas: arguments, output and flag."""
    units = 2.0 ** np.array(f.units)

    def rounded(values: FloatArray) -> FloatArray:
        return np.asarray(np.clip(np.round(values / units), -32768, 32767) * units)

    vectors = golden(f.routine, lambda of, given: f.bound, rounded)
    given, outside = np.round(vectors.arguments / units), vectors.outside
    outputs = np.round(vectors.outputs / f.output.unit)
    rows = np.column_stack([given, np.clip(outputs, -32768, 32767), outside]).astype(int)
    return [list(map(int, row)) for row in rows]


def _test_of(code: Code, f: Fixed, number: int) -> list[str]:
    rows = vectors_of(f)
    width = len(rows[0])
    allowed = floor(f.bound / f.output.unit + 0.5)
    text = ",\n    ".join("{" + ", ".join(map(str, row)) + "}" for row in rows)
    read = [f"{code.name.upper()}_READ(vectors_{number}[k][{j}])" for j in range(width)]
    table = f"{code.name.upper()}_TABLE"
    return [
        f"static const int16_t vectors_{number}[{len(rows)}][{width}] {table} = {{\n    {text}}};",
        "",
        f"static int test_{number}(void)",
        "{",
        "    int k, outside;",
        "",
        f"    for (k = 0; k < {len(rows)}; k++) {{",
        f"        const int32_t found = {f.name}({', '.join(read[:-2])}, &outside);",
        f"        const int32_t off = found - {read[-2]};",
        "",
        f"        if (off > {allowed} || off < -{allowed} || outside != {read[-1]}) return 0;",
        "    }",
        "    return 1;",
        "}",
        "",
    ]
