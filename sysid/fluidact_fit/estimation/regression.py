"""Regression of a balance of measured quantities: one estimator for every family that has one.

    Z' W (y - A x) = 0

The columns ``A`` multiply the unknowns, ``W`` are Huber's weights. A column that carries noise is
weighed by an instrument ``Z`` made of other readings [1]_; where there is none, what the noise
shifts is added to the errors. Without noise that matters ``Z`` is ``A`` and this is least squares.
The Stribeck speed, in which no balance is linear, is solved for in steps. See
``docs/theory/regression.md``.

References
----------
.. [1] W. A. Fuller, Measurement Error Models, 1987, sections 1.2 and 1.4.
.. [2] P. J. Huber, E. Ronchetti, Robust Statistics, 2nd ed., 2009, chapter 7.
.. [3] T. W. Anderson, H. Rubin, "Estimation of the parameters of a single equation in a complete
   system of stochastic equations", Annals of Mathematical Statistics 20, 1949.
.. [4] J. L. Montiel Olea, C. Pflueger, "A robust test for weak instruments", Journal of Business
   and Economic Statistics 31, 2013, table 1: one instrument, bias of 5 %.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import Notice, UsageError
from ..experiment import BoolArray, FloatArray
from .least_squares import bounded_least_squares, column_scales
from .noise import PER_MEDIAN
from .results import Solved
from .robust_weights import HUBER, SPIKE
from .stribeck import STRIBECK, Rise, RiseSearch, shape_notice, slowest_and_fastest
from .uncertainty import Uncertainty, covariance, enlarge, score_covariance, t_quantile

_BIASED = 0.03  # bias by noise of a column [standard errors] from which instruments are used
_DROWNED = 0.3  # share of noise in a column from which its bias is unknown
_WEAK = 37.4  # squared product of a column with its instrument, over its variance by noise [4]_
_SEARCHED = 4000  # samples on which the Stribeck speed is searched for
_STEPS = 12  # between Stribeck speeds, at most
_SETTLED = 1e-3  # relative change of level and speed at which the steps end

Columns = Mapping[str, FloatArray]
Limits = Mapping[str, tuple[float, float]]


def reached(at: BoolArray, width: int) -> BoolArray:
    """Samples within half the width of a filter of a chosen one, shape ``(N,)``."""
    from scipy.ndimage import maximum_filter1d

    return np.asarray(maximum_filter1d(at, width, mode="constant"))


def shared_limits(limits: Limits, names: Sequence[str]) -> tuple[float, float]:
    """Lowest and highest value of one unknown that stands for several parameters.

    Raises
    ------
    UsageError
        Where the limits have no value in common.
    """
    low, high = zip(*(limits.get(n, (-np.inf, np.inf)) for n in names))
    if max(low) > min(high):
        raise UsageError(
            f"--bounds of {' and '.join(names)} have no value in common",
            expected="They are one unknown here: the data cannot tell them apart.",
            remedy="Give both the same bounds, or leave one of them out.",
        )
    return max(low), min(high)


@dataclass(frozen=True)
class Evidence:
    """Columns and target, ``(m,)`` each, whose residuals show the noise of a balance."""

    columns: Columns
    target: FloatArray


@dataclass(frozen=True)
class Balance:
    """One run of a balance of forces, SI.

    Attributes
    ----------
    columns, target
        Factors of the unknowns by name, and the force that they have to explain, ``(n,)`` each.
    at
        Mask of these samples among those of the run, shape ``(N,)``.
    instruments
        Instruments for the columns that carry noise, by name, ``(n,)`` each.
    noises
        For every noisy signal the change of the columns by one standard deviation, ``(n,)`` each.
    kernel
        Weights by which the target was smoothed; its noise is that of ``evidence``, over the
        samples within their reach.
    evidence
        Balances whose residuals show the noise, of which the noisiest counts; the balance itself
        where there are none.
    reading, step
        Logged target, shape ``(N,)``, and the step of its converter.
    timed
        Whether the samples follow one another in time.
    """

    columns: Columns
    target: FloatArray
    at: BoolArray
    instruments: Columns = field(default_factory=dict)
    noises: Sequence[Columns] = ()
    kernel: FloatArray = field(default_factory=lambda: np.ones(1))
    evidence: Sequence[Evidence] = ()
    reading: FloatArray | None = None
    step: float = 0.0
    timed: bool = True

    @property
    def support(self) -> BoolArray:
        """Samples that the fitted ones depend on, shape ``(N,)``."""
        return reached(self.at, self.kernel.size)

    def spread(self, table: FloatArray) -> FloatArray:
        """Spread weights over the target before smoothing; ``(n, p)`` to ``(support, p)``."""
        if self.kernel.size == 1:
            return table
        full = np.zeros((self.at.size, table.shape[1]))
        full[self.at] = table
        return np.column_stack([np.convolve(c, self.kernel, "same") for c in full.T])[self.support]


@dataclass(frozen=True)
class RegressionModel:
    """A balance that is linear in its unknowns, but for the Stribeck speed.

    Attributes
    ----------
    balances
        Gives every run, linear about a Stribeck level and speed.
    speed
        Velocities of the samples that are fitted, of all runs, ``(n,)`` [m/s or rad/s].
    least_speed
        Speed below which there is only noise [m/s or rad/s].
    least_residual
        Standard deviation of the smallest error that the target can have [N or N m].
    """

    balances: Callable[[Rise], Sequence[Balance]]
    speed: FloatArray = field(default_factory=lambda: np.zeros(0))
    least_speed: float = 0.0
    least_residual: float = 0.0


@dataclass(frozen=True)
class Regression:
    """A solved balance.

    Attributes
    ----------
    free, values
        Solution without bounds, and values within them, both with those that were held [SI].
    residuals
        Of every run, shape ``(n_i,)``.
    scale, limit
        Robust standard deviation of the residuals, and the size from which they have no weight.
    uncertainty
        Of the free solution.
    instrumented
        Whether instruments were needed.
    speed
        Stribeck speed about which the balance was made linear [m/s or rad/s].
    estimator
        What solved it.
    """

    free: Solved
    values: dict[str, float]
    residuals: list[FloatArray]
    scale: float
    limit: float
    uncertainty: Uncertainty
    instrumented: bool
    speed: float
    estimator: Estimator

    def spikes(self, least: float = 0.0) -> int:
        """Number of samples without weight, further off than ``least``."""
        limit = max(self.limit, least)
        return int(sum(np.count_nonzero(np.abs(r) > limit) for r in self.residuals))

    def spike_notices(
        self, least: float, say: Callable[[float], str], sensor: str
    ) -> Iterator[Notice]:
        """Warn of samples that no friction explains.

        A sample of the other direction is off by the distance of the levels (``least``), and noise
        with long tails by more than normal noise; neither is a fault of the sensor.
        """
        count, limit = self.spikes(least), max(self.limit, least)
        if not count:
            return
        yield Notice(
            "force-spikes",
            f"{count} of {sum(r.size for r in self.residuals)} samples lie more than {say(limit)} "
            f"off the fit and were given no weight: spikes of the {sensor}, contact at the end of "
            "the stroke, or a force unlike that of the equation. Look at the picture (--plot) and "
            "leave them out with --window.",
        )


@dataclass(frozen=True)
class _Robust:
    """Values ``(p,)``, inverse ``(p, p)``, weights ``(n,)``, scale and limit of the residuals."""

    values: FloatArray
    inverse: FloatArray
    weight: FloatArray
    scale: float
    limit: float


class Estimator:
    """The estimate of some unknowns of a balance, with others held.

    Parameters
    ----------
    model
        The balance.
    names
        The unknowns; a run whose balance has no such column does not depend on it.
    held
        Values of the others [SI].
    limits
        Lowest and highest value by name [SI].
    spike
        Distance from the model below which no sample loses its weight.
    """

    def __init__(
        self,
        model: RegressionModel,
        names: Sequence[str],
        held: Mapping[str, float] | None = None,
        limits: Limits | None = None,
        spike: float = 0.0,
    ) -> None:
        self.model, self.names, self.held = model, tuple(names), dict(held or {})
        self.limits, self.spike = limits or {}, spike

    def solve(self) -> Regression:
        """Solve; where the Stribeck speed is unknown, repeatedly about the latest one."""
        if not self.names:
            residuals = [self._table(b)[1] for b in self.model.balances(Rise())]
            nothing = Uncertainty(np.zeros((0, 0)), 1, 0.0, 0)
            free = Solved(self.held, (), nothing.covariance, 1)
            return Regression(free, self.held, residuals, 0.0, np.inf, nothing, False, 0.0, self)
        if "stribeck_speed" not in self.names:
            return self._about(Rise(*(self.held.get(n, 0.0) for n in STRIBECK)))
        rise = Rise(*self.search().rise[1:])
        found = self._about(rise)
        low, high = slowest_and_fastest(self.model.speed, self.model.least_speed)
        for _ in range(_STEPS):
            level, speed = (found.free.values[n] for n in STRIBECK)
            # no further at once than where the term is still the same one
            speed = float(np.clip(speed, 0.6 * rise.speed, 1.6 * rise.speed))
            speed = float(np.clip(speed, 0.5 * low, 2.0 * high))
            # about too high a level the speed hardly moves, and would seem well known
            off = abs(speed - rise.speed) / speed, abs(level - rise.level) / max(abs(level), 1e-300)
            if max(off) < _SETTLED:
                break
            rise = Rise(level, speed)
            found = self._about(rise)
        return found

    def search(self, exponent: float = 2.0) -> RiseSearch:
        """The Stribeck speed over the range of the motion, on part of the samples."""
        others = Estimator(self.model, [n for n in self.names if n != "stribeck_speed"], self.held)
        speeds = self.model.speed
        every = -(-speeds.size // _SEARCHED)

        def solve(speed: float) -> tuple[float, float]:
            """Squared mean absolute residual, robust against spikes, and the level."""
            runs = self.model.balances(Rise(0.0, speed, exponent))
            tables = []
            for b in runs:
                # noise of a reading would make a law better that has less viscous friction
                quiet = b.evidence[-1].columns if b.evidence and b.kernel.size == 1 else b.columns
                tables.append(others._table(replace(b, columns=quiet)))
            a, y = (np.concatenate(parts)[::every] for parts in zip(*tables))
            best = _solve(a, a, y, (self.model.least_residual, 0.0))
            level = {**self.held, **dict(zip(others.names, best.values.tolist()))}["stribeck"]
            return float(np.mean(np.abs(y - a @ best.values))) ** 2, level

        ends = slowest_and_fastest(speeds, self.model.least_speed)
        return RiseSearch(ends, -(-speeds.size // every), solve)

    def other_shape(self) -> Iterator[Notice]:
        """Warn if another law of the rise fits as well with as many unknowns."""
        if set(STRIBECK) <= set(self.names):
            yield from shape_notice(self.search)

    def _table(self, balance: Balance | Evidence) -> tuple[FloatArray, FloatArray]:
        """Columns of the unknowns, ``(n, p)``, and the target less the held terms, ``(n,)``."""
        size = balance.target.size
        right = balance.target
        for name, value in self.held.items():
            if name in balance.columns and name != "stribeck_speed" and value:
                right = right - value * balance.columns[name]
        columns = [balance.columns.get(n, np.zeros(size)) for n in self.names]
        return np.column_stack(columns) if columns else np.zeros((size, 0)), right

    def _about(self, rise: Rise) -> Regression:
        """Least squares about a rise, or with instruments where noise would bias it."""
        runs = self.model.balances(rise)
        tables = [self._table(b) for b in runs]
        a, y = (np.concatenate(parts) for parts in zip(*tables))
        least = (self.model.least_residual, self.spike)
        start = np.array([rise.speed if n == "stribeck_speed" else 0.0 for n in self.names])
        best = _solve(a, a, y, least)
        found = self._spread(runs, best, a)
        errors = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
        added = self._noise_products(runs, best.weight)
        bias = best.inverse @ added @ best.values
        own = 1.0 / np.maximum(np.diag(best.inverse), 1e-300)
        drowned = np.diag(added) > _DROWNED * own
        noisy = bool(np.any(drowned | (np.abs(bias) > _BIASED * errors)))
        instrumented = noisy and any(b.instruments for b in runs)
        if instrumented:
            z = np.concatenate(
                [_stack(b, self.names, {**b.columns, **b.instruments}) for b in runs]
            )
            best = _solve(a, z, y, least)
            found = _reaching(self._spread(runs, best, z), best, a, z, y)
        elif noisy:
            variances = np.where(drowned, np.inf, errors**2 + bias**2)
            found = replace(found, covariance=enlarge(found.covariance, variances))
        values = dict(zip(self.names, (best.values + start).tolist()))
        solved = Solved(
            {**self.held, **values}, self.names, found.covariance, found.degrees,
            independent=found.independent,
        )  # fmt: skip
        x = self._bounded(a, best.values, start)
        within = {**self.held, **dict(zip(self.names, (x + start).tolist()))}
        cuts = np.cumsum([b.target.size for b in runs])[:-1]
        return Regression(
            solved, within, np.split(y - a @ x, cuts), best.scale, best.limit, found,
            instrumented, rise.speed, self,
        )  # fmt: skip

    def _noise_products(self, runs: Sequence[Balance], weight: FloatArray) -> FloatArray:
        """Expected products of the noise in the columns, weighted, shape ``(p, p)``."""
        p = len(self.names)
        total, first = np.zeros((p, p)), 0
        for b in runs:
            own = weight[first : first + b.target.size]
            first += b.target.size
            for part in b.noises:
                table = _stack(b, self.names, part)
                total += (own[:, None] * table).T @ table
        return total

    def _bounded(self, a: FloatArray, x: FloatArray, start: FloatArray) -> FloatArray:
        """The solution within the limits, shape ``(p,)``; equal limits hold an unknown."""
        ends = [self.limits.get(n, (-np.inf, np.inf)) for n in self.names]
        low, high = (np.array(e) - start for e in zip(*ends))
        if not np.any((x < low) | (x > high)):
            return x
        return bounded_least_squares(a, a @ x, low, high)[0]

    def _spread(self, runs: Sequence[Balance], best: _Robust, z: FloatArray) -> Uncertainty:
        """Covariance under autocorrelated noise, and at least that of the scores.

        Noise may be larger where it matters more: near reversals, or in a steep Stribeck term.
        """
        cuts = np.cumsum([b.target.size for b in runs])[:-1]
        jacobian = _equivalent(runs, np.split(best.weight[:, None] * z, cuts), best.inverse)
        sets = [
            [self._rest(e, best) for e in sources]
            for sources in zip(*(b.evidence or (Evidence(b.columns, b.target),) for b in runs))
        ]
        scattered = score_covariance(jacobian, sets[0], [[slice(0, r.size)] for r in sets[0]])
        return _widest([*(self._covariance(runs, jacobian, r) for r in sets), scattered])

    def _rest(self, evidence: Evidence, best: _Robust) -> FloatArray:
        """Residuals of evidence, shape ``(m,)``, with zeros for samples without weight."""
        a, y = self._table(evidence)
        rest = y - a @ best.values
        end = max(
            SPIKE * PER_MEDIAN * float(np.median(np.abs(rest))) if rest.size else 0.0, best.limit
        )
        return np.where(np.abs(rest) > end, 0.0, rest)

    def _covariance(
        self, runs: Sequence[Balance], jacobian: Sequence[FloatArray], rests: Sequence[FloatArray]
    ) -> Uncertainty:
        """Covariance from residuals, autocorrelated within stretches of samples."""
        columns, series, readings = [], [], []
        for b, j, r in zip(runs, jacobian, rests):
            at = b.support
            cuts = _stretches(at)
            columns += [part for part in np.split(j, cuts) if part.size]
            series += [part for part in np.split(r, cuts) if part.size]
            if b.reading is not None:
                readings += [(p, b.step) for p in np.split(b.reading[at], cuts) if p.size]
        timed = all(b.timed for b in runs)
        return covariance(columns, series, robust=timed, small_sample=True, readings=readings)


def _stack(balance: Balance, names: Sequence[str], columns: Columns) -> FloatArray:
    """Columns by name, zero where there is none, shape ``(n, p)``."""
    nothing = np.zeros(balance.target.size)
    return np.column_stack([columns.get(n, nothing) for n in names])


def _invert(matrix: FloatArray) -> FloatArray:
    """Inverse of a matrix ``(p, p)`` of unknowns of any size."""
    scale = np.sqrt(np.abs(np.diag(matrix)))
    scale = np.where(scale > 0.0, scale, 1.0)
    inverse = np.linalg.pinv(matrix / np.outer(scale, scale), rcond=1e-13)
    return np.asarray(inverse / np.outer(scale, scale))


def _solve(a: FloatArray, z: FloatArray, y: FloatArray, least: tuple[float, float]) -> _Robust:
    """Values by iterated reweighting [2]_; ``least`` are scale and limit of the residuals."""
    weight, x, scale, limit = np.ones(y.size), np.zeros(a.shape[1]), 0.0, np.inf
    inverse = np.zeros((x.size, x.size))
    norm = column_scales(a)
    for _ in range(30):
        weighted = weight[:, None] * z
        inverse = _invert(weighted.T @ a)
        now = inverse @ (weighted.T @ y)
        now = now + inverse @ (weighted.T @ (y - a @ now))  # removes rounding errors
        size = np.abs(y - a @ now)
        scale = max(PER_MEDIAN * float(np.median(size)), least[0])
        limit = max(SPIKE * scale, least[1])
        done = np.all(np.abs(now - x) <= 1e-10 * (np.abs(now) + scale / norm))
        x = now
        fresh = np.minimum(1.0, HUBER * scale / np.maximum(size, 1e-300))
        fresh[size > limit] = 0.0
        if done or np.array_equal(fresh, weight):
            break
        weight = fresh
    return _Robust(x, inverse, weight, scale, limit)


def _equivalent(
    runs: Sequence[Balance], instruments: Sequence[FloatArray], inverse: FloatArray
) -> list[FloatArray]:
    """Jacobians, per run, of a least-squares estimate with the gains ``Z inverse'``."""
    spread = [b.spread(z) for b, z in zip(runs, instruments)]
    gains = np.vstack(spread) @ inverse.T
    size = column_scales(gains)
    gains = gains / size
    jacobian = gains @ np.linalg.pinv(gains.T @ gains) / size
    return np.split(jacobian, np.cumsum([z.shape[0] for z in spread])[:-1])


def _widest(found: Sequence[Uncertainty]) -> Uncertainty:
    """Return the first uncertainty, widened to the largest variances of all."""
    most = np.max([np.diag(u.covariance) for u in found], axis=0)
    first = found[0]
    return replace(
        first,
        covariance=enlarge(first.covariance, most),
        degrees=min(u.degrees for u in found),
        order=max(u.order for u in found),
        independent=min(u.independent for u in found),
    )


def _stretches(at: BoolArray) -> list[int]:
    """Boundaries between stretches of consecutive samples, as indices into the chosen ones.

    Stretches of fewer than 20 samples stay with the one before them.
    """
    index = np.flatnonzero(at)
    out: list[int] = []
    for cut in (np.flatnonzero(np.diff(index) > 1) + 1).tolist():
        if cut - (out[-1] if out else 0) >= 20 and index.size - cut >= 20:
            out.append(cut)
    return out


def _reaching(
    found: Uncertainty, best: _Robust, a: FloatArray, z: FloatArray, y: FloatArray
) -> Uncertainty:
    """Widen an uncertainty to the range that poor instruments leave open; infinite where weak.

    With ``x`` the projected column beside all others, ``e`` what the projection left of the column
    and ``r`` the residual, a value ``d`` off is possible where
    ``d^2 (x'x)^2 <= t^2 var(x'(r - d e))`` [3]_.
    """
    root = np.sqrt(best.weight)[:, None]
    columns, residual = root * a, root[:, 0] * (y - a @ best.values)
    size = column_scales(z)
    projected = root * z / size @ np.linalg.lstsq(root * z / size, columns, rcond=1e-12)[0]
    t = t_quantile(0.975, found.degrees)
    variances = np.zeros(a.shape[1])
    for k in range(a.shape[1]):
        others = np.delete(projected, k, axis=1)
        others = others / column_scales(others)
        own = projected[:, k] - others @ np.linalg.lstsq(others, projected[:, k], rcond=1e-12)[0]
        left = columns[:, k] - projected[:, k]
        reach = _reach(own, left, residual, float(found.covariance[k, k]), t)
        variances[k] = reach**2 / t**2
    return replace(found, covariance=enlarge(found.covariance, variances))


def _reach(
    own: FloatArray, left: FloatArray, residual: FloatArray, variance: float, t: float
) -> float:
    """Distance from the estimate to the farther end of the confidence set."""
    x = float(own @ own)
    if not x or not np.any(residual) or float(left @ left) <= 1e-18 * x:  # rounding
        return 0.0

    def of(series: FloatArray) -> float:
        """Variance of its product with the instrument."""
        rows = [slice(0, series.size)]
        found = score_covariance([own[:, None]], [series], [rows]).covariance
        return x**2 * float(found[0, 0])

    scale = float(np.linalg.norm(residual) / np.linalg.norm(left))
    alone, ee = of(residual / scale), of(left)
    re = 0.5 * (of(residual / scale + left) - alone - ee) * scale
    rr = max(alone * scale**2, variance * x**2)
    if x**2 <= max(_WEAK, t**2) * ee:
        return np.inf
    rr, re, ee = t**2 * rr, t**2 * re, t**2 * ee
    return (abs(re) + float(np.sqrt(re**2 + (x**2 - ee) * rr))) / (x**2 - ee)
