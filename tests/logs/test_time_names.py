"""Columns that are the time by their name, in the languages of loggers, and those that are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.errors import LogError
from fluidact_fit.families import get_family
from fluidact_fit.logs import choose_variant, experiments

T = np.arange(50) * 0.02


def write(folder: Path, header: str, time: np.ndarray = T, more: str = "") -> Path:
    path = folder / "log.csv"
    rows = np.column_stack([time, np.sign(np.sin(9.0 * T)), np.cos(T)])
    names = f"{header},inlet [bar],outlet [bar]" + more
    path.write_text(names + "\n" + "\n".join(",".join(f"{x:.6g}" for x in r) for r in rows) + "\n")
    return path


def instants(path: Path) -> np.ndarray:
    log = ff.read_log(path)
    (run,), _ = experiments(log, choose_variant(log, get_family("line").variants))
    return np.asarray(run.time)


@pytest.mark.parametrize("header", [
    "Zeit", "ZEIT", "zeit_s", "Zeit [s]", "Zeit in s", "Uhrzeit", "Zeitstempel", "timestamp",
    "TimeStamp", "TIME_STAMP", "Time stamp", "tiempo", "Temps (s)", "Tempo", "tout", "Tout",
    "X_Value", "x", "elapsed", "Elapsed Time (s)", "Sekunden", "sec", "datetime", "時間", "时间",
    "ts", "stamp", "simTime", "rowTimes",
])  # fmt: skip
def test_a_name_of_time_is_the_time(tmp_path: Path, header: str) -> None:
    assert instants(write(tmp_path, header)) == pytest.approx(T)


def test_its_unit_is_read_as_of_any_time(tmp_path: Path) -> None:
    assert instants(write(tmp_path, "Zeit [ms]", 1e3 * T)) == pytest.approx(T)


@pytest.mark.parametrize(("header", "time"), [
    ("Zeit [bar]", T), ("temperature", T), ("x", T**2), ("x [mm]", T), ("y", T), ("timer", T),
])  # fmt: skip
def test_what_may_be_something_else_is_asked_for(
    tmp_path: Path, header: str, time: np.ndarray
) -> None:
    with pytest.raises(LogError, match="no column is named 'time'"):
        instants(write(tmp_path, header, time))


def test_two_names_of_time_are_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = "\n".join(f"{t:g},{t:g},{np.sin(t):.4f},0" for t in T)
    path.write_text(f"Zeit,elapsed,inlet [bar],outlet [bar]\n{rows}\n")
    with pytest.raises(LogError, match="no column is named 'time'"):
        instants(path)


def test_time_itself_comes_before_its_other_names(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = "\n".join(f"{9 * t:g},{t:g},{np.sin(t):.4f},0" for t in T)
    path.write_text(f"timestamp,time,inlet [bar],outlet [bar]\n{rows}\n")
    assert instants(path) == pytest.approx(T)
