"""Logs of one experiment that begin at different instants: merged on their common clock."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import fluidact_fit as ff
from fluidact_fit.errors import LogError

START = datetime(2026, 5, 31, 10, 0, 0)
LATE = 5.0  # s by which the second log begins later
COUNT = 1000


def instants(late: float) -> list[datetime]:
    return [START + timedelta(seconds=late + 0.01 * k) for k in range(COUNT)]


def iso(path: Path, late: float, name: str) -> Path:
    rows = [f"{t.isoformat(timespec='milliseconds')},{k}" for k, t in enumerate(instants(late))]
    path.write_text("\n".join([f"time,{name}", *rows]), encoding="utf-8")
    return path


def time_of_day(path: Path, late: float, name: str) -> Path:
    rows = [f"{t:%H:%M:%S.%f};{k}" for k, t in enumerate(instants(late))]
    path.write_text("\n".join([f"Zeit;{name}", *rows]), encoding="utf-8")
    return path


def split(path: Path, late: float, name: str) -> Path:
    begin = 1_717_171_717_000_000_000 + round(1e9 * late)
    stamps = [divmod(begin + 10_000_000 * k, 10**9) for k in range(COUNT)]
    rows = [f"{s},{n},{k}" for k, (s, n) in enumerate(stamps)]
    path.write_text("\n".join([f"secs,nsecs,{name}", *rows]), encoding="utf-8")
    return path


def nanoseconds(path: Path, late: float, name: str) -> Path:
    begin = 1_717_171_717_000_000_001 + round(1e9 * late)
    rows = [f"{begin + 10_000_000 * k},{k}" for k in range(COUNT)]
    path.write_text("\n".join([f"time [ns],{name}", *rows]), encoding="utf-8")
    return path


def parquet(path: Path, late: float, name: str) -> Path:
    path = path.with_suffix(".parquet")
    pd.DataFrame({"time": instants(late), name: np.arange(COUNT)}).to_parquet(path)
    return path


WRITERS = [iso, time_of_day, split, nanoseconds, parquet]
Writer = Callable[[Path, float, str], Path]


@pytest.mark.parametrize("write", WRITERS, ids=lambda w: w.__name__)
def test_a_log_that_begins_later_stays_later(write: Writer, tmp_path: Path) -> None:
    one = write(tmp_path / "a.csv", 0.0, "inlet")
    other = write(tmp_path / "b.csv", LATE, "outlet")
    log = ff.read_log(f"{one}+{other}")
    columns = {c.name: c.values for c in log.columns}
    both = np.isfinite(columns["inlet"]) & np.isfinite(columns["outlet"])
    assert both.sum() == COUNT - round(100 * LATE)
    assert set(columns["inlet"][both] - columns["outlet"][both]) == {100 * LATE}


@pytest.mark.parametrize("write", [iso, split], ids=lambda w: w.__name__)
def test_logs_of_different_hours_have_nothing_in_common(write: Writer, tmp_path: Path) -> None:
    one = write(tmp_path / "a.csv", 0.0, "inlet")
    other = write(tmp_path / "b.csv", 3600.0, "outlet")
    with pytest.raises(LogError, match="no instant in common"):
        ff.read_log(f"{one}+{other}")


def test_a_clock_and_seconds_from_zero_are_not_laid_over_each_other(tmp_path: Path) -> None:
    one = iso(tmp_path / "a.csv", 0.0, "inlet")
    rows = [f"{0.01 * k:.2f},{k}" for k in range(COUNT)]
    other = tmp_path / "b.csv"
    other.write_text("\n".join(["time (s),outlet", *rows]), encoding="utf-8")
    with pytest.raises(LogError, match="no instant in common"):
        ff.read_log(f"{one}+{other}")
