"""Rows of units, below the names or above them, as oscilloscopes and loggers write them."""

from __future__ import annotations

from pathlib import Path

import pytest

from fluidact_fit.errors import LogError
from fluidact_fit.logs import describe, read_log
from fluidact_fit.logs import table as table_module

THREE = [f"{k};{k}.25;{k}.5" for k in range(40)]


@pytest.mark.parametrize(
    ("above", "names", "units"),
    [
        (["a;b;c", "ms;rpm;%"], "a b c", "ms rpm %"),
        (["a;b;c", "[s];[V];[bar]"], "a b c", "s V bar"),
        (["a;b;c", "(ms);(V);(mA)"], "a b c", "ms V mA"),
        (["a;b;c", "(ms);(V);(mA)", ""], "a b c", "ms V mA"),
        (["a;b;c", "in ms;in V;in mA"], "a b c", "ms V mA"),
        (["a;b;c", "s;V;°C"], "a b c", "s V °C"),
        (["a;b;c", "s;V;barg"], "a b c", "s V barg"),
        (["a;b;c", "s;;V"], "a b c", "s - V"),
        (["a;b;c", "s;V;"], "a b c", "s V -"),
        (["a;b;c", "s;V"], "a b c", "s V -"),
        (["a;b;c", "s;-;V"], "a b c", "s - V"),
        (["a;b;c", ";V;N"], "a b c", "- V N"),
        (["a;b;c", "second;Volt;Volt"], "a b c", "second Volt Volt"),
        (["x-axis;1;2", "second;Volt;Volt"], "x-axis 1 2", "second Volt Volt"),
        (["s;V;N", "a;b;c"], "a b c", "s V N"),
        (["a;b;c", "s;V;N", ";raw;filtered"], "a b c", "s V N"),
        (["# a;b;c", "# s;V;N"], "a b c", "s V N"),
        (['"a";"b";"c"', '"s";"V";"N"'], "a b c", "s V N"),
        (["Model;X1;", "Firmware;1.2;", "", "a;b;c", "s;V;N"], "a b c", "s V N"),
        (["s;V;N"], "s V N", "s V N"),
        (["ms;rpm;current"], "ms rpm current", "ms rpm -"),
        (["t;V;x"], "t V x", "- V -"),
        (["time [s];V;p (bar)"], "time V p", "s V bar"),
        (["t;u;y"], "t u y", "- - -"),
        (["D (mm);x y;1/n"], "D x_y 1/n", "mm - -"),
        (["Kanal 1;Kanal 2;Kanal 3", "t;u;y"], "t u y", "- - -"),
    ],
)
@pytest.mark.parametrize("fast", [False, True])
def test_names_and_units(
    tmp_path: Path,
    above: list[str],
    names: str,
    units: str,
    fast: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(table_module, "FAST_FROM_BYTES", 0 if fast else 10**9)
    path = tmp_path / "a.csv"
    path.write_text("\n".join([*above, *THREE]) + "\n", encoding="utf-8")
    log = read_log(path)
    assert [c.name.replace(" ", "_") for c in log.columns] == names.split()
    assert [c.unit or "-" for c in log.columns] == units.split()
    in_row = log.dialect.units_line is not None or units.split() == names.split()
    assert not (in_row and any(c.doubtful for c in log.columns))
    assert (log.rows, log.account.header_lines) == (40, len(above))
    assert describe(log)["rows"] == 40


@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("quoted", [False, True])
@pytest.mark.parametrize("trigger", [True, False])
def test_epos_recorder(tmp_path: Path, decimal: str, quoted: bool, trigger: bool) -> None:
    line = 'Trigger:;1;0.000000;"Parameter values";"Channel 1";"Rising above value"'
    lines = [
        "Date:;2024-05-01 21:54:05",
        "Firmware Version:;0x0120;0x6150;0x0000;0x0000",
        "EPOS Studio Version:;3.6.1.0",
        "Index:;0x30D3;0x30D2;0x0000;0x0000",
        "Max. samples:;500",
        "Sampling period:;40.000",
        "Scale:;0;True;100.000;0.500;-400.500;399.500",
        *(['"{}"'.format(line.replace('"', '""')) if quoted else line] if trigger else []),
        ";Velocity actual value averaged;Torque actual value averaged",
        "ms;rpm;%",
        *(f"{40 * k}.000;{k};{-0.1 * k:.1f}".replace(".", decimal) for k in range(60)),
    ]
    path = tmp_path / "a.csv"
    path.write_text("\r\n".join(lines) + "\r\n", encoding="utf-8")
    # Only such times tell thousands from decimals where a comma may be both.
    log = read_log(path)
    assert log.dialect.name == "EPOS Studio recorder"
    assert [c.header for c in log.columns] == [
        "time",
        "Velocity actual value averaged",
        "Torque actual value averaged",
    ]
    assert [c.unit for c in log.columns] == ["ms", "rpm", "%"]
    assert log.columns[0].values[-1] == 59 * 40.0
    assert (log.rows, log.account.left_out) == (60, ())


def test_rows_of_events_with_instants_before_the_trigger(tmp_path: Path) -> None:
    rows = ["-0.500000000000000,0,1", "-0.000000125000000,0,1", "0.000000000000000,1,1"]
    rows += [f"{0.001 * k * k:.15f},{k % 2},1" for k in range(1, 40)]
    path = tmp_path / "digital.csv"
    path.write_text("\n".join(["Time [s],Channel 0,Channel 1", *rows]) + "\n", encoding="utf-8")
    log = read_log(path)
    assert [c.name for c in log.columns] == ["Time", "Channel 0", "Channel 1"]
    assert (log.rows, log.columns[0].unit, log.columns[0].values[0]) == (42, "s", -0.5)
    assert describe(log)["time"]["start"] == -0.5


def scope(step: str, tail: str = ",,") -> str:
    rows = [f"{k},{k}.5,{k}.25{tail}" for k in range(60)]
    top = ["X,CH1,CH2,Start,Increment,", f"Sequence,Volt,Volt,-3.0e-03,{step}"]
    return "\n".join([*top, *rows]) + "\n"


@pytest.mark.parametrize("tail", ["", ",", ",,"])
def test_an_oscilloscope_that_writes_its_step_once(tmp_path: Path, tail: str) -> None:
    path = tmp_path / "scope.csv"
    path.write_text(scope("1.0e-05", tail), encoding="utf-8")
    log = read_log(path)
    assert [c.header for c in log.columns] == ["time", "CH1", "CH2"]
    assert [c.unit for c in log.columns] == ["s", "Volt", "Volt"]
    assert log.columns[0].values[[0, 1, 59]].tolist() == [-0.003, -0.00299, -0.00241]
    assert (log.rows, log.account.header_lines, log.account.left_out) == (60, 2, ())
    path.write_text(scope("auto"), encoding="utf-8")
    with pytest.raises(LogError, match="step 'auto'"):
        read_log(path)


@pytest.mark.parametrize("names", ["No.,Time,CH1,CH2", "Time,CH1,CH2"])
def test_a_header_of_seven_rows(tmp_path: Path, names: str) -> None:
    count = names.count(",") + 1
    head = ["Model,A6,", "Serial,12345678,", "Date,2024/05/01,12:00:00", "Sampling,0.125,ms"]
    head += ["Trigger,CH1,Rise", names, ["No.", "ms", "r/min", "%"][-count:]]
    head = [",".join(line) if isinstance(line, list) else line for line in head]
    rows = [",".join([str(k), f"{0.125 * k:.3f}", f"{k}.5", "2.25"][-count:]) for k in range(50)]
    path = tmp_path / "trace.csv"
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    log = read_log(path)
    assert [c.header for c in log.columns] == names.split(",")
    assert [c.unit for c in log.columns][-3:] == ["ms", "r/min", "%"]
    assert (log.rows, log.account.header_lines) == (50, 7)


@pytest.mark.parametrize("below", [True, False])
def test_units_of_either_row_of_names_count(tmp_path: Path, below: bool) -> None:
    names = ["Time;Crosshead;Load", "t (ms);AI0 (mm);AI1 (kN)"]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([*(names if below else names[::-1]), *THREE]))
    log = read_log(path)
    assert [c.unit for c in log.columns] == ["ms", "mm", "kN"]
    assert all("Load" in c.also for c in log.columns[2:])


def test_signs_below_the_names_are_units_that_are_not_known(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time;force;x", "??;@@;@@", *THREE]))
    columns = read_log(path).columns
    assert [c.header for c in columns] == ["time", "force", "x"]
    assert [c.unit for c in columns] == ["??", "@@", "@@"]


@pytest.mark.parametrize("head", [["[Head]", "[Data]", "t (ms);p (bar);q (V)"],
                                  ["t (ms);p (bar);q (V)", "[Data]"]])  # fmt: skip
def test_the_name_of_a_section_is_no_unit(tmp_path: Path, head: list[str]) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join([*head, *THREE]))
    assert [c.unit for c in read_log(path).columns] == ["ms", "bar", "V"]


def test_a_size_before_the_first_unit_is_no_instant(tmp_path: Path) -> None:
    """The row of units was taken for samples, and the log refused."""
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["t;p;x", "10 ms;bar;mm", *THREE]) + "\n", encoding="utf-8")
    assert [c.unit for c in read_log(path).columns] == ["10 ms", "bar", "mm"]
