"""Folders, names and lists of jobs that are out to have a file of somebody replaced.

Whatever is asked for: no file that is read changes, no file that was there without ``--force``
either, nothing waits for a pipe or a device, and no cell of a summary is a formula.
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import json
import os
import random
import shlex
import socket
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from fluidact_fit.batch.outcome import JobResult, Task

from . import program
from .case import LOSS, WRONG, Case, Part, Result

_ROWS = 80
_NAMES = (
    "a.csv", "A.CSV", "b c.csv", "--scale=outlet=-3", "-o", "-", "-f.csv", "--force", "u1.yaml",
    "jobs.csv", "u1.txt", "summary.csv", "index.html", "journal.jsonl", "summary.parquet",
    "=cmd|'calc'!A0.csv", "+1+1.csv", "@SUM(1).csv", "it's.csv", 'x";y.csv', "[a].csv", "*.csv",
    "$(id).csv", "ünï.csv", "u\u0308.csv", "\u00fc.csv", "<img src=x onerror=alert(1)>.csv",
    "\u202egpj.csv", "a\tb.csv", "p+q.csv", "~.csv", "a=b.csv", os.fsdecode(b"raw\xff.csv"),
)  # fmt: skip
_JOBS = ("u1", "u2", "jobs", "summary", "a", "=1+1", "-5", "@x", "+x", "logs", "0017", "line")
_FOLDERS = (".", "logs", "out", "sub/out", "sub/up", "loop", "./out/../logs", "out/", "a.csv")


def _hashed(folder: Path) -> dict[str, str]:
    """Checksum of every file, by its name."""
    found = {}
    for top, _, names in os.walk(folder):
        for name in names:
            path = os.path.join(top, name)
            if os.path.isfile(path) and not os.path.realpath(path).startswith("/dev"):
                with open(path, "rb") as file:
                    found[path] = hashlib.sha256(file.read()).hexdigest()
    return found


def _furnish(rng: random.Random) -> list[str]:
    """Write logs, links, pipes and devices; returns names of logs."""
    for folder in ("logs", "out/logs", "sub"):
        os.makedirs(folder, exist_ok=True)
    places = [rng.choice(("", "logs/", "out/", "out/logs/", "sub/")) + n
              for n in rng.sample(_NAMES, 6)]  # fmt: skip
    logs = []
    for k, place in enumerate(places):
        if not os.path.lexists(place):
            program.write_log("line", Path(place), _ROWS + 10 * k)
            logs.append(place)
    rows = [r.split(",") for r in Path(logs[0]).read_text(encoding="utf-8").splitlines()]
    for name, columns in (("half1.csv", (0, 1)), ("half2.csv", (0, 2))):
        text = "".join(",".join(r[k] for k in columns) + "\n" for r in rows)
        Path(name).write_text(text, encoding="utf-8")
    logs.append("half1.csv+half2.csv")
    for _ in range(rng.randint(0, 4)):
        at = rng.choice((
            "out/u1.yaml", "out/logs/u1.txt", "out/summary.csv", "loop", "sub/up", "pic.png",
            "out/journal.jsonl", "link.csv", "u1.yaml", "pipe.csv",
        ))  # fmt: skip
        with contextlib.suppress(FileExistsError):
            _strange(at, logs, rng)
    return logs


def _strange(at: str, logs: Sequence[str], rng: random.Random) -> None:
    kind = rng.choice(("link", "hard", "pipe", "socket", "zero", "loop", "up", "mine"))
    if kind == "link":
        os.symlink(os.path.abspath(rng.choice(logs[:-1])), at)
    elif kind == "hard":
        os.link(rng.choice(logs[:-1]), at)
    elif kind == "pipe":
        os.mkfifo(at)
    elif kind == "socket":
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX) as made:
            made.bind(at)
    elif kind == "mine":
        with open(at, "x", encoding="utf-8") as file:
            file.write("mine")
    else:
        to = {"zero": "/dev/zero", "loop": os.path.basename(at), "up": ".."}[kind]
        os.symlink(to, at)


def _alias(name: str, rng: random.Random) -> str:
    """Another way to write a path."""
    return rng.choice((
        name, name, f"./{name}", os.path.abspath(name), f"sub/../{name}", name.upper(),
    ))  # fmt: skip


def output(case: Case) -> Result:
    """Ask one command to write to a name that may be anybody's."""
    rng = case.rng
    logs = _furnish(rng)
    Path("line.yaml").write_text(program.golden()["line"], encoding="utf-8")
    log = rng.choice(logs)
    target = _alias(rng.choice((*log.split("+"), *logs[:-1], "line.yaml", "link.csv", "pic.png",
                                "out/u1.yaml", "new.yaml", "loop")), rng)  # fmt: skip
    fit = ["line", *program.arguments("line")]
    words, read = rng.choice((
        ([*fit, "-o", target, "--", log], [log]),
        ([*fit, "-o", target, "--", log], [log]),
        ([*fit, "-o", "n.yaml", "--report", target, "--", log], [log]),
        ([*fit, "--validate", log, "-o", target, "--", logs[0]], [log, logs[0]]),
        (["simulate", "-o", target, "--", "line.yaml", log], ["line.yaml", log]),
        (
            ["design", "line", "--from", "line.yaml", "--duration", "1", "--sample-time", "0.05",
             "-o", target], ["line.yaml"],
        ),
        (["report", "-o", target, "--", "line.yaml"], ["line.yaml"]),
        (["export", "--to", "json", "-o", os.path.dirname(target) or ".", "--", "line.yaml"],
         ["line.yaml"]),
        (["check", "--", "line.yaml", log], ["line.yaml", log]),
        (["check-consumer", "--", "line.yaml", target], ["line.yaml", target]),
        (["compare", "--", "line.yaml", target], ["line.yaml", target]),
        (["inspect", "--", target], [target]),
    ))  # fmt: skip
    force = "-o" in words and rng.random() < 0.7
    words = [words[0], *(["-f"] if force else []), *words[1:]]
    case.tell(shlex.join(words).encode("utf-8", "backslashreplace").decode())
    before = _hashed(Path())
    ended = program.run(words)
    result = Result(str(ended.status), message=ended.err)
    program.judge(ended, result, (*program.DOCUMENTED, 5))
    kept = {os.path.realpath(p) for name in read for p in (name, *name.split("+"))}
    _judge_files(before, result, lambda path: force and os.path.realpath(path) not in kept)
    return result


def _judge_files(before: dict[str, str], result: Result, may_change: Any) -> None:
    after = _hashed(Path())
    for path, checksum in before.items():
        if after.get(path) != checksum and not may_change(path):
            how = "is lost" if path not in after else "has changed"
            result.fail(LOSS, f"{path} {how}".encode("utf-8", "backslashreplace").decode())


class _Here:
    """A pool without processes."""

    def run(self, execute: Any, tasks: Sequence[Task]) -> Iterator[JobResult]:
        """Outcomes one after the other."""
        return map(execute, tasks)


@contextlib.contextmanager
def _without_processes() -> Iterator[None]:
    from fluidact_fit_cli.commands import batch

    kept = batch._pool
    batch._pool = lambda *_: contextlib.nullcontext(_Here())
    try:
        yield
    finally:
        batch._pool = kept


def batch(case: Case) -> Result:
    """Run a list of jobs in such a folder, twice."""
    rng = case.rng
    logs = _furnish(rng)
    mine = _hashed(Path())
    jobs = _list(logs, rng)
    force = rng.random() < 0.3
    out = rng.choice(_FOLDERS)
    words = ["batch", jobs, "-o", out, *(["--force"] if force else [])]
    case.tell(f"{shlex.join(words)}: {Path(jobs).read_text(errors='backslashreplace')}")
    before = {**_hashed(Path()), **mine}
    options_force = "-f" in Path(jobs).read_text(errors="replace")
    result = Result("")
    with _without_processes():
        for _ in range(2):
            ended = program.run(words)
            result.outcome, result.message = str(ended.status), ended.err
            program.judge(ended, result, (0, 2, 3))
    read = {os.path.realpath(p) for log in logs for p in log.split("+")} | {os.path.realpath(jobs)}
    _judge_files(
        before, result,
        lambda path: (force or options_force) and os.path.realpath(path) not in read,
    )  # fmt: skip
    if ended.status == 0:
        _judge_summary(Path(out, "summary.csv"), result)
        page = Path(out, "index.html").read_text(encoding="utf-8")
        if "<img src=x" in page:
            result.fail(WRONG, "markup in the page")
    return result


def _list(logs: Sequence[str], rng: random.Random) -> str:
    """A list of jobs over these logs; every log is read by one of them."""
    columns = shlex.join(program.arguments("line"))
    names = rng.sample(_JOBS, 4)
    shares: list[list[str]] = [[] for _ in names]
    for log in logs:
        shares[rng.randrange(len(shares))].append(log)
    rows = []
    for name, share in zip(names, shares):
        more = rng.choice((
            "", "", "", "--plot pic.png", "--plot same.svg", "--report out/index.html", "-f",
            f"--report {shlex.quote(_alias(rng.choice(logs[:-1]), rng))}", "--", "-qo x.yaml",
            f"--validate {shlex.quote(rng.choice(logs))} --plot p.png -f", "--report out/u1.html",
            f"--plot {shlex.quote(name)}.png", "--validate", "--strict",
        ))  # fmt: skip
        named = share or [rng.choice(("*", "**/*.csv", "-*", "sub/**/*", "pipe.csv", "none*"))]
        rows.append({"job": name, "family": "line", "logs": named, "options": f"{columns} {more}"})
    if rng.random() < 0.5:
        path = rng.choice(("jobs.yaml", "u1.yaml", "list.yml"))
        text = json.dumps(rows, ensure_ascii=True)
        if os.path.lexists(path):
            path = "other.yaml"
        Path(path).write_text(text, encoding="utf-8")
        return path
    path = rng.choice(("list.csv", "summary.csv", "out/summary.csv", "list.csv"))
    if os.path.lexists(path):
        path = "other.csv"
    with open(path, "w", encoding="utf-8", errors="surrogateescape", newline="") as file:
        table = csv.writer(file)
        table.writerow(("job", "family", "logs", "options"))
        for row in rows:
            table.writerow((row["job"], "line", ";".join(row["logs"]), row["options"]))
    return path


def _judge_summary(path: Path, result: Result) -> None:
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            for name, cell in row.items():
                try:
                    float(cell or 0.0)
                except ValueError:
                    pass
                else:
                    continue
                if any(
                    part.lstrip()[:1] in ("=", "+", "-", "@") for part in cell.split(";") if part
                ):
                    result.fail(WRONG, f"{name} of a summary is a formula: {cell[:60]!r}")


PARTS = (
    Part("outputs", "outputs over files of anybody", 3000, output),
    Part("batch-hostile", "batches in hostile folders", 1000, batch),
)
