"""Excel workbooks: cells as they are, dates with all digits, one sheet with a table."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable
from datetime import datetime, time, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import fluidact_fit as ff
from fluidact_fit.errors import LogError
from fluidact_fit.logs import Log, read_log

openpyxl = pytest.importorskip("openpyxl")


def save(folder: Path, *fill: Callable[[Any], object]) -> Path:
    """A workbook with a sheet for every function that fills one."""
    book = openpyxl.Workbook()
    book.remove(book.active)
    for number, function in enumerate(fill, start=1):
        function(book.create_sheet(f"S{number}"))
    path = folder / "log.xlsx"
    book.save(path)
    return path


def rows(*lines: list[Any]) -> Callable[[Any], None]:
    def fill(sheet: Any) -> None:
        for line in lines:
            sheet.append(line)

    return fill


TABLE = rows(["t (ms)", "p (bar)", "q"], *([10 * k, 0.1 * k, k % 3] for k in range(40)))


def test_a_table(tmp_path: Path) -> None:
    log = read_log(save(tmp_path, TABLE))
    assert log.dialect.name == "Excel workbook"
    assert [c.header for c in log.columns] == ["t (ms)", "p (bar)", "q"]
    assert [c.unit for c in log.columns] == ["ms", "bar", None]
    assert log.columns[1].values == pytest.approx(0.1 * np.arange(40))
    assert (log.rows, log.lines[0], log.account.header_lines) == (40, 2, 1)


def test_preamble_units_empty_cells_and_statistics(tmp_path: Path) -> None:
    head = [["Rig", "B"], [], [None, "t", "p", "comment"], [None, "ms", "bar", None]]
    body = [[None, k, None if k == 5 else 0.1 * k, "x" if k == 9 else None] for k in range(40)]
    log = read_log(save(tmp_path, rows(*head, *body, [None, "Mean", 3.0])))
    assert [c.header for c in log.columns] == ["", "t", "p", "comment"]
    assert [c.unit for c in log.columns][1:3] == ["ms", "bar"]
    assert log.columns[2].bad == {5: ""}
    assert log.columns[3].bad[9] == "x"
    assert log.account.left_out == ((45, "statistics"),)
    assert log.account.total_lines == 45


@pytest.mark.parametrize("step", [timedelta(seconds=1), timedelta(microseconds=250)])
def test_dates_keep_their_digits(tmp_path: Path, step: timedelta) -> None:
    """A double holds a date of today to 0.6 us."""
    begin = datetime(2024, 5, 1, 23, 59, 58)
    path = save(tmp_path, rows(["Zeit", "p"], *([begin + k * step, 0.1 * k] for k in range(40))))
    column = read_log(path).columns[0]
    assert column.clock
    expected = step.total_seconds() * np.arange(40)
    np.testing.assert_allclose(column.values, expected, atol=3e-6)


@pytest.mark.parametrize("kind", ["time", "duration"])
def test_times_of_day_and_durations(tmp_path: Path, kind: str) -> None:
    cells = [time(10, 0, k) if kind == "time" else timedelta(seconds=k) for k in range(40)]
    log = read_log(save(tmp_path, rows(["time", "p"], *([c, 1.5] for c in cells))))
    assert log.columns[0].values.tolist() == [float(k) for k in range(40)]


def test_formulas_count_with_what_was_computed(tmp_path: Path) -> None:
    path = save(tmp_path, rows(["t", "p"], *([k, f"=A{k + 2}*2"] for k in range(40))))
    bad = read_log(path).columns[1].bad
    assert bad[0] == "=A2*2"
    assert len(bad) == 40
    computed = _changed(
        path, "xl/worksheets/sheet1.xml", lambda xml: re.sub(r"<v\s*/>|<v></v>", "<v>7.5</v>", xml)
    )
    assert read_log(computed).columns[1].values.tolist() == [7.5] * 40


def test_truth_values_and_errors_are_no_numbers(tmp_path: Path) -> None:
    body = [[k, 0.5 * k] for k in range(40)]
    body[3][1], body[4][1], body[5][1] = True, "#DIV/0!", "n/a"
    column = read_log(save(tmp_path, rows(["t", "p"], *body))).columns[1]
    assert column.bad == {3: "true", 4: "#DIV/0!", 5: "n/a"}


def test_the_one_sheet_with_a_table_is_taken(tmp_path: Path) -> None:
    def hidden(sheet: Any) -> None:
        TABLE(sheet)
        sheet.sheet_state = "hidden"

    path = save(tmp_path, rows(["made by", "B"], ["on", "Monday"]), TABLE, hidden)
    log = read_log(path)
    assert log.rows == 40
    (notice,) = log.notices
    assert "'S2' was read" in notice.message
    assert "'S1', 'S3 (hidden)'" in notice.message


@pytest.mark.parametrize(
    ("fill", "told"),
    [
        ((TABLE, TABLE), "2 sheets hold a table: 'S1', 'S2'"),
        ((rows(),), "no sheet holds anything"),
        ((rows(["only"], ["words"]),), "no table of numbers"),
        ((rows(["t", "p"], *([k] * 5000 for k in range(3))),), "too many rows or columns"),
    ],
)
def test_no_table_or_several_are_refused(tmp_path: Path, fill: Any, told: str) -> None:
    with pytest.raises(LogError) as caught:
        read_log(save(tmp_path, *fill))
    assert told in caught.value.text


def test_rows_that_the_user_names(tmp_path: Path) -> None:
    path = save(tmp_path, rows(["t", "p", "q"], *([k, k % 3, 9] for k in range(20))), )  # fmt: skip
    assert [c.header for c in read_log(path, skip_rows=1).columns] == [""] * 3
    with pytest.raises(LogError, match="do not apply to a workbook"):
        read_log(path, delimiter=";")


def _changed(path: Path, member: str, change: Callable[[str], str]) -> Path:
    """A workbook with one of its parts written otherwise."""
    out = path.with_name("changed.xlsx")
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new:
        for name in old.namelist():
            text = old.read(name).decode()
            new.writestr(name, change(text) if name == member else text)
    return out


SHEET = "xl/worksheets/sheet1.xml"


def _bomb(xml: str) -> str:
    return xml.replace("</sheetData>", "</sheetData>" + " " * 300_000_000)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (_bomb, "MB"),
        (lambda xml: '<!DOCTYPE x [<!ENTITY a "b">]>' + xml, "entities"),
        (lambda xml: xml.replace('r="5"', 'r="9999999"'), "too many rows"),
        (lambda xml: xml[: len(xml) // 2], "damaged"),
        (lambda xml: xml.replace('r="A5"', 'r="ZZZZ5"'), "damaged"),
        (lambda xml: xml.replace("<v>", "<v>x"), "damaged"),
    ],
)
def test_forged_workbooks_are_refused(
    tmp_path: Path, change: Callable[[str], str], told: str
) -> None:
    path = _changed(save(tmp_path, TABLE), SHEET, change)
    with pytest.raises(LogError) as caught:
        read_log(path)
    assert told in caught.value.text


@pytest.mark.parametrize(
    ("member", "more", "told"),
    [
        ("[Content_Types].xml", " " * 300_000_000, "MB"),
        ("docProps/core.xml", '<!DOCTYPE x [<!ENTITY a "b">]>', "entities"),
    ],
)
def test_parts_beside_the_sheets_are_bounded_too(
    tmp_path: Path, member: str, more: str, told: str
) -> None:
    """The package that reads workbooks opens them first; only those below 'xl' were counted."""
    path = _changed(save(tmp_path, TABLE), member, lambda xml: more + xml)
    with pytest.raises(LogError) as caught:
        read_log(path)
    assert told in caught.value.text


@pytest.mark.parametrize("how", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_parts_that_are_unpacked_without_a_limit_are_refused(tmp_path: Path, how: int) -> None:
    path = tmp_path / "rare.xlsx"
    with (
        zipfile.ZipFile(save(tmp_path, TABLE)) as old,
        zipfile.ZipFile(path, "w", how) as new,
    ):
        for name in old.namelist():
            new.writestr(name, old.read(name))
    with pytest.raises(LogError, match="packed in a way that is not read"):
        read_log(path)


def test_dimensions_are_not_believed(tmp_path: Path) -> None:
    path = _changed(
        save(tmp_path, TABLE), SHEET,
        lambda xml: re.sub(r'<dimension ref="[^"]*"', '<dimension ref="A1:XFD1048576"', xml),
    )  # fmt: skip
    assert (read_log(path).rows, len(read_log(path).columns)) == (40, 3)


@pytest.mark.parametrize("seed", range(20))
def test_damaged_bytes_never_end_in_another_error(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    raw = bytearray(save(tmp_path, TABLE).read_bytes())
    for place in rng.integers(0, len(raw), 8):
        raw[place] = rng.integers(0, 256)
    path = tmp_path / "damaged.xlsx"
    path.write_bytes(raw[: rng.integers(len(raw) // 2, len(raw))] if seed % 2 else raw)
    try:
        log: Log | None = read_log(path)
    except LogError:
        log = None
    assert log is None or log.rows <= 41


def test_it_is_fitted_as_the_table_is(tmp_path: Path) -> None:
    source = Path(__file__).parents[2] / "datasets/line/trial1.csv"
    path = tmp_path / "trial.xlsx"
    pd.read_csv(source).to_excel(path, index=False)
    columns = {"inlet": "p_valve (bar)", "outlet": "p_chamber (bar)"}
    found = ff.fit("line", [read_log(path, columns=columns)])
    plain = ff.fit("line", [read_log(source, columns=columns)])
    for name, value in plain.parameters.items():
        assert found.parameters[name].value == pytest.approx(value.value, rel=1e-9)


def test_without_the_library_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import fluidact_fit.logs.workbook as workbook

    path = save(tmp_path, TABLE)

    def absent(name: str) -> Any:
        raise ImportError(name)

    monkeypatch.setattr(workbook, "import_module", absent)
    with pytest.raises(LogError, match=r"pip install 'fluidact-fit\[excel\]'"):
        read_log(path)


def test_a_sheet_of_words_is_refused_without_options_that_nobody_gave(tmp_path: Path) -> None:
    """'with --decimal '.' and --delimiter' was said of every workbook without numbers."""
    book = openpyxl.Workbook()
    for row in [["time [s]", "p [bar]"], *([f"'{k}", "high"] for k in range(30))]:
        book.active.append(row)
    book.save(tmp_path / "log.xlsx")
    with pytest.raises(LogError, match=r"no table of numbers was found\.") as caught:
        read_log(tmp_path / "log.xlsx")
    assert "--" not in caught.value.text
