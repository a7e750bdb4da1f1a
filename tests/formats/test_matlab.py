"""MATLAB files of every version: structures, cells, Simulink, and what is no signal."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy import sparse
from scipy.io import savemat

from fluidact_fit.errors import LogError
from fluidact_fit.logs import Log, read_log
from recordings import T, columns, fates


def read(folder: Path, variables: dict[str, Any], **how: Any) -> Log:
    path = folder / "log.mat"
    savemat(path, variables, **how)
    return read_log(path)


def test_version_4(tmp_path: Path) -> None:
    log = read(tmp_path, {"t": T, "x": T**2, "who": "me"}, format="4")
    np.testing.assert_array_equal(columns(log)["x"], T**2)
    assert fates(log) == {"who": "text"}
    log = read(tmp_path, {"data": np.column_stack((T, T**2)).astype("f4")}, format="4")
    assert [c.header for c in log.columns] == ["data1", "data2"]


def test_text_that_begins_as_a_number_is_no_matlab_file(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("0,1\n" * 20)
    assert read_log(path).dialect.name == "delimited"


def test_what_is_no_signal_is_named(tmp_path: Path) -> None:
    log = read(tmp_path, {
        "t": T, "x": 2 * T, "z": T + 1j, "cube": np.ones((200, 2, 3)), "gain": 3.0, "note": "a",
        "wide": np.ones((200, 5000)), "big": sparse.csc_matrix((100_000, 100_000)),
        "short": np.arange(7.0), "cells": np.array([T, "b", T[:3]], dtype=object),
    })  # fmt: skip
    assert [*columns(log)] == ["t", "x", "cells1"]
    account = fates(log)
    assert {"z", "cube", "gain", "note", "wide", "big", "short", "cells2", "cells3"} <= {*account}
    (notice,) = log.notices
    told = ["z (complex numbers)", "cube (an array of 3 axes (200 x 2 x 3))", "cells3"]
    told += ["wide (a table of 5000 columns)", "big (a sparse matrix)", "short (7 values"]
    for text in told:
        assert text in notice.message


def test_a_sparse_vector_is_filled_up(tmp_path: Path) -> None:
    values = np.where(np.arange(200) % 5, 0.0, T)
    log = read(tmp_path, {"t": T[:, None], "x": sparse.csc_matrix(values[:, None])})
    np.testing.assert_array_equal(columns(log)["x"], values)


def test_more_than_a_thousand_columns(tmp_path: Path) -> None:
    log = read(tmp_path, {"t": T, "d": np.arange(300_000.0).reshape(200, 1500)})
    assert columns(log)["d1500"][0] == 1499.0


@pytest.mark.parametrize(
    ("variables", "rows", "channels"),
    [
        ({"data": np.arange(24.0).reshape(4, 6)}, 4, 6),
        ({"data": np.arange(24.0).reshape(4, 6), "t": np.arange(4.0)}, 4, 7),
        ({"data": np.arange(24.0).reshape(4, 6), "t": np.arange(6.0)}, 6, 5),
        ({"data": np.vstack((T, T**2, T**3))}, 200, 3),
        ({"run": {"data": np.ones((4, 200)), "time": T}}, 200, 5),
    ],
)
def test_which_way_samples_run(
    tmp_path: Path, variables: dict[str, Any], rows: int, channels: int
) -> None:
    log = read(tmp_path, variables)
    assert (log.rows, len(log.columns)) == (rows, channels)


def simulink(*signals: tuple[str, np.ndarray], time: Any = T) -> dict[str, Any]:
    held = [{"values": v, "dimensions": 1, "label": n} for n, v in signals]
    return {"time": time, "signals": held, "blockName": "model/scope"}


def test_simulink_structures_with_several_signals(tmp_path: Path) -> None:
    log = read(tmp_path, {"simout": simulink(("Force", T), ("Pos", 2 * T), ("", 3 * T))})
    found = columns(log)
    assert [*found] == ["time", "Force", "Pos", "signal3"]
    np.testing.assert_array_equal(found["Pos"], 2 * T)
    log = read(tmp_path, {"out": simulink(("q", np.column_stack((T, T))))})
    assert [c.header for c in log.columns] == ["time", "q1", "q2"]
    log = read(tmp_path, {"out": simulink(("q", T), ("p", T), time=[])})
    assert [c.header for c in log.columns] == ["q", "p"]
    short = 0.1 * np.arange(20)
    log = read(tmp_path, {"a": simulink(("q", T)), "b": simulink(("p", short), time=short)})
    assert [c.header for c in log.columns] == ["time", "q", "p"]
    np.testing.assert_array_equal(columns(log)["p"], short)


def test_structures_with_other_times_are_no_one_table(tmp_path: Path) -> None:
    one, other = {"time": T, "x": T}, {"time": T + 0.005, "x": 2 * T}
    log = read(tmp_path, {"a": one, "b": other})
    assert [c.header for c in log.columns] == ["time", "a.x", "b.x"]
    assert log.rows == 400
    np.testing.assert_array_equal(columns(log)["b.x"], 2 * T)
    log = read(tmp_path, {"a": one, "b": {"time": T, "x": 2 * T}})
    assert [c.header for c in log.columns] == ["time", "a.x", "b.x"]
    assert log.rows == 200
    log = read(tmp_path, {"runs": [one, other]})
    assert [c.header for c in log.columns] == ["time", "runs1.x", "runs2.x"]


def test_nothing_but_text_is_refused_with_its_names(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"no vectors of numbers \(who \(text\)"):
        read(tmp_path, {"who": "me"})


def element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def an_object(name: bytes, word: bytes) -> bytes:
    """A variable as MATLAB writes an object: its name, its class, and where its content is."""
    content = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 1, 6))
    content += element(1, b"") + element(6, struct.pack("<6I", 0xDD000000, 2, 1, 1, 1, 1))
    head = element(6, struct.pack("<II", 17, 0)) + element(1, name) + element(1, b"MCOS")
    return element(14, head + element(1, word) + element(14, content))


def test_every_object_is_named(tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    savemat(path, {"t": T, "x": T})
    objects = an_object(b"tt", b"timetable") + an_object(b"ts", b"timeseries")
    path.write_bytes(path.read_bytes() + objects)
    log = read_log(path)
    assert log.rows == 200
    assert fates(log) == {
        "tt": "a MATLAB object (timetable)", "ts": "a MATLAB object (timeseries)",
    }  # fmt: skip
    (notice,) = log.notices
    assert "tt (a MATLAB object (timetable)); ts (" in notice.message


def read_73(folder: Path, fill: Callable[[h5py.File], object]) -> Log:
    """A file as MATLAB 7.3 writes it: HDF5 behind a line of text."""
    path = folder / "log.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        fill(file)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")
    return read_log(path)


def variable(place: h5py.Group, name: str, values: Any, word: str, **attributes: Any) -> Any:
    dataset = place.create_dataset(name, data=np.asarray(values).T)
    dataset.attrs["MATLAB_class"] = np.bytes_(word)
    for key, value in attributes.items():
        dataset.attrs[key] = value
    return dataset


def test_version_73(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        variable(file, "t", T[:, None], "double")
        variable(file, "data", np.column_stack((T, T**2)), "double")
        variable(file, "on", (T[:, None] > 1).astype("u1"), "logical", MATLAB_int_decode=1)
        variable(file, "note", np.full((1, 200), 65, "u2"), "char", MATLAB_int_decode=2)
        variable(file, "none", np.zeros(2, "u8"), "double", MATLAB_empty=1)
        variable(file, "tt", np.arange(200, dtype="u4"), "timetable", MATLAB_object_decode=3)
        refs = file.create_group("#refs#")
        cells = [variable(refs, "a", 3 * T[:, None], "double"), variable(refs, "b", [[66]], "char")]
        held = np.array([[c.ref for c in cells]], dtype=h5py.ref_dtype)
        file.create_dataset("c", data=held).attrs["MATLAB_class"] = np.bytes_("cell")
        thin = file.create_group("thin")
        thin.attrs["MATLAB_sparse"] = 200
        thin["data"], thin["ir"] = np.ones(200), np.arange(200)
        variable(file.create_group("run"), "x", 4 * T[:, None], "double")

    log = read_73(tmp_path, fill)
    found = columns(log)
    assert {*found} == {"t", "data1", "data2", "on", "c1", "run.x"}
    np.testing.assert_array_equal(found["data2"], T**2)
    np.testing.assert_array_equal(found["c1"], 3 * T)
    account = fates(log)
    assert (account["note"], account["none"], account["c2"]) == ("text", "empty", "text")
    assert "timetable" in account["tt"]
    assert "sparse" in account["thin"]


@pytest.mark.parametrize("left", range(3, 10))
@pytest.mark.parametrize("magic", [b"MATLAB 5.0", b"MATLAB 7.3"])
def test_a_file_that_is_cut_in_its_first_bytes_is_no_text(
    tmp_path: Path, magic: bytes, left: int
) -> None:
    path = tmp_path / "log.mat"
    path.write_bytes(magic[:left])
    with pytest.raises(LogError, match=f"only {left} bytes"):
        read_log(path)


def test_a_version_4_that_is_cut_says_so(tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    savemat(path, {"t": T, "x": T**2}, format="4")
    raw = path.read_bytes()
    for size, told in ((1000, "MATLAB 4 file that is cut: its first matrix ends at byte 1622"),
                       (2500, "MATLAB 4 file is cut or damaged .Not enough bytes")):  # fmt: skip
        path.write_bytes(raw[:size])
        with pytest.raises(LogError, match=told):
            read_log(path)
    huge = struct.pack("<5i", 0, 2**31 - 1, 2**31 - 1, 0, 2) + b"x\0" + bytes(100)
    path.write_bytes(huge)
    with pytest.raises(LogError, match="is cut"):
        read_log(path)


@pytest.mark.parametrize(
    ("head", "told"),
    [
        (b"ARROW1\0\0", "a Feather or Arrow file.*to_parquet"),
        (b"\x93NUMPY\x01\0", "an array of NumPy"),
        (b"\x80\x05\x95", "a pickle of Python, which can run code"),
        (b"ULog\x01\x12\x35\x01", "a ULog file of PX4"),
    ],
)
def test_what_else_is_recorded_is_called_by_its_name(
    tmp_path: Path, head: bytes, told: str
) -> None:
    path = tmp_path / "log.bin"
    path.write_bytes(head + bytes(range(256)))
    with pytest.raises(LogError, match=f"(?s){told}"):
        read_log(path)
