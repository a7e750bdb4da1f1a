# ruff: noqa: T201 (it prints its table)
"""How often the family of a log stands first among those that ``inspect`` suggests.

    python studies/advice.py [--runs N] [--family NAME ...] [--jobs N] [--write]

Every dataset is recorded anew by its own generator with other random numbers. Its columns are
shuffled and renamed: some by what people call them, some by a channel's number; units stay. Then
the first log of each is given to the suggestions without another word, and the columns that they
chose are compared with the true ones. What the first suggestion says that the log does not
determine is compared with the fit that a user runs next. ``--write`` writes
``docs/evidence/advice.md``.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from fluidact_fit.logs import Log

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "evidence" / "advice.md"
SEED = 20_261_126
_NAMES = {
    "time": ("time", "Zeit", "t"), "force": ("Kraft", "load cell"), "torque": ("Drehmoment", "M"),
    "position": ("Weg", "laser"), "angle": ("Winkel", "encoder"), "command": ("Sollwert", "valve"),
    "outlet": ("Druck", "p out"), "inlet": ("p in", "source"), "speed": ("Drehzahl", "omega"),
    "velocity": ("v", "speed"), "flow": ("Q", "Volumenstrom"), "reading": ("ADC", "counts"),
    "pressure_1": ("pA", "p1"), "pressure_2": ("pB", "p2"), "pressure_drop": ("dp", "delta p"),
    "reference": ("laser", "caliper"), "drive": ("Motor", "x"),
    "load": ("Last", "phi"),
}  # fmt: skip
_PAGE = """\
# Which family a log is of

Written by `studies/advice.py --write`. Datasets were recorded anew with other random numbers, their
columns shuffled and half of them named by channel; `inspect` was given the first log of each with
nothing else. A family stands first where its trial fit is the best of all that units and names
allow; where a family needs numbers that no log tells, it is suggested untried.

{first} of {runs} have their family first, {columns} of {known} of these the right columns in every
role; {agree} of {compared} lists of what is not determined are those of the fit that follows.
({seconds:.1f} s each in the median.)

| family | logs | first | columns | not determined alike | what stood first instead |
|---|---|---|---|---|---|
{rows}
"""


@dataclass(frozen=True)
class Run:
    """What was suggested for one log."""

    family: str
    first: str
    columns: bool
    alike: bool | None
    seconds: float


def suggest_for(family: str, number: int) -> Run:
    """Record a dataset, disguise its first log, and ask."""
    sys.path.insert(0, str(ROOT / "datasets"))
    from generate import find_datasets
    from generators.writing import name_logs, write_dataset

    import fluidact_fit as ff
    from fluidact_fit.advice import suggest
    from fluidact_fit.demo import Dataset

    rng = np.random.default_rng([SEED, number, len(family)])
    data = next(d for d in find_datasets() if d.family == family)
    with TemporaryDirectory(prefix="advice-") as folder:
        write_dataset(replace(data, seed=(SEED, number)), Path(folder))
        paths = tuple(Path(folder) / family / name for name in name_logs())
        log = Dataset(family, paths, data.roles, data.options, {}, {}).read()[0]
        path, truth = disguise(log, Path(folder), rng)
        began = time.process_time()
        found = suggest([ff.read_log(path)], [str(path)])
        seconds = time.process_time() - began
        if not found or found[0].family != family:
            return Run(family, found[0].family if found else "nothing", False, None, seconds)
        best = found[0]
        right = all(best.columns.get(r) in (None, at) for r, at in truth.items())
        alike = None
        if best.verdict in ("pass", "warn"):
            result = ff.fit(family, path, columns=dict(best.columns), **data.options)
            lost = {n for n, q in result.parameters.items() if q.status == "not_identified"}
            alike = lost == set(best.not_identified)
    return Run(family, best.family, right, alike, seconds)


def disguise(log: Log, folder: Path, rng: np.random.Generator) -> tuple[Path, Mapping[str, str]]:
    """Write a log with its columns shuffled and renamed; where each role stands now."""
    from fluidact_fit.logs.columns import find_column

    roles = {find_column(log, r, at).index: r for r, at in log.bindings.items()}
    columns = list(log.columns)
    order = [0, *(1 + rng.permutation(len(columns) - 1)).tolist()]
    names, truth = [], {}
    for k, index in enumerate(order):
        column = columns[index]
        role = roles.get(column.index, "time" if index == 0 else "")
        called = _NAMES.get(role, (column.name,))
        name = str(rng.choice(called)) if role == "time" or rng.random() < 0.5 else f"AI{k}"
        names.append(f"{name} [{column.unit}]" if column.unit else name)
        if role and role != "time":
            truth[role] = f"#{k + 1}"
    table = np.column_stack([columns[i].values for i in order])
    path = folder / "bench.csv"
    np.savetxt(path, table, delimiter=";", header=";".join(names), comments="", fmt="%.9g",
               encoding="utf-8")  # fmt: skip
    return path, truth


def _one(task: tuple[str, int]) -> Run:
    return suggest_for(*task)


def main() -> int:
    """Return 1 where fewer than 55 of 60 stand first, or lists differ in more than a tenth."""
    import fluidact_fit as ff

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5, help="logs of each family")
    parser.add_argument("--family", nargs="+", default=ff.family_names())
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    tasks = [(f, k) for f in given.family for k in range(given.runs)]
    with get_context("fork").Pool(given.jobs) as pool:
        runs = pool.map(_one, tasks, chunksize=1)
    rows = []
    for family in given.family:
        own = [r for r in runs if r.family == family]
        hits = [r for r in own if r.first == family]
        told = [r.alike for r in hits if r.alike is not None]
        others = ", ".join(sorted({r.first for r in own if r.first != family}))
        rows.append(f"| {family} | {len(own)} | {len(hits)} | {sum(r.columns for r in hits)} | "
                    f"{f'{sum(told)} of {len(told)}' if told else ''} | {others} |")  # fmt: skip
    hits = [r for r in runs if r.first == r.family]
    told = [r.alike for r in hits if r.alike is not None]
    text = _PAGE.format(
        first=len(hits), runs=len(runs), columns=sum(r.columns for r in hits), known=len(hits),
        agree=sum(told), compared=len(told), rows="\n".join(rows),
        seconds=float(np.median([r.seconds for r in runs])),
    )  # fmt: skip
    print(text)
    if given.write:
        PAGE.write_text(text, encoding="utf-8")
    return int(12 * len(hits) < 11 * len(runs) or 10 * sum(told) < 9 * len(told))


if __name__ == "__main__":
    sys.exit(main())
