"""Tables, timetables, dates and durations in MATLAB files: objects that only mat-io reads."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..errors import LogError
from .sink import Sink, full, library, seconds_of

_READ = ("table", "timetable", "datetime", "duration")
_DEEPEST = 32
_MOST_CELLS = 1000


def read_objects(path: str, sink: Sink) -> None:
    """Hand over the objects that were met while the rest of a file was read."""
    found, why_not = _found(path) if any(k in _READ for _, k in sink.objects) else ({}, "")
    alone = len(sink.objects) == 1 and not sink.vectors
    for name, kind in sink.objects:
        value = found.get(name)
        if hasattr(value, "columns"):
            sink.convert(name, f"a {kind} of {len(value)} rows")
            _take_table(sink, "" if alone else name, value)
        elif isinstance(value, np.ndarray):
            seconds, since, bad = seconds_of(np.ravel(value))
            clock = value.dtype.kind == "M"
            how = f"a {kind} to seconds"
            sink.add(name, seconds, unit="s", clock=clock, since=since, bad=bad, how=how)
        else:
            reason = f", {why_not}" if why_not and kind in _READ else ""
            sink.leave(name, f"a MATLAB object{f' ({kind})' if kind else ''}{reason}")


def _found(path: str) -> tuple[dict[str, Any], str]:
    """Tables and instants by name; why there are none, where that is so."""
    found: dict[str, Any] = {}
    try:
        load = library("matio", "matlab").load_from_mat
        for name, value in load(path, add_table_attrs=True).items():
            found |= dict(_values(name, value, 0))
    except LogError:
        return {}, "read with: pip install 'fluidact-fit[matlab]'"
    except MemoryError:
        raise
    except Exception as error:  # what is no object can be read without it
        return {}, f"which cannot be read: {str(error)[:80].replace(path, 'it')}"
    return found, ""


def _values(name: str, value: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """Tables and instants within a variable, by their names with what holds them."""
    if hasattr(value, "columns") or getattr(value, "dtype", np.dtype("f8")).kind in "mM":
        yield name, value
    if not isinstance(value, np.ndarray) or depth > _DEEPEST or value.size > _MOST_CELLS:
        return
    for k, cell in enumerate(value.ravel(order="F"), start=1):
        for label in {f"{name}{k}", name if value.size == 1 else f"{name}{k}"}:
            for field in value.dtype.names or ():
                yield from _values(full(label, field), cell[field], depth + 1)
            if value.dtype == object:
                yield from _values(label, cell, depth + 1)


def _take_table(sink: Sink, group: str, frame: Any) -> None:
    """The columns of a table over its row times, if it has any."""
    instants = None
    times = np.asarray(frame.index)
    if times.dtype.kind in "mM":
        seconds, since, bad = seconds_of(times)
        described = {"clock": times.dtype.kind == "M", "since": since, "role": "instants"}
        instants = sink.add("time", seconds, group=group, unit="s", bad=bad, **described)
    units = _units(frame)
    for k, name in enumerate(frame.columns):
        values = np.asarray(frame.iloc[:, k])
        unit, how, described = units[k], "", {}
        if values.dtype.kind in "mM":
            values, since, bad = seconds_of(values)
            described, unit = {"bad": bad, "since": since}, "s"
            how = "instants to seconds"
        elif values.dtype.kind == "b":
            values, how = values.astype(np.float64), "true and false to 1 and 0"
        if values.dtype.kind not in "fiu":
            why = "complex numbers" if values.dtype.kind == "c" else "text"
            sink.leave(str(name), why, group=group, signal=why != "text")
            continue
        sink.add(str(name), values, group=group, unit=unit, instants=instants, how=how, **described)


def _units(frame: Any) -> list[str | None]:
    """The unit of every column; one of a variable of several columns is that of each of them."""
    given = frame.attrs.get("varUnits") or frame.attrs.get("VariableUnits") or []
    names = [str(name) for name in frame.columns]
    variable: list[int] = []
    for k, name in enumerate(names):
        stem, number = re.fullmatch(r"(.*?)(?:_(\d+))?", name, re.DOTALL).groups()  # type: ignore[union-attr]
        follows = k > 0 and number and names[k - 1] == f"{stem}_{int(number) - 1}"
        variable.append(variable[-1] + (not follows) if variable else 0)
    places = range(len(names)) if len(given) == len(names) else variable
    if not names or len(given) != places[-1] + 1:
        return [None] * len(names)
    return [str(given[place]).strip() or None for place in places]
