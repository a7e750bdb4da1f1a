"""The numbers that functions were made from as macros, for code that a controller already has."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

import numpy as np

from ..target import Code, Entry, plain_text

_WIDTH = 94


@dataclass(frozen=True)
class Macro:
    """A number, or a list of them, under a name; ``lines`` define it, with its unit behind."""

    name: str
    value: float | int | list[float]
    lines: tuple[str, ...]

    @property
    def single(self) -> bool:
        """Return whether single precision holds it."""
        return _reaches(self.value)


def macros_of(code: Code) -> list[Macro]:
    """``#define NAME_PARAMETER value`` for every number, with its unit behind it.

    A number keeps all digits and becomes a ``float``; a matrix is a list by rows, its shape
    beside it. Words are left out.
    """
    found = []
    for entry in code.numbers:
        if not isinstance(entry.value, str):
            name = f"{code.name}_{entry.key}".upper()
            found.append(Macro(name, entry.value, tuple(_lines(name, entry))))
    return found


def _lines(name: str, entry: Entry) -> list[str]:
    how = f", {entry.how}" if entry.how else ""
    about = textwrap.wrap(plain_text(f"{entry.description}{how}"), _WIDTH)
    lines = [f"{'   ' if k else '/* '}{line}" for k, line in enumerate(about)]
    lines[-1] += " */"
    unit = f" /* [{plain_text(entry.unit)}] */" if entry.unit else ""
    if isinstance(entry.value, list):
        numbers = textwrap.wrap(", ".join(map(_literal, entry.value)), _WIDTH)
        rows = [f"#define {name} {{", *(f"    {row}" for row in numbers)]
        return [*lines, *(f"{row} \\" for row in rows), f"}}{unit}"]
    text = _literal(entry.value) if isinstance(entry.value, float) else f"{entry.value:d}"
    return [*lines, f"#define {name} {f'({text})' if text.startswith('-') else text}{unit}"]


def _literal(value: float) -> str:
    """A constant with all digits; a ``float`` where single precision reaches, zero below it."""
    if abs(value) < 2.0**-150:
        value = 0.0  # of which a compiler says that it truncates a constant
    return f"{value + 0.0!r}{'f' if _reaches(value) else ''}"


def _reaches(value: float | list[float]) -> bool:
    with np.errstate(over="ignore"):
        return bool(np.all(np.isfinite(np.asarray(value, dtype=np.float32))))
