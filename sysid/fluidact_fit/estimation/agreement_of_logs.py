"""Agreement of logs of one machine: leave-one-log-out errors and drift, without refitting.

At the optimum the fit is nearly linear in its parameters, so the estimate from one log alone, and
from all the others, follows from the Jacobian by one Gauss-Newton step. The difference of the two,
in its standard errors, is the drift of that log.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import erfc, sqrt

import numpy as np

from ..experiment import BoolArray, FloatArray
from ..rows import square_sum
from .least_squares import scaled_inverse
from .uncertainty import covariance


@dataclass(frozen=True)
class LogDisagreement:
    """Disagreement of one log with the others in one parameter.

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
    """Normal equations of one log, with the covariance of its own estimate."""

    information: FloatArray
    score: FloatArray
    covariance: FloatArray
    jacobian: Sequence[FloatArray]
    residual: Sequence[FloatArray]


def compare_logs(
    jacobian: Sequence[FloatArray],
    residuals: Sequence[FloatArray],
    logs: Sequence[int],
    names: Sequence[str],
    least: float = 0.0,
    readings: Sequence[tuple[FloatArray, float]] = (),
) -> tuple[list[LogDisagreement], dict[int, float]]:
    """Compare every log with the others, in every parameter and by prediction.

    Parameters
    ----------
    jacobian, residuals
        Per experiment, shapes ``(n_i, p)`` and ``(n_i,)``, at the optimum.
    logs
        Log of every experiment.
    names
        Parameters; nuisance unknowns have been left out of the Jacobian.
    least
        Share of the information on a parameter that a log has to contain to be judged by it.
    readings
        As in :func:`.uncertainty.covariance`; errors of logs with the same levels are taken for
        independent, which is cautious.

    Returns
    -------
    drifts
        The worst parameter of every log, the worst log first; of two logs the first one only. Logs
        already named are left out of the reference of those after them, so that one odd log does
        not make the others look odd.
    left_out
        Root-mean-square error of every log predicted from all the others; empty for two logs.
    """
    every = list(dict.fromkeys(logs))
    parts = {k: _part(jacobian, residuals, readings, logs, k) for k in every}
    left_out = {k: _predicted_error(parts, k) for k in every} if len(every) > 2 else {}
    drifts: list[LogDisagreement] = []
    rest = dict(parts)
    tests = len(every) * len(names)
    while len(rest) > 1:
        # two logs differ from each other equally: rounding must not decide which is named
        tried = list(rest)[:1] if len(rest) == 2 else rest
        found = max(
            (_drift(rest, k, names, tests, least) for k in tried),
            key=lambda d: abs(d.deviations),
        )
        drifts.append(found)
        del rest[found.log]
    return drifts, left_out


def _part(
    jacobian: Sequence[FloatArray],
    residuals: Sequence[FloatArray],
    readings: Sequence[tuple[FloatArray, float]],
    logs: Sequence[int],
    k: int,
) -> _Part:
    js = [j for j, log in zip(jacobian, logs) if log == k]
    rs = [r for r, log in zip(residuals, logs) if log == k]
    ys = [y for y, log in zip(readings, logs) if log == k]
    information = np.sum([j.T @ j for j in js], axis=0)
    score = np.sum([j.T @ r for j, r in zip(js, rs)], axis=0)
    return _Part(information, score, covariance(js, rs, readings=ys).covariance, js, rs)


def _pooled(parts: dict[int, _Part], k: int) -> tuple[list[_Part], FloatArray, FloatArray]:
    """All logs but one, their information ``(p, p)``, and their step of the estimate ``(p,)``."""
    others = [p for j, p in parts.items() if j != k]
    information = np.sum([p.information for p in others], axis=0)
    score = np.sum([p.score for p in others], axis=0)
    return others, information, _inverse(information)[0] @ score


def _inverse(information: FloatArray) -> tuple[FloatArray, BoolArray]:
    return scaled_inverse(information, 1e-10, 1e-4)


def _drift(
    parts: dict[int, _Part],
    k: int,
    names: Sequence[str],
    tests: int,
    least: float,
) -> LogDisagreement:
    one, (others, information, theirs) = parts[k], _pooled(parts, k)
    # covariance of the pooled others: each log's sandwich, weighted by its information
    own, (inverse, vague) = _inverse(one.information)[0], _inverse(information)
    with np.errstate(invalid="ignore"):  # what a log does not determine has no finite one
        middle = np.sum([p.information @ p.covariance @ p.information for p in others], axis=0)
        variance = np.diag(one.covariance) + np.diag(inverse @ middle @ inverse)
    variance = np.where(vague, np.inf, variance)
    difference = own @ one.score - theirs
    z = difference / np.sqrt(np.maximum(variance, 1e-300))
    together = np.diag(_inverse(one.information + information)[0])
    alone = np.maximum(np.diag(own), np.diag(inverse))
    z = np.where(np.isfinite(z) & (least * alone <= together), z, 0.0)
    worst = int(np.argmax(np.abs(z)))
    p_value = min(1.0, tests * erfc(abs(float(z[worst])) / sqrt(2.0)))
    return LogDisagreement(k, names[worst], float(difference[worst]), float(z[worst]), p_value)


def _predicted_error(parts: dict[int, _Part], k: int) -> float:
    part, step = parts[k], _pooled(parts, k)[2]
    errors = [r - j @ step for j, r in zip(part.jacobian, part.residual)]
    return float(np.sqrt(sum(map(square_sum, errors)) / sum(e.size for e in errors)))
