"""What is said of cells and lines that are no numbers, and of numbers that were not measured."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.errors import LogError, NotIdentifiedError
from fluidact_fit.logs import Log, describe, read_log
from fluidact_fit.logs import table as table_module

TIME = 0.01 * np.arange(400)
INLET = 3.0 + np.sin(7.0 * TIME) + (TIME > 1.0)
ROWS = [f"{t:.2f},{u:.5f},{0.9 * u:.5f}" for t, u in zip(TIME, INLET)]
NAMES = "time [s],inlet [bar],outlet [bar]"


def write(folder: Path, lines: list[str]) -> Path:
    path = folder / "log.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def with_inlet(cells: dict[int, str]) -> list[str]:
    rows = list(ROWS)
    for row, cell in cells.items():
        time, _, outlet = rows[row].split(",")
        rows[row] = f"{time},{cell},{outlet}"
    return [NAMES, *rows]


@pytest.mark.parametrize(
    ("cells", "options"),
    [
        (range(100, 103), ["lines=102:104"]),
        ([100, 102, 103], ["lines=102", "lines=104:105"]),
    ],
)
def test_several_cells_are_left_out_by_an_option(
    tmp_path: Path, cells: list[int], options: list[str]
) -> None:
    path = write(tmp_path, with_inlet(dict.fromkeys(cells, "OL")))
    with pytest.raises(LogError) as caught:
        ff.fit("line", path)
    assert "--invalid=drop to leave such rows out" in caught.value.text
    assert "remove the line" not in caught.value.text
    assert read_log(path, exclude=options).rows == 397


@pytest.mark.parametrize("sign", [",", "'"])
@pytest.mark.parametrize("role", ["time", "inlet"])
def test_thousands_are_to_be_named(tmp_path: Path, sign: str, role: str) -> None:
    counts = [f"{100 * k:,}".replace(",", sign) for k in range(len(ROWS))]
    cells = [row.split(",") for row in ROWS]
    for row, count in zip(cells, counts):
        row[("time", "inlet").index(role)] = f'"{count}"'
    names = NAMES.replace("[s]", "[ms]") if role == "time" else NAMES
    path = write(tmp_path, [names, *map(",".join, cells)])
    for invalid in (None, "drop"):
        with pytest.raises(LogError, match="stands between thousands") as caught:
            ff.fit("line", path, invalid=invalid)
        assert f"--thousands '{sign}'" in caught.value.text or f'"{sign}"' in caught.value.text
    column = read_log(path, thousands=sign).columns[("time", "inlet").index(role)]
    assert column.values[-1] == 100.0 * (len(ROWS) - 1)


@pytest.mark.parametrize("given", [{"decimal": ","}, {"delimiter": ";"}, {"thousands": "."}])
def test_a_sign_that_does_not_suit_the_file_is_named(tmp_path: Path, given: dict[str, Any]) -> None:
    (option, sign), *_ = given.items()
    with pytest.raises(LogError) as caught:
        read_log(write(tmp_path, [NAMES, *ROWS]), **given)
    assert f"no table of numbers was found with --{option} '{sign}'." in caught.value.text
    assert f"Leave --{option} out" in caught.value.text


def test_a_column_of_text_is_to_be_replaced(tmp_path: Path) -> None:
    path = write(tmp_path, with_inlet(dict.fromkeys(range(300), "OL")))
    with pytest.raises(LogError, match="with a column of numbers") as caught:
        ff.fit("line", path)
    assert "--exclude" not in caught.value.text


@pytest.mark.parametrize(
    "line", ["End of data", "400 records written", "\x1a", "# stopped by hand"]
)
@pytest.mark.parametrize("rows", [30, 400])
@pytest.mark.parametrize("limit", [0, 10**9])
def test_words_at_the_end_are_no_row_that_was_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str, rows: int, limit: int
) -> None:
    monkeypatch.setattr(table_module, "FAST_FROM_BYTES", limit)
    log = read_log(write(tmp_path, [NAMES, *ROWS[:rows], line]))
    (notice,) = log.notices
    assert notice.code == "partial-lines"
    assert f"1 line of text left out (line {rows + 2})" in notice.message
    assert log.account.left_out == ((rows + 2, "text"),)


def test_comments_are_told_from_partly_written_lines(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, [NAMES, *ROWS[:200], "# gain set to 2", "1.5,3", *ROWS[200:]]))
    partial, text = (notice.message for notice in log.notices)
    assert "1 line with the wrong number of fields left out (line 203; partly written" in partial
    assert "1 line of text left out (line 202)" in text
    assert log.account.left_out == ((202, "text"), (203, "2 fields"))


def test_many_lines_of_text_between_rows_are_still_refused(tmp_path: Path) -> None:
    lines = [line for row in ROWS[:40] for line in (row, "a remark")]
    with pytest.raises(LogError, match="1 field where the table has 3 columns"):
        read_log(write(tmp_path, [NAMES, *lines]))


def placeholders(log: Log) -> list[str]:
    notices = describe(log)["notices"]
    return [n["message"] for n in notices if n["code"] == "placeholder-values"]


@pytest.mark.parametrize("value", ["-999", "9999.999", "65535", "-32768", "1e6"])
def test_values_that_stand_for_none_are_named(tmp_path: Path, value: str) -> None:
    path = write(tmp_path, with_inlet(dict.fromkeys(range(200, 203), value)))
    (message,) = placeholders(read_log(path))
    assert "--exclude lines=202:204" in message
    with pytest.raises(NotIdentifiedError) as caught:
        ff.fit("line", path)
    assert message in caught.value.text
    assert not placeholders(read_log(path, exclude=["lines=202:204"]))


@pytest.mark.parametrize(
    "cells",
    [
        {},
        {200: "-999"},  # one alone may be a spike
        dict.fromkeys(range(200, 203), "9.5"),  # not far enough
        dict.fromkeys(range(200, 240), "-999"),  # too many
        {row: f"{-999 - row}" for row in range(200, 203)},  # not the same
        {row: "50" if 200 <= row < 203 else "0" for row in range(400)},  # a command
    ],
)
def test_other_values_are_not(tmp_path: Path, cells: dict[int, str]) -> None:
    assert not placeholders(read_log(write(tmp_path, with_inlet(cells))))


def in_turns(often: int) -> list[str]:
    rows = [NAMES]
    for k, (t, u) in enumerate(zip(TIME, INLET)):
        rows.append(f"{t:.4f},{u:.5f},")
        rows += [f"{t + 0.003:.4f},,{0.9 * u:.5f}"] if k % often == 0 else []
    return rows


@pytest.mark.parametrize("often", [1, 5])
@pytest.mark.parametrize("limit", [0, 10**9])
def test_cells_that_are_filled_in_turns_are_of_different_rasters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, often: int, limit: int
) -> None:
    monkeypatch.setattr(table_module, "FAST_FROM_BYTES", limit)
    path = write(tmp_path, in_turns(often))
    assert [c.sparse for c in read_log(path).columns] == [False, True, True]
    # the outlet is the inlet of 3 ms earlier
    found = ff.fit("line", path, fixed={"time_constant": 1e-4}).parameters
    assert found["gain"].value == pytest.approx(0.9, rel=0.02)
    assert found["dead_time"].value == pytest.approx(0.003, abs=0.001)


@pytest.mark.parametrize("cells", [{100: ""}, {**dict.fromkeys(range(100, 250), ""), 7: "OL"}])
def test_cells_that_are_empty_once_or_among_text_are_refused(
    tmp_path: Path, cells: dict[int, str]
) -> None:
    path = write(tmp_path, with_inlet(cells))
    assert not any(c.sparse for c in read_log(path).columns)
    with pytest.raises(LogError, match=r"is empty|holds 'OL'"):
        ff.fit("line", path)


def test_without_time_there_are_no_rasters(tmp_path: Path) -> None:
    lines = [f"{k if k % 2 else ''},{0.5 * k}" for k in range(60)]
    with pytest.raises(LogError, match="column 'reading' is empty"):
        ff.fit("potentiometer", write(tmp_path, ["reading,reference [mm]", *lines]))


def test_a_run_in_which_a_column_was_not_sampled_is_refused(tmp_path: Path) -> None:
    second = [f"{t:.4f},,{0.9 * u:.5f}" for t, u in zip(TIME, INLET)]
    path = write(tmp_path, [*in_turns(1), *second])
    with pytest.raises(LogError, match="column 'inlet \\[bar\\]' is empty"):
        ff.fit("line", path)
