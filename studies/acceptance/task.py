"""What is run: a function that gives the rows of one fit or of a few that belong together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from .figures import Figure


@dataclass(frozen=True)
class Task:
    """A function of a scratch directory; the dear ones are begun first."""

    group: str
    name: str
    seconds: float
    figures: Callable[[Path], list[Figure]]
