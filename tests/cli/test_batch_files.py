"""A batch among files of others: it replaces none of them, and says which job would."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from fluidact_fit.batch.journal import NAME
from hanging import ended_after

Log = Callable[..., Path]
Run = Callable[..., Any]
_FINISHED: dict[str, bytes] = {}
posix = pytest.mark.skipif(os.name != "posix", reason="POSIX links, devices and pipes")


@pytest.fixture(autouse=True)
def patience() -> Iterator[None]:
    """End a test that waits for ever."""
    with ended_after(120):
        yield


def _jobs(folder: Path, *rows: tuple[str, str, str], name: str = "jobs.csv") -> Path:
    with (folder / name).open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(("job", "family", "logs", "options"))
        table.writerows((job, "valve", logs, options) for job, logs, options in rows)
    return folder / name


def _content(folder: Path) -> Mapping[str, bytes]:
    return {str(p): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def _summary(folder: Path) -> dict[str, dict[str, str]]:
    with (folder / "summary.csv").open(encoding="utf-8", newline="") as file:
        return {row["job"]: row for row in csv.DictReader(file)}


@posix
@pytest.mark.parametrize("trap", [
    "records", "parameter file", "list of jobs", "summary", "page", "hard link", "link", "case",
    "merged", "validation", "journal", "folder",
])  # fmt: skip
def test_a_batch_that_would_replace_what_it_reads(
    trap: str, inside: Path, valve: Log, here: Run
) -> None:
    (inside / "logs").mkdir()
    valve("logs/u1.txt")
    log, options, out, name = "logs/u1.txt", "", "out", "jobs.csv"
    (inside / "out" / "logs").mkdir(parents=True)
    if trap == "records":
        out = "."
    elif trap == "parameter file":
        valve("out/u1.yaml")
        log = "out/u1.yaml"
    elif trap == "list of jobs":
        out, name, log = ".", "summary.csv", "v.csv"
        valve("v.csv")
    elif trap == "summary":
        valve("out/summary.csv")
        log = "out/s*.csv"
    elif trap == "page":
        log = "out/index.html"
        valve(log)
    elif trap == "hard link":
        os.link(log, "out/u1.yaml")
    elif trap == "link":
        os.symlink("../logs/u1.txt", "out/summary.parquet")
    elif trap == "case":
        log = "out/logs/U1.TXT"
        valve(log)
    elif trap == "merged":
        valve("a.csv")
        log = "a.csv+out/u1.yaml"
        valve("out/u1.yaml")
    elif trap == "validation":
        valve("out/u1.yaml")
        options = "--validate=out/u1.yaml"
    elif trap == "journal":
        os.symlink("../logs/u1.txt", "out/journal.jsonl")
    elif trap == "folder":
        (inside / "out" / "logs").rmdir()
        os.symlink("../logs", "out/logs")
    _jobs(inside, ("u1", log, options), name=name)
    before = _content(inside)
    for more in ([], ["--force"]):
        done = here("batch", name, "-o", out, "--workers", "1", *more)
        assert done.status == 2, done.err
        assert "read by" in done.err or "is not from a batch" in done.err
        assert _content(inside) == before


def test_pictures_that_jobs_name(inside: Path, valve: Log, apart: Run) -> None:
    valve("v.csv")
    valve("w.csv", seed=2)
    (inside / "mine.png").write_text("mine", encoding="utf-8")
    _jobs(
        inside,
        ("alone", "v.csv", "--plot alone.png"),
        ("one", "v.csv", "--plot same.svg"),
        ("two", "w.csv", "--plot ./x/../SAME.svg"),
        ("mine", "v.csv", "--plot mine.png"),
        ("log", "v.csv", "--validate w.csv --report out/../w.csv -f"),
        ("page", "v.csv", "--report out/index.html"),
        ("other", "v.csv", "--report out/logs/alone.txt --accept-failed"),
        ("asked", "w.csv", "--plot asked.png -f"),
    )
    (inside / "asked.png").write_text("mine", encoding="utf-8")
    before = _content(inside)
    said = {
        "one": "written by job two as well", "two": "written by job one as well",
        "mine": "already exists", "log": "", "page": "a file of this batch", "other": "",
    }  # fmt: skip
    for _ in range(2):
        done = apart("batch", "jobs.csv", "-o", "out", "--workers", "2", cwd=inside)
        assert done.status == 0, done.err
        found = _summary(inside / "out")
        for job, text in said.items():
            assert found[job]["exit"] == "2", found[job]
            assert text in found[job]["message"]
        assert {job for job in found if found[job]["exit"] == "0"} == {"alone", "asked"}
        after = _content(inside)
        assert all(after[p] == c for p, c in before.items() if not p.endswith("asked.png"))
        assert not (inside / "same.svg").exists()
    records = {p.stem for p in (inside / "out" / "logs").iterdir()}
    assert records == {*found}


def test_a_picture_is_made_again_and_costs_no_run(inside: Path, valve: Log, apart: Run) -> None:
    valve("v.csv")
    _jobs(inside, ("u", "v.csv", "--report u.html"))
    words = ("batch", "jobs.csv", "-o", "out", "--workers", "1")
    assert apart(*words, cwd=inside).status == 0
    first = (inside / "u.html").stat().st_mtime_ns
    assert apart(*words, cwd=inside).status == 0
    assert (inside / "u.html").stat().st_mtime_ns == first
    (inside / "u.html").unlink()
    assert apart(*words, cwd=inside).status == 0
    assert (inside / "u.html").exists()


def test_what_a_batch_wrote_is_no_log(inside: Path, valve: Log, apart: Run) -> None:
    for k in range(2):
        valve(f"u{k}.csv", seed=k)
    words = ("batch", "--family", "valve", "--logs", "**/*", "-o", "out", "--workers", "1")
    assert apart(*words, cwd=inside).status == 0
    first = _summary(inside / "out")
    valve("u2.csv", seed=5)
    done = apart(*words, cwd=inside)
    assert done.status == 0, done.err
    assert {*_summary(inside / "out")} == {*first, "u2"}
    (inside / "out" / "mine.csv").write_bytes((inside / "u0.csv").read_bytes())
    assert apart(*words, cwd=inside).status == 0
    assert "out_mine" in _summary(inside / "out")


def test_names_of_logs_are_no_options(inside: Path, valve: Log, apart: Run) -> None:
    valve("u.csv")
    valve("--scale=outlet=-3", seed=2)
    valve("-o", seed=3)
    _jobs(inside, ("all", "*u.csv;-*", ""), ("list", "--strict", ""), ("end", "u.csv", "-- x"),
          ("lacks", "u.csv", "--validate"), ("hidden", "u.csv", "-qo elsewhere.yaml"))  # fmt: skip
    before = _content(inside)
    done = apart("batch", "jobs.csv", "-o", "out", "--workers", "1", cwd=inside)
    assert done.status == 0, done.err
    found = _summary(inside / "out")
    assert [found[job]["exit"] for job in found] == ["0", "3", "2", "2", "2"]
    assert float(found["all"]["gain"]) == pytest.approx(1000.0, rel=0.01)
    assert {p.name for p in inside.iterdir()} == {Path(p).name for p in before} | {"out"}


@posix
@pytest.mark.parametrize(("place", "kind"), [
    ("v.csv", "pipe"), ("v.csv", "loop"), ("v.csv", "device"), ("u.png", "pipe"),
    ("out/u.yaml", "pipe"), ("out/u.yaml", "loop"), ("out/u.yaml", "device"),
    ("out/logs/u.txt", "pipe"), ("out/summary.csv", "pipe"), ("out/journal.jsonl", "pipe"),
    ("out/journal.jsonl", "device"), ("out/index.html", "loop"),
])  # fmt: skip
def test_only_regular_files(
    place: str, kind: str, inside: Path, valve: Log, here: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    valve("w.csv")
    (inside / "out" / "logs").mkdir(parents=True)
    _jobs(inside, ("u", "v.csv w.csv".replace(" ", ";"), "--plot u.png"))
    if kind == "pipe":
        os.mkfifo(place)
    else:
        os.symlink(inside / place if kind == "loop" else "/dev/zero", place)
    done = here("batch", "jobs.csv", "-o", "out", "--workers", "1", "-f")
    if place in ("v.csv", "u.png"):
        assert done.status == 0, done.err
        assert _summary(inside / "out")["u"]["exit"] in ("2", "3")
    else:
        assert done.status == 2
        assert "not a regular file" in done.err


@pytest.mark.parametrize(
    "how",
    ["number", *(pytest.param(how, marks=pytest.mark.slow)
                 for how in ("type", "parameter file", "cut", "lost", "swapped"))],
)  # fmt: skip
def test_a_journal_is_not_believed_blindly(how: str, inside: Path, valve: Log, apart: Run) -> None:
    words = ("batch", "jobs.csv", "-o", "out", "--workers", "1")
    if not _FINISHED:  # a finished batch is the same wherever it is put
        for k in range(3):
            valve(f"v{k}.csv", seed=k)
        _jobs(inside, *((f"u{k}", f"v{k}.csv", "") for k in range(3)))
        assert apart(*words, cwd=inside).status == 0
        _FINISHED.update({str(Path(p).relative_to(inside)): b for p, b in _content(inside).items()})
    for name, content in _FINISHED.items():
        (inside / name).parent.mkdir(parents=True, exist_ok=True)
        (inside / name).write_bytes(content)
    out = inside / "out"
    summary, file = (out / "summary.csv").read_bytes(), (out / "u1.yaml").read_text()
    head, *lines = (out / NAME).read_text(encoding="utf-8").splitlines()
    at = next(k for k, line in enumerate(lines) if json.loads(line)["job"] == "u1")
    entry = json.loads(lines[at])
    if how == "number":
        value = repr(entry["parameters"]["gain"]["value"])
        changed = value.replace(value[-1], "1" if value[-1] != "1" else "2")
        assert changed != value
        lines[at] = lines[at].replace(value, changed)
    elif how == "type":
        lines[at] = json.dumps({**entry, "warnings": 3, "message": ["x"]})
    elif how == "cut":
        lines[at] = lines[at][:90]
    elif how == "lost":
        del lines[at]
    elif how == "swapped":
        lines[at] = lines[at].replace('"u1"', '"u2"')
    else:
        (out / "u1.yaml").write_text(file.replace("valve", "volve"))
    (out / NAME).write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
    done = apart(*words, cwd=inside)
    assert done.status == 0, done.err
    assert (out / "summary.csv").read_bytes() == summary
    if how == "parameter file":
        assert "u1.yaml" in done.err
        assert "volve" not in (out / "u1.yaml").read_text()
    elif how != "lost":
        assert "1 of 4 lines" in done.err
    assert apart(*words, cwd=inside).err.count("warning") == (how not in ("lost", "parameter file"))


def test_the_journal_of_another_program_is_kept(inside: Path, valve: Log, here: Run) -> None:
    valve("v.csv")
    _jobs(inside, ("u", "v.csv", ""))
    (inside / "out").mkdir()
    (inside / "out" / NAME).write_text('{"day": 1}\n{"day": 2}\n', encoding="utf-8")
    done = here("batch", "jobs.csv", "-o", "out", "--workers", "1")
    assert done.status == 2
    assert "is not the journal of a batch" in done.err
    assert (inside / "out" / NAME).read_text(encoding="utf-8").count("day") == 2


@pytest.mark.parametrize("out", ["loop", "loop/deeper"])
def test_a_loop_of_links_is_no_folder(out: str, inside: Path, valve: Log, here: Run) -> None:
    valve("v.csv")
    _jobs(inside, ("u", "v.csv", ""))
    os.symlink("loop", "loop")
    done = here("batch", "jobs.csv", "-o", out, "--workers", "1")
    assert done.status == 2
    assert "Give another folder with -o" in done.err
    assert "Written before" not in done.err
