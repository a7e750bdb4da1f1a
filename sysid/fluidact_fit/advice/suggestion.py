"""What is suggested for a log, and the order of several suggestions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from ..assessment import policy
from ..result import FitResult

_ALIKE = 1.5  # times the misfit of another, up to which fewer parameters are the better model
_APART = 3.0  # times the misfit of the best model, beyond which another is none of its rivals


@dataclass(frozen=True)
class Suggestion:
    """A family that a log may be of.

    Attributes
    ----------
    family, variant
        Names.
    columns
        Role to the number of its column, as ``"#2"``.
    score
        How well units and names agree.
    unsure
        Pairs of roles whose columns could be exchanged, for all that units, names and the order
        in time say.
    verdict
        Of a trial fit, ``"refused"`` where nothing can be determined; empty where none was made.
    fit_percent
        Of the trial.
    parameters
        How many numbers it estimated.
    not_identified
        Parameters that the logs do not determine, with what would: the words of the warning.
    reason
        Why it was refused or not tried.
    options
        What the command needs beside columns; the trial was made with it.
    asked
        Options that have to be given first, as ``--mass NUMBER``.
    command
        How to run the fit, for a POSIX shell.
    powershell
        The same for PowerShell.
    against
        Pairs of a driving role and the output that moves the other way: a sign may be reversed.
    basis
        What the columns were chosen by where units and names do not suffice, or what is missing;
        empty where they do.
    candidates
        Role to the numbers of the columns that it may have, where nothing tells which one it is.
    result
        Of the trial fit, where one was made.
    """

    family: str
    variant: str
    columns: Mapping[str, str]
    score: float
    unsure: tuple[tuple[str, str], ...] = ()
    verdict: str = ""
    fit_percent: float | None = None
    parameters: int = 0
    not_identified: Mapping[str, str] = field(default_factory=dict)
    reason: str = ""
    options: tuple[str, ...] = ()
    asked: tuple[str, ...] = ()
    command: str = ""
    powershell: str = ""
    against: tuple[tuple[str, str], ...] = ()
    basis: str = ""
    candidates: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    result: FitResult | None = field(default=None, repr=False, compare=False)

    def as_dict(self) -> dict[str, Any]:
        """Everything but the result, as plain data."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name != "result"}

    @property
    def rank(self) -> tuple[int, float]:
        """Better ones are lower; of those that are alike, the simpler one has to be chosen."""
        order = {"pass": 0, "warn": 1, "": 2, "fail": 3, "refused": 4}
        missed = 100.0 if self.fit_percent is None else 100.0 - self.fit_percent
        return order[self.verdict], missed


def is_clear(found: Sequence[Suggestion]) -> bool:
    """Return whether the first suggestion is the one, without a question left."""
    if not found or found[0].verdict not in ("pass", "warn"):
        return False
    if found[0].unsure or found[0].basis or found[0].options:
        return False
    if (found[0].fit_percent or 100.0) < policy.FIT_WEAK:
        return False
    rivals = [s for s in found[1:] if s.verdict == found[0].verdict]
    best = found[0].rank[1]
    return all(s.score < found[0].score or s.rank[1] > _APART * best for s in rivals)


def in_order_of_merit(tried: Sequence[Suggestion]) -> list[Suggestion]:
    """By verdict and misfit; of two that fit alike, the one with fewer numbers comes first.

    One that could not be tried without a number, and has a role for more columns, precedes a fit
    that is not clean.
    """
    left, out = sorted(tried, key=lambda s: (s.rank[0], -s.score, s.rank[1])), []
    while left:
        verdict = left[0].rank[0]
        alike = [s for s in left if s.rank[0] == verdict]
        least = min(s.rank[1] for s in alike)
        close = [s for s in alike if s.rank[1] <= _ALIKE * least]
        best = min(close, key=lambda s: (s.parameters, -s.score))
        out.append(best)
        left.remove(best)
    return sorted(out, key=lambda s: not _awaits_numbers(s, out[0]))


def _awaits_numbers(s: Suggestion, best: Suggestion) -> bool:
    """Return whether a family that has a role for more columns than the best one lacks numbers.

    Part of the columns fits some other family, and not well: what asks for an area is meant.
    """
    return bool(s.asked) and best.verdict != "pass" and len(s.columns) > len(best.columns)
