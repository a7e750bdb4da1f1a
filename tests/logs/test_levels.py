"""Names in several rows, and rows in which some columns have units and others names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import fluidact_fit as ff
from fluidact_fit.errors import LogError
from fluidact_fit.logs import Log, read_log
from fluidact_fit.logs.columns import find_column

ROWS = [f"{k},{k}.5,{k}.25,{k % 7}" for k in range(40)]


def read(folder: Path, lines: list[str], **options: object) -> Log:
    path = folder / "log.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_log(path, **options)


@pytest.mark.parametrize(
    ("head", "names", "units"),
    [
        (["Time,Analog 1,Analog 2,Analog 3", "ms,Servo motor speed,Torque,Not selected"],
         ["Time", "Analog 1 Servo motor speed", "Analog 2 Torque", "Analog 3 Not selected"],
         ["ms", None, None, None]),
        (["Zeit,Kanal 1,Kanal 2,Kanal 3", "[ms],Druck,[bar],Weg"],
         ["Zeit", "Kanal 1 Druck", "Kanal 2", "Kanal 3 Weg"], ["ms", None, "bar", None]),
        (["Time,Analog 1,Analog 2,Analog 3", "us,V,V,Pressure at valve"],
         ["Time", "Analog 1", "Analog 2", "Analog 3 Pressure at valve"], ["us", "V", "V", None]),
        (["No.,Time,Analog 1,Analog 2", ",ms,Servo speed,Servo torque"],
         ["No.", "Time", "Analog 1 Servo speed", "Analog 2 Servo torque"],
         [None, "ms", None, None]),
        (["ms,Servo speed,Servo torque,", "Time,Analog 1,Analog 2,Analog 3"],
         ["Time", "Servo speed Analog 1", "Servo torque Analog 2", "Analog 3"],
         ["ms", None, None, None]),
        (["Kanal 1,Kanal 2,Kanal 3,Kanal 4", "t,u,y,z"], ["t", "u", "y", "z"], [None] * 4),
        (["time,in,out,min", "s,-,V,V"], ["time", "in", "out", "min"], ["s", "-", "V", "V"]),
    ],
)  # fmt: skip
def test_units_beside_names(
    tmp_path: Path, head: list[str], names: list[str], units: list[str | None]
) -> None:
    log = read(tmp_path, [*head, *ROWS])
    assert [c.header for c in log.columns] == names
    assert [c.unit or None for c in log.columns] == units
    assert (log.rows, log.account.header_lines) == (40, 2)


def test_either_part_of_a_name_means_its_column(tmp_path: Path) -> None:
    head = ["Time,Analog 1,Analog 2,Analog 3", "ms,Servo speed,Not selected,Not selected"]
    log = read(tmp_path, [*head, *ROWS])
    for wanted in ("Analog 1", "Servo speed", "servo_speed", "Analog 1 Servo speed"):
        assert find_column(log, "velocity", wanted).index == 2
    with pytest.raises(LogError, match="could be"):
        find_column(log, "velocity", "Not selected")


@pytest.mark.parametrize("index", ["time", None])
@pytest.mark.parametrize("levels", [2, 3])
@pytest.mark.parametrize("sep", [",", ";"])
def test_columns_of_several_levels_as_pandas_writes_them(
    tmp_path: Path, index: str | None, levels: int, sep: str
) -> None:
    names = [("valve", "p1", "bar"), ("valve", "p2", "bar"), ("rod", "x", "mm")]
    columns = pd.MultiIndex.from_tuples([n[:levels] for n in names])
    instants = pd.Index(np.arange(40) / 100, name=index)
    frame = pd.DataFrame(np.arange(120.0).reshape(40, 3), index=instants, columns=columns)
    path = tmp_path / "frame.csv"
    frame.to_csv(path, sep=sep)
    log = read_log(path)
    assert [c.header for c in log.columns] == [index or "", "valve p1", "valve p2", "rod x"]
    assert [c.unit for c in log.columns][1:] == (
        ["bar", "bar", "mm"] if levels == 3 else [None] * 3
    )
    assert (log.rows, log.account.left_out) == (40, ())
    assert find_column(log, "position", "x").values[-1] == 119.0


@pytest.mark.parametrize("index", [[], ["t (ms),,,"]])
def test_the_same_names_in_every_group(tmp_path: Path, index: list[str]) -> None:
    first = "" if index else "t (ms)"
    log = read(tmp_path, [",valve,chamber,tank", f"{first},p (bar),p (bar),p (bar)", *index, *ROWS])
    headers = ["t (ms)", "valve p (bar)", "chamber p (bar)", "tank p (bar)"]
    assert [c.header for c in log.columns] == headers
    assert [c.unit for c in log.columns] == ["ms", "bar", "bar", "bar"]


def test_groups_that_are_named_once(tmp_path: Path) -> None:
    log = read(tmp_path, [",valve,,rod", "t (ms),p (bar),x,x", *ROWS])
    assert [c.header for c in log.columns] == ["t (ms)", "valve p (bar)", "valve x", "rod x"]
    assert [c.unit for c in log.columns] == ["ms", "bar", None, None]
    assert [c.name for c in log.columns] == ["t", "valve p", "valve x", "rod x"]


def test_a_name_of_the_columns_above_that_of_the_index(tmp_path: Path) -> None:
    log = read(tmp_path, ["signal,p [bar],x [mm],u [V]", "time [ms],,,", *ROWS])
    assert [c.header for c in log.columns] == ["time [ms]", "p [bar]", "x [mm]", "u [V]"]


NO_VALUE = ["s/d", "N", "A", "V", "***", "*", "n.a.", "#NV", "---", "h", "min"]


@pytest.mark.parametrize("word", NO_VALUE)
@pytest.mark.parametrize("first", ["0", "0.0", "0.000", "-1", "1", "1.0"])
@pytest.mark.parametrize("head", ["t,p,q", "t (s),p (bar),q (bar)", "t [s],p,q"])
def test_a_first_row_without_values_is_a_row(
    tmp_path: Path, word: str, first: str, head: str
) -> None:
    at = float(first)
    rows = [f"{at + k:.1f},{k}.5,{k}.25" for k in range(1, 40)]
    log = read(tmp_path, [head, f"{first},{word},{word}", *rows])
    assert [c.header for c in log.columns] == head.split(",")
    assert (log.rows, log.lines[0], log.account.header_lines) == (40, 2, 1)
    assert log.columns[0].values[0] == at
    assert [c.bad for c in log.columns] == [{}, {0: word}, {0: word}]
    assert log.columns[1].unit == ("bar" if "bar" in head else None)


@pytest.mark.parametrize("word", ["N", "A", "***", "s/d"])
def test_a_first_row_of_such_words_alone_is_named(tmp_path: Path, word: str) -> None:
    rows = [f"{k}.0,{k}.5,{k}.25" for k in range(40)]
    log = read(tmp_path, ["time,p,q", ",".join([word] * 3), *rows])
    assert [c.header for c in log.columns] == ["time", "p", "q"]
    assert [c.unit for c in log.columns] == [None] * 3
    assert 2 in [*log.lines.tolist(), *(line for line, _ in log.account.left_out)]


def test_a_row_of_units_for_a_count_keeps_its_one(tmp_path: Path) -> None:
    log = read(tmp_path, ["No,u,p", "1,V,bar", *(f"{k},{k}.5,{k}.25" for k in range(1, 40))])
    assert [c.unit for c in log.columns] == ["1", "V", "bar"]
    assert log.rows == 39


def test_time_below_a_row_of_units_and_names_is_in_milliseconds(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    time = np.arange(1500) * 5.0
    u = np.repeat(rng.uniform(0, 5, 50), 30)
    y = np.zeros(1500)
    for k in range(1, 1500):
        y[k] = y[k - 1] + (1 - np.exp(-5 / 120)) * (u[k - 1] - y[k - 1])
    y += rng.normal(0, 0.01, 1500)
    rows = [f"{t:.1f},{a:.4f},{b:.4f}" for t, a, b in zip(time, u, y)]
    head = [
        "Axis1",
        "Interval (ms),5",
        "Time,Analog 1,Analog 2",
        "ms,Feed pressure,Outlet pressure",
    ]
    log = read(
        tmp_path, [*head, *rows],
        columns={"inlet": "Feed pressure", "outlet": "Analog 2"},
    )  # fmt: skip
    result = ff.fit("line", [log], hold={"inlet": "zoh"})
    assert result.parameters["time_constant"].value == pytest.approx(0.12, rel=0.02)


@pytest.mark.parametrize("unit", ["milimetr", "MV", "bra", "\u00b110 V"])
@pytest.mark.parametrize("names", ["Time,position", '"t","u"'])
def test_a_cell_below_a_name_is_its_unit_though_the_time_has_none(
    names: str, unit: str, tmp_path: Path
) -> None:
    rows = [f"2024-05-27T14:48:49.{k:02d}0Z,{0.25 * k}" for k in range(40)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([names, f",{unit}", *rows]), encoding="utf-8")
    log = read_log(path)
    assert [c.unit for c in log.columns][1] == unit
    assert log.columns[1].name == names.split(",")[1].strip('"')
    with pytest.raises(ff.FluidactError, match=r"units=\{'outlet': "):
        ff.fit("line", path, columns={"time": "#1", "inlet": "#2", "outlet": "#2"},
               units={"inlet": "bar"})  # fmt: skip
