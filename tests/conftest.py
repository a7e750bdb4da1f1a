"""How the tests are shared out among processes."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Any

import pytest

import fluidact_fit as ff

FAMILIES = sorted(ff.family_names(), key=len, reverse=True)


def scope_of(test: str) -> str:
    """What a test shares its fits with: the family in its brackets or of its file, or the file."""
    path, _, name = test.partition("::")
    parameters = name.partition("[")[2]
    told = PurePosixPath(path).stem.removeprefix("test_").replace("_", "-")
    return next((f for f in FAMILIES if parameters.startswith(f) or told == f), path)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Keep what is fitted once for many tests in one process, which then fits it once.

    ``--dist loadgroup`` of pytest-xdist 3.8 does nothing under pytest 9.2.
    """
    from xdist.scheduler import LoadScopeScheduling

    class ByScope(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return scope_of(nodeid)

    return ByScope(config, log)
