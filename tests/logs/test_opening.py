"""Several logs at once: what is said of all of them, and of one by its name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fluidact_fit.errors import UsageError
from fluidact_fit.logs import open_logs


@pytest.fixture
def logs(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / f"{name}.csv" for name in ("a1", "a2", "b1")]
    for path in paths:
        rows = "".join(f"{0.1 * k:.1f},{k}\n" for k in range(20))
        path.write_text("time [s],x [mm]\n" + rows, encoding="utf-8")
    return paths


def test_what_has_no_name_is_left_out_of_every_log(logs: list[Path]) -> None:
    opened = open_logs(logs, exclude_rows="3:5,8")
    assert [log.rows for log in opened] == [16, 16, 16]


def test_parts_of_one_log_by_its_name(logs: list[Path]) -> None:
    opened = open_logs(logs, exclude=["a2.csv:lines=4:6"], exclude_rows="b*:1")
    assert [log.rows for log in opened] == [20, 17, 19]


@pytest.mark.parametrize("given", [{"a*:y": "25 %"}, ["a*:y=25 %"]])
def test_a_constant_of_some_logs(logs: list[Path], given: object) -> None:
    opened = open_logs(logs, set=given, constants={"z": "1"})
    assert [{role: s.start for role, s in log.steps.items()} for log in opened] == [
        {"z": 1.0, "y": 25.0}, {"z": 1.0, "y": 25.0}, {"z": 1.0},
    ]  # fmt: skip


def test_data_are_called_data(logs: list[Path]) -> None:
    table = {"time": np.arange(20.0), "x": np.arange(20.0)}
    (log, other) = open_logs([table, logs[0]], exclude_rows="data:1:4")
    assert (log.rows, other.rows) == (16, 20)


def test_a_name_of_no_log_is_refused(logs: list[Path]) -> None:
    with pytest.raises(UsageError, match=r"c\.csv.*names a log that is not given"):
        open_logs(logs[:1], exclude="c.csv:run=1")
    assert open_logs(logs[:1], beside=logs[1:], exclude="b1.csv:run=1")[0].rows == 20


def test_what_is_not_understood_is_refused_by_its_keyword(logs: list[Path]) -> None:
    with pytest.raises(UsageError, match=r"exclude_rows='x'.*\nExpected \[LOG:\]7"):
        open_logs(logs, exclude_rows="x")


@pytest.mark.parametrize("given", [["a*:y=25 %", "y=2"], ["y=2", "a*:y=25 %"]])
def test_what_is_said_of_some_logs_goes_before_what_is_said_of_all(
    logs: list[Path], given: list[str]
) -> None:
    opened = open_logs(logs, set=given)
    assert [log.steps["y"].start for log in opened] == [25.0, 25.0, 2.0]


def test_a_name_with_brackets_means_itself(logs: list[Path]) -> None:
    named = logs[0].rename(logs[0].with_name("v[1].csv"))
    opened = open_logs([named, logs[1]], exclude_rows="v[1].csv:1:4")
    assert [log.rows for log in opened] == [16, 20]


def test_one_row_may_be_a_number(logs: list[Path]) -> None:
    assert open_logs(logs[0], exclude_rows=7)[0].rows == 19
