"""Impulse and step response of a system with one input and one output, without a model of it.

The impulse response ``g`` is a vector of numbers, ``y_k = c + sum_j g_j u_(k-j) + e_k``, with the
prior covariance ``gamma s^2 lambda^max(i,j)`` that lets it be rough early and small late (the TC
kernel). ``gamma`` and ``lambda`` maximise the marginal likelihood; the posterior covariance gives
the bands. Where the residual is coloured, input and output are filtered by an autoregression of it
and the estimate is repeated. An output that integrates its input
is compared with the integral; the taps are then those of the rate.

Source: Chen, Ohlsson and Ljung, "On the estimation of transfer functions, regularizations and
Gaussian processes - revisited", Automatica 48 (2012).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, eigh

from ..estimation.uncertainty import fit_autoregression, innovations
from ..experiment import FloatArray

_TAPS = 100  # of an impulse response
_FEWEST_TAPS = 10
_PER_TAP = 4  # samples at least
_MOST_ROWS = 40_000  # of all runs; beyond, means of consecutive samples are taken
_BETTER = 0.95  # of the error of prediction, from which on the output integrates
_LASTING = 0.2  # of the largest rate, that is left of one that lasts
_DECAYS = 1.0 - np.geomspace(0.004, 0.5, 14)  # lambda, per tap
_SIZES = np.geomspace(1e-4, 1e8, 73)  # gamma, of scaled signals
_SETTLED = 0.02  # of the largest step response, that is left in the last taps
_ORDER = 12  # of the autoregression of the residual, at most
_TWO_SIDED = 1.959964  # standard deviations of a 95 % interval

Runs = Sequence[tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class Recipe:
    """Settled choices of an estimate: with them, taps are linear in the output."""

    thin: int
    stride: int
    taps: int
    drift: bool
    scales: tuple[float, float]
    colour: FloatArray
    decay: float
    size: float


@dataclass(frozen=True)
class ImpulseResponse:
    """Impulse response with its uncertainty.

    Attributes
    ----------
    step : float
        Time from one tap to the next [s]: a sample, or several of a slow system.
    taps : (n,)
        What one unit of the input during ``step`` changes of the output (of its rate, where it
        ``integrates``) ``k`` steps later [output/input].
    covariance : (n, n)
        Of the taps.
    integrates : bool
        Whether the taps are those of the rate of change of the output [output/input/s].
    delay : tuple of float
        95 % interval of the dead time [s].
    samples : int
        That were used.
    recipe
        How it was estimated, for :func:`respond_alike`.
    """

    step: float
    taps: FloatArray
    covariance: FloatArray
    integrates: bool
    delay: tuple[float, float]
    samples: int
    recipe: Recipe

    @property
    def time(self) -> FloatArray:
        """Time of the taps [s], shape ``(n,)``."""
        return self.step * np.arange(self.taps.size, dtype=float)

    @property
    def half_width(self) -> FloatArray:
        """Half the 95 % band of each tap, shape ``(n,)``."""
        return np.asarray(_TWO_SIDED * np.sqrt(np.diag(self.covariance)))

    @cached_property
    def step_response(self) -> tuple[FloatArray, FloatArray]:
        """Sum of the taps and half its 95 % band, shapes ``(n,)``."""
        summed = np.cumsum(np.cumsum(self.covariance, axis=0), axis=1)
        return np.cumsum(self.taps), _TWO_SIDED * np.sqrt(np.maximum(np.diag(summed), 0.0))


# ------------------------------------------------------------------------------ impulse response


def impulse_response(
    runs: Runs, sample_time: float, *, held: bool = True
) -> ImpulseResponse | None:
    """Estimate the impulse response of evenly sampled runs.

    Parameters
    ----------
    runs
        Input and output of each, shapes ``(n,)`` [any units].
    sample_time
        Of all of them [s].
    held
        Whether the input is constant between its samples, as a command is; else it is followed by
        straight lines, and the dead time is known to a sample less.

    Returns
    -------
    ImpulseResponse or None
        ``None`` where the runs are too short, or the input or the output does not change.
    """
    thin = -(-sum(u.size for u, _ in runs) // _MOST_ROWS)
    pairs = _thinned(runs, thin)
    estimate, stride = None, 1
    while (found := _best_form(pairs, sample_time * thin, thin, stride, held)) is not None:
        estimate, stride = found, 2 * stride
        if _has_settled(found):
            break
    return estimate


def respond_alike(found: ImpulseResponse, runs: Runs) -> FloatArray:
    """Taps of other outputs for the same inputs, estimated as others were, shape ``(n,)``.

    The difference of two such estimates is that of the difference of the outputs.
    """
    recipe, step = found.recipe, found.step / found.recipe.stride
    pairs = _thinned(runs, recipe.thin)
    if recipe.drift:
        pairs = [(step * np.cumsum(u - u.mean()), y) for u, y in pairs]
    tables = _tables(pairs, recipe)
    gram = np.asarray(sum(x.T @ x for x, _ in tables))
    right = np.asarray(sum(x.T @ y for x, y in tables))
    return recipe.scales[1] / recipe.scales[0] * (_spread(gram, recipe.decay, recipe.size) @ right)


def _thinned(runs: Runs, size: int) -> list[tuple[FloatArray, FloatArray]]:
    """Means of consecutive samples of every run."""
    return [(_means(np.asarray(u, dtype=float), size), _means(np.asarray(y, dtype=float), size))
            for u, y in runs]  # fmt: skip


def _means(values: FloatArray, size: int) -> FloatArray:
    whole = values.size // size * size
    return values if size == 1 else values[:whole].reshape(-1, size).mean(axis=1)


def _has_settled(found: ImpulseResponse) -> bool:
    """Return whether the last fifth of the taps adds nothing to the step response."""
    total, _ = found.step_response
    last = max(total.size // 5, 1)
    return abs(float(total[-1] - total[-last])) <= _SETTLED * float(np.abs(total).max())


def _best_form(
    runs: Runs, step: float, thin: int, stride: int, held: bool
) -> ImpulseResponse | None:
    """The response to the input or to its integral, whichever predicts clearly better."""
    plain = _fit(runs, thin, stride, drift=False)
    summed = [(step * np.cumsum(u - u.mean()), y) for u, y in runs]
    rate = _fit(summed, thin, stride, drift=True)
    if plain is None or rate is None:
        return None
    total = np.cumsum(rate.taps)
    lasts = abs(float(total[-1])) > _LASTING * float(np.abs(total).max())
    integrates = lasts and rate.innovation < _BETTER * plain.innovation
    best = rate if integrates else plain
    low, high = best.delay()
    coarse = step * stride
    return ImpulseResponse(
        coarse, best.taps, best.covariance, integrates,
        (max(low * coarse - step, 0.0), high * coarse + (0.0 if held else step)), best.samples,
        best.recipe,
    )  # fmt: skip


@dataclass(frozen=True)
class _Fit:
    """A regularised least-squares fit of taps: sums of scaled signals, and what came of them."""

    gram: FloatArray
    right: FloatArray
    square: float
    samples: int
    recipe: Recipe
    taps: FloatArray
    covariance: FloatArray
    innovation: float

    def delay(self) -> tuple[int, int]:
        """First and last number of leading zero taps that are likely (95 %, by evidence)."""
        most = self.taps.size // 2
        cost = np.array([self._cost_without(k) for k in range(most)])
        weight = np.exp(-0.5 * (cost - cost.min()))
        share = np.cumsum(weight) / weight.sum()
        return int(np.searchsorted(share, 0.025)), int(np.searchsorted(share, 0.975))

    def _cost_without(self, leading: int) -> float:
        """Minus twice the log evidence with so many taps at zero."""
        gram, right = self.gram[leading:, leading:], self.right[leading:]
        root = np.sqrt(self.recipe.size) * _root(right.size, self.recipe.decay)
        inner = np.eye(right.size) + root.T @ gram @ root
        factor = cho_factor(inner, lower=True)
        part = root.T @ right
        left = self.square - float(part @ cho_solve(factor, part))
        logdet = 2.0 * float(np.log(np.diag(factor[0])).sum())
        return self.samples * float(np.log(max(left, 1e-300))) + logdet


def _root(taps: int, decay: float) -> FloatArray:
    """Triangular root of the kernel ``decay^max(i,j)``, shape ``(taps, taps)``."""
    k = np.arange(taps)
    kernel = decay ** np.maximum(k[:, None], k[None, :])
    return np.asarray(np.linalg.cholesky(kernel + 1e-12 * np.eye(taps)))


def _spread(gram: FloatArray, decay: float, size: float) -> FloatArray:
    """Posterior covariance of the taps per variance of the noise."""
    root = _root(gram.shape[0], decay)
    inner = np.eye(gram.shape[0]) / size + root.T @ gram @ root
    return np.asarray(root @ np.linalg.solve(inner, root.T))


def _fit(runs: Runs, thin: int, stride: int, *, drift: bool) -> _Fit | None:
    """Fit the taps, once more with whitened signals where the residual is coloured."""
    samples = sum(u.size for u, _ in runs)
    taps = min(_TAPS, samples // (stride * (_PER_TAP + len(runs))))
    if taps < _FEWEST_TAPS or any(u.size <= 2 * taps * stride for u, _ in runs):
        return None
    u_scale = float(np.std(np.concatenate([u for u, _ in runs])))
    y_scale = float(np.std(np.concatenate([y for _, y in runs])))
    if not u_scale > 0.0 or not y_scale > 0.0:
        return None
    plain = Recipe(thin, stride, taps, drift, (u_scale, y_scale), np.empty(0), 0.0, 0.0)
    tables = _tables(runs, plain)
    first = _regularised(tables, plain)
    ratio = y_scale / u_scale
    colour, _ = fit_autoregression([y - x @ (first.taps / ratio) for x, y in tables], _ORDER)
    white = [(innovations(x, colour), innovations(y, colour)) for x, y in tables]
    second = _regularised(white, replace(plain, colour=colour))
    left = np.concatenate([y - x @ (second.taps / ratio) for x, y in white])
    return replace(second, innovation=y_scale * float(np.sqrt(np.mean(left**2))))


def _tables(runs: Runs, recipe: Recipe) -> list[tuple[FloatArray, FloatArray]]:
    """Whitened regressors and outputs of all runs, scaled."""
    u_scale, y_scale = recipe.scales
    plain = (_lagged(u / u_scale, y / y_scale, recipe.taps, recipe.stride, recipe.drift)
             for u, y in runs)  # fmt: skip
    return [(innovations(x, recipe.colour), innovations(y, recipe.colour)) for x, y in plain]


def _lagged(
    u: FloatArray, y: FloatArray, taps: int, stride: int, drift: bool
) -> tuple[FloatArray, FloatArray]:
    """Regressors and output of one run from where all taps are known, less level and drift."""
    held = np.convolve(u, np.full(stride, 1.0 / stride), mode="valid")
    rows = np.arange((taps - 1) * stride, held.size)
    table = held[rows[:, None] - stride * np.arange(taps)]
    right = y[rows + stride - 1]
    t = np.linspace(-1.0, 1.0, rows.size)
    for line in (np.ones(rows.size), t) if drift else (np.ones(rows.size),):
        line = line / np.linalg.norm(line)
        table = table - np.outer(line, line @ table)
        right = right - line * float(line @ right)
    return table, right


def _regularised(tables: Sequence[tuple[FloatArray, FloatArray]], recipe: Recipe) -> _Fit:
    """Posterior of the taps at the most likely ``lambda`` and ``gamma``."""
    gram = np.asarray(sum(x.T @ x for x, _ in tables))
    right = np.asarray(sum(x.T @ y for x, y in tables))
    square = float(sum(y @ y for _, y in tables))
    samples = sum(y.size for _, y in tables)
    best, decay, size = np.inf, 0.0, 0.0
    for tried in _DECAYS.tolist():
        root = _root(right.size, tried)
        values, vectors = eigh(root.T @ gram @ root)
        part = (vectors.T @ (root.T @ right)) ** 2
        inner = 1.0 + _SIZES[:, None] * np.maximum(values, 0.0) / samples
        left = square - np.sum(_SIZES[:, None] / samples * part / inner, axis=1)
        cost = samples * np.log(np.maximum(left, 1e-300)) + np.log(inner).sum(axis=1)
        k = int(np.argmin(cost))
        if cost[k] < best:
            best, decay, size = float(cost[k]), tried, float(_SIZES[k]) / samples
    spread = _spread(gram, decay, size)
    taps = spread @ right
    noise = max(square - float(right @ taps), 0.0) / samples
    ratio = recipe.scales[1] / recipe.scales[0]
    return _Fit(gram, right, square, samples, replace(recipe, decay=decay, size=size),
                ratio * taps, ratio**2 * noise * spread, 0.0)  # fmt: skip
