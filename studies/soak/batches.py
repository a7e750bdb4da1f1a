"""Lists of jobs and journals that are damaged, batches that are killed or run out of disk.

A batch that was disturbed and run again has to end with the summary of one that was not, and with
every job finished once.
"""

from __future__ import annotations

import csv
import json
import os
import random
import shlex
import signal
import subprocess
import time
from collections import Counter
from functools import cache
from pathlib import Path

import yaml

from fluidact_fit import FluidactError
from fluidact_fit.batch import read_jobs
from fluidact_fit.batch.journal import NAME

from . import program
from .case import LONGEST, WRONG, Case, Part, Result
from .processes import PATIENCE, PROGRAM, small_disk, start, wait

_JOBS = 6
_ROWS = 60
_TEXTS = ("", " ", "..", "../x", "/etc/passwd", "a\x1b[2J", "\0", "nul", "x" * 300, "-", "*", "[",
          "'", '"', "a;b;;c", "=1+1", "-o x", "--json", "\u202e", "ü" * 200, "1e999")  # fmt: skip


def job_file(case: Case) -> Result:
    """Read a damaged list of jobs: it is a list, or refused in a few words."""
    name = case.rng.choice(("jobs.csv", "jobs.yaml"))
    path = Path(name)
    path.write_bytes(_damaged(_table(name, case.rng), case.rng))
    case.tell(name)
    result = Result("read")
    try:
        jobs = read_jobs(path)
    except FluidactError as error:
        result.outcome, result.message = "refused", str(error)
        if len(str(error)) > LONGEST or not error.remedy:
            result.fail(WRONG, "a message without an end, or without what to do")
        return result
    folder = Path.cwd()
    for job in jobs:
        if (folder / f"{job.name}.yaml").resolve().parent != folder:
            result.fail(WRONG, f"the file of {job.name!r} would be elsewhere")
    return result


def _table(name: str, rng: random.Random) -> bytes:
    rows = [
        {"job": f"j{k}", "family": "line", "logs": f"u{k}.csv;v{k}*.csv", "options": "--strict"}
        for k in range(rng.randint(1, 5))
    ]  # fmt: skip
    for _ in range(rng.randint(0, 3)):
        rng.choice(rows)[rng.choice(("job", "family", "logs", "options"))] = rng.choice(_TEXTS)
    if name.endswith("yaml"):
        return yaml.safe_dump(rows, allow_unicode=True).encode("utf-8", "surrogatepass")
    lines = [",".join(rows[0])]
    lines += [",".join(json.dumps(v, ensure_ascii=False) for v in row.values()) for row in rows]
    return "\n".join(lines).encode()


def _damaged(content: bytes, rng: random.Random) -> bytes:
    data = bytearray(content)
    for _ in range(rng.choice((0, 0, 1, 1, 3, 30))):
        k = rng.randrange(len(data) + 1)
        if rng.random() < 0.5:
            data[k:k] = rng.choice((b",", b'"', b"\n", b"\0", b"\xff", b": ", b"- ", b"&a ", b"*a"))
        else:
            del data[k : k + rng.choice((1, 1, 10))]
    return bytes(data)


def _fleet() -> list[str]:
    """Write logs, one of them broken, and their table; returns the words of the batch."""
    options = shlex.join(program.arguments("line"))
    for k in range(_JOBS):
        program.write_log("line", Path(f"u{k}.csv"), _ROWS + 10 * k)
    Path("u2.csv").write_text("broken\n", encoding="utf-8")
    with Path("jobs.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(("job", "family", "logs", "options"))
        table.writerows((f"u{k}", "line", f"u{k}.csv", options) for k in range(_JOBS))
    return [*PROGRAM, "batch", "jobs.csv", "--workers", "2", "-q", "-o"]


@cache
def _undisturbed() -> tuple[bytes, float]:
    """Summary of a batch that is let alone, and how long it takes."""
    words = _fleet()
    began = time.perf_counter()
    subprocess.run([*words, "alone"], check=True, capture_output=True)
    return Path("alone", "summary.csv").read_bytes(), time.perf_counter() - began


def _finished(out: Path) -> Counter[str]:
    journal = out / NAME
    lines = journal.read_bytes().split(b"\n") if journal.exists() else []
    found = []
    for line in lines:
        try:
            entry = json.loads(line)
        except ValueError:
            continue
        if entry.get("lasting"):
            found.append(entry["job"])
    return Counter(found)


def _compare(out: Path, result: Result) -> None:
    """Run the batch once more, undisturbed, and judge what is there then."""
    summary, _ = _undisturbed()
    words = _fleet()
    done = subprocess.run([*words, str(out)], capture_output=True, text=True, check=False)
    if done.returncode:
        result.fail(WRONG, f"run again: exit status {done.returncode}: {done.stderr[-300:]}")
        return
    if (out / "summary.csv").read_bytes() != summary:
        result.fail(WRONG, "run again: another summary")
    if _finished(out) != Counter(f"u{k}" for k in range(_JOBS)):
        result.fail(WRONG, f"jobs finished: {dict(_finished(out))}")
    left = [p.name for p in out.rglob(".fluidact-*")]
    if left:
        result.fail(WRONG, f"left behind: {', '.join(left)}")


def kill(case: Case) -> Result:
    """Kill a batch, all of it or the first process alone, at any instant; then run it again."""
    _, whole = _undisturbed()
    words = _fleet()
    result, out = Result(""), Path("out")
    for _ in range(case.rng.randint(1, 3)):
        alone, moment = case.rng.random() < 0.5, case.rng.uniform(0.0, 1.1 * whole)
        case.tell(f"{'its first process' if alone else 'all of it'} killed after {moment:.2f} s")
        process = start([*words, str(out)], start_new_session=True)
        try:
            process.wait(moment)
        except subprocess.TimeoutExpired:
            (os.kill if alone else os.killpg)(process.pid, signal.SIGKILL)
        wait(process, case, result)
    _compare(out, result)
    return result


def journal(case: Case) -> Result:
    """Damage the journal of a finished batch, and run it again."""
    words = _fleet()
    out = Path("out")
    subprocess.run([*words, str(out)], check=True, capture_output=True)
    path = out / NAME
    content = path.read_bytes()
    how = case.rng.choice(("cut", "garbled", "line lost", "strange line", "digit", "type"))
    case.tell(how)
    lines = content.splitlines(keepends=True)
    # but for the first, without which files are no longer known as the batch's own
    at, first = case.rng.randrange(1, len(lines)), len(lines[0])
    if how == "cut":
        content = content[: case.rng.randrange(first, len(content))]
    elif how == "garbled":
        k = case.rng.randrange(first, len(content))
        content = content[:k] + case.rng.randbytes(4) + content[k + 4 :]
    elif how == "line lost":
        content = b"".join(lines[:at] + lines[at + 1 :])
    elif how == "digit":
        places = [k for k in range(first, len(content)) if content[k : k + 1].isdigit()]
        k = case.rng.choice(places)
        content = content[:k] + str((content[k] - 47) % 10).encode() + content[k + 1 :]
    elif how == "type":
        entry = json.loads(lines[at])
        name = case.rng.choice(sorted(entry))
        entry[name] = case.rng.choice((None, 1, "x", [], {}, [1], True, 1.5))
        content = b"".join([*lines[:at], json.dumps(entry).encode() + b"\n", *lines[at + 1 :]])
    else:
        strange = (b"{}", b"null", b'{"job": []}', b"[" * 3000, b'{"job": "u1", "exit": "x"}')
        content += case.rng.choice(strange) + b"\n"
    path.write_bytes(content)
    result = Result(how)
    done = subprocess.run([*words, str(out)], capture_output=True, text=True, check=False)
    result.message = done.stderr
    if done.returncode:
        result.fail(WRONG, f"exit status {done.returncode}: {done.stderr[-300:]}")
    elif (out / "summary.csv").read_bytes() != _undisturbed()[0]:
        result.fail(WRONG, "another summary")
    return result


def disk(case: Case) -> Result:
    """Let the disk fill up on the way, make room, and run the batch again."""
    result = Result("")
    with small_disk(case.rng) as (place, limit, what):
        case.tell(what)
        words = _fleet()
        out = place / "out"
        process = start([*words, str(out)], preexec_fn=limit)
        wait(process, case, result)
        if process.returncode not in (0, 3):
            result.fail(WRONG, f"exit status {process.returncode}")
        saved = Path("saved")
        subprocess.run(["cp", "-r", str(out), str(saved)], check=False, capture_output=True)
    saved.mkdir(exist_ok=True)
    _compare(saved, result)
    return result


def two(case: Case) -> Result:
    """Start two batches on one folder: one works, the other is refused or finds all done."""
    words = _fleet()
    result, out = Result(""), Path("out")
    first = start([*words, str(out)])
    time.sleep(case.rng.uniform(0.0, 3.0))
    second = start([*words, str(out)])
    case.tell("two batches on one folder")
    ended = []
    for process in (first, second):
        wait(process, case, result)
        ended.append(process.returncode)
    result.outcome = " and ".join(map(str, sorted(ended)))
    if sorted(ended) not in ([0, 0], [0, 3]):
        result.fail(WRONG, f"exit statuses {ended}")
    _compare(out, result)
    return result


PARTS = (
    Part("jobs", "damaged lists of jobs", 5000, job_file),
    Part("journal", "damaged journals", 60, journal, **PATIENCE),
    Part("batch-kill", "killed batches", 250, kill, **PATIENCE),
    Part("batch-disk", "full disks under a batch", 40, disk, **PATIENCE),
    Part("batch-two", "two batches on one folder", 20, two, **PATIENCE),
)
