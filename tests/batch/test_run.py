"""What is run, what is not run again, and what a death on the way costs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from batch_jobs import note
from fluidact_fit.batch import Job, run_batch
from fluidact_fit.batch.journal import NAME, open_journal
from fluidact_fit.batch.outcome import JobResult, Task
from fluidact_fit.batch.pools import LocalPool
from fluidact_fit.errors import OutputError


def _jobs(*options: Sequence[str]) -> list[Job]:
    return [Job(f"j{k}", "line", ("a.csv",), tuple(words)) for k, words in enumerate(options)]


def _run(jobs: list[Job], folder: Path, workers: int = 2, **more: Any) -> list[JobResult]:
    (folder / "a.csv").touch()
    return run_batch(jobs, folder, folder / "out", note, LocalPool(workers), **more)


def _ran(folder: Path) -> list[str]:
    path = folder / "ran.txt"
    lines = sorted(path.read_text(encoding="utf-8").split()) if path.exists() else []
    path.unlink(missing_ok=True)
    return lines


def test_what_is_finished_is_not_run_again(tmp_path: Path) -> None:
    jobs = _jobs((), ("refuse",), ("refuse", "again"), ("slow",))
    assert [o.exit for o in _run(jobs, tmp_path)] == [0, 4, 4, 0]
    assert _ran(tmp_path) == ["j0", "j1", "j2", "j3"]
    assert [o.exit for o in _run(jobs, tmp_path)] == [0, 4, 4, 0]
    assert _ran(tmp_path) == ["j2"]  # another try may end otherwise
    (tmp_path / "out" / "j3.yaml").unlink()
    _run(jobs, tmp_path)
    assert _ran(tmp_path) == ["j2", "j3"]
    _run(jobs[:2], tmp_path, again=True)
    assert _ran(tmp_path) == ["j0", "j1"]


@pytest.mark.parametrize("changed", ["log", "options", "file of an option", "merged log"])
def test_what_has_changed_is_run_again(changed: str, tmp_path: Path) -> None:
    for name in ("b.csv", "v.csv"):
        (tmp_path / name).touch()
    merged = Job("m", "line", ("a.csv+b.csv",))
    jobs = [merged, *_jobs(("--validate=v.csv",))]
    _run(jobs, tmp_path)
    _ran(tmp_path)
    target = {"log": "a.csv", "file of an option": "v.csv", "merged log": "b.csv"}.get(changed)
    if target:
        (tmp_path / target).write_text("changed", encoding="utf-8")
    else:
        jobs[1] = _jobs(("--gain", "2"))[0]
    _run(jobs, tmp_path)
    expected = {"log": ["j0", "m"], "merged log": ["m"]}.get(changed, ["j0"])
    assert _ran(tmp_path) == expected


def test_a_file_written_by_a_process_that_died_is_replaced_unless_it_is_somebody_elses(
    tmp_path: Path,
) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "j1.yaml").touch()
    outcomes = _run(_jobs(("late",), ("slow",)), tmp_path)
    assert [o.exit for o in outcomes] == [0, 2]
    assert _ran(tmp_path).count("j0") == 2
    assert not (tmp_path / "out" / "j1.yaml").read_text()


def test_a_job_that_ends_its_process_costs_itself_alone(tmp_path: Path) -> None:
    jobs = _jobs(*[("slow",)] * 6, ("die",), *[("slow",)] * 6)
    outcomes = _run(jobs, tmp_path)
    assert [o.exit for o in outcomes] == [0] * 6 + [1] + [0] * 6
    assert "more memory" in outcomes[6].message
    ran = _ran(tmp_path)
    assert set(ran) == {job.name for job in jobs}
    assert ran.count("j6") == 2


def test_a_process_that_dies_idle_costs_nothing(tmp_path: Path) -> None:
    names = [f"j{k}" for k in range(6)]
    tasks = [
        Task(n, n, ("line", "idle" if n == "j2" else ""), str(tmp_path), str(tmp_path / n), "")
        for n in names
    ]
    found = []
    for outcome in LocalPool(1).run(note, tasks):
        found.append(outcome.job)
        if len(found) == 1:  # slower than the process, which has three tasks and then waits
            time.sleep(2.0)
    assert sorted(found) == names
    assert _ran(tmp_path) == names


def test_a_line_cut_short_is_no_outcome(tmp_path: Path) -> None:
    jobs = _jobs((), (), ())
    _run(jobs, tmp_path)
    _ran(tmp_path)
    journal = tmp_path / "out" / NAME
    whole = journal.read_bytes()
    lost = whole.splitlines(keepends=True)[-1]
    journal.write_bytes(whole[: -len(lost) // 2])
    _run(jobs, tmp_path)
    assert len(_ran(tmp_path)) == 1
    assert not _ran(tmp_path)
    _run(jobs, tmp_path)
    assert not _ran(tmp_path)


@pytest.mark.parametrize("line", [b"null", b"[]", b'{"job": "j0"}', b"\xff\xfe", b"{" * 5000])
def test_a_damaged_journal_costs_what_is_damaged(line: bytes, tmp_path: Path) -> None:
    _run(_jobs((), ()), tmp_path)
    _ran(tmp_path)
    with (tmp_path / "out" / NAME).open("ab") as file:
        file.write(line + b"\n")
    _run(_jobs((), ()), tmp_path)
    assert not _ran(tmp_path)


def test_two_batches_cannot_share_a_folder(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    with (
        open_journal(tmp_path / "out"),
        pytest.raises(OutputError, match="another batch is writing"),
    ):
        _run(_jobs(()), tmp_path)
    assert not _ran(tmp_path)


def test_a_file_written_just_before_a_kill_is_known(tmp_path: Path) -> None:
    _run(_jobs((), ()), tmp_path)
    journal = tmp_path / "out" / NAME
    claimed, *finished = journal.read_bytes().splitlines(keepends=True)
    assert len(finished) == 2
    journal.write_bytes(claimed)  # both files are there, and neither job is known to have ended
    _ran(tmp_path)
    assert [o.exit for o in _run(_jobs((), ()), tmp_path)] == [0, 0]
    assert _ran(tmp_path) == ["j0", "j1"]


def test_lines_that_are_damaged_are_left_out_and_counted(tmp_path: Path) -> None:
    said: list[str] = []
    _run(_jobs((), (), ()), tmp_path, warn=said.append)
    assert said == []
    _ran(tmp_path)
    journal = tmp_path / "out" / NAME
    claimed, *finished = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"\0" + claimed[1:] + b"".join(finished[:2]))
    kept = {name for name in ("j0", "j1", "j2") if name in b"".join(finished[:2]).decode()}
    found = _run(_jobs((), (), ()), tmp_path, warn=said.append)
    (text,) = said
    assert text.startswith("1 of 3 lines of ")
    assert "somebody else's" in text
    (other,) = {"j0", "j1", "j2"} - kept
    assert [o.exit for o in found] == [2 if o.job == other else 0 for o in found]
    assert _ran(tmp_path) == [other]  # the others are known to have ended


def test_files_of_somebody_else_are_kept(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "j0.yaml").touch()
    assert [o.exit for o in _run(_jobs((), ()), tmp_path)] == [2, 0]
    assert [o.exit for o in _run(_jobs((), ()), tmp_path, again=True)] == [0, 0]
