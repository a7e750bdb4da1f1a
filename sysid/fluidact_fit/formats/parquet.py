"""Parquet files: numbers part by part, so that none is there twice."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Any

import numpy as np

from ..errors import LogError
from .sink import EXACT, KEPT, Sink, library, numbers_of

_DATE = re.compile(r"\d[-:/.]\d|#\d")
_PROBED = 200  # cells that show whether text may be instants
_NONE = np.iinfo(np.int64).min
_PARTS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9, "date32[day]": 1.0 / 86_400.0,
          "date64[ms]": 1e3}  # fmt: skip


def read(path: str, sink: Sink, *, batch: int) -> None:
    """Hand over the columns of a Parquet file, ``batch`` rows at once."""
    parquet = library("pyarrow.parquet")
    file = parquet.ParquetFile(path, pre_buffer=False)  # or it keeps all that it has read
    sink.dialect = "Parquet"
    rows = file.metadata.num_rows
    _check(file, rows)
    columns = _columns(file.schema_arrow, rows, sink)
    taken = [(place, column) for place, column in enumerate(columns) if column is not None]
    if not taken:
        raise LogError("it holds no column of numbers.", remedy="Export it as CSV.")
    names = file.schema_arrow.names
    wanted = None
    if len(set(names)) == len(names):  # else they have to be told by their places
        wanted = [column.name for _, column in taken]
        taken = [(place, column) for place, (_, column) in enumerate(taken)]
    begin = 0
    for part in file.iter_batches(batch, columns=wanted):
        if begin + len(part) > rows:
            raise _forged(rows, begin + len(part))
        for place, column in taken:
            column.fill(begin, part.column(place))
        begin += len(part)
    if begin != rows:
        raise _forged(rows, begin)
    for _, column in taken:
        column.finish(sink)


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


def _columns(schema: Any, rows: int, sink: Sink) -> list[_Column | None]:
    """The columns that can be read, in order; what cannot be is left out."""
    types = library("pyarrow").types
    found: list[_Column | None] = []
    for field in schema:
        name, kind = field.name, field.type
        while types.is_dictionary(kind):
            kind = kind.value_type
        timed = types.is_temporal(kind) and not str(kind).startswith("month")
        index = name.startswith("__index_level_")
        number = types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind)
        number = number or types.is_decimal(kind) or types.is_null(kind)
        if index and not timed:
            sink.leave(name, "the index of the table", signal=False)
            found.append(None)
        elif not (timed or number or types.is_string(kind) or types.is_large_string(kind)):
            sink.leave(name, f"a column of {str(kind)[:60]}")
            found.append(None)
        else:
            found.append(_Column(name, kind, rows, sink, "time" if index else name))
    return found


class _Column:
    """A column while it is read, by the type that it has."""

    def __init__(self, name: str, kind: Any, rows: int, sink: Sink, header: str) -> None:
        types = library("pyarrow").types
        self.name, self.kind, self.number = name, kind, len(sink.vectors)
        self.timed = types.is_temporal(kind)
        self.clock = types.is_timestamp(kind) or types.is_date(kind)
        self.text = types.is_string(kind) or types.is_large_string(kind)
        self.whole = self.timed or (types.is_integer(kind) and kind.bit_width == 64)
        unsigned = self.whole and types.is_unsigned_integer(kind)
        dtype = (np.uint64 if unsigned else np.int64) if self.whole else np.float64
        unit = "s" if self.timed else None
        self.place = sink.room(header, rows, dtype, unit=unit, clock=self.clock)
        self.bad: dict[int, str] = {}
        self.holes: list[Any] = []  # rows without a value, of whole numbers
        self.cells: list[str | None] = []  # of text that may be instants
        self.dated: bool | None = None

    def fill(self, begin: int, values: Any) -> None:
        """Take the next rows."""
        pa = library("pyarrow")
        if pa.types.is_dictionary(values.type):
            values = values.dictionary_decode()
        place = self.place[begin : begin + len(values)]
        if values.null_count:
            none = np.flatnonzero(values.is_null().to_numpy(zero_copy_only=False))
            self.bad |= {begin + int(row): "" for row in none[: KEPT - len(self.bad)]}
            self.holes.append(begin + none)
        if self.text:
            cells = values.to_pylist()
            if self.dated is None:
                self.dated = any(_DATE.search(cell) for cell in cells[:_PROBED] if cell)
            self.cells += cells if self.dated else []
            place[:], bad = numbers_of(cells)
            room = KEPT - len(self.bad)
            self.bad |= {begin + row: text for row, text in list(bad.items())[:room]}
        elif self.timed:
            place[:] = self._instants(values)
        elif self.whole:
            whole = values.fill_null(0) if values.null_count else values
            place[:] = whole.to_numpy(zero_copy_only=False)
        elif pa.types.is_boolean(values.type) or pa.types.is_decimal(values.type):
            place[:] = values.cast(pa.float64()).to_numpy(zero_copy_only=False)
        else:
            place[:] = values.to_numpy(zero_copy_only=False)

    def _instants(self, values: Any) -> Any:
        """Instants and durations in the unit that they have, none as the smallest number."""
        pa = library("pyarrow")
        whole = values.cast(pa.int32()) if values.type.bit_width == 32 else values
        return whole.cast(pa.int64()).fill_null(_NONE).to_numpy(zero_copy_only=False)

    def finish(self, sink: Sink) -> None:
        """Turn whole numbers into doubles in their place, unless these do not hold them."""
        sink.mark(self.number, self.bad)
        if self.cells and not np.isfinite(self.place).any():
            sink.put_texts(self.number, self.cells)
        elif self.timed:
            known = self.place != _NONE
            first = int(self.place[known][0]) if self.clock and known.any() else 0
            parts = _PARTS[getattr(self.kind, "unit", str(self.kind))]
            seconds = (self.place - first) / parts
            seconds[~known] = np.nan
            self.place.view(np.float64)[:] = seconds
            entry = sink.vectors[self.number]
            entry["kind"] = seconds.dtype.str
            entry["since"] = round(first * 1e9 / parts)
            sink.convert(self.name, f"{self.kind} to seconds")
        elif self.whole:
            holes = np.concatenate(self.holes) if self.holes else np.empty(0, np.int64)
            large = self.place.size and (
                int(self.place.max()) > EXACT or int(self.place.min()) < -EXACT
            )
            if large and not holes.size:
                return
            doubles = self.place.view(np.float64)
            edges = [*range(0, self.place.size, 1 << 20), self.place.size]
            for begin, end in pairwise(edges):
                doubles[begin:end] = self.place[begin:end].astype(np.float64)
            doubles[holes] = np.nan
            sink.vectors[self.number]["kind"] = doubles.dtype.str
