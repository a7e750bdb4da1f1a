# ruff: noqa: T201 (it prints its table)
"""Run everything, compare with the committed table, say which rows are worse."""

from __future__ import annotations

import argparse
import platform
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

from . import bench_problems, measured, readme, timing
from .command import PROGRAM, ROOT
from .compare import Judgement, compare, load, markdown, save, summary
from .figures import Figure
from .task import Task

COMMITTED = Path(__file__).with_name("committed.json")
PAGE = ROOT / "docs" / "evidence" / "acceptance.md"
WORKERS = 2
GROUPS = (readme.GROUP, bench_problems.GROUP, *measured.GROUPS, timing.GROUP)
_EXPLAINED = """\
# Headline figures

Written by `make acceptance ACCEPTANCE=--write`. `make acceptance` runs all of it again, with the
installed command line only, prints this table with what it saw, and fails where a row is worse
than the committed value by more than its noise.

- `truth` is what made the logs of `datasets/` and of the benchmark's problems; `published` and
  `certified` values belong to logs that others measured, which are no part of this repository
  (their rows are skipped where the logs are missing).
- `(+0.43 se)` is the distance from the reference in standard errors. An estimate is worse when
  it is farther from its reference by more than a tenth of the committed standard error, or its
  standard error has grown by more than a tenth.
- `wrong today`: the row misses its reference and did so when the table was written. It does not
  fail the run; mending it is reported as `better`.
- `moved`: changed by more than the noise, no farther from the reference.
- `did not end in 120 s`: of processor time.
- Times are ratios to those of a process that imports numpy and scipy and computes for
  as long again, in the same run (`studies/acceptance/timing.py`).
"""


def main() -> int:
    """Return 1 when a row is worse."""
    given = _arguments()
    groups = given.only or list(GROUPS)
    skipped = {group: "not asked for" for group in GROUPS if group not in groups}
    for group in measured.GROUPS:
        if not (given.data / group).is_dir():
            skipped[group] = "its logs are not there"
    if timing.GROUP in skipped or "emps" in skipped:
        skipped[timing.MEASURED] = "not measured"
    if not PROGRAM.exists():
        print(f"fluidact-fit is not installed beside {sys.executable}", file=sys.stderr)
        return 2
    began = time.perf_counter()
    seen = _run([g for g in groups if g not in skipped], given.data)
    committed = seen if given.write else load(COMMITTED)
    judgements = compare(committed, seen, skipped)
    print("\n".join(markdown(judgements)))
    print()
    print("\n".join(summary(judgements)))
    print(f"{time.perf_counter() - began:.0f} s", file=sys.stderr)
    if given.write:
        _write(seen, judgements)
    return int(any(judgement.word == "worse" for judgement in judgements))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write the committed table anew")
    parser.add_argument("--only", nargs="+", choices=GROUPS, metavar="GROUP",
                        help=f"run some groups alone: {', '.join(GROUPS)}")  # fmt: skip
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data",
                        help="logs that others measured (default: %(default)s)")  # fmt: skip
    given = parser.parse_args()
    missing = [g for g in measured.GROUPS if not (given.data / g).is_dir()]
    if given.write and (given.only or missing):
        parser.error("--write needs everything: no --only, and the measured logs")
    given.data = given.data.resolve()
    return given


def _run(groups: Sequence[str], data: Path) -> list[Figure]:
    """All rows of the groups: figures two at a time, then the times alone."""
    every = [*readme.tasks(), *bench_problems.tasks(), *measured.tasks(data)]
    tasks = [task for task in every if task.group in groups]
    with TemporaryDirectory(prefix="acceptance-") as name:
        folder = Path(name)
        with ThreadPoolExecutor(WORKERS) as pool:
            dear_first = sorted(tasks, key=lambda task: -task.seconds)
            begun = {id(task): pool.submit(_one, task, folder) for task in dear_first}
            figures = [figure for task in tasks for figure in begun[id(task)].result()]
        if timing.GROUP in groups:
            figures += timing.figures(data, folder)
    return figures


def _one(task: Task, folder: Path) -> list[Figure]:
    """Rows of a task, in a folder of its own."""
    own = folder / f"{task.group} {task.name}"
    own.mkdir()
    began = time.perf_counter()
    figures = task.figures(own)
    spent = time.perf_counter() - began
    print(f"{task.group}, {task.name}: {spent:.0f} s", file=sys.stderr, flush=True)
    return figures


def _write(seen: Sequence[Figure], judgements: Sequence[Judgement]) -> None:
    save(COMMITTED, seen)
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "casadi"))
    made = f"Python {platform.python_version()}, {packages}."
    table = "\n".join(markdown(judgements))
    PAGE.write_text(f"{_EXPLAINED}\n{made}\n\n{table}\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
