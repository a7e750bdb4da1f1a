"""The parameters of a file as macros, for code that a controller already has."""

from __future__ import annotations

import textwrap

import numpy as np

from ...block import Block
from ..flat import Entry, known_how, parameters_of
from ..target import plain_text

_WIDTH = 96


def macros_of(name: str, block: Block) -> list[str]:
    """``#define NAME_PARAMETER value`` for every parameter, with its unit behind it.

    A number keeps all digits of the file and becomes a ``float``; a matrix is a list by rows,
    its shape beside it.
    """
    lines = []
    for entry in parameters_of(block):
        lines += _macro(f"{name}_{entry.key}".upper(), entry, block)
    if not lines:
        return []
    about = "What was identified, for code of your own: the functions hold these numbers already."
    return [f"/* {about} */", *lines]


def _macro(name: str, entry: Entry, block: Block) -> list[str]:
    how = known_how(block.document.parameters[entry.parameter])
    unit = f"[{plain_text(entry.unit)}] " if entry.unit else ""
    note = f"/* {unit}{plain_text(f'{entry.description}, {how}')} */"
    if isinstance(entry.value, list):
        numbers = textwrap.wrap(", ".join(map(_literal, entry.value)), _WIDTH)
        rows = [f"#define {name} {{", *(f"    {row}" for row in numbers)]
        return [*(f"{row} \\" for row in rows), f"}} {note}"]
    text = _literal(entry.value) if isinstance(entry.value, float) else str(entry.value)
    return [f"#define {name} {f'({text})' if text.startswith('-') else text} {note}"]


def _literal(value: float) -> str:
    """A constant with all digits; a ``float`` where single precision reaches."""
    with np.errstate(over="ignore"):
        reaches = bool(np.isfinite(np.float32(value)))
    return f"{value!r}{'f' if reaches else ''}"
