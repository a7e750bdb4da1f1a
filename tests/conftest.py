"""How the tests are shared out among processes, and which are left to `make test-slow`."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path, PurePosixPath
from typing import Any

import pytest

# Before numpy is loaded, and for every process of the tests: with as many processes as cores,
# several threads of linear algebra in each are up to ten times slower than one.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import fluidact_fit as ff

FAMILIES = sorted(ff.family_names(), key=len, reverse=True)

# What takes long for its few tests: begun last, it would keep the other process waiting.
LONG = (
    "hydraulic-cylinder",
    "force-map",
    "tests/families/test_stribeck.py",
    "tests/families/test_transfer.py",
    "tests/studies/test_red_team.py",
    "tests/cli/test_batch.py",
    "tests/test_excitation.py",
    "tests/export/test_chip_page.py",
)


# Repetitions, and all but one case of what runs many; `tools/slow_tests.py` writes the list.
SLOW = frozenset((Path(__file__).parent / "slow.txt").read_text(encoding="utf-8").splitlines())


def scope_of(test: str) -> str:
    """What a test shares its fits with: the family in its brackets or of its file, or the file."""
    path, _, name = test.partition("::")
    parameters = name.partition("[")[2]
    told = PurePosixPath(path).stem.removeprefix("test_").replace("_", "-")
    return next((f for f in FAMILIES if parameters.startswith(f) or told == f), path)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Begin with what takes long and with the notebooks, then with what is many tests."""
    for item in items:
        if item.nodeid in SLOW:
            item.add_marker(pytest.mark.slow)
    if not hasattr(config, "workerinput"):
        return
    scopes = [scope_of(item.nodeid) for item in items]
    sizes = Counter(scopes)

    def place(scope: str) -> tuple[int, int]:
        if scope in LONG:
            return LONG.index(scope), 0
        return len(LONG), -len(items) if scope.endswith(".ipynb") else -sizes[scope]

    ordered = sorted(zip(scopes, items), key=lambda pair: place(pair[0]))
    items[:] = [item for _, item in ordered]


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Keep what is fitted once for many tests in one process, which then fits it once.

    ``--dist loadgroup`` of pytest-xdist 3.8 does nothing under pytest 9.2.
    """
    from xdist.scheduler import LoadScopeScheduling

    class ByScope(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return scope_of(nodeid)

    config.option.loadscopereorder = False  # they come in order
    return ByScope(config, log)
