"""The attack on the files and processes itself: it sees what is planted, and repeats itself."""

from __future__ import annotations

import os
import random
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from studies.soak import hostile, logs, options, parameters, processes, program
from studies.soak.__main__ import PARTS
from studies.soak.case import EXIT_1, HANG, LOSS, SEED, TRACEBACK, WRONG, Case, Part, Result
from studies.soak.drafts import ROOT, Draft, recorded
from studies.soak.pool import run_case, run_part
from studies.soak.table import page, shown

from fluidact_fit.logs import Log, read_log


@pytest.fixture
def draft() -> Draft:
    """The first rows of a log with decimal commas."""
    found = recorded(ROOT / "datasets" / "valve" / "trial1.csv")
    found.lines = found.lines[:61]
    return found


@pytest.fixture
def log(draft: Draft, tmp_path: Path) -> Log:
    """What the reader makes of it."""
    path = tmp_path / "log.csv"
    path.write_bytes(draft.encoded())
    return read_log(path)


def kinds(draft: Draft, log: Log) -> list[str]:
    """Kinds of what is wrong with a reading."""
    return [kind for kind, _ in logs.judge(draft, log)]


def without(log: Log, rows: slice) -> Log:
    """A log whose rows were taken for a header, or for nothing at all."""
    keep = np.delete(np.arange(log.rows), rows)
    columns = tuple(replace(c, values=c.values[keep]) for c in log.columns)
    header = log.account.header_lines + log.rows - keep.size
    account = replace(log.account, data_rows=keep.size, header_lines=header)
    return replace(log, lines=log.lines[keep], columns=columns, account=account)


def test_a_log_in_order_is_in_order(draft: Draft, log: Log) -> None:
    assert log.rows == 60
    assert kinds(draft, log) == []


@pytest.mark.parametrize("rows", [slice(0, 3), slice(20, 40), slice(57, 60)])
def test_lost_rows_are_seen(draft: Draft, log: Log, rows: slice) -> None:
    assert kinds(draft, without(log, rows)) == [LOSS]


def test_rows_left_out_with_a_reason_are_no_loss(draft: Draft, log: Log) -> None:
    left = without(log, slice(20, 22))
    account = replace(log.account, data_rows=58, left_out=((22, "text"), (23, "text")))
    assert kinds(draft, replace(left, account=account)) == []


def test_an_account_that_does_not_add_up_is_seen(draft: Draft, log: Log) -> None:
    for wrong in ({"header_lines": 2}, {"total_lines": 70}, {"data_rows": 59}):
        assert WRONG in kinds(draft, replace(log, account=replace(log.account, **wrong)))


def test_a_changed_number_is_seen(draft: Draft, log: Log) -> None:
    values = log.columns[1].values.copy()
    values[7] *= 1000.0
    columns = (log.columns[0], replace(log.columns[1], values=values), *log.columns[2:])
    assert kinds(draft, replace(log, columns=columns)) == [WRONG]


def test_a_header_among_the_rows_is_seen(draft: Draft, log: Log) -> None:
    lines = log.lines.copy()
    lines[0] = 1
    assert WRONG in kinds(draft, replace(log, lines=lines))


def test_readers_that_differ_are_seen(log: Log) -> None:
    values = log.columns[2].values.copy()
    values[3] = np.nan
    other = replace(log, columns=(*log.columns[:2], replace(log.columns[2], values=values)))
    assert list(logs.differences(log, log)) == []
    assert len(list(logs.differences(log, other))) == 1
    assert len(list(logs.differences(log, without(log, slice(0, 1))))) == 1


def _raise(case: Case) -> Result:
    case.tell("planted")
    raise ValueError("planted")


def _spin(case: Case) -> Result:
    case.tell("planted")
    pow(9, 9**9)  # one call that no signal handler of Python interrupts
    return Result("done")


def _sleep(case: Case) -> Result:
    case.tell("planted")
    signal.pause()
    return Result("done")


def _crash(case: Case) -> Result:
    case.tell("planted")
    os.kill(os.getpid(), signal.SIGKILL)
    return Result("done")


@pytest.mark.parametrize(
    ("run", "kind"), [(_raise, TRACEBACK), (_spin, HANG), (_sleep, HANG), (_crash, TRACEBACK)]
)
def test_cases_that_do_not_end_well_are_seen(run: Callable[[Case], Result], kind: str) -> None:
    part = Part("planted", "planted", 3, run, limit=0.2, wait=1.0)
    results = list(run_part(part, range(3), SEED, jobs=2))
    assert sorted(r.number for r in results) == [0, 1, 2]
    assert [[k for k, _ in r.failures] for r in results] == [[kind]] * 3
    assert all(r.about == "planted" for r in results)
    text = page([part], results, 1.0, 1.0)
    assert "3 cases in 1 s, 3 of them failed" in text
    assert f"- {kind}, 3: " in text
    assert "planted:0" in shown(min(results, key=lambda r: r.number))


BUG = "This is a bug in fluidact-fit, not in your data, sorry: KeyError: 'x'. Nothing was written."


@pytest.mark.parametrize(
    ("ended", "kinds_"),
    [
        (program.Ended(0, "done", ""), []),
        (program.Ended(3, "", "log.csv: this is a folder."), []),
        (program.Ended(1, "", BUG), [EXIT_1]),
        (program.Ended(2, "", "Traceback (most recent call last):\n  x\nKeyError: 1"), [TRACEBACK]),
        (program.Ended(7, "", "what"), [WRONG]),
        (program.Ended(3, "", ""), [WRONG]),
        (program.Ended(3, "", "x" * 30_000), [WRONG]),
        (program.Ended(3, "", "no column '\x1b[2J'"), [WRONG]),
    ],
)
def test_ends_are_judged(ended: program.Ended, kinds_: list[str]) -> None:
    result = Result("")
    program.judge(ended, result)
    assert [kind for kind, _ in result.failures] == kinds_


def test_files_are_judged(tmp_path: Path) -> None:
    path = tmp_path / "out.yaml"
    whole = (ROOT / "tests" / "golden" / "0.1.0" / "line.yaml").read_bytes()
    for content, old, found in (
        (None, None, "none"), (None, b"x", "lost"), (whole, whole, "old"), (whole, b"x", "new"),
        (whole[:900], whole, "broken"),
    ):  # fmt: skip
        path.unlink(missing_ok=True)
        if content is not None:
            path.write_bytes(content)
        result = Result("")
        said = processes.judge_file(path, old, result)
        assert said == found.replace("lost", "none")
        assert bool(result.failures) is (found in ("lost", "broken"))


def test_what_is_left_behind_is_judged() -> None:
    log = {"log.csv": b"1"}
    for after, status, words, bad in (
        (log, 0, [], False), (log, 2, [], False), ({"log.csv": b"2"}, 0, ["-f"], True),
        ({**log, "out.png": b""}, 3, [], True), ({**log, "out.png": b""}, 0, [], False),
        (log, 0, ["-o", "not/there.yaml"], True),
    ):  # fmt: skip
        result = Result("")
        options.judge_files(log, after, status, words, result)
        assert bool(result.failures) is bad


def test_what_must_be_refused_is_known() -> None:
    """Of the damage to parameter files much must be refused, and some does no harm."""
    why = [parameters.drafted(random.Random(f"known {n}"))[2] for n in range(40)]
    assert 5 < sum(map(bool, why)) < 35


def test_parts_have_names_of_their_own() -> None:
    names = [part.name for part in PARTS]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("part", PARTS[:6], ids=lambda part: part.name)
def test_a_case_repeats_itself(part: Part, tmp_path: Path) -> None:
    runs = [run_case(part, 3, SEED, tmp_path / name) for name in "ab"]
    first, second = ((r.outcome, r.about, [k for k, _ in r.failures]) for r in runs)
    assert first == second
    assert runs[0].about
    assert run_case(part, 4, SEED, tmp_path / "c").about != runs[0].about


@pytest.mark.skipif(os.name != "posix", reason="pipes and links")
@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("part", hostile.PARTS, ids=lambda part: part.name)
def test_files_of_others_are_kept(part: Part, number: int, tmp_path: Path) -> None:
    result = run_case(part, number, SEED, tmp_path)
    assert result.failures == []


def test_a_file_that_changed_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("kept", "changed", "lost", "asked for"):
        Path(name).write_text(name, encoding="utf-8")
    before, result = hostile._hashed(Path()), Result("")
    Path("lost").unlink()
    for name in ("changed", "asked for"):
        Path(name).write_text("other", encoding="utf-8")
    hostile._judge_files(before, result, lambda path: path == "./asked for")
    assert sorted(what for _, what in result.failures) == [
        "./changed has changed",
        "./lost is lost",
    ]


def test_a_process_is_killed(tmp_path: Path) -> None:
    result = run_case(PARTS[6], 6, SEED, tmp_path)
    assert PARTS[6].name == "kill"
    assert result.outcome in ("old", "new")
    assert "killed before step 4" in result.about
