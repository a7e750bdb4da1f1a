"""The three files of a C export in fixed point: header, source and self-test."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence

from ...errors import UsageError
from ..target import Code, plain_text
from .constants import Macro, macros_of
from .files import (
    at_most,
    comment,
    guarded,
    macros_test,
    main_of,
    preamble,
    read_macro,
    table,
    table_macros,
)
from .fixed import Fixed, Omitted, fixed
from .fixed_golden import vectors_of
from .language import WIDTH, unread, wrapped

_ABOUT_TEST = (
    "golden vectors. main returns 0 when all hold to the last bit, otherwise the number of the "
    "function that failed; the last number stands for the macros of the header. Each lies within "
    "the bound of the header of what the Python model gives in double precision."
)
_READERS = {"READ": "(int16_t)pgm_read_word", "READ_LONG": "(int32_t)pgm_read_dword"}


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
    numbers = macros_of(code)
    files = {
        f"{code.file}.h": _header(code, functions, omitted, numbers),
        f"{code.file}.c": _source(code, functions),
        f"{code.file}_selftest.c": _self_test(code, functions, numbers),
    }
    return {name: "\n".join([*lines, ""]).encode("ascii") for name, lines in files.items()}


def signature(f: Fixed) -> str:
    """The function without its end."""
    arguments = "".join(f"int16_t {a.name}, " for a in f.routine.arguments)
    return f"int16_t {f.name}({arguments}int *outside)"


def _header(
    code: Code, functions: Sequence[Fixed], omitted: Sequence[Omitted], numbers: Sequence[Macro]
) -> list[str]:
    left = (f"Left out: {o.name}, because {o.why}." for o in omitted)
    words = [
        f"{code.name}: {code.title}, in fixed point",
        *preamble(code),
        "All quantities are SI. Each is an int16_t times a power of two whose exponent is given",
        "below. An argument beyond its range is clamped and sets *outside to 1, which may be a",
        "null pointer. No memory is allocated and no function is recursive.",
        *(line for text in left for line in textwrap.wrap(text, 94)),
    ]
    lines = ["#include <stdint.h>", "", *(line for m in numbers for line in m.lines)]
    for f in functions:
        lines += ["", *comment(_describe(f)), *(line for m in exponents(f) for line in m.lines)]
        lines += wrapped(f"{signature(f)};", "")
    return guarded(code, comment(words), [*lines, ""])


def exponents(f: Fixed) -> list[Macro]:
    """Exponents of the arguments and of the output as macros."""
    base = f"{f.code.prefix}_{f.routine.name}".upper()
    names = [f"{base}_{a.name.upper()}_EXPONENT" for a in f.routine.arguments]
    values = [*f.units, f.output.exponent]
    return [
        Macro(n, v, (f"#define {n} ({v})",)) for n, v in zip([*names, f"{base}_EXPONENT"], values)
    ]


def _describe(f: Fixed) -> list[str]:
    r = f.routine
    lines = [*textwrap.wrap(r.about, 94), ""]
    for a, e, ends in zip(r.arguments, f.units, f.ends):
        kind = "range of the logs" if a.recorded else "not recorded, derived"
        text = f"{a.name} [{a.unit}]: {a.about}; {a.low + 0.0:.9g} to {a.high:.9g} ({kind}),"
        lines += textwrap.wrap(text, 94, subsequent_indent="    ")
        low, high = ends
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


def _source(code: Code, functions: Sequence[Fixed]) -> list[str]:
    lines = [
        *comment([f"{code.name}: {code.title}, in fixed point", *preamble(code)[:-1]]),
        f'#include "{code.file}.h"', "", "#include <stddef.h>", "",
        "#if (-3 >> 1) != -2",
        "#error a shift of a negative number to the right has to keep its sign",
        "#endif", "",
    ]  # fmt: skip
    body = [line for f in functions for line in _function(f)]
    text = "\n".join(body)
    readers = {k: v for k, v in _READERS.items() if f"{code.name.upper()}_{k}(" in text}
    lines += table_macros(code, readers) if readers else []
    lines += _within(code.name)
    for bits in (15, 31):
        if f"{code.name}_sqrt{bits}(" in text:
            lines += _square_root(code.name, bits)
    return [*lines, *body]


def _tables(f: Fixed, text: str) -> list[str]:
    """The tables that the text of a function reads."""
    lines, place = list[str](), f"{f.code.prefix.upper()}_TABLE"
    for number, entries in enumerate(f.code.tables):
        name = f"table_{number}"
        if f"{name}[" in text:
            rows = [", ".join(map(str, entries))]
            lines += table(f"static const int16_t {name}[{len(entries)}] {place}", rows)[:-1]
    for layer, rows_of in f.code.biases.items():
        name = f"{layer}_biases"
        rows = ["{" + ", ".join(map(str, row)) + "}" for row in rows_of]
        shape = f"[{len(rows)}][{len(rows_of[0])}]"
        lines += table(f"static const int32_t {name}{shape} {place}", rows)[:-1]
    return lines


def _within(name: str) -> list[str]:
    return [
        f"static int16_t {name}_within(int16_t given, int16_t low, int16_t high, int *beyond)",
        "{",
        "    int16_t found = given;", "",
        "    if (given < low) {", "        found = low;", "        *beyond = 1;",
        "    } else if (given > high) {", "        found = high;", "        *beyond = 1;",
        "    } else {", "        /* it is within the range */", "    }",
        "    return found;", "}", "",
    ]  # fmt: skip


def _square_root(name: str, bits: int) -> list[str]:
    """Whole part of a square root, two bits of the radicand at a time."""
    long, short = 2 * bits + 2, bits + 1
    kind = f"uint{long}_t"
    return [
        f"static int{short}_t {name}_sqrt{bits}(int{long}_t radicand)",
        "{",
        f"    {kind} rest = 0u;",
        f"    {kind} root = 0u;",
        f"    {kind} bit = UINT{long}_C(1) << {2 * bits - 2}u;",
        "",
        "    if (radicand > 0) {",
        f"        rest = ({kind})radicand;",
        "    }",
        "    while (bit > 0u) {",
        "        if (rest >= (root + bit)) {",
        "            rest -= root + bit;",
        "            root = (root >> 1u) + bit;",
        "        } else {",
        "            root >>= 1u;",
        "        }",
        "        bit >>= 2u;",
        "    }",
        f"    return (int{short}_t)root;",
        "}",
        "",
    ]


def _function(f: Fixed) -> list[str]:
    base = f"{f.code.prefix}_{f.routine.name}".upper()
    macros, lines = list[str](), list[str]()
    for a, e, ends in zip(f.routine.arguments, f.units, f.ends):
        names = [f"{base}_{a.name}_{end}".upper() for end in ("low", "high")]
        macros += [f"#define {n} ({v})" for n, v in zip(names, ends)]
        call = f"{f.code.prefix}_within({a.name}, {', '.join(names)}, &beyond)"
        lines += [f"/* [{plain_text(a.unit)}] * 2^{-e} */"]
        lines += wrapped(f"const int16_t {a.name}_used = {call};", "", None, WIDTH - 4)
    lines += f.code.lines(" ".join([f.output.text, *f.flags]))
    for condition in f.flags:
        lines += [f"if ({condition}) {{", "    beyond = 1;", "}"]
    lines += ["if (outside != NULL) {", "    *outside = beyond;", "}", f"return {f.output.text};"]
    lines = unread(lines, [f"{a.name}_used" for a in f.routine.arguments])
    inside = [*_tables(f, "\n".join(lines)), "int beyond = 0;", *lines]
    return [*macros, "", *wrapped(signature(f), ""), "{", *(f"    {i}" for i in inside), "}", ""]


def _self_test(code: Code, functions: Sequence[Fixed], numbers: Sequence[Macro]) -> list[str]:
    lines = [
        *comment([*textwrap.wrap(f"{code.name}: {_ABOUT_TEST}", 94), *preamble(code)[:-1]]),
        f'#include "{code.file}.h"', "", *table_macros(code, {"READ": _READERS["READ"]}),
    ]  # fmt: skip
    for number, f in enumerate(functions, start=1):
        lines += _test_of(code, f, number)
    macros = [*numbers, *(m for f in functions for m in exponents(f))]
    test = macros_test(code, macros, len(functions), "READ_FLOAT")
    if test:
        lines += read_macro(code, "READ_FLOAT", "pgm_read_float")
    return [*lines, *test, *main_of(len(functions) + bool(test))]


def _test_of(code: Code, f: Fixed, number: int) -> list[str]:
    rows = vectors_of(f)
    width, name = len(rows[0]), code.name.upper()
    text = ["{" + ", ".join(map(str, row)) + "}" for row in rows]
    read = [f"{name}_READ(vectors_{number}[k][{j}])" for j in range(width)]
    vectors = table(
        f"static const int16_t vectors_{number}[{len(rows)}][{width}] {name}_TABLE", text
    )
    return [
        f"static int test_{number}(void)",
        "{",
        *(f"    {line}" for line in vectors[:-1]),
        "    int held = 1;",
        "    int k;",
        "    int outside;",
        "",
        f"    for (k = 0; k < {len(rows)}; k++) {{",
        *wrapped(f"const int16_t found = {f.name}({', '.join(read[:-2])}, &outside);", "        "),
        f"        const int16_t due = {read[-2]};",
        f"        const int16_t beyond = {read[-1]};",
        "",
        "        if ((found != due) || (outside != beyond)) {",
        "            held = 0;",
        "        }",
        "    }",
        "    return held;",
        "}",
        "",
    ]
