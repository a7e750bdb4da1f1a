"""Numbers and units as people read them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import floor, isfinite, log10
from typing import Any

import numpy as np

from ..tables import percent_text
from ..units import display_unit

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Scale:
    """Factor from SI to the unit that is shown, and its name."""

    factor: float
    unit: str

    def label(self, name: str) -> str:
        """Return ``name [unit]``, the name alone for a plain number."""
        return f"{name} [{self.unit}]" if self.unit else name


def choose_scale(unit: str, size: float) -> Scale:
    """Return the unit in which SI values of a typical size are read best."""
    found = display_unit(unit, size)
    return Scale(found.factor, pretty_unit(found.unit))


def scaled(value: float, unit: str, digits: int = 3) -> str:
    """A number in SI as people say it: ``0.0000502 m`` as ``50.2 µm``."""
    scale = choose_scale(unit, abs(value))
    return f"{short(value * scale.factor, digits)} {scale.unit}".rstrip()


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
        return _minus(f"{value:.{max(digits - 1 - exponent, 0)}f}")
    mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
    return _minus(f"{mantissa}×10{str(int(power)).translate(_SUPERSCRIPT)}")


def with_error(value: float, error: float | None) -> str:
    """A value with its standard error, both to the digit the error allows."""
    if error is None or not isfinite(error) or error <= 0.0:
        return short(value)
    size = max(abs(value), error)
    exponent = floor(log10(size))
    power = exponent if not -2 <= exponent < 6 else 0
    decimals = min(max(1 - floor(log10(error / 10.0**power)), 0), 12)
    text = f"{value / 10.0**power:.{decimals}f} ± {error / 10.0**power:.{decimals}f}"
    if power:
        text = f"({text})×10{str(power).translate(_SUPERSCRIPT)}"
    return _minus(text)


def show(value: Any, error: Any = None) -> str:
    """A parameter value of any rank in one line; lists are summarised."""
    if isinstance(value, list | tuple):
        flat = flatten(value)
        if len(flat) <= 2:
            return " … ".join(short(v) for v in flat)
        size = f"{len(value)} × {len(value[0])}" if isinstance(value[0], list) else str(len(flat))
        return f"{size} values, {short(min(flat), 3)} … {short(max(flat), 3)}"
    return with_error(float(value), error if isinstance(error, int | float) else None)


def flatten(value: Any) -> list[float]:
    """All numbers of a nested list."""
    return np.ravel(value).astype(float).tolist()


def percent(value: float | None) -> str:
    """An agreement in percent; one short of 100 is never rounded to it."""
    if value is None:
        return "–"
    decimals = 2
    if value < 0.0:
        return _minus(percent_text(value))
    while decimals < 8 and value < 100.0 <= round(value, decimals):
        decimals += 1
    return _minus(f"{value:.{decimals}f}") + " %"


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


def _minus(text: str) -> str:
    return text.replace("-", "−")
