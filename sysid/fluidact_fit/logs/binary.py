"""Recordings that are no text: MATLAB, HDF5, Parquet, TDMS and MDF files.

Which it is shows in the first bytes. What reads them is a library; those that not everybody has
are optional, and a message says which to install.
"""

from __future__ import annotations

import io
import logging
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import LogError, Notice
from .arrays import Named, joined
from .log import count_of
from .source import begins_with, name_of

_BATCH = 1 << 16  # rows that are decoded at once
Found = tuple[str, list[Named], list[Notice]]  # dialect, columns, what was noticed


def read_binary(raw: bytes, name: str) -> Found | None:
    """Columns of a binary recording, ``None`` where the bytes are none that is known.

    Raises
    ------
    LogError
        When it cannot be read, holds no table, or needs a library that is not installed.
    """
    reader = next((r for magic, r in _READERS.items() if raw.startswith(magic)), None)
    if reader is None:
        return None
    with _blaming_the_file(name):
        return reader(raw, name)


@contextmanager
def _blaming_the_file(name: str) -> Iterator[None]:
    """Where a library meets a damaged file, that is said."""
    try:
        yield
    except LogError:
        raise
    except Exception as error:
        raise LogError(
            f"the file cannot be read ({type(error).__name__}: {str(error)[:200]}).",
            where=name,
            remedy="Export the recording again, or as CSV.",
        ) from error


def read_stored(path: Path) -> Found | None:
    """Columns of a binary recording that can be read without its bytes at hand; else ``None``.

    Raises
    ------
    LogError
        As :func:`read_binary`.
    """
    if not begins_with(path, b"PAR1"):
        return None
    with _blaming_the_file(name_of(path)):
        return _of_parquet(path)


def _optional(module: str, extra: str, name: str) -> Any:
    """A library that not everybody has."""
    try:
        # what a library has to say of a damaged file is said in the message
        logging.getLogger(module.partition(".")[0]).setLevel(logging.CRITICAL)
        return import_module(module)
    except ImportError:
        raise LogError(
            f"reading it needs the Python package {module}, which is not installed.",
            where=name,
            remedy=f"Run: pip install 'fluidact-fit[{extra}]', or export the recording as CSV.",
        ) from None


def _read_matlab(raw: bytes, name: str) -> Found:
    from scipy.io import loadmat

    variables = loadmat(
        io.BytesIO(raw), squeeze_me=True, struct_as_record=False, chars_as_strings=True
    )
    return _of_variables({k: v for k, v in variables.items() if not k.startswith("__")}, name)


def _read_hdf5(raw: bytes, name: str) -> Found:
    h5py = _optional("h5py", "hdf5", name)
    found: dict[str, Any] = {}

    def visit(path: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset) and not path.startswith("#") and node.dtype.kind in "fiu":
            found[path.replace("/", ".")] = np.squeeze(node[()])

    with h5py.File(io.BytesIO(raw), "r") as file:
        file.visititems(visit)
    return _of_variables(found, name)


def _read_parquet(raw: bytes, name: str) -> Found:
    return _of_parquet(io.BytesIO(raw))


def _of_parquet(source: Path | io.BytesIO) -> Found:
    """Columns of a Parquet file; numbers part by part, so that none is there twice."""
    import pyarrow as pa
    from pyarrow import parquet

    file = parquet.ParquetFile(source, pre_buffer=False)  # or it keeps all that it has read
    schema, rows = file.schema_arrow, file.metadata.num_rows
    kept = [n for n in schema.names if not n.startswith("__index_level_")]
    number = pa.types.is_floating, pa.types.is_integer
    numbers = [n for n in kept if any(is_one(schema.field(n).type) for is_one in number)]
    found = {n: np.empty(rows) for n in numbers}
    begin = 0
    for batch in file.iter_batches(_BATCH, columns=numbers) if numbers else ():
        for name, column in zip(batch.schema.names, batch.columns):
            found[name][begin : begin + len(column)] = column.to_numpy(zero_copy_only=False)
        begin += len(batch)
    others = file.read([n for n in kept if n not in found])
    values = {**found, **{n: others[n].to_numpy() for n in others.column_names}}
    return "Parquet", [Named(n, values[n], own=n in found) for n in kept], []


def _read_tdms(raw: bytes, name: str) -> Found:
    nptdms = _optional("nptdms", "tdms", name)
    parts = []
    for group in nptdms.TdmsFile.read(io.BytesIO(raw)).groups():
        for channel in group.channels():
            if channel.data.dtype.kind not in "fiu" or not len(channel):
                continue
            try:
                time = channel.time_track()
            except KeyError:
                time = None
            unit = channel.properties.get("unit_string") or None
            parts.append((time, Named(channel.name, channel[:], unit, sparse=True)))
    return _of_channels("TDMS", parts, name)


def _read_mdf(raw: bytes, name: str) -> Found:
    asammdf = _optional("asammdf", "mdf", name)
    with asammdf.MDF(io.BytesIO(raw)) as file:
        parts = [
            (s.timestamps, Named(s.name, s.samples, s.unit or None, sparse=True))
            for s in file.iter_channels()
            if s.samples.dtype.kind in "fiu" and s.samples.ndim == 1
        ]
    return _of_channels("MDF", parts, name)


def _of_channels(dialect: str, parts: list[tuple[Any, Named]], name: str) -> Found:
    """Columns of channels with their instants, or of channels without any."""
    if not parts:
        raise LogError("it holds no channel of numbers.", where=name, remedy="Export it as CSV.")
    if any(time is None for time, _ in parts):
        return dialect, [column for _, column in parts], []
    return dialect, joined([[Named("time", t, "s"), c] for t, c in parts], name), []


def _of_variables(variables: Mapping[str, Any], name: str) -> Found:
    """Columns of the variables of a workspace.

    A recording of dSPACE is a structure with ``X`` and ``Y``; of others the numbers of equal
    length belong together, structures taken apart, and what is longer or shorter is left out.
    """
    for variable in variables.values():
        if hasattr(variable, "X") and hasattr(variable, "Y"):
            return "dSPACE MATLAB", _of_dspace(variable, name), []
    columns = [c for key, value in variables.items() for c in _take_apart(key, value)]
    sizes = Counter(c.values.size for c in columns if c.values.size > 2)
    if not sizes:
        listed = ", ".join(list(variables)[:12]) or "nothing"
        raise LogError(
            f"it holds no vectors of numbers ({listed}).",
            where=name,
            expected="Expected vectors of equal length, one per column, or a table of numbers.",
            remedy="Save arrays (table2struct for a table), or export it as CSV.",
        )
    longest = max(sizes, key=lambda n: (sizes[n], n))
    kept = [c for c in columns if c.values.size == longest]
    other = [c.header for c in columns if c.values.size != longest]
    notices = []
    if other:
        text = f"{name}: {count_of(len(other), 'variable')} of another length than {longest} left "
        notices.append(Notice("variables-left-out", f"{text}out: {', '.join(other[:8])}."))
    return "MATLAB", kept, notices


def _take_apart(key: str, value: Any) -> Iterator[Named]:
    """Vectors in a variable: itself, its columns, its fields."""
    if hasattr(value, "_fieldnames"):
        for field in value._fieldnames:
            yield from _take_apart(field, getattr(value, field))
        return
    array = np.asarray(value)
    if array.dtype.kind not in "fiu" or array.ndim not in (1, 2):
        return
    if array.ndim == 1:
        yield Named(key, array)
        return
    table = array if array.shape[0] >= array.shape[1] else array.T
    for k in range(min(table.shape[1], 1000)):
        yield Named(f"{key}{k + 1}", table[:, k])


def _of_dspace(variable: Any, name: str) -> list[Named]:
    """Signals ``Y`` over the instants ``X`` of their raster."""
    axes = [np.ravel(x.Data) for x in np.atleast_1d(variable.X)]
    parts: list[list[Named]] = [[Named("time", axis, "s")] for axis in axes]
    names = [str(y.Name) for y in np.atleast_1d(variable.Y)]
    counts = Counter(map(_last_part, names))
    for full, y in zip(names, np.atleast_1d(variable.Y)):
        values = np.ravel(y.Data)
        place = int(getattr(y, "XIndex", 1)) - 1
        fits = [k for k in (place, *range(len(axes))) if 0 <= k < len(axes)]
        axis = next((k for k in fits if axes[k].size == values.size), None)
        if axis is None:
            raise LogError(
                f"signal '{full}' has {values.size} samples, and no time has as many.",
                where=name,
                remedy="Export the recording again.",
            )
        short = _last_part(full)
        unit = str(getattr(y, "Unit", "") or "") or None
        parts[axis].append(Named(short if counts[short] == 1 else full, values, unit, True))
    return joined([p for p in parts if len(p) > 1], name)


def _last_part(path: str) -> str:
    r"""The name of a signal: the end of ``"Model Root"/"sub"/"Out1"`` or ``Model Root/..\Out1``."""
    return re.split(r"[/\\]", path)[-1].strip('" ') or path


_READERS: Mapping[bytes, Callable[[bytes, str], Found]] = {
    b"MATLAB 5.0": _read_matlab,
    b"MATLAB 7.3": _read_hdf5,
    b"\x89HDF": _read_hdf5,
    b"PAR1": _read_parquet,
    b"TDSm": _read_tdms,
    b"MDF  ": _read_mdf,
}
