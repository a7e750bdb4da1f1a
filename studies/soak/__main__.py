# ruff: noqa: T201 (it prints its table)
"""Run all parts of the attack and write what came of them into ``docs/evidence/soak.md``."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

from . import batches, hostile, logs, options, parameters, processes, recordings
from .case import SEED, Part, Result
from .pool import run_case, run_part
from .table import page, shown

PAGE = Path(__file__).parents[2] / "docs" / "evidence" / "soak.md"
PARTS: tuple[Part, ...] = (
    *logs.PARTS, *parameters.PARTS, *options.PARTS, *processes.PARTS, *batches.PARTS,
    *hostile.PARTS, *recordings.PARTS,
)  # fmt: skip


def main() -> int:
    """Return 1 where a case failed."""
    parser = argparse.ArgumentParser(prog="python -m studies.soak", description=__doc__)
    names = ", ".join(part.name for part in PARTS)
    parser.add_argument("--part", nargs="+", metavar="PART", help=f"run these only: {names}")
    parser.add_argument("--only", metavar="PART:NUMBER", help="run one case, and keep its files")
    parser.add_argument("--scale", type=float, default=1.0, help="share of the cases")
    parser.add_argument("--seed", type=int, default=SEED, help="of all random numbers")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--write", action="store_true", help="write the page")
    parser.add_argument("--verbose", action="store_true", help="print every failure in full")
    given = parser.parse_args()
    chosen = [p for p in PARTS if not given.part or p.name in given.part]
    if given.only:
        return _one(given.only, given.seed)
    began = time.perf_counter()
    results: list[Result] = []
    for part in chosen:
        cases = range(max(1, round(part.cases * given.scale)))
        for result in run_part(part, cases, given.seed, given.jobs):
            results.append(result)
            if given.verbose and result.failures:
                print(shown(result), flush=True)
        print(f"{part.name}: done at {time.perf_counter() - began:.0f} s", file=sys.stderr)
    results.sort(key=lambda r: r.number)
    text = page(chosen, results, time.perf_counter() - began, given.scale)
    print(text)
    if given.write:
        PAGE.write_text(text, encoding="utf-8")
    return int(any(r.failures for r in results))


def _one(which: str, seed: int) -> int:
    """Run one case in this process, without limits, and print all of it."""
    name, _, number = which.partition(":")
    part = next(p for p in PARTS if p.name == name)
    folder = Path(tempfile.mkdtemp(prefix=f"soak-{name}-{number}-"))
    print(f"files in {folder}")
    result = run_case(part, int(number), seed, folder, lambda about: print(about, flush=True))
    print(shown(result))
    return int(bool(result.failures))


if __name__ == "__main__":
    sys.exit(main())
