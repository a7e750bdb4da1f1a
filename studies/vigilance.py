"""What vigilance costs: how often good logs of the right model raise a warning.

    python studies/vigilance.py [--runs N] [--family NAME ...] [--jobs N] [--write]

Every dataset is recorded anew by its own generator (``datasets/generators``), each time with
other random numbers, and fitted as its README says; holds are not declared. A run is quiet where
the verdict is ``pass`` without any warning beyond information. The single logs P1 to P3 are
counted by ``make red-team RED_TEAM='--cells RUNS'``. ``--write`` writes
``docs/evidence/vigilance.md``.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "evidence" / "vigilance.md"
SEED = 20_261_123
_EXPLAINED = """\
# What vigilance costs

Written by `studies/vigilance.py`: the datasets recorded anew by their own generators, with other
random numbers each time, and fitted as their READMEs say. Nothing is wrong with any of them.

- `quiet`: verdict `pass` and no warning beyond information.
- `held`: how often a 95 % interval of a parameter held the truth, over all parameters.
- `time`: processor time of one fit, median.

| dataset | runs | quiet | held | time | warnings |
|---|---|---|---|---|---|
"""


@dataclass(frozen=True)
class Run:
    """What came of one recording of a dataset: warning codes, intervals that held, time [s]."""

    family: str
    codes: tuple[str, ...]
    held: tuple[bool, ...]
    seconds: float


def record_and_fit(family: str, number: int) -> Run:
    """Record a dataset with random numbers of its own and fit it."""
    sys.path.insert(0, str(ROOT / "datasets"))
    from generate import find_datasets
    from generators.writing import name_logs, write_dataset

    import fluidact_fit as ff
    from fluidact_fit.demo import Dataset
    from fluidact_fit.notices import is_note

    data = next(d for d in find_datasets() if d.family == family)
    with TemporaryDirectory(prefix="vigilance-") as folder:
        write_dataset(replace(data, seed=(SEED, number)), Path(folder))
        paths = tuple(Path(folder) / family / name for name in name_logs())
        logs = Dataset(family, paths, data.roles, data.options, {}, {}).read()
        began = time.process_time()
        try:
            found = ff.fit(family, logs, **data.options)
        except ff.FluidactError as error:
            return Run(family, (type(error).__name__,), (), time.process_time() - began)
        seconds = time.process_time() - began
    codes = tuple(sorted({n.code for n in found.notices if not is_note(n.code)}))
    if found.verdict == "fail" and not codes:
        codes = ("fail",)
    held = []
    for name, truth in data.truth.items():
        q = found.parameters.get(name)
        if q is not None and q.status == "estimated" and isinstance(truth.value, float):
            low, high = np.ravel(q.ci95)
            held.append(bool(low <= truth.value <= high))
    return Run(family, codes, tuple(held), seconds)


def row(family: str, runs: Sequence[Run]) -> str:
    """One line of the table."""
    quiet = sum(not r.codes for r in runs)
    held = [h for r in runs for h in r.held]
    codes = Counter(c for r in runs for c in r.codes).most_common(3)
    cells = (
        family, len(runs), f"{100.0 * quiet / len(runs):.1f} %",
        f"{100.0 * np.mean(held):.1f} %" if held else "",
        f"{np.median([r.seconds for r in runs]):.2f} s",
        ", ".join(f"{c} {n}" for c, n in codes),
    )  # fmt: skip
    return "| " + " | ".join(str(c) for c in cells) + " |"


def _one(task: tuple[str, int]) -> Run:
    return record_and_fit(*task)


def main() -> None:
    """Record, fit, count."""
    import fluidact_fit as ff

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--family", nargs="+", default=ff.family_names())
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    rows: dict[str, str] = {}
    if PAGE.exists():  # families that are not run again keep their row
        lines = PAGE.read_text(encoding="utf-8").splitlines()
        rows = {
            line.split(" ")[1]: line
            for line in lines
            if line[2:].startswith(tuple(ff.family_names()))
        }
    with get_context("fork").Pool(given.jobs) as pool:
        for family in given.family:
            tasks = [(family, k) for k in range(given.runs)]
            rows[family] = row(family, pool.map(_one, tasks, chunksize=1))
            print(rows[family], flush=True)  # noqa: T201 (it prints its table)
    if given.write:
        PAGE.write_text(_EXPLAINED + "\n".join(sorted(rows.values())) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
