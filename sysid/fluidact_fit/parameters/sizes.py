"""Sizes that the numbers of a parameter file may have: those that the options have.

Beyond them squares and quotients leave the range of floating point, in a controller more so.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..units.quantities import plausible
from .problems import Location, Problems, find_entries

_LEAST, _MOST = 1e-12, 1e9  # s, of a sample time
_SQUARE = 1e60  # of a variance, and of a coefficient made of several parameters

_QUANTITIES = (
    *(
        (part, "*", key)
        for part in ("parameters", "derived")
        for key in ("value", "std_error", "ci95")
    ),
    ("validity", "*", "low"),
    ("validity", "*", "high"),
    ("fit", "rmse", "value"),
    *(
        (*logs, "*", key, "value")
        for logs in (("fit", "logs"), ("validation",))
        for key in ("rmse", "offset")
    ),
    ("provenance", "options", "*", "*"),
    ("provenance", "logs", "*", "columns", "*", "scale"),
    ("provenance", "logs", "*", "columns", "*", "step", "*"),
)
_SQUARES = (("covariance", "matrix"), ("model",))
_PERIODS = (("model", "discrete", "sample_time"), ("provenance", "logs", "*", "sample_time"))


def check_sizes(document: dict[str, Any], problems: Problems) -> None:
    """Note every number that no quantity has in SI."""
    for path in _QUANTITIES:
        scalars = path[0] == "parameters" and path[-1] == "value"
        for place, number in _numbers(document, path):
            alone = scalars and len(place) == len(path)  # of a list, a very small one is zero
            if words := _strange(number, small=alone):
                problems.add(place, f"{number!r} is {words}")
    for path in _SQUARES:
        if not problems.intact(*path):
            continue
        for place, number in _numbers(document, path):
            if abs(number) > _SQUARE:
                problems.add(place, f"{number!r} is too large: nothing here is above {_SQUARE:.0e}")
    for path in _PERIODS:
        for place, number in _numbers(document, path):
            if number > 0.0 and not _LEAST <= number <= _MOST:
                problems.add(
                    place, f"{number!r} s is impossible; expected {_LEAST:g} to {_MOST:g} s"
                )


def _strange(number: float, *, small: bool) -> str:
    """Explain why a quantity cannot have this size; empty where it can."""
    if abs(number) < 1.0 and not small:
        return ""
    try:
        plausible(number)
    except ValueError as error:
        return str(error)
    return ""


def _numbers(document: dict[str, Any], path: tuple[str, ...]) -> Iterator[tuple[Location, float]]:
    for place, part in find_entries(document, *path):
        yield from _leaves(part, place)


def _leaves(part: Any, place: Location) -> Iterator[tuple[Location, float]]:
    if isinstance(part, dict):
        for key, item in part.items():
            yield from _leaves(item, (*place, key))
    elif isinstance(part, list):
        for index, item in enumerate(part):
            yield from _leaves(item, (*place, index))
    elif isinstance(part, int | float) and not isinstance(part, bool):
        yield place, part
