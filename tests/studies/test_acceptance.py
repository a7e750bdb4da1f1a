"""The comparison behind ``make acceptance``: what fails it and what does not."""

from __future__ import annotations

import importlib
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]


def load(name: str) -> ModuleType:
    """A module of ``studies/acceptance``, which stands beside the package."""
    sys.path.insert(0, str(ROOT))
    try:
        return importlib.import_module(f"studies.acceptance.{name}")
    finally:
        sys.path.remove(str(ROOT))


C, F = load("compare"), load("figures")


def estimate(value: float, spread: float = 0.02):
    """An estimate of a truth of 1; one standard error is 0.02."""
    file = {"parameters": {"mass": {"value": value, "unit": "kg", "std_error": spread}}}
    return F.parameter("readme", "drive: mass", file, "mass", "exit 4", truth=1.0)


def ending(word: str):
    return F.words("readme", "drive: end", "exit status", word, "exit 0, pass")


def rms(seen: float | str):
    return F.number("emps", "drive: rms", "rms [m]", "at most 1.7", seen, "low",
                    noise=0.05, limit=1.7)  # fmt: skip


COMMITTED = [ending("exit 0, pass"), estimate(1.01), rms(1.6)]


def words(seen, committed=None, skipped=None):
    """Verdict by row."""
    judgements = C.compare(COMMITTED if committed is None else committed, seen, skipped or {})
    return {j.row: j.word for j in judgements}


def test_the_same_figures_pass() -> None:
    assert set(words(COMMITTED).values()) == {"ok"}


@pytest.mark.parametrize("worse", [1.0121, 0.9879])
def test_an_estimate_that_left_the_truth_by_more_than_its_noise_fails(worse: float) -> None:
    # 0.0121 is 0.605 standard errors against 0.5; a tenth is noise
    assert words([COMMITTED[0], estimate(worse), COMMITTED[2]])["drive: mass"] == "worse"


def test_a_change_within_the_noise_passes() -> None:
    assert words([COMMITTED[0], estimate(1.0119), rms(1.64)]) == {
        "drive: end": "ok", "drive: mass": "ok", "drive: rms": "ok"
    }  # fmt: skip


def test_an_estimate_on_the_other_side_of_the_truth_has_moved_and_passes() -> None:
    assert words([COMMITTED[0], estimate(0.99), COMMITTED[2]])["drive: mass"] == "moved"


@pytest.mark.parametrize("seen", [estimate(1.0), estimate(1.002)])
def test_a_better_estimate_passes(seen) -> None:
    assert words([COMMITTED[0], seen, rms(1.2)]) == {
        "drive: end": "ok", "drive: mass": "better", "drive: rms": "better"
    }  # fmt: skip


def test_a_standard_error_that_grew_fails_though_the_estimate_is_the_same() -> None:
    assert words([COMMITTED[0], estimate(1.01, 0.023), COMMITTED[2]])["drive: mass"] == "worse"


def test_an_interval_that_no_longer_holds_the_truth_fails() -> None:
    assert words([COMMITTED[0], estimate(1.01, 0.002), COMMITTED[2]])["drive: mass"] == "worse"


def test_a_missing_row_fails_and_is_named() -> None:
    judgements = C.compare(COMMITTED, COMMITTED[:2], {})
    assert [(j.row, j.word) for j in judgements][-1] == ("drive: rms", "worse")
    assert C.summary(judgements)[-1] == "worse: drive: rms"


def test_rows_of_a_group_that_is_skipped_pass_with_the_reason() -> None:
    judgements = C.compare(COMMITTED, COMMITTED[:2], {"emps": "its logs are not there"})
    assert judgements[-1].cells()[-1] == "skipped: its logs are not there"


def test_a_fit_that_does_not_end_fails() -> None:
    end = "did not end in 120 s"
    gone = F.parameter("readme", "drive: mass", None, "mass", end, truth=1.0)
    assert words([ending(end), gone, rms(end)]) == dict.fromkeys(
        ("drive: end", "drive: mass", "drive: rms"), "worse"
    )


def test_what_is_wrong_today_may_stay_so_or_get_better() -> None:
    before = [ending("exit 5"), rms("did not end in 120 s")]
    assert set(words(before, before).values()) == {"wrong today"}
    assert set(words([ending("exit 0, pass"), rms(1.6)], before).values()) == {"better"}
    assert words([ending("exit 1"), rms(9.0)], before) == {
        "drive: end": "worse", "drive: rms": "better"
    }  # fmt: skip
    assert words([ending("exit 0, pass"), rms("exit 4")], before)["drive: rms"] == "worse"


def test_a_parameter_that_is_refused_now_fails() -> None:
    file = {"parameters": {"mass": {"value": 0.0, "unit": "kg", "status": "not_identified"}}}
    refused = F.parameter("readme", "drive: mass", file, "mass", "exit 4", truth=1.0)
    assert words([COMMITTED[0], refused, COMMITTED[2]])["drive: mass"] == "worse"


def test_a_figure_without_a_reference_has_to_stay() -> None:
    row = F.number("x", "bench: lag", "lag", "-", 5.0, "stay", noise=0.1)
    assert words([replace(row, seen=5.09)], [row]) == {"bench: lag": "ok"}
    assert words([replace(row, seen=4.8)], [row]) == {"bench: lag": "worse"}


def test_a_new_row_passes_and_is_said() -> None:
    assert words(COMMITTED, COMMITTED[:2])["drive: rms"] == "new"


def test_rows_that_are_worse_come_last() -> None:
    seen = [ending("exit 1"), *COMMITTED[1:]]
    assert [j.row for j in C.compare(COMMITTED, seen, {})][-1] == "drive: end"


def test_figures_are_read_back_as_they_were_written(tmp_path: Path) -> None:
    C.save(tmp_path / "committed.json", COMMITTED)
    assert C.load(tmp_path / "committed.json") == COMMITTED


def test_the_committed_table_and_its_figures_belong_together() -> None:
    figures = C.load(ROOT / "studies" / "acceptance" / "committed.json")
    page = (ROOT / "docs" / "evidence" / "acceptance.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| ")][2:]
    assert [row.split(" | ")[0].removeprefix("| ") for row in rows] == [f.row for f in figures]
    assert len({f.row for f in figures}) == len(figures)
