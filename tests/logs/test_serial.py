"""Captures of a serial line: clocks before the lines, names before the values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fluidact_fit.errors import LogError
from fluidact_fit.logs import Log, describe, read_log


def read(folder: Path, lines: list[str], **options: object) -> Log:
    path = folder / "capture.txt"
    path.write_text("\r\n".join(lines) + "\r\n", encoding="utf-8")
    log = read_log(path, **options)
    account = log.account
    assert account.total_lines == len(lines)
    assert account.total_lines == (
        account.header_lines + account.data_rows + account.blank_lines + len(account.left_out)
    )
    describe(log)
    return log


def arrows(values: list[str], start: int = 0) -> list[str]:
    return [
        f"12:{k // 60:02}:{k % 60:02}.250 -> {text}" for k, text in enumerate(values, start=start)
    ]


@pytest.mark.parametrize(
    "form", ["{k},{k}.5", "{k}, {k}.5", "{k};{k}.5", "{k}\t{k}.5", "{k} {k}.5"]
)
@pytest.mark.parametrize("header", ["", "count", "count,p"])
def test_the_clock_is_the_time_where_there_is_no_other(
    tmp_path: Path, form: str, header: str
) -> None:
    lines = [form.format(k=k) for k in range(100)]
    names = ["", ""]
    if header == "count,p":
        sign = next((s for s in ",;\t" if s in form), " ")
        lines = [header.replace(",", sign), *lines]
        names = ["count", "p"]
    elif header:
        lines = ["7.5", *lines[1:]]  # the first line is partial
    log = read(tmp_path, arrows(lines))
    assert log.dialect.name == "serial capture"
    assert [c.header for c in log.columns] == ["time", *names]
    first = 1 if header == "count" else 0
    assert log.columns[0].values.tolist() == list(range(100 - first))
    assert log.columns[2].values[-1] == 99.5
    assert len(log.account.left_out) == first


def test_a_time_of_the_sketch_comes_before_the_clock(tmp_path: Path) -> None:
    lines = ["t_ms,p", *(f"{20 * k},{k}.5" for k in range(100))]
    log = read(tmp_path, arrows(lines))
    assert [c.header for c in log.columns] == ["clock", "t_ms", "p"]
    assert [c.unit for c in log.columns] == ["s", "ms", None]


@pytest.mark.parametrize("arrow", [False, True])
@pytest.mark.parametrize(
    "form",
    [
        "t_ms:{k},p:{k}.5",
        "t_ms:{k} p:{k}.5",
        "t_ms:{k}\tp:{k}.5",
        "t_ms: {k}, p: {k}.5",
        "t_ms = {k}; p = {k}.5",
        "t_ms:{k},p:{k}.5,",
    ],
)
def test_names_before_the_values(tmp_path: Path, form: str, arrow: bool) -> None:
    lines = [form.format(k=20 * k) for k in range(100)]
    lines[0] = lines[0][5:]  # partial
    log = read(tmp_path, arrows(lines) if arrow else lines)
    assert [c.header for c in log.columns] == ["clock"] * arrow + ["t_ms", "p"]
    assert [c.unit for c in log.columns] == ["s"] * arrow + ["ms", None]
    assert log.columns[-1].values.tolist() == [20 * k + 0.5 for k in range(1, 100)]
    assert log.account.left_out == ((1, "broken"),)


def test_units_behind_the_values(tmp_path: Path) -> None:
    log = read(tmp_path, [f"t: {k} ms, p: {k}.5 bar, T: 20.{k} °C" for k in range(60)])
    assert [c.name for c in log.columns] == ["t", "p", "T"]
    assert [c.unit for c in log.columns] == ["ms", "bar", "°C"]


def test_restarts_and_what_the_sketch_says(tmp_path: Path) -> None:
    run = [f"t_ms:{20 * k},p:{k}.5" for k in range(60)]
    log = read(tmp_path, ["pr", "sensor ready", *run, "ets Jul 29 2019", "sensor ready", *run])
    assert log.rows == 120
    assert describe(log)["time"]["runs"] == 2
    assert [n for n, _ in log.account.left_out] == [1, 2, 63, 64]
    assert "partial-lines" in [n.code for n in log.notices]


def test_other_names_in_between_are_left_out(tmp_path: Path) -> None:
    lines = [f"t_ms:{20 * k},p:{k}.5" for k in range(60)]
    lines[30] = "error:3,p:1.5"
    log = read(tmp_path, lines)
    assert log.account.left_out == ((31, "broken"),)
    assert np.isfinite(log.columns[0].values).all()


def test_a_terminal_log_of_named_values(tmp_path: Path) -> None:
    mark = "=~=~=~=~=~=~=~=~=~=~=~= PuTTY log 2024.05.01 12:00:00 =~=~=~=~=~=~=~=~=~=~=~="
    run = [f"t_ms:{20 * k},p:{k}.5" for k in range(60)]
    log = read(tmp_path, [mark, *run, mark])
    assert (log.dialect.name, log.rows) == ("PuTTY log", 60)
    assert [c.header for c in log.columns] == ["t_ms", "p"]
    assert log.account.left_out == ((62, "written by the logger itself"),)


PAIRS = {
    "blanks": "t=0.{k} p={k}.5 u=1",
    "semicolons": "t=0.{k};p={k}.5;u=1",
    "tabs": "t=0.{k}\tp={k}.5\tu=1",
    "commas": "t=0.{k}, p={k}.5, u=1",
    "quotes": 't="0.{k}" p="{k}.5" u="1"',
    "around": "t = 0.{k}; p = {k}.5; u = 1",
    "colons": "t: 0.{k}, p: {k}.5, u: 1",
}


@pytest.mark.parametrize("form", PAIRS)
def test_names_before_values(tmp_path: Path, form: str) -> None:
    log = read(tmp_path, [PAIRS[form].format(k=k) for k in range(10, 90)])
    assert [c.header for c in log.columns] == ["t", "p", "u"]
    assert log.columns[1].values.tolist() == [k + 0.5 for k in range(10, 90)]
    assert (log.rows, log.account.left_out) == (80, ())


def test_names_in_another_order_or_missing(tmp_path: Path) -> None:
    """A line is told by its names, not by their places: none of it is lost."""
    parts = [["t=0.{k}", "p={k}.5", "u=1"], ["u=1", "t=0.{k}", "p={k}.5"], ["p={k}.5", "t=0.{k}"]]
    lines = [" ".join(parts[k % 3]).format(k=k) for k in range(10, 90)]
    log = read(tmp_path, lines)
    columns = {c.header: c for c in log.columns}
    assert log.rows == 80
    assert columns["p"].values.tolist() == [k + 0.5 for k in range(10, 90)]
    assert len(columns["u"].bad) == sum(k % 3 == 2 for k in range(10, 90))


def test_words_and_a_time_before_the_names(tmp_path: Path) -> None:
    lines = [
        f'2024-05-01 10:00:{k} level=info state="running in" p={k}.5 e= x=[1]'
        for k in range(10, 60)
    ]
    log = read(tmp_path, lines)
    assert [c.header for c in log.columns] == ["time", "level", "state", "p", "e", "x"]
    assert log.columns[0].values[-1] == 49.0
    assert log.columns[2].bad[0] == "running in"
    assert log.columns[3].values[0] == 10.5


def test_a_name_that_stands_twice_is_no_table(tmp_path: Path) -> None:
    with pytest.raises(LogError):
        read(tmp_path, [f"t=0.{k} p={k}.5 p=1" for k in range(10, 60)])
