"""No line vanishes without a word, and both readers read the same numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import fluidact_fit as ff
from fluidact_fit.errors import LogError, UsageError
from fluidact_fit.logs import Log, read_log
from fluidact_fit.logs import table as table_module

LINES = (Path(__file__).parents[2] / "datasets/valve/trial1.csv").read_text().splitlines()


def read(folder: Path, lines: list[str], **options: object) -> Log:
    path = folder / "log.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_log(path, **options)


def without_last_cell(line: str) -> str:
    return line.rpartition(";")[0]


def left_out(log: Log) -> list[int]:
    return [line for line, _ in log.account.left_out]


@pytest.mark.parametrize("damaged", [1, 2, 12, 45, 49])
@pytest.mark.parametrize("headed", [True, False])
def test_one_damaged_line_takes_no_other_with_it(
    tmp_path: Path, damaged: int, headed: bool
) -> None:
    lines = LINES[0 if headed else 1 :]
    if damaged == 1 and headed:
        return
    lines[damaged - 1] = without_last_cell(lines[damaged - 1])
    log = read(tmp_path, lines)
    assert left_out(log) == [damaged]
    assert log.rows == 999
    assert [c.header for c in log.columns] == (LINES[0].split(";") if headed else [""] * 3)
    assert [n.code for n in log.notices] == ["partial-lines"]


@pytest.mark.parametrize("between", [[], LINES[:1], ["", *LINES[:1]], ["started again"]])
@pytest.mark.parametrize("headed", [True, False])
def test_a_short_run_before_a_long_one_is_read(
    tmp_path: Path, between: list[str], headed: bool
) -> None:
    lines = [*LINES[0 if headed else 1 : 51], *between, *LINES[1:400]]
    if LINES[0] in between and not headed:
        return  # a header below the first rows is none
    log = read(tmp_path, lines)
    assert log.rows == 50 + 399
    assert log.account.total_lines == len(lines)
    assert len(left_out(log)) == sum(1 for line in between if line)


def test_every_line_is_accounted_for(tmp_path: Path) -> None:
    lines = ["recorded today", "", *LINES[:30], "", "", *LINES[30:60], "0,6;1", *LINES[60:900]]
    account = read(tmp_path, lines).account
    assert account.header_lines == 3
    assert account.blank_lines == 2
    assert account.left_out == ((65, "2 fields"),)
    assert account.data_rows == 899
    assert account.total_lines == len(lines) == 3 + 2 + 1 + 899


ROWS = range(40)


@pytest.mark.parametrize(
    ("cells", "sign"),
    [
        ([f"{i};3,5{i:02d}" for i in ROWS], ","),
        ([f"{i};4.0{i:02d}" for i in ROWS], "."),
        ([f"{i}\t4 0{i:02d}" for i in ROWS], " "),
        ([f"{i}\t4\u00a00{i:02d}" for i in ROWS], "\u00a0"),
    ],
)
def test_thousands_or_decimals_are_asked_for(tmp_path: Path, cells: list[str], sign: str) -> None:
    with pytest.raises(LogError) as caught:
        read(tmp_path, cells)
    assert "--thousands" in caught.value.text
    values = read(tmp_path, cells, thousands=sign).columns[1].values
    assert values.max() > 3000.0
    if sign in ",.":
        values = read(tmp_path, cells, decimal=sign).columns[1].values
        assert values.max() < 5.0


def test_more_cells_that_tell_otherwise_are_not_overruled(tmp_path: Path) -> None:
    """Thousands grouped by points, decimal commas, and a few lines with decimal points."""
    cells = [f"1.{100 + i};48055,0{i:02d}" for i in range(60)]
    cells[30:33] = ["0.5;48055.000"] * 3
    with pytest.raises(LogError, match=r"may be 1\.1.. or 11"):
        read(tmp_path, cells)


@pytest.mark.parametrize(
    "cells",
    [
        [f"{i},4.0{i:02d}" for i in ROWS],  # commas separate: the point is a decimal point
        [f"0,{i:02d};3,5{i:02d}" for i in ROWS],  # one column tells for all
        [f"{i};0.5{i:02d}" for i in ROWS],
    ],
)
def test_one_cell_tells_for_the_whole_log(tmp_path: Path, cells: list[str]) -> None:
    assert read(tmp_path, cells).columns[1].values.max() < 5.0


def test_a_point_among_decimal_commas_is_no_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cells = [f"0,{i:02d};{'1.012' if i == 5 else '1,5'}" for i in ROWS]
    for limit in (0, 10**9):
        monkeypatch.setattr(table_module, "FAST_FROM_BYTES", limit)
        column = read(tmp_path, cells).columns[1]
        assert column.bad == {5: "1.012"}
        assert np.isnan(column.values[5])


@pytest.mark.parametrize("limit", [0, 10**9])
def test_one_separator_too_many_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: int
) -> None:
    """Rows that end with a separator: one of the last may be missing, none may be too many."""
    monkeypatch.setattr(table_module, "FAST_FROM_BYTES", limit)
    rows = [f"{i}.25\t{i % 7}.5\t" for i in range(400)]
    rows[3] = "3.25\t\t3.5\t"
    assert left_out(read(tmp_path, rows)) == [4]


@pytest.mark.parametrize(
    "lines",
    [
        ["0.1\t5\t7", "garbled;", *(f"{i}.2\t5.1\t{i}" for i in range(300))],
        ["0,1\t5,0\t7,5", *(f"{i}.2\t5.1\t{i}" for i in range(300))],
        ["a\tb", "1.5\t2.5", *(f"{i}.2\t5.1\t{i}" for i in range(300))],
    ],
)
def test_a_first_row_is_one_of_the_table_whatever_stands_below(
    tmp_path: Path, lines: list[str]
) -> None:
    log = read(tmp_path, lines)
    account = log.account
    text = sum(line[0].isalpha() for line in lines[:1])
    assert account.header_lines == text
    assert account.data_rows + len(account.left_out) == len(lines) - text


ROWS_OF_THREE = [f"{i}.2\t5.1\t{i}" for i in range(300)]


@pytest.mark.parametrize(
    ("above", "named", "header"),
    [
        (["1 2.5 3", "4 5.5 6", "started again", "a\tb\tc"], [1, 2], "abc"),
        (["1\t2\t3", "a\tb\tc"], [1], "abc"),  # numbers of the columns
        (["Recorder", "1.5\t2\t3", "7\tx\t5", "started again"], [2, 3], ""),
        (["a,b,c", "0.1,5,3", "1.1\t5\t3", "a,b,c"], [2, 3], ""),
        (["Recorder", "0.5\t7\tx\ty\t5"], [2], ""),
        (["Recorder 3.1", "Rate\t100\tHz", "Gain 1.5 2.5 V", "2020-01-02", "a\tb\tc"], [], "abc"),
    ],
)
def test_what_looks_like_a_row_above_the_table_is_named(
    tmp_path: Path, above: list[str], named: list[int], header: str
) -> None:
    log = read(tmp_path, [*above, *ROWS_OF_THREE])
    assert log.account.left_out == tuple((line, "above the table") for line in named)
    assert log.account.header_lines == len(above) - len(named)
    assert log.rows == 300
    assert "".join(c.header for c in log.columns) == header
    assert [n.code for n in log.notices] == ["rows-above-table"] * bool(named)
    if named and header:
        assert not read(tmp_path, [*above, *ROWS_OF_THREE], header_row=len(above)).notices


def test_dates_far_above_a_short_log_are_no_rows(tmp_path: Path) -> None:
    date = "Date: 2020-01-02 10:11:12"
    lines = [date, "Serial\t4711", date, "Recorder 3.1", "21,5 C", "# a comment", "Rate;100;Hz"]
    lines += ["Recorder 3.1", date, "Recorder 3.1", "# a comment", "Rate;100;Hz", "key,value", date]
    log = read(tmp_path, [*lines, *(f"0.0{k} 0.00 1.4{k}" for k in range(6))])
    assert log.lines.tolist()[-6:] == [15, 16, 17, 18, 19, 20]
    assert log.columns[2].values[-1] == 1.45


@pytest.mark.parametrize("line", ["7.5\t4", "7.5\tx", "7.5\tx\ty", "7\t8\t9\tx", "x\ty\t9"])
def test_a_damaged_line_below_the_header_is_no_header(tmp_path: Path, line: str) -> None:
    log = read(tmp_path, ["a\tb\tc", line, *ROWS_OF_THREE])
    assert "".join(c.header for c in log.columns) == "abc"
    assert log.account.header_lines == 1
    assert 2 in {*left_out(log), *log.lines.tolist()}


SEMICOLONS = [f"{i}.25;{700 + i}.5" for i in range(6)]


@pytest.mark.parametrize(
    ("lines", "named"),
    [
        (["a;b", '"0.0"; "24.5"', '"1.0"; "24.6"', *(f'"{i}.0", "25.5"' for i in range(2, 6))],
         [2, 3]),
        (["a,b (mm)", "891,48055.0", "861,10x7", *SEMICOLONS], [2, 3]),
        (["A. N.", "0.00\t-inf\t3.6", *(f"0,0{i}\t-inf\t3,6{i}" for i in range(1, 9))], [2]),
        (["a b c", "0.0 3270.0 10.25", "nan", *(f"{i}.0;32{i}.0;10.5" for i in range(9))], [2, 3]),
        (["10x7\t 4.766e+00\t", *(f" 3.{i}e+00\t 4.7{i}e+00\t" for i in range(5))], [1]),
        (["ms;rpm;%", "0.000;0;0x1A", "40.000;0;0x1A", *(f"{k}0,00;0;0x1A" for k in range(9))],
         [2, 3]),
        (["a;b;c;d", "5; 636,0; 1,290;'1'", "cleared",
          *(f"{i}; 6{i},5; 1,3; 4,6" for i in range(9))], [2]),
    ],
)  # fmt: skip
def test_damaged_rows_of_another_form_are_named(
    tmp_path: Path, lines: list[str], named: list[int]
) -> None:
    """As fresh seeds of the attack on the reader found them."""
    log = read(tmp_path, lines)
    assert set(named) <= {*left_out(log), *log.lines.tolist()}
    assert log.account.header_lines + len(log.account.left_out) + log.rows == len(lines)


@pytest.mark.parametrize(
    ("lines", "last"),
    [
        (["a b c", " 0,00 4000,00 3618,2000\t", " 0,01 4000,00 3623,0000\t",
          "  0,02 4000,00 3645,0000  \t"], [0.02, 4000.0, 3645.0]),
        (["a,b,c,d", "10x7,0.000,0.005380,4\u00a0016\u00a0174",
          "10x7,0.000,0.005496,4\u00a0016\u00a0175"], [np.nan, 0.0, 0.005496, np.nan]),
    ],
)  # fmt: skip
def test_what_separates_few_damaged_rows(
    tmp_path: Path, lines: list[str], last: list[float]
) -> None:
    """A comma within numbers, or a tab behind each row, is taken for no separator."""
    log = read(tmp_path, lines)
    row = log.lines.tolist().index(len(lines)) if len(lines) in log.lines else -1
    np.testing.assert_array_equal([c.values[row] for c in log.columns], last)


@pytest.mark.parametrize(
    "lines",
    [
        ["a,b,c", "0.1,5,3", *ROWS_OF_THREE[:4]],
        ["a;b;c", "0,00;-480,5;0,25", "0,01\t-405,5\t0,25", "0,02;-324,5;0,25",
         "0,03;-246,5;0,25;"],
    ],
)  # fmt: skip
def test_a_log_in_two_forms_is_refused(tmp_path: Path, lines: list[str]) -> None:
    with pytest.raises(LogError, match=r"line [23]: \d fields? where the table has"):
        read(tmp_path, lines)


@pytest.mark.parametrize(
    "change",
    [
        {3: "3.25\t3.5\tnan"},  # text behind the last separator
        {0: "0.25\t0.5\t1.25\t1.5\t", 5: "5.25\t", 6: "6.25\t"},
        {0: "\ufeff0.25\t5.5\t"},
        {0: "0.25\t0.5\t7.5\t", 5: "5.25\t"},
    ],
)
@pytest.mark.parametrize("header", [[], ["a\tb\t"]])
def test_what_the_quick_reader_may_not_pass_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: dict[int, str], header: list[str]
) -> None:
    rows = [f"{i}.25\t{i % 7}.5\t" for i in range(400)]
    for row, text in change.items():
        rows[row] = text
    logs = []
    for limit in (0, 10**9):
        monkeypatch.setattr(table_module, "FAST_FROM_BYTES", limit)
        logs.append(read(tmp_path, [*header, *rows]))
    quick, careful = logs
    assert quick.account == careful.account
    for a, b in zip(quick.columns, careful.columns):
        np.testing.assert_array_equal(a.values, b.values)
        assert a.bad == b.bad


def test_header_and_rows_as_they_are_said_to_be(tmp_path: Path) -> None:
    body = [f"{i};4.{i};3" for i in ROWS]
    log = read(tmp_path, ["1;2;3", "4;5;6", "a;b;c", *body], header_row=3)
    assert [c.header for c in log.columns] == ["a", "b", "c"]
    assert (log.rows, log.account.header_lines) == (40, 3)
    log = read(tmp_path, ["1;2;3", "4;5;6", *body], skip_rows=2)
    assert (log.rows, log.account.header_lines) == (40, 2)
    assert [c.header for c in log.columns] == ["", "", ""]


@pytest.mark.parametrize(
    "options",
    [{"decimal": ";"}, {"thousands": "x"}, {"decimal": ",", "thousands": ","}, {"skip_rows": -1}],
)
def test_impossible_signs_are_refused(tmp_path: Path, options: dict[str, object]) -> None:
    with pytest.raises(UsageError):
        read(tmp_path, LINES, **options)


CELL = st.sampled_from(["1.012", "3,502", "0,5", "-2", "4 004", "1e5", "nan", "", "x", "1.5", "7"])


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    changes=st.lists(st.tuples(st.integers(0, 79), st.integers(0, 2), CELL), max_size=6),
    removed=st.lists(st.integers(0, 79), max_size=3),
    delimiter=st.sampled_from([";", "\t", ",", " "]),
    decimal=st.sampled_from([".", ","]),
    blank=st.booleans(),
)
def test_both_readers_read_the_same(
    tmp_path_factory: pytest.TempPathFactory,
    changes: list[tuple[int, int, str]],
    removed: list[int],
    delimiter: str,
    decimal: str,
    blank: bool,
) -> None:
    rows = [[f"{0.01 * i:.2f}", f"{i % 7}.25", f"{(i * i) % 5}"] for i in range(80)]
    if delimiter != decimal:
        rows = [[c.replace(".", decimal) for c in row] for row in rows]
    for row, column, text in changes:
        rows[row][column] = text
    lines = [delimiter.join(row) for k, row in enumerate(rows) if k not in removed]
    lines = ["a;b;c".replace(";", delimiter), *lines, *([""] if blank else [])]
    path = tmp_path_factory.mktemp("logs") / "log.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    found: list[Log | str] = []
    for limit in (0, 10**9):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(table_module, "FAST_FROM_BYTES", limit)
            try:
                found.append(read_log(path))
            except LogError as error:
                found.append(error.text)
    quick, careful = found
    if isinstance(quick, str) or isinstance(careful, str):
        assert quick == careful
        return
    assert quick.account == careful.account
    np.testing.assert_array_equal(quick.lines, careful.lines)
    for a, b in zip(quick.columns, careful.columns):
        np.testing.assert_array_equal(a.values, b.values)
        assert a.bad == b.bad


def test_rows_of_which_half_are_numbers_are_named(tmp_path: Path) -> None:
    log = read(tmp_path, ["a;b", "[s];[m]", *(f"{i}.5;10x7" for i in range(9)), "9.5;3"])
    assert {*left_out(log), *log.lines.tolist()} == {*range(3, 13)}
    assert [n.code for n in log.notices] == ["rows-above-table"]


@pytest.mark.parametrize(
    ("lines", "named"),
    [
        # what is left of a row in between is no text
        (["D,ADC", "83.33,1_000", "82.77,1_000", "1_000", "76.06,1_000", "75.2,1", "74.4,2",
          "74.32,3", "73.9,5", "73.1,6"], [2, 3, 4, 5]),
        (["D,ADC", "83.33,1/2", "   ", "recording resumed at 12:31", "82.77,2", "82.25,62",
          "81.95,106", "81.55,152", "80.85,236", "80.05,314"], [2]),
        (["6.41;4.766", "Z4E75#e.b8b2", *(f"6.41;4.{i}5" for i in range(100, 160))], [1, 2]),
        # a row with a letter in every number is no header
        (["6.41\t4.766", "Y3.41\t4.76{36", *(f"6.41\t4.{i}5" for i in range(100, 160))], [1, 2]),
    ],
)  # fmt: skip
def test_damaged_rows_at_the_top_are_named(
    tmp_path: Path, lines: list[str], named: list[int]
) -> None:
    log = read(tmp_path, lines)
    assert {line for line, _ in log.account.left_out} >= set(named)


@pytest.mark.parametrize(
    ("line", "delimiter"),
    [("0,{k:02d}; 0.0031; 24,98{k:02d}", ";"), ("0,{k:02d} \x1b[31m5 1,{k:02d}", " "),
     ("0,{k:02d}\t0x1A\t24,98{k:02d}", "\t"), ("{k},00;4.000,00; 3,6{k:02d}", ";")],
)  # fmt: skip
def test_a_column_of_another_notation_does_not_cut_the_others(
    tmp_path: Path, line: str, delimiter: str
) -> None:
    """With commas for separators the last number lost its whole part: 9882 instead of 24.9882."""
    log = read(tmp_path, [line.format(k=k) for k in range(30)])
    assert log.dialect.delimiter == delimiter
    assert log.dialect.decimal == ","
    assert len(log.columns) == 3


def test_a_number_with_both_signs_says_which_option_reads_it(tmp_path: Path) -> None:
    """Where another cell of the log tells otherwise."""
    path = tmp_path / "log.csv"
    rows = [f"{k},00;1.0{k:02d},50;3,6;0{'.' if k == 3 else ','}5" for k in range(30)]
    path.write_text("\n".join(["time;command;outlet;other", *rows]) + "\n", encoding="utf-8")
    with pytest.raises(LogError, match=r"give thousands='\.'"):
        ff.fit("valve", path)


@pytest.mark.parametrize("blank", ["\xa0", "\x0c"])
def test_both_readers_cut_at_odd_blanks_alike(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, blank: str
) -> None:
    lines = [f"0.{k:03d} 1.5 2.{k}" for k in range(200)]
    lines[20] = lines[20].replace("1.5", f"1{blank}.5")
    careful = read(tmp_path, lines)
    monkeypatch.setattr(table_module, "FAST_FROM_BYTES", 0)
    quick = read(tmp_path, lines)
    assert quick.rows == careful.rows == 199
    assert left_out(quick) == left_out(careful) == [21]


def test_dates_among_text_are_no_rows_of_a_short_log(tmp_path: Path) -> None:
    preamble = ["Recorder 3.1", "Date: 2020-01-02 10:11:12", "Gain 1.5 of 2.5 V", "-----"] * 5
    rows = [f"{k},00  0,00  1,{k}8" for k in range(5)]
    log = read(tmp_path, [*preamble, "t_[s] i_[A] omega_[rad/s]", *rows])
    assert log.rows == 5
    assert [c.header for c in log.columns] == ["t_[s]", "i_[A]", "omega_[rad/s]"]
    assert left_out(log) == []


TABBED = [f"0,{k:02d}\t2,4{k}\t21,1{k}" for k in range(10, 40)]


@pytest.mark.parametrize(
    ("lines", "named"),
    [
        # another separator from some line on: the rows of one of the two are lost
        ([*(f'"0.{k}","1.5","2.{k}"' for k in range(10, 20)),
          *(f'"0.{k}"\t"1.5"\t"2.{k}"' for k in range(20, 60))], range(1, 11)),
        # signs that no name holds, between two rows
        (["0,00\t2,40\t21,1", 'b,2+\tb%Yc#"e{\tc', *TABBED], [1, 2]),
        (["0,00\t1_000\t21,1", "e4Z\x07\t-,\tc", *TABBED], [1, 2]),
    ],
)  # fmt: skip
def test_rows_that_cannot_be_read_are_named(
    tmp_path: Path, lines: list[str], named: list[int]
) -> None:
    log = read(tmp_path, lines)
    assert log.rows == len(lines) - len(named)
    assert left_out(log) == list(named)
    assert [n.code for n in log.notices] == ["rows-above-table"]


def test_separators_between_quotes_are_no_cells(tmp_path: Path) -> None:
    """Between blanks "0.00","1.48" was five cells, two of which were commas."""
    lines = [f'"0.{k}","0.00","1.{k}"' for k in range(10, 15)]
    lines += [f'"0.{k}"|"0.00"|"1.{k}"' for k in range(15, 19)]
    log = read(tmp_path, ["t,i,w", *lines])
    assert len(log.columns) == 3
    assert log.rows + len(left_out(log)) == 9
    assert set(log.columns[2].values.tolist()) <= {round(1.0 + k / 100.0, 2) for k in range(10, 19)}


def test_a_first_row_in_the_other_notation_is_no_header(tmp_path: Path) -> None:
    """Where a log changes its decimal sign, a first row with a missing cell was taken for names."""
    rows = [["nan", "3.5022", "3.4277"]] + [[f"{k}", f"3.50{k}", f"3.42{k}"] for k in range(10, 40)]
    rows += [[f"{k}", f"1,64{k}", f"2,03{k}"] for k in range(40, 80)]
    log = read(tmp_path, ["\t".join(row) for row in rows])
    assert log.dialect.header_line is None
    assert log.account.data_rows + len(log.account.left_out) == len(rows)


def test_a_second_mark_of_byte_order_is_no_text(tmp_path: Path) -> None:
    """It made names of the first row."""
    path = tmp_path / "log.csv"
    rows = [f"{k}\t{k}.5\t{k}.25" for k in range(20)]
    path.write_bytes(("\ufeff" + "\n".join(rows)).encode("utf-16"))
    log = read_log(path)
    assert log.account.data_rows == 20


def test_integers_too_large_for_a_machine_let_no_other_text_be_a_number(tmp_path: Path) -> None:
    """Python, which reads them in place of pandas, reads ``1_000`` as well."""
    rows = [f"{9 * 10**19 + k};{k}.5" for k in range(40)]
    rows[30] = "1_000;30.5"
    log = read(tmp_path, rows)
    assert log.columns[0].bad == {30: "1_000"}
    assert np.isnan(log.columns[0].values[30])


def test_a_truth_value_beside_a_number_is_no_name(tmp_path: Path) -> None:
    """The first of four rows was taken for names, its number with it."""
    rows = ["   3.41\t4.7636589e+00", "   6.41\t4.8393589e+00", "   6.41\t5.0029789e+00"]
    log = read(tmp_path, ["TRUE\t4.7660989e+00", *rows])
    assert log.rows == 4
    assert log.columns[1].values[0] == 4.7660989
    assert np.isnan(log.columns[0].values[0])


@pytest.mark.parametrize(
    ("lost", "rows"),
    [
        (["t|F|x", "0,00|0,0031|24,5", "10,00\t-0,04\t24,5", "#VALUE!"],
         [f"{20 + 10 * k},00\t0,0{k}5\t24,5" for k in range(30)]),
        (["??\t4,7660989e+00"], [f"??\t4.{k:02d}6e+00" for k in range(30)]),
    ],
)  # fmt: skip
def test_rows_above_the_table_that_lost_their_numbers_are_named(
    tmp_path: Path, lost: list[str], rows: list[str]
) -> None:
    log = read(tmp_path, lost + rows)
    assert log.rows == len(rows)
    named = [k for k, line in enumerate(lost, 1) if not line.startswith("t|")]
    assert left_out(log) == named
    assert any(n.code == "rows-above-table" for n in log.notices)


def test_a_date_in_a_preamble_is_no_row_between_blanks(tmp_path: Path) -> None:
    """Day and time made it one cell wider than the table, which was refused for it."""
    rows = [f"{891000 - 15 * k} {48055 - k},000" for k in range(60)]
    log = read(tmp_path, ["Sample rate;100;Hz", "Date: 2020-01-02 10:11:12", *rows], decimal=",")
    assert log.rows == 60
    assert left_out(log) == []


@pytest.mark.parametrize(
    "lost",
    [
        ["6.41\t\u22125", "3.41\t4.7636589e+00", "6Y4a0Z0.1e+00\t- 4.+393589e+03X"],
        ["6,41\t5,33", "3,41\t4,76", '"4}0c,0"\t8"3\u00e9a,309'],
        ["6,41\t5,33", "3,41\t4,76", "87b\te0-73a"],
    ],
)
def test_a_garbled_row_below_others_is_no_header(tmp_path: Path, lost: list[str]) -> None:
    rows = [f"6.41\t5.{k:02d}60289" for k in range(30)]
    log = read(tmp_path, lost + rows)
    assert log.rows == 30
    assert left_out(log) == [1, 2, 3]


def test_rows_with_a_printed_dash_above_others_are_named(tmp_path: Path) -> None:
    rows = [f"0,0{k:02d}|\u20135|99,9" for k in range(30)]
    log = read(tmp_path, [row.replace("|", ";") for row in rows[:3]] + rows[3:])
    assert log.rows == 27
    assert left_out(log) == [1, 2, 3]


def test_one_number_is_no_table(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no table of numbers"):
        read(tmp_path, ["7"])


def test_a_line_of_signs_below_rows_above_the_table_is_named_with_them(tmp_path: Path) -> None:
    rows = [f"{10 * k}.00, 0.{k:02d}5, 0.00" for k in range(30)]
    preamble = ["Channel 1: range 5.0 V, gain 1.5", "----------", "Recorder 3.1"]
    log = read(tmp_path, [*preamble, *rows[:2], '+}\x07#9e"\t;a6Y.a11Y;\x1b', *rows[3:]])
    assert log.rows == 27
    assert left_out(log) == [4, 5, 6]


@pytest.mark.parametrize("first", ["#VALUE!", "?", "\u00b2"])
def test_rows_above_others_with_more_columns_are_named(tmp_path: Path, first: str) -> None:
    """Where a recording changes its columns nothing of the first part was read or named."""
    early = [f"{first},0.000,0.0055{k:02d},{162964 + k}" for k in range(8)]
    late = [f"{first},2,3,0.000,0.0055{k:02d},{162964 + k}" for k in range(30)]
    log = read(tmp_path, ["t_s,u_valve_V,x_m,pA_Pa", *early, *late])
    assert log.rows == 30
    assert left_out(log) == list(range(2, 10))


COLOURED = "\x1b[31m5"  # what a terminal made of a number


@pytest.mark.parametrize(
    ("rows", "below"),
    [
        ([f"-8.7354,{COLOURED},0.001,1"] * 30, [f"-8.7354|{COLOURED}|0.30{k}|1" for k in range(9)]),
        ([f"0.02,+.5,{COLOURED}"] * 8, ["+.5"] * 6),
    ],
)
def test_rows_with_another_separator_than_those_below_are_named(
    tmp_path: Path, rows: list[str], below: list[str]
) -> None:
    log = read(tmp_path, [*rows, *below])
    assert left_out(log) == list(range(1, len(rows) + 1))
    assert [n.code for n in log.notices if n.code == "rows-above-table"]


def test_a_damaged_first_row_is_no_header(tmp_path: Path) -> None:
    log = read(tmp_path, [f"{COLOURED}\t4.766", "3.41\t4.763", "6.41\t4.839"])
    assert left_out(log) == [1]
    assert log.lines.size == 2


def test_a_garbled_line_below_damaged_rows_is_named_too(tmp_path: Path) -> None:
    rows = [f"{80 - k}.25,{k}2" for k in range(12)]
    log = read(tmp_path, ["D (mm),ADC83.33,0", "82.77,2", "82.25,62", "41EZaX1 b", *rows])
    assert {2, 3, 4} <= set(left_out(log))


def test_blanks_below_the_last_row_do_not_cut_it(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("".join(f"{k}.41\t4.7{k}\t\n" for k in range(9)) + "  ")
    assert read_log(path).lines.size == 9
    assert not read_log(path).notices


@pytest.mark.parametrize(
    "lines",
    [
        # decimal commas that an empty column, or other separators, leave alone
        ["6,41e+00\t4.76e+00\t"] * 3 + ["3,41e+00\t\t"] * 20,
        ["6,41e+00\t4.76e+00\t"] * 2 + ["3,41e+00    4.83e+00"] * 5,
    ],
)
def test_a_decimal_comma_with_an_exponent_is_no_separator(tmp_path: Path, lines: list[str]) -> None:
    log = read(tmp_path, lines)
    values = np.concatenate([c.values for c in log.columns])
    assert not {6.0, 3.0} & set(values[np.isfinite(values)])


def test_words_between_a_preamble_and_four_rows_are_no_damaged_row(tmp_path: Path) -> None:
    rows = [f"0,0{k}  4000,00  36{k}8,2000" for k in range(4)]
    log = read(tmp_path, ["Operator  N. N.", "", "Pr\u00fcfstand 3, 21,5 \u00b0C", *rows])
    assert log.lines.tolist() == [4, 5, 6, 7]


@pytest.mark.parametrize(
    "rows",
    [
        [f"{i}.25;{'' if i % 3 else i};{i % 7}.5" for i in range(400)],
        [f"{i}.25;;{i % 7}.5" for i in range(400)],
        [f"  {i}.25 \t{i % 7}.5   {i * i}e-3 \t " for i in range(400)],
        ["", *(f"{i}.25;{i % 7}.5;{i}" for i in range(400))],
        [f"{i}.25;{i % 7}.5;{'' if i == 5 else 'nan' if i == 9 else i}" for i in range(400)],
    ],
)
def test_large_tables_are_read_as_small_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows: list[str]
) -> None:
    logs = []
    for limit in (0, 10**9):
        monkeypatch.setattr(table_module, "FAST_FROM_BYTES", limit)
        logs.append(read(tmp_path, rows))
    fast, careful = logs
    np.testing.assert_array_equal(fast.lines, careful.lines)
    for one, other in zip(fast.columns, careful.columns, strict=True):
        np.testing.assert_array_equal(one.values, other.values)
        assert (one.bad, one.sparse) == (other.bad, other.sparse)
