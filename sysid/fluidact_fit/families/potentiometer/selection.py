"""Which curve: dead band, degree, whether it turns back, weights that data determine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...errors import Notice
from ...estimation.uncertainty import Uncertainty, t_quantile
from ...family import Request
from .calibration import rising_share
from .data import (
    COARSE,
    FINE,
    Data,
    Scaled,
    find_positions,
    position_count,
    sample_count,
    scale_samples,
)
from .options import PotentiometerOptions
from .rational_bezier import (
    LOG_WEIGHT_LIMIT,
    CurveFit,
    Rows,
    Score,
    Shape,
    bernstein,
    compress,
    cross_validate,
    fit_ladder,
    fit_shape,
    smallest_sufficient,
)
from .spread import std_errors

MOST = 5  # highest degree of an automatic choice
_PLENTY = 14  # positions that are no longer few
_GAP, _UNEVEN = 0.2, 5.0  # part of the range without a reading; that in median distances


def find_dead_band(data: Data, request: Request[PotentiometerOptions]) -> float:
    """Dead band that describes the data best [unit of the reading].

    The branches are taken to be polynomials of the pooled curve, nearly straight ones.
    """
    if "hysteresis_dead_band" in request.fixed:
        return float(request.fixed["hysteresis_dead_band"])
    if request.options.dead_band is not None:
        return request.options.dead_band
    scaled = scale_samples(data)
    shape = Shape(min(4, highest_degree(scaled.merged, 1)))
    pooled = fit_shape(compress(scaled.merged, COARSE), shape, shape.starts()[:1])
    steps = np.diff(np.unique(scaled.merged.t)) * scaled.span
    finest = max(2.0 * float(steps.min()), 2e-3 * scaled.span)
    part = max(data.parts, key=lambda p: p.stop - p.start)
    part = slice(part.start, min(part.stop, part.start + 30_000))
    used, x = data.used[part], data.reading[part]
    t = (x[used] - scaled.low) / scaled.span
    y = (data.reference[part][used] - scaled.base) / scaled.stroke
    b = bernstein(np.clip(pooled.evaluate(t, np.ones(t.size)), 0.0, 1.0), 4)
    best, found = np.inf, finest
    for band in finest * 2.0 ** np.arange(6):
        share = rising_share(x, band)[used, None]
        columns = np.hstack((b * share, b * (1.0 - share)))
        rest = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
        if rest @ rest < best * (1.0 - 1e-3):
            best, found = float(rest @ rest), float(band)
    return found


def highest_degree(rows: Rows, branches: int) -> int:
    """Highest degree that automatic choice tries: three positions are left over at least."""
    least = min(position_count(rows), sample_count(rows) / branches)
    return int(np.clip((least - 4) // 2, 1, MOST))


def search_degree(
    rows: Rows, shape: Shape, request: Request[PotentiometerOptions]
) -> tuple[CurveFit, list[Score]]:
    """Fit all degrees up to the one wanted; without one, choose by cross-validation.

    Each branch is searched by itself, on the samples that are wholly its own; all samples
    and both branches come together in the final fit.
    """
    highest = shape.degree or highest_degree(rows, shape.branches)
    request.progress(f"fitting curves up to degree {highest}")
    alone = replace(shape, degree=highest, branches=1)
    branches = [rows] if shape.branches == 1 else _separate(rows)
    coarse = [compress(r, COARSE) for r in branches]
    ladders = [fit_ladder(r, alone) for r in coarse]
    scores: list[Score] = []
    degree = shape.degree
    if not degree:
        if highest > 1:
            scores = _pool(
                [cross_validate(r, f, find_positions(r.t)) for r, f in zip(coarse, ladders)]
            )
        degree = smallest_sufficient(scores) if scores else 1
    found = [ladder[degree - 1] for ladder in ladders]
    final = replace(shape, degree=degree)
    start = final.start_at([f.weights[0] for f in found])
    # with two branches a bin holds up to five rows
    fit = fit_shape(compress(rows, FINE // (4 if shape.branches > 1 else 1)), final, [start])
    first = found[0].search
    search = replace(fit.search, tried=first.tried, agreeing=first.agreeing)
    return replace(fit, search=search), scores


def _separate(rows: Rows) -> list[Rows]:
    """Samples wholly on the rising and wholly on the falling branch."""
    one = np.ones(rows.t.size)
    whole = [rows.rising >= 0.999, rows.rising <= 0.001]
    return [replace(rows.take(w), rising=one[w]) for w in whole]


def _pool(scores: Sequence[Sequence[Score]]) -> list[Score]:
    """Cross-validated errors of all branches together, degree by degree."""
    return [
        Score(alike[0].degree, np.concatenate([s.squares for s in alike])) for alike in zip(*scores)
    ]


def weigh_suspects(
    scaled: Scaled, data: Data, shape: Shape, request: Request[PotentiometerOptions]
) -> Scaled:
    """Bound the pull of lone extremes that look clipped.

    They stay in, but a clipped reading far off the course of all others must not buy a
    degree or bend the end of the curve: its weight is ``1 / (1 + (r / 3 s)^2)`` with its
    distance ``r`` from the curve of the others and their scatter ``s``.
    """
    suspects = request.options.suspected
    if not suspects or shape.branches > 1 or scaled.scatter is not None:
        return scaled
    rows = scaled.rows
    suspect = np.isin(data.kept(data.reading), suspects)
    others = rows.take(~suspect)
    if sample_count(others) < shape.unknowns + 4 or np.unique(others.t).size < 6:
        return scaled
    fit, _ = search_degree(others, replace(shape, ends=None), request)
    rest = rows.y - fit.evaluate(rows.t, rows.rising)
    free = max(others.t.size - fit.shape.unknowns, 1)
    scatter = np.sqrt(float(rest[~suspect] @ rest[~suspect]) / free)
    share = rest / max(3.0 * scatter, 1e-300)
    weighted = replace(rows, count=np.where(suspect, 1.0 / (1.0 + share**2), 1.0))
    return replace(scaled, rows=weighted, merged=weighted)


def make_monotone(
    scaled: Scaled, fit: CurveFit, wanted: bool | None
) -> tuple[CurveFit, list[Notice]]:
    """Keep the curve from turning back unless the data say that it does."""
    if fit.monotone or wanted is False:
        return fit, []
    rows = scaled.merged
    direction = 1 if np.polynomial.Polynomial.fit(rows.t, rows.y, 1).convert().coef[-1] > 0 else -1
    shape = replace(fit.shape, direction=direction)
    starts = [shape.start_at(fit.weights), *shape.starts()]
    bounded = fit_shape(compress(rows, FINE), shape, starts)
    if _excess_tail(scaled, bounded, fit) >= 1e-3:
        return bounded, []
    ratio = np.sqrt(scaled.squares(bounded) / max(scaled.squares(fit), 1e-300))
    if wanted:
        text = (
            f"the data resist --monotone: the residuals of the monotone curve are {ratio:.3g} "
            "times those of the free one. Give --no-monotone, or another degree."
        )
    else:
        text = (
            f"the curve of degree {fit.shape.degree} turns back within the range, so a position "
            f"may have two readings; kept monotone its residuals would be {ratio:.3g} times as "
            "large. Try another --degree, or give --monotone."
        )
    return bounded if wanted else fit, [Notice("not-monotone", text)]


def drop_weights(
    scaled: Scaled, fit: CurveFit, spread: Uncertainty
) -> tuple[CurveFit, list[Notice]]:
    """Replace weights that the data say nothing about by ones.

    Every straight line, for one, is a curve of degree two with any of a family of weights.
    """
    widest = std_errors(spread, fit.shape.degree)[:, 1].max()
    half = t_quantile(0.975, spread.degrees) * widest
    if not fit.shape.rational or half <= LOG_WEIGHT_LIMIT:
        return fit, []
    shape = replace(fit.shape, rational=False)
    plain = fit_shape(compress(scaled.merged, FINE), shape, shape.starts())
    lower = f"Give a --degree below {fit.shape.degree}, or --degree auto. "
    advice = lower if fit.shape.degree > 1 else ""
    if _excess_tail(scaled, plain, fit) < 0.05:
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


def _excess_tail(scaled: Scaled, restricted: CurveFit, fit: CurveFit) -> float:
    """Probability of an F statistic as large as that of a restricted fit."""
    from scipy.special import fdtrc

    worse, better = scaled.squares(restricted), scaled.squares(fit)
    extra = fit.shape.degree * fit.shape.branches
    free = sample_count(scaled.merged) - fit.shape.unknowns
    if worse <= better or free < 1:
        return 1.0
    return float(fdtrc(extra, free, (worse - better) / extra / max(better / free, 1e-28)))


def few_positions_notice(scaled: Scaled, fit: CurveFit, scores: Sequence[Score]) -> list[Notice]:
    """Warn of a gap, or of positions that allow no curve that bends more often than this one."""
    if gap := _widest_gap(scaled, fit):
        return [gap]
    positions = position_count(scaled.merged)
    highest = highest_degree(scaled.merged, fit.shape.branches)
    if fit.shape.degree < highest or highest == MOST or positions > _PLENTY:
        return []
    if not scores and positions >= 2 * fit.shape.degree + 4 and highest > 1:
        return []  # a degree that was given
    text = (
        f"{positions} positions cannot show whether the curve bends more often than one of degree "
        f"{fit.shape.degree}, the highest they can test: between them it may be off by far more "
        f"than the intervals say. Record {2 * fit.shape.degree + 6} positions or more, spread "
        "over the whole range; more readings at the same positions do not help."
    )
    return [Notice("few-positions", text)]


def _widest_gap(scaled: Scaled, fit: CurveFit) -> Notice | None:
    """Warn of a part of the range in which nothing was recorded, though elsewhere it was."""
    t = np.unique(scaled.merged.t)
    steps = np.diff(t)
    k = int(np.argmax(steps))
    if steps[k] < _GAP or t.size < 8 or steps[k] < _UNEVEN * float(np.median(steps)):
        return None
    low, high = (scaled.low + scaled.span * t[i] for i in (k, k + 1))
    return Notice(
        "few-positions",
        f"there are no readings between {low:.6g} and {high:.6g}, {100.0 * steps[k]:.0f} % of the "
        f"range: what the curve does there follows from its degree ({fit.shape.degree}) alone, and "
        "no interval allows for another shape. Record positions there.",
    )


def bound_notice(fit: CurveFit) -> list[Notice]:
    """Warn of weights that rest on their bound."""
    names = [
        f"weight of control point {i + 1}{' (falling)' if k else ''}"
        for k in range(fit.shape.branches)
        for i in range(fit.shape.degree if fit.shape.rational else 0)
        if fit.search.best.active[k * fit.shape.nonlinear + i]
    ]
    if not names:
        return []
    text = (
        f"{len(names)} of the weights rest on the bound of 50 that keeps the curve from "
        f"bending too sharply ({', '.join(names)}); their intervals do not count. "
    )
    advice = "Give another --degree." if fit.shape.degree > 1 else "Give --degree 2 or more."
    return [Notice("weight-at-bound", text + advice)]
