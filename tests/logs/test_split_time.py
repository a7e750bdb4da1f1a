"""Seconds in one column, and their nano-, micro- or milliseconds in another."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fluidact_fit.errors import LogError
from fluidact_fit.family import Role, Variant
from fluidact_fit.logs import describe, experiments, read_log

ROLES = (Role("time", "s", ""), Role("outlet", "1", "", output=True))
FIRST = 1_717_171_717_873_456_789  # ns


def write(folder: Path, header: str, base: int, *, swapped: bool = False) -> Path:
    """A log of 200 samples every 10 ms."""
    rows = []
    for k in range(200):
        second, part = divmod((FIRST + k * 10_000_000) // (10**9 // base), base)
        pair = (part, second) if swapped else (second, part)
        rows.append(f"{pair[0]},{pair[1]},{3 * k % 7}.5")
    path = folder / "log.csv"
    path.write_text("\n".join(([header] if header else []) + rows) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("names", "base"),
    [
        ("header.stamp.secs,header.stamp.nsecs", 10**9),
        ("header.stamp.sec,header.stamp.nanosec", 10**9),
        ("/imu/header/stamp/secs,/imu/header/stamp/nsecs", 10**9),
        ("secs,nsecs", 10**9),
        ("sec,nanosec", 10**9),
        ("Seconds,Nanoseconds", 10**9),
        ("seconds,nanos", 10**9),
        ("stamp_sec,stamp_nsec", 10**9),
        ("stamp_sec, stamp_nanosec", 10**9),
        ("tv_sec,tv_nsec", 10**9),
        ("tv_sec,tv_usec", 10**6),
        ("timestamp_s,timestamp_us", 10**6),
        ("Time (s),Time (us)", 10**6),
        ("Time [s],Time [ms]", 10**3),
        ("sec,msec", 10**3),
    ],
)
def test_both_columns_are_one_time(tmp_path: Path, names: str, base: int) -> None:
    """The fractions were taken for the time, which started again with every second."""
    log = read_log(write(tmp_path, f"{names},p", base), columns={"outlet": "p"})
    np.testing.assert_array_equal(log.columns[0].values, np.arange(200) * 10_000_000 / 1e9)
    (one,), notices = experiments(log, Variant("any", ROLES, ()))
    assert one.sample_time == 0.01
    assert one.uniform
    assert "time-joined" in {n.code for n in notices}
    assert describe(log)["time"]["sample_time"] == pytest.approx(0.01)


def test_the_fractions_may_stand_first(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, "stamp.nsecs,stamp.secs,p", 10**9, swapped=True))
    np.testing.assert_array_equal(log.columns[1].values, np.arange(200) * 10_000_000 / 1e9)


def test_fractions_alone_are_no_time(tmp_path: Path) -> None:
    path = write(tmp_path, "secs,nsecs,p", 10**9)
    log = read_log(path, columns={"time": "nsecs", "outlet": "p"})
    with pytest.raises(LogError, match="no more than fractions of a second") as caught:
        experiments(log, Variant("any", ROLES, ()))
    assert caught.value.remedy == "Give --column time=#1."


@pytest.mark.parametrize("header", ["", "stamp.a,stamp.b,p"])
def test_fractions_are_never_proposed_as_the_time(tmp_path: Path, header: str) -> None:
    """Without names that tell, the advice was `--column time=#2`."""
    path = write(tmp_path, header, 10**9)
    assert describe(read_log(path))["time"] is None
    with pytest.raises(LogError) as caught:
        experiments(read_log(path, columns={"outlet": "#3"}), Variant("any", ROLES, ()))
    assert "looks like it" not in caught.value.text
    log = read_log(path, columns={"time": "#2", "outlet": "#3"})
    with pytest.raises(LogError, match="starts again wherever column"):
        experiments(log, Variant("any", ROLES, ()))


def test_a_time_beside_the_number_of_its_run_starts_again(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = [f"{k // 100},{10 * (k % 100)},{k % 7}.5" for k in range(400)]
    path.write_text("\n".join(["run,time [ms],outlet", *rows]) + "\n", encoding="utf-8")
    found, _ = experiments(read_log(path), Variant("any", ROLES, ()))
    assert len(found) == 4


def test_a_missing_number_is_a_missing_instant(tmp_path: Path) -> None:
    path = write(tmp_path, "secs,nsecs,p", 10**9)
    lines = path.read_text(encoding="utf-8").splitlines()
    lines[8] = lines[8].partition(",")[0] + ",," + lines[8].rpartition(",")[2]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    values = read_log(path).columns[0].values
    assert np.flatnonzero(np.isnan(values)).tolist() == [7]
    assert values[8] == 0.08


@pytest.mark.parametrize(
    "rows",
    [
        [f"{k},{1000 * k},{k}.5" for k in range(50)],  # one time in two units
        [f"0.0{k:02},{k % 1000},{k}.5" for k in range(50)],  # no whole seconds
        [f"{k // 10},{k % 10},{k}.5" for k in range(50)],  # counts to ten
    ],
)
def test_columns_that_do_not_belong_together_stay_apart(tmp_path: Path, rows: list[str]) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["t_s,t_ms,p", *rows]) + "\n", encoding="utf-8")
    log = read_log(path)
    assert not any(c.part_of for c in log.columns)
    assert not log.notices


@pytest.mark.parametrize(
    ("header", "base"),
    [
        ("Date,Time,ms", 10**3),
        ("Datum,Zeit,Millisekunden", 10**3),
        ("Fecha,Hora,milisegundos", 10**3),
        ("Date,Time,us", 10**6),
    ],
)
def test_a_clock_of_seconds_is_joined_with_the_milliseconds_beside_it(
    tmp_path: Path, header: str, base: int
) -> None:
    path = tmp_path / "log.csv"
    rows = [
        f"2024-05-06,10:00:{k * 37 // 1000:02d},{k * 37 % 1000 * base // 1000},{k % 7}.5"
        for k in range(60)
    ]
    path.write_text("\n".join([f"{header},outlet", *rows]))
    log = read_log(path)
    assert [n.code for n in log.notices] == ["time-joined"]
    np.testing.assert_allclose(log.columns[1].values, 0.037 * np.arange(60), atol=1e-12)
    assert describe(log)["time"]["sample_time"] == pytest.approx(0.037)


def test_milliseconds_that_do_not_belong_to_the_clock_are_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = [f"10:00:{k:02d},{k * 137 % 900},{k % 7}.5" for k in range(60)]
    path.write_text("\n".join(["Time,ms,outlet", *rows]))
    assert not read_log(path).notices
