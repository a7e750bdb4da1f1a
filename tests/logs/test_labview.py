"""LabVIEW measurement files, written after their public description."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fluidact_fit.errors import LogError
from fluidact_fit.logs import Log, describe, read_log

SIGNS = {"Tab": "\t", "Comma": ","}


def block(
    columns: str,
    sign: str,
    decimal: str,
    start: float = 0.0,
    step: float = 0.01,
    names: tuple[str, ...] = ("Voltage", "Druck"),
    dimension: str = "Time",
) -> list[str]:
    """Lines of the block on the channels, and the one with their names."""

    def row(key: str, text: str) -> str:
        return sign.join([key, *[text] * len(names), ""]).replace(".", decimal)

    x = ["X_Value"]
    heads = [h for name in names for h in (*x, name)] if columns == "Multi" else [*x, *names]
    return [
        sign.join(["Channels", str(len(names)), "", ""]),
        row("Samples", "7"),  # a lie
        row("Date", "2024/05/01"),
        row("Time", "12:00:00.1234567890"),
        sign.join(["Y_Unit_Label", "Volts", "bar"][: 1 + len(names)]),
        row("X_Dimension", dimension),
        row("X0", f"{start:.16E}"),
        row("Delta_X", f"{step:.6f}"),
        "***End_of_Header***" + sign * 3,
        sign.join([*heads, "Comment"]),
    ]


def rows(
    columns: str, sign: str, decimal: str, count: int, start: float = 0.0, remark: str = "warm, up"
) -> list[str]:
    out = []
    for k in range(count):
        x = "" if columns == "No" else f"{start + 0.01 * k:.6f}"
        cells = [x, f"{k}.25", x, f"{k}.5"] if columns == "Multi" else [x, f"{k}.25", f"{k}.5"]
        text = sign.join(cells).replace(".", decimal)
        out.append(text + (f'{sign}"{remark}"' if k == 0 and remark else ""))
    return out


def head(columns: str, separator: str, decimal: str) -> list[str]:
    sign = SIGNS[separator]
    keys = {
        "LabVIEW Measurement": "",
        "Writer_Version": "2",
        "Separator": separator,
        "Decimal_Separator": decimal,
        "Multi_Headings": "Yes",
        "X_Columns": columns,
        "Time_Pref": "Relative",
        "Time": "12:00:00,1234567890",
    }
    return [*(sign.join(pair) for pair in keys.items()), "***End_of_Header***" + sign, sign]


def read(folder: Path, lines: list[str]) -> Log:
    path = folder / "a.lvm"
    path.write_text("\n".join(lines) + "\n", encoding="cp1252")
    log = read_log(path)
    account = log.account
    assert account.total_lines == len(lines)
    assert account.total_lines == (
        account.header_lines + account.data_rows + account.blank_lines + len(account.left_out)
    )
    return log


@pytest.mark.parametrize("columns", ["No", "One", "Multi"])
@pytest.mark.parametrize(("separator", "decimal"), [("Tab", "."), ("Tab", ","), ("Comma", ".")])
def test_columns_of_x(tmp_path: Path, columns: str, separator: str, decimal: str) -> None:
    sign = SIGNS[separator]
    lines = [
        *head(columns, separator, decimal),
        *block(columns, sign, decimal),
        *rows(columns, sign, decimal, 50),
    ]
    log = read(tmp_path, lines)
    assert log.dialect.name == "LabVIEW measurement"
    assert [c.header for c in log.columns] == ["time", "Voltage", "Druck"]
    assert [c.unit for c in log.columns] == ["s", "Volts", "bar"]
    np.testing.assert_allclose(log.columns[0].values, 0.01 * np.arange(50), atol=1e-12)
    assert log.columns[2].values.tolist() == [k + 0.5 for k in range(50)]
    assert log.account.left_out == ()
    assert describe(log)["time"]["sample_time"] == pytest.approx(0.01)


def test_the_samples_tell_their_decimal_sign(tmp_path: Path) -> None:
    lines = [*head("One", "Tab", ","), *block("One", "\t", ","), *rows("One", "\t", ".", 50)]
    assert read(tmp_path, lines).columns[1].values[3] == 3.25


@pytest.mark.parametrize("columns", ["No", "One"])
@pytest.mark.parametrize("starts", [(0.0, 0.0), (0.0, 5.0)])
def test_segments_are_runs_where_time_starts_again(
    tmp_path: Path, columns: str, starts: tuple[float, float]
) -> None:
    lines = head(columns, "Tab", ".")
    for start in starts:
        lines += [*block(columns, "\t", ".", start), *rows(columns, "\t", ".", 20, start), ""]
    log = read(tmp_path, lines)
    seen = describe(log)["time"]
    assert seen["runs"] == (2 if starts[1] == 0.0 else 1)
    assert log.columns[0].values[[0, 20]].tolist() == list(starts)
    assert {why for _, why in log.account.left_out} == {"header of a segment"}
    assert len(log.account.left_out) == 10


def test_segments_of_other_channels_are_refused(tmp_path: Path) -> None:
    lines = [*head("No", "Tab", "."), *block("No", "\t", "."), *rows("No", "\t", ".", 20)]
    lines += [*block("No", "\t", ".", names=("Voltage", "Kraft")), *rows("No", "\t", ".", 20)]
    with pytest.raises(LogError, match="segment 2 holds other channels") as caught:
        read(tmp_path, lines)
    assert "Split the file above line 41" in caught.value.text


def test_without_names_it_is_refused(tmp_path: Path) -> None:
    lines = [*head("One", "Tab", "."), *block("One", "\t", ".")[:-1], *rows("One", "\t", ".", 20)]
    with pytest.raises(LogError, match="X_Value"):
        read(tmp_path, lines)


def test_steps_that_were_not_written_are_counted(tmp_path: Path) -> None:
    lines = [
        *head("No", "Tab", "."),
        *block("No", "\t", ".", step=0.0, dimension="Index"),
        *rows("No", "\t", ".", 20),
    ]
    log = read(tmp_path, lines)
    assert (log.columns[0].header, log.columns[0].unit) == ("index", None)
    assert log.columns[0].values[:3].tolist() == [0.0, 1.0, 2.0]


def test_a_cut_line_is_named(tmp_path: Path) -> None:
    lines = [*head("One", "Tab", "."), *block("One", "\t", "."), *rows("One", "\t", ".", 300)]
    lines[100] = lines[100].rpartition("\t")[0]
    assert [n for n, _ in read(tmp_path, lines).account.left_out] == [101]


@pytest.mark.parametrize(
    "units",
    [("V", "bar", "mbar"), ("V", "", "mbar"), ("", "bar", ""), ("", "", "mbar"), ("V", "", "")],
)
@pytest.mark.parametrize("columns", ["No", "One", "Multi"])
@pytest.mark.parametrize("spread", [True, False])
@pytest.mark.parametrize("sign", ["\t", ","])
def test_units_and_starts_stand_above_their_channels(
    tmp_path: Path, units: tuple[str, ...], columns: str, spread: bool, sign: str
) -> None:
    """With a column of X for every channel, the block has an empty cell for each of them."""
    between = sign * (2 if columns == "Multi" and spread else 1)

    def row(key: str, *cells: str) -> str:
        return key + sign + between.join(cells) + sign

    names = ["u", "p", "q"]
    heads = (
        [h for n in names for h in ("X_Value", n)] if columns == "Multi" else ["X_Value", *names]
    )
    lines = [
        *head(columns, "Tab" if sign == "\t" else "Comma", "."),
        row("Channels", "3"),
        row("Samples", *["20"] * 3),
        row("Y_Unit_Label", *units).rstrip(sign),
        row("X_Dimension", *["Time"] * 3),
        row("X0", *["0.5"] * 3),
        row("Delta_X", *["0.01"] * 3),
        "***End_of_Header***",
        sign.join([*heads, "Comment"]),
    ]
    for k in range(20):
        x = "" if columns == "No" else f"{0.5 + 0.01 * k:.4f}"
        cells = [f"{k}.25", f"{k}.5", f"{k}.75"]
        whole = [c for v in cells for c in (x, v)] if columns == "Multi" else [x, *cells]
        lines.append(sign.join(whole))
    log = read(tmp_path, lines)
    assert [c.header for c in log.columns] == ["time", *names]
    assert [c.unit or "" for c in log.columns] == ["s", *units]
    assert log.columns[0].values[[0, 19]].tolist() == pytest.approx([0.5, 0.69])
