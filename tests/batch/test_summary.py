"""The summary of a batch in hands that it was not made for: spreadsheets and browsers."""

from __future__ import annotations

import csv
from pathlib import Path

import pandas as pd
import pytest

from fluidact_fit.batch import Job, write_summary
from fluidact_fit.batch.outcome import JobResult

FORMULAS = (
    "=cmd|'/C calc'!A1", "+1+1", "-2+3+cmd|' /C calc'!A0", "@SUM(1+1)*cmd", "=HYPERLINK('x')",
    " =1+1", "\t=1+1", "\r=1", "\n@x", "\u00a0=1+1", "＝1+1", "＋1+1", "－1+1", "＠x",
    "x;=1+1", 'a"; =1+1', "-", "=", "--1", "-1-1", "\u2212cmd",
)  # fmt: skip


def _written(folder: Path, name: str, message: str) -> list[dict[str, str]]:
    outcome = JobResult(
        name, "k", 0, "pass", message, message, (message,),
        {"gain": {"value": -1.5, "std_error": 0.5, "unit": "V", "status": "estimated"}},
    )  # fmt: skip
    write_summary([Job(name, "line", ("a.csv",))], [outcome], folder)
    with (folder / "summary.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("text", FORMULAS)
def test_no_cell_is_a_formula(text: str, tmp_path: Path) -> None:
    (row,) = _written(tmp_path, text, text)
    assert row["gain"] == "-1.5"
    for name in ("job", "message", "warnings"):
        # as locales split cells: by commas, by semicolons
        for part in row[name].split(";"):
            first = part.lstrip('"\t\r\n \u00a0')[:1]
            assert first not in set("=+-@＝＋－＠\u2212"), row
    packed = pd.read_parquet(tmp_path / "summary.parquet")
    assert packed["job"][0] == text


@pytest.mark.parametrize(
    "name", ["-5", "+1.5", "1e3", "unit-0041", "a=b", "x@y", "'quoted'", "b - c"]
)
def test_what_is_harmless_stays_as_it_is(name: str, tmp_path: Path) -> None:
    (row,) = _written(tmp_path, name, f"log {name}; then -- {name}")
    assert row["job"] == name
    assert row["message"] == f"log {name}; then -- {name}"


def test_the_page_shows_markup_as_text(tmp_path: Path) -> None:
    evil = "<img src=x onerror=alert(1)>&\"'"
    _written(tmp_path, "j", evil)
    failed = JobResult(evil, "k", 3, message=evil, reason=evil)
    write_summary([Job(evil, "line", ("a.csv",))] * 2, [failed, failed], tmp_path)
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "onerror" in page
    assert "<img" not in page.replace('<img src="data:', "")
    assert 'href="logs/%3Cimg%20src' in page


def test_a_job_without_a_reason_is_listed_by_its_message(tmp_path: Path) -> None:
    """It was grouped by it, and shown without words."""
    failed = JobResult("j", "k", 3, message="a.csv: it stops in the middle.")
    write_summary([Job("j", "line", ("a.csv",))], [failed], tmp_path)
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "<td>a.csv: it stops in the middle.</td>" in page
