"""The ``model`` part of a file, read strictly: a controller must not run a damaged one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..errors import ParameterFileError
from ..family import Family, Variant
from ..parameters import ParameterDocument

_REMEDY = "Fit again and use the new file."
_SAME = 1e-4  # relative; an edited parameter shows, one rounded to six digits does not


@dataclass(frozen=True)
class Difference:
    """Difference equation, rising powers of ``1/z``, ``denominator[0]`` 1."""

    sample_time: float
    numerator: tuple[float, ...]
    denominator: tuple[float, ...]


@dataclass(frozen=True)
class Section:
    """A linear model, in falling powers of ``s``, with what goes before it.

    ``dead_zone`` holds the negative and the positive edge, or is ``None``.
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    dead_time: float
    discrete: Difference | None
    dead_zone: tuple[float, float] | None


class _Reader:
    """Collects every problem instead of stopping at the first."""

    def __init__(self) -> None:
        self.problems: list[tuple[str, str]] = []

    def mapping(self, parent: Mapping[str, Any], key: str, path: str) -> Mapping[str, Any]:
        value = parent.get(key)
        if isinstance(value, Mapping):
            return value
        self.problems.append((path, "is missing" if value is None else "is not a mapping"))
        return {}

    def number(self, parent: Mapping[str, Any], key: str, path: str, low: float) -> float:
        value = parent.get(key)
        if isinstance(value, int | float) and _is_number(value) and value >= low:
            return float(value)
        self.problems.append((f"{path}.{key}", f"{value!r} is not a number >= {low:g}"))
        return max(low, 0.0)

    def numbers(self, parent: Mapping[str, Any], key: str, path: str) -> tuple[float, ...]:
        value = parent.get(key)
        if isinstance(value, Sequence) and value and all(_is_number(v) for v in value):
            return tuple(float(v) for v in value)
        self.problems.append((f"{path}.{key}", f"{value!r} is not a list of finite numbers"))
        return ()


def _is_number(value: object) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and math.isfinite(value)  # type: ignore[arg-type]


def read_section(document: ParameterDocument, where: str = "the document") -> Section:
    """Read the ``model`` part of a document.

    Raises
    ------
    ParameterFileError
        Naming every problem with its path.
    """
    reader = _Reader()
    model: Mapping[str, Any] = document.model
    continuous = reader.mapping(model, "continuous", "model.continuous")
    path = "model.continuous"
    numerator = reader.numbers(continuous, "numerator", path) if continuous else ()
    denominator = reader.numbers(continuous, "denominator", path) if continuous else ()
    if numerator and denominator:
        if denominator[0] == 0.0:
            reader.problems.append((f"{path}.denominator", "starts with 0"))
        if len(numerator) >= len(denominator):
            reader.problems.append(
                (path, "the numerator is not of lower order than the denominator")
            )
    dead_time = reader.number({"dead_time": 0.0, **continuous}, "dead_time", path, 0.0)
    discrete = _discrete(reader, model) if "discrete" in model else None
    zone = _dead_zone(reader, model) if "input_nonlinearity" in model else None
    if reader.problems:
        raise ParameterFileError(where, reader.problems, _REMEDY)
    return Section(numerator, denominator, dead_time, discrete, zone)


def _discrete(reader: _Reader, model: Mapping[str, Any]) -> Difference:
    path = "model.discrete"
    part = reader.mapping(model, "discrete", path)
    step = reader.number(part, "sample_time", path, 1e-12)
    num = reader.numbers(part, "numerator", path)
    den = reader.numbers(part, "denominator", path)
    if len(num) != len(den):
        reader.problems.append((path, "numerator and denominator differ in length"))
    if den and den[0] != 1.0:
        reader.problems.append((f"{path}.denominator", "does not start with 1"))
    return Difference(step, num, den)


def _dead_zone(reader: _Reader, model: Mapping[str, Any]) -> tuple[float, float]:
    path = "model.input_nonlinearity"
    part = reader.mapping(model, "input_nonlinearity", path)
    low = reader.number(part, "dead_zone_negative", path, -math.inf)
    high = reader.number(part, "dead_zone_positive", path, -math.inf)
    slope = reader.number({"slope": 1.0, **part}, "slope", path, -math.inf)
    if not low <= 0.0 <= high:
        reader.problems.append((path, f"0 is not inside the dead zone {low:g} ... {high:g}"))
    if slope != 1.0:
        reader.problems.append((f"{path}.slope", f"{slope:g} is not 1"))
    return low, high


def check_agreement(
    document: ParameterDocument, family: Family, variant: Variant, where: str = "the document"
) -> None:
    """Compare the ``model`` part with the one the parameters give.

    A parameter changed by hand would otherwise leave a controller with the old model.

    Raises
    ------
    ParameterFileError
        Naming what disagrees.
    """
    model = document.model
    discrete = model.get("discrete", {})
    step, hold = discrete.get("sample_time", 0.0), discrete.get("hold", "zoh")
    due = family.model_section(variant, document.values(), float(step), hold)
    problems = [
        (f"model.{key}", "does not agree with the parameters")
        for key, value in due.items()
        if key not in model or not _agree(model[key], value)
    ]
    if problems:
        remedy = "One of the two was changed by hand. Fit again with --fix NAME=VALUE instead."
        raise ParameterFileError(where, problems, remedy)


def _agree(found: Any, due: Any) -> bool:
    """Whether two parts of a document hold the same keys and, nearly, the same numbers."""
    if isinstance(due, Mapping):
        return isinstance(found, Mapping) and all(
            key in found and _agree(found[key], value) for key, value in due.items()
        )
    if isinstance(due, list | tuple):
        if not isinstance(found, list | tuple) or len(found) != len(due):
            return False
        if not all(_is_number(v) for v in (*found, *due)):
            return list(found) == list(due)
        scale = max((abs(v) for v in due), default=0.0)
        return all(
            abs(a - b) <= _SAME * abs(b) + 1e-9 * scale for a, b in zip(found, due, strict=True)
        )
    if _is_number(due):
        return _is_number(found) and abs(found - due) <= _SAME * abs(due)
    return bool(found == due)
