"""Do a few samples carry the answer? Leave-one-out of every sample, run and half, in closed form.

With the derivatives ``J`` of a least-squares fit the estimate without sample ``i`` differs by
``(J'J)^-1 J_i' r_i / (1 - h_i)``, ``h_i`` being the sample's leverage, the diagonal of
``J (J'J)^-1 J'`` [1]_. A sample that stands alone, far from what all others say, or that is
matched exactly because nothing else holds what it says, can turn a result without showing in
its root-mean-square error.

References
----------
.. [1] R. D. Cook, S. Weisberg, Residuals and Influence in Regression, 1982.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import Notice
from ..estimation.agreement_of_logs import Drift, compare_logs
from ..experiment import FloatArray
from ..logs.log import BoolArray, IndexArray
from ..units import as_share
from .optimum import Optimum

_ODD = 1e-6  # probability of a residual that large among all samples
_MOVES = 0.5  # standard errors by which an odd sample may move a parameter
_CARRIES = 3.0  # standard errors by which any sample may
_FAR = 10.0  # standard deviations that no noise reaches
_LISTED = 5
_FEWEST = 50  # samples of a part of the data that is compared with the rest
_DISAGREE = 1e-4  # probability of a difference that large between parts of the data
_MATTERS = 0.02  # part of a parameter that a difference must exceed
_VAGUE = 10.0  # standard errors of the fit: a half that is vaguer says nothing


@dataclass(frozen=True)
class Sample:
    """A sample that decides: where it is, how far off, and what it moves."""

    place: str
    deviations: float
    parameter: str
    shift: float
    errors: float


@dataclass(frozen=True)
class Influence:
    """What every sample does to the estimate, all series one after the other.

    Attributes
    ----------
    leverage, deviations
        Diagonal of the hat matrix, and studentised residuals, shape ``(n,)`` each.
    moves, errors
        By how much the sample moves each parameter [its unit], and the same in standard errors,
        shape ``(n, p)`` each.
    odd
        Whether the residual is too large for one of that many, shape ``(n,)``.
    """

    leverage: FloatArray
    deviations: FloatArray
    moves: FloatArray
    errors: FloatArray
    odd: BoolArray

    @property
    def most(self) -> FloatArray:
        """Standard errors by which the parameter that it moves most is moved, shape ``(n,)``."""
        return np.asarray(np.abs(self.errors).max(axis=1))

    @property
    def deciding(self) -> IndexArray:
        """Samples that the result hangs on, the strongest first."""
        most = self.most
        found = np.flatnonzero((self.odd & (most > _MOVES)) | (most > _CARRIES))
        return found[np.argsort(-most[found])]

    @property
    def outlying(self) -> IndexArray:
        """Samples that no model near this one explains, in order: odd, and deciding or far off."""
        beyond = (self.most > _MOVES) | (np.abs(self.deviations) > _FAR)
        return np.flatnonzero(self.odd & beyond)


def measure_influence(at: Optimum) -> Influence | None:
    """What every sample does to the estimate; ``None`` where too few of them tell."""
    j, r = np.vstack(at.jacobians), np.concatenate(at.residuals)
    n, p = j.shape
    if n <= p + 10:
        return None
    scale = np.linalg.norm(j, axis=0)
    scale[scale == 0.0] = 1.0
    q, triangle = np.linalg.qr(j / scale)
    if np.min(np.abs(np.diag(triangle))) < 1e-9:
        return None
    leverage = np.minimum(np.sum(q**2, axis=1), 1.0 - 1e-9)
    gain = np.linalg.inv(triangle) / scale[:, None]
    moves = (q * (r / (1.0 - leverage))[:, None]) @ gain.T
    deviations = _studentised(r, leverage, p)
    odd = np.abs(deviations) > _limit(n, n - p - 1)
    return Influence(leverage, deviations, moves, moves / at.errors, odd)


def find_deciding_samples(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """Samples that the result hangs on: an entry for the file, and a warning."""
    all_of = measure_influence(at)
    if all_of is None:
        return {}, []
    deciding, errors = all_of.deciding, all_of.errors
    entry: dict[str, Any] = {
        "largest_influence": float(all_of.most.max()),
        "largest_leverage": float(all_of.leverage.max()),
    }
    if not deciding.size:
        return entry, []
    places = at.places()
    found = []
    for i in deciding[:_LISTED]:
        k = int(np.argmax(np.abs(errors[i])))
        found.append(
            Sample(
                places[i], float(all_of.deviations[i]), at.names[k], float(-all_of.moves[i, k]),
                float(-errors[i, k]),
            )
        )  # fmt: skip
    entry["samples"] = [vars(s) for s in found]
    return entry, [_notice(found, int(deciding.size), at.unit(found[0].parameter))]


def _studentised(r: FloatArray, leverage: FloatArray, p: int) -> FloatArray:
    """Residuals in standard deviations of the others, robust against many odd ones."""
    n = r.size
    own = r / np.sqrt(1.0 - leverage)
    rest = np.maximum(float(r @ r) - own**2, 0.0) / max(n - p - 1, 1)
    robust = 1.4826 * float(np.median(np.abs(r))) * np.sqrt(n / max(n - p, 1))
    # a residual that is mostly zero (a counter at rest) has no robust size
    sigma = np.sqrt(rest) if robust == 0.0 else np.minimum(np.sqrt(rest), 2.0 * robust)
    # of a residual that is one sample alone nothing is left but rounding
    return np.asarray(own / np.maximum(sigma, 1e-12 * max(float(np.abs(own).max()), 1e-300)))


def _limit(n: int, degrees: int) -> float:
    """Studentised residual that one of ``n`` exceeds with a probability of ``_ODD``."""
    from scipy.special import stdtrit

    return float(-stdtrit(max(degrees, 1), 0.5 * _ODD / n))


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
    jacobians, residuals, half = _halves(at)
    if min(sum(r.size for r, h in zip(residuals, half) if h == k) for k in (0, 1)) < _FEWEST:
        return {}, []
    drift = compare_logs(jacobians, residuals, half, at.names, _VAGUE * at.errors)[0][0]
    entry = {
        "parameter": drift.parameter,
        "difference": drift.difference,
        "deviations": drift.deviations,
        "p_value": drift.p_value,
    }
    return {"halves": entry}, [_halves_notice(at, drift)] if _telling(at, drift) else []


def _halves(at: Optimum) -> tuple[list[FloatArray], list[FloatArray], list[int]]:
    """Derivatives and residuals of the parts, and which half each belongs to."""
    last = at.series[-1].run
    if last:
        return list(at.jacobians), list(at.residuals), [int(2 * s.run > last) for s in at.series]
    parts: list[list[FloatArray]] = [[], []]
    for whole, halves in zip((at.jacobians, at.residuals), parts):
        for rows in whole:
            middle = rows.shape[0] // 2
            halves += [rows[:middle], rows[middle:]]
    return parts[0], parts[1], [0, 1] * len(at.series)


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
