"""Rows with a missing or non-numeric cell: refused, or left out where that is asked for."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import fluidact_fit as ff
from fluidact_fit.errors import LogError, UsageError
from fluidact_fit.family import Role, Variant
from fluidact_fit.logs import experiments, read_log
from fluidact_fit_cli.main import run

ROOT = Path(__file__).parents[2]
VARIANT = Variant(
    "any",
    (
        Role("time", "s", "", required=False),
        Role("inlet", "1", "", hold="foh"),
        Role("outlet", "1", "", output=True),
    ),
    (),
)


def line(folder: Path, name: str = "line.csv", holes: Sequence[int] = (), text: str = "") -> Path:
    """First-order response to steps, gain 0.8, time constant 0.15 s, every 10 ms."""
    inlet = np.repeat([0.0, 1.0, 3.0, 0.5, 2.0, 1.0], 100)
    outlet, y = [], 0.0
    for u in inlet:
        outlet.append(y)
        y += (0.8 * u - y) * (1.0 - np.exp(-0.01 / 0.15))
    noise = 1e-3 * np.random.default_rng(1).normal(size=inlet.size)
    rows = ["time [s],inlet [bar],outlet [bar]"]
    for k, (u, v) in enumerate(zip(inlet, outlet + noise)):
        rows.append(f"{0.01 * k:.2f},{u:.4f},{text if k in holes else f'{v:.5f}'}")
    path = folder / name
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


HOLES = [*range(150, 550, 10)]  # forty of them


@pytest.mark.parametrize("text", ["", "nan", "NaN", "#N/A", "OL", "---"])
def test_a_log_with_holes_is_refused_or_read_without_them(tmp_path: Path, text: str) -> None:
    path = line(tmp_path, holes=HOLES, text=text)
    for invalid in (None, "refuse"):
        with pytest.raises(LogError) as caught:
            experiments(read_log(path, invalid=invalid), VARIANT)
        assert "line 152: column 'outlet [bar]'" in caught.value.text
        assert "39 more such cells" in caught.value.text
        assert "--invalid=drop" in caught.value.remedy
    (one,), notices = experiments(read_log(path, invalid="drop"), VARIANT)
    kept = np.delete(np.arange(600), HOLES)
    np.testing.assert_allclose(one.time, 0.01 * kept)
    assert not one.uniform
    assert one.sample_time == pytest.approx(0.01)
    assert one.signals["inlet"].values.size == 600  # it is known all the same
    (said,) = [n.message for n in notices if n.code == "rows-dropped"]
    assert "40 rows" in said
    assert "lines 152, 162, 172, 182 and 36 more" in said
    assert "40 in 'outlet [bar]'" in said


def test_a_row_without_its_time_is_left_out(tmp_path: Path) -> None:
    path = line(tmp_path)
    lines = path.read_text(encoding="utf-8").splitlines()
    for at in (7, 8, 300):
        lines[at] = "," + lines[at].partition(",")[2]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(LogError, match="column 'time \\[s\\]' is empty"):
        experiments(read_log(path, columns={"time": "#1"}), VARIANT)
    (one,), notices = experiments(read_log(path, invalid="drop"), VARIANT)
    np.testing.assert_allclose(one.time, 0.01 * np.delete(np.arange(600), [6, 7, 299]))
    assert any("3 rows" in n.message for n in notices if n.code == "rows-dropped")


def test_only_columns_that_are_used_count(tmp_path: Path) -> None:
    path = line(tmp_path)
    lines = path.read_text(encoding="utf-8").splitlines()
    lines = [f"{row},{'' if k % 9 else 1.5}" for k, row in enumerate(lines)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    (one,), notices = experiments(read_log(path, invalid="drop"), VARIANT)
    assert one.samples == 600
    assert one.uniform
    assert "rows-dropped" not in {n.code for n in notices}


@pytest.mark.parametrize("sample_time", [None, 0.01])
def test_a_row_left_out_of_a_log_without_time_is_a_gap(
    tmp_path: Path, sample_time: float | None
) -> None:
    """Rows that were excluded closed up, and all that follow were too early."""
    frame = pd.read_csv(line(tmp_path, holes=[100, 101, 400])).iloc[:, 1:]
    log = read_log(frame, invalid="drop", sample_time=sample_time)
    (one,), _ = experiments(log, VARIANT)
    kept = np.delete(np.arange(600), [100, 101, 400])
    assert one.samples == 597
    if sample_time:
        np.testing.assert_allclose(one.time, 0.01 * kept)
        log = read_log(frame, exclude=["rows=101:102", "rows=401"], sample_time=sample_time)
        (one,), _ = experiments(log, VARIANT)
        np.testing.assert_allclose(one.time, 0.01 * kept)
        (one,), _ = experiments(
            read_log(frame, exclude="rows=1:402", sample_time=sample_time), VARIANT
        )
        assert one.uniform
        assert one.time[0] == pytest.approx(4.02)


@pytest.mark.parametrize(
    ("cells", "told"),
    [
        (["x"] * 400, "with a column of numbers"),
        (["1,234.5"] * 3, "stands between thousands"),  # what is left would be all that is small
    ],
)
def test_what_is_no_hole_is_refused_all_the_same(
    tmp_path: Path, cells: list[str], told: str
) -> None:
    cells = [*cells, *(f"{k % 7}.25" for k in range(600 - len(cells)))]
    rows = [f"{k / 100};{k % 5}.5;{cell}" for k, cell in enumerate(cells)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time;inlet;outlet", *rows]) + "\n", encoding="utf-8")
    with pytest.raises(LogError) as caught:
        experiments(read_log(path, invalid="drop"), VARIANT)
    assert told in caught.value.text


def test_nothing_left_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = [f"{k / 100},{k if k % 2 else 'x'},{'x' if k % 2 else k}" for k in range(600)]
    path.write_text("\n".join(["time,inlet,outlet", *rows]) + "\n", encoding="utf-8")
    with pytest.raises(LogError, match="no row holds a number in every column"):
        experiments(read_log(path, invalid="drop"), VARIANT)
    with pytest.raises(UsageError, match="invalid"):
        read_log(path, invalid="often")  # type: ignore[arg-type]


def test_the_fit_and_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    whole = ff.fit("line", line(tmp_path, "whole.csv"))
    holed = line(tmp_path, "holed.csv", holes=HOLES)
    with pytest.raises(LogError) as caught:
        ff.fit("line", holed)
    assert "invalid='drop'" in str(caught.value)
    assert "--" not in str(caught.value)
    result = ff.fit("line", holed, invalid="drop")
    for name in ("gain", "time_constant"):
        one, two = result.parameters[name], whole.parameters[name]
        assert one.value == pytest.approx(two.value, abs=4 * two.std_error)
    (source,) = result.document.provenance.logs
    assert source.details is not None
    assert source.details["invalid"] == "drop"
    assert source.details["rows_dropped"] == 40


def test_check_and_simulate_do_it_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    line(tmp_path, "a.csv", holes=HOLES)
    line(tmp_path, "b.csv", holes=[20, 333], text="OL")
    assert run(["line", "a.csv", "-q"]) == 3
    assert run(["line", "a.csv", "--invalid", "drop", "-q"]) == 0
    for log in ("a.csv", "b.csv"):
        assert run(["check", "line.yaml", log, "-q"]) == 0
        assert run(["simulate", "line.yaml", log, "-o", "s.csv", "-f", "-q"]) == 0
    assert run(["check", "line.yaml", "b.csv", "--invalid", "refuse", "-q"]) == 3
    capsys.readouterr()
    assert run(["inspect", "a.csv", "--family", "line", "--invalid", "drop", "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert found["family"]["runs"][0]["samples"] == 560
    assert "rows-dropped" in {n["code"] for n in found["notices"]}


def test_batch_takes_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    line(tmp_path, "a.csv", holes=HOLES)
    (tmp_path / "jobs.csv").write_text(
        "job,family,logs,options\none,line,a.csv,--invalid drop\n", encoding="utf-8"
    )
    assert run(["batch", "jobs.csv", "-o", "out", "-q"]) == 0
    assert (tmp_path / "out/one.yaml").exists()


def test_holes_of_a_machine_that_is_tried_for_losses(tmp_path: Path) -> None:
    """Forces at instants of their own made the examination divide by nothing."""
    lines = (ROOT / "datasets/hydrostatic/trial2.csv").read_text(encoding="utf-8").splitlines()
    for at in range(60, 900, 70):
        lines[at] = lines[at].rpartition(",")[0] + ","
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    columns = {"force": "F [N]", "position": "x [mm]"}
    result = ff.fit("hydrostatic", path, columns=columns, invalid="drop")
    assert result.parameters["mass"].value == pytest.approx(53.8, abs=3.0)
