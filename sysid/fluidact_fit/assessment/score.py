"""Rao's score test of one more term in a finished fit [1]_.

Residual and derivatives are whitened first, so that autocorrelated noise is not taken for a
missing response.

Noise ``e`` of a measured input is in the residual, as ``-a e`` where the output changes by ``a``
with the input, and in every derivative of the output. Their products then have a mean although
nothing is missing: least squares of the residual takes the parameters back to where their
estimate with instruments had corrected them, and takes along any term with the noise of the same
sample in it. Where the family estimates with instruments the terms are therefore judged with
them too: with ``X`` the derivatives by parameters and term, ``Z`` the same by what stands in
for noisy inputs, ``X_Z`` the projection of ``X`` on ``Z`` and ``r`` the residual,

    x = (X_Z' X)^-1 X_Z' r,   cov(x) = (X_Z' X_Z)^-1 X_Z' R X_Z (X_Z' X_Z)^-1,

the autocorrelation ``R`` of what is left from an autoregression. Nothing is whitened then: that
would bring the noise of earlier samples into the residual, of which the instruments are not free.
Where it estimates by a score corrected for the noise, the terms are judged so as well: see
:mod:`.copies`.

References
----------
.. [1] C. R. Rao, "Large sample tests of statistical hypotheses concerning several
   parameters", Proc. Cambridge Phil. Soc. 44, 1948.
.. [2] E. B. Wilson, M. M. Hilferty, "The distribution of chi-square", Proc. National Academy of
   Sciences 17, 1931.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..estimation.least_squares import explain, scaled_least_squares
from ..estimation.uncertainty import covariance, is_coarse
from ..experiment import FloatArray
from ..rows import is_kept
from .beside import Beside
from .copies import Products
from .optimum import LEAST, Optimum

_SIGNIFICANT = 3.0, 4.0  # standard errors of the added term
_MATTERS = 2.0  # standard errors by which a parameter would move
_SURE = 1.0  # the same where a term of a known sign is there without the benefit of that sign
_ONE_SIDED = 0.4  # fewer standard errors suffice where one sign alone is possible
_NOTED = 0.01  # part of its value by which one would, that asks for the first of them only
_OWN = 1e-3  # part of a direction that the parameters must leave over to tell it apart


@dataclass(frozen=True)
class Term:
    """One thing that the model may lack.

    ``columns`` are its directions in the output, per run and per ``unit``; ``words`` says what
    a size of it would mean, ``remedy`` what to do. ``offered`` marks a parameter of the family.
    The directions are those of a size up to ``most``; the term counts where it would move a
    parameter by more than ``least``, in parts of its value. ``instruments`` are the directions by
    what stands in for noisy inputs; empty where the columns know nothing of the noise. Where the
    residual itself has chosen the direction out of several, ``chosen`` is their number: by chance
    it then has as much of it as of all of them. ``positive`` ones cannot be negative.
    """

    name: str
    unit: str
    words: Callable[[float], str]
    remedy: str
    columns: Sequence[FloatArray]
    offered: bool = False
    most: float = np.inf
    least: float = LEAST
    instruments: Sequence[FloatArray] = ()
    chosen: int = 1
    positive: bool = False


@dataclass(frozen=True)
class Score:
    """What adding a term would do.

    ``size`` is that of the term [its unit], ``deviations`` that in its standard errors;
    ``parameter`` would move by ``shift`` [its unit], ``errors`` of its standard errors.
    ``share`` is the largest part of its value that one would move by, significantly. It is
    ``bounded`` unless a coarse converter may have more to do with it than the standard errors say.
    """

    term: Term
    size: float
    deviations: float
    parameter: str
    shift: float
    errors: float
    share: float
    bounded: bool = True

    @property
    def significant(self) -> float:
        """Standard errors of the term from which it counts: fewer where it would change much."""
        few, many = _SIGNIFICANT
        if self.term.positive and self.size < 0.0:
            return many
        return (few if self.share > _NOTED else many) - _ONE_SIDED * self.term.positive

    @property
    def unseen(self) -> dict[str, float]:
        """How large the term could be without being significant, and what it would then move."""
        if not self.size or not self.deviations or not self.bounded:
            return {}
        size = min(self.significant * abs(self.size / self.deviations), self.term.most)
        return {"unseen_size": size, "unseen_shift": size * abs(self.shift / self.size)}

    @property
    def telling(self) -> bool:
        """Whether the term is there, and matters."""
        possible = abs(self.size) <= self.term.most and self.share >= self.term.least
        there = abs(self.deviations) > self.significant
        return possible and there and abs(self.errors) > _needed_move(self.term, self.deviations)


def judge_term(at: Optimum, term: Term) -> Score | None:
    """Size and significance of a term; ``None`` where the parameters can stand for it."""
    found = _solve(at, term)
    if found is None:
        return None
    x, deviation = found
    return _beside_converter(at, term, _score(at, term, x, deviation))


def _score(at: Optimum, term: Term, x: FloatArray, deviation: float) -> Score:
    """What changes of the parameters and a size of the term, ``(p + 1,)``, mean."""
    errors = x[:-1] / at.errors
    values = np.abs([at.number(n) for n in at.names])
    shares = np.full(values.size, np.inf)  # whatever is added to zero
    np.divide(np.abs(x[:-1]), values, out=shares, where=values > np.finfo(float).tiny)
    worst = int(np.argmax(np.abs(errors)))
    size = float(x[-1])
    deviations = _as_one(size / max(deviation, 1e-300), term.chosen)
    shares[np.abs(errors) <= _needed_move(term, deviations)] = 0.0
    kept = replace(term, columns=(), instruments=())  # those of many terms are too much to keep
    return Score(
        kept, size, deviations, at.names[worst], float(x[worst]),
        float(errors[worst]), float(shares.max()),
    )  # fmt: skip


def _needed_move(term: Term, deviations: float) -> float:
    """Standard errors by which a parameter has to move for a term to matter.

    Noise may take as much from an error as the term added to it; where hardly a right model shows
    such a term, less of a move is enough.
    """
    return _SURE if term.positive and deviations > _SIGNIFICANT[0] else _MATTERS


def _beside_converter(at: Optimum, term: Term, plain: Score) -> Score:
    """The same by rows as they are, with the errors of a coarse converter not taken for noise.

    That takes longer, and is asked only where it may excuse what would be said. Of other terms it
    is not known then how large they could be without a word.
    """
    steps = [s.resolution for s in at.series]
    if at.copies or at.instruments or not all(map(is_kept, at.jacobians)):
        return plain
    if not is_coarse(max(steps), at.sigma):
        return plain
    if not plain.telling:
        return replace(plain, bounded=not at.quantised)
    tables = at.beside_residual(term.columns).tables
    columns, rest = [t[:, :-1] for t in tables], [t[:, -1] for t in tables]
    x = scaled_least_squares(np.vstack(columns), np.concatenate(rest))
    left = [r - c @ x for c, r in zip(columns, rest, strict=True)]
    free = sum(s.own_level for s in at.series)
    readings = list(zip(at.measured, steps, strict=True))
    spread = covariance(columns, left, readings=readings, local_unknowns=free)
    other = _score(at, term, x, float(np.sqrt(spread.covariance[-1, -1])))
    return min(plain, other, key=lambda s: abs(s.deviations))


def fit_together(
    at: Optimum, columns: Sequence[FloatArray], scale: float
) -> tuple[FloatArray, int] | None:
    """Sizes of several directions at once, as the residual has them beside the parameters.

    What the parameters can do as well is left to them: of sizes that fit alike these are the least,
    ``scale`` being what is to be expected of one.

    Returns
    -------
    The sizes, shape ``(q,)``, and how many of the directions are not those of parameters; ``None``
    where none is.
    """
    p, q = at.jacobians[0].shape[1], columns[0].shape[1]
    if at.copies:
        products = at.copies.products(columns)
        if not products.finite:
            return None
        triangle, rows = products.triangle, products.rows
    else:
        beside = at.beside_residual(columns)
        if not beside.finite:
            return None
        triangle, rows = _triangle(beside), beside.rows
    if rows <= p + q + 1:
        return None
    own, target = triangle[p : p + q, p:-1], triangle[p : p + q, -1]
    whole = np.linalg.norm(triangle[:, p:-1], axis=0).max()
    count = int(np.sum(np.linalg.svd(own, compute_uv=False) > _OWN * whole))
    sigma = float(np.linalg.norm(triangle[p + q :, -1])) / np.sqrt(rows - p - q)
    if not count:
        return None
    expected = np.eye(q) * (sigma / scale)
    return scaled_least_squares(np.vstack((own, expected)), np.append(target, np.zeros(q))), count


def _as_one(deviations: float, chosen: int) -> float:
    """Standard errors of one direction that are as rare as these of the best of several [2]_."""
    if chosen == 1:
        return deviations
    spread = 2.0 / (9.0 * chosen)
    cube = np.cbrt(deviations**2 / chosen)
    return float(np.copysign(max((cube - 1.0 + spread) / np.sqrt(spread), 0.0), deviations))


def _solve(at: Optimum, term: Term) -> tuple[FloatArray, float] | None:
    """Changes of the parameters and size of the term, ``(p + 1,)``; standard error of the size."""
    if at.copies:
        return _corrected(at.copies.products(term.columns))
    beside = at.beside_residual(term.columns)
    if not beside.finite:
        return None
    return _instrumented(at, term, beside) if at.instruments else _whitened(beside)


def _triangle(beside: Beside) -> FloatArray:
    """What holds all products of whitened columns and residual."""
    return np.asarray(np.linalg.qr(beside.whiten(beside.left_over()), mode="r"))


def _whitened(beside: Beside) -> tuple[FloatArray, float] | None:
    """The same by rows as they become white."""
    triangle = _triangle(beside)
    columns, target = triangle[:, :-1], triangle[:, -1]
    own = _own(columns)
    if not own:
        return None
    x = scaled_least_squares(columns, target)
    degrees = max(beside.rows - columns.shape[1], 1)
    return x, float(np.linalg.norm(target - columns @ x)) / np.sqrt(degrees) / own


def _corrected(products: Products) -> tuple[FloatArray, float] | None:
    """The same where the noise of inputs is taken from all products."""
    if not products.finite or products.weak:
        return None
    columns, target = products.triangle[:, :-1], products.triangle[:, -1]
    if not _own(columns):
        return None
    x = scaled_least_squares(columns, target)
    return x, float(np.sqrt(products.covariance(x)[-1, -1]))


def _instrumented(at: Optimum, term: Term, beside: Beside) -> tuple[FloatArray, float] | None:
    """The same by two-stage least squares, with what stands in for noisy inputs."""
    rows = beside.tables
    stacked = np.vstack(rows)
    columns, residual = stacked[:, :-1], stacked[:, -1]
    instruments = np.vstack(at.represented(term.instruments or term.columns).tables)[:, :-1]
    if not np.all(np.isfinite(instruments)):
        return None
    projected = instruments @ explain(columns, instruments)
    if not _own(np.asarray(np.linalg.qr(projected, mode="r"))):
        return None
    x = scaled_least_squares(projected, residual)
    cuts = np.cumsum([r.shape[0] for r in rows])[:-1]
    spread = covariance(np.split(projected, cuts), np.split(residual - columns @ x, cuts))
    return x, float(np.sqrt(max(spread.covariance[-1, -1], 0.0)))


def _own(triangle: FloatArray) -> float:
    """Size of the last column beside all others; 0 where that is nothing of its own."""
    last = triangle.shape[1] - 1
    own, whole = abs(float(triangle[last, last])), float(np.linalg.norm(triangle[:, last]))
    return own if own >= _OWN * whole else 0.0
