"""Tables, time series, dates and durations in MATLAB files: objects that only mat-io reads."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ..errors import LogError
from .sink import DEEPEST, MOST_CELLS, Array, Sink, full, library, seconds_of

_READ = ("table", "timetable", "datetime", "duration", "timeseries")
_OF_SIMULINK = "Simulink.SimulationData."  # what holds its time series


def read_objects(path: str, sink: Sink, *, counted: bool = False) -> None:
    """Hand over the objects that were met while the rest of a file was read.

    The only cell of an array is called as the array is, or ``counted`` as one of several.
    """
    readable = [kind for _, kind in sink.objects if kind.startswith((*_READ, _OF_SIMULINK))]
    found, why_not = _found(path, counted) if readable else ({}, "")
    alone = len(sink.objects) == 1 and not sink.vectors
    for name, kind in sink.objects:
        parts = [n for n in found if n == name or n.startswith(f"{name}.")]
        for part in parts:
            _take(sink, part, kind, found[part], alone)
        if not parts:
            reason = f", {why_not}" if why_not and kind in readable else ""
            sink.leave(name, f"a MATLAB object{f' ({kind})' if kind else ''}{reason}")


def _take(sink: Sink, name: str, kind: str, value: Any, alone: bool) -> None:
    """A table, a time series, or instants."""
    if hasattr(value, "columns"):
        sink.convert(name, f"a {kind} of {len(value)} rows")
        _take_table(sink, "" if alone else name, value)
    elif isinstance(value, np.ndarray):
        _add_instants(sink, name, np.ravel(value), how=f"a {kind} to seconds")
    else:
        _take_series(sink, name, value.properties)


def _found(path: str, counted: bool) -> tuple[dict[str, Any], str]:
    """Tables and instants by name; why there are none, where that is so."""
    found: dict[str, Any] = {}
    try:
        load = library("matio", "matlab").load_from_mat
        for name, value in load(path, add_table_attrs=True).items():
            for label, part in _values(name, value, counted, 0):
                found[label if label not in found else f"{label} #{len(found)}"] = part
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
    if hasattr(value, "properties") and depth <= DEEPEST:
        if value.classname == "timeseries":
            yield name, value
        elif isinstance(value.properties, dict):
            for part in value.properties.values():
                yield from _within(name, part, depth + 1)
    if not isinstance(value, np.ndarray) or depth > DEEPEST or value.size > MOST_CELLS:
        return
    alone = value.size == 1 and not (counted and value.dtype == object)
    for k, cell in enumerate(value.ravel(order="F"), start=1):
        label = name if alone else f"{name}{k}"
        for field in value.dtype.names or ():
            yield from _values(full(label, field), cell[field], counted, depth + 1)
        if value.dtype == object:
            yield from _values(label, cell, counted, depth + 1)


def _within(name: str, value: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """Tables and time series within an object: logged signals have names, or are counted."""
    several = isinstance(value, np.ndarray) and value.dtype == object
    parts = value.ravel(order="F")[:MOST_CELLS] if several else [value]
    for k, part in enumerate(parts, start=1):
        own = text_of(_properties(part).get("Name")) or (f"signal{k}" if len(parts) > 1 else "")
        if not several and getattr(part, "classname", "") == "timeseries":
            own = ""  # it is called as the signal that it belongs to
        yield from _values(full(name, own) if own else name, part, False, depth)


def _add_instants(sink: Sink, name: str, values: Array, **described: Any) -> int:
    """Hand over instants or durations; returns their number."""
    seconds, since, bad = seconds_of(values)
    clock = values.dtype.kind == "M"
    return sink.add(name, seconds, unit="s", clock=clock, since=since, bad=bad, **described)


def _take_series(sink: Sink, name: str, series: Mapping[str, Any]) -> None:
    """A time series: even instants are kept as their start, increment and number."""
    times, unit = _times(series)
    raw = series.get("Data_")
    values = np.asarray(series.get("Data") if raw is None or np.size(raw) == 0 else raw)
    if values.dtype.kind not in "fiub" or times.size < 2 or times.size not in values.shape:
        size = " x ".join(map(str, values.shape))
        sink.leave(name, f"a timeseries of {times.size} instants, and data of {size}")
        return
    axis = 0 if values.shape[0] == times.size else values.ndim - 1
    rows = np.moveaxis(values, axis, 0).reshape(times.size, -1)
    group, _, own = name.rpartition(".")
    instants = sink.add("time", times, group=group, unit=unit or "s", role="instants")
    quantity = text_of(_properties(series.get("DataInfo")).get("Units")) or None
    for k, column in enumerate(rows.T, start=1):
        label = own if rows.shape[1] == 1 else f"{own}{k}"
        numbers = column.astype(np.float64)
        sink.add(label, numbers, group=group, unit=quantity, instants=instants)
    sink.convert(name, f"a timeseries of {times.size} samples")


def _times(series: Mapping[str, Any]) -> tuple[Array, str]:
    """The instants of a time series and their unit; none where it keeps them otherwise."""
    about = _properties(series.get("TimeInfo"))
    unit = text_of(about.get("Units"))
    for given in (series.get("Time_"), series.get("Time"), about.get("Time_")):
        if isinstance(given, np.ndarray) and given.dtype.kind in "fiu" and given.size > 1:
            return given.ravel().astype(np.float64), unit
    even = [np.ravel(np.asarray(about.get(k))) for k in ("Start_", "Increment_", "Length")]
    if not all(n.size == 1 and n.dtype.kind in "fiu" and np.isfinite(n[0]) for n in even):
        return np.empty(0), unit
    start, step, size = (float(n[0]) for n in even)
    stored: Any = series.get("Data_")
    possible = 0 < size <= np.size(stored)
    return start + step * np.arange(int(size) if possible else 0), unit


def _properties(value: Any) -> Mapping[str, Any]:
    """The properties of an object, also of the only one of an array; none of anything else."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.item()
    found = getattr(value, "properties", None)
    return found if isinstance(found, dict) else {}


def text_of(value: Any) -> str:
    """A text of MATLAB, empty for anything else."""
    if isinstance(value, np.ndarray) and value.size == 1 and value.dtype.kind in "UO":
        value = value.item()
    return value.strip() if isinstance(value, str) else ""


def _take_table(sink: Sink, group: str, frame: Any) -> None:
    """The columns of a table over its row times, if it has any."""
    instants = None
    times = np.asarray(frame.index)
    if times.dtype.kind in "mM":
        instants = _add_instants(sink, "time", times, group=group, role="instants")
    for k, (header, unit) in enumerate(zip(frame.columns, _units(frame))):
        name, values = str(header), np.asarray(frame.iloc[:, k])
        if values.dtype.kind in "mM":
            how = "instants to seconds"
            _add_instants(sink, name, values, group=group, instants=instants, how=how)
        elif sink.holds_numbers(name, values, group):
            sink.add(name, values, group=group, unit=unit, instants=instants)


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
