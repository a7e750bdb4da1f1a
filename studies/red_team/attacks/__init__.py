"""The attacks, a module a family; each makes its own with ``attacks()``."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pkgutil import iter_modules

from ..attack import Attack


def every(families: list[str] | None = None) -> Iterator[Attack]:
    """All attacks, or those on some families."""
    for info in iter_modules(__path__):
        for attack in import_module(f"{__name__}.{info.name}").attacks():
            if not families or attack.family in families:
                yield attack
