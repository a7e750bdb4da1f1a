"""The unit in which people read a value: that of their log, or SI with a prefix."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from math import isfinite

from ..errors import UnitError
from .conversion import conversion_factor, same_dimension
from .spelling import normalise_unit, split_reference

_LEAST, _BELOW = 0.1, 1e4  # sizes that need no other unit
_LEAST_RECORDED = 0.01  # size from which a unit of the log is kept, as other numbers are in it
_PREFIXES = {1e-9: "n", 1e-6: "µ", 1e-3: "m", 1.0: "", 1e3: "k", 1e6: "M", 1e9: "G"}
_LARGE = ("N", "Pa", "W", "J", "Hz")  # units whose multiples are in use
# A unit at the beginning of an expression that may take a prefix: not one that is raised.
_FIRST = re.compile(r"(N|Pa|V|A|s|m|rad|W|J|Hz)(?![A-Za-z0-9^])")
# What engineers write: smallest size, factor and name, the first one that fits.
_USUAL: Mapping[str, tuple[tuple[float, float, str], ...]] = {
    "s": ((0.5, 1.0, "s"), (5e-4, 1e3, "ms"), (0.0, 1e6, "µs")),
    "m": ((1.5, 1.0, "m"), (5e-5, 1e3, "mm"), (0.0, 1e6, "µm")),
    "m/s": ((1.5, 1.0, "m/s"), (0.0, 1e3, "mm/s")),
    "Pa": ((5e8, 1e-9, "GPa"), (5e3, 1e-5, "bar"), (0.0, 1.0, "Pa")),
    "m3/s": ((0.0, 6e4, "L/min"),),
}
# Powers and kilograms take no prefix as they stand.
_NAMED: Mapping[str, Mapping[str, float]] = {
    "kg": {"mg": 1e6, "g": 1e3, "kg": 1.0},
    "kg m2": {"g cm2": 1e7, "kg cm2": 1e4, "kg m2": 1.0},
    "m2": {"mm2": 1e6, "cm2": 1e4, "m2": 1.0},
    "m3": {"cm3": 1e6, "L": 1e3, "m3": 1.0},
}


@dataclass(frozen=True)
class DisplayUnit:
    """A unit, and the factor that turns a number in SI into one in it."""

    unit: str
    factor: float = 1.0


def display_unit(si_unit: str, size: float, recorded: Sequence[str] = ()) -> DisplayUnit:
    """Return the unit in which a value is read best.

    Parameters
    ----------
    si_unit
        Unit of the value, as parameter files write it.
    size
        Its magnitude [si_unit].
    recorded
        Units of the columns of the log. One that measures the same is taken, or the ratio of two
        (``bar/V``), unless the number would be below 0.01 or reach 10,000. Times are no choice of
        the log: they are in s, ms or µs by their size, and what is per time is per second.

    Returns
    -------
    DisplayUnit
        Where no unit of the log suits, what engineers write (``bar``, ``mm``, ``L/min``), SI
        itself, or SI with a prefix.

    Examples
    --------
    >>> display_unit("s", 0.0123)
    DisplayUnit(unit='ms', factor=1000.0)
    >>> display_unit("Pa/V", 1.5e5, ["V", "bar"]).unit
    'bar/V'
    """
    own = DisplayUnit(si_unit)
    if si_unit in ("", "1") or not isfinite(size):
        return own
    for candidate in _recorded(si_unit, recorded):
        if size == 0.0 or _LEAST_RECORDED <= size * candidate.factor < _BELOW:
            return candidate
    for smallest, factor, unit in _USUAL.get(si_unit, ()):
        if size >= smallest and size > 0.0:
            return DisplayUnit(unit, factor)
    if size == 0.0 or _LEAST <= size < _BELOW:
        return own
    scaled = _scaled(si_unit)
    fitting = [c for c in scaled if 1.0 <= size * c.factor < 1e3]
    return next(iter([*fitting, *(c for c in scaled if _LEAST <= size * c.factor < _BELOW)]), own)


def _recorded(si_unit: str, recorded: Sequence[str]) -> list[DisplayUnit]:
    """Units of the log that measure the same, then ratios of two of them."""
    plain = (split_reference(normalise_unit(unit))[0] for unit in recorded)
    known = ("s" if same_dimension(unit, "s") else unit for unit in plain)
    units = [unit for unit in dict.fromkeys(known) if unit not in ("", "1") and "%" not in unit]
    ratios = [f"{a}/({b})" if "/" in b else f"{a}/{b}" for a, b in permutations(units, 2)]
    found = []
    for unit in (*(u for u in units if u != "s"), *ratios):
        try:
            found.append(DisplayUnit(unit, 1.0 / conversion_factor(unit, si_unit)))
        except UnitError:
            continue
    return found


def _scaled(si_unit: str) -> list[DisplayUnit]:
    """SI with every prefix that is in use."""
    if si_unit in _NAMED:
        return [DisplayUnit(unit, factor) for unit, factor in _NAMED[si_unit].items()]
    if not (first := _FIRST.match(si_unit)):
        return []
    return [
        DisplayUnit(prefix + si_unit, 1.0 / size)
        for size, prefix in _PREFIXES.items()
        if size <= 1.0 or first[1] in _LARGE
    ]
