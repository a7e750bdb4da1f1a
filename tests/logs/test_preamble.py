"""What stands above a table: entries that look like rows, several lines of names, a header."""

from __future__ import annotations

from pathlib import Path

import pytest

from fluidact_fit.errors import LogError
from fluidact_fit.logs import Log, read_log


def read(folder: Path, lines: list[str], **options: object) -> Log:
    path = folder / "log.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_log(path, **options)


def headers(log: Log) -> list[str]:
    return [column.header for column in log.columns]


ROWS = [f"0.{k},3.5{k},3.3{k}" for k in range(10, 60)]


def with_sign(sign: str) -> list[str]:
    return [row.replace(",", sign) for row in ROWS]


@pytest.mark.parametrize(
    ("above", "names"),
    [
        # settings of an oscilloscope, of which each line has as many cells as a row
        (["Model,MSO", "", "Horizontal Units,S,", "Horizontal Scale,0.4,", "Sample Interval,0.01,",
          "Record Length,50,", "Gating,0.0% to 100.0%,", "Probe Attenuation,1,1",
          "Vertical Units,V,V", "Vertical Offset,0,0", "Vertical Scale,1,1", "Label,,",
          "TIME,CH1,CH2"], ["TIME", "CH1", "CH2"]),
        # names, and what else is said of the columns, below them
        (["time,inlet,outlet", ",Interp: linear,Interp: linear"], ["time", "inlet", "outlet"]),
        (["time,inlet,outlet", "Step Information: C=1 (Run: 1/2)"], ["time", "inlet", "outlet"]),
        (["time,inlet,outlet", "f8,f4,f4", "s,bar,bar"], ["time", "inlet", "outlet"]),
    ],
)  # fmt: skip
def test_names_below_settings_and_above_remarks(
    tmp_path: Path, above: list[str], names: list[str]
) -> None:
    log = read(tmp_path, [*above, *ROWS])
    assert (log.rows, headers(log)) == (50, names)
    assert log.account.header_lines == len(above)


def test_units_of_repeated_cells_are_kept(tmp_path: Path) -> None:
    rows = [f"{k},7,1,3.{k},2.{k}" for k in range(40)]
    log = read(tmp_path, ["Number,Kind,Place,CH1,CH2", "NO.,KND,PLC,V,V", *rows])
    assert headers(log) == ["Number", "Kind", "Place", "CH1", "CH2"]
    assert [c.unit for c in log.columns] == [None, None, None, "V", "V"]


@pytest.mark.parametrize(
    "above",
    [
        ["# name: data", "# type: matrix", "# rows: 50", "# columns: 3"],
        ["# name: data", "# type: matrix", "# columns: 3"],
    ],
)
def test_entries_in_comments_are_no_rows(tmp_path: Path, above: list[str]) -> None:
    log = read(tmp_path, [*above, *with_sign(" ")])
    assert (log.rows, headers(log)) == (50, ["", "", ""])
    assert not log.account.left_out


@pytest.mark.parametrize(
    ("above", "form"),
    [
        (["| time | inlet | outlet |", "|---|---|---|"], "| {} |"),
        ([" time | inlet | outlet ", "------+-------+-------"], " {} "),
    ],
)
def test_a_printed_table(tmp_path: Path, above: list[str], form: str) -> None:
    log = read(tmp_path, [*above, *map(form.format, with_sign(" | "))])
    assert (log.rows, headers(log)) == (50, ["time", "inlet", "outlet"])
    assert log.columns[2].values[0] == 3.31


def test_entries_right_above_the_rows(tmp_path: Path) -> None:
    """An empty line ends them; what stands above them names them and no columns."""
    above = ['"TraceName","CH1","CH2",', '"BlockSize",50,50,', '"VUnit","V","V",']
    above += ['"HOffset",0.0,0.0,', '"HUnit","s","s",', '"DisplayBlockSize",50,50,', ""]
    rows = [f",3.5{k},3.3{k}," for k in range(10, 60)]
    log = read(tmp_path, [*above, *rows])
    assert (log.rows, headers(log)) == (50, ["", "", ""])
    log = read(tmp_path, [*above, *rows], header_row=1)
    assert (log.rows, headers(log)) == (50, ["TraceName", "CH1", "CH2"])
    assert log.columns[1].unit == "V"


@pytest.mark.parametrize("sign", [" ", ",", "\t"])
def test_names_of_rows_have_no_name_themselves(tmp_path: Path, sign: str) -> None:
    rows = [f'"{k}" {row}'.replace(" ", sign) for k, row in enumerate(with_sign(" "), start=1)]
    log = read(tmp_path, ['"time" "inlet" "outlet"'.replace(" ", sign), *rows])
    assert headers(log) == ["", "time", "inlet", "outlet"]
    assert log.columns[1].values[0] == 0.10


@pytest.mark.parametrize("sign", [",", ";", "\t"])
def test_names_with_line_breaks(tmp_path: Path, sign: str) -> None:
    names = ['"Time\n[s]"', '"inlet\n[bar]"', '"outlet\n[bar]"']
    log = read(tmp_path, ["recorded today", sign.join(names), *with_sign(sign)])
    assert [(c.name, c.unit) for c in log.columns] == [
        ("Time", "s"), ("inlet", "bar"), ("outlet", "bar"),
    ]  # fmt: skip
    account = log.account
    assert (account.total_lines, account.header_lines, account.data_rows) == (55, 5, 50)


NAMES = ["time,inlet,outlet", "Format: f8,f4,f4,f4", "f8,f4,g4", "x,y,z", "s,bar,bar", *ROWS]


@pytest.mark.parametrize(("row", "names"), [(1, "time,inlet,outlet"), (4, "x,y,z")])
def test_the_line_that_is_named_has_the_names(tmp_path: Path, row: int, names: str) -> None:
    log = read(tmp_path, NAMES, header_row=row)
    assert ",".join(headers(log)) == names
    assert [c.unit for c in log.columns] == ["s", "bar", "bar"]
    assert (log.rows, log.account.header_lines) == (50, 5)


def test_the_header_of_a_terminal_is_the_one_that_is_named(tmp_path: Path) -> None:
    mark = "=~=~=~=~=~=~=~=~=~=~=~= PuTTY log 2020.03.04 11:59:57 =~=~=~=~=~=~=~=~=~=~=~="
    log = read(tmp_path, [mark, "time,inlet,outlet", *ROWS], header_row=2)
    assert (log.rows, headers(log)) == (50, ["time", "inlet", "outlet"])


@pytest.mark.parametrize(
    ("row", "reason"),
    [(2, "it has 4 cells where the rows have 3"), (7, "it holds numbers"), (99, "below line 99")],
)
def test_a_line_that_cannot_be_the_header_is_refused(tmp_path: Path, row: int, reason: str) -> None:
    with pytest.raises(LogError, match=reason):
        read(tmp_path, NAMES, header_row=row)


def test_numbers_behind_a_word_are_of_the_preamble(tmp_path: Path) -> None:
    """Start values of a NIST file: five numbers in a line, but named ones."""
    above = [f"  b{k} =   2         1.5        1.67450630E+00  8.79896343E-02" for k in range(5)]
    rows = [f"  {k}.5   {2 * k}.25" for k in range(30)]
    log = read(tmp_path, [*above, "Data:  y               x", *rows])
    assert log.rows == 30
    assert log.account.left_out == ()


@pytest.mark.parametrize("first", [0.0, 1.0])
def test_exponents_of_fortran_are_read_in_the_first_rows(tmp_path: Path, first: float) -> None:
    rows = [f"{first + k:.6E},{0.5 * k:.6E},{-k:.6E}".replace("E", "D") for k in range(50)]
    log = read(tmp_path, ["time [s],inlet [bar],outlet [bar]", *rows])
    assert [c.values[1] for c in log.columns] == [first + 1.0, 0.5, -1.0]


def test_the_minus_sign_of_print_is_a_minus(tmp_path: Path) -> None:
    rows = [f"{k - 20},{0.5 * k:.3f},{-k:.1f}e-2".replace("-", "\u2212") for k in range(50)]
    log = read(tmp_path, ["time,\u2212p,q", *rows])
    assert headers(log) == ["time", "\u2212p", "q"]
    assert [c.values[1] for c in log.columns] == [-19.0, 0.5, -0.01]
    assert not any(c.bad for c in log.columns)
