"""Tables in binary formats, spreadsheets and JSON, written by the libraries of those formats."""

from __future__ import annotations

import bz2
import gzip
import io
import json
import lzma
import random
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from . import text
from .text import Written
from .truth import TIME_UNITS, Truth

# A native format costs a process of its own, and seconds.
_SHARES = {"parquet": 2, "hdf5": 2, "mat": 2, "tdms": 2, "mdf": 1, "json": 8, "xlsx": 8,
           "packed": 12}  # fmt: skip
Columns = list[tuple[str, str, np.ndarray]]  # name, unit, values


def write(rng: random.Random, truth: Truth) -> Written:
    """Write a table in a binary format, or pack one of text."""
    how = rng.choices(list(_SHARES), list(_SHARES.values()))[0]
    if how == "packed":
        return _packed(rng, truth)
    columns = _columns(rng, truth)
    if how == "mat":  # whose variables have no units
        for c in truth.channels:
            c.unit, c.size = "", 1.0
        columns[0] = ("time", "s", np.array(truth.times))
    data, detail = _WRITERS[how](rng, columns)
    suffix = {"hdf5": "h5", "mdf": "mf4"}.get(how, how)
    return Written(data, f".{suffix}", f"{how} {detail}", None, "" if how == "mdf" else "#1")


def _packed(rng: random.Random, truth: Truth) -> Written:
    inner = text.write(rng, truth)
    packers: dict[str, Callable[[bytes], bytes]] = {
        "gz": gzip.compress, "bz2": bz2.compress, "xz": lzma.compress
    }  # fmt: skip
    kind = rng.choice(sorted(packers))
    data = packers[kind](inner.data)
    return Written(data, f".csv.{kind}", f"{kind} of {inner.how}", inner.sample_time, inner.time)


def _columns(rng: random.Random, truth: Truth) -> Columns:
    """Time and channels; the values of a channel are those that its type holds."""
    unit = rng.choice([u for u in sorted(TIME_UNITS) if u != "100 ns"])
    time = np.array(truth.times) / TIME_UNITS[unit]
    out: Columns = [("time", unit, time)]
    for c in truth.channels:
        kind = rng.choice(("float64", "float64", "float32", "int32"))
        values = np.array(c.values).astype(kind)
        if values.size > 1 and np.ptp(values) == 0:
            values = np.array(c.values)
        c.values = [float(v) for v in values]
        out.append((c.name, c.unit, values))
    names = [n for n, _, _ in out]
    assert len(set(names)) == len(names), names
    return out


def _headed(columns: Columns, shape: str) -> list[str]:
    return [shape.format(n=n, u=u) for n, u, _ in columns]


def _parquet(rng: random.Random, columns: Columns) -> tuple[bytes, str]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    shape = rng.choice(("{n} [{u}]", "{n} ({u})"))
    arrays = [pa.array(v) for _, _, v in columns]
    table = pa.table(dict(zip(_headed(columns, shape), arrays)))
    sink, packing = io.BytesIO(), rng.choice(("none", "snappy", "zstd", "gzip"))
    pq.write_table(table, sink, compression=packing, row_group_size=rng.choice((7, 1000)))
    return sink.getvalue(), f"{shape!r} {packing}"


def _hdf5(rng: random.Random, columns: Columns) -> tuple[bytes, str]:
    import h5py

    attribute = rng.random() < 0.6
    group = rng.choice(("", "run/", "measurement/data/"))
    sink = io.BytesIO()
    with h5py.File(sink, "w") as file:
        for k, (name, unit, values) in enumerate(columns):
            key = f"{name} [{unit}]".replace("/", "∕") if not attribute else name
            kept = file.create_dataset(f"{group}{k}_{key}", data=values, track_order=True)
            if attribute:
                kept.attrs["units"] = unit
    return sink.getvalue(), f"attribute={attribute} {group!r}"


def _mat(rng: random.Random, columns: Columns) -> tuple[bytes, str]:
    from scipy.io import savemat

    shape = rng.choice((lambda v: v[:, None], lambda v: v[None, :]))
    sink, struct = io.BytesIO(), rng.random() < 0.3
    held = {f"c{k}": shape(v) for k, (_, _, v) in enumerate(columns)}
    savemat(sink, {"log": held} if struct else held, do_compression=rng.random() < 0.5)
    return sink.getvalue(), f"struct={struct}"


def _tdms(rng: random.Random, columns: Columns) -> tuple[bytes, str]:
    from nptdms import ChannelObject, TdmsWriter

    sink = io.BytesIO()
    parts = rng.choice((1, 3))
    with TdmsWriter(sink) as writer:
        for rows in np.array_split(np.arange(columns[0][2].size), parts):
            writer.write_segment([
                ChannelObject("group", n, v[rows], properties={"unit_string": u})
                for n, u, v in columns
            ])  # fmt: skip
    return sink.getvalue(), f"segments={parts}"


def _mdf(rng: random.Random, columns: Columns) -> tuple[bytes, str]:
    from asammdf import MDF, Signal

    _, unit, stamps = columns[0]
    time = stamps * TIME_UNITS[unit]
    signals = [Signal(v, time, name=n, unit=u) for n, u, v in columns[1:]]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.mf4"
        with MDF(version=rng.choice(("4.10", "4.11"))) as file:
            file.append(signals)
            file.save(path, compression=rng.choice((0, 1)))
        return path.read_bytes(), ""


def _json(rng: random.Random, columns: Columns) -> tuple[bytes, str]:
    heads = _headed(columns, rng.choice(("{n} [{u}]", "{n} ({u})")))
    lists: list[list[Any]] = [v.tolist() for _, _, v in columns]
    kind = rng.choice(("records", "columns", "lines"))
    records = [dict(zip(heads, row)) for row in zip(*lists)]
    if kind == "records":
        made = json.dumps(records, ensure_ascii=rng.random() < 0.5)
    elif kind == "columns":
        made = json.dumps(dict(zip(heads, lists)), indent=rng.choice((None, 2)))
    else:
        made = "\n".join(json.dumps(r) for r in records) + "\n"
    return made.encode(), kind


def _xlsx(rng: random.Random, columns: Columns) -> tuple[bytes, str]:
    from openpyxl import Workbook

    book = Workbook()
    sheet = book.active
    assert sheet is not None
    row_of_units = rng.random() < 0.4
    names = [n for n, _, _ in columns]
    sheet.append(names if row_of_units else _headed(columns, "{n} [{u}]"))
    if row_of_units:
        sheet.append([u for _, u, _ in columns])
    for row in zip(*(v.tolist() for _, _, v in columns)):
        sheet.append(list(row))
    sink = io.BytesIO()
    book.save(sink)
    return sink.getvalue(), f"row of units={row_of_units}"


_WRITERS = {"parquet": _parquet, "hdf5": _hdf5, "mat": _mat, "tdms": _tdms, "mdf": _mdf,
            "json": _json, "xlsx": _xlsx}  # fmt: skip
