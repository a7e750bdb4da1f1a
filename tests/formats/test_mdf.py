"""MDF: invalid samples, groups with their own time, and files that are damaged."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fluidact_fit.errors import LogError
from fluidact_fit.logs import Log, read_log
from recordings import T, columns, fates

asammdf = pytest.importorskip("asammdf", reason="the extra 'mdf' is not installed")
INVALID = np.isin(np.arange(200), range(10, 20))


def signal(name: str, values: Any, times: Any = T, unit: str = "bar", **how: Any) -> Any:
    return asammdf.Signal(samples=values, timestamps=times, name=name, unit=unit, **how)


def read(folder: Path, *groups: list[Any], version: str = "4.10", **how: Any) -> Log:
    with asammdf.MDF(version=version) as file:
        for group in groups:
            file.append(group)
        return read_log(Path(file.save(folder / "log", **how)))


def test_samples_that_are_marked_invalid_are_none(tmp_path: Path) -> None:
    values = np.where(INVALID, 1e6, T)
    log = read(tmp_path, [signal("x", values, invalidation_bits=INVALID), signal("y", T)])
    x = log.columns[1]
    np.testing.assert_array_equal(np.isnan(x.values), INVALID)
    assert set(x.bad.values()) == {"marked invalid"}
    assert not x.sparse
    assert fates(log)["group1.x"] == "10 samples marked as invalid"


def test_invalid_samples_of_several_groups_are_told(tmp_path: Path) -> None:
    x = signal("x", np.where(INVALID, 1e6, T), invalidation_bits=INVALID)
    log = read(tmp_path, [x], [signal("y", T[:50], 4 * T[:50] + 0.001)])
    assert columns(log)["x"].max() < 2.0
    (notice,) = [n for n in log.notices if n.code == "samples-invalid"]
    assert "10 of 'x'" in notice.message


def test_groups_keep_their_own_instants(tmp_path: Path) -> None:
    log = read(tmp_path, [signal("x", T)], [signal("y", T[:50], 5.0 + 4 * T[:50])])
    at = np.isfinite(log.columns[2].values)
    np.testing.assert_allclose(log.columns[0].values[at], 5.0 + 4 * T[:50])
    log = read(tmp_path, [signal("x", T)], [signal("x", 2 * T, T + 0.001)], overwrite=True)
    assert [c.header for c in log.columns] == ["time", "group1.x", "group2.x"]


@pytest.mark.parametrize("compression", [0, 1, 2])
def test_conversions_are_applied(tmp_path: Path, compression: int) -> None:
    counts, states = np.arange(200, dtype="u2"), (np.arange(200) % 2).astype("u1")
    words = {"val_0": 0, "text_0": b"off", "val_1": 1, "text_1": b"on", "default": b""}
    log = read(tmp_path, [signal("x", counts, conversion={"a": 2.0, "b": 1.0}),
                          signal("pump", states, conversion=words), signal("on", T > 1.0),
                          signal("name", np.array([b"ab"] * 200), encoding="utf-8")],
               compression=compression)  # fmt: skip
    found = columns(log)
    np.testing.assert_array_equal(found["x"], 2.0 * counts + 1.0)
    np.testing.assert_array_equal(found["pump"], states)
    np.testing.assert_array_equal(found["on"], T > 1.0)
    assert fates(log)["group1.name"] == "text"


@pytest.mark.parametrize("place", [70, 200, 1000, 3000, -600, -30])
def test_a_file_that_is_cut_is_refused(tmp_path: Path, place: int) -> None:
    read(tmp_path, [signal("x", T)], [signal("y", T[:50], 4 * T[:50])])
    path = tmp_path / "log.mf4"
    path.write_bytes(path.read_bytes()[:place])
    with pytest.raises(LogError, match=r"cannot be read|damaged|are stated|no vectors"):
        read_log(path)


def test_flipped_bits_end_no_process(tmp_path: Path) -> None:
    """Whatever they do to the library, the file is read or refused."""
    read(tmp_path, [signal("x", T)], [signal("y", T[:50], 4 * T[:50])])
    path = tmp_path / "log.mf4"
    content = path.read_bytes()
    rng = np.random.default_rng(3)
    ends = []
    for _ in range(5):
        damaged = bytearray(content)
        damaged[rng.integers(64, len(content))] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        try:
            ends.append(read_log(path).rows)
        except LogError as error:
            ends.append(error.text)
    assert len(ends) == 5


def test_an_unfinished_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.mf4"
    path.write_bytes(b"UnFinMF 4.10    " + bytes(200))
    with pytest.raises(LogError, match="never finished"):
        read_log(path)
