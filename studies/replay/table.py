"""What every section of the page needs."""

from __future__ import annotations

from dataclasses import dataclass

STEP = 0.01  # [s], of the controllers
HEAD = ["| what | source | here | a test of the model? |", "|---|---|---|---|"]


def row(what: str, source: str, ours: str, test: str) -> str:
    """A row of a table; ``test`` says what the figure of the source had part in."""
    return f"| {what} | {source} | {ours} | {test} |"


@dataclass(frozen=True)
class Transfer:
    """A transfer function by its coefficients."""

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    dead_time: float = 0.0


def second_order(frequency: float, ratio: float) -> Transfer:
    """Valve of gain 1."""
    w = frequency
    return Transfer((w * w,), (1.0, 2.0 * ratio * w, w * w))
