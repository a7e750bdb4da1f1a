"""Do the logs show one machine? Leave-one-log-out and drift, without refitting.

At the optimum the fit is nearly linear in its parameters, so the estimate from one log
alone, and from all the others, follows from the Jacobian by one Gauss-Newton step. The
difference of the two, in units of its own standard error, is the drift of that log.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import erfc, sqrt

import numpy as np

from ..experiment import FloatArray
from .uncertainty import BoolArray, covariance

_RCOND = 1e-10  # eigenvalues of an information below this part of the largest say nothing


@dataclass(frozen=True)
class Drift:
    """Drift of one log in one parameter.

    ``difference`` is the estimate from the log less that from the others [unit of the
    parameter], ``deviations`` that difference in its standard errors, ``p_value`` its
    significance over all logs and parameters (Bonferroni).
    """

    log: int
    parameter: str
    difference: float
    deviations: float
    p_value: float


@dataclass(frozen=True)
class _Part:
    """Normal equations of one log."""

    information: FloatArray
    score: FloatArray
    covariance: FloatArray
    jacobian: FloatArray
    residual: FloatArray


def compare_logs(
    jacobian: Sequence[FloatArray],
    residuals: Sequence[FloatArray],
    logs: Sequence[int],
    names: Sequence[str],
) -> tuple[list[Drift], dict[int, float]]:
    """Drift of every log in every parameter, and the error of each predicted by the others.

    Parameters
    ----------
    jacobian, residuals
        Per experiment, shapes ``(n_i, p)`` and ``(n_i,)``, at the optimum.
    logs
        Log of every experiment.
    names
        Parameters; nuisance unknowns have been left out of the Jacobian.

    Returns
    -------
    drifts
        The worst parameter of every log, the worst log first. Logs already named are
        left out of the reference of those after them, so that one odd log does not
        make the others look odd.
    left_out
        Root-mean-square error of every log predicted from all the others.
    """
    every = list(dict.fromkeys(logs))
    parts = {k: _part(jacobian, residuals, logs, k) for k in every}
    left_out = {k: _predicted_error(parts, k) for k in every}
    drifts: list[Drift] = []
    rest = dict(parts)
    tests = len(every) * len(names)
    while len(rest) > 1:
        found = max((_drift(rest, k, names, tests) for k in rest), key=lambda d: abs(d.deviations))
        drifts.append(found)
        del rest[found.log]
    return drifts, left_out


def _part(
    jacobian: Sequence[FloatArray], residuals: Sequence[FloatArray], logs: Sequence[int], k: int
) -> _Part:
    js = [j for j, log in zip(jacobian, logs) if log == k]
    rs = [r for r, log in zip(residuals, logs) if log == k]
    stacked, rest = np.vstack(js), np.concatenate(rs)
    spread = covariance(js, rs).covariance
    return _Part(stacked.T @ stacked, stacked.T @ rest, spread, stacked, rest)


def _pooled(parts: dict[int, _Part], k: int) -> tuple[list[_Part], FloatArray, FloatArray]:
    """All logs but one, their information, and how far they would move the estimate."""
    others = [p for j, p in parts.items() if j != k]
    information = np.sum([p.information for p in others], axis=0)
    return others, information, _solve(information, np.sum([p.score for p in others], axis=0))


def _solve(information: FloatArray, score: FloatArray) -> FloatArray:
    scaled, scale = _scaled(information)
    return np.asarray(np.linalg.lstsq(scaled, score / scale, rcond=_RCOND)[0] / scale)


def _scaled(information: FloatArray) -> tuple[FloatArray, FloatArray]:
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    return information / np.outer(scale, scale), scale


def _unseen(information: FloatArray) -> BoolArray:
    """Parameters with a part in directions that :func:`_solve` leaves out, shape ``(p,)``."""
    values, vectors = np.linalg.eigh(_scaled(information)[0])
    left_out = values <= _RCOND * values.max()
    return np.any(np.abs(vectors[:, left_out]) > 1e-4, axis=1)


def _drift(parts: dict[int, _Part], k: int, names: Sequence[str], tests: int) -> Drift:
    one, (others, information, theirs) = parts[k], _pooled(parts, k)
    # covariance of the pooled others: each log's sandwich, weighted by its information
    middle = np.sum([p.information @ p.covariance @ p.information for p in others], axis=0)
    scaled, scale = _scaled(information)
    inverse = np.linalg.pinv(scaled, rcond=_RCOND, hermitian=True) / np.outer(scale, scale)
    spread = inverse @ middle @ inverse
    variance = np.diag(one.covariance) + np.diag(spread)
    difference = _solve(one.information, one.score) - theirs
    # what one side cannot tell does not disagree
    variance[_unseen(one.information) | _unseen(information)] = np.inf
    z = difference / np.sqrt(np.maximum(variance, 1e-300))
    worst = int(np.argmax(np.where(np.isfinite(z), np.abs(z), 0.0)))
    p_value = min(1.0, tests * erfc(abs(float(z[worst])) / sqrt(2.0)))
    return Drift(k, names[worst], float(difference[worst]), float(z[worst]), p_value)


def _predicted_error(parts: dict[int, _Part], k: int) -> float:
    error = parts[k].residual - parts[k].jacobian @ _pooled(parts, k)[2]
    return float(np.sqrt(np.mean(error**2)))
