"""Numbers and units as people read them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, isfinite, log10
from typing import Any

import numpy as np

from ..experiment import FloatArray
from ..family import Quantity
from ..parameters.document import Derived
from ..tables import format_estimate, percent_text
from ..units import display_unit

_POWER = re.compile(r"e([+-]?\d+)")
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Scale:
    """Factor from SI to the unit that is shown, and its name."""

    factor: float
    unit: str

    def label(self, name: str) -> str:
        """Return ``name [unit]``, the name alone for a plain number."""
        return f"{name} [{self.unit}]" if self.unit else name


def choose_scale(unit: str, size: float, recorded: Sequence[str] = ()) -> Scale:
    """Return the unit in which SI values of a typical size are read best.

    ``recorded`` are the units of the log: see :func:`.units.display_unit`.
    """
    found = display_unit(unit, size, recorded)
    return Scale(found.factor, pretty_unit(found.unit))


def scale_of(values: Sequence[FloatArray], unit: str, recorded: Sequence[str] = ()) -> Scale:
    """Return the unit for the largest finite size among arrays."""
    finite = (np.abs(v[np.isfinite(v)]) for v in values)
    size = max((float(v.max(initial=0.0)) for v in finite), default=0.0)
    return choose_scale(unit, size, recorded)


def scaled(value: float, unit: str, recorded: Sequence[str] = (), digits: int = 3) -> str:
    """A number in SI as people say it: ``0.0000502 m`` as ``50.2 µm``."""
    scale = choose_scale(unit, abs(value), recorded)
    return f"{short(value * scale.factor, digits)} {scale.unit}".rstrip()


def in_scale(q: Derived | Quantity, recorded: Sequence[str]) -> tuple[Any, Any, Scale]:
    """Return value and standard error in the unit in which they are read best, and that unit."""
    scale = choose_scale(q.unit, float(np.abs(q.value).max(initial=0.0)), recorded)
    error = None if q.std_error is None else (scale.factor * np.array(q.std_error)).tolist()
    return (scale.factor * np.array(q.value, dtype=float)).tolist(), error, scale


def pretty_unit(unit: str) -> str:
    """``kg m2`` as ``kg·m²``, ``Pa^0.5`` as ``√Pa``; a plain number has none."""
    if unit in ("1", ""):
        return ""
    unit = re.sub(r"(\w+)\^0\.5\b", r"√\1", unit)
    raised = re.sub(r"(?<=[A-Za-z])(-?\d+)", lambda m: m[0].translate(_SUPERSCRIPT), unit)
    return raised.replace(" ", "·")


def short(value: float, digits: int = 4) -> str:
    """A number with so many significant digits, powers of ten written out."""
    if not isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    exponent = floor(log10(abs(value)))
    if -3 <= exponent < 6:
        return in_print(f"{value:.{max(digits - 1 - exponent, 0)}f}")
    return in_print(f"{value:.{digits - 1}e}")


def show(value: Any, error: Any = None) -> str:
    """A parameter value of any rank in one line; lists are summarised."""
    if isinstance(value, list | tuple):
        flat = flatten(value)
        if len(flat) <= 2:
            return " … ".join(short(v) for v in flat)
        size = f"{len(value)} × {len(value[0])}" if isinstance(value[0], list) else str(len(flat))
        return f"{size} values, {short(min(flat), 3)} … {short(max(flat), 3)}"
    return in_print(format_estimate(float(value), error))


def flatten(value: Any) -> list[float]:
    """All numbers of a nested list."""
    return np.ravel(value).astype(float).tolist()


def percent(value: float | None) -> str:
    """An agreement in percent; one short of 100 is never rounded to it."""
    if value is None:
        return "–"
    return in_print(percent_text(value))


def count(number: int) -> str:
    """An integer in groups of three digits."""
    return f"{number:,}".replace(",", "\u2009" if number >= 10_000 else "")


def spoken(name: str) -> str:
    """A name of a program as people say it: ``dead_time`` as ``dead time``."""
    return name.replace("_", " ")


def plain(text: str, longest: int = 60) -> str:
    """Text from outside as a figure can show it: printable, of bounded length."""
    known = ((c.isprintable() and ord(c) < 0x530) or c == "…" for c in text)
    kept = "".join(c if shown else "?" for c, shown in zip(text, known))
    if len(kept) <= longest:
        return kept
    head = (longest - 1) // 2
    return f"{kept[:head]}…{kept[-(longest - 1 - head) :]}"


def in_print(text: str) -> str:
    """Numbers with the sign and the powers of print: ``-1.5e-06`` as ``−1.5×10⁻⁶``."""
    raised = _POWER.sub(lambda m: "×10" + str(int(m[1])).translate(_SUPERSCRIPT), text)
    return raised.replace("-", "−")
