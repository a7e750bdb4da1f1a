"""The numbers that functions were made from as macros, for code that a controller already has."""

from __future__ import annotations

import textwrap

import numpy as np

from ..target import Code, Entry, plain_text

_WIDTH = 96


def macros_of(code: Code) -> list[str]:
    """``#define NAME_PARAMETER value`` for every number, with its unit behind it.

    A number keeps all digits and becomes a ``float``; a matrix is a list by rows, its shape
    beside it. Words are left out.
    """
    about = "What the functions were made from and hold already, for code of your own."
    lines = [f"/* {about} */"]
    for entry in code.numbers:
        if not isinstance(entry.value, str):
            lines += _macro(f"{code.name}_{entry.key}".upper(), entry)
    return lines


def _macro(name: str, entry: Entry) -> list[str]:
    unit = f"[{plain_text(entry.unit)}] " if entry.unit else ""
    about = plain_text(f"{entry.description}{f', {entry.how}' if entry.how else ''}")
    note = f"/* {unit}{about} */"
    if isinstance(entry.value, list):
        numbers = textwrap.wrap(", ".join(map(_literal, entry.value)), _WIDTH)
        rows = [f"#define {name} {{", *(f"    {row}" for row in numbers)]
        return [*(f"{row} \\" for row in rows), f"}} {note}"]
    text = _literal(entry.value) if isinstance(entry.value, float) else f"{entry.value:d}"
    return [f"#define {name} {f'({text})' if text.startswith('-') else text} {note}"]


def _literal(value: float) -> str:
    """A constant with all digits; a ``float`` where single precision reaches."""
    with np.errstate(over="ignore"):
        reaches = bool(np.isfinite(np.float32(value)))
    return f"{value!r}{'f' if reaches else ''}"
