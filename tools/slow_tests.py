"""Which tests `make test` leaves to `make test-slow`, from what each has taken.

Reads what ``pytest --durations=0 --durations-min=0.02`` has printed of the whole suite and prints
the node ids for ``tests/slow.txt``: whatever takes longer than ``LIMIT``. Of a function the fastest
case stays, unless it is longer than ``MOST``; what stands in ``tests/promises.txt`` stays as well.
Times are those of one machine: only their order of size matters.
"""

from __future__ import annotations

import re
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

TESTS = Path(__file__).parents[1] / "tests"
LIMIT, MOST = 0.3, 1.5  # s
STAYS = ("notebooks/01_potentiometer.ipynb",)
_LINE = re.compile(r"(\d+\.\d+)s (?:call|setup|teardown) +(\S.*)")


def slow_tests(report: str, promises: Iterable[str]) -> list[str]:
    """Node ids of the tests that are slow in a report of durations, sorted."""
    taken: dict[str, float] = defaultdict(float)
    for line in report.splitlines():
        if found := _LINE.match(line):
            taken[found[2].rstrip()] += float(found[1])
    functions: dict[str, list[str]] = defaultdict(list)
    for test in taken:
        functions[test.partition("[")[0]].append(test)
    kept = tuple(promises)
    return sorted(
        test for cases in functions.values() for test in _of_function(cases, taken)
        if not test.startswith(kept)
    )  # fmt: skip


def _of_function(cases: list[str], taken: dict[str, float]) -> Iterator[str]:
    first, *others = sorted(cases, key=lambda test: taken[test])
    if taken[first] > MOST:
        yield first
    yield from (test for test in others if taken[test] > LIMIT)


if __name__ == "__main__":
    promises = (TESTS / "promises.txt").read_text(encoding="utf-8").split()
    sys.stdout.write("\n".join(slow_tests(sys.stdin.read(), [*promises, *STAYS])) + "\n")
