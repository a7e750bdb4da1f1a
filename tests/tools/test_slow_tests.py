"""What `make test` leaves to `make test-slow`: the list, and how it is made."""

from __future__ import annotations

import ast
from pathlib import Path

from slow_tests import slow_tests

TESTS = Path(__file__).parents[1]
SLOW = (TESTS / "slow.txt").read_text(encoding="utf-8").splitlines()
PROMISES = (TESTS / "promises.txt").read_text(encoding="utf-8").split()
REPORT = """
============ slowest durations ============
0.15s setup    tests/test_a.py::test_one[x]
0.10s call     tests/test_a.py::test_one[x]
0.90s call     tests/test_a.py::test_one[y z]
0.10s call     tests/test_a.py::test_two
9.00s call     tests/test_b.py::test_three[p]
9.50s call     tests/test_b.py::test_three[q]
9.00s call     tests/test_c.py::test_promise[q]
"""


def test_one_case_stays_unless_it_takes_long_itself() -> None:
    assert slow_tests(REPORT, ["tests/test_c.py::test_promise"]) == [
        "tests/test_a.py::test_one[y z]",
        "tests/test_b.py::test_three[p]",
        "tests/test_b.py::test_three[q]",
    ]


def test_the_list_names_tests_that_there_are_and_no_promise() -> None:
    """A test that was renamed would be run by nothing else than `make test`, slow or not."""
    functions: dict[str, set[str]] = {}
    for test in SLOW:
        path, _, name = test.partition("::")
        if path.endswith(".ipynb"):
            assert (TESTS.parent / path).exists()
            continue
        if path not in functions:
            tree = ast.parse((TESTS.parent / path).read_text(encoding="utf-8"))
            found = (n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef))
            functions[path] = {n.name for n in found}
        assert name.partition("[")[0] in functions[path], test
        assert not test.startswith(tuple(PROMISES))
