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

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..errors import Notice
from ..estimation.agreement_of_logs import Drift, compare_logs
from ..estimation.blocks import blocks, condense, rows_of
from ..experiment import BoolArray, FloatArray
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
class Effect:
    """What one sample does to the estimate.

    Attributes
    ----------
    series, row
        Where it is: the series, and the row among its used samples.
    leverage, deviations
        Entry on the diagonal of the hat matrix, and studentised residual.
    odd
        Whether that is too large for one of that many.
    parameter, errors
        Number of the parameter that it moves most, and by how many standard errors.
    """

    series: int
    row: int
    leverage: float
    deviations: float
    odd: bool
    parameter: int
    errors: float

    @property
    def deciding(self) -> bool:
        """Whether the result hangs on it."""
        return abs(self.errors) > (_MOVES if self.odd else _CARRIES)

    @property
    def outlying(self) -> bool:
        """Whether no model near this one explains it: it is odd, and decides or lies far off."""
        return self.odd and (abs(self.errors) > _MOVES or abs(self.deviations) > _FAR)


@dataclass(frozen=True)
class Influence:
    """What the samples do to the estimate.

    Attributes
    ----------
    leverage, most
        The largest leverage, and the most standard errors by which one moves a parameter.
    effects
        Those of samples that decide or lie far off, in order.
    odd
        Which samples of every series are odd, shape ``(n_i,)`` each.
    inverse
        That of the triangle of the derivatives: rows of them times it are those of the
        orthogonal factor, shape ``(p, p)``.
    """

    leverage: float
    most: float
    effects: Sequence[Effect]
    odd: Sequence[BoolArray]
    inverse: FloatArray


def measure_influence(at: Optimum) -> Influence | None:
    """What every sample does to the estimate; ``None`` where too few of them tell."""
    table = condense(rows_of(at.jacobians))
    n, p = sum(r.size for r in at.residuals), table.shape[1]
    if n <= p + 10:
        return None
    scale = np.linalg.norm(table, axis=0)
    scale[scale == 0.0] = 1.0
    triangle = np.linalg.qr(table / scale, mode="r")
    if np.min(np.abs(np.diag(triangle))) < 1e-9:
        return None
    inverse = np.linalg.inv(triangle) / scale[:, None]
    each = _Leverages(at, inverse, _Scatter.of(at.residuals, p))
    leverage, most, effects = 0.0, 0.0, []
    odd = [np.zeros(r.size, dtype=bool) for r in at.residuals]
    for series, part in _blocks(at.residuals):
        own, errors = each.of(series, part)
        size = np.abs(errors).max(axis=1)
        deviations = each.scatter.studentised(at.residuals[series][part], own)
        leverage, most = max(leverage, float(own.max())), max(most, float(size.max()))
        odd[series][part] = np.abs(deviations) > each.limit
        for i in np.flatnonzero(odd[series][part] | (size > _CARRIES)):
            k = int(np.argmax(np.abs(errors[i])))
            strange = bool(odd[series][part.start + i])
            found = (float(own[i]), float(deviations[i]), strange, k, float(errors[i, k]))
            effects.append(Effect(series, part.start + int(i), *found))
    return Influence(leverage, most, effects, odd, inverse)


def find_deciding_samples(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """Samples that the result hangs on: an entry for the file, and a warning."""
    influence = measure_influence(at)
    if influence is None:
        return {}, []
    entry: dict[str, Any] = {
        "largest_influence": influence.most, "largest_leverage": influence.leverage
    }  # fmt: skip
    deciding = sorted((e for e in influence.effects if e.deciding), key=lambda e: -abs(e.errors))
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


def _blocks(residuals: Sequence[FloatArray]) -> Iterator[tuple[int, slice]]:
    """Blocks of all series."""
    return ((k, part) for k, r in enumerate(residuals) for part in blocks(r.size))


@dataclass(frozen=True)
class _Scatter:
    """Size of the residuals of a fit of ``p`` unknowns.

    ``squares`` is the sum of their squares, ``robust`` their standard deviation by the median,
    ``largest`` the largest of them.
    """

    samples: int
    p: int
    squares: float
    robust: float
    largest: float

    @classmethod
    def of(cls, residuals: Sequence[FloatArray], p: int) -> _Scatter:
        """The scatter of all series together."""
        size = np.concatenate([np.abs(r) for r in residuals])
        n = size.size
        squares, largest = float(size @ size), float(size.max())
        median = float(np.median(size, overwrite_input=True))
        return cls(n, p, squares, 1.4826 * median * np.sqrt(n / max(n - p, 1)), largest)

    def studentised(self, r: FloatArray, leverage: FloatArray) -> FloatArray:
        """Residuals in standard deviations of the others, robust against many odd ones."""
        own = r / np.sqrt(1.0 - leverage)
        degrees = max(self.samples - self.p - 1, 1)
        sigma = np.sqrt(np.maximum(self.squares - own**2, 0.0) / degrees)
        # a residual that is mostly zero (a counter at rest) has no robust size
        sigma = sigma if self.robust == 0.0 else np.minimum(sigma, 2.0 * self.robust)
        # of a residual that is one sample alone nothing is left but rounding
        return np.asarray(own / np.maximum(sigma, 1e-12 * max(self.largest, 1e-300)))


@dataclass(frozen=True)
class _Leverages:
    """Leverage of samples and how far each moves the parameters.

    ``inverse`` is that of the triangle of the derivatives, shape ``(p, p)``.
    """

    at: Optimum
    inverse: FloatArray
    scatter: _Scatter

    @cached_property
    def limit(self) -> float:
        """Studentised residual beyond which a sample is odd."""
        return _limit(self.scatter.samples, self.scatter.samples - self.scatter.p - 1)

    def of(self, series: int, part: slice) -> tuple[FloatArray, FloatArray]:
        """Leverage, ``(m,)``, and moves in standard errors, ``(m, p)``."""
        q = self.at.jacobians[series][part] @ self.inverse
        leverage = np.minimum(np.sum(q**2, axis=1), 1.0 - 1e-9)
        r = self.at.residuals[series][part]
        moves = (q * (r / (1.0 - leverage))[:, None]) @ self.inverse.T
        return leverage, np.asarray(moves / self.at.errors)


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
