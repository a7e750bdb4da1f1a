"""Reading: separators, decimal signs, preambles, headers, encodings, and damaged files."""

from __future__ import annotations

import gzip
import hashlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fluidact_fit.errors import LogError, UsageError
from fluidact_fit.logs import StepInput, describe, read_log
from fluidact_fit.logs import table as table_module

PREAMBLES = [
    [],
    ["Recorded by hand", ""],
    ["Values 1.5 2.5 3.5 7", "  b1 =  2   1.5  1.6E+00  8.9E-02", "Date: 2020-01-02", "", ""] * 12,
    ["# a comment", "# another, with 3 numbers: 1, 2, 3"],
]
HEADERS = [None, ["time [s]", "force (N)", "position_mm"], ["t", "Kraft", "größe"]]
TEXTS = st.floats(-1e6, 1e6, allow_nan=False).map(lambda v: f"{v:.5f}")


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    rows=st.lists(st.tuples(TEXTS, TEXTS, TEXTS), min_size=6, max_size=30),
    cut=st.sampled_from([(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), (" ", ".")]),
    preamble=st.sampled_from(PREAMBLES),
    header=st.sampled_from(HEADERS),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-32", "cp1252"]),
    trailing=st.booleans(),
    ending=st.sampled_from(["\n", "\r\n", "\r"]),
    final=st.booleans(),
    fast=st.booleans(),
)
def test_round_trip(
    tmp_path_factory: pytest.TempPathFactory,
    rows: list[tuple[str, str, str]],
    cut: tuple[str, str],
    preamble: list[str],
    header: list[str] | None,
    encoding: str,
    trailing: bool,
    ending: str,
    final: bool,
    fast: bool,
) -> None:
    delimiter, decimal = cut
    tail = delimiter if trailing else ""
    lines = list(preamble)
    if header is not None:
        lines.append(delimiter.join(header) + tail)
    first = len(lines) + 1
    lines += [delimiter.join(c.replace(".", decimal) for c in row) + tail for row in rows]
    path = tmp_path_factory.mktemp("logs") / "log.csv"
    path.write_bytes((ending.join(lines) + (ending if final else "")).encode(encoding))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(table_module, "FAST_FROM_BYTES", 0 if fast else 10**9)
        log = read_log(path)
    expected = np.array(rows, dtype=float)
    assert log.rows == len(rows)
    assert len(log.columns) == 3
    found = np.column_stack([c.values for c in log.columns])
    np.testing.assert_allclose(found, expected, rtol=1e-14)
    assert log.lines[0] == first
    assert log.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    if header is not None:
        assert [c.header for c in log.columns] == header
        assert log.dialect.header_line == first - 1
    assert not log.notices


def write(tmp_path: Path, text: str | bytes, name: str = "a.csv") -> Path:
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_units_row_below_header(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, "time;speed;torque\nms;rpm;%\n" + "0;1;2\n" * 8))
    assert [c.unit for c in log.columns] == ["ms", "rpm", "%"]
    assert (log.dialect.header_line, log.dialect.units_line) == (1, 2)


def test_quoted_fields_and_text_columns(tmp_path: Path) -> None:
    text = '"time [s]","remark, free","x [m]"\n' + '"0.1","a, b",2.5\n' * 10
    log = read_log(write(tmp_path, text))
    assert [c.header for c in log.columns] == ["time [s]", "remark, free", "x [m]"]
    assert log.columns[2].values[3] == 2.5
    assert log.columns[1].bad[0] == "a, b"


@pytest.mark.parametrize(
    ("sign", "form", "decimal"),
    [
        (",", '="{}"', "."),
        (",", '="{}"', ","),
        (";", '="{}"', ","),
        (",", '"=""{}"""', "."),
        ("\t", '"=""{}"""', ","),
    ],
)
def test_numbers_that_a_spreadsheet_keeps_as_text(
    tmp_path: Path, sign: str, form: str, decimal: str
) -> None:
    """A formula of a text, ="0.5", kept a cell from being read."""
    rows = [(0.01 * k, 2.5 + 0.125 * k) for k in range(60)]
    lines = [("time", "p [bar]"), *((f"{t:.2f}", f"{p:.4f}") for t, p in rows)]
    path = tmp_path / "log.csv"
    cells = [[c if "p" in c else c.replace(".", decimal) for c in line] for line in lines]
    path.write_text("\n".join(sign.join(map(form.format, line)) for line in cells) + "\n")
    log = read_log(path)
    assert [(c.name, c.unit) for c in log.columns] == [("time", None), ("p", "bar")]
    np.testing.assert_allclose(np.column_stack([c.values for c in log.columns]), rows)


def test_commented_and_spaced_headers(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, "# time [s]  force [N]\n" + "0.0 1.0\n" * 5))
    assert [c.header for c in log.columns] == ["time [s]", "force [N]"]


def test_bad_first_row_is_a_row_and_no_header(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, "time,x\n0,abc\n" + "".join(f"{i},2\n" for i in range(1, 9))))
    assert [c.header for c in log.columns] == ["time", "x"]
    assert log.columns[1].bad == {0: "abc"}
    assert log.lines[0] == 2


def test_dates_beside_numbers(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, "stamp,force\n" + "2020-01-01 12:00:00,1.5\n" * 9))
    assert [c.header for c in log.columns] == ["stamp", "force"]
    assert log.rows == 9


def test_tiny_logs(tmp_path: Path) -> None:
    assert read_log(write(tmp_path, "a,b\n1,2\n3,4\n")).rows == 2
    assert read_log(write(tmp_path, "1 2\n3 4\n")).rows == 2
    assert read_log(write(tmp_path, "1\n2\n3\n")).rows == 3


@pytest.mark.parametrize("fast", [False, True])
def test_cut_last_line(tmp_path: Path, fast: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table_module, "FAST_FROM_BYTES", 0 if fast else 10**9)
    body = "a,b,c\n" + "".join(f"{i},1.500,2.500\n" for i in range(50))
    for cut in ("50,1.5", "50,1.500,", "50,1.500,2.5", "50,1.500,-"):
        log = read_log(write(tmp_path, body + cut))
        assert log.rows == 50
        assert [n.code for n in log.notices] == ["cut-last-line"]
        assert "a.csv, line 52" in log.notices[0].message
    assert read_log(write(tmp_path, body + "50,1.500,2.700")).rows == 51


@pytest.mark.parametrize("fast", [False, True])
@pytest.mark.parametrize("bad", ["7,1", "7,1,2,3", "7,1,2,3,4,5,6"])
def test_few_ragged_lines_warn_and_many_stop(
    tmp_path: Path, fast: bool, bad: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table_module, "FAST_FROM_BYTES", 0 if fast else 10**9)
    good = [f"{i},1,2" for i in range(300)]
    few = [*good[:150], bad, *good[150:]]
    log = read_log(write(tmp_path, "a,b,c\n" + "\n".join(few) + "\n"))
    assert log.rows == 300
    assert [n.code for n in log.notices] == ["partial-lines"]
    assert "line 152" in log.notices[0].message
    assert log.lines[150] == 153
    many = [*good[:150], *[bad] * 20, *good[150:]]
    with pytest.raises(LogError, match=r"a\.csv, line 152: .* where the table has 3 columns"):
        read_log(write(tmp_path, "a,b,c\n" + "\n".join(many) + "\n"))


def test_short_and_long_rows_do_not_cancel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table_module, "FAST_FROM_BYTES", 0)
    for first, second in (("7,1", "7,1,2,3"), ("7,1,2,3", "7,1")):
        text = "1,2,3\n" * 150 + f"{first}\n" + "1,2,3\n" * 150 + f"{second}\n" + "1,2,3\n" * 9
        log = read_log(write(tmp_path, text))
        assert log.rows == 309
        assert [n.code for n in log.notices] == ["partial-lines"]


@pytest.mark.parametrize("fast", [False, True])
def test_blank_lines_keep_line_numbers(
    tmp_path: Path, fast: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table_module, "FAST_FROM_BYTES", 0 if fast else 10**9)
    log = read_log(write(tmp_path, "a,b\n" + "1,2\n" * 20 + "\n\n" + "3,x\n" + "3,4\n" * 20))
    assert log.rows == 41
    assert log.lines[20] == 24
    assert log.columns[1].bad == {20: "x"}


@pytest.mark.parametrize("fast", [False, True])
def test_cells_that_are_no_numbers(
    tmp_path: Path, fast: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table_module, "FAST_FROM_BYTES", 0 if fast else 10**9)
    cells = ["10x7", "nan", "inf", "", "1_000", "1e999", "True", "0x10"]
    text = "a,b,c\n" + "1,2,3\n" * 200 + "".join(f"1,{c},3\n" for c in cells) + "1,2,3\n" * 20
    log = read_log(write(tmp_path, text))
    assert list(log.columns[1].bad.values()) == cells
    assert int(np.isnan(log.columns[1].values).sum()) == len(cells)
    assert not np.isnan(log.columns[2].values).any()


def test_missing_in_last_column(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, "a,b\n" + "1,2\n" * 9 + "1,\n" + "1,2\n" * 3))
    assert log.columns[1].bad == {9: ""}
    assert log.rows == 13


REFUSED = {
    "empty": (b"", "is empty"),
    "blank": (b"\n \n\n", "is empty"),
    "prose": (b"Dear reader,\nthis is a letter.\nYours\n" * 5, "no table of numbers"),
    "binary": (bytes(range(256)) * 50, "binary"),
    "control": (b"\x01\x02\x03\x04abc" * 100, "binary"),
    "packed twice": (gzip.compress(gzip.compress(b"1,2\n3,4\n")), "binary"),
    "zip": (b"PK\x03\x04....", "zip"),
    "mat": (b"MATLAB 5.0 MAT-file" + b"\0" * 200, "cannot be read"),
    "wide": (b",".join([b"1"] * 100_000) + b"\n" + b",".join([b"1"] * 100_000), "columns"),
    "header only": (b"time,force\n", "no table of numbers"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_files_that_are_no_logs(tmp_path: Path, kind: str) -> None:
    content, words = REFUSED[kind]
    path = write(tmp_path, content)
    with pytest.raises(LogError) as error:
        read_log(path)
    assert "a.csv" in str(error.value)
    assert words in str(error.value)
    assert error.value.remedy


def test_paths_that_are_no_files(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no such file"):
        read_log(tmp_path / "missing.csv")
    with pytest.raises(LogError, match="folder"):
        read_log(tmp_path)
    with pytest.raises(LogError):
        read_log("with\0zero.csv")


@settings(max_examples=150, deadline=None)
@given(content=st.binary(max_size=400) | st.text(max_size=200).map(str.encode))
def test_anything_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.mktemp("any") / "a.csv"
    path.write_bytes(content)
    try:
        describe(read_log(path))
    except LogError as error:
        assert error.remedy  # noqa: PT017


@pytest.mark.parametrize(
    "arguments",
    [
        {"sample_time": 0.0},
        {"sample_time": float("nan")},
        {"scales": {"force": 0.0}},
        {"window": (2.0, 1.0)},
        {"steps": {"force": StepInput(0.0, float("inf"))}},
        {"holds": {"force": "spline"}},
    ],
)
def test_arguments_are_checked(tmp_path: Path, arguments: dict[str, object]) -> None:
    path = write(tmp_path, "a,b\n" + "1,2\n" * 5)
    with pytest.raises(UsageError):
        read_log(path, **arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(("sign", "decimal"), [(",", "."), (";", ","), ("\t", ".")])
def test_the_quick_reader_reads_what_python_reads(
    tmp_path: Path, sign: str, decimal: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    odd = ["0.1000000000000000055511151231257827", "9007199254740993", "5e-324", "-0.0", "1."]
    odd += ["nan", "-inf", "1e999", "nan(7)", "", "+1.5", " 2.5", "00012", "1E+05"]
    rows = [["0.25", cell, "3.5"] for cell in ["0.3", *odd, *["1.25"] * 200]]
    text = "".join(sign.join(row).replace(".", decimal) + sign + "\n" for row in rows)
    path = write(tmp_path, sign.join("abc") + "\n" + text)
    for some in (text, text.replace(f"{sign}+1{decimal}5", f"{sign}1{decimal}5")):
        path.write_text(sign.join("abc") + "\n" + some, encoding="utf-8")
        found = []
        for limit in (0, 10**9):
            monkeypatch.setattr(table_module, "FAST_FROM_BYTES", limit)
            found.append(read_log(path))
        for quick, careful in zip(found[0].columns, found[1].columns, strict=True):
            assert quick.values.tobytes() == careful.values.tobytes()
            assert quick.bad == careful.bad
        assert found[0].account == found[1].account
