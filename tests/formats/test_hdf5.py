"""HDF5 and netCDF: packed numbers, time bases, and nothing from outside the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import netcdf_file

from fluidact_fit.errors import LogError
from fluidact_fit.logs import read_log
from recordings import T, columns, fates, put, read_hdf5

RAW = np.r_[-999, np.arange(199)].astype("i2")


def test_packed_numbers_are_what_their_attributes_say(tmp_path: Path) -> None:
    packing = {"scale_factor": 0.01, "add_offset": 5.0, "_FillValue": np.int16(-999)}

    def fill(file: h5py.File) -> None:
        put(file, "p", RAW, {**packing, "units": "bar"})
        put(file, "time", np.arange(200), {"units": "milliseconds since 2024-01-01 00:00:00"})

    log = read_hdf5(tmp_path, fill)
    pressure, time = log.columns
    assert (pressure.unit, time.unit) == ("bar", "milliseconds")
    np.testing.assert_allclose(pressure.values[1:], 5.0 + 0.01 * np.arange(199))
    assert np.isnan(pressure.values[0])
    assert pressure.bad == {0: "-999"}
    assert fates(log)["p"] == "1 cells marked as missing, times 0.01 plus 5"


@pytest.mark.parametrize(
    ("attributes", "invalid"),
    [
        ({"missing_value": [-999, 5]}, [0, 6]),
        ({"valid_range": np.array([0, 190], "i2")}, [0, *range(192, 200)]),
        ({"valid_min": 0}, [0]),
        ({"_FillValue": -999, "valid_max": np.array([197])}, [0, 199]),
        ({"Units": np.bytes_(b"V")}, []),
    ],
)
def test_cells_that_stand_for_none(tmp_path: Path, attributes: Any, invalid: list[int]) -> None:
    log = read_hdf5(tmp_path, lambda f: (put(f, "p", RAW, attributes), put(f, "t", T, {})))
    assert np.flatnonzero(np.isnan(log.columns[0].values)).tolist() == invalid


@pytest.mark.parametrize(
    "attributes",
    [{"scale_factor": "a lot"}, {"scale_factor": [1.0, 2.0]}, {"add_offset": np.nan},
     {"valid_range": [1, 2, 3]}, {"_FillValue": "none"}, {"scale_factor": np.inf}],
)  # fmt: skip
def test_packing_that_is_not_understood_is_refused(tmp_path: Path, attributes: Any) -> None:
    with pytest.raises(LogError, match=r"attribute .* of 'rig.p' is"):
        read_hdf5(tmp_path, lambda f: put(f, "rig/p", RAW, attributes))


def external(file: h5py.File, other: Path) -> None:
    file.create_dataset("x", (200,), "u1", external=[(str(other), 0, 200)])


def external_parts(file: h5py.File, other: Path) -> None:
    parts = [(str(other), 0, 80), (str(other), 80, h5py.h5f.UNLIMITED)]
    file.create_dataset("rig/x", (200,), "u1", external=parts)


def external_link(file: h5py.File, other: Path) -> None:
    file["x"] = h5py.ExternalLink(str(other), "x")


def link_through_a_link(file: h5py.File, other: Path) -> None:
    file["z"] = h5py.ExternalLink(str(other), "/")
    file["a"] = h5py.SoftLink("/z/x")


def virtual(file: h5py.File, other: Path) -> None:
    layout = h5py.VirtualLayout((200,), "f8")
    layout[:] = h5py.VirtualSource(str(other), "x", (200,))
    file.create_virtual_dataset("x", layout)


def virtual_of_itself(file: h5py.File, other: Path) -> None:
    layout = h5py.VirtualLayout((200,), "f8")
    layout[:] = h5py.VirtualSource(".", "x", (200,))[:]
    file.create_virtual_dataset("x", layout)


def virtual_behind_a_reference(file: h5py.File, other: Path) -> None:
    virtual(file.create_group("#refs#"), other)
    file["cells"] = np.array([file["#refs#/x"].ref], dtype=h5py.ref_dtype)


@pytest.mark.parametrize(
    "made",
    [external, external_parts, external_link, link_through_a_link, virtual, virtual_of_itself,
     virtual_behind_a_reference],
)  # fmt: skip
def test_nothing_outside_the_file_is_read(tmp_path: Path, made: Any) -> None:
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["x"] = T
    with pytest.raises(LogError, match="which is not read"):
        read_hdf5(tmp_path, lambda f: (put(f, "t", T, {}), made(f, other)))


def test_every_other_kind_is_named(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file["t"], file["b"], file["c"] = T, T > 1.0, T + 1j
        file["words"] = np.array([b"x"] * 200)
        file["gain"], file["cube"] = 5.0, np.ones((4, 5, 200))
        file["m"], file["w"], file["none"] = np.ones((200, 2)), np.ones((3, 200)), np.zeros(0)
        file["again"], file["nowhere"] = h5py.SoftLink("/t"), h5py.SoftLink("/nothing")
        file["nul"] = h5py.Empty("f8")
        file.create_dataset("unwritten", (200,), "f4")
        file["ragged"] = np.array([np.ones(2), np.ones(3)] * 100, dtype=h5py.vlen_dtype("f8"))
        file["rows"] = np.array(list(zip(T, 2 * T)), dtype=[("time", "f8"), ("v", "f4")])

    log = read_hdf5(tmp_path, fill)
    found = columns(log)
    assert {"t", "b", "m1", "m2", "w1", "w2", "w3", "rows.v"} <= {*found} | {"t"}
    np.testing.assert_array_equal(found["b"], T > 1.0)
    np.testing.assert_allclose(found["rows.v"], 2 * T, rtol=1e-6)
    account = fates(log)
    for name in ("c", "words", "gain", "cube", "none", "again", "nowhere", "nul", "unwritten",
                 "ragged"):  # fmt: skip
        assert account[name], name
    (notice,) = [n for n in log.notices if n.code == "variables-left-out"]
    for name in ("c (complex", "cube (", "unwritten (", "ragged ("):
        assert name in notice.message
    assert "words" not in notice.message


def test_chunks_that_were_never_written_are_no_zeros(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file["t"] = T
        file.create_dataset("x", (200,), "f8", chunks=(50,))[:100] = 1.0 + T[:100]

    log = read_hdf5(tmp_path, fill)
    np.testing.assert_array_equal(np.isnan(log.columns[1].values), T >= 1.0)
    assert fates(log)["x"] == "100 cells never written"


@pytest.mark.parametrize("units", [{}, {"units": "s"}])
def test_groups_with_times_of_their_own_keep_them(tmp_path: Path, units: dict[str, str]) -> None:
    def fill(file: h5py.File) -> None:
        for name, step, rows in (("fast", 0.01, 200), ("slow", 0.1, 20)):
            put(file, f"{name}/time", step * np.arange(rows), units)
            put(file, f"{name}/p", np.arange(float(rows)), {})

    log = read_hdf5(tmp_path, fill)
    assert [c.header for c in log.columns] == ["time", "fast.p", "slow.p"]
    assert log.columns[0].unit == units.get("units")
    slow = log.columns[2]
    assert slow.sparse
    at = np.isfinite(slow.values)
    np.testing.assert_allclose(log.columns[0].values[at], 0.1 * np.arange(20))


def test_times_in_different_units_are_joined_in_seconds(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        put(file, "a/time", 10.0 * np.arange(200), {"units": "ms"})
        put(file, "a/p", T, {})
        put(file, "b/time", 0.005 + 0.1 * np.arange(20), {"units": "s"})
        put(file, "b/q", T[:20], {})

    log = read_hdf5(tmp_path, fill)
    assert log.columns[0].unit == "s"
    assert log.columns[0].values[-1] == pytest.approx(1.99)
    assert log.rows == 220


def test_groups_of_one_time_are_one_table(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        for name in "ab":
            put(file, f"{name}/time", T, {"units": "s"})
            put(file, f"{name}/p", T * 2.0, {})

    log = read_hdf5(tmp_path, fill)
    assert [c.header for c in log.columns] == ["a.p", "a.time", "b.p"]
    assert fates(log)["b.time"] == "the same as a.time"


def test_a_block_of_another_program_before_the_file(tmp_path: Path) -> None:
    log = read_hdf5(tmp_path, lambda f: put(f, "t", T, {}), userblock_size=2048)
    np.testing.assert_array_equal(log.columns[0].values, T)


@pytest.mark.parametrize(
    "fill",
    [
        lambda f: f.create_dataset("x", (1 << 40,), "f8", chunks=(1 << 10,)).__setitem__(0, 1.0),
        lambda f: f.create_dataset("x", (1 << 20, 1 << 20), "u1", chunks=(8, 8)).__setitem__(
            (0, 0), 1
        ),
        lambda f: f.create_dataset(
            "x", (1 << 25,), "f8", chunks=(1 << 24,), compression="gzip", fillvalue=1.0
        ).__setitem__(0, 1.0),
    ],
)
def test_what_is_far_larger_than_its_file_is_refused(tmp_path: Path, fill: Any) -> None:
    with pytest.raises(LogError, match="more than a file of this size may hold"):
        read_hdf5(tmp_path, fill)


def test_groups_in_a_circle_are_read_once(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file["t"] = T
        file.create_group("a")["b"] = file

    assert len(read_hdf5(tmp_path, fill).columns) == 1


@pytest.mark.parametrize("version", [1, 2])
def test_classic_netcdf(tmp_path: Path, version: int) -> None:
    path = tmp_path / "log.nc"
    with netcdf_file(path, "w", version=version) as file:
        file.createDimension("time", 200)
        time = file.createVariable("time", "f8", ("time",))
        time[:], time.units = T, "seconds since 2024-01-01"
        pressure = file.createVariable("p", "i2", ("time",))
        pressure[:] = RAW
        pressure.units, pressure.scale_factor, pressure._FillValue = "bar", 0.01, -999
    log = read_log(path)
    assert [(c.header, c.unit) for c in log.columns] == [("time", "seconds"), ("p", "bar")]
    np.testing.assert_allclose(log.columns[1].values[1:], 0.01 * np.arange(199))
    assert np.isnan(log.columns[1].values[0])


def test_long_vectors_are_not_there_twice(tmp_path: Path) -> None:
    values = np.sin(np.arange(float(1 << 20) + 7.0))

    def fill(file: h5py.File) -> None:
        file.create_dataset("rig/x", data=values, chunks=(1 << 15,), compression="lzf")
        put(file, "rig/y", values, {"scale_factor": 2.0})

    log = read_hdf5(tmp_path, fill)
    np.testing.assert_array_equal(log.columns[0].values, values)
    np.testing.assert_array_equal(log.columns[1].values, 2.0 * values)


def test_a_file_that_is_still_open_for_writing(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["t"] = T
        file.flush()
        np.testing.assert_array_equal(read_log(tmp_path / "log.h5").columns[0].values, T)


@pytest.mark.parametrize("unit", ["bar", np.bytes_(b"bar"), ["bar"], np.array([b"bar"])])
def test_units_however_they_are_written(tmp_path: Path, unit: Any) -> None:
    log = read_hdf5(tmp_path, lambda f: put(f, "p", T, {"Unit": unit}))
    assert log.columns[0].unit == "bar"
