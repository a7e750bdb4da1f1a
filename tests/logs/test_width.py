"""Headers with more or fewer names than the rows have cells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fluidact_fit.errors import LogError
from fluidact_fit.logs import Log, read_log
from fluidact_fit.logs import table as table_module

ROWS = [f"{k},{k}.5,{k}.25" for k in range(40)]
NAMES = "t (ms),p (bar),q (bar)"


def read(folder: Path, lines: list[str], **options: object) -> Log:
    path = folder / "log.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_log(path, **options)


@pytest.mark.parametrize("fast", [False, True])
@pytest.mark.parametrize("sign", [",", ";", "\t"])
@pytest.mark.parametrize(
    ("head", "tail"),
    [
        ([f"{NAMES},comment"], ","),
        ([f"{NAMES},comment,"], ",,"),
        ([f"{NAMES},comment,remark"], ",,"),
        ([f"# {NAMES},comment"], ","),
        (['"t (ms)","p (bar)","q (bar)","comment"'], ",\"\""),
        (["t,p,q,comment", "ms,bar,bar,"], ","),
        (["t,p,q,comment", "ms,bar,bar"], ","),
        (["Rig 3,,,", f"{NAMES},comment"], ","),
        ([NAMES], ","),
        ([NAMES], ",,"),
        ([f"{NAMES},,"], ",,"),
        ([f"{NAMES},"], ""),
    ],
)  # fmt: skip
def test_empty_columns_at_the_end(
    tmp_path: Path,
    head: list[str],
    tail: str,
    sign: str,
    fast: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(table_module, "FAST_FROM_BYTES", 0 if fast else 10**9)
    lines = [*head, *(row + tail for row in ROWS)]
    log = read(tmp_path, [line.replace(",", sign) for line in lines])
    assert [c.name for c in log.columns][:3] == ["t", "p", "q"]
    assert [c.unit for c in log.columns][:3] == ["ms", "bar", "bar"]
    assert [c.name for c in log.columns][3:] in ([], ["comment"], ["comment", "remark"])
    assert log.columns[2].values[-1] == 39.25
    assert all(np.isnan(c.values).all() for c in log.columns[3:])
    assert (log.rows, log.account.left_out) == (40, ())


@pytest.mark.parametrize("places", [(7,), (3, 30), (39,)])
def test_a_column_of_few_comments(tmp_path: Path, places: tuple[int, ...]) -> None:
    rows = [f"{row},{'start' if k in places else ''}" for k, row in enumerate(ROWS)]
    log = read(tmp_path, [f"{NAMES},comment", *rows])
    assert (log.rows, log.account.left_out) == (40, ())
    assert [log.columns[3].bad[k] for k in places] == ["start"] * len(places)


@pytest.mark.parametrize("column", [0, 1, 2])
def test_an_empty_column_elsewhere(tmp_path: Path, column: int) -> None:
    names, cells = NAMES.split(","), [row.split(",") for row in ROWS]
    names.insert(column, "spare")
    for row in cells:
        row.insert(column, "")
    log = read(tmp_path, [",".join(names), *map(",".join, cells)])
    assert [c.header for c in log.columns] == names
    assert np.isnan(log.columns[column].values).all()


@pytest.mark.parametrize(
    "head", [f"{NAMES},comment", "t (ms),p (bar)", "t (ms),p, valve (bar),q (bar)"]
)
def test_names_that_do_not_fit_the_cells_are_refused(tmp_path: Path, head: str) -> None:
    rows = [f"{k}.5,{k % 3}.5,{k}.25" for k in range(40)]
    with pytest.raises(LogError, match=r"line 1: \d names above rows of 3 cells"):
        read(tmp_path, [head, *rows])
    log = read(tmp_path, [head, *rows], skip_rows=1)
    assert [c.header for c in log.columns] == [""] * 3


def test_names_of_the_columns_beside_those_of_the_rows(tmp_path: Path) -> None:
    """R writes no name above the names of its rows."""
    log = read(tmp_path, ['"t (ms)","p (bar)"', *(f'"{k + 1}",{k}.5,{k % 3}' for k in range(40))])
    assert [c.name for c in log.columns] == ["", "t", "p"]


@pytest.mark.parametrize("header", ["pos (mm)", "Kraft", '"F [N]"', "力\nNewton"])
def test_one_name_above_decimal_commas_is_asked_about(tmp_path: Path, header: str) -> None:
    """They were read as two columns: the whole parts and the decimals."""
    path = tmp_path / "a.csv"
    rows = "".join(f"{k},{7 * k % 100:02d}\n" for k in range(30))
    path.write_text(f"{header}\n{rows}", encoding="utf-8")
    with pytest.raises(LogError, match="one column or two"):
        read_log(path)
    assert len(read_log(path, decimal=",").columns) == 1


def test_units_that_are_fewer_than_blank_separated_columns_are_refused(tmp_path: Path) -> None:
    """Names and units were left out, and what was in kN taken for N."""
    path = tmp_path / "a.txt"
    rows = "".join(f"08:00:{k / 10:06.3f} {0.1 * k:.2f} {k}.5\n" for k in range(30))
    path.write_text(f"time force x\n  kN mm\n{rows}", encoding="utf-8")
    with pytest.raises(LogError, match="kN, mm"):
        read_log(path)


@pytest.mark.parametrize("head", [[], ["dx = 0,01 s"], ["Rig, Test 3"], ["a,b"]])
def test_decimal_commas_of_a_single_column_are_not_cut(tmp_path: Path, head: list[str]) -> None:
    rows = [f"{'-' if k % 2 else ''}{k / 16:.4f}".replace(".", ",") for k in range(30)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([*head, *rows]))
    with pytest.raises(LogError, match="may be one column or two"):
        read_log(path)
    assert len(read_log(path, decimal=",").columns) == 1
    assert len(read_log(path, delimiter=",").columns) == 2


def test_two_columns_of_whole_numbers_are_two(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join(f"{k},{k * k % 170}" for k in range(30)))
    assert len(read_log(path).columns) == 2


@pytest.mark.parametrize(
    ("head", "sign"),
    [
        (["time(ms);force(kN);pos(mm)"], ","),
        (["time(ms),force(kN),pos(mm)"], "\t"),
        (["time_ms|force_kN|pos_mm"], ","),
        (["Zeit / ms Kraft / kN Weg / mm"], "\t"),
        (["# time(ms)  force(kN)  pos(mm)"], ","),
        (["time ms force kN pos mm"], " "),
        (["# columns: t[ms] F[kN] x[mm]"], " "),
        (["# 1: t [ms]", "# 2: F [kN]", "# 3: x [mm]"], " "),
        (["Spalte 1: t [ms]", "Spalte 2: F [kN]", "Spalte 3: x [mm]"], ";"),
    ],
)
def test_units_of_a_header_that_is_not_read_are_not_dropped(
    tmp_path: Path, head: list[str], sign: str
) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join([*head, *(row.replace(",", sign) for row in ROWS)]))
    with pytest.raises(LogError, match=r"units stand above the first row|names? above rows"):
        read_log(path)
    assert len(read_log(path, skip_rows=len(head)).columns) == 3


@pytest.mark.parametrize(
    "head", [["Supply 200 bar, stroke 300 mm, 50 kN"], ["Rig 3, oil, warm"], ["Test in N and mm"]]
)
def test_a_remark_above_a_table_without_a_header_is_one(tmp_path: Path, head: list[str]) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join([*head, *(row.replace(",", ";") for row in ROWS)]))
    assert len(read_log(path).columns) == 3


def test_a_unit_below_one_of_two_names_between_blanks_is_not_passed_over(tmp_path: Path) -> None:
    """Nobody knows below which name it stands: numbers would be a thousand times too large."""
    rows = [f"{0.01 * k:.2f}  {1.5 * k:.1f}" for k in range(40)]
    with pytest.raises(LogError, match="1 name above rows of 2 cells: 1/1000 mm"):
        read(tmp_path, ['"t" "pos"', '   "1/1000 mm"', *rows])
