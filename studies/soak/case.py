"""A part of the attack, one case of it, and what came of a case."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

SEED = 20_261_122
LIMIT = 10  # s of processor time; a case that takes more hangs
WAIT = 60  # s on the clock, for a case that sleeps for ever
LONGEST = 20_000  # characters of a message; nobody reads more

TRACEBACK, EXIT_1, HANG = "traceback", "exit 1", "hang"
LOSS, DISAGREEMENT, WRONG = "silent loss", "disagreement", "wrong"
KINDS = (TRACEBACK, EXIT_1, HANG, LOSS, DISAGREEMENT, WRONG)


@dataclass
class Case:
    """One case while it runs.

    Attributes
    ----------
    rng
        Its random numbers, its own whatever else runs.
    folder
        An empty folder, which is also the working directory.
    limit
        Seconds that a process which it starts may take.
    tell
        Called with what was done, before it is tried: all that is known of a case that hangs.
    """

    rng: random.Random
    folder: Path
    limit: float = LIMIT
    tell: Callable[[str], None] = lambda about: None


@dataclass
class Result:
    """What came of a case.

    ``outcome`` is a word or exit status for the table; ``failures`` are pairs of a kind (one of
    ``KINDS``) and a sentence. ``part`` and ``number`` run it again, ``about`` says what was done,
    ``message`` what the program said.
    """

    outcome: str
    failures: list[tuple[str, str]] = field(default_factory=list)
    message: str = ""
    part: str = ""
    number: int = 0
    about: str = ""

    def fail(self, kind: str, what: str) -> None:
        """Add a failure."""
        self.failures.append((kind, what))


@dataclass(frozen=True)
class Part:
    """A kind of damage: ``run`` does one case; there are ``cases`` of them at full scale."""

    name: str
    title: str
    cases: int
    run: Callable[[Case], Result]
    limit: float = LIMIT
    wait: float = WAIT


def numbers(part: Part, number: int, seed: int) -> random.Random:
    """The random numbers of a case; the same on every machine."""
    return random.Random(f"{seed} {part.name} {number}")
