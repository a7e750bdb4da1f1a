"""Parquet: every type of a column, and footers that state what is not there."""

from __future__ import annotations

import datetime as dt
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from pyarrow import parquet

from fluidact_fit.errors import LogError
from fluidact_fit.logs import Log, read_log
from recordings import T, columns, fates

INSTANTS = [dt.datetime(2024, 5, 31, 12) + dt.timedelta(milliseconds=10 * k) for k in range(200)]


def read(folder: Path, table: Any, **how: Any) -> Log:
    path = folder / "log.parquet"
    parquet.write_table(pa.table(table), path, **how)
    return read_log(path)


@pytest.mark.parametrize(
    "kind", [pa.timestamp("ms"), pa.timestamp("us"), pa.timestamp("ns", tz="Europe/Berlin")]
)
def test_instants(tmp_path: Path, kind: Any) -> None:
    stamps = pa.array([None if k == 5 else x for k, x in enumerate(INSTANTS)])
    log = read(tmp_path, {"stamp": stamps.cast(kind), "x": T})
    time = log.columns[0]
    assert (time.unit, time.clock) == ("s", True)
    assert np.flatnonzero(np.isnan(time.values)).tolist() == [5]
    np.testing.assert_allclose(np.delete(time.values, 5), np.delete(T, 5))


def test_every_type_of_column(tmp_path: Path) -> None:
    log = read(tmp_path, {
        "on": pa.array([None if k == 0 else k % 2 == 0 for k in range(200)]),
        "decimal": pa.array([Decimal(k) / 100 for k in range(200)]),
        "words": pa.array(["1.5", "2.5"] * 100).dictionary_encode(),
        "single": T.astype("f4"), "half": pa.array(T.astype("f2")),
        "u8": np.arange(200, dtype="u8"),
        "lasted": pa.array([dt.timedelta(milliseconds=10 * k) for k in range(200)]),
        "clock": pa.array([dt.time(12, 0, 0, 1000 * k) for k in range(200)]),
        "written": [f"2024-05-31 12:00:{k / 10:06.3f}" for k in range(200)],
        "list": pa.array([[1.0]] * 200), "raw": pa.array([b"x"] * 200), "nothing": pa.nulls(200),
    })  # fmt: skip
    found = columns(log)
    np.testing.assert_array_equal(found["on"][1:], np.arange(1, 200) % 2 == 0)
    assert np.isnan(found["on"][0])
    np.testing.assert_allclose(found["decimal"], T)
    np.testing.assert_array_equal(found["words"], [1.5, 2.5] * 100)
    np.testing.assert_allclose(found["lasted"], T)
    np.testing.assert_allclose(found["clock"], 43_200.0 + T / 10.0)
    np.testing.assert_allclose(found["written"], 10.0 * T, atol=1e-9)
    assert np.isnan(found["nothing"]).all()
    assert {"list", "raw"} <= fates(log).keys()


def test_instants_beyond_the_centuries_of_nanoseconds(tmp_path: Path) -> None:
    far = pa.array([*INSTANTS[:3], dt.datetime(9999, 12, 31), dt.datetime(1, 1, 1)])
    days = pa.array([dt.date(2024, 1, 1 + k) for k in range(5)])
    log = read(tmp_path, {"stamp": far.cast(pa.timestamp("us")), "day": days})
    np.testing.assert_allclose(log.columns[0].values[:3], T[:3], atol=1e-9)
    assert log.columns[0].values[3] > 1e11
    assert log.columns[0].values[4] < -1e10
    np.testing.assert_array_equal(log.columns[1].values, 86_400.0 * np.arange(5))


@pytest.mark.parametrize("name", [None, "when"])
def test_an_index_of_instants_is_the_time(tmp_path: Path, name: str | None) -> None:
    index = pd.DatetimeIndex(pd.Timestamp("2024-05-31") + pd.to_timedelta(T, unit="s"), name=name)
    path = tmp_path / "log.parquet"
    pd.DataFrame({"x": T}, index=index).to_parquet(path)
    log = read_log(path)
    assert [c.header for c in log.columns] == ["x", name or "time"]
    np.testing.assert_allclose(log.columns[1].values, T, atol=1e-9)


def test_names_that_repeat_are_told_by_their_places(tmp_path: Path) -> None:
    table = pa.Table.from_arrays([pa.array(T), pa.array(["a"] * 200), pa.array(2 * T)], ["x"] * 3)
    log = read(tmp_path, table)
    np.testing.assert_array_equal(log.columns[2].values, 2 * T)


def forged(content: bytes, rows: int, stated: int, places: int) -> bytes:
    """The file with another number in some places of its footer, where it takes as many bytes."""
    old, new = varint(rows), varint(stated)
    assert len(old) == len(new)
    size = int.from_bytes(content[-8:-4], "little")
    footer = content[-8 - size : -8]
    assert old in footer
    return content[: -8 - size] + footer.replace(old, new, places) + content[-8:]


def varint(number: int) -> bytes:
    """A number of Thrift: seven bits a byte, the lowest of them the sign."""
    number, out = number << 1, bytearray()
    while number >= 128:
        out.append(number & 127 | 128)
        number >>= 7
    return bytes([*out, number])


@pytest.mark.parametrize(("stated", "places"), [(4000, -1), (4000, 1), (600, 1), (600, 2)])
def test_a_footer_that_states_other_rows_is_refused(
    tmp_path: Path, stated: int, places: int
) -> None:
    path = tmp_path / "log.parquet"
    x = np.random.default_rng(1).standard_normal(1000)
    parquet.write_table(pa.table({"x": x, "y": x}), path, write_statistics=False)
    path.write_bytes(forged(path.read_bytes(), 1000, stated, places))
    with pytest.raises(LogError, match=r"says that it has|cannot be read|are stated"):
        read_log(path)


@pytest.mark.parametrize("kept", [10, -4, -200])
def test_a_file_that_is_cut_is_refused(tmp_path: Path, kept: int) -> None:
    read(tmp_path, {"x": T})
    path = tmp_path / "log.parquet"
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(LogError, match="cannot be read"):
        read_log(path)


def test_far_more_rows_than_the_file_can_hold(tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    zeros = pa.array(np.zeros(1 << 20))
    schema = pa.schema([("x", pa.float64())])
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        for _ in range(40):
            writer.write_table(pa.table([zeros], schema))
    with pytest.raises(LogError, match="more than a file of this size may hold"):
        read_log(path)


def test_text_of_a_plc_is_a_time(tmp_path: Path) -> None:
    """It was taken for words."""
    log = read(tmp_path, {"time": [f"T#{4 * k}ms" for k in range(50)], "p": [0.5] * 50})
    assert log.columns[0].clock
    np.testing.assert_allclose(log.columns[0].values, 0.004 * np.arange(50), atol=1e-12)
