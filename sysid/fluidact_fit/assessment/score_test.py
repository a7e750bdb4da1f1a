"""Rao's score test of every term that a model may lack, without another fit.

Where the residual has a significant component along a term, and adding the term would move a
parameter by more than its interval, the interval does not cover the truth and the fit must not pass
in silence. Derivation and references: ``docs/theory/score-test.md``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import chain
from typing import Any

import numpy as np

from ..errors import Notice
from ..estimation.converter_errors import is_coarse
from ..estimation.least_squares import scaled_least_squares
from ..estimation.solution import base_name
from ..estimation.uncertainty import covariance
from ..experiment import FloatArray
from ..units import as_share
from . import policy
from .corrected_score import with_noise_copies
from .optimum import Optimum
from .terms import Term, terms_at_any_time, terms_over_time

_QUANTISED = 1.5  # standard error allowing for the converter, per that of white residuals


def find_missing_response(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """Judge every term that the model may lack: entries for the file, and a warning."""
    whole = with_noise_copies(at)
    part = whole.part
    terms = chain(
        ((whole, t) for t in terms_over_time(whole)), ((part, t) for t in terms_at_any_time(part))
    )
    judged = [judge_term(where, t) for where, t in terms]
    scores = [s for s in judged if isinstance(s, TermScore)]
    table = {s.term.name: s.entry for s in scores}
    significant = [s for s in scores if s.significant]
    if not significant:
        return table, list(_unexamined(at, judged))
    close = policy.PREFER_PARAMETER * max(abs(s.deviations) for s in significant)
    offered = [s for s in significant if s.term.offered and abs(s.deviations) > close]
    best = max(offered or significant, key=lambda s: abs(s.deviations))
    return table, [_notice(at, best)]


@dataclass(frozen=True)
class TermScore:
    """Effect of adding a term.

    Attributes
    ----------
    term
        The term, without its columns.
    size, deviations
        Size of the term [its unit], and that in its standard errors.
    parameter, shift, standard_errors
        Parameter that would move most, by how much [its unit], and that in its standard errors.
    share
        Largest relative change of a parameter, of those that would move significantly.
    bounded
        Whether the standard errors tell how large the term could be unseen: with a coarse
        converter they may not.
    """

    term: Term
    size: float
    deviations: float
    parameter: str
    shift: float
    standard_errors: float
    share: float
    bounded: bool = True

    @property
    def needed(self) -> float:
        """Standard errors from which the term counts: fewer where a parameter would change much."""
        one_sided = self.term.positive and self.size >= 0.0
        if self.term.positive and not one_sided:
            return policy.TERM_CERTAIN
        seen = self.share > policy.NOTICEABLE
        least = policy.TERM_SEEN if seen else policy.TERM_CERTAIN
        return least - policy.TERM_ONE_SIDED * one_sided

    @property
    def significant(self) -> bool:
        """Return whether the term is present, and matters."""
        possible = abs(self.size) <= self.term.max_size
        present = abs(self.deviations) > self.needed
        return possible and present and (self.moves or abs(self.size) > self.term.matters_from)

    @property
    def moves(self) -> bool:
        """Return whether a parameter would move by more than its interval allows for."""
        far = abs(self.standard_errors) > _needed_move(self.term, self.deviations)
        return far and self.share >= self.term.min_share

    @property
    def entry(self) -> dict[str, Any]:
        """Entry for the file: also how large the term could be unseen, and the shift by that."""
        entry: dict[str, Any] = {
            "size": self.size, "unit": self.term.unit, "deviations": self.deviations,
            "parameter": self.parameter, "shift": self.shift,
            "standard_errors": self.standard_errors,
        }  # fmt: skip
        if self.size and self.deviations and self.bounded:
            size = min(self.needed * abs(self.size / self.deviations), self.term.max_size)
            entry["unseen_size"] = size
            entry["unseen_shift"] = size * abs(self.shift / self.size)
        return entry


class Unjudged(Enum):
    """Reason why nothing is known of a term."""

    HIDDEN = "noise of an input leaves nothing that would show it"
    REPRESENTED = "the parameters can stand for it"


def judge_term(at: Optimum, term: Term) -> TermScore | Unjudged:
    """Estimate size and significance of a term."""
    found = at.regress(term.columns, term.instruments)
    if found is None:
        return Unjudged.HIDDEN
    if not found.distinct:
        return Unjudged.REPRESENTED
    plain = _score(at, term, found.shifts, found.size, found.error, found.degrees)
    return _allowing_for_converter(at, term, plain, found.degrees)


def _score(
    at: Optimum, term: Term, shifts: FloatArray, size: float, error: float, degrees: int
) -> TermScore:
    """Score of a term of that size, standard error and shifts of the parameters, ``(p,)``."""
    if term.changed_parameter:
        shifts = shifts + 0.5 * size * np.equal(at.names, term.changed_parameter)
    errors = shifts / at.std_errors
    values = np.abs([at.number(n) for n in at.names])
    shares = np.full(values.size, np.inf)  # whatever is added to zero
    np.divide(np.abs(shifts), values, out=shares, where=values > np.finfo(float).tiny)
    worst = int(np.argmax(np.abs(errors)))
    deviations = as_normal(size / max(error, 1e-300), term.directions, degrees)
    shares[np.abs(errors) <= _needed_move(term, deviations)] = 0.0
    kept = replace(term, columns=(), instruments=())  # those of many terms are too much to keep
    return TermScore(
        kept, size, deviations, at.names[worst], float(shifts[worst]), float(errors[worst]),
        float(shares.max()),
    )  # fmt: skip


def _needed_move(term: Term, deviations: float) -> float:
    """Standard errors by which a parameter has to move for a term to matter.

    Noise may cancel as much of an error as the term adds; where a right model hardly ever shows
    such a term, a smaller move counts.
    """
    seen = term.positive and deviations > policy.TERM_SEEN
    return policy.TERM_MOVES_ONE_SIDED if seen else policy.TERM_MOVES


def as_normal(deviations: float, directions: int, degrees: int) -> float:
    """Equally rare deviations of a standard normal variable.

    Those given are of the best of so many ``directions``, in standard errors with ``degrees`` of
    freedom: Student's t by Wallace [1]_, Fisher's F by Paulson [2]_.

    References
    ----------
    .. [1] D. L. Wallace, "Bounds on normal approximations to Student's and the chi-square
       distributions", Annals of Mathematical Statistics 30, 1959.
    .. [2] E. Paulson, "An approximate normalization of the analysis of variance distribution",
       Annals of Mathematical Statistics 13, 1942.
    """
    if directions == 1:
        size = (1.0 - 2.0 / (8.0 * degrees + 3.0)) * np.sqrt(
            degrees * np.log1p(deviations**2 / degrees)
        )
        return float(np.copysign(size, deviations))
    left = max(degrees - directions + 1, 1)  # the other directions are not in the error
    ratio = np.cbrt(deviations**2 / directions * left / degrees)
    above, below = 2.0 / (9.0 * directions), 2.0 / (9.0 * left)
    size = ((1.0 - below) * ratio - (1.0 - above)) / np.sqrt(below * ratio**2 + above)
    return float(np.copysign(max(size, 0.0), deviations))


def _allowing_for_converter(at: Optimum, term: Term, plain: TermScore, degrees: int) -> TermScore:
    """The score from rows as they are, with the errors of a coarse converter not taken for noise.

    This takes longer and is done only for significant terms, of which it may clear some. For the
    others it is then unknown how large they could be unseen.
    """
    steps = [s.resolution for s in at.series]
    if at.treatment or at.instruments or not is_coarse(max(steps), at.sigma):
        return plain
    if not plain.significant:
        return replace(plain, bounded=not at.is_less_certain(_QUANTISED))
    tables = at.augmented(term.columns).tables
    columns, rest = [t[:, :-1] for t in tables], [t[:, -1] for t in tables]
    x = scaled_least_squares(np.vstack(columns), np.concatenate(rest))
    left = [r - c @ x for c, r in zip(columns, rest, strict=True)]
    free = sum(s.own_level for s in at.series)
    readings = list(zip(at.measured, steps, strict=True))
    spread = covariance(columns, left, readings=readings, local_unknowns=free)
    error = float(np.sqrt(spread.covariance[-1, -1]))
    other = _score(at, term, x[:-1], float(x[-1]), error, degrees)
    return min(plain, other, key=lambda s: abs(s.deviations))


def _unexamined(at: Optimum, judged: Sequence[TermScore | Unjudged]) -> Iterator[Notice]:
    """Warn if noise of an input hides nearly everything that the model may lack."""
    inputs = at.solution.noise.inputs
    hidden = judged.count(Unjudged.HIDDEN)
    said = any(n.code == "input-noise-left" for n in at.solution.notices)
    if not inputs or said or not hidden or hidden < policy.HIDDEN * len(judged):
        return
    role = next(iter(inputs))
    noise = at.signal(role).text(inputs[role].sigma, ".2g")
    yield Notice(
        "unexamined",
        f"'{role}' carries noise of about {noise} rms, behind which a delay, a lag or anything "
        f"else that the model lacks would not be seen ({hidden} of {len(judged)} tests have no "
        "answer): the intervals hold only if the model is complete. Record the input with a "
        "cleaner sensor, or move it further and faster.",
    )


def _notice(at: Optimum, s: TermScore) -> Notice:
    value, spec = at.number(s.parameter), at.variant.parameter(base_name(s.parameter))
    if not s.moves:
        text = (
            "No straight line holds over its whole range; the parameters are those of a mean one."
        )
        return _missing(s, text)
    share = as_share(s.shift, value)
    off = f"{s.shift:+.3g}{at.unit(s.parameter)}{share}"
    moved = f"would then change by {off}, more than its interval allows for"
    if s.term.changed_parameter == s.parameter:
        moved = f"is then off by {off} at the end, more than its interval allows for"
    if not spec.minimum <= value + s.shift <= spec.maximum:
        moved = "would then leave its range: it cannot be trusted"
    return _missing(s, f"{s.parameter} {moved}.")


def _missing(s: TermScore, consequence: str) -> Notice:
    return Notice(
        "unmodelled-response",
        f"something is missing from the model: the data fit better if {s.term.words(s.size)} "
        f"({abs(s.deviations):.0f} standard errors). {consequence} {s.term.advice(s.size)}",
    )
