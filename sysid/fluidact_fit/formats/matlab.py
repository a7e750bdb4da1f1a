"""MATLAB files up to version 7: variables, structures taken apart, and recordings of dSPACE."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..errors import LogError
from .matlab_objects import read_objects, text_of
from .sink import DEEPEST, MOST_CELLS, Array, Sink, full, library
from .tables import add_array

_FULL = 1 << 24  # numbers of a sparse matrix that is filled up


def read(path: str, sink: Sink) -> None:
    """Hand over the variables of a MATLAB file."""
    variables = list(_variables(path))
    sink.dialect = "MATLAB"
    recording = next((v for _, v in variables if hasattr(v, "X") and hasattr(v, "Y")), None)
    if recording is not None:
        sink.dialect = "dSPACE MATLAB"
        _read_dspace(recording, sink)
        for name, value in variables:
            if value is not recording:
                sink.leave(name, "beside the recording")
        return
    lengths = _lengths(value for _, value in variables)
    for name, value in variables:
        _take(sink, name, value, "", lengths, 0)
    read_objects(path, sink)


def _variables(path: str) -> Iterator[tuple[str, Any]]:
    """Variables one by one, as objects of MATLAB share a name in one mapping."""
    io = library("scipy.io")
    how = {"squeeze_me": True, "struct_as_record": False, "chars_as_strings": True}
    with open(path, "rb") as file:
        if 0 in file.read(4):  # MATLAB 4
            file.seek(0)
            try:
                parts = [io.loadmat(file, **how)]
            except (ValueError, TypeError) as error:
                raise LogError(
                    f"the MATLAB 4 file is cut or damaged ({str(error).partition(';')[0][:100]}).",
                    remedy="Save it again, or export it as CSV.",
                ) from None
        else:
            file.seek(0)
            split = io.matlab.varmats_from_mat(file)
            parts = [io.loadmat(part, **how) for _, part in split]
    for part in parts:
        for name, value in part.items():
            if not re.fullmatch("__.*__", name):
                yield _own_name(name, value), value


def _own_name(name: str, value: Any) -> str:
    """The name of a variable; an object keeps its own within itself."""
    if type(value).__name__ == "MatlabOpaque" and name in ("None", ""):
        try:
            held = value[0]["s0"]
        except (IndexError, KeyError, ValueError, TypeError):
            return name
        return held.decode("utf-8", "replace") if isinstance(held, bytes) else str(held)
    return name


def _take(sink: Sink, name: str, value: Any, group: str, lengths: list[int], depth: int) -> None:
    """A variable, a field or a cell: an array, or what is taken apart further."""
    kind = type(value).__name__
    if depth > DEEPEST:
        sink.leave(name, "too deep within structures", group=group)
    elif hasattr(value, "_fieldnames"):
        _take_structure(sink, name, value, group, depth)
    elif kind == "MatlabFunction":
        sink.leave(name, "a function", group=group, signal=False)
    elif kind == "MatlabOpaque" or (isinstance(value, np.ndarray) and value.dtype.names):
        sink.objects.append((full(group, name), _class_of(value)))
    elif hasattr(value, "toarray"):
        _take_sparse(sink, name, value, group, lengths)
    elif isinstance(value, np.ndarray) and value.dtype == object:
        if value.size > MOST_CELLS:
            sink.leave(name, f"{value.size} cells", group=group)
            return
        for k, part in enumerate(value.ravel(order="F"), start=1):
            beside = _lengths(value.ravel()) or lengths
            _take(sink, f"{name}{k}", part, group, beside, depth + 1)
        if not value.size:
            sink.leave(name, "empty", group=group, signal=False)
    else:
        add_array(sink, name, np.asarray(value), group=group, samples=lengths)


def _take_structure(sink: Sink, name: str, value: Any, group: str, depth: int) -> None:
    """Fields of a structure; the signals of Simulink under their labels."""
    fields = {str(k): getattr(value, k) for k in value._fieldnames}
    inside = full(group, name)
    lengths = _lengths(fields.values())
    signals = np.atleast_1d(np.asarray(fields.get("signals", []), dtype=object))
    if signals.size and all(hasattr(s, "values") for s in signals):
        time = np.ravel(fields.get("time", []))
        lengths = [time.size] if time.size > 1 else lengths
        for key, field in fields.items():
            if key != "signals":
                _take(sink, key, field, inside, lengths, depth + 1)
        for k, signal in enumerate(signals, start=1):
            label = text_of(getattr(signal, "label", ""))
            _take(sink, label or f"signal{k}", signal.values, inside, lengths, depth + 2)
        return
    for key, field in fields.items():
        _take(sink, key, field, inside, lengths, depth + 1)
    if not fields:
        sink.leave(name, "empty", group=group, signal=False)


def _take_sparse(sink: Sink, name: str, value: Any, group: str, lengths: list[int]) -> None:
    if value.shape[0] * value.shape[1] > _FULL:
        sink.leave(name, "a sparse matrix", group=group)
        return
    how = "a sparse matrix filled up"
    add_array(sink, name, np.asarray(value.toarray()), group=group, samples=lengths, how=how)


def _class_of(value: Any) -> str:
    """The class that an object names, empty where it names none."""
    try:
        words = [value[0][k] for k in ("s1", "s2")] if value.dtype.names else []
    except (IndexError, KeyError, ValueError, TypeError):
        return ""
    found = [w.decode("ascii", "replace") if isinstance(w, bytes) else str(w) for w in words]
    return found[-1][:40] if found else ""


def _lengths(values: Any) -> list[int]:
    """Lengths of the vectors among values."""
    found = (v for v in values if isinstance(v, np.ndarray) and v.dtype.kind in "fiub")
    return [v.size for v in found if v.ndim == 1 and v.size > 1]


def _read_dspace(variable: Any, sink: Sink) -> None:
    """Signals ``Y`` over the instants ``X`` of their raster."""
    axes = [np.ravel(x.Data) for x in np.atleast_1d(variable.X)]
    signals = np.atleast_1d(variable.Y)
    names = [str(y.Name) for y in signals]
    counts = Counter(map(_last_part, names))
    instants: dict[int, int] = {}
    for name, y in zip(names, signals):
        values = np.ravel(y.Data)
        place = int(getattr(y, "XIndex", 1)) - 1
        axis = next((k for k in _places(place, axes) if axes[k].size == values.size), None)
        if axis is None:
            raise LogError(
                f"signal '{name[:100]}' has {values.size} samples, and no time has as many.",
                remedy="Export the recording again.",
            )
        if axis not in instants:
            times: Array = np.asarray(axes[axis], dtype=np.float64)
            instants[axis] = sink.add("time", times, unit="s", role="instants")
        short = _last_part(name)
        unit = text_of(getattr(y, "Unit", "")) or None
        label = short if counts[short] == 1 else name
        if sink.holds_numbers(label, values):
            sink.add(label, values, unit=unit, instants=instants[axis])


def _places(first: int, axes: list[Array]) -> Iterator[int]:
    return (k for k in (first, *range(len(axes))) if 0 <= k < len(axes))


def _last_part(path: str) -> str:
    r"""The name of a signal: the end of ``"Model Root"/"sub"/"Out1"`` or ``Model Root/..\Out1``."""
    return re.split(r"[/\\]", path)[-1].strip('" ') or path
