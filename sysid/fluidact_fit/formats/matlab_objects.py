"""Tables, timetables, dates and durations in MATLAB files: objects that only mat-io reads."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..errors import LogError
from .sink import Array, Sink, full, library, seconds_of

_READ = ("table", "timetable", "datetime", "duration")
_DEEPEST = 32
_MOST_CELLS = 1000


def read_objects(path: str, sink: Sink, *, counted: bool = False) -> None:
    """Hand over the objects that were met while the rest of a file was read.

    The only cell of an array is called as the array is, or ``counted`` as one of several.
    """
    readable = any(kind in _READ for _, kind in sink.objects)
    found, why_not = _found(path, counted) if readable else ({}, "")
    alone = len(sink.objects) == 1 and not sink.vectors
    for name, kind in sink.objects:
        value: Any = found.get(name)
        if hasattr(value, "columns"):
            sink.convert(name, f"a {kind} of {len(value)} rows")
            _take_table(sink, "" if alone else name, value)
        elif isinstance(value, np.ndarray):
            _add_instants(sink, name, np.ravel(value), how=f"a {kind} to seconds")
        else:
            reason = f", {why_not}" if why_not and kind in _READ else ""
            sink.leave(name, f"a MATLAB object{f' ({kind})' if kind else ''}{reason}")


def _found(path: str, counted: bool) -> tuple[dict[str, Any], str]:
    """Tables and instants by name; why there are none, where that is so."""
    found: dict[str, Any] = {}
    try:
        load = library("matio", "matlab").load_from_mat
        for name, value in load(path, add_table_attrs=True).items():
            found |= dict(_values(name, value, counted, 0))
    except LogError:
        return {}, "read with: pip install 'fluidact-fit[matlab]'"
    except MemoryError:
        raise
    except Exception as error:  # what is no object can be read without it
        return {}, f"which cannot be read: {str(error)[:80].replace(path, 'it')}"
    return found, ""


def _values(name: str, value: Any, counted: bool, depth: int) -> Iterator[tuple[str, Any]]:
    """Tables and instants within a variable, by their names with what holds them."""
    if hasattr(value, "columns") or getattr(value, "dtype", np.dtype("f8")).kind in "mM":
        yield name, value
    if not isinstance(value, np.ndarray) or depth > _DEEPEST or value.size > _MOST_CELLS:
        return
    alone = value.size == 1 and not (counted and value.dtype == object)
    for k, cell in enumerate(value.ravel(order="F"), start=1):
        label = name if alone else f"{name}{k}"
        for field in value.dtype.names or ():
            yield from _values(full(label, field), cell[field], counted, depth + 1)
        if value.dtype == object:
            yield from _values(label, cell, counted, depth + 1)


def _add_instants(sink: Sink, name: str, values: Array, **described: Any) -> int:
    """Hand over instants or durations; returns their number."""
    seconds, since, bad = seconds_of(values)
    clock = values.dtype.kind == "M"
    return sink.add(name, seconds, unit="s", clock=clock, since=since, bad=bad, **described)


def _take_table(sink: Sink, group: str, frame: Any) -> None:
    """The columns of a table over its row times, if it has any."""
    instants = None
    times = np.asarray(frame.index)
    if times.dtype.kind in "mM":
        instants = _add_instants(sink, "time", times, group=group, role="instants")
    for k, (header, unit) in enumerate(zip(frame.columns, _units(frame))):
        name, values, how = str(header), np.asarray(frame.iloc[:, k]), ""
        if values.dtype.kind in "mM":
            how = "instants to seconds"
            _add_instants(sink, name, values, group=group, instants=instants, how=how)
            continue
        if values.dtype.kind == "b":
            values, how = values.astype(np.float64), "true and false to 1 and 0"
        if values.dtype.kind not in "fiu":
            why = "complex numbers" if values.dtype.kind == "c" else "text"
            sink.leave(name, why, group=group, signal=why != "text")
            continue
        sink.add(name, values, group=group, unit=unit, instants=instants, how=how)


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
