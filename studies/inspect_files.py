# ruff: noqa: T201 (it prints its table)
"""What ``inspect`` suggests for every file of some folders, and what comes of it.

    python studies/inspect_files.py FOLDER... [--each N] [--jobs N] [--seconds S] [--write]

Every file is given to ``fluidact-fit inspect`` as it is. The command that it prints is run as
printed, by a shell, in an empty folder. A line of the table: file, suggestion, exit status, and the
verdict or the first words of the refusal. A command with words in capitals has to be completed
first: it is not run, and the line says what it asks for. ``--each`` takes that many files of every
folder, evenly. ``--write`` writes ``docs/evidence/inspect-files.md``.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import time
from collections import Counter
from multiprocessing.pool import ThreadPool
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "evidence" / "inspect-files.md"
_DOCUMENTS = ("README.md", "LICENSE")
_MOST = 100  # characters of an outcome
_ASKED = "to be completed"
_PROGRESS = re.compile(r"\.\.\. \(\d+ s\)$")
_PAGE = """\
# What inspect suggests for files as they are

Written by `python -m studies.inspect_files {folders}{each} --write`; the files are no part of
this repository. `inspect` was given each file without an option, and the first command that it
printed was run as printed. A command with words in capitals was not run: the log does not tell what
they stand for, and the table says what has to be given. *s* is the time of `inspect`.

{count} files{sampled}: {summary}.

{table}
"""
_HEAD = "| file | suggestion | outcome | s |\n|---|---|---|---|"


class Row(NamedTuple):
    """What became of one file."""

    file: str
    suggestion: str
    outcome: str
    seconds: float


def examine(folder: Path, path: Path, seconds: float) -> Row:
    """Inspect a file, and run what is suggested."""
    began = time.monotonic()
    status, out, err = _run(["fluidact-fit", "inspect", str(path), "--json"], seconds)
    name = str(path.relative_to(folder.parent))
    took = time.monotonic() - began
    if status != 0:
        return Row(name, f"inspect: exit {status}", _first(err), took)
    found = json.loads(out)["suggestions"]
    if not found:
        return Row(name, "none", "", took)
    best = found[0]
    if best["candidates"]:
        families = list(dict.fromkeys(s["family"] for s in found))
        return Row(name, f"one of {len(families)} families", f"{_ASKED}: {best['basis']}", took)
    suggestion = f"{best['family']} ({best['verdict'] or 'not tried'})"
    if best["asked"]:
        return Row(name, suggestion, f"{_ASKED}: {', '.join(best['asked'])}", took)
    status, out, err = _run(["sh", "-c", best["command"]], seconds)
    verdict = next((line.rsplit("verdict ")[-1] for line in out.splitlines()
                    if "verdict " in line), "")  # fmt: skip
    outcome = f"exit {status}: {verdict if status == 0 else _first(err)}"
    return Row(name, suggestion, outcome, took)


def _run(words: list[str], seconds: float) -> tuple[int, str, str]:
    """Exit status, output and messages, in a folder that is empty."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    with TemporaryDirectory(prefix="inspect-files-") as folder:
        try:
            done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False,
                                  timeout=seconds, env={**os.environ, "PATH": path})  # fmt: skip
        except subprocess.TimeoutExpired:
            return 124, "", f"stopped after {seconds:g} s"
    return done.returncode, done.stdout, done.stderr


def _first(text: str) -> str:
    """The line of an error, without notes and warnings before it."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    told = [line for line in lines
            if not line.startswith(("note", "warning")) and not _PROGRESS.search(line)]  # fmt: skip
    return (told or lines or [""])[0][:_MOST]


def main() -> int:
    """Print the table; 1 where a command neither ran nor was refused with a reason."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--each", type=int, metavar="N", help="files of a folder at most")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=120.0, help="for each command")
    parser.add_argument("--write", action="store_true", help=f"write {PAGE.relative_to(ROOT)}")
    given = parser.parse_args()
    tasks = [(folder.resolve(), path) for folder in given.folders
             for path in chosen_files(folder.resolve(), given.each)]  # fmt: skip
    print(_HEAD, flush=True)
    lines, count = [], Counter[str]()
    with ThreadPool(given.jobs) as pool:
        for row in pool.imap(lambda task: examine(*task, given.seconds), tasks):
            lines.append(f"| {row.file} | {row.suggestion} | {row.outcome} | {row.seconds:.1f} |")
            print(lines[-1], flush=True)
            count[row.outcome.split(":")[0] if ":" in row.outcome else row.suggestion] += 1
    summary = ", ".join(f"{n} {what}" for what, n in count.most_common())
    print(f"\n{len(tasks)} files: {summary}")
    if given.write:
        each = f" --each {given.each}" if given.each else ""
        sampled = f" (at most {given.each} of each folder)" if given.each else ""
        folders = " ".join(folder.name for folder in given.folders)
        table = "\n".join([_HEAD, *lines])
        page = _PAGE.format(count=len(tasks), summary=summary, table=table, each=each,
                            sampled=sampled, folders=folders)  # fmt: skip
        PAGE.write_text(page, encoding="utf-8")
    return int(bool(count["exit 1"] or count["exit 124"] or count["none"]))


def chosen_files(folder: Path, each: int | None) -> list[Path]:
    """Return the files below a folder, of each folder at most so many, evenly spread."""
    by_folder: dict[Path, list[Path]] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.name not in _DOCUMENTS:
            by_folder.setdefault(path.parent, []).append(path)
    return [path for files in by_folder.values()
            for path in files[:: -(-len(files) // (each or len(files)))]]  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
