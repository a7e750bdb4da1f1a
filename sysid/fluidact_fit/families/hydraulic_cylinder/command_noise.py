"""Noise on the logged command of a gray box, and what it does to the estimates.

A reading of the command carries noise that the machine did not see; a controller that closes a
loop over a noisy position sends its noise. See ``docs/theory/hydraulic-cylinder.md``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...estimation.least_squares import without
from ...estimation.noise import noise_floor
from ...experiment import FloatArray
from .gray_search import GrayPoint

_DRAWS = 16  # of the noise
_SEEN = 0.5  # share of the noise that the machine did not see: certainly less, and it saw it
_SURE = 3.0  # standard errors
_SPAN = 5  # samples of the median that takes the noise off a command


def command_noise(point: GrayPoint) -> tuple[FloatArray, float]:
    """Covariance of the free parameters by noise on the command, ``(p, p)``, from draws of it.

    Returned as well is the largest standard deviation found on the command of a log [V], 0 where
    the machine saw them all.
    """
    rng, bread = np.random.default_rng(0), point.bread
    total, most = np.zeros_like(bread), 0.0
    for k, log in enumerate(point.problem.logs):
        noise = noise_floor(log.command, 4)
        if noise == 0.0 or _was_seen(point, k):
            continue
        most = max(most, noise)
        draws = noise * rng.standard_normal((_DRAWS, log.command.size))
        scores = [bread @ (point.jacobian[k].T @ _change(point, k, d)) for d in draws]
        total += np.transpose(scores) @ scores / _DRAWS
    return total, most


def _was_seen(point: GrayPoint, k: int) -> bool:
    """True if the residuals of a log show that the machine followed the noise of its command.

    The share of it that the machine did not follow is estimated beside the parameters.
    """
    from scipy.ndimage import median_filter

    command = point.problem.logs[k].command
    column = _change(point, k, median_filter(command, _SPAN, mode="nearest") - command)
    own = point.jacobian[k].T @ column
    size = max(float(column @ column - own @ point.bread @ own), 1e-300)
    share = float(column @ point.residuals[k]) / size
    return share + _SURE / np.sqrt(size) < _SEEN


def _change(point: GrayPoint, k: int, command: FloatArray) -> FloatArray:
    """Change of the weighted rows of a log with its command, less what its start explains."""
    problem, log = point.problem, point.problem.logs[k]
    other = replace(log, command=log.command + command)
    moved = problem.box.simulate(other, point.initial[k], point.values)
    return without(point.start_basis[k], problem.weighted(log, moved - point.states[k]))
