# ruff: noqa: T201 (it prints its table)
"""What the examinations of a fit cost in processor time, against the last commit without them.

    python studies/vigilance_price.py [--pairs N] [--write]

The command of every dataset's README is run as a whole process, now and as it was, in turn; the
median of the ratios counts. The commit is checked out into a folder of its own. ``--write`` writes
``docs/evidence/vigilance-price.md``.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import shlex
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "evidence" / "vigilance-price.md"
BEFORE = "ae15765"  # the last commit before the examinations
_EXPLAINED = """\
# What vigilance costs in time

Written by `studies/vigilance_price.py --write`: processor time of the whole command of every
dataset's README, imports included, now over that at commit `ae15765`, the last one before the
examinations. Both are run in turn; the median of the ratios counts. The limit that was set is 1.5.

| dataset | before [s] | now [s] | ratio | least and largest of the pairs |
|---|---|---|---|---|
"""


def command(dataset: Path, out: Path) -> list[str]:
    """The words of the README's fit behind the name of the program."""
    found = re.search(r"fluidact-fit (.+?)\n```", (dataset / "README.md").read_text(), re.DOTALL)
    assert found is not None
    words = shlex.split(found[1].replace("\\\n", " "))
    at = words.index("-o")
    return [*words[:at], "-f", "-o", str(out), *words[at + 2 :]]


def seconds(checkout: Path, words: list[str]) -> float:
    """Processor time of a fit by the code of a checkout [s]."""
    path = os.pathsep.join(str(checkout / part) for part in ("sysid", "cli"))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, "-m", "fluidact_fit_cli.main", *words],
        cwd=ROOT, env={**os.environ, "PYTHONPATH": path}, check=True, capture_output=True,
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def measure(old: Path, out: Path, pairs: int) -> list[str]:
    """A row of the table for every dataset."""
    rows = []
    for dataset in sorted(p.parent for p in (ROOT / "datasets").glob("*/README.md")):
        words = command(dataset, out / f"{dataset.name}.yaml")
        seconds(ROOT, words), seconds(old, words)  # what is compiled first
        times = [(seconds(old, words), seconds(ROOT, words)) for _ in range(pairs)]
        ratios = [now / before for before, now in times]
        before, now = (statistics.median(x) for x in zip(*times))
        rows.append(f"| {dataset.name} | {before:.2f} | {now:.2f} | {statistics.median(ratios):.2f}"
                    f" | {min(ratios):.2f}, {max(ratios):.2f} |")  # fmt: skip
        print(rows[-1], file=sys.stderr, flush=True)
    return rows


def main() -> None:
    """Measure every dataset, print or write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("--write", action="store_true", help="write the page")
    given = parser.parse_args()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # else every run would compile the program
    with tempfile.TemporaryDirectory() as folder:
        old = Path(folder) / "before"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--quiet", "--detach", str(old), BEFORE], check=True)
        try:
            page = _EXPLAINED + "\n".join(measure(old, Path(folder), given.pairs)) + "\n"
        finally:
            subprocess.run([*git, "remove", "--force", str(old)], check=True)
    if given.write:
        PAGE.write_text(page, encoding="utf-8")
    else:
        print(page)


if __name__ == "__main__":
    main()
