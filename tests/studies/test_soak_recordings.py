"""The attack on recordings and archives sees what is planted, and finds nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from studies.soak import recordings
from studies.soak.case import LOSS, SEED, WRONG, Case, Part, Result, numbers
from studies.soak.pool import run_case

from fluidact_fit.logs import read_log


@pytest.mark.parametrize("part", recordings.PARTS, ids=lambda part: part.name)
def test_some_cases_fail_in_nothing(part: Part, tmp_path: Path) -> None:
    for number in range(4):
        result = run_case(part, number, SEED, tmp_path / str(number))
        assert result.failures == []
        assert result.outcome in ("read", "refused")


def test_numbers_lost_without_a_word_are_seen(tmp_path: Path) -> None:
    path = tmp_path / "v5.mat"
    path.write_bytes(recordings._whole("v5.mat") or b"")
    log = read_log(path)
    result = Result("read")
    recordings._judge_cut("v5.mat", log, result)
    assert result.failures == []
    recordings._judge_cut("v5.mat", replace(log, columns=log.columns[:1], notices=()), result)
    assert [kind for kind, _ in result.failures] == [LOSS]


def test_too_much_memory_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    taken = iter([[100_000, 2_000_000], [100_000, 2_000_000], [100_000, 2_000_000], [1_200_000, 0]])
    monkeypatch.setattr(recordings, "_most", lambda: next(taken))
    path = tmp_path / "log.csv"
    path.write_text("1,2\n" * 9)
    found = []
    for number in range(2):  # what was there before is not the file's
        case = Case(numbers(recordings.PARTS[0], number, SEED), tmp_path)
        _, result = recordings._read(case, path)
        found.append([kind for kind, _ in result.failures])
    assert found == [[], [WRONG]]
