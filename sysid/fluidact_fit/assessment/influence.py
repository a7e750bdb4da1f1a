"""Influential samples, outliers, and halves of the data that disagree.

With the derivatives ``J`` of a least-squares fit the estimate without sample ``i`` differs by
``(J'J)^-1 J_i' r_i / (1 - h_i)``, ``h_i`` being the leverage of the sample, the diagonal of
``J (J'J)^-1 J'`` [1]_. A single sample far from what all others predict is an outlier: it is
replaced by the prediction of the others, and the fit is repeated. Where the model misses several
samples in a row, or those after a jump of an input, the model is wrong there, and no sample is set
aside.

References
----------
.. [1] R. D. Cook, S. Weisberg, Residuals and Influence in Regression, 1982.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import Notice
from ..estimation.agreement_of_logs import LogDisagreement, compare_logs
from ..estimation.blocks import condensed
from ..estimation.noise import PER_MEDIAN
from ..experiment import Experiment, FloatArray, IndexArray
from ..logs.log import count_of
from ..logs.spikes import where_inputs_move
from ..rows import blocks, square_sum
from ..units import as_share
from . import policy
from .optimum import Optimum

_LISTED = 5  # samples that a message names
_WIDEST = 2  # consecutive samples that may be outliers


@dataclass(frozen=True)
class Effect:
    """Effect of one sample on the estimate.

    Attributes
    ----------
    series, row
        Index of the series, and of the row among its used samples.
    leverage, deviations
        Diagonal entry of the hat matrix, and studentised residual.
    odd
        Whether that residual is too large for one of that many.
    parameter, standard_errors
        Index of the parameter that it moves most, and by how many standard errors.
    """

    series: int
    row: int
    leverage: float
    deviations: float
    odd: bool
    parameter: int
    standard_errors: float

    @property
    def deciding(self) -> bool:
        """Return whether the sample dominates the result."""
        return abs(self.standard_errors) > (policy.ODD_MOVES if self.odd else policy.ANY_MOVES)

    @property
    def outlying(self) -> bool:
        """Return whether no similar model explains it: it is odd, and decides or lies far off."""
        far = abs(self.deviations) > policy.FAR
        return self.odd and (abs(self.standard_errors) > policy.ODD_MOVES or far)


@dataclass(frozen=True)
class Influence:
    """Effects of the samples on the estimate.

    Attributes
    ----------
    largest_leverage, largest_influence
        The largest leverage, and the most standard errors by which a sample moves a parameter.
    effects
        Effects of the samples that are deciding or outlying, in order.
    odd
        Rows of every series that are odd, in order, shape ``(m_i,)`` each.
    inverse
        Inverse of the triangular factor of the derivatives, shape ``(p, p)``: rows of derivatives
        times it are rows of the orthogonal factor.
    """

    largest_leverage: float
    largest_influence: float
    effects: Sequence[Effect]
    odd: Sequence[IndexArray]
    inverse: FloatArray


def measure_influence(
    jacobians: Sequence[FloatArray], residuals: Sequence[FloatArray], std_errors: FloatArray
) -> Influence | None:
    """Measure the effect of every sample on the estimate; ``None`` if there are too few.

    Parameters
    ----------
    jacobians, residuals
        Of every series, shapes ``(n_i, p)`` and ``(n_i,)``.
    std_errors : (p,)
        Standard errors of the parameters.
    """
    from scipy.special import stdtrit

    table = condensed(jacobians)
    n, p = sum(r.size for r in residuals), table.shape[1]
    if n <= p + 10:
        return None
    scale = np.linalg.norm(table, axis=0)
    scale[scale == 0.0] = 1.0
    triangle = np.linalg.qr(table / scale, mode="r")
    if np.min(np.abs(np.diag(triangle))) < 1e-9:
        return None
    inverse = np.linalg.inv(triangle) / scale[:, None]
    squares, degrees = sum(map(square_sum, residuals)), max(n - p - 1, 1)
    robust = _robust_deviation(residuals, p, np.sqrt(squares / degrees))
    limit = float(-stdtrit(degrees, 0.5 * policy.ODD / n))
    leverage, influence, effects = 0.0, 0.0, []
    odd: list[IndexArray] = []
    for series, (jacobian, residual) in enumerate(zip(jacobians, residuals, strict=True)):
        # where one sample alone has a residual, the rest of them is rounding
        least = max(1e-12 * np.abs(residual).max(initial=0.0), 1e-300)
        places = []
        for at in blocks(residual.size):
            q, r = jacobian[at] @ inverse, residual[at]
            own = np.minimum(np.einsum("ij,ij->i", q, q), 1.0 - 1e-9)
            studentised = r / np.sqrt(1.0 - own)
            sigma = np.sqrt(np.maximum(squares - studentised**2, 0.0) / degrees)
            deviations = studentised / np.maximum(np.minimum(sigma, 2.0 * robust), least)
            moved = (q * (r / (1.0 - own))[:, None]) @ inverse.T / std_errors
            size = np.abs(moved).max(axis=1)
            leverage = max(leverage, float(own.max(initial=0.0)))
            influence = max(influence, float(size.max(initial=0.0)))
            strange = np.abs(deviations) > limit
            places.append(at.start + np.flatnonzero(strange))
            for i in np.flatnonzero(strange | (size > policy.ANY_MOVES)):
                k = int(np.argmax(np.abs(moved[i])))
                effect = Effect(
                    series, at.start + int(i), float(own[i]), float(deviations[i]),
                    bool(strange[i]), k, float(moved[i, k]),
                )  # fmt: skip
                effects += [effect] if effect.deciding or effect.outlying else []
        odd.append(np.concatenate(places))
    return Influence(leverage, influence, effects, odd, inverse)


def _robust_deviation(residuals: Sequence[FloatArray], p: int, deviation: float) -> float:
    """Standard deviation by the median, robust against many odd samples.

    It is infinite where it does not differ enough from ``deviation`` to matter, or where the
    residual is mostly zero (a counter at rest).
    """
    n = sum(r.size for r in residuals)
    per_median = PER_MEDIAN * np.sqrt(n / max(n - p, 1))
    found = per_median * float(np.median(np.abs(np.concatenate(residuals))))
    return found if 0.0 < found < 0.5 * deviation else np.inf


def find_deciding_samples(
    at: Optimum, influence: Influence | None
) -> tuple[dict[str, Any], list[Notice]]:
    """Find samples that dominate the result: an entry for the file, and a warning."""
    if influence is None:
        return {}, []
    entry: dict[str, Any] = {
        "largest_influence": influence.largest_influence,
        "largest_leverage": influence.largest_leverage,
    }
    deciding = [e for e in influence.effects if e.deciding and _matters(at, e)]
    if not deciding:
        return entry, []
    deciding.sort(key=lambda e: -abs(e.standard_errors))
    entry["samples"] = [
        {
            "place": at.place(e.series, e.row),
            "deviations": e.deviations,
            "parameter": at.names[e.parameter],
            "shift": -e.standard_errors * float(at.std_errors[e.parameter]),
            "errors": -e.standard_errors,
        }
        for e in deciding[:_LISTED]
    ]
    return entry, [_deciding_notice(entry["samples"], len(deciding), at)]


def _matters(at: Optimum, e: Effect) -> bool:
    """Return whether a sample moves a parameter by more than a bench can tell."""
    moved = abs(e.standard_errors) * float(at.std_errors[e.parameter])
    return moved > policy.LEAST * abs(at.number(at.names[e.parameter]))


def _deciding_notice(found: Sequence[dict[str, Any]], count: int, at: Optimum) -> Notice:
    first, off = found[0], abs(found[0]["deviations"])
    others = "" if count == 1 else f" and {count - 1} more"
    verb, it = ("decides", "it") if count == 1 else ("decide", "that first one")
    listed = ", ".join(s["place"] for s in found[1:])
    return Notice(
        "few-samples-decide",
        f"{first['place']}{others} {verb} {first['parameter']}: without {it} it would change by "
        f"{first['shift']:+.3g}{at.unit(first['parameter'])}, {abs(first['errors']):.1f} standard "
        f"errors; the model misses {it} by "
        f"{f'{off:.0f} times' if off < 1000.0 else 'over 1000 times'} the usual scatter."
        + (f" The others: {listed}." if listed else "")
        + " Look at the log there (--plot) and delete rows that are wrong; where they are steps or "
        "reversals, sample faster.",
    )


@dataclass(frozen=True)
class Outlier:
    """A sample that was set aside.

    Attributes
    ----------
    run, role, sample
        Index of the run, role, and index of the sample; both count from 0.
    place
        Log and instant, as a message names them.
    measured, replaced
        Recorded value, and the one that was fitted instead [``unit``].
    text
        Both values in the unit of the log.
    """

    run: int
    role: str
    sample: int
    place: str
    measured: float
    replaced: float
    unit: str
    text: str = ""

    @property
    def reading(self) -> tuple[int, str, int]:
        """Identity of the reading: run, role, sample."""
        return self.run, self.role, self.sample

    @property
    def entry(self) -> dict[str, Any]:
        """Entry for the file."""
        names = ("place", "role", "measured", "replaced", "unit")
        return {name: getattr(self, name) for name in names}


def find_outliers(at: Optimum, influence: Influence | None) -> list[Outlier] | None:
    """Find samples to set aside; ``None`` where an outlying one cannot be set aside."""
    found = [] if influence is None else [e for e in influence.effects if e.outlying]
    if influence is None or not found:
        return []
    held = any(e.leverage >= policy.OUTLIER_LEVERAGE for e in found)
    if held or len(found) > most_outliers(at.samples) or not _alone(at, influence, found):
        return None
    # prediction errors of the model of all others: (I - H)^-1 r, H their part of the hat matrix
    q = np.array([at.jacobians[e.series][e.row] for e in found]) @ influence.inverse
    r = np.array([at.residuals[e.series][e.row] for e in found])
    missed = np.linalg.solve(np.eye(len(found)) - q @ q.T, r)
    out = []
    for e, off in zip(found, missed):
        s = at.series[e.series]
        signal, k = s.experiment.signals[s.role], int(np.flatnonzero(s.used)[e.row])
        if signal.values.size != s.used.size:
            return None
        value = float(signal.values[k])
        left = value - float(off) * s.scale
        value = float(signal.recorded.get(k, value))  # the reading may have been replaced before
        text = f"{signal.text(value, '.4g')} instead of {signal.text(left, '.4g')}"
        place = at.place(e.series, e.row)
        out.append(Outlier(s.run, s.role, k, place, value, left, signal.unit, text))
    return out


def most_outliers(samples: int) -> int:
    """Return how many out of so many samples can be outliers at most."""
    return int(min(policy.OUTLIERS, max(3, policy.OUTLIER_SHARE * samples)))


def _alone(at: Optimum, influence: Influence, found: Sequence[Effect]) -> bool:
    """Return whether no long row of samples is odd, and no input jumped at an outlying one."""
    for series in {e.series for e in found}:
        s, odd = at.series[series], influence.odd[series]
        if np.any(odd[_WIDEST:] - odd[:-_WIDEST] == _WIDEST):  # more in a row than that
            return False
        if s.experiment.time.size:
            moved = where_inputs_move(s.experiment, at.variant)[s.used]
            if any(moved[e.row] for e in found if e.series == series):
                return False
    return True


def set_aside(runs: Sequence[Experiment], outliers: Sequence[Outlier]) -> list[Experiment]:
    """Return the runs with the values of the model in the place of outliers."""
    out = list(runs)
    for o in outliers:
        signal = out[o.run].signals[o.role]
        values = signal.values.copy()
        values[o.sample] = o.replaced
        recorded = {o.sample: o.measured, **signal.recorded}
        signal = replace(signal, values=values, recorded=recorded)
        out[o.run] = replace(out[o.run], signals={**out[o.run].signals, o.role: signal})
    return out


def outlier_notice(outliers: Sequence[Outlier]) -> Notice:
    """Warn of the samples that were set aside."""
    n = len(outliers)
    listed = "; ".join(f"{o.place}: {o.text}" for o in outliers[:_LISTED])
    more = f"; and {n - _LISTED} more, all in fit.details" if n > _LISTED else ""
    one = n == 1
    verb, was, which = ("lies", "was", "it lies") if one else ("lie", "were", "they lie")
    return Notice(
        "outliers",
        f"{count_of(n, 'sample')} {verb} far outside what the rest of the data allow, and {was} "
        f"left out of the fit, which would have followed {'it' if one else 'them'} ({listed}"
        f"{more}). "
        f"Check the cable, the converter and the logger; where {which} at reversals, sample "
        "faster.",
    )


def find_disagreeing_halves(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """Compare the two halves of the data: an entry for the file, and a warning."""
    # noise of an input attenuates the estimates of a slow half and of a fast one differently
    (jacobians, residuals), half = _halves(at, [at.instruments or at.jacobians, at.residuals])
    fewest = min(sum(r.size for r, h in zip(residuals, half) if h == k) for k in (0, 1))
    if fewest < policy.FEW:
        return {}, []
    compared = jacobians, residuals, half, at.names, policy.HALVES_KNOW
    drift = compare_logs(*compared)[0][0]
    if _differ(at, drift):  # errors of a converter take longer to compute, and excuse more
        (measured,), _ = _halves(at, [at.measured])
        steps = [s.resolution for s in at.series for _ in range(len(measured) // len(at.series))]
        drift = compare_logs(*compared, list(zip(measured, steps, strict=True)))[0][0]
    entry = {
        "parameter": drift.parameter,
        "difference": drift.difference,
        "deviations": drift.deviations,
        "p_value": drift.p_value,
    }
    return {"halves": entry}, [_halves_notice(at, drift)] if _differ(at, drift) else []


def _halves(
    at: Optimum, tables: Sequence[Sequence[FloatArray]]
) -> tuple[list[list[FloatArray]], list[int]]:
    """Split tables of all series, and say which half of the data, 0 or 1, each part is of."""
    last = at.series[-1].run
    if last:
        return [list(t) for t in tables], [int(2 * s.run > last) for s in at.series]
    parts = []
    for table in tables:
        cuts = [(rows, rows.shape[0] // 2) for rows in table]
        parts.append([part for rows, k in cuts for part in (rows[:k], rows[k:])])
    return parts, [0, 1] * len(at.series)


def _differ(at: Optimum, d: LogDisagreement) -> bool:
    least = policy.HALVES_DIFFER * abs(at.number(d.parameter))
    return d.p_value < policy.HALVES and abs(d.difference) > least


def _halves_notice(at: Optimum, d: LogDisagreement) -> Notice:
    return Notice(
        "halves-disagree",
        f"the first and the second half of the data give a {d.parameter} that differs by "
        f"{d.difference:+.3g}{at.unit(d.parameter)}"
        f"{as_share(d.difference, at.number(d.parameter))}, "
        f"{abs(d.deviations):.1f} standard errors: the machine changed while it was recorded, or "
        "the model describes only part of what it did. Fit the halves separately (--window) and "
        "look at both pictures.",
    )
