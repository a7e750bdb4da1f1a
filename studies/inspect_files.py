# ruff: noqa: T201 (it prints its table)
"""What ``inspect`` suggests for every file of some folders, and what comes of it.

    python studies/inspect_files.py FOLDER... [--jobs N] [--seconds S]

Every file is given to ``fluidact-fit inspect`` as it is. The command that it prints is run as
printed, by a shell, in an empty folder. A line of the table: file, suggestion, exit status, and the
verdict or the first words of the refusal.
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

_DOCUMENTS = ("README.md", "LICENSE")
_MOST = 100  # characters of an outcome
_PROGRESS = re.compile(r"\.\.\. \(\d+ s\)$")


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
    found = json.loads(out)["suggestions"] if status == 0 else []
    took = time.monotonic() - began
    if not found:
        text = "none" if status == 0 else f"inspect: exit {status}"
        return Row(name, text, _first(err), took)
    best = found[0]
    told = f"{best['family']} ({best['verdict'] or 'not tried'})"
    status, out, err = _run(["sh", "-c", best["command"]], seconds)
    verdict = next((line.rsplit("verdict ")[-1] for line in out.splitlines()
                    if "verdict " in line), "")  # fmt: skip
    return Row(name, told, f"exit {status}: {verdict if status == 0 else _first(err)}", took)


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
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=120.0, help="for each command")
    given = parser.parse_args()
    tasks = [(folder, path) for folder in given.folders
             for path in sorted(folder.resolve().rglob("*"))
             if path.is_file() and path.name not in _DOCUMENTS]  # fmt: skip
    count: Counter[str] = Counter()
    print("| file | suggestion | outcome | s |\n|---|---|---|---|", flush=True)
    with ThreadPool(given.jobs) as pool:
        work = pool.imap(lambda t: examine(t[0].resolve(), t[1], given.seconds), tasks)
        for row in work:
            print(f"| {row.file} | {row.suggestion} | {row.outcome} | {row.seconds:.1f} |",
                  flush=True)  # fmt: skip
            count[row.outcome.split(":")[0] if ":" in row.outcome else row.suggestion] += 1
    print(f"\n{len(tasks)} files: {', '.join(f'{n} {what}' for what, n in count.most_common())}")
    return int(bool(count["exit 1"] or count["exit 124"]))


if __name__ == "__main__":
    sys.exit(main())
