"""Words of Structured Text: literals, identifiers, comments and declarations."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence
from math import isfinite

WIDTH = 100
INDENT = "    "
# IEC 61131-3 and what TwinCAT adds: keywords, types, operators and standard functions and blocks
_WORDS = """
ABS ABSTRACT ACOS ACTION ADD ADR AND AND_THEN ANY ARRAY ASIN AT ATAN ATAN2 BEGIN BIT BITADR BOOL
BY BYTE CAL CALC CALCN CASE CONCAT CONFIGURATION CONSTANT CONTINUE COS CTD CTU CTUD DATE
DATE_AND_TIME DELETE DINT DIV DO DT DWORD ELSE ELSIF END END_ACTION END_CASE END_CONFIGURATION
END_FOR END_FUNCTION END_FUNCTION_BLOCK END_IF END_INTERFACE END_METHOD END_NAMESPACE
END_PROGRAM END_PROPERTY END_REPEAT END_RESOURCE END_STEP END_STRUCT END_TRANSITION END_TYPE
END_UNION END_VAR END_WHILE EQ EXIT EXP EXPT EXTENDS FALSE FINAL FIND FOR FROM FUNCTION
FUNCTION_BLOCK F_EDGE F_TRIG GE GET GOTO GT IF IMPLEMENTS INDEXOF INI INITIAL_STEP INSERT INT
INTERFACE INTERNAL INTERVAL JMP JMPC JMPCN LABEL LD LDATE LDN LDT LE LEFT LEN LIMIT LINT LN LOG
LREAL LT LTIME LTOD LWORD MAX MEM MEMORY METHOD MID MIN MOD MOVE MUL MUX NAMESPACE NE NEG NOT
NULL OF ON OR OR_ELSE OVERRIDE PARAMS PERSISTENT POINTER PRIORITY PRIVATE PROGRAM PROPERTY
PROTECTED PUBLIC R READ_ONLY READ_WRITE REAL REF REFERENCE REPEAT REPLACE RESOURCE RET RETAIN
RETC RETCN RETURN RIGHT ROL ROR RS RTC R_EDGE R_TRIG S SEL SEMA SET SHL SHR SIN SINGLE SINT
SIZEOF SQRT SR ST STEP STN STRING STRUCT SUB SUPER TAN TASK TEST THEN THIS TIME TIME_OF_DAY TO
TOD TOF TON TP TRANSITION TRUE TRUNC TYPE UDINT UINT ULINT UNION UNTIL USING USINT VAR
VAR_ACCESS VAR_CONFIG VAR_EXTERNAL VAR_GLOBAL VAR_INPUT VAR_INST VAR_IN_OUT VAR_OUTPUT VAR_STAT
VAR_TEMP WCHAR WHILE WITH WORD WSTRING XOR
"""
RESERVED = frozenset(_WORDS.split())


class Names:
    """Identifiers of one scope: none is reserved, none is given twice; case does not matter."""

    def __init__(self) -> None:
        self._taken = set(RESERVED)

    def new(self, wanted: str) -> str:
        """Return ``wanted`` or, where that is no free identifier, one that resembles it.

        An identifier holds no two underscores in a row and none at its end.
        """
        base = re.sub(r"[^A-Za-z0-9]+", "_", wanted).strip("_")
        if not base or base[0].isdigit():
            base = f"x_{base}".rstrip("_")
        name, number = base, 0
        while name.upper() in self._taken:
            number += 1
            name = f"{base}_{number}"
        self._taken.add(name.upper())
        return name


def literal(value: float) -> str:
    """LREAL literal that reads back as the same number.

    Raises
    ------
    ValueError
        When the number is not finite: the language has no literal for that.
    """
    if not isfinite(value):
        raise ValueError(f"{value!r} has no literal in Structured Text")
    mantissa, _, exponent = repr(float(value)).partition("e")
    if "." not in mantissa:
        mantissa += ".0"
    return f"{mantissa}E{int(exponent)}" if exponent else mantissa


def harmless(text: str) -> str:
    """One line of printable ASCII that neither opens nor closes a comment."""
    plain = text.encode("ascii", "replace").decode("ascii")
    line = " ".join("".join(c if c.isprintable() else " " for c in plain).split())
    return line.replace("*)", "* )").replace("(*", "( *")


def comment(text: str) -> str:
    """A comment at the end of a line."""
    return f"(* {harmless(text)} *)"


def block_comment(lines: Iterable[str]) -> list[str]:
    """A comment of several lines, wrapped; an empty one stays."""
    found = ["(*"]
    for line in lines:
        found += textwrap.wrap(harmless(line), WIDTH - 3) or [""]
    return [f"   {x}".rstrip() if k else x for k, x in enumerate(found)] + ["*)"]


def wrapped(line: str, depth: int) -> list[str]:
    """A statement or declaration, broken between its words where it is long."""
    return textwrap.wrap(
        line, WIDTH, initial_indent=INDENT * depth, subsequent_indent=INDENT * (depth + 1),
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip


def number(name: str, value: float, about: str = "") -> list[str]:
    """Declaration of a number with its value."""
    return [
        f"{INDENT}{name} : LREAL := {literal(value)};" + (f" {comment(about)}" if about else "")
    ]


def array(name: str, values: Sequence[str], shape: Sequence[int], kind: str) -> list[str]:
    """Declaration of an array with its values, rows one after the other."""
    ranges = ", ".join(f"0..{n - 1}" for n in shape)
    return wrapped(f"{name} : ARRAY[{ranges}] OF {kind} := [{', '.join(values)}];", 1)


def section(keyword: str, lines: Sequence[str]) -> list[str]:
    """Declarations between a keyword and ``END_VAR``; nothing where there are none."""
    return [keyword, *lines, "END_VAR"] if lines else []
