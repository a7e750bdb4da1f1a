"""Exports of oscilloscopes, written after their descriptions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fluidact_fit.errors import LogError
from fluidact_fit.logs import read_log

SETTINGS = (
    "Record Length,2.500000e+03", "Sample Interval,4.000000e-03",
    "Trigger Point,1.250000000000e+03", ",", ",", ",", "Source,CH2", "Vertical Units,V",
    "Vertical Scale,5.000000e-01", "Vertical Offset,0.000000e+00", "Horizontal Units,s",
    "Horizontal Scale,1.000000e+00", "Pt Fmt,Y", "Yzero,0.000000e+00", "Probe Atten,1.0",
    "Model Number,TDS2014", "Serial Number,C012345", "Firmware Version,FV:v22.11",
)  # fmt: skip


def export(rows: int, tail: str) -> str:
    lines = []
    for k in range(rows):
        setting = SETTINGS[k] if k < len(SETTINGS) else ","
        lines.append(f"{setting},,{0.004 * (k - 5):019.12f},{0.02 * (k % 7):10.5f}{tail}")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("tail", ["", ","])
def test_settings_beside_the_samples(tmp_path: Path, tail: str) -> None:
    path = tmp_path / "F0000CH2.CSV"
    path.write_text(export(300, tail), encoding="utf-8")
    log = read_log(path)
    assert log.dialect.name == "Tektronix oscilloscope"
    assert [(c.header, c.unit) for c in log.columns] == [("time", "s"), ("CH2", "V")]
    assert (log.rows, log.account.left_out) == (300, ())
    np.testing.assert_allclose(log.columns[0].values, 0.004 * (np.arange(300) - 5.0), atol=1e-12)
    np.testing.assert_allclose(log.columns[1].values, 0.02 * (np.arange(300) % 7), atol=1e-12)


def test_a_damaged_line_is_named(tmp_path: Path) -> None:
    lines = export(300, ",").split("\n")
    lines[100] = ",,,0.38"
    path = tmp_path / "F0000CH2.CSV"
    path.write_text("\n".join(lines), encoding="utf-8")
    log = read_log(path)
    assert log.rows == 299
    assert [line for line, _ in log.account.left_out] == [101]


def test_numbered_samples_have_the_instants_that_are_written_once(tmp_path: Path) -> None:
    """As a Rigol exports two channels."""
    path = tmp_path / "NewFile1.csv"
    rows = [f"{k},{0.5 * (k % 5):.2e},{k:.2e},," for k in range(100)]
    head = ["X,CH1,CH2,Start,Increment", "Sequence,Volt,Volt,-2.0e-03,1.0e-04"]
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    log = read_log(path)
    assert log.dialect.name == "Rigol oscilloscope"
    assert [(c.header, c.unit) for c in log.columns] == [
        ("time", "s"), ("CH1", "Volt"), ("CH2", "Volt"),
    ]  # fmt: skip
    np.testing.assert_allclose(log.columns[0].values, -2e-3 + 1e-4 * np.arange(100), atol=1e-12)
    np.testing.assert_allclose(log.columns[2].values, np.arange(100.0))
    path.write_text("\n".join([head[0], "Sequence,Volt,Volt,?,0", *rows]), encoding="utf-8")
    with pytest.raises(LogError, match=r"line 2.*no times follow from start '\?'"):
        read_log(path)


HEAD = (
    '"Header Size",15', '"Model Name","DLM4000"', '"Comment",""', '"BlockNumber",1',
    '"TraceName","inlet","outlet"', '"BlockSize",100,100', '"VUnit","bar","mV"',
    '"SampleRate",1000,1000', '"HResolution",1.0e+00,1.0e+00', '"HOffset",-2.0e+01,-2.0e+01',
    '"HUnit","ms","ms"', '"DisplayPointNo.",1,1', '"Date","2024/05/06","2024/05/06"',
    '"Time","10:11:12.5","10:11:12.5"', "",
)  # fmt: skip


@pytest.mark.parametrize(
    "form", [",{:.4f},{:.3f}", "{:.4f},{:.3f}", "{:.4f},{:.3f},", ",{:.4f},{:.3f},"]
)
def test_settings_of_every_trace_above_the_samples(tmp_path: Path, form: str) -> None:
    """As a Yokogawa exports: 'HUnit' or 'Time' and an instant were the names of the columns."""
    path = tmp_path / "000.csv"
    rows = [form.format(1.0 + 0.5 * (k % 5), 2.0 * k) for k in range(100)]
    path.write_text("\n".join([*HEAD, *rows]) + "\n", encoding="utf-8")
    log = read_log(path)
    assert log.dialect.name == "Yokogawa oscilloscope"
    found = [(c.header, c.unit) for c in log.columns]
    assert found == [("time", "s"), ("inlet", "bar"), ("outlet", "mV")]
    assert (log.rows, log.account.left_out) == (100, ())
    np.testing.assert_allclose(log.columns[0].values, 1e-3 * np.arange(-20, 80), atol=1e-12)
    np.testing.assert_allclose(log.columns[2].values, 2.0 * np.arange(100))


def test_traces_have_steps_and_units_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "000.csv"
    head = [line.replace("1.0e+00,1.0e+00", "1.0e+00,2.0e+00").replace('"bar","mV"', '"","mV"')
            for line in HEAD]  # fmt: skip
    rows = [f",{0.5 * (k % 5):.4f},{k if k < 50 else ''}" for k in range(100)]
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    time, inlet, outlet = read_log(path).columns
    assert (inlet.unit, outlet.unit) == (None, "mV")
    there = np.isfinite(outlet.values)
    np.testing.assert_allclose(outlet.values[there], np.arange(50.0))
    np.testing.assert_allclose(time.values[there], 1e-3 * (-20.0 + 2.0 * np.arange(50)), atol=1e-12)


@pytest.mark.parametrize(
    ("line", "instead", "message"),
    [
        (10, '"HUnit","Hz","Hz"', r"line 9: no times follow from start '-2\.0e\+01'"),
        (8, '"HResolution",0,0', r"line 9: no times follow .* step '0' \[ms\]"),
        (3, '"BlockNumber",3', r"line 16: 2 traces \(blocks: 3\)"),
    ],
)
def test_settings_without_instants_are_refused(
    tmp_path: Path, line: int, instead: str, message: str
) -> None:
    path = tmp_path / "000.csv"
    head = [*HEAD[:line], instead, *HEAD[line + 1 :]]
    rows = [f",{0.5 * (k % 5):.4f},{k}" for k in range(100)]
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    with pytest.raises(LogError, match=message):
        read_log(path)
