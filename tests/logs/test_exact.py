"""Stamps with more digits than doubles hold keep their steps, whatever the format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from fluidact_fit.logs import Log, describe, log_of, read_log
from fluidact_fit.logs import table as table_module

START = 1_700_000_000_123_456_789
COUNT = 400


def stamps(step: int) -> list[int]:
    rng = np.random.default_rng(2)
    return [START + step * k + int(rng.integers(0, 1 + step // 50)) for k in range(COUNT)]


def steps(log: Log) -> np.ndarray:
    return np.diff(log.columns[0].stamps)


@pytest.mark.parametrize("fast", [False, True])
@pytest.mark.parametrize("step", [1, 1000, 1_000_000])
@pytest.mark.parametrize("unit", ["t", "t (ns)", "t [us]"])
def test_whole_numbers_in_text(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fast: bool, step: int, unit: str
) -> None:
    monkeypatch.setattr(table_module, "FAST_FROM_BYTES", 0 if fast else 10**9)
    values = stamps(step)
    path = tmp_path / "log.csv"
    path.write_text(f"{unit},p\n" + "".join(f"{v},{k % 7}.5\n" for k, v in enumerate(values)))
    log = read_log(path)
    np.testing.assert_array_equal(steps(log), np.diff(values))
    assert log.columns[0].values[0] == float(values[0])
    if unit != "t [us]":
        assert describe(log)["time"]["sample_time"] == pytest.approx(step * 1e-9, rel=0.03)


@pytest.mark.parametrize("fast", [False, True])
@pytest.mark.parametrize(("decimal", "sign"), [(".", ","), (",", ";")])
def test_seconds_with_nine_decimals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fast: bool, decimal: str, sign: str
) -> None:
    monkeypatch.setattr(table_module, "FAST_FROM_BYTES", 0 if fast else 10**9)
    values = stamps(1000)
    texts = [f"{v // 10**9}{decimal}{v % 10**9:09d}" for v in values]
    path = tmp_path / "log.csv"
    path.write_text(f"t (s){sign}p\n" + "".join(f"{t}{sign}{k % 7}\n" for k, t in enumerate(texts)))
    np.testing.assert_allclose(steps(read_log(path)), np.diff(values) * 1e-9, rtol=1e-12)


def test_an_empty_cell_and_a_large_step_stay_what_they_are(tmp_path: Path) -> None:
    values = stamps(1000)
    rows = [f"{'' if k == 7 else v},{k % 7}.5" for k, v in enumerate(values)]
    path = tmp_path / "log.csv"
    path.write_text("t,p\n" + "\n".join(rows) + "\n")
    log = read_log(path)
    assert log.columns[0].bad == {7: ""}
    np.testing.assert_array_equal(steps(log)[8:], np.diff(values)[8:])


@pytest.mark.parametrize("kind", ["int64", "uint64", "Int64", "object", "parquet", "mat"])
def test_whole_numbers_in_other_formats(tmp_path: Path, kind: str) -> None:
    values = stamps(1000)
    frame = pd.DataFrame({"t": values, "p": np.arange(COUNT) % 7 + 0.5})
    if kind == "parquet":
        frame.to_parquet(tmp_path / "log.parquet")
        log = read_log(tmp_path / "log.parquet")
    elif kind == "mat":
        savemat(tmp_path / "log.mat", {"t": np.array(values), "p": frame["p"].to_numpy()})
        log = read_log(tmp_path / "log.mat")
    else:
        log = log_of({"t": frame["t"].astype(kind), "p": frame["p"]})
    np.testing.assert_array_equal(steps(log), np.diff(values))
    assert describe(log)["time"]["sample_time"] == pytest.approx(1e-6, rel=0.03)


def test_microseconds_are_not_blurred_by_seconds_since_1970() -> None:
    values = [v // 1000 for v in stamps(1_000_000)]
    log = log_of({"t": np.array(values), "p": np.arange(COUNT) % 7 + 0.5})
    time = describe(log)["time"]
    assert (time["unit"], time["start"]) == ("us", 0.0)
    assert time["jitter"] == pytest.approx(np.abs(np.diff(values) - 1000).max() * 1e-6, rel=0.2)


def test_rows_that_are_left_out_take_their_stamps_with_them() -> None:
    values = stamps(1000)
    log = read_log({"t": np.array(values), "p": np.arange(COUNT) % 7}, exclude=["rows=1:5"])
    np.testing.assert_array_equal(steps(log), np.diff(values[5:]))


def test_two_logs_of_one_clock_are_laid_over_each_other(tmp_path: Path) -> None:
    for name, late in (("a", 0), ("b", 50_000)):
        rows = [f"{START + late + 1000 * k},{k % 7}.5" for k in range(COUNT)]
        (tmp_path / f"{name}.csv").write_text(f"time (ns),{name}\n" + "\n".join(rows) + "\n")
    log = read_log(f"{tmp_path}/a.csv+{tmp_path}/b.csv")
    time, a, b = (c.values for c in log.columns)
    assert np.flatnonzero(np.isfinite(b))[0] == 50
    assert np.isfinite(a[:COUNT]).all()
    np.testing.assert_allclose(np.diff(time), 1e-6, rtol=1e-6)


@pytest.mark.parametrize("first", [0, 1_700_000_000, 1_700_000_000_123])
def test_what_doubles_hold_is_as_it_was(first: int) -> None:
    column = log_of({"t": first + np.arange(COUNT), "p": np.arange(COUNT) % 7}).columns[0]
    assert column.exact is None
    assert column.stamps is column.values
