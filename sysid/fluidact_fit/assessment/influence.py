"""Do a few samples carry the answer, or one half of the data?

A sample that stands alone, far from what all others say, or that is matched exactly because
nothing else holds what it says, can turn a result without showing in its root-mean-square error;
see :mod:`.leverage`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..errors import Notice
from ..estimation.agreement_of_logs import Drift, compare_logs
from ..experiment import FloatArray
from ..units import as_share
from .leverage import Effect
from .optimum import LEAST, Optimum

_LISTED = 5
_FEWEST = 50  # samples of a part of the data that is compared with the rest
_DISAGREE = 1e-4  # probability of a difference that large between parts of the data
_MATTERS = 0.02  # part of a parameter that a difference must exceed
_TOLD = 0.04  # part of what both halves know of a parameter that each has to know of it


@dataclass(frozen=True)
class Sample:
    """A sample that decides: where it is, how far off, and what it moves."""

    place: str
    deviations: float
    parameter: str
    shift: float
    errors: float


def find_deciding_samples(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """Samples that the result hangs on: an entry for the file, and a warning."""
    influence = at.influence
    if influence is None:
        return {}, []
    entry: dict[str, Any] = {
        "largest_influence": influence.most, "largest_leverage": influence.leverage
    }  # fmt: skip
    deciding = [e for e in influence.effects if e.deciding and _matters(at, e)]
    deciding.sort(key=lambda e: -abs(e.errors))
    if not deciding:
        return entry, []
    found = [
        Sample(
            at.place(e.series, e.row), e.deviations, at.names[e.parameter],
            -e.errors * float(at.errors[e.parameter]), -e.errors,
        )
        for e in deciding[:_LISTED]
    ]  # fmt: skip
    entry["samples"] = [vars(s) for s in found]
    return entry, [_notice(found, len(deciding), at.unit(found[0].parameter))]


def _matters(at: Optimum, e: Effect) -> bool:
    """Whether a sample moves a parameter by more than any bench is worth."""
    moved = abs(e.errors) * float(at.errors[e.parameter])
    return moved > LEAST * abs(at.number(at.names[e.parameter]))


def _times(factor: float) -> str:
    return f"{factor:.0f} times" if factor < 1000.0 else "over 1000 times"


def _notice(found: list[Sample], count: int, unit: str) -> Notice:
    first = found[0]
    others = "" if count == 1 else f" and {count - 1} more"
    verb, it = ("decides", "it") if count == 1 else ("decide", "that first one")
    listed = ", ".join(s.place for s in found[1:])
    return Notice(
        "few-samples-decide",
        f"{first.place}{others} {verb} {first.parameter}: without {it} it would change by "
        f"{first.shift:+.3g}{unit}, {abs(first.errors):.1f} standard errors; the model misses {it} "
        f"by {_times(abs(first.deviations))} the usual scatter."
        + (f" The others: {listed}." if listed else "")
        + " Look at the log there (--plot) and delete rows that are wrong; where they are steps or "
        "reversals, sample faster.",
    )


def find_disagreeing_parts(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """Compare the two halves of the data."""
    (jacobians, residuals), half = _halves(at, [at.jacobians, at.residuals])
    if min(sum(r.size for r, h in zip(residuals, half) if h == k) for k in (0, 1)) < _FEWEST:
        return {}, []
    compared = jacobians, residuals, half, at.names, _TOLD
    drift = compare_logs(*compared)[0][0]
    if _telling(at, drift):  # what a converter does takes longer to know, and excuses more
        (measured,), _ = _halves(at, [at.measured])
        steps = [s.resolution for s in at.series for _ in range(len(measured) // len(at.series))]
        drift = compare_logs(*compared, list(zip(measured, steps, strict=True)))[0][0]
    entry = {
        "parameter": drift.parameter,
        "difference": drift.difference,
        "deviations": drift.deviations,
        "p_value": drift.p_value,
    }
    return {"halves": entry}, [_halves_notice(at, drift)] if _telling(at, drift) else []


def _halves(
    at: Optimum, tables: Sequence[Sequence[FloatArray]]
) -> tuple[list[list[FloatArray]], list[int]]:
    """The parts of tables of all series, and which half of the data each belongs to."""
    last = at.series[-1].run
    if last:
        return [list(t) for t in tables], [int(2 * s.run > last) for s in at.series]
    parts = []
    for table in tables:
        cuts = [(rows, rows.shape[0] // 2) for rows in table]
        parts.append([part for rows, k in cuts for part in (rows[:k], rows[k:])])
    return parts, [0, 1] * len(at.series)


def _telling(at: Optimum, d: Drift) -> bool:
    value = at.number(d.parameter)
    return d.p_value < _DISAGREE and abs(d.difference) > _MATTERS * abs(value)


def _halves_notice(at: Optimum, d: Drift) -> Notice:
    return Notice(
        "halves-disagree",
        f"the first and the second half of the data give a {d.parameter} that differs by "
        f"{d.difference:+.3g}{at.unit(d.parameter)}"
        f"{as_share(d.difference, at.number(d.parameter))}, "
        f"{abs(d.deviations):.1f} standard errors: the machine changed while it was recorded, or "
        "the model describes only part of what it did. Fit the halves separately (--window) and "
        "look at both pictures.",
    )
