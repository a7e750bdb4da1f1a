# ruff: noqa: T201 (it prints its table)
"""Run all attacks and write what came of them into ``docs/evidence/red-team.md``.

With ``--cells`` only those whose coverage is counted, as often as it says, into
``docs/evidence/red-team-coverage.md``.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

from . import cells
from .attack import Attack, Result
from .attacks import every, vary
from .run import SEED, run
from .table import page, shown

_TASKS: list[tuple[Attack, int, int]] = []
PAGE = Path(__file__).parents[2] / "docs" / "evidence" / "red-team.md"


def _one(index: int) -> Result:
    return run(*_TASKS[index])


def main() -> int:
    """Return 1 where a wrong number passed in silence, or the program broke."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--family", nargs="+", help="attack these families only")
    parser.add_argument("--group", nargs="+", help="run only groups whose title holds a word")
    parser.add_argument("--scale", type=float, default=1.0, help="share of the repetitions")
    parser.add_argument("--cells", type=int, default=0, metavar="RUNS", help="count coverage")
    parser.add_argument("--seed", type=int, default=SEED, help="of all random numbers")
    parser.add_argument(
        "--vary",
        type=float,
        default=0.0,
        metavar="SHARE",
        help="other machines: every number up to exp(SHARE) times more or less",
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--write", action="store_true", help="write the page")
    parser.add_argument("--verbose", action="store_true", help="print every result, as they come")
    given = parser.parse_args()
    if given.vary:
        vary(given.vary, given.seed)
    attacks = [
        a
        for a in every(given.family)
        if not given.group or any(word in a.group for word in given.group)
    ]
    if given.cells:
        attacks = [replace(a, repetitions=given.cells) for a in attacks if cells.is_cell(a)]
    began = time.perf_counter()
    tasks = [
        (a, k, given.seed)
        for a in attacks
        for k in range(max(1, round(a.repetitions * given.scale)))
    ]
    _TASKS.extend(tasks)
    # forked, since an attack holds functions that cannot be sent
    results = []
    with get_context("fork").Pool(given.jobs) as pool:
        for r in pool.imap(_one, range(len(tasks))):
            results.append(r)
            if given.verbose:
                print(shown(r), flush=True)
    if given.cells:
        text, path = cells.page(attacks, results), cells.PAGE
    else:
        text, path = page(results, time.perf_counter() - began, given.scale), PAGE
    print(text)
    if given.write:
        path.write_text(text, encoding="utf-8")
    return int(any(r.silent or r.verdict in ("crash", "endless") for r in results))


if __name__ == "__main__":
    sys.exit(main())
