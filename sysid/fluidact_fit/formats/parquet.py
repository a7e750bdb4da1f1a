"""Parquet files: one column after the other."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from ..errors import LogError
from .sink import KEPT, Sink, library, numbers_of, seconds_of

_DATE = re.compile(r"\d[-:/.]\d|#\d")
_PROBED = 200  # cells that show whether text may be instants


def read(path: str, sink: Sink) -> None:
    """Hand over the columns of a Parquet file, one after the other."""
    parquet = library("pyarrow.parquet")
    file = parquet.ParquetFile(path, pre_buffer=False)  # or it keeps all that it has read
    sink.dialect = "Parquet"
    rows = file.metadata.num_rows
    _check(file, rows)
    names = file.schema_arrow.names
    whole = file.read() if len(set(names)) < len(names) else None
    for place, field in enumerate(file.schema_arrow):
        name = field.name
        index = name.startswith("__index_level_")
        why = _why_not(field.type, index)
        if why:
            sink.leave(name, why, signal=not index)
            continue
        if rows * 8 > sink.left:
            raise sink.too_large(name, rows)
        column = file.read(columns=[name]).column(0) if whole is None else whole.column(place)
        if len(column) != rows:
            raise _forged(rows, len(column))
        _hand_over(sink, "time" if index else name, column)
    if not sink.vectors:
        raise LogError("it holds no column of numbers.", remedy="Export it as CSV.")


def _check(file: Any, rows: int) -> None:
    """Refuse a footer whose numbers of rows contradict one another."""
    metadata, schema = file.metadata, file.schema
    flat = [k for k in range(metadata.num_columns) if schema.column(k).max_repetition_level == 0]
    parts = [metadata.row_group(k) for k in range(metadata.num_row_groups)]
    if sum(part.num_rows for part in parts) != rows:
        raise _forged(rows, sum(part.num_rows for part in parts))
    for part in parts:
        for k in flat:
            if part.column(k).num_values != part.num_rows:
                raise _forged(part.num_rows, part.column(k).num_values)


def _forged(stated: int, held: int) -> LogError:
    return LogError(
        f"the file says that it has {stated} rows, and holds {held}.",
        expected="Expected as many as its footer states.",
        remedy="Export the recording again.",
    )


def _why_not(kind: Any, index: bool) -> str:
    """Explain why a column of a type holds no signal; empty where it may."""
    types = library("pyarrow").types
    while types.is_dictionary(kind):
        kind = kind.value_type
    timed = types.is_temporal(kind) and not str(kind).startswith("month")
    number = types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind)
    number = number or types.is_decimal(kind) or types.is_null(kind)
    if index and not timed:
        return "the index of the table"
    text = types.is_string(kind) or types.is_large_string(kind)
    return "" if timed or number or text else f"a column of {str(kind)[:60]}"


def _hand_over(sink: Sink, name: str, column: Any) -> None:
    """Hand over a column, by the type that it has."""
    pa = library("pyarrow")
    types = pa.types
    while types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    kind = column.type
    if types.is_string(kind) or types.is_large_string(kind):
        cells = column.to_pylist()
        values, bad = numbers_of(cells)
        number = sink.add(name, values, bad=bad)
        if not np.isfinite(values).any() and any(map(_DATE.search, filter(None, cells[:_PROBED]))):
            sink.put_texts(number, cells)
    elif types.is_temporal(kind):
        clock = types.is_timestamp(kind) or types.is_date(kind)
        whole = column.cast(pa.int32()) if kind.bit_width == 32 else column
        parts = whole.cast(pa.int64()).fill_null(np.iinfo(np.int64).min).to_numpy()
        unit = getattr(kind, "unit", "D" if types.is_date32(kind) else "ms")
        seconds, since, bad = seconds_of(parts.view(f"{'M' if clock else 'm'}8[{unit}]"))
        how = f"{kind} to seconds"
        sink.add(name, seconds, unit="s", clock=clock, since=since, bad=bad, how=how)
    else:
        plain = types.is_boolean(kind) or types.is_decimal(kind) or types.is_null(kind)
        values = (column.cast(pa.float64()) if plain else column).to_numpy()
        holes = column.is_null().to_numpy() if column.null_count else np.empty(0)
        sink.add(name, values, bad=dict.fromkeys(np.flatnonzero(holes)[:KEPT].tolist(), ""))
