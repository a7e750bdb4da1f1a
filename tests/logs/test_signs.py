"""Signs between thousands, decimal commas between quotes, and other odd ways to write a row."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fluidact_fit.errors import LogError, UsageError
from fluidact_fit.logs import Log, read_log
from fluidact_fit.logs import table as table_module

NUMBERS = [(0.5 * k, 998.25 + k, 12000.75 + k) for k in range(60)]


def read(folder: Path, lines: list[str], **options: object) -> Log:
    path = folder / "log.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_log(path, **options)


def table(delimiter: str, decimal: str, thousands: str, quote: str = "") -> list[str]:
    swap = str.maketrans({",": thousands, ".": decimal})
    rows = [[f"{quote}{x:,.2f}{quote}".translate(swap) for x in row] for row in NUMBERS]
    return [delimiter.join(row) for row in [["time", "inlet", "outlet"], *rows]]


def require_numbers(log: Log) -> None:
    np.testing.assert_array_equal(np.transpose([c.values for c in log.columns]), NUMBERS)


@pytest.mark.parametrize(
    ("decimal", "thousands"),
    [(",", "."), (",", " "), (",", "\u00a0"), (",", "\u202f"), (".", "'"), (".", "\u2019"),
     (".", ",")],
)  # fmt: skip
@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_both_signs_in_a_cell_tell_which_is_which(
    tmp_path: Path, delimiter: str, decimal: str, thousands: str
) -> None:
    lines = table(delimiter, decimal, thousands)
    require_numbers(read(tmp_path, lines))
    require_numbers(read(tmp_path, lines, thousands=thousands, decimal=decimal))


@pytest.mark.parametrize("written", ["\u00a0", "\u202f", "\u2009", "\u2019"])
def test_a_sign_is_given_however_it_is_written(tmp_path: Path, written: str) -> None:
    lines = [f"{k}.5;1{written}0{k:02d}" for k in range(60)]
    plain = "'" if written == "\u2019" else " "
    for sign in (plain, written):
        assert read(tmp_path, lines, thousands=sign).columns[1].values[-1] == 1059.0


@pytest.mark.parametrize(("decimal", "thousands"), [(".", ","), (",", ".")])
def test_between_quotes_a_comma_does_not_separate(
    tmp_path: Path, decimal: str, thousands: str
) -> None:
    require_numbers(read(tmp_path, table(",", decimal, thousands, '"')))
    lines = table(",", decimal, "", '"')
    require_numbers(read(tmp_path, lines))
    require_numbers(read(tmp_path, lines, delimiter=",", decimal=decimal))


def test_cells_without_a_comma_need_no_quotes(tmp_path: Path) -> None:
    lines = ["time,inlet", *(f'{k},"3,52{k}"' if k % 3 else f"{k},4" for k in range(40))]
    values = read(tmp_path, lines).columns[1].values
    assert values[:2].tolist() == [4.0, 3.521]


def test_thousands_between_quotes_that_may_be_decimals_are_asked_for(tmp_path: Path) -> None:
    lines = ["time,inlet", *(f'{k},"3,5{k:02d}"' for k in range(40))]
    with pytest.raises(LogError, match=r"may be 3\.5.. or 35") as caught:
        read(tmp_path, lines)
    assert "--decimal ',' or --thousands ','" in caught.value.text
    assert read(tmp_path, lines, decimal=",").columns[1].values[-1] == 3.539
    assert read(tmp_path, lines, thousands=",").columns[1].values[-1] == 3539.0


@pytest.mark.parametrize("cell", ["0.5", "12.25"])
def test_a_cell_that_tells_otherwise_leaves_thousands_to_the_user(
    tmp_path: Path, cell: str
) -> None:
    rows = [f"{k},00;1.0{k:02d},50" for k in range(30)]
    log = read(tmp_path, [*rows, f"{cell};1.030,50", *rows])
    assert not np.isfinite(log.columns[1].values).any()
    log = read(tmp_path, [*rows, f"{cell};1.030,50", *rows], thousands=".")
    assert log.columns[1].values[0] == 1000.5
    assert log.columns[0].bad == {30: cell}


def test_a_lone_cell_without_decimals_that_may_be_either_is_no_number(tmp_path: Path) -> None:
    """It was read as a thousand times as much as its neighbours."""
    rows = [f"{k},00;632,000;1.0{k:02d},500" for k in range(60)]
    column = read(tmp_path, [*rows, "60,00;632.000;1.060,500", *rows]).columns[1]
    assert column.bad == {60: "632.000"}
    assert np.nanmax(column.values) == 632.0
    whole = [f"{k},00;{k}.632;1.0{k:02d},500" for k in range(1, 60)]
    assert read(tmp_path, whole).columns[1].values[-1] == 59632.0


def test_blanks_between_thousands_do_not_make_commas_decimals(tmp_path: Path) -> None:
    """Rows that had lost a cell were cut at their blanks, and the names above them ignored."""
    rows = [f"0.00{k}0,0.000,3 9{k:02d} 413" for k in range(10, 26)]
    with pytest.raises(LogError, match="line 1: 4 names above rows of 3 cells"):
        read(tmp_path, ["t_s,u_V,x_m,p_Pa", "0.0010,0.000,0.005458,4 050 903", *rows])
    log = read(tmp_path, ["t_s,u_V,p_Pa", *rows], thousands=" ")
    assert log.columns[2].values[0] == 3910413.0


@pytest.mark.parametrize("signs", [{"delimiter": ";", "thousands": ";"}, {"delimiter": ".,"}])
def test_one_sign_for_two_things_is_refused(tmp_path: Path, signs: dict[str, str]) -> None:
    with pytest.raises(UsageError):
        read(tmp_path, table(";", ",", "."), **signs)


@pytest.mark.parametrize("sign", [",", ";", "\t"])
def test_rows_between_one_pair_of_quotes(tmp_path: Path, sign: str) -> None:
    lines = [f'"{line}"' for line in table(sign, ".", "")]
    log = read(tmp_path, lines)
    require_numbers(log)
    assert [c.header for c in log.columns] == ["time", "inlet", "outlet"]


@pytest.mark.parametrize("limit", [0, 10**9])
def test_blanks_behind_a_sign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: int) -> None:
    monkeypatch.setattr(table_module, "FAST_FROM_BYTES", limit)
    lines = [f"{time:.2f};+{inlet:10.2f};-  {outlet:.2f}" for time, inlet, outlet in NUMBERS]
    log = read(tmp_path, ["time;inlet;outlet", *lines])
    assert log.columns[1].values[0] == 998.25
    assert log.columns[2].values[0] == -12000.75


def test_room_that_was_not_filled_is_named(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes("\n".join([*table(";", ".", ""), ""]).encode() + bytes(5000))
    with pytest.raises(LogError, match="ends with 5000 zero bytes") as caught:
        read_log(path)
    assert "tr -d '\\000'" in caught.value.text
    path.write_bytes(b"time;inlet\n1;\0\0\n" + b"2;3\n" * 50)
    with pytest.raises(LogError, match="binary file"):
        read_log(path)


def test_commas_between_columns_and_before_decimals_are_refused(tmp_path: Path) -> None:
    lines = [",".join(f"{x:.2f}" for x in row).replace(".", ",") for row in NUMBERS]
    with pytest.raises(LogError, match=r"6 numbers in a row and 3 names: a comma") as caught:
        read(tmp_path, ["time,inlet,outlet", *lines])
    assert "--skip-rows" in caught.value.text
    assert len(read(tmp_path, ["time,inlet,outlet", *lines], skip_rows=1).columns) == 6


def test_codes_among_the_numbers_make_no_decimal_comma_a_separator(tmp_path: Path) -> None:
    times = ["0.00", "0.01", "1/2", "1/2", "1/2"]  # two columns were read of three
    rows = [f"{time} -0.{480 - 75 * k} 0,00" for k, time in enumerate(times)]
    log = read(tmp_path, ["time torque angle", *rows])
    assert [c.name for c in log.columns] == ["time", "torque", "angle"]
    assert log.columns[1].values.tolist() == [-0.480, -0.405, -0.330, -0.255, -0.180]


def test_a_cell_with_the_separator_of_all_lines_is_two(tmp_path: Path) -> None:
    """A code and a decimal comma: cut at the comma, ``1e;48`` and ``055``, the curve was lost."""
    lines = ["ADC;laser (mm)", *(f"1e;{k},{k:02d}5" for k in range(40))]
    log = read(tmp_path, lines)
    assert [c.header for c in log.columns] == ["ADC", "laser (mm)"]
    np.testing.assert_allclose(log.columns[1].values, [k + (10 * k + 5) / 1e3 for k in range(40)])


def test_commas_at_the_ends_of_cells_separate_them(tmp_path: Path) -> None:
    """With a column of garbage the first number took half of it for its decimals."""
    lines = [f"{19 + 2 * k},1 2, 0.59{k:02d}, 903, 306" for k in range(40)]
    log = read(tmp_path, lines)
    assert log.columns[0].values.tolist() == [19.0 + 2 * k for k in range(40)]
    assert np.isnan(log.columns[1].values).all()


def test_two_numbers_between_blanks_are_not_cut_at_a_comma(tmp_path: Path) -> None:
    log = read(tmp_path, ["ADC laser", *(f"1_000 {48055 - k},000" for k in range(40))], decimal=",")
    assert log.columns[1].values[0] == 48055.0


def test_a_column_tells_for_itself_where_a_log_has_both_decimal_signs(tmp_path: Path) -> None:
    """1.000 ms was read as 1 behind 990, and 50.000 as 50 among 40000 and 60000."""
    rows = [f"{10 * k};3,5{k:02d}2;3.42{k:02d}" for k in range(99)]
    for cell in ("1.000", "50.000"):
        with pytest.raises(LogError, match=f"'{cell}' may be {cell} or"):
            read(tmp_path, [*rows, f"{cell};3,5815;3.4192", *rows[:30]])
    one_damaged = [*(r.replace(",", ".") for r in rows), "0;3,5815;3.4192", "1.000;3.5815;3.4192"]
    assert read(tmp_path, one_damaged).columns[0].values[-1] == 1.0


def test_blanks_between_thousands_separate_no_columns_beside_empty_cells(tmp_path: Path) -> None:
    rows = [f"{10 * k},1 6{k:02d}.3000,{'---' if k > 40 else '2.6978'}" for k in range(10, 46)]
    assert [c.values[0] for c in read(tmp_path, rows).columns] == [100.0, 1610.3, 2.6978]


def test_rows_with_another_separator_are_not_read_in_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """48,055 was read as 55."""
    rows = [f"{k}.5;{k}.25;{k}.125" for k in range(1, 60)]
    for limit in (0, 10**9):  # the quick reader and the careful one
        monkeypatch.setattr(table_module, "FAST_FROM_BYTES", limit)
        columns = read(tmp_path, ["0.5;0.2|5;0.125", *rows]).columns
        assert [c.bad for c in columns] == [{0: "0.5"}, {0: "0.2|5"}, {0: "0.125"}]
    log = read(tmp_path, ["891|48,055", "876|47,030", *(f"{43 - k},5{k:02d}" for k in range(19))])
    assert [c.bad for c in log.columns] == [{0: "891|48", 1: "876|47"}, {0: "055", 1: "030"}]
