"""A logger that starts again in the same file, with other columns."""

from __future__ import annotations

from pathlib import Path

import pytest

from fluidact_fit.errors import LogError
from fluidact_fit.logs import Log, read_log
from fluidact_fit.logs import table as table_module

FIRST = ["Time [s],inlet [bar],outlet [bar]", *(f"0.{k},3.5{k},3.3{k}" for k in range(10, 70))]
WIDER = ["Time [s],oil [degC],inlet [bar],outlet [bar]", *(f"1.{k},40,3,2.{k}" for k in range(70))]


def read(folder: Path, lines: list[str], **options: object) -> Log:
    path = folder / "log.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_log(path, **options)


@pytest.mark.parametrize("more", [10, 70])
def test_columns_that_change_are_refused(tmp_path: Path, more: int) -> None:
    lines = [*FIRST, *WIDER[: 1 + more]]
    with pytest.raises(LogError) as caught:
        read(tmp_path, lines)
    assert "line 62: the columns change: " in caught.value.text
    assert "--header-row 62" in caught.value.text
    below = read(tmp_path, lines, header_row=62)
    assert below.rows == more
    assert [c.name for c in below.columns] == ["Time", "oil", "inlet", "outlet"]
    assert read(tmp_path, lines, skip_rows=61).rows == more


SECOND = [
    ("Time [s],inlet [psi],outlet [psi]", "column #2 is 'inlet [psi]', above it is 'inlet [bar]'"),
    ("Time [s],outlet [bar],inlet [bar]", "column #2 is 'outlet [bar]', above it is 'inlet [bar]'"),
    ("Time [ms],inlet [bar],outlet [bar]", "column #1 is 'Time [ms]', above it is 'Time [s]'"),
]


@pytest.mark.parametrize(("second", "told"), SECOND)
@pytest.mark.parametrize("limit", [0, 10**9])
@pytest.mark.parametrize("exclude", [(), ("lines=62",)])
def test_a_second_header_that_differs_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, second: str, told: str, limit: int,
    exclude: tuple[str, ...],
) -> None:  # fmt: skip
    """Without the line, what stands below it would be read as what stands above."""
    monkeypatch.setattr(table_module, "FAST_FROM_BYTES", limit)
    lines = [*FIRST, second, *FIRST[1:]]
    with pytest.raises(LogError) as caught:
        read(tmp_path, lines, exclude=exclude)
    assert "line 62: a second header that differs" in caught.value.text
    assert told in caught.value.text
    assert read(tmp_path, lines, header_row=62).rows == 60


def test_other_units_in_a_row_of_their_own_are_refused(tmp_path: Path) -> None:
    lines = ["Time;inlet", "s;bar", *(f"{k};3.{k}" for k in range(30))]
    again = read(tmp_path, [*lines, *lines])
    assert again.rows == 60
    with pytest.raises(LogError, match="column #2 is 'psi', above it is 'bar'"):
        read(tmp_path, [*lines, lines[0], "s;psi", *lines[2:]])


@pytest.mark.parametrize("line", ["OL,OL,OL", "recording,stopped,now", "nan,nan,nan", ",,"])
def test_words_between_rows_are_no_header(tmp_path: Path, line: str) -> None:
    assert read(tmp_path, [*FIRST, line, *FIRST[1:]]).rows == 121


def test_lines_above_the_data_are_not_counted_twice(tmp_path: Path) -> None:
    """Counts of a potentiometer in hexadecimal: some rows look damaged, and are rows."""
    rows = ["37B;48.055", "36C;47.030", "35D;46.030", "34B;44.731", "337;43.500"]
    rows += [f"{k};{k}.5" for k in range(9)]
    log = read(tmp_path, ["reading;reference [mm]", *rows])
    account = log.account
    assert (account.header_lines, account.data_rows) == (1, len(rows))
    assert not account.left_out


LONG = [f"{k},{k}.5,{k}.25" for k in range(400)]


@pytest.mark.parametrize(
    ("first", "second", "told"),
    [
        (["t,p,q"], ["", "zeit,druck,weg"], "a second header"),
        (["t,p,q"], ["", "f,amplitude,phase"], "a second header"),
        (["t,p,q"], ["Zeit,a,b"], "a second header"),
        ([], ["t,p,q"], "names of the columns below the first rows"),
        (["Channel 1", "t,p,q"], ["Channel 2", "t,p,q"], "it is 'Channel 1'."),
        (["Channel: far", "t,p,q"], ["Channel: near", "t,p,q"], "it is 'Channel: far'."),
        (["Name,far,", "t,p,q"], ["", "Name,near,", "t,p,q"], "a second block"),
        (["# sensor: far", "t,p,q"], ["# sensor: near", "t,p,q"], "a second block"),
        (["Messstelle = far", "t,p,q"], ["Messstelle = near", "t,p,q"], "a second block"),
        (["t,p,q"], ["Kanal 2", "t,p,q"], "a second block"),
        (["[p_far]"], ["[p_near]"], "a second block"),
        (["# GVL.p_far"], ["# GVL.p_near"], "a second block"),
        (["p_far,,"], ["p_near,,"], "a second header"),
        (["Unit: bar", "t,p,q"], ["Unit: mbar", "t,p,q"], "a second block"),
        (["t,p,q"], ["", "x,y,z"], "a second header"),
    ],
)
def test_a_block_that_does_not_go_on_is_refused(
    tmp_path: Path, first: list[str], second: list[str], told: str
) -> None:
    lines = [*first, *LONG, *second, *LONG]
    with pytest.raises(LogError) as caught:
        read(tmp_path, lines)
    assert told in caught.value.text
    assert f"line {len(first) + 401 + (not second[0])}" in caught.value.text


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (["Run 1", "t,p,q"], ["Run 2", "t,p,q"]),
        (["Run: 1", "t,p,q"], ["", "Run: 2", "t,p,q"]),
        (["Start: Mon 3 Feb 2020", "t,p,q"], ["Start: Tue 4 Mar 2020", "t,p,q"]),
        (["Logger ABC", "t,p,q"], ["Logger ABC", "t,p,q"]),
        (["Recording started", "t,p,q"], ["Recording stopped"]),
        (["t,p,q"], ["", "", "t,p,q"]),
        (["t,p,q"], ["# cable of the sensor changed"]),
    ],
)
def test_another_run_goes_on(tmp_path: Path, first: list[str], second: list[str]) -> None:
    log = read(tmp_path, [*first, *LONG, *second, *LONG])
    assert log.rows == 800


def test_names_of_fewer_columns_above_a_row_are_refused(tmp_path: Path) -> None:
    lines = ["t,p,q", *LONG, "", "t,p", "1,2", "2,3", ""]
    with pytest.raises(LogError, match="line 403: the columns change: 2 columns from here on"):
        read(tmp_path, lines)


@pytest.mark.parametrize("head", [["f,amplitude"], []])
def test_a_small_table_of_another_width_below_is_refused(tmp_path: Path, head: list[str]) -> None:
    lines = ["t,p,q", *LONG, "", *head, "1,2", "2,3", "3,4", "4,5"]
    with pytest.raises(LogError, match="line 403: the columns change: 2 columns from here on"):
        read(tmp_path, lines)


def test_words_in_the_first_column_begin_no_block(tmp_path: Path) -> None:
    rows = [f"{('sensor1', 'sensor2')[k % 2]},{k},{k}.5" for k in range(40)]
    assert read(tmp_path, ["name,t,p", *rows]).rows == 40
