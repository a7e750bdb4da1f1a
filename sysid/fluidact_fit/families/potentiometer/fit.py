"""Choice of the curve: dead band, degree, monotonicity, weights that the data determine."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...errors import Notice, NotIdentifiedError
from ...estimation.map import (
    AT_ODDS,
    Index,
    MapFit,
    MapRows,
    Misfit,
    count_ways,
    cross_validate,
    direction_notices,
    excess_tail,
    find_misfit,
    find_uncertainty,
    fit_map,
    fold_squares,
    interior_folds,
    smallest_sufficient,
    widest_gap,
)
from ...estimation.noise import noise_floor
from ...estimation.uncertainty import Uncertainty, t_quantile
from ...experiment import BoolArray, FloatArray, all_of, where_finite
from ...family import Request
from ...units import after_number
from .calibration import rising_share
from .data import CalibrationData, ScaledSamples, scale_samples
from .options import PotentiometerOptions
from .rational_bezier import (
    LOG_WEIGHT_LIMIT,
    BezierModel,
    bernstein,
    curves_of,
    express,
    is_monotone,
    model_of,
)

MOST = 5  # highest degree of an automatic choice
MATTERS = 2e-3  # share of the stroke that is worth a warning
_ENDS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])  # of both branches


@dataclass(frozen=True)
class CurveFit:
    """A chosen curve: the fit, covariance of control points and log weights, scores, notices.

    ``spread`` is in scaled units, its rows ``P_0..P_N, log w_0/w_0..log w_N/w_0`` per branch.
    """

    fit: MapFit
    spread: Uncertainty
    scores: list[tuple[int, float]]
    notices: list[Notice]

    @property
    def model(self) -> BezierModel:
        """Model that was fitted."""
        return model_of(self.fit)


def fit_curve(
    data: CalibrationData, scaled: ScaledSamples, request: Request[PotentiometerOptions]
) -> CurveFit:
    """Choose and fit a curve to the samples."""
    options = request.options
    branches = 2 if options.branches == "two" else 1
    ends = _mean_ends(scaled) if options.endpoints == "fixed" else None
    rows = scaled.few if ends is None else _pinned(scaled.few, ends[0])
    _check_enough(scaled, BezierModel(options.degree_wanted or 1, branches))
    fit, scores = _search_degree(rows, scaled, branches, request)
    fit, notices = _keep_monotone(rows, scaled, fit, options.monotone)
    misfit, spread = _spread(data, scaled, fit, ends)
    plain, unsure = _drop_weights(rows, scaled, fit, spread)
    if plain is not fit:
        fit, notices = _keep_monotone(rows, scaled, plain, options.monotone)
        misfit, spread = _spread(data, scaled, fit, ends)
    notices += [
        *unsure,
        *_bound_notice(fit),
        *_few_positions_notice(scaled, fit, bool(scores)),
        *_misfit_notice(misfit, scaled, data.unit),
        *_direction_notice(fit, scaled, data),
    ]
    return CurveFit(fit, spread, scores, notices)


# ------------------------------------------------------------------------------ the search


def find_dead_band(data: CalibrationData, request: Request[PotentiometerOptions]) -> float:
    """Dead band that describes the data best [unit of the reading].

    Mean and difference of the branches are taken to be polynomials of the pooled curve. That of the
    difference is of a low degree: with more freedom a band of a few steps, which follows the noise
    of the reading, describes that noise.
    """
    if "hysteresis_dead_band" in request.fixed:
        return float(request.fixed["hysteresis_dead_band"])
    if request.options.dead_band is not None:
        return request.options.dead_band
    from scipy.optimize import minimize_scalar

    scaled = scale_samples(data)
    model = BezierModel(min(4, _highest_degree(scaled, 1)))
    pooled = fit_map(model, scaled.few, model.starts(scaled.few)[:1])
    steps = np.diff(np.unique(scaled.few.x[:, 0])) * scaled.span
    finest = max(2.0 * float(steps.min()), MATTERS * scaled.span)
    part = max(data.parts, key=lambda p: p.stop - p.start)
    part = slice(part.start, min(part.stop, part.start + 30_000))
    used, x = data.used[part], data.reading[part]
    t = (x[used] - scaled.low) / scaled.span
    y = (data.reference[part][used] - scaled.base) / scaled.stroke
    level = model.value(pooled.theta, np.column_stack((t, t)))
    mean, difference = (bernstein(np.clip(level, 0.0, 1.0), n) for n in (12, 2))

    def left(octaves: float) -> float:
        """Sum of squares that branches with a band of ``finest * 2**octaves`` leave."""
        share = rising_share(x, finest * 2.0**octaves)[used, None]
        columns = np.hstack((mean, difference * (share - 0.5)))
        rest = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
        return float(rest @ rest)

    rough = np.array([left(k) for k in range(7)])
    best = float(np.argmin(np.round(rough / rough.min(), 3)))
    near = (max(best - 1.0, 0.0), best + 1.0)
    refined = minimize_scalar(left, bounds=near, method="bounded", options={"xatol": 1e-3})
    return float(finest * 2.0**refined.x)


def _highest_degree(scaled: ScaledSamples, branches: int) -> int:
    """Highest degree that automatic choice tries: three positions are left over at least."""
    least = min(scaled.positions, scaled.rows.y.size / branches)
    return int(np.clip((least - 4) // 2, 1, MOST))


def _search_degree(
    rows: MapRows, scaled: ScaledSamples, branches: int, request: Request[PotentiometerOptions]
) -> tuple[MapFit, list[tuple[int, float]]]:
    """Fit all degrees up to the one wanted; without one, choose by cross-validation.

    Each degree starts from the one before, elevated, as well: more degrees never fit worse.
    """
    wanted = request.options.degree_wanted
    highest = wanted or _highest_degree(scaled, branches)
    request.progress(f"fitting curves up to degree {highest}")
    ladder: list[MapFit] = []
    for degree in range(1, highest + 1):
        model = BezierModel(degree, branches)
        starts = model.starts(rows)
        if ladder:
            starts.append(model.start(rows, [express(w, degree) for _, w in curves_of(ladder[-1])]))
        ladder.append(fit_map(model, rows, starts, 1e-2))
    degree, scores = wanted or 1, []
    if not wanted and highest > 1:
        folds = _folds(scaled)
        scores = [_score(scaled.few, f, folds) for f in ladder]
        degree = smallest_sufficient(scores) + 1
    found = ladder[degree - 1]
    last = fit_map(found.model, rows, [found.theta], apart=True)
    fit = replace(last, tried=found.tried, agreeing=found.agreeing)
    return fit, [(k, float(s.mean())) for k, s in enumerate(scores, start=1)]


def _folds(scaled: ScaledSamples) -> Index:
    """Folds of positions, or of stretches of the curve; the outermost are always fitted."""
    t = scaled.few.x[:, 0]
    if scaled.edges is not None:
        labels = np.searchsorted(scaled.edges, t, side="right")
    else:
        blocks = t.size if t.size <= 24 else int(np.clip(t.size // 3, 4, 40))
        labels = np.empty(t.size, dtype=np.intp)
        labels[np.argsort(t, kind="stable")] = np.arange(t.size) * blocks // t.size
    return interior_folds(labels, np.arange(1, int(labels.max())), 10)


def _score(rows: MapRows, fit: MapFit, folds: Index) -> FloatArray:
    """Mean squares of the folds; each is predicted from the others."""

    def predict(rest: BoolArray, held: BoolArray, fold: int) -> FloatArray:
        found = fit_map(fit.model, rows.take(rest), [fit.theta], 0.03)
        return rows.take(held).residual(found)

    return fold_squares(cross_validate(folds, predict), folds, rows.count)


def _mean_ends(scaled: ScaledSamples) -> tuple[FloatArray, FloatArray]:
    """Mean reference of the extreme readings, and how many samples each has."""
    t, y = np.asarray(scaled.rows.x)[:, 0], np.asarray(scaled.rows.y)
    at = [t == 0.0, t == 1.0]
    return np.array([y[a].mean() for a in at]), np.array([np.count_nonzero(a) for a in at])


def _pinned(rows: MapRows, ends: FloatArray) -> MapRows:
    """Rows with end points through which the curve has to go, on both branches."""
    weight = np.append(rows.count, np.full(4, 1e8 * rows.count.sum()))
    return MapRows(np.vstack((rows.x, _ENDS)), np.append(rows.y, np.tile(ends, 2)), weight)


def _check_enough(scaled: ScaledSamples, model: BezierModel) -> None:
    """Refuse a curve with more unknowns than the samples can determine."""
    samples, distinct = scaled.rows.y.size, int(np.unique(scaled.few.x[:, 0]).size)
    needed = model.unknowns // model.branches
    if samples >= model.unknowns + 2 and distinct >= needed:
        return
    lower = f" or give a --degree below {model.degree}" if model.degree > 1 else ""
    raise NotIdentifiedError(
        f"{samples} samples at {distinct} distinct readings cannot determine a curve of degree "
        f"{model.degree}, which has {model.unknowns} unknowns.",
        expected=f"At least {model.unknowns + 2} samples at {needed} distinct readings.",
        remedy=f"Record more positions{lower}.",
    )


def is_rising_or_falling(fit: MapFit) -> bool:
    """Return whether no branch turns back."""
    return all(is_monotone(p, w) for p, w in curves_of(fit))


def _keep_monotone(
    rows: MapRows, scaled: ScaledSamples, fit: MapFit, wanted: bool | None
) -> tuple[MapFit, list[Notice]]:
    """Make the curve monotone unless the data contradict that, and report the loss of fit."""
    if wanted is False or is_rising_or_falling(fit):
        return fit, []
    line = np.polynomial.Polynomial.fit(rows.x[:, 0], rows.y, 1).convert()
    model = replace(model_of(fit), direction=1 if line.coef[-1] > 0.0 else -1)
    starts = [model.start(rows, [w for _, w in curves_of(fit)]), *model.starts(rows)]
    kept = fit_map(model, rows, starts)
    ratio = np.sqrt(scaled.rows.squares(kept) / max(scaled.rows.squares(fit), 1e-300))
    cost = f"the residuals of the monotone curve are {ratio:.4g} times those of the free one"
    if _tail(scaled, kept, fit) >= AT_ODDS:
        text = (
            f"the best curve of degree {model.degree} turns back within the range, which the "
            "data do not demand: it was kept monotone, so that every position has one reading; "
            f"{cost} (--no-monotone)."
        )
        return kept, [] if wanted else [Notice("kept-monotone", text)]
    if wanted:
        text = f"the data resist --monotone: {cost}. Give --no-monotone, or another degree."
        return kept, [Notice("not-monotone", text)]
    text = (
        f"the curve of degree {model.degree} turns back within the range, so a position may have "
        f"two readings; {cost}. Try another --degree, or give --monotone."
    )
    return fit, [Notice("not-monotone", text)]


def _tail(scaled: ScaledSamples, restricted: MapFit, fit: MapFit) -> float:
    """p-value of the loss of fit of a restricted curve."""
    model = model_of(fit)
    return excess_tail(
        scaled.rows.squares(restricted), scaled.rows.squares(fit), model.degree * model.branches,
        scaled.rows.y.size, model.unknowns,
    )  # fmt: skip


def _drop_weights(
    rows: MapRows, scaled: ScaledSamples, fit: MapFit, spread: Uncertainty
) -> tuple[MapFit, list[Notice]]:
    """Replace weights that the data do not determine by ones.

    A straight line, for example, is a curve of degree two with any of a family of weights.
    """
    model = model_of(fit)
    widest = std_errors(spread, model.degree)[:, 1].max()
    if not model.rational or t_quantile(0.975, spread.degrees) * widest <= LOG_WEIGHT_LIMIT:
        return fit, []
    straight = replace(model, rational=False, direction=0)
    plain = fit_map(straight, rows, straight.starts(rows))
    lower = f"Give a --degree below {model.degree}, or --degree auto. "
    advice = lower if model.degree > 1 else ""
    if _tail(scaled, plain, fit) < 0.05:
        text = (
            "some weights are hardly determined: their 95 % intervals span more than a factor of "
            f"50 either way. {advice}"
        )
        return fit, [Notice("degree-too-high", text.rstrip())]
    text = (
        "weights cannot be determined from these data: a polynomial describes them as well. "
        f"They are written as 1, status not_identified. {advice}A record of more samples "
        "over the whole range, the ends included, would determine them."
    )
    return plain, [Notice("not-identified", text)]


# ------------------------------------------------------------------------- its uncertainty


def std_errors(spread: Uncertainty, degree: int) -> FloatArray:
    """Standard errors of the control points and of the log weights, ``(branches, 2, N + 1)``."""
    errors = np.sqrt(np.maximum(np.diag(spread.covariance), 0.0))
    return np.asarray(errors.reshape(-1, 2, degree + 1))


def expansion_of(fit: MapFit) -> FloatArray:
    """Control points and log weight ratios of all branches per free unknown, ``(m, q)``."""
    model = model_of(fit)
    one = model.expansion.copy()
    one[model.degree + 1 :] -= one[model.degree + 1]
    return np.asarray(np.kron(np.eye(model.branches), one)[:, fit.free])


def _spread(
    data: CalibrationData,
    scaled: ScaledSamples,
    fit: MapFit,
    ends: tuple[FloatArray, FloatArray] | None,
) -> tuple[Misfit | None, Uncertainty]:
    """Lack of fit, and covariance of control points and log weights.

    Raises
    ------
    NotIdentifiedError
        When the data do not determine some control points.
    """
    rows, edges = scaled.rows, scaled.edges
    rest, columns, gain = rows.residual(fit), rows.slopes(fit), np.eye(int(fit.free.sum()))
    if ends is not None:
        columns, gain = _with_measured_ends(fit, rows, np.asarray(columns), ends[1])
    misfit = find_misfit(rows.x[:, 0], rest, model_of(fit).unknowns, edges)
    spread = find_uncertainty(data.by_log(columns), data.by_log(rest), misfit, data.in_order)
    if not np.all(np.isfinite(spread.covariance)):
        raise NotIdentifiedError(
            "the data cannot determine control_points: the curve does not depend on some of them.",
            expected="Nothing was written.",
            remedy="Give a lower --degree, or record the whole range in both directions.",
        )
    matrix = expansion_of(fit) @ gain
    return misfit, replace(spread, covariance=matrix @ spread.covariance @ matrix.T)


def _with_measured_ends(
    fit: MapFit, rows: MapRows, jacobian: FloatArray, count: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Columns ``S`` and gain ``G``: errors ``e`` move an estimate with fixed ends by ``A^-1 S' e``.

    The ends are means of some rows and weigh ``w``: ``A = J'J + w E'E`` and ``S = J + w M E`` with
    the rows ``M`` of the means. With the covariance ``C`` of an ordinary fit that has the columns
    ``S`` that of the estimate is ``G C G'``, ``G = A^-1 S'S``.
    """
    weight, by_ends = 1e4 * len(jacobian), fit.model.slopes(fit.theta, _ENDS)[:, fit.free]
    at = np.column_stack([rows.x[:, 0] == t for t in (0.0, 1.0)]) / count
    columns = jacobian + weight * at @ (by_ends[:2] + by_ends[2:])
    normal = jacobian.T @ jacobian + weight * by_ends.T @ by_ends
    return columns, np.asarray(np.linalg.solve(normal, columns.T @ columns))


# ------------------------------------------------------------------------- warnings


def _few_positions_notice(scaled: ScaledSamples, fit: MapFit, chosen: bool) -> Iterator[Notice]:
    """Warn of a gap, or of positions that allow no curve that bends more often than this one."""
    model = model_of(fit)
    if gap := widest_gap(scaled.few.x[:, 0]):
        low, high = (scaled.low + scaled.span * t for t in gap)
        yield Notice(
            "few-positions",
            f"there are no readings between {low:.6g} and {high:.6g}, "
            f"{100.0 * (gap[1] - gap[0]):.0f} % of the range: what the curve does there follows "
            f"from its degree ({model.degree}) alone, and no interval allows for another shape. "
            "Record positions there.",
        )
        return
    positions, highest = scaled.positions, _highest_degree(scaled, model.branches)
    given = not chosen and model.degree == highest > 1
    if model.degree < highest or highest == MOST or given:
        return
    yield Notice(
        "few-positions",
        f"{positions} positions cannot show whether the curve bends more often than one of degree "
        f"{model.degree}, the highest they can test: between them it may be off by far more "
        f"than the intervals say. Record {2 * model.degree + 6} positions or more, spread "
        "over the whole range; more readings at the same positions do not help.",
    )


def _bound_notice(fit: MapFit) -> Iterator[Notice]:
    """Warn of weights that rest on their bound."""
    model = model_of(fit)
    bounded = ~fit.free.reshape(model.branches, -1)[:, model.degree + 1 :]
    if not bounded.any():
        return
    falling = ("", " (falling)")
    names = [f"of control point {i + 1}{falling[k]}" for k, i in np.argwhere(bounded)]
    advice = "Give another --degree." if model.degree > 1 else "Give --degree 2 or more."
    yield Notice(
        "weight-at-bound",
        f"{len(names)} of the weights rest on the bound of 50 that keeps the curve from bending "
        f"too sharply ({', '.join(names)}); their intervals do not count. {advice}",
    )


def _misfit_notice(misfit: Misfit | None, scaled: ScaledSamples, unit: str) -> Iterator[Notice]:
    """Say by how much a curve misses positions; warn where their readings scatter by less."""
    if misfit is None or not misfit.is_sure:
        return
    reading = f"{scaled.low + misfit.worst * scaled.span:.6g}{after_number(unit)}"
    if not misfit.matters(MATTERS):
        if misfit.at_rest:
            return  # positions share the errors of their references
        yield Notice(
            "small-misfit",
            f"the curve misses the readings by {scaled.words(misfit.rms)} (RMS), most of all at a "
            f"reading of {reading}; the intervals allow for it.",
        )
        return
    common = (
        ", or the reference at a position is off by that much, which more readings there do not "
        "mend" if misfit.at_rest else ""
    )  # fmt: skip
    yield Notice(
        "curve-misses",
        f"the curve misses the readings by {scaled.words(misfit.rms)} (RMS), while readings "
        f"beside each other scatter by {scaled.words(float(np.sqrt(misfit.within)))}, most of all "
        f"at a reading of {reading}: it cannot follow the sensor{common}. "
        "Look at the picture (--plot); try a higher --degree, or fit only the range that you use "
        "(--rails).",
    )


def _direction_notice(
    fit: MapFit, scaled: ScaledSamples, data: CalibrationData
) -> Iterator[Notice]:
    """Warn of one curve for two directions that differ by more than their scatter."""
    if model_of(fit).branches > 1:
        return
    tremble = 8.0 * max(
        noise_floor(all_of(x, where_finite(x))) for x in (data.reading[p] for p in data.parts)
    )
    share = data.rising(max(tremble, 5e-3 * scaled.span))
    fewer, more = count_ways(share)
    if fewer < 10:
        if fewer or more <= 0.9 * share.size or scaled.edges is not None:
            return  # some go back at least, or are at rest
        yield Notice(
            "one-direction",
            "the reading moves in one direction only: whether it depends on the direction, by "
            "play in the coupling or a delay between the two signals, cannot be seen, and the "
            "curve holds for this direction. Record strokes in both directions.",
        )
        return
    # of the reading before: one that is too high by chance both looks like rising and lies
    # beside the curve
    shares = [np.append(s[:1], s[:-1]) for s in data.by_log(share)]
    jacobian, rest = scaled.rows.slopes(fit), scaled.rows.residual(fit)
    words = (
        "at one reading the reference", "readings", "one curve for both is off by half of that or "
        "more. Give --branches=two, or look for play in the coupling and for a delay between the "
        "two signals.",
    )  # fmt: skip
    yield from direction_notices(
        words, scaled.words, 0.5 * MATTERS, data.by_log(jacobian), data.by_log(rest), shares
    )
