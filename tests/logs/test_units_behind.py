"""Units behind the numbers, as multimeters and formatted spreadsheets write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from openpyxl import Workbook

from fluidact_fit.logs import Log, read_log

T = 0.004 * np.arange(60)
U, P = 5.0 * np.sin(9.0 * T), 10.0 + T


def read(folder: Path, lines: list[str]) -> Log:
    path = folder / "log.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_log(path)


@pytest.mark.parametrize("form", ["{:.3f} s;{:.3f} mV;{:.4f} bar", "{:.3f}s,{:.3f}mV,{:.4f}bar",
                                  "{:.3f}\t{:.3f} mV\t{:.4f} bar"])  # fmt: skip
def test_units_behind_numbers_are_those_of_their_columns(tmp_path: Path, form: str) -> None:
    """No table of numbers was found."""
    sign = next(c for c in ";,\t" if c in form)
    log = read(tmp_path, [sign.join(["t", "u", "p"]), *map(form.format, T, U, P)])
    assert [c.name for c in log.columns] == ["t", "u", "p"]
    assert [c.unit for c in log.columns] == ["s" if "s" in form else None, "mV", "bar"]
    np.testing.assert_allclose(log.columns[1].values, np.round(U, 3), rtol=1e-12)


def test_another_unit_of_a_single_cell_is_no_number(tmp_path: Path) -> None:
    """A multimeter changes its range; where that is, no reading is taken for one of the others."""
    cells = [f"{u:.3f} V" for u in U]
    whole = read(tmp_path, ["t,u", *(f"{t:.3f},{c}" for t, c in zip(T, cells))])
    assert not whole.columns[1].bad
    cells[2] = "312.0 mV"  # above the lines that are looked at first
    log = read(tmp_path, ["t,u,p", *(f"{t:.3f},{c},{p:.3f} bar" for t, c, p in zip(T, cells, P))])
    assert log.columns[1].bad == {2: "312.0 mV"}
    assert np.isnan(log.columns[1].values[2])
    np.testing.assert_allclose(log.columns[2].values, np.round(P, 3))


@pytest.mark.parametrize("clock", ["T#{:.0f}ms", "T#1s{:.0f}ms", "{:.0f}"])
def test_units_behind_numbers_beside_durations_of_a_controller(tmp_path: Path, clock: str) -> None:
    """The column of bars was one of words, and T#4ms was T#4."""
    lines = [f"{clock.format(1e3 * t)};{p:.4f} bar" for t, p in zip(T, P)]
    log = read(tmp_path, ["t;p", *lines])
    assert log.columns[1].unit == "bar"
    np.testing.assert_allclose(log.columns[1].values, np.round(P, 4))
    since = log.columns[0].values * (1.0 if "#" in clock else 1e-3)
    np.testing.assert_allclose(since - since[0], T, atol=1e-12)


def test_durations_in_several_units_stay_instants(tmp_path: Path) -> None:
    clock = [f"{1e3 * t:.0f} ms" if t < 0.1 else f"{t:.3f} s" for t in T]
    log = read(tmp_path, ["t;p", *(f"{c};{p:.4f} bar" for c, p in zip(clock, P))])
    assert log.columns[1].unit == "bar"
    np.testing.assert_allclose(log.columns[0].values, T, atol=1e-12)


def test_units_behind_numbers_with_blanks_between_thousands(tmp_path: Path) -> None:
    cells = [f"{1e5 * p:,.1f} Pa".replace(",", " ").replace(".", ",") for p in P]
    log = read(tmp_path, ["t;p", *(f"{t:.3f};{c}".replace(".", ",") for t, c in zip(T, cells))])
    assert log.columns[1].unit == "Pa"
    np.testing.assert_allclose(log.columns[1].values, 1e5 * P, atol=0.06)


@pytest.mark.parametrize("place", [2, 40])
@pytest.mark.parametrize("empty", ["", "NaN", "---"])
def test_a_cell_without_a_number_costs_no_other_its_unit(
    tmp_path: Path, place: int, empty: str
) -> None:
    """One empty cell made words of all columns with units behind their numbers."""
    cells = [f"{p:.4f} bar" for p in P]
    cells[place] = empty
    log = read(tmp_path, ["t,u,p", *(f"{t:.3f},{u:.3f} V,{c}" for t, u, c in zip(T, U, cells))])
    assert [c.unit for c in log.columns] == [None, "V", "bar"]
    assert [c.bad for c in log.columns] == [{}, {}, {place: empty}]
    np.testing.assert_allclose(log.columns[1].values, np.round(U, 3))


def test_a_unit_that_the_header_contradicts_is_not_read(tmp_path: Path) -> None:
    lines = [f"{t:.3f};{p:.3f} mbar" for t, p in zip(T, P)]
    log = read(tmp_path, ["t [s];p [bar]", *lines])
    assert log.columns[1].unit == "bar or mbar"
    log = read(tmp_path, ["t [s];p [mbar]", *lines])
    assert log.columns[1].unit == "mbar"


def test_units_in_number_formats_of_a_workbook(tmp_path: Path) -> None:
    """The cells are shown with them; volts were assumed."""
    book = Workbook()
    sheet = book.active
    sheet.append(["time [s]", "command", "outlet [bar]"])
    for row, cells in enumerate(zip(T, U, P), start=2):
        sheet.append(list(map(float, cells)))
        sheet.cell(row, 2).number_format = '0.00" mV"'
        sheet.cell(row, 3).number_format = '0.0"x"'
    book.save(tmp_path / "log.xlsx")
    log = read_log(tmp_path / "log.xlsx")
    assert [c.unit for c in log.columns] == ["s", "mV", "bar"]
    np.testing.assert_allclose(log.columns[1].values, U, rtol=1e-15)


def test_a_letter_between_blanks_is_a_cell_of_its_own(tmp_path: Path) -> None:
    """It was taken for the unit of the cell before, and the header no longer fitted."""
    log = read(tmp_path, ["t p phase", *(f"{t:.3f} {p:.3f} A" for t, p in zip(T, P))])
    assert [(c.name, c.unit) for c in log.columns] == [("t", None), ("p", None), ("phase", None)]
    np.testing.assert_allclose(log.columns[1].values, np.round(P, 3))
    log = read(tmp_path, ["t p", *(f"{t:.3f} {p:.3f}bar" for t, p in zip(T, P))])
    assert [c.unit for c in log.columns] == [None, "bar"]


@pytest.mark.parametrize("form", ['0.0,"kN"', '0.0,," MN"', '0,.0" kN"', '#,##0.0,"kN"'])
def test_a_number_format_that_shows_thousands_says_no_unit(tmp_path: Path, form: str) -> None:
    """5000 N, shown as 5.0 kN, was read as 5000 kN."""
    book = Workbook()
    sheet = book.active
    sheet.append(["time [s]", "force"])
    for row, (t, u) in enumerate(zip(T, U), start=2):
        sheet.append([float(t), 1e3 * float(u)])
        sheet.cell(row, 2).number_format = form
    book.save(tmp_path / "log.xlsx")
    force = read_log(tmp_path / "log.xlsx").columns[1]
    assert force.unit is None
    np.testing.assert_allclose(force.values, 1e3 * U, rtol=1e-15)
