"""``fluidact-fit batch`` as processes: outcomes, resuming, kills, refusals."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml

Log = Callable[..., Path]
Run = Callable[..., Any]
PROGRAM = [sys.executable, "-m", "fluidact_fit_cli.main", "batch"]


@pytest.fixture
def fleet(valve: Log, tmp_path: Path) -> Path:
    """A table of jobs: two that can be fitted, and four ways in which one cannot."""
    for k in range(3):
        valve(f"v{k}.csv", seed=k, gain=1000.0 + k)
    (tmp_path / "broken.csv").write_text("time,command,outlet\n1,2\n", encoding="utf-8")
    (tmp_path / "jobs.csv").write_text(
        "job,family,logs,options\n"
        "two logs,valve,v0.csv;v1.csv,--window :3\n"
        "one,valve,v2*.csv,--report one.html\n"
        "broken,valve,broken.csv,\n"
        "no log,valve,none*.csv,\n"
        "unknown,valves,v0.csv,\n"
        "options,valve,v0.csv,--gainn 2\n"
        "own name,valve,v0.csv,-o elsewhere.yaml\n"
        "refused,valve,v0.csv,--window 0:0.05\n",
        encoding="utf-8",
    )
    return tmp_path


EXITS = {
    "two logs": 0, "one": 0, "broken": 3, "no log": 3, "unknown": 2, "options": 2, "own name": 2,
}  # fmt: skip


def test_every_job_has_an_outcome(fleet: Path, apart: Run) -> None:
    done = apart("batch", fleet / "jobs.csv", "-o", fleet / "out", "--workers", "2")
    assert done.status == 0, done.err
    table = pd.read_csv(fleet / "out" / "summary.csv", index_col="job")
    assert list(table.index) == [*EXITS, "refused"]
    assert table["exit"].to_dict().items() >= EXITS.items()
    assert table.loc["refused", "exit"] in (3, 4)
    assert table["gain"].notna().sum() == 2
    assert table.loc["one", "gain"] == pytest.approx(
        1002.0, abs=4 * table.loc["one", "gain_std_error"]
    )
    assert "--gainn" in table.loc["options", "message"]
    packed = pd.read_parquet(fleet / "out" / "summary.parquet").set_index("job")
    pd.testing.assert_series_equal(packed["gain"], table["gain"])
    made = {path.name for path in (fleet / "out").glob("*.yaml")}
    assert made == {"two logs.yaml", "one.yaml"}
    assert (fleet / "one.html").exists()
    assert not (fleet / "elsewhere.yaml").exists()
    records = {path.stem for path in (fleet / "out" / "logs").iterdir()}
    assert records == set(table.index)
    page = (fleet / "out" / "index.html").read_text(encoding="utf-8")
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org", "")


def test_the_files_are_those_of_the_command_line(fleet: Path, apart: Run) -> None:
    apart("batch", fleet / "jobs.csv", "-o", fleet / "out")
    words = ("valve", "v0.csv", "v1.csv", "--window", ":3", "-o", "two logs.yaml")
    assert apart(*words, cwd=fleet).status == 0
    files = (fleet / "two logs.yaml", fleet / "out" / "two logs.yaml")
    one, other = (yaml.safe_load(path.read_text(encoding="utf-8")) for path in files)
    for document in (one, other):
        document["provenance"].pop("created")
    assert one == other


def test_strict_tells_of_failed_jobs(fleet: Path, apart: Run) -> None:
    done = apart("batch", fleet / "jobs.csv", "-o", fleet / "out", "--strict")
    assert done.status == 4
    assert "6 of 8 jobs" in done.err
    assert (fleet / "out" / "summary.csv").exists()


def test_jobs_from_the_names_of_logs(valve: Log, tmp_path: Path, apart: Run) -> None:
    for k in range(2):
        for seed, trial in enumerate("ab"):
            valve(f"unit{k}_{trial}.csv", seed=2 * k + seed)
    words = ("--family", "valve", "--logs", "unit*.csv", "--group-by", "unit{job}_*.csv")
    done = apart("batch", *words, "--options", "--window :3", "-o", "out", cwd=tmp_path)
    assert done.status == 0, done.err
    document = yaml.safe_load((tmp_path / "out" / "1.yaml").read_text(encoding="utf-8"))
    assert [log["file"] for log in document["provenance"]["logs"]] == ["unit1_a.csv", "unit1_b.csv"]


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ((), "there are no jobs"),
        (("jobs.csv", "--family", "valve"), "JOBS lists them already"),
        (("jobs.csv", "--scheduler", "tcp://x:1", "--workers", "2"), "brings its own workers"),
        (("none.csv",), "none.csv: cannot be read"),
        (("jobs.csv", "--scheduler", "nowhere"), "cannot be used"),
    ],
)
def test_a_batch_that_cannot_be(
    words: tuple[str, ...], found: str, fleet: Path, inside: Path, here: Run
) -> None:
    done = here("batch", *words, "-o", "out")
    assert done.status in (2, 3)
    assert found in done.err


def test_a_summary_of_somebody_else_is_kept(fleet: Path, here: Run) -> None:
    (fleet / "summary.csv").write_text("mine", encoding="utf-8")
    done = here("batch", fleet / "jobs.csv", "-o", fleet)
    assert done.status == 2
    assert "already exists" in done.err
    assert (fleet / "summary.csv").read_text(encoding="utf-8") == "mine"


def test_a_parameter_file_of_somebody_else_is_kept(fleet: Path, apart: Run) -> None:
    (fleet / "out").mkdir()
    (fleet / "out" / "one.yaml").write_text("mine", encoding="utf-8")
    assert apart("batch", fleet / "jobs.csv", "-o", fleet / "out").status == 0
    assert (fleet / "out" / "one.yaml").read_text(encoding="utf-8") == "mine"
    table = pd.read_csv(fleet / "out" / "summary.csv", index_col="job")
    assert "already exists" in table.loc["one", "message"]
    assert "Give batch --force to replace it" in table.loc["one", "message"]
    (fleet / "out" / "one.yaml").unlink()
    (fleet / "one.html").unlink(missing_ok=True)
    assert apart("batch", fleet / "jobs.csv", "-o", fleet / "out").status == 0
    table = pd.read_csv(fleet / "out" / "summary.csv", index_col="job")
    assert table.loc["one", "status"] == "done"


def _finished(out: Path) -> list[str]:
    journal = out / "journal.jsonl"
    lines = journal.read_bytes().splitlines() if journal.exists() else []
    return [
        json.loads(line)["job"]
        for line in lines
        if line.startswith(b'{"job"') and line.endswith(b"}")
    ]


@dataclass(frozen=True)
class Undisturbed:
    """The words of a batch of seven jobs, without its folder, and what it gives."""

    words: list[str]
    summary: bytes


@pytest.fixture(scope="module")
def undisturbed(write_valve: Log, tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    """A batch that nobody stops, for those that are to give the same."""
    folder = tmp_path_factory.mktemp("undisturbed")
    rows = ["job,family,logs,options"]
    for k in range(7):
        write_valve(folder / f"v{k}.csv", seed=k, gain=1000.0 + 5.0 * k)
        rows.append(f"u{k},valve,v{k}.csv,")
    (folder / "jobs.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    words = [*PROGRAM, str(folder / "jobs.csv"), "--workers", "2", "-q", "-o"]
    done = subprocess.run(
        [*words, str(folder / "whole")], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return Undisturbed(words, (folder / "whole" / "summary.csv").read_bytes())


@pytest.mark.parametrize("way", [signal.SIGKILL, signal.SIGINT])
def test_killed_and_run_again(
    way: signal.Signals, undisturbed: Undisturbed, tmp_path: Path
) -> None:
    words, out = undisturbed.words, tmp_path / "out"
    process = subprocess.Popen(
        [*words, str(out)], start_new_session=True, stderr=subprocess.PIPE,
        # what started the tests may ignore it, and a batch that inherits this goes on
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    while len(_finished(out)) < 3 and process.poll() is None:
        time.sleep(0.01)
    # -9 for all of it, as a power cut; Ctrl-C for the batch, whose processes then leave too
    (os.killpg if way == signal.SIGKILL else os.kill)(process.pid, way)
    _, said = process.communicate(timeout=60)
    before = _finished(out)
    assert 3 <= len(before) < 7
    if way == signal.SIGINT:
        assert process.returncode == 130
        assert b"Interrupted" in said
        assert b"Nothing was written" not in said
    assert subprocess.run([*words, str(out)], check=False, timeout=120).returncode == 0
    assert Counter(_finished(out)) == {f"u{k}": 1 for k in range(7)}
    assert (out / "summary.csv").read_bytes() == undisturbed.summary
    assert not list(out.glob(".fluidact-*"))


def test_a_cluster_of_dask_gives_the_same(undisturbed: Undisturbed, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    done = subprocess.run(
        [*undisturbed.words, str(tmp_path), "--cluster", "local"],
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "summary.csv").read_bytes() == undisturbed.summary


def test_the_terminal_says_once_why_jobs_have_failed(apart: Run, inside: Path) -> None:
    """Three jobs of a family that there is not: "3 unusable" was all that was said."""
    rows = "".join(f"{k},nofam,none{k}.csv\n" for k in range(3))
    (inside / "jobs.csv").write_text("job,family,logs\n" + rows, encoding="utf-8")
    done = apart("batch", "jobs.csv", "-o", "out", "--workers", "1", cwd=inside)
    assert done.status == 0
    assert done.err.count("there is no model family 'nofam'") == 1
    assert "error: job 0 and 2 more: " in done.err


def test_a_family_that_does_not_exist_is_refused_before_any_job_runs(
    here: Run, inside: Path
) -> None:
    (inside / "a.csv").write_text("time,command,outlet\n", encoding="utf-8")
    done = here("batch", "--family", "valvw", "--logs", "*.csv", "-o", "out")
    assert done.status == 2
    assert "'valve' is the nearest name" in done.err
    assert not (inside / "out").exists()
