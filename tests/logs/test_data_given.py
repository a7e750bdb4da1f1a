"""Data that are no CSV file: frames, arrays, binary recordings, packed ones, standard input."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import nptdms
import numpy as np
import pandas as pd
import pyarrow
import pytest
from scipy.io import savemat

import fluidact_fit as ff
from fluidact_fit.errors import LogError, UsageError
from fluidact_fit.logs import read_log
from fluidact_fit.logs.arrays import log_of

CSV = Path(__file__).parents[2] / "datasets/line/trial1.csv"
SI = {"time": 1e-3, "inlet": 1e5, "outlet": 1e5}  # ms, bar, bar


@pytest.fixture(scope="module")
def columns() -> dict[str, np.ndarray]:
    log = read_log(CSV)
    return {r: c.values * f for c, (r, f) in zip(log.columns, SI.items())}


@pytest.fixture(scope="module")
def expected() -> dict[str, float]:
    found = ff.fit("line", read_log(CSV, columns={"time": "#1", "inlet": "#2", "outlet": "#3"}))
    return {n: q.value for n, q in found.parameters.items()}


def check(data: Any, expected: dict[str, float]) -> None:
    found = ff.fit("line", data)
    assert found.verdict == "pass"
    for name, value in expected.items():
        # the printed resolution of a file is not that of an array: rounding, no more
        assert found.parameters[name].value == pytest.approx(value, rel=1e-6), name


def frame_by_durations(columns: dict[str, np.ndarray]) -> pd.DataFrame:
    index = pd.to_timedelta(columns["time"], unit="s")
    return pd.DataFrame({k: columns[k] for k in ("inlet", "outlet")}, index=index)


def frame_by_instants(columns: dict[str, np.ndarray]) -> pd.DataFrame:
    index = pd.Timestamp("2026-03-01 12:00") + pd.to_timedelta(columns["time"], unit="s")
    return pd.DataFrame({k: columns[k] for k in ("inlet", "outlet")}, index=index)


@pytest.mark.parametrize(
    "made",
    [
        lambda c: pd.DataFrame(c),
        lambda c: c,
        lambda c: {k: v.tolist() for k, v in c.items()},
        lambda c: pd.DataFrame(c).to_records(index=False),
        lambda c: pd.DataFrame(c).set_index("time"),
        frame_by_durations,
        frame_by_instants,
        lambda c: {"t [ms]": c["time"] * 1e3, "inlet (bar)": c["inlet"] / 1e5,
                   "outlet_bar": c["outlet"] / 1e5},
    ],
)  # fmt: skip
def test_data_are_fitted_as_a_file_is(
    made: Any, columns: dict[str, np.ndarray], expected: dict[str, float]
) -> None:
    check(made(columns), expected)


def test_a_table_has_numbers_for_headers(columns: dict[str, np.ndarray]) -> None:
    table = np.column_stack(list(columns.values()))
    log = read_log(table, columns={"time": "#1", "inlet": "#2", "outlet": "#3"})
    assert ff.fit("line", log).verdict in ("pass", "warn")


def test_the_same_data_have_the_same_checksum(columns: dict[str, np.ndarray]) -> None:
    assert read_log(columns).sha256 == read_log(pd.DataFrame(columns)).sha256
    other = {**columns, "inlet": columns["inlet"] + 1.0}
    assert read_log(columns).sha256 != read_log(other).sha256


@pytest.mark.parametrize(
    "made",
    [
        lambda c: pd.DataFrame(c).astype(object),
        lambda c: pd.DataFrame(c).map(repr),
        lambda c: {k: [f"{v:.17E}".replace("E", "D") for v in values] for k, values in c.items()},
    ],
)
def test_numbers_as_objects_and_as_text_are_read(
    made: Any, columns: dict[str, np.ndarray], expected: dict[str, float]
) -> None:
    raw = {role: values / SI[role] for role, values in columns.items()}
    units = {"time": "ms", "inlet": "bar", "outlet": "bar"}
    found = ff.fit("line", made(raw), units=units).parameters
    assert {n: q.value for n, q in found.items()} == pytest.approx(expected, rel=1e-6)


def test_text_that_is_no_number_is_refused(columns: dict[str, np.ndarray]) -> None:
    texts = [repr(float(v)) for v in columns["inlet"]]
    with pytest.raises(LogError, match="line 3: column 'inlet' holds '3,5'"):
        ff.fit("line", {**columns, "inlet": [*texts[:2], "3,5", *texts[3:]]})


@pytest.mark.parametrize("kind", [float, np.int64, "M8[ns]", "m8[ns]", object])
def test_what_a_mask_hides_is_no_number(kind: Any) -> None:
    values = np.arange(1, 9).astype(kind)
    hidden = np.ma.masked_array(values, mask=np.arange(8) == 5)
    for data in ({"time": hidden, "p": np.arange(8.0)}, np.ma.stack([hidden, hidden]).T):
        found = read_log(data).columns[0].values
        assert np.flatnonzero(np.isnan(found)).tolist() == [5]
    assert np.isfinite(read_log({"p": np.ma.masked_array(values)}).columns[0].values).all()


def test_missing_values_of_nullable_columns_are_no_numbers() -> None:
    frame = pd.DataFrame({"p": [1, None, 3], "q": [1.5, None, 3.0]}).astype(
        {"p": "Int64", "q": "Float64"}
    )
    for column in read_log(frame).columns:
        assert np.isnan(column.values).tolist() == [False, True, False]


def test_columns_of_a_frame_may_share_a_name() -> None:
    frame = pd.DataFrame([[0.0, 1.0, 2.0], [0.1, 3.0, 4.0]], columns=["time", "p", "p"])
    log = read_log(frame)
    assert [c.header for c in log.columns] == ["time", "p", "p"]
    assert [c.values.tolist() for c in log.columns[1:]] == [[1.0, 3.0], [2.0, 4.0]]


def zstd(content: bytes) -> bytes:
    packed: bytes = pyarrow.compress(content, codec="zstd", asbytes=True)
    return packed


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress, lzma.compress, zstd])
def test_packed_files_are_unpacked(tmp_path: Path, pack: Any) -> None:
    path = tmp_path / "log.csv.packed"
    path.write_bytes(pack(CSV.read_bytes()))
    plain, packed = read_log(CSV), read_log(path)
    for a, b in zip(plain.columns, packed.columns):
        np.testing.assert_array_equal(a.values, b.values)
    path.write_bytes(pack(CSV.read_bytes())[:-20])
    with pytest.raises(LogError, match="damaged"):
        read_log(path)


def test_matlab_vectors(
    tmp_path: Path, columns: dict[str, np.ndarray], expected: dict[str, float]
) -> None:
    path = tmp_path / "log.mat"
    savemat(path, {**columns, "gain": 3.0, "note": "a remark", "short": np.arange(5.0)})
    log = read_log(path)
    assert [n.code for n in log.notices] == ["variables-left-out"]
    check(log, expected)
    savemat(path, {"run": columns})  # a structure
    check(path, expected)


@pytest.mark.parametrize("named", [{}, {"outlet": "outlet"}])
def test_a_missing_column_is_told_beside_what_was_left_out(
    tmp_path: Path, columns: dict[str, np.ndarray], named: dict[str, str]
) -> None:
    path = tmp_path / "log.mat"
    savemat(path, {**columns, "outlet": columns["outlet"][:-1]})
    with pytest.raises(LogError, match=r"outlet \(999 values where the others have 1000\)"):
        ff.fit("line", path, columns=named)


def test_dspace_matlab_with_two_rasters(tmp_path: Path) -> None:
    fast, slow = np.arange(0.0, 1.0, 0.01), np.arange(0.0, 1.0, 0.1)
    recording = {
        "X": [{"Data": fast}, {"Data": slow}],
        "Y": [
            {"Name": '"Model Root"/"valve"/"Out1"', "Data": fast**2, "XIndex": 1},
            {"Name": 'Model Root/oil\\temperature', "Data": slow + 20.0, "XIndex": 2},
        ],
    }  # fmt: skip
    path = tmp_path / "rec1.mat"
    savemat(path, {"rec1": recording})
    log = read_log(path)
    assert log.dialect.name == "dSPACE MATLAB"
    assert [c.header for c in log.columns] == ["time", "Out1", "temperature"]
    assert log.columns[0].unit == "s"
    sparse = log.columns[2]
    assert sparse.sparse
    np.testing.assert_allclose(sparse.values[np.isfinite(sparse.values)], slow + 20.0)


def test_parquet(
    tmp_path: Path, columns: dict[str, np.ndarray], expected: dict[str, float]
) -> None:
    path = tmp_path / "log.parquet"
    pd.DataFrame(columns).to_parquet(path)
    check(path, expected)


def test_hdf5_as_matlab_writes_it(
    tmp_path: Path, columns: dict[str, np.ndarray], expected: dict[str, float]
) -> None:
    path = tmp_path / "log.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in columns.items():
            file[name] = values[None, :]
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")
    check(path, expected)


def test_tdms(tmp_path: Path) -> None:
    path = tmp_path / "log.tdms"
    timing = {"wf_start_offset": 0.0, "wf_increment": 0.01, "unit_string": "bar"}
    values = np.linspace(1.0, 2.0, 100)
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment([nptdms.ChannelObject("bench", "inlet", values, timing)])
    log = read_log(path)
    assert [(c.header, c.unit) for c in log.columns] == [("time", "s"), ("inlet", "bar")]
    np.testing.assert_allclose(log.columns[0].values, 0.01 * np.arange(100))


@pytest.mark.parametrize("version", ["3.30", "4.10", "4.11"])
def test_mdf(tmp_path: Path, version: str) -> None:
    """Two groups, each with instants of its own, and a channel of text that is no number."""
    asammdf = pytest.importorskip("asammdf", reason="the extra 'mdf' is not installed")
    t, slow = 0.01 * np.arange(200), 0.02 * np.arange(100)
    with asammdf.MDF(version=version) as file:
        pressure = asammdf.Signal(samples=1.0 + t, timestamps=t, name="inlet", unit="bar")
        file.append([pressure])
        file.append(
            [
                asammdf.Signal(samples=20.0 + slow, timestamps=slow, name="oil", unit="degC"),
                asammdf.Signal(
                    samples=np.array([b"on"] * 100), timestamps=slow, name="pump", encoding="utf-8"
                ),
            ]
        )
        path = Path(file.save(tmp_path / "log"))
    log = read_log(path)
    assert log.dialect.name == "MDF"
    headers = [("time", "s"), ("inlet", "bar"), ("oil", "degC")]
    assert [(c.header, c.unit) for c in log.columns] == headers
    np.testing.assert_allclose(log.columns[1].values, 1.0 + t)
    # a slower channel has values at its own instants only
    np.testing.assert_allclose(log.columns[2].values[::2], 20.0 + slow)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"time": [0.0, 1.0], "inlet": [1.0]}, "differ in length"),
        ({}, "columns"),
        ({"time": []}, "no samples"),
        (np.zeros((2, 3, 4)), "no log"),
        (42, "no log"),
        ({"time": [0.0, 1.0], "inlet": [1j, 2.0]}, "complex"),
        ({"time": [0.0, 1.0, 2.0, 3.0], "inlet": [[1.0, 2.0], [3.0, 4.0]]}, "shape"),
    ],
)
def test_what_is_no_table_is_refused(data: Any, said: str) -> None:
    with pytest.raises(LogError, match=said):
        read_log(data)


def test_text_among_numbers_is_named(columns: dict[str, np.ndarray]) -> None:
    inlet = columns["inlet"].astype(object)
    inlet[7] = "oops"
    with pytest.raises(LogError, match="oops"):
        ff.fit("line", {**columns, "inlet": inlet})


def test_standard_input(tmp_path: Path) -> None:
    out = tmp_path / "line.yaml"
    words = ["line", "-", "--column", "time=#1", "--column", "inlet=#2", "--column", "outlet=#3"]
    command = [sys.executable, "-m", "fluidact_fit_cli.main", *words, "-o", str(out)]
    done = subprocess.run(command, input=CSV.read_bytes(), capture_output=True)
    assert done.returncode == 0, done.stderr
    assert ff.read_document(out).provenance.logs[0].file == "standard input"


@pytest.mark.parametrize("magic", [b"MATLAB 5.0", b"PAR1", b"\x89HDF\r\n\x1a\n", b"TDSm"])
def test_damaged_recordings_are_refused(tmp_path: Path, magic: bytes) -> None:
    path = tmp_path / "log.bin"
    path.write_bytes(magic + io.BytesIO(bytes(range(256)) * 8).read())
    with pytest.raises(LogError, match=r"cannot be read|no channel"):
        read_log(path)


def test_columns_and_units_are_told_in_the_call(
    columns: dict[str, np.ndarray], expected: dict[str, float]
) -> None:
    frame = pd.DataFrame({"t": 1e3 * columns["time"], "p1": columns["inlet"] / 1e5,
                          "p2": columns["outlet"] / 2e5})  # fmt: skip
    told = {
        "columns": {"time": "t", "inlet": "p1", "outlet": "p2"},
        "units": {"time": "ms", "inlet": "bar", "outlet": "bar"},
        "scales": {"outlet": 2.0},
    }
    other = frame.assign(p2=1.001 * frame["p2"])  # rows that are not fitted
    for data in (frame, dict(frame.items()), [frame]):
        found = ff.fit("line", data, validate=[other], **told)
        for name, value in expected.items():
            assert found.parameters[name].value == pytest.approx(value, rel=1e-6), name
        (source,) = found.document.provenance.logs
        assert source.columns["inlet"].header == "p1"
        assert source.columns["inlet"].unit == "bar"
        assert found.document.validation[0].fit_percent > 90.0


def test_a_path_takes_columns_a_sample_time_and_a_window(expected: dict[str, float]) -> None:
    named = {"time": "#1", "inlet": "#2", "outlet": "#3"}
    found = ff.fit("line", CSV, columns=named)
    assert {n: q.value for n, q in found.parameters.items()} == expected
    with pytest.raises(UsageError, match="read already"):
        ff.fit("line", read_log(CSV), columns=named)
    with pytest.raises(LogError, match="nothing"):
        ff.fit("line", CSV, columns={**named, "inlet": "nothing"})
    part = ff.fit("line", CSV, columns=named, window=(None, 1.0))
    whole, cut = (f.document.fit.samples for f in (found, part))
    assert cut < whole


@pytest.mark.parametrize("missing", [0, 5])
@pytest.mark.parametrize("kind", ["datetime64[ns]", "datetime64[us]", "timedelta64[ns]"])
@pytest.mark.parametrize("how", ["frame", "parquet"])
def test_a_missing_instant_is_one_invalid_row(
    tmp_path: Path, how: str, kind: str, missing: int
) -> None:
    """All instants became -9.2e9 s."""
    start = 0 if kind.startswith("t") else 1_714_564_800_000_000_000
    instants = (start + 10_000_000 * np.arange(50)).astype(kind.partition("[")[0] + "[ns]")
    instants = instants.astype(kind)
    instants[missing] = "NaT"
    frame = pd.DataFrame({"time": instants, "p": np.arange(50.0)})
    given: object = frame
    if how == "parquet":
        frame.to_parquet(tmp_path / "log.parquet")
        given = tmp_path / "log.parquet"
    values = read_log(given).columns[0].values
    assert np.flatnonzero(np.isnan(values)).tolist() == [missing]
    np.testing.assert_allclose(np.diff(np.delete(values, missing))[6:], 0.01)


@pytest.mark.parametrize("unit", ["Y", "M", "W", "D", "h", "m", "s", "ms", "us", "ns"])
@pytest.mark.parametrize("order", "<>")
def test_instants_count_in_the_unit_that_they_have(unit: str, order: str) -> None:
    """Months were taken for minutes, and years ended in a traceback."""
    begin = np.datetime64("2024-01-01").astype(f"M8[{unit}]")
    instants = begin + np.arange(12)
    log = log_of({"time": instants.astype(f"{order}M8[{unit}]"), "p": np.arange(12.0)}, "log")
    since = instants.astype("M8[ns]") - begin.astype("M8[ns]")  # months differ in length
    np.testing.assert_allclose(log.columns[0].values, since / np.timedelta64(1, "s"), rtol=1e-15)
    assert log.columns[0].since == int(begin.astype("M8[ns]").astype(np.int64))


@pytest.mark.parametrize(
    "as_cells",
    [
        lambda t: t.tz_localize("UTC"),
        lambda t: t.tz_localize("UTC").tz_convert("Europe/Berlin"),
        lambda t: list(t.to_pydatetime()),
        lambda t: [str(x) for x in t],
        lambda t: [x.isoformat() + "Z" for x in t],
        lambda t: [x.time() for x in t],
    ],
)
def test_instants_of_any_kind(as_cells: Callable[[pd.DatetimeIndex], object]) -> None:
    """With a zone, as objects or as text none of them was a number."""
    instants = pd.date_range("2024-10-27 00:59:59.8", periods=50, freq="10ms")
    log = read_log(pd.DataFrame({"time": as_cells(instants), "p": np.arange(50.0)}))
    np.testing.assert_allclose(log.columns[0].values, 0.01 * np.arange(50), atol=1e-9)
    assert log.columns[0].unit == "s"
