"""The head-to-head: this project and every other tool, side by side in one run.

    python bench/run.py                    the four problems, then five random variations
    python bench/run.py --seed 7           other noise and other excitations
    python bench/run.py --variation 3      one variation as the main table
    python bench/run.py --only lmfit_peer  this project and some tools

Results go to ``head-to-head.json`` in the directory of the environments;
``bench/report.py`` makes the document of it.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

from environments import HERE, OWN, TOOLS
from harness import Row, run, start
from problems import vary


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--directory", type=Path, default=HERE.parent / ".bench")
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--limit", type=float, default=60.0, help="seconds a fit may take")
    parser.add_argument("--variation", type=int, default=0, help="0: the benchmark itself")
    parser.add_argument("--variations", type=int, default=5, help="of the second table")
    parser.add_argument("--quick", type=float, default=2.0, help="slowest fit of the second table")
    parser.add_argument("--only", nargs="*", choices=[t for t in TOOLS if t != OWN])
    parser.add_argument("--problems", nargs="*", choices=["P1", "P2", "P3", "P4"])
    given = parser.parse_args()
    directory = given.directory.resolve()
    directory.mkdir(parents=True, exist_ok=True)
    tools = [t for t in TOOLS if t == OWN or given.only is None or t in given.only]
    workers, missing = start(tools, directory)
    if not any(w.tool == OWN for w in workers):
        sys.stderr.write(f"this project cannot be run: {missing[OWN]}\n")
        return 1

    def chosen(number: int) -> dict:
        every = vary(number, given.seed)
        return {k: p for k, p in every.items() if not given.problems or k in given.problems}

    main_rows = run(chosen(given.variation), workers, given.trials, given.limit)
    others = [r for r in main_rows if r.tool != OWN]
    slow = {(r.tool, r.fit) for r in others if not _is_quick(r, given.quick)}
    varied = {}
    for number in range(1, given.variations + 1):
        sys.stderr.write(f"variation {number}\n")
        problems = chosen(number)
        rows = run(problems, workers, 3, given.limit, slow)
        varied[number] = {
            "problems": {k: asdict(p) for k, p in problems.items()},
            "rows": [asdict(r) for r in rows],
        }
    for worker in workers:
        worker.stop()
    content = {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "cores": os.cpu_count(),
        "load": os.getloadavg()[2],
        "python": sys.version.split()[0],
        "seed": given.seed,
        "variation": given.variation,
        "limit": given.limit,
        "quick": given.quick,
        "problems": {k: asdict(p) for k, p in chosen(given.variation).items()},
        "versions": {w.hello["title"]: w.hello["version"] for w in workers},
        "missing": missing,
        "rows": [asdict(r) for r in main_rows],
        "variations": varied,
    }
    path = directory / "head-to-head.json"
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return 0


def _is_quick(row: Row, limit: float) -> bool:
    seconds = [t["seconds"] for t in row.trials if "seconds" in t]
    return bool(seconds) and min(seconds) < limit


if __name__ == "__main__":
    sys.exit(main())
