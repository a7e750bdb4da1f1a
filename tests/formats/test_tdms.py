"""TDMS: channels at their own instants, instants among the channels, files that are cut."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nptdms
import numpy as np
import pytest

from fluidact_fit.errors import LogError
from fluidact_fit.logs import Log, read_log
from recordings import T, columns, fates

BEGIN = np.datetime64("2024-05-31T12:00:00", "us")


def channel(group: str, name: str, values: Any, **properties: Any) -> nptdms.ChannelObject:
    return nptdms.ChannelObject(group, name, np.asarray(values), properties)


def wave(after: float | None = 0.0, offset: float = 0.0) -> dict[str, Any]:
    found = {"wf_increment": 0.01, "wf_start_offset": offset}
    if after is not None:
        found["wf_start_time"] = BEGIN + np.timedelta64(round(1e6 * after), "us")
    return found


def stamps(after: float = 0.0, rows: int = 200) -> np.ndarray:
    return BEGIN + np.rint(1e6 * (after + T[:rows])).astype("m8[us]")


def read(folder: Path, *channels: nptdms.ChannelObject, times: int = 1) -> Log:
    path = folder / "log.tdms"
    with nptdms.TdmsWriter(str(path)) as writer:
        for _ in range(times):
            writer.write_segment(list(channels))
    return read_log(path)


def instants(log: Log, header: str) -> np.ndarray:
    values = next(c.values for c in log.columns if c.header == header)
    return log.columns[0].values[np.isfinite(values)]


@pytest.mark.parametrize(
    ("first", "second", "after", "rows"),
    [
        (wave(), wave(5.0), 5.0, 400),
        (wave(5.0), wave(), -5.0, 400),
        (wave(), wave(0.5), 0.5, 250),  # the instants that both have are the same numbers
        (wave(), wave(0.0, offset=0.5), 0.5, 250),
        (wave(None), wave(None), 0.0, 200),
        (wave(), wave(None), 0.0, 200),
        (wave(100_000.0), wave(100_000.5), 0.5, 250),
    ],
)
def test_channels_keep_their_own_instants(
    tmp_path: Path, first: Any, second: Any, after: float, rows: int
) -> None:
    log = read(tmp_path, channel("a", "x", T, **first), channel("b", "y", 2 * T, **second))
    assert log.rows == rows
    np.testing.assert_allclose(instants(log, "x"), T + max(-after, 0.0), atol=1e-9)
    np.testing.assert_allclose(instants(log, "y"), T + max(after, 0.0), atol=1e-9)
    np.testing.assert_array_equal(columns(log)["y"], 2 * T)


def test_a_channel_that_does_not_say_when_it_began(tmp_path: Path) -> None:
    log = read(tmp_path, channel("a", "x", T, **wave()), channel("b", "y", T, **wave(None)),
               channel("c", "z", T, **wave(5.0)))  # fmt: skip
    assert {*columns(log)} == {"time", "x", "z"}
    assert "when it began" in fates(log)["b.y"]


def test_instants_among_the_channels_are_the_time(tmp_path: Path) -> None:
    log = read(tmp_path, channel("a", "Stamp", stamps()), channel("a", "y", 2 * T))
    time = log.columns[0]
    assert (time.header, time.unit, time.clock) == ("Stamp", "s", True)
    np.testing.assert_allclose(time.values, T, atol=1e-9)
    log = read(tmp_path, channel("a", "Time", stamps()), channel("a", "y", T),
               channel("b", "Time", stamps(5.0, 50)), channel("b", "z", T[:50]))  # fmt: skip
    np.testing.assert_allclose(instants(log, "z"), 5.0 + T[:50], atol=1e-9)
    log = read(tmp_path, channel("a", "Time", stamps()), channel("a", "y", T),
               channel("b", "z", T[:50], **wave(1.0)))  # fmt: skip
    np.testing.assert_allclose(instants(log, "z"), 1.0 + T[:50], atol=1e-9)


def test_channels_without_instants_are_a_table(tmp_path: Path) -> None:
    log = read(tmp_path, channel("a", "t (ms)", 1e3 * T), channel("a", "y", T),
               channel("b", "z", T[:50]))  # fmt: skip
    assert [c.header for c in log.columns] == ["t (ms)", "y"]
    assert fates(log)["z"] == "50 values where the others have 200"


def test_every_other_channel_is_named(tmp_path: Path) -> None:
    log = read(tmp_path, channel("a", "x", T, unit_string="bar", **wave()),
               channel("a", "note", ["p", "q"]), channel("a", "c", T + 1j),
               channel("a", "on", T > 1.0, **wave()), channel("a", "none", []))  # fmt: skip
    assert [(c.header, c.unit) for c in log.columns[:2]] == [("time", "s"), ("x", "bar")]
    np.testing.assert_array_equal(columns(log)["on"], T > 1.0)
    assert fates(log).keys() >= {"a.note", "a.c", "a.none"}


@pytest.mark.parametrize("missing", [10, 1700, 4000])
def test_a_file_that_is_cut_says_so(tmp_path: Path, missing: int) -> None:
    read(tmp_path, channel("a", "x", T, **wave()), channel("a", "y", T, **wave()), times=3)
    path = tmp_path / "log.tdms"
    path.write_bytes(path.read_bytes()[:-missing])
    log = read_log(path)
    (notice,) = [n for n in log.notices if n.code == "recording-cut"]
    assert "misses" in notice.message
    assert columns(log)["x"].size < 600 or columns(log)["y"].size < 600


@pytest.mark.parametrize("kept", [4, 20, 27, 60, 200])
def test_a_file_that_is_cut_before_its_samples_is_refused(tmp_path: Path, kept: int) -> None:
    read(tmp_path, channel("a", "x", T, **wave()))
    path = tmp_path / "log.tdms"
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(LogError, match=r"cut|ends within|cannot be read"):
        read_log(path)


def test_a_segment_that_was_never_finished(tmp_path: Path) -> None:
    read(tmp_path, channel("a", "x", T, **wave()))
    path = tmp_path / "log.tdms"
    content = bytearray(path.read_bytes())
    content[12:20] = b"\xff" * 8
    path.write_bytes(content)
    assert [n.code for n in read_log(path).notices] == ["recording-cut"]


def test_the_index_beside_a_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.tdms_index"
    path.write_bytes(b"TDSh" + bytes(60))
    with pytest.raises(LogError, match=r"Give the \.tdms file"):
        read_log(path)
