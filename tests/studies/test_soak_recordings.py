"""The attack on recordings and archives sees what is planted, and finds nothing."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from studies.soak import recordings
from studies.soak.case import LOSS, SEED, WRONG, Case, Part, Result, numbers
from studies.soak.pool import run_case

from fluidact_fit.errors import LogError
from fluidact_fit.logs import native, read_log


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


@pytest.mark.parametrize("name", ["log.h5", "log.parquet"])
def test_a_forked_reader_finds_the_same(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(recordings._whole(name) or b"")
    with recordings._forked():
        log = read_log(path)
    assert log.sha256 == read_log(path).sha256
    for forked, other in zip(log.columns, read_log(path).columns, strict=True):
        assert forked.label == other.label
        np.testing.assert_array_equal(forked.values, other.values)


@pytest.mark.parametrize(
    ("does", "seconds", "says"),
    [
        (lambda: os.kill(os.getpid(), 15), 60, "SIGTERM"),
        (lambda: time.sleep(99), 0, "takes more than"),
    ],
)
def test_a_forked_reader_that_does_not_return_is_refused(
    does: Callable[[], None],
    seconds: int,
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = tmp_path / "v4.mat"
    path.write_bytes(recordings._whole("v4.mat") or b"")
    monkeypatch.setattr(recordings.worker, "main", does)
    monkeypatch.setattr(native, "_WAIT", 0.1)
    limits = {"room": 1, "memory": 1, "seconds": seconds}
    monkeypatch.setattr(native, "_limits", lambda size: limits)
    with recordings._forked(), pytest.raises(LogError, match=says):
        read_log(path)
