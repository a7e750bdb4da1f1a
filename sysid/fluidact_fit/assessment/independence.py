"""How many independent samples are the data worth?

Strongly autocorrelated errors make hundreds of samples say as much as a dozen independent ones.
The covariance allows for that, with a size and an autocorrelation of the errors that come from
the same residuals. Where these are worth hardly more samples than there are unknowns, the curve
has taken the slow part of the errors for its own, and no residual shows how large it was.

An autoregression of few lags does not see what wanders over seconds below a louder white noise,
and that is just what adds up in an estimate. What the residuals of a block of rows contribute
to the estimate shows it [1]_: with errors that are forgotten within a block, the sum of squares of
``B`` such contributions has the variance of the estimate for its mean.

References
----------
.. [1] B. Schmeiser, "Batch size effects in the analysis of simulation output", Operations
   Research 30(3), 1982.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import Notice
from ..estimation.blocks import condense, rows_of
from ..estimation.uncertainty import inverse_information
from ..experiment import FloatArray
from .optimum import Optimum

_FEWEST = 8.0  # independent samples an unknown: with fewer, errors of 4 standard errors were seen
_BLOCKS = (6, 12, 24, 48)  # of rows, whose contributions are compared; each divides the last
_SHORTEST = 25  # rows of a block
_BY_CHANCE = 1e-5  # probability at which they count for no chance
_WIDER = 1.5  # times its standard error, that the error of a parameter has to be by them


def find_independent_samples(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """How many independent samples the residuals are worth, and a warning where they are few."""
    slow, said = _find_slow_errors(at)
    entry, few = _count_independent(at)
    return {**entry, **slow}, few or said


def _find_slow_errors(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """Errors that change so slowly that the intervals do not know of them."""
    if len(at.roles) > 1 or at.instruments or not all(e.time.size for e in at.experiments):
        return {}, []
    wider = _errors_by_blocks(at) / at.errors
    worst = int(np.argmax(wider))
    if wider[worst] <= _WIDER:
        return {}, []
    name, times = at.names[worst], float(wider[worst])
    return {"slow_errors": {"parameter": name, "times": times}}, [
        Notice(
            "errors-change-slowly",
            f"the residuals hold errors that change slowly, over a part of the log that counts: by "
            f"what its blocks contribute, {name} is uncertain by {times:.2g} times its standard "
            "error. Look for a sensor that warms up, a supply that wanders, or a machine that "
            "changes; record for longer, or zero the sensors before every log.",
        )
    ]


def _errors_by_blocks(at: Optimum) -> FloatArray:
    """Standard errors by the contributions of blocks of rows, 0 where no more than chance."""
    from scipy.special import chdtri

    bread, blind = inverse_information(condense(rows_of(at.jacobians)))
    known, n = at.errors**2, sum(r.size for r in at.residuals)
    counts = [count for count in _BLOCKS if n >= count * _SHORTEST]
    out = np.zeros(known.size)
    if np.any(blind) or not counts:  # the output may say nothing of what was fitted to others
        return out
    finest = counts[-1]
    scores = np.array([_score(at, k * n // finest, (k + 1) * n // finest) for k in range(finest)])
    parts = scores @ bread
    for count in counts:
        sums = parts.reshape(count, finest // count, known.size).sum(axis=1)
        found = np.sum(sums**2, axis=0) * count / (count - 1)
        more = found > known * chdtri(count - 1, _BY_CHANCE) / (count - 1)
        out = np.where(more, np.maximum(out, found), out)
    return np.sqrt(out)


def _score(at: Optimum, begin: int, end: int) -> FloatArray:
    """``J' r`` over some rows, counted through all runs, shape ``(p,)``."""
    total, first = np.zeros(len(at.names)), 0
    for j, r in zip(at.jacobians, at.residuals, strict=True):
        a, b = max(begin - first, 0), min(end - first, r.size)
        if a < b:
            total += r[a:b] @ j[a:b]
        first += r.size
    return total


def _count_independent(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """How many independent samples would show the size of the errors as well."""
    independent, unknowns = at.estimate.independent, len(at.names)
    if not np.isfinite(independent):
        return {}, []
    entry = {"samples": independent}
    if independent >= _FEWEST * unknowns:
        return entry, []
    samples = sum(r.size for r in at.residuals)
    return entry, [
        Notice(
            "few-independent-samples",
            f"the residuals are autocorrelated over so long that {samples} samples show the size "
            f"of the errors as well as some {independent:.0f} independent ones would, with "
            f"{unknowns} unknowns fitted to them: the parameters may be off by more than their "
            "intervals say. Settle what else is said of this fit first, since it may be the cause; "
            "then record for longer, with more strokes over the whole range. Faster sampling does "
            "not help.",
        )
    ]
