"""Rows of statistics are no samples: left out, each named, wherever they stand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.logs import Log, read_log
from fluidact_fit.logs import table as table_module

HEAD = "No,ADC,laser (mm)"
ROWS = [f"{k},{40 + 37 * k},{2.5 * k:.2f}" for k in range(1, 25)]
CELLS = ",459.9,30.02"


def read(folder: Path, lines: list[str], **options: object) -> Log:
    path = folder / "log.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_log(path, **options)


def left_out(log: Log) -> list[int]:
    return [line for line, _ in log.account.left_out]


SETS = [
    "Mean Std Min Max", "mean: std: min: max:", "Average StDev Minimum Maximum Sum Count",
    "Mittelwert Standardabweichung Minimum Maximum Summe", "Moyenne Médiane Écart-type",
    "Promedio Mediana Desviación Mínimo Máximo", "MEAN STD", "Median", "Avg", "Ø σ",
    "平均值 标准差 最大值 最小值", "count mean std min 25% 50% 75% max", "RMS Peak-Peak",
    "Max.-Wert Min.-Wert", "Mean(mm) Max(mm)", "Tolerance", "Bemerkung",
]  # fmt: skip


@pytest.mark.parametrize("words", SETS)
@pytest.mark.parametrize("between", [[], [""], ["-----"]])
@pytest.mark.parametrize("form", ["plain", "semicolons", "quoted", "fast"])
def test_statistics_below_the_samples(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, between: list[str], form: str
) -> None:
    monkeypatch.setattr(table_module, "FAST_FROM_BYTES", 0 if form == "fast" else 10**9)
    lines = [HEAD, *ROWS, *between, *(word + CELLS for word in words.split())]
    if form == "semicolons":
        lines = [line.replace(",", ";").replace(".", ",") for line in lines]
    elif form == "quoted":
        lines = [",".join(f'"{c}"' for c in line.split(",")) if line else "" for line in lines]
    log = read(tmp_path, lines)
    assert log.rows == 24
    assert log.columns[2].values[-1] == 60.0
    assert not any(c.bad for c in log.columns)
    first = 26 + sum(map(bool, between)) * 0
    assert left_out(log) == [n for n in range(first, len(lines) + 1) if lines[n - 1]]
    assert [n.code for n in log.notices][-1] == "statistics-rows"


@pytest.mark.parametrize("place", ["top", "middle", "both"])
def test_statistics_elsewhere(tmp_path: Path, place: str) -> None:
    block = [word + CELLS for word in ("Mean", "Std")]
    lines = {
        "top": [HEAD, *block, *ROWS, *ROWS],
        "middle": [HEAD, *ROWS, *block, HEAD, *ROWS],
        "both": [HEAD, *ROWS, *block, HEAD, *ROWS, *block],
    }[place]
    log = read(tmp_path, lines)
    assert log.rows == 48
    assert left_out(log) == [
        n for n, line in enumerate(lines, start=1) if n > 1 and not line[0].isdigit()
    ]


@pytest.mark.parametrize(
    ("head", "row", "below"),
    [
        ("ADC,laser (mm),remark", "{adc},{mm},", ["459.9,30.0,Mean", "275.7,18.0,Std"]),
        ("No,ADC,laser (mm),remark", "{k},{adc},{mm},", [",459.9,30.0,Mean"]),
        ("No,ADC,laser (mm)", "{k},{adc},{mm}", ["Count,24"]),
        ("laser (mm),No,ADC", "{mm},{k},{adc}", ["30.0,Mean,459.9", "18.0,Std,275.7"]),
        ("time,laser (mm)", "10:00:{k:02d},{mm}", ["Mean,30.0", "Max,60.0"]),
        ("laser (mm)", "{mm}", ["Mean 30.02", "Std: 18.1"]),
        ("No ADC laser_mm", "{k} {adc} {mm}", ["Mean 459.9 30.02", "Std 275.7 18.05"]),
    ],
)
def test_the_word_in_other_columns(tmp_path: Path, head: str, row: str, below: list[str]) -> None:
    rows = [row.format(k=k, adc=40 + 37 * k, mm=f"{2.5 * k:.2f}") for k in range(1, 25)]
    log = read(tmp_path, [head, *rows, *below])
    assert log.rows == 24
    assert left_out(log) == list(range(26, 26 + len(below)))


@pytest.mark.parametrize(
    "below",
    [
        [",Mean,Std", ",3.0,4.0"],
        ["ADC,Mean,Std", ",3.0,4.0", ",5.0,6.0"],
        ["Mean,,", "3.0,4.0,5.0"],
        ["Mean,,", "3.0,4.0,5.0", "Std,,", "1.0,1.0,1.0"],
        ["=AVERAGE(A2:A25),=AVERAGE(B2:B25),=AVERAGE(C2:C25)"],
        ["# Mean,3,4"],
        ["Statistics", "Mean,3,4"],
        ["Statistik:,,", "Mittelwert:,3,4", "Stdabw.:,3,4"],
    ],
)
def test_statistics_below_names_of_their_own(tmp_path: Path, below: list[str]) -> None:
    log = read(tmp_path, [HEAD, *ROWS, *below])
    assert log.rows == 24
    assert left_out(log) == list(range(26, 26 + len(below)))


@pytest.mark.parametrize(
    "rows",
    [
        [f"{k},{('min', 'run', 'max')[k % 3]},{k}.5" for k in range(24)],
        [f"{k},{'max' if k == 23 else ''},{k}.5" for k in range(24)],
        [f"{k},{'max' if k in (3, 9) else ''},{k}.5" for k in range(24)],
        [f"{k},{('max', '')[k % 2]},{k}.5" for k in range(24)],
        [f"{k},{'OVF' if k == 23 else k},{k}.5" for k in range(24)],
    ],
)
def test_words_of_a_state_leave_their_rows(tmp_path: Path, rows: list[str]) -> None:
    log = read(tmp_path, ["t,state,x", *rows])
    assert log.rows == 24
    assert not log.account.left_out


def test_a_fit_takes_the_samples_alone(tmp_path: Path) -> None:
    adc = np.linspace(42, 939, 24)
    mm = 60 * ((adc - 42) / 897) ** 1.1
    rows = [f"{k},{a:.0f},{m:.3f}" for k, (a, m) in enumerate(zip(adc, mm), start=1)]
    columns = {"reading": "ADC", "reference": "laser (mm)"}
    plain = ff.fit("potentiometer", [read(tmp_path, [HEAD, *rows], columns=columns)], degree=3)
    log = read(tmp_path, [HEAD, *rows, "Mean,459.9,30.002", "Max,939.0,60.037"], columns=columns)
    assert ff.fit("potentiometer", [log], degree=3).document.fit.samples == 24
    assert plain.document.fit.samples == 24
