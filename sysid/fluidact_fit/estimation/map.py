"""Estimator of static maps: a curve or a network that gives one quantity at some inputs.

A family declares a :class:`MapModel`: the value of the map for its unknowns, the derivatives, and
bounds, which can also make it monotone. Search from several starts, cross-validation over whole
positions or logs, lone samples, and lack of fit are here.

References
----------
.. [1] T. Hastie, R. Tibshirani, J. Friedman, The Elements of Statistical Learning, 2nd ed.,
   2009, section 7.10: cross-validation and the one-standard-error rule.
.. [2] N. Draper, H. Smith, Applied Regression Analysis, 3rd ed., 1998, section 2.1: lack of
   fit and pure error.
.. [3] G. Golub, V. Pereyra, "The differentiation of pseudo-inverses and nonlinear least squares
   problems whose variables separate", SIAM Journal on Numerical Analysis 10, 1973.
.. [4] J. Cook, L. Stefanski, "Simulation-extrapolation estimation in parametric measurement error
   models", J. American Statistical Association 89, 1994.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from ..errors import Notice
from ..experiment import BoolArray, Experiment, FloatArray
from ..rows import middle_of, square_sum
from .budget import exhausted, simulated
from .least_squares import scaled_least_squares
from .minimise import Minimum, minimise
from .motion_state import running_median
from .noise import PER_MEDIAN
from .robust_weights import SPIKE
from .uncertainty import Uncertainty, covariance, enlarge, t_quantile

AT_ODDS = 1e-3  # p-value below which a simpler map is rejected
_BEYOND_DOUBT = 1e-6  # p-value of a lack of fit that is worth a warning
_BY_CHANCE = 0.01  # p-value above which a lack of fit may be chance
_MOST_POSITIONS = 100  # more positions are as good as a sweep
_BREAK = 4.0  # least ratio of the gap between positions to the gaps between readings of one
_STRETCHES = 60  # of a sweep, each taken as a position

Index = npt.NDArray[np.intp]


class MapModel(Protocol):
    """A map with unknowns ``theta``, shape ``(p,)``, of inputs ``x``, shape ``(n, inputs)``."""

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest values of the unknowns, shape ``(p,)`` each; may be infinite."""

    @property
    def linear(self) -> BoolArray:
        """Mask of the unbounded unknowns in which the map is linear, without constant, ``(p,)``."""

    def value(self, theta: FloatArray, x: FloatArray) -> FloatArray:
        """The map, shape ``(n,)``."""

    def slopes(self, theta: FloatArray, x: FloatArray) -> FloatArray:
        """Its derivatives by the unknowns, shape ``(n, p)``."""


ModelT = TypeVar("ModelT", bound=MapModel)


@dataclass(frozen=True)
class MapRows:
    """Samples of a map: inputs ``(n, inputs)``, output ``(n,)`` and weights ``(n,)``.

    A row that is the mean of several samples weighs as many.
    """

    x: FloatArray
    y: FloatArray
    count: FloatArray

    def take(self, index: BoolArray | Index | slice) -> MapRows:
        """Return some of the rows."""
        return MapRows(self.x[index], self.y[index], self.count[index])

    def residual(self, fit: MapFit[Any]) -> FloatArray:
        """Residual of the rows, shape ``(n,)``."""
        return self.y - fit.model.value(fit.theta, self.x)

    def slopes(self, fit: MapFit[Any]) -> FloatArray:
        """Derivatives of a fit by its unknowns that are not on a bound, shape ``(n, q)``."""
        every = fit.model.slopes(fit.theta, self.x)
        return every if fit.free.all() else every[:, fit.free]

    def squares(self, fit: MapFit[Any]) -> float:
        """Weighted sum of squared residuals."""
        return square_sum(self.residual(fit) * np.sqrt(self.count))


@dataclass(frozen=True)
class MapFit(Generic[ModelT]):
    """A fitted map.

    Attributes
    ----------
    model, theta
        The map, and its unknowns, shape ``(p,)``.
    free
        Mask of the unknowns that are not on a bound, shape ``(p,)``.
    cost
        Weighted sum of squared residuals.
    tried, agreeing
        Number of starts, and of those that ended at this optimum.
    iterations, converged
        Of the best search.
    others
        Unknowns and cost of the other optima.
    """

    model: ModelT
    theta: FloatArray
    free: BoolArray
    cost: float
    tried: int
    agreeing: int
    iterations: int
    converged: bool
    others: Sequence[tuple[FloatArray, float]] = ()


@dataclass(frozen=True)
class _Point:
    theta: FloatArray
    residual: FloatArray

    @property
    def cost(self) -> float:
        return square_sum(self.residual)


def fit_map(
    model: ModelT, rows: MapRows, starts: Sequence[FloatArray], tolerance: float = 1e-5,
    *, apart: bool = False,
) -> MapFit[ModelT]:  # fmt: skip
    """Fit a map by weighted least squares from several starts, and keep the best fit.

    With ``apart`` the linear unknowns are solved for at every step, and only the others are
    searched [3]_. Where both change the map nearly alike, joint steps stop half-way along a valley.
    Each step takes longer, so this is for the last search.

    Parameters
    ----------
    starts
        Values of the unknowns, shape ``(p,)`` each.
    tolerance
        Of the search, as in :func:`.minimise.minimise`.
    """
    roots, linear, (low, high) = np.sqrt(rows.count), model.linear & apart, model.bounds
    count = int(linear.sum())

    def slopes(theta: FloatArray) -> FloatArray:
        simulated(rows.y.size)  # all derivatives come together
        return model.slopes(theta, rows.x) * roots[:, None]

    def triangle(theta: FloatArray, residual: FloatArray) -> FloatArray:
        """Of the derivatives, by linear unknowns first, and of the residual."""
        j = slopes(theta)
        table = np.column_stack((j[:, linear], j[:, ~linear], residual))
        return np.asarray(np.linalg.qr(table, mode="r"))

    def evaluate(searched: FloatArray) -> _Point:
        simulated(rows.y.size)
        theta = np.zeros(linear.size)
        theta[~linear] = searched
        if count:
            root = triangle(theta, roots * rows.y)
            theta[linear] = scaled_least_squares(root[:count, :count], root[:count, -1])
        return _Point(theta, roots * (rows.y - model.value(theta, rows.x)))

    def normal(point: _Point) -> tuple[FloatArray, FloatArray]:
        if count:
            j, r = np.split(triangle(point.theta, point.residual)[count:, count:], [-1], axis=1)
            return (j.T @ r)[:, 0], j.T @ j
        j = slopes(point.theta)
        return j.T @ point.residual, j.T @ j

    def solve(start: FloatArray) -> Minimum[_Point]:
        return minimise(
            evaluate, normal, start[~linear], (low[~linear], high[~linear]), rows=rows.y.size,
            tolerance=tolerance, max_iterations=160 if count else 80,
        )  # fmt: skip

    found: list[Minimum[_Point]] = []
    for start in starts:
        if not found or not exhausted():
            found.append(solve(start))
    found.sort(key=lambda m: m.point.cost)
    best, theta = found[0], found[0].point.theta
    agreeing = sum(m.point.cost <= best.point.cost * (1.0 + 1e-6) + 1e-300 for m in found)
    return MapFit(
        model, theta, (theta > low) & (theta < high), best.point.cost, len(found), agreeing,
        best.iterations, best.converged, [(m.point.theta, m.point.cost) for m in found[agreeing:]],
    )  # fmt: skip


# ------------------------------------------------------------------------- choice of a map


def interior_folds(labels: Index, inner: Index, most: int, seed: int | None = None) -> Index:
    """Index of the fold that holds out each row, -1 for none, shape ``(n,)``.

    Rows of one label, a position or a log, are held out together; only ``inner`` labels are, so
    that no map has to extrapolate. Neighbours go to different folds, or to random ones by ``seed``.
    """
    order = inner if seed is None else np.random.default_rng(seed).permutation(inner)
    fold = np.full(int(labels.max()) + 1, -1)
    fold[order] = np.arange(order.size) % min(most, max(order.size, 1))
    return fold[labels]


def cross_validate(
    folds: Index, predict: Callable[[BoolArray, BoolArray, int], FloatArray]
) -> FloatArray:
    """Errors on rows that were not fitted, shape ``(n,)``; NaN where a row is in no fold.

    ``predict(rest, held, fold)`` fits the rows ``rest`` and returns the errors on ``held``.
    """
    error = np.full(folds.size, np.nan)
    for k in range(int(folds.max(initial=-1)) + 1):
        held = folds == k
        error[held] = predict(~held, held, k)
    return error


def fold_squares(error: FloatArray, folds: Index, count: FloatArray | None = None) -> FloatArray:
    """Mean square of every fold's errors, shape ``(folds,)``."""
    weight = np.ones(error.size) if count is None else count
    parts = [folds == k for k in range(int(folds.max()) + 1)]
    return np.array([np.average(error[p] ** 2, weights=weight[p]) for p in parts])


def smallest_sufficient(scores: Sequence[FloatArray]) -> int:
    """Index of the first candidate within one standard error of the best one [1]_.

    ``scores`` are mean squares of the folds, simplest candidate first.
    """
    means = [float(s.mean()) for s in scores]
    best = scores[int(np.argmin(means))]
    error = float(best.std(ddof=1) / np.sqrt(best.size)) if best.size > 1 else 0.0
    allowed = float(best.mean()) + max(error, 1e-18)  # exact data leave rounding
    return next(k for k, mean in enumerate(means) if mean <= allowed)


def excess_tail(worse: float, better: float, extra: int, samples: int, unknowns: int) -> float:
    """p-value of the F test of a restricted fit.

    ``worse`` and ``better`` are sums of squares without and with ``extra`` unknowns, ``unknowns``
    those of the better one.
    """
    from scipy.special import fdtrc

    free = samples - unknowns
    if worse <= better or free < 1 or extra < 1:
        return 1.0
    return float(fdtrc(extra, free, (worse - better) / extra / max(better / free, 1e-28)))


# --------------------------------------------------------------------- samples and positions


def lone_samples(output: FloatArray, residual: FloatArray, settled: BoolArray) -> BoolArray:
    """Mask of spikes: samples off the fit whose residual and output differ from their neighbours'.

    Lack of fit of a map lasts for many samples, a spike for one to three. A jump of an input moves
    the residual but not the measured output. Just after a reversal, where nothing is ``settled``, a
    lone sample may be creep. All arrays are of one run, shape ``(n,)``.
    """
    if residual.size < 8:
        return np.zeros(residual.size, dtype=bool)
    off = np.abs(residual - running_median(residual, 3))
    jump = np.abs(output - running_median(output, 3))
    limit = max(SPIKE * robust_deviation(off), 1e-6 * float(np.abs(output).max()))
    far = off > 3.0 * robust_deviation(residual)
    return np.asarray((np.minimum(off, jump) > limit) & far & settled)


def robust_deviation(residual: FloatArray) -> float:
    """Standard deviation from the median absolute residual; never zero."""
    return max(PER_MEDIAN * float(np.median(np.abs(residual))), 1e-9)


def are_in_order(experiments: Sequence[Experiment], role: str) -> bool:
    """Return whether samples follow one another in time.

    They have a time, or a role moves in both directions: a table may have been sorted.
    """
    values = [e[role] for e in experiments]
    both_ways = all(
        any(bool(way(x[:-1], x[1:]).any()) for x in values) for way in (np.less, np.greater)
    )
    return both_ways or all(e.time.size > 0 for e in experiments)


def position_edges(x: FloatArray, samples: int) -> FloatArray | None:
    """Edges between the positions at which readings were taken, shape ``(positions - 1,)``.

    Gaps between sorted readings taken at rest are either small or large; ``None`` where they are
    not: a sweep, or one reading at each position. ``samples`` is the number of readings, which may
    exceed the size of ``x`` where equal ones were merged.
    """
    places = np.unique(x)
    gaps = np.diff(places)
    size = np.sort(gaps)
    if not size.size:
        return None
    ratios = size[1:] / size[:-1]
    k = int(np.argmax(ratios)) if ratios.size else 0
    apart = float(size[k + 1]) if ratios.size and ratios[k] > _BREAK else float(size[0])
    wide = gaps >= apart
    groups = 1 + int(np.count_nonzero(wide))
    if not 3 <= groups <= min(_MOST_POSITIONS, samples // 2):
        return None
    if float(gaps[wide].sum()) < 0.8 * float(gaps.sum()):
        return None
    return np.asarray((places[:-1] + places[1:])[wide] / 2.0)


def widest_gap(x: FloatArray) -> tuple[float, float] | None:
    """Ends of a wide part of the range without readings, ``None`` where there is none."""
    places = np.unique(x)
    gaps = np.diff(places)
    k = int(np.argmax(gaps))
    far = max(0.2 * float(np.ptp(places)), 5.0 * float(np.median(gaps)))
    return (float(places[k]), float(places[k + 1])) if gaps.size > 6 and gaps[k] > far else None


# --------------------------------------------------------------------- lack of fit, uncertainty


@dataclass(frozen=True)
class Misfit:
    """Lack of fit of a map: mean squares of the residual between and within positions [2]_.

        between = sum_b n_b mean_b(r)^2 / (B - p),   within = sum_b sum (r - mean_b(r))^2 / (n - B)

    agree where the errors of all samples are independent. Errors that last for some samples look
    like lack of fit until the motion returns there, so the scatter between the first and the second
    half of the rows counts where it is larger.

    Attributes
    ----------
    between, within, degrees
        Both mean squares, and the degrees of freedom of the first.
    probability
        p-value of their ratio.
    rms
        Root mean square of the lack of fit beyond the scatter.
    worst
        Input at the position of the largest miss.
    at_rest
        Whether readings were taken at rest, at a few positions.
    rows, squares
        A row of each position, and the squared miss there less its scatter, shape ``(B,)`` each.
    """

    between: float
    within: float
    probability: float
    degrees: int
    rms: float
    worst: float
    at_rest: bool
    rows: Index
    squares: FloatArray

    @property
    def is_sure(self) -> bool:
        """Return whether the lack of fit is beyond doubt."""
        return self.probability < _BEYOND_DOUBT

    def matters(self, least: float) -> bool:
        """Return whether it is beyond doubt, and exceeds the scatter and the ``least`` size."""
        return self.is_sure and self.rms > least and self.rms**2 > self.within


def find_misfit(
    x: FloatArray, residual: FloatArray, unknowns: int, edges: FloatArray | None
) -> Misfit | None:
    """Compare the scatter of positions, or of stretches of a sweep, with that of samples.

    ``x`` is the input along which the positions lie, shape ``(n,)``; ``None`` where they are few.
    """
    from scipy.special import fdtrc

    n, at_rest = x.size, edges is not None
    if edges is None:
        few = np.asarray(x[:: max(n // 100_000, 1)])
        count = max(min(_STRETCHES, n // 5), 1)
        edges = np.unique(np.quantile(few, np.arange(1, count) / count))
    stretches = edges.size + 1
    key = np.searchsorted(edges, x, side="right")
    last = np.zeros(stretches, dtype=np.intp)  # some row of each
    last[key] = np.arange(n)
    key += stretches * (np.arange(n) >= n // 2)
    sizes, totals = (
        np.bincount(key, weights, minlength=2 * stretches).reshape(2, -1)
        for weights in (None, residual)
    )
    used = np.flatnonzero(sizes.sum(axis=0))
    size = sizes.sum(axis=0)[used]
    mean = totals.sum(axis=0)[used] / size
    degrees, free, explained = size.size - unknowns, n - size.size, float(size @ mean**2)
    if degrees < 1 or free < 10:
        return None
    between, within = explained / degrees, max(square_sum(residual) - explained, 0.0) / free
    scatter, both = within, sizes.min(axis=0) > 0.0
    if not at_rest and 2 * np.count_nonzero(both) > size.size:
        apart = np.diff(totals[:, both] / sizes[:, both], axis=0)[0]
        again = float(np.mean(apart**2 / np.sum(1.0 / sizes[:, both], axis=0)))
        if again > within:
            scatter, free = again, int(np.count_nonzero(both))
    floor = 1e-28  # what rounding leaves of outputs of order one
    probability = float(fdtrc(degrees, free, (between + floor) / (scatter + floor)))
    rms = float(np.sqrt(max(between - scatter, 0.0) * degrees / n))
    ends = np.concatenate(([float(np.min(x))], edges, [float(np.max(x))]))
    worst = int(used[np.argmax(np.abs(mean) * np.sqrt(size))])
    place = float(0.5 * (ends[worst] + ends[worst + 1]))
    squares = np.maximum(mean**2 - scatter / size, 0.0)
    return Misfit(between, within, probability, degrees, rms, place, at_rest, last[used], squares)


def find_uncertainty(
    jacobians: Sequence[FloatArray],
    residuals: Sequence[FloatArray],
    misfit: Misfit | None,
    in_order: bool,
    readings: Sequence[tuple[FloatArray, float]] = (),
) -> Uncertainty:
    """Covariance of the unknowns of a map, allowing for lack of fit.

    Samples at one position share the error of its reference and count as one. Lack of fit in a
    sweep does not average out with more samples: the interval of the map itself has to include it,
    nearly everywhere.

    Parameters
    ----------
    jacobians, residuals
        Per log, shapes ``(n_i, p)`` and ``(n_i,)``.
    misfit
        Of all rows, as :func:`find_misfit` returns it.
    in_order
        Whether the samples follow one another in time.
    readings
        As in :func:`.covariance`.
    """
    white = found = covariance(jacobians, residuals, robust=False)
    if in_order:
        found = covariance(jacobians, residuals, small_sample=True, readings=readings)
    if misfit is None or misfit.probability > _BY_CHANCE:
        return found
    per_variance = white.covariance / max(white.sigma**2, 1e-300)
    if not per_variance.size or not np.isfinite(per_variance).all():
        return found  # nothing, or something, is not determined at all: it is refused
    if misfit.at_rest:
        matrix = enlarge(found.covariance, misfit.between * np.diag(per_variance))
    else:
        begin = np.cumsum([0, *map(len, jacobians)])
        of = np.searchsorted(begin, misfit.rows, side="right") - 1
        rows = np.array([jacobians[k][i - begin[k]] for k, i in zip(of, misfit.rows)])
        held = np.sum(rows @ per_variance * rows, axis=1)
        seen = held > 1e-9 * held.mean()  # at the others no unknown could reduce the miss
        needed = misfit.squares[seen] / np.maximum(held, 0.1 * held.mean())[seen]  # or it is flat
        size = float(np.quantile(needed, 0.98)) / t_quantile(0.975, misfit.degrees) ** 2
        matrix = found.covariance + size * per_variance
    return replace(found, covariance=matrix, degrees=min(found.degrees, misfit.degrees))


def shift_by_noise(fit: MapFit[Any], rows: MapRows, disturbed: Iterable[MapRows]) -> FloatArray:
    """Shift of the free unknowns by noise of the inputs, shape ``(q,)``, to first order.

    A fit to rows whose inputs are ``disturbed`` by more of the noise that they have already moves
    on by as much (simulation extrapolation [4]_).
    """

    def step(rows: MapRows) -> FloatArray:
        return scaled_least_squares(rows.slopes(fit), rows.residual(fit))

    return np.asarray(np.mean([step(again) for again in disturbed], axis=0) - step(rows))


def direction_notices(
    words: tuple[str, str, str],
    one_way: str,
    text: Callable[[float], str],
    least: float,
    jacobians: Sequence[FloatArray],
    residuals: Sequence[FloatArray],
    rising: Sequence[FloatArray],
) -> Iterator[Notice]:
    """Warn of an output that differs between rising and falling inputs, or was recorded one way.

    Residuals are regressed on the direction together with the unknowns of the map. The difference
    has to be significant, and larger than half the scatter and the ``least`` one worth a warning.

    Parameters
    ----------
    words
        Names of the output and of the inputs, and the meaning of the difference.
    one_way
        What is said where nearly all samples move in one direction; empty for nothing.
    text
        Formats a difference of the output.
    jacobians, residuals, rising
        Per log: derivatives ``(n_i, p)``, residuals and the share of rising motion ``(n_i,)``,
        0 to 1.
    """
    shares = np.concatenate(rising)
    fewer, more = sorted(np.count_nonzero(x) for x in (shares > 0.9, shares < 0.1))
    if fewer < 10:
        # none goes back, and few rest; the first of a log has no direction yet
        if one_way and not fewer and more + len(rising) > 0.9 * shares.size:
            yield Notice("one-direction", one_way)
        return
    parts = [middle_of(len(r)) for r in residuals]
    residuals = [np.asarray(r[at]) for r, at in zip(residuals, parts)]
    tables = [np.column_stack((j[at], r[at] - 0.5)) for j, r, at in zip(jacobians, rising, parts)]
    scale = np.sqrt(sum(np.sum(t**2, axis=0) for t in tables))
    scale = np.where(scale > 0.0, scale, 1.0)
    tables = [t / scale for t in tables]
    found = np.linalg.lstsq(np.vstack(tables), np.concatenate(list(residuals)), rcond=1e-10)[0]
    spread = covariance(tables, [r - t @ found for t, r in zip(tables, residuals)])
    error = float(np.sqrt(spread.covariance[-1, -1])) / scale[-1]
    width = abs(float(found[-1])) / scale[-1]
    if width > 5.0 * error and width >= max(0.5 * spread.sigma, least):
        what, inputs, meaning = words
        yield Notice(
            "directions-differ",
            f"{what} differs by {text(width)} between rising and falling {inputs}, while each "
            f"direction scatters by {text(spread.sigma)}: {meaning}",
        )
