"""Simulations that a search may take: counted, and bounded by a budget.

One simulation is one pass of the model over all samples of all logs. A derivative by one unknown is
another pass (those of a network by all its weights come from a single one, backwards), and a pass
over part of the logs counts by its share of their samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from ..errors import NotIdentifiedError

AT_MOST = 20_000  # simulations of a fit
PASSES = 8e7  # samples that those of short logs may go over, if that is more
_FOR_SEARCHES = 0.5  # of the simulations, after which no search goes on: the rest is to end the fit


@dataclass
class Budget:
    """Simulations that a search has ``spent``, and the most that it may, of logs of ``samples``."""

    samples: int
    at_most: int
    spent: float = 0.0

    @property
    def exhausted(self) -> bool:
        """Return whether a search is to end where it is."""
        return self.spent >= _FOR_SEARCHES * self.at_most

    def add(self, simulations: float) -> None:
        """Count simulations, or refuse them where a fit may not take as many."""
        if self.spent + simulations > self.at_most:
            raise NotIdentifiedError(
                f"the search does not end within {self.at_most} simulations of the logs",
                expected="A fit takes some hundreds of them. Nothing was written.",
                remedy="Give --start values near the right ones, or hold what is known with --fix.",
            )
        self.spent += simulations


_budget: ContextVar[Budget | None] = ContextVar("budget", default=None)


@contextmanager
def counting(samples: int) -> Iterator[Budget]:
    """Count the simulations of logs of so many samples, and bound them."""
    budget = Budget(samples, max(AT_MOST, int(PASSES / max(samples, 1))))
    token = _budget.set(budget)
    try:
        yield budget
    finally:
        _budget.reset(token)


@contextmanager
def uncounted() -> Iterator[None]:
    """Count no simulations: those that describe a finished search are none of it."""
    token = _budget.set(None)
    try:
        yield
    finally:
        _budget.reset(token)


def simulated(samples: float | None = None, passes: int = 1) -> None:
    """Count passes of a model over so many samples, all of them by default, where anyone counts.

    Raises
    ------
    NotIdentifiedError
        Where that is more than a fit may take.
    """
    budget = _budget.get()
    if budget is not None:
        budget.add(passes if samples is None else passes * samples / budget.samples)


def exhausted() -> bool:
    """Return whether a search is to end where it is, because it may not go on."""
    budget = _budget.get()
    return budget is not None and budget.exhausted
