"""Text of LabChart: blocks of samples below what is said of their channels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fluidact_fit.errors import LogError
from fluidact_fit.logs import Log, describe, read_log


def block(
    *,
    start: float = 0.0,
    count: int = 50,
    interval: str = "0.001 s",
    ranges: str = "10.000 V\t2.000 bar",
    times: bool = True,
    comment: str = "",
) -> list[str]:
    head = [
        f"Interval=\t{interval}",
        "ExcelDateTime=\t4.4562621527777775e+04\t1/1/2022 14:55:00.000000",
        "TimeFormat=\tStartOfBlock",
        "DateFormat=\t",
        "ChannelTitle=\tForce\tFeed pressure",
        f"Range=\t{ranges}",
    ]
    rows = [
        (f"{start + 0.001 * k:.3f}\t" if times else "") + f"{k % 7}.5\t{k}.25" for k in range(count)
    ]
    if comment:
        rows[3] += f"\t{comment}"
    return head + rows


def read(folder: Path, lines: list[str], **options: object) -> Log:
    path = folder / "export.txt"
    path.write_text("\r\n".join(lines) + "\r\n", encoding="utf-8")
    log = read_log(path, **options)
    account = log.account
    assert (
        account.total_lines
        == len(lines)
        == (account.header_lines + account.data_rows + account.blank_lines + len(account.left_out))
    )
    return log


@pytest.mark.parametrize("times", [True, False])
@pytest.mark.parametrize("decimal", [".", ","])
def test_a_block(tmp_path: Path, times: bool, decimal: str) -> None:
    lines = [line.replace(".", decimal) for line in block(times=times)]
    log = read(tmp_path, lines)
    assert log.dialect.name == "LabChart"
    assert [c.header for c in log.columns] == ["time", "Force", "Feed pressure"]
    assert [c.unit for c in log.columns] == ["s", "V", "bar"]
    np.testing.assert_allclose(log.columns[0].values, 0.001 * np.arange(50), atol=1e-12)
    assert log.columns[2].values.tolist() == [k + 0.25 for k in range(50)]
    assert not any(c.bad for c in log.columns)


@pytest.mark.parametrize("times", [True, False])
def test_blocks_are_runs(tmp_path: Path, times: bool) -> None:
    log = read(tmp_path, [*block(times=times), *block(times=times, count=30)])
    assert describe(log)["time"]["runs"] == 2
    assert [line for line, _ in log.account.left_out] == list(range(57, 63))
    assert log.rows == 80


@pytest.mark.parametrize("comment", ["#* valve opened", "#1 12,5 bar; see page 3"])
def test_comments_beside_samples_are_named(tmp_path: Path, comment: str) -> None:
    log = read(tmp_path, block(comment=comment))
    assert log.rows == 50
    assert [n.code for n in log.notices] == ["comments-left-out"]
    assert "line 10" in log.notices[0].message


def test_dates_and_times_of_day(tmp_path: Path) -> None:
    head = [line for line in block(interval="0.5 s", count=0) if not line.startswith("DateF")]
    rows = [f"14:55:{k:02d}.500\t1/25/2022\t{k}.5\t{k}.25" for k in range(40)]
    log = read(tmp_path, [*head[:3], "DateFormat=\tM/d/yyyy", *head[3:], *rows])
    assert log.columns[0].clock
    assert log.columns[0].values[-1] == 39.0
    assert [c.header for c in log.columns] == ["time", "date", "Force", "Feed pressure"]


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (block() + block(ranges="10.000 V\t2.000 mbar"), "other channels or other units"),
        (block(interval="1 s"), "times 0.001 apart"),
        (block(interval="soon", times=False), "'Interval=' is 'soon'"),
        ([line for line in block() if "Title" not in line], "without 'ChannelTitle='"),
        (block(count=0), "without 'ChannelTitle=', or without samples"),
        ([line + "\t1\t2" * (k > 5) for k, line in enumerate(block())], "5 cells"),
    ],
)
def test_what_does_not_add_up_is_refused(tmp_path: Path, lines: list[str], told: str) -> None:
    with pytest.raises(LogError) as caught:
        read(tmp_path, lines)
    assert told in caught.value.text
