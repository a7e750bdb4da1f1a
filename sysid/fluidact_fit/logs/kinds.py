"""Kinds of the keywords with which logs are read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..arguments import is_number, require, shown
from ..errors import UsageError
from .log import StepInput

_BY_ROLE = ("columns", "units", "scales", "steps", "holds", "unwrap", "constants", "from_name")


def check_kinds(given: Mapping[str, Any]) -> None:
    """Refuse keywords with a value of another kind (``UsageError``); ``None`` says nothing."""
    said = {name: value for name, value in given.items() if value is not None}
    for name in _BY_ROLE:
        if not isinstance(said.get(name, {}), Mapping):
            raise UsageError(
                f"{name}={shown(said[name])} is not a mapping of role to value.",
                remedy=f"Give one, as {name}={{'command': ...}}.",
            )
        require("mapping", **{name: said.get(name, {})})
    for role, column in said.get("columns", {}).items():
        if not isinstance(column, str):
            number = max(column, 1) if isinstance(column, int) else 1
            raise UsageError(
                f"columns={{{role!r}: {shown(column)}}} is not text.",
                remedy=f"Give a header as text, or the number of a column as '#{number}', counted "
                "from 1.",
            )
    units = {role: unit for role, unit in said.get("units", {}).items() if unit is not None}
    require("text", **{f"units of {role}": unit for role, unit in units.items()})
    require("number", **{f"scales of {role}": v for role, v in said.get("scales", {}).items()})
    for role, step in said.get("steps", {}).items():
        if not isinstance(step, StepInput) or not all(
            map(is_number, (step.start, step.end, step.at))
        ):
            raise UsageError(
                f"steps={{{role!r}: {shown(step)}}} is not a step.",
                remedy=f"Give for example steps={{{role!r}: StepInput(0.0, 1.0, at=2.0)}}.",
            )
    check_window(said.get("window"))
    require("number", sample_time=said.get("sample_time", 0.0))
    exclude = said.get("exclude", ())
    listed = exclude if isinstance(exclude, list | tuple) else [exclude]
    require("text", **{f"exclude #{k}": text for k, text in enumerate(listed, start=1)})
    for name in ("decimal", "thousands", "delimiter", "invalid"):
        require("text", **{name: said.get(name, "")})
    for name in ("skip_rows", "header_row"):
        require("whole", **{name: said.get(name, 0)})


def check_window(window: Any, name: str = "window") -> None:
    """Refuse what is no pair of times (``UsageError``); ``None`` is an open side, or no window."""
    if window is None:
        return
    if isinstance(window, str) or not isinstance(window, Sequence) or len(window) != 2:
        raise UsageError(
            f"{name}={shown(window)} is not a pair of times.",
            remedy="Give it in seconds, as (0.5, 3.0).",
        )
    ends = (name, window[0]), (f"end of {name}", window[1])
    require("number", **{side: end for side, end in ends if end is not None})
