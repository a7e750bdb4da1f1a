"""Choice of the curve: dead band, degree, monotonicity, weights that the data determine."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...errors import Notice, NotIdentifiedError
from ...estimation.blocks import joined
from ...estimation.map import (
    AT_ODDS,
    Index,
    MapFit,
    MapRows,
    Misfit,
    cross_validate,
    direction_notices,
    excess_tail,
    find_misfit,
    find_uncertainty,
    fit_map,
    fold_squares,
    interior_folds,
    shift_by_noise,
    smallest_sufficient,
    widest_gap,
)
from ...estimation.noise import noise_floor
from ...estimation.uncertainty import Uncertainty, covariance, t_quantile, widen_by
from ...experiment import BoolArray, FloatArray, all_of, where_finite
from ...family import NoiseLevel, Request
from ...rows import middle_of, square_sum
from ...units import after_number
from .data import CalibrationData
from .options import PotentiometerOptions
from .rational_bezier import LOG_WEIGHT_LIMIT, BezierModel, bernstein, express, is_monotone

MOST = 5  # highest degree of an automatic choice
_MEAN, _DIFFERENCE = 12, (2, 4)  # degrees of branches over the pooled curve, for that
_PER_DEGREE = 50  # samples of the difference, which is of the lower degree otherwise
MATTERS = 2e-3  # share of the stroke that is worth a warning
_DRAWS = 4  # of the noise of the readings
_POWER = 0.1  # relative standard error of its power
_ENDS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])  # of both branches

BezierFit = MapFit[BezierModel]


@dataclass(frozen=True)
class CurveFit:
    """A chosen curve: the fit, covariance of control points [SI] and weights, notices.

    ``scores`` are mean squares of the folds held out, by degree; none where one was given.
    The rows of ``spread`` are ``P_0..P_N, w_0..w_N`` per branch. ``noise`` of the readings is that
    which matters.
    """

    fit: BezierFit
    spread: Uncertainty
    scores: list[FloatArray]
    notices: list[Notice]
    noise: dict[str, NoiseLevel]


def fit_curve(data: CalibrationData, request: Request[PotentiometerOptions]) -> CurveFit:
    """Choose and fit a curve to the samples."""
    options = request.options
    rows, ends = data.few, None
    if options.endpoints == "fixed":
        ends = _mean_ends(data.rows)
        weight = np.append(rows.count, np.full(4, 1e8 * rows.count.sum()))
        rows = MapRows(np.vstack((rows.x, ends.x)), np.append(rows.y, ends.y), weight)
    _check_enough(data, BezierModel(options.degree_wanted or 1, data.branches))
    fit, scores = _search_degree(rows, data, request)
    fit, notices = _keep_monotone(rows, data, fit, options.monotone)
    misfit, spread, moved = _spread(data, fit, ends)
    plain, unsure = _drop_weights(rows, data, fit, spread, bool(scores))
    if plain is not fit:
        fit, notices = _keep_monotone(rows, data, plain, options.monotone)
        misfit, spread, moved = _spread(data, fit, ends)
    shift = float(np.abs(data.rows.take(data.sparse).slopes(fit) @ moved).max())
    noise = {"reading": NoiseLevel(data.noise, _POWER)} if shift > MATTERS else {}
    notices += [
        *_noise_notice(data, shift),
        *unsure,
        *_bound_notice(fit),
        *_few_positions_notice(data, fit, bool(scores)),
        *_misfit_notice(misfit, data),
        *_direction_notice(fit, data),
    ]
    return CurveFit(fit, spread, scores, notices, noise)


# ------------------------------------------------------------------------------ the search


def find_dead_band(data: CalibrationData, request: Request[PotentiometerOptions]) -> float:
    """Dead band that describes the data best [unit of the reading].

    Mean and difference of the branches are taken to be polynomials of the pooled curve. That of the
    difference is of a low degree: with more freedom a band of a few steps, which follows the noise
    of the reading, describes that noise.

    Raises
    ------
    NotIdentifiedError
        When the branches do not differ beyond chance.
    """
    if "hysteresis_dead_band" in request.fixed:
        return float(request.fixed["hysteresis_dead_band"])
    if request.options.dead_band is not None:
        return request.options.dead_band
    from scipy.optimize import minimize_scalar

    model = BezierModel(min(4, _highest_degree(data)))
    pooled = fit_map(model, data.few, model.starts(data.few)[:1])
    finest = data.readings[1] * max(
        2.0 * float(np.diff(np.unique(data.few.x[:, 0])).min()), MATTERS
    )
    at = data.sparse
    level = np.clip(model.value(pooled.theta, data.rows.x), 0.0, 1.0)
    y, (mean, difference) = data.rows.y[at], (bernstein(level[at], n) for n in _degrees(data))

    def left(octaves: float) -> float:
        """Variance that branches with a band of ``finest * 2**octaves`` leave."""
        band = finest * 2.0**octaves
        known, share = data.kept(data.has_branch(band))[at], data.rising(band)[at, None]
        columns = np.hstack((mean, difference * (share - 0.5)))[known]
        free = len(columns) - columns.shape[1]
        if free < 1:
            return square_sum(y)
        rest = y[known] - columns @ np.linalg.lstsq(columns, y[known], rcond=None)[0]
        return square_sum(rest) / free

    rough = np.array([left(k) for k in range(7)])
    best = float(np.argmin(np.round(rough / rough.min(), 3)))
    near = (max(best - 1.0, 0.0), best + 1.0)
    refined = minimize_scalar(left, bounds=near, method="bounded", options={"xatol": 1e-3})
    band = float(finest * 2.0**refined.x)
    if _difference_tail(data, level, band) > AT_ODDS:
        raise NotIdentifiedError(
            "the data cannot determine hysteresis_dead_band: at one reading the reference differs "
            "between rising and falling readings by no more than errors do by chance.",
            remedy="Leave --branches two out, record more strokes, or give "
            "--fix hysteresis_dead_band=VALUE.",
        )
    return band


def _degrees(data: CalibrationData) -> tuple[int, int]:
    """Degrees of the mean and the difference of branches that the samples allow."""
    return _MEAN, int(np.clip(data.rows.y.size // _PER_DEGREE, *_DIFFERENCE))


def _difference_tail(data: CalibrationData, level: FloatArray, band: float) -> float:
    """p-value of the difference of both branches, Wald's test; ``level`` is the pooled curve."""
    from scipy.special import fdtrc

    tables, residuals, degrees = [], [], _degrees(data)
    for y, x, share in zip(*map(data.by_log, (data.rows.y, level)), _shares_before(data, band)):
        at = middle_of(y.size)
        mean, difference = (bernstein(x[at], n) for n in degrees)
        tables.append(np.hstack((mean, difference * (share[at, None] - 0.5))))
        residuals.append(y[at])
    found = np.linalg.lstsq(np.vstack(tables), joined(residuals), rcond=None)[0]
    spread = covariance(tables, [y - t @ found for t, y in zip(tables, residuals)])
    tested = slice(degrees[0] + 1, None)
    size = found[tested] @ np.linalg.solve(spread.covariance[tested, tested], found[tested])
    count = degrees[1] + 1
    return float(fdtrc(count, spread.degrees, size / count))


def _shares_before(data: CalibrationData, band: float) -> list[FloatArray]:
    """Share of the rising branch at the reading before, by log.

    A reading that is too high by chance both looks like rising and lies beside the curve.
    """
    return [np.append(s[:1], s[:-1]) for s in data.by_log(data.rising(band))]


def _highest_degree(data: CalibrationData) -> int:
    """Highest degree that automatic choice tries: three positions are left over at least."""
    return int(np.clip((data.places - 4) // 2, 1, MOST))


def _search_degree(
    rows: MapRows, data: CalibrationData, request: Request[PotentiometerOptions]
) -> tuple[BezierFit, list[FloatArray]]:
    """Fit all degrees up to the one wanted; without one, choose by cross-validation.

    Each degree starts from the one before, elevated, as well: more degrees never fit worse.
    """
    wanted = request.options.degree_wanted
    highest = wanted or _highest_degree(data)
    request.progress(f"fitting curves up to degree {highest}")
    ladder: list[BezierFit] = []
    for degree in range(1, highest + 1):
        model = BezierModel(degree, data.branches)
        starts = model.starts(rows)
        if ladder:
            before = ladder[-1].model.curves(ladder[-1].theta)
            starts.append(model.start(rows, [express(w, degree) for _, w in before]))
        ladder.append(fit_map(model, rows, starts, 1e-2))
    degree, scores = wanted or 1, list[FloatArray]()
    if not wanted and highest > 1:
        folds = _folds(data)
        scores = [_score(data.few, f, folds) for f in ladder]
        degree = smallest_sufficient(scores) + 1
    found = ladder[degree - 1]
    last = fit_map(found.model, rows, [found.theta], apart=True)
    return replace(last, tried=found.tried, agreeing=found.agreeing), scores


def _folds(data: CalibrationData) -> Index:
    """Folds of positions, or of stretches of the curve; the outermost are always fitted."""
    t = data.few.x[:, 0]
    if data.edges is not None:
        labels = np.searchsorted(data.edges, t, side="right")
    else:
        blocks = t.size if t.size <= 24 else int(np.clip(t.size // 3, 4, 40))
        labels = np.empty(t.size, dtype=np.intp)
        labels[np.argsort(t, kind="stable")] = np.arange(t.size) * blocks // t.size
    return interior_folds(labels, np.arange(1, int(labels.max())), 10)


def _score(rows: MapRows, fit: BezierFit, folds: Index) -> FloatArray:
    """Mean squares of the folds; each is predicted from the others."""

    def predict(rest: BoolArray, held: BoolArray, fold: int) -> FloatArray:
        found = fit_map(fit.model, rows.take(rest), [fit.theta], 0.03)
        return rows.take(held).residual(found)

    return fold_squares(cross_validate(folds, predict), folds, rows.count)


def _mean_ends(rows: MapRows) -> MapRows:
    """Ends of both branches: mean references of the extreme readings, with how many samples."""
    at = [rows.x[:, 0] == t for t in _ENDS[:, 0]]
    means, counts = [rows.y[a].mean() for a in at], [np.count_nonzero(a) for a in at]
    return MapRows(_ENDS, np.array(means), np.array(counts, dtype=float))


def _check_enough(data: CalibrationData, model: BezierModel) -> None:
    """Refuse a curve with more unknowns than the samples can determine."""
    samples, distinct = data.rows.y.size, int(np.unique(data.few.x[:, 0]).size)
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


def _keep_monotone(
    rows: MapRows, data: CalibrationData, fit: BezierFit, wanted: bool | None
) -> tuple[BezierFit, list[Notice]]:
    """Make the curve monotone unless the data contradict that, and report the loss of fit."""
    if wanted is False or all(is_monotone(*c) for c in fit.model.curves(fit.theta)):
        return fit, []
    line = np.polynomial.polynomial.polyfit(rows.x[:, 0], rows.y, 1)
    model = replace(fit.model, direction=1 if line[1] > 0.0 else -1)
    starts = [model.start(rows, [w for _, w in fit.model.curves(fit.theta)]), *model.starts(rows)]
    kept = fit_map(model, rows, starts)
    ratio = np.sqrt(data.rows.squares(kept) / max(data.rows.squares(fit), 1e-300))
    cost = f"the residuals of the monotone curve are {ratio:.4g} times those of the free one"
    if _tail(data, kept, fit) >= AT_ODDS:
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


def _tail(data: CalibrationData, restricted: BezierFit, fit: BezierFit) -> float:
    """p-value of the loss of fit of a restricted curve."""
    model = fit.model
    return excess_tail(
        data.rows.squares(restricted), data.rows.squares(fit), model.degree * model.branches,
        data.rows.y.size, model.unknowns,
    )  # fmt: skip


def _drop_weights(
    rows: MapRows, data: CalibrationData, fit: BezierFit, spread: Uncertainty, chosen: bool
) -> tuple[BezierFit, list[Notice]]:
    """Replace weights that the data do not determine by ones.

    A straight line, for example, is a curve of degree two with any of a family of weights. The
    degree was ``chosen`` here, or given.
    """
    model = fit.model
    weights = [w for _, w in model.curves(fit.theta)]
    widest = np.max(std_errors(spread, model.degree)[:, 1] / weights)
    if not model.rational or t_quantile(0.975, spread.degrees) * widest <= LOG_WEIGHT_LIMIT:
        return fit, []
    straight = replace(model, rational=False, direction=0)
    plain = fit_map(straight, rows, straight.starts(rows))
    auto = "" if chosen else ", or --degree auto"
    advice = f"Give a --degree below {model.degree}{auto}. " if model.degree > 1 else ""
    if _tail(data, plain, fit) < 0.05:
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
    """Standard errors of control points [SI] and weights, shape ``(branches, 2, N + 1)``."""
    errors = np.sqrt(np.maximum(np.diag(spread.covariance), 0.0))
    return np.asarray(errors.reshape(-1, 2, degree + 1))


def _spread(
    data: CalibrationData, fit: BezierFit, ends: MapRows | None
) -> tuple[Misfit | None, Uncertainty, FloatArray]:
    """Lack of fit, covariance of control points [SI] and weights, and the shift by noise.

    The covariance covers that shift of the free unknowns by noise of the readings.

    Raises
    ------
    NotIdentifiedError
        When the data do not determine some control points.
    """
    rows = data.rows
    rest, columns, gain = rows.residual(fit), rows.slopes(fit), np.eye(int(fit.free.sum()))
    if ends is not None:
        columns, gain = _with_measured_ends(fit, rows, columns, ends)
    misfit = find_misfit(rows.x[:, 0], rest, fit.model.unknowns, data.edges)
    spread = find_uncertainty(data.by_log(columns), data.by_log(rest), misfit, data.in_order)
    if not np.all(np.isfinite(spread.covariance)):
        raise NotIdentifiedError(
            "the data cannot determine control_points: the curve does not depend on some of them.",
            expected="Nothing was written.",
            remedy="Give a lower --degree, or record the whole range in both directions.",
        )
    curves, stroke = fit.model.curves(fit.theta), data.positions[1]
    scale = np.concatenate([np.append(np.full(p.size, stroke), w) for p, w in curves])
    expansion = np.kron(np.eye(fit.model.branches), fit.model.expansion)
    matrix = scale[:, None] * expansion[:, fit.free]
    found, moved = matrix @ gain @ spread.covariance @ gain.T @ matrix.T, np.zeros(matrix.shape[1])
    if data.noise:
        moved = shift_by_noise(fit, rows.take(data.sparse), data.disturbed(_DRAWS))
        found = widen_by(found, matrix @ moved)
    return misfit, replace(spread, covariance=found), moved


def _with_measured_ends(
    fit: BezierFit, rows: MapRows, jacobian: FloatArray, ends: MapRows
) -> tuple[FloatArray, FloatArray]:
    """Columns ``S`` and gain ``G``: errors ``e`` move an estimate with fixed ends by ``A^-1 S' e``.

    The ends are means of some rows and weigh ``w``: ``A = J'J + w E'E`` and ``S = J + w M E`` with
    the rows ``M`` of the means. With the covariance ``C`` of an ordinary fit that has the columns
    ``S`` that of the estimate is ``G C G'``, ``G = A^-1 S'S``.
    """
    weight, by_ends = 1e4 * len(jacobian), ends.slopes(fit)
    at = np.column_stack([rows.x[:, 0] == t for t in ends.x[:, 0]]) / ends.count
    columns = jacobian + weight * at @ by_ends
    normal = jacobian.T @ jacobian + weight * by_ends.T @ by_ends
    return columns, np.asarray(np.linalg.solve(normal, columns.T @ columns))


# ------------------------------------------------------------------------- warnings


def _noise_notice(data: CalibrationData, shift: float) -> Iterator[Notice]:
    """Warn of noise of the readings that shifts the curve."""
    if shift > MATTERS:
        noise = f"{data.noise:.2g}{after_number(data.unit)}"
        yield Notice(
            "input-noise-left",
            f"'reading' carries noise of about {noise} rms, which flattens the curve by up to "
            f"{data.words(shift)}, at its ends and where it bends; the intervals allow for that. "
            "Average readings at rest, or filter the sensor and move more slowly.",
        )


def _few_positions_notice(data: CalibrationData, fit: BezierFit, chosen: bool) -> Iterator[Notice]:
    """Warn of a gap, or of positions that allow no curve that bends more often than this one."""
    model = fit.model
    if gap := widest_gap(data.few.x[:, 0]):
        low, high = (data.readings[0] + data.readings[1] * t for t in gap)
        yield Notice(
            "few-positions",
            f"there are no readings between {low:.6g} and {high:.6g}, "
            f"{100.0 * (gap[1] - gap[0]):.0f} % of the range: what the curve does there follows "
            f"from its degree ({model.degree}) alone, and no interval allows for another shape. "
            "Record positions there.",
        )
        return
    highest = _highest_degree(data)
    given = not chosen and model.degree == highest > 1
    if model.degree < highest or highest == MOST or given:
        return
    each = " in each direction" if model.branches > 1 else ""
    yield Notice(
        "few-positions",
        f"{data.places} positions{each} cannot show whether the curve bends more often than one of "
        f"degree {model.degree}, the highest they can test: between them it may be off by far more "
        f"than the intervals say. Record {2 * model.degree + 6} positions or more{each}, spread "
        "over the whole range; more readings at the same positions do not help.",
    )


def _bound_notice(fit: BezierFit) -> Iterator[Notice]:
    """Warn of weights that rest on their bound."""
    model = fit.model
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


def _misfit_notice(misfit: Misfit | None, data: CalibrationData) -> Iterator[Notice]:
    """Say by how much a curve misses positions; warn where their readings scatter by less."""
    if misfit is None or not misfit.is_sure:
        return
    low, span = data.readings
    reading = f"{low + misfit.worst * span:.6g}{after_number(data.unit)}"
    if not misfit.matters(MATTERS):
        if misfit.at_rest:
            return  # positions share the errors of their references
        yield Notice(
            "small-misfit",
            f"the curve misses the readings by {data.words(misfit.rms)} (RMS), most of all at a "
            f"reading of {reading}; the intervals allow for it.",
        )
        return
    common = (
        ", or the reference at a position is off by that much, which more readings there do not "
        "mend" if misfit.at_rest else ""
    )  # fmt: skip
    yield Notice(
        "curve-misses",
        f"the curve misses the readings by {data.words(misfit.rms)} (RMS), while readings "
        f"beside each other scatter by {data.words(float(np.sqrt(misfit.within)))}, most of all "
        f"at a reading of {reading}: it cannot follow the sensor{common}. "
        "Look at the picture (--plot); try a higher --degree, or fit only the range that you use "
        "(--rails).",
    )


def _direction_notice(fit: BezierFit, data: CalibrationData) -> Iterator[Notice]:
    """Warn of one curve for two directions that differ by more than their scatter."""
    if fit.model.branches > 1:
        return
    tremble = 8.0 * max(
        noise_floor(all_of(x, where_finite(x))) for x in (data.reading[p] for p in data.parts)
    )
    shares = _shares_before(data, max(tremble, 5e-3 * data.readings[1]))
    words = (
        "at one reading the reference", "readings", "one curve for both is off by half of that or "
        "more. Give --branches=two, or look for play in the coupling and for a delay between the "
        "two signals.",
    )  # fmt: skip
    one_way = (
        "the reading moves in one direction only: whether it depends on the direction, by play in "
        "the coupling or a delay between the two signals, cannot be seen, and the curve holds for "
        "this direction. Record strokes in both directions."
    )
    yield from direction_notices(
        words, one_way * (data.edges is None), data.words, 0.5 * MATTERS,
        data.by_log(data.rows.slopes(fit)), data.by_log(data.rows.residual(fit)), shares,
    )  # fmt: skip
