"""The attacks, a module a family; each makes its own with ``attacks()``."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from math import exp
from pkgutil import iter_modules

import numpy as np

from ..attack import Attack


def vary(share: float, seed: int) -> None:
    """Scale the numbers of every machine by up to ``exp(share)`` either way, each by its own.

    What was tuned against the machines as they stand is met by others. Tables of numbers in the
    modules are changed in place, before the attacks are made of them. Names of one ending
    change together, so that no static level falls below the Coulomb level of its direction; so do
    those of loading and unloading, which no log can tell apart.
    """
    rng = np.random.default_rng(seed)
    for info in iter_modules(__path__):
        for table in vars(import_module(f"{__name__}.{info.name}")).values():
            if isinstance(table, dict) and all(isinstance(v, float) for v in table.values()):
                endings = {n: n.rpartition("_")[2].removeprefix("un") for n in table}
                unique = dict.fromkeys(endings.values())
                factors = {e: exp(share * rng.uniform(-1.0, 1.0)) for e in unique}
                for name, ending in endings.items():
                    table[name] *= factors[ending]


def every(families: list[str] | None = None) -> Iterator[Attack]:
    """All attacks, or those on some families."""
    for info in iter_modules(__path__):
        for attack in import_module(f"{__name__}.{info.name}").attacks():
            if not families or attack.family in families:
                yield attack
