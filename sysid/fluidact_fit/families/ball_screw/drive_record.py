"""Errors of the recorded drive: noise of a measured one, noise of a command, missing rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ...errors import Notice
from ...estimation.inputs import settled_hold
from ...estimation.noise import noise_floor
from ...estimation.parametric import Fitted
from ...estimation.uncertainty import covariance, largest
from ...experiment import Experiment, FloatArray, Signal
from .model import Axis, DriveModel

_FIRST, _DRAWS = 4, 48  # disturbances: the first show whether noise matters, all tell how much
_MATTERS = 0.1  # of a standard error, by which the first disturbances have to move an estimate
_WANDERS = 20  # rows over which white noise averages out, but not what a wrong break-away does
_ORDER = 8  # of the differences that leave noise of a drive, and nothing of a sine
# of the range of a held drive: below is the curve of a chirp, above are levels that were commanded
_HELD_NOISE = (5e-4, 0.02)
_MISSING = 1.5  # sample times between two samples, from which rows are missing between them


def with_drive_noise(
    fitted: Fitted, axis: Axis, experiments: Sequence[Experiment], seed: int
) -> Fitted:
    """Return the fit with the noise of a measured drive in its covariance.

    Noise moves the instants of break-away and, until the next stop, the speed. Residuals show only
    part of that: few break-aways tell a static level. So the drive is disturbed at random by as
    much noise as it shows, followed through all events, and the estimate moved by
    ``(J'J)^-1 J' dy``. Where the residual wanders less than what is left of ``dy``, part of the
    noise was in the machine (such as rounding of a command), and the moves count for less.
    """
    noise = [_measured_noise(e.signals[axis.drive]) for e in experiments]
    if not any(noise) or not fitted.names:
        return fitted
    rng = np.random.default_rng(seed)
    clean = DriveModel(experiments, axis).compared_rows(fitted.values)
    jacobian = fitted.solution.jacobian
    plain = covariance(jacobian, fitted.solution.residuals, robust=False).covariance
    moves, left = list[FloatArray](), list[float]()
    while len(moves) < _DRAWS:
        noisy = [_disturbed(e, axis, s, rng) for e, s in zip(experiments, noise)]
        shifts = [
            a - b for a, b in zip(DriveModel(noisy, axis).compared_rows(fitted.values), clean)
        ]
        change = [shift - shift.mean() for shift in shifts]  # the offset of a run is free
        moves.append(np.linalg.lstsq(np.vstack(jacobian), np.concatenate(change), rcond=1e-12)[0])
        left.append(sum(_wander(c - j @ moves[-1]) for c, j in zip(change, jacobian)))
        added = np.transpose(moves) @ np.array(moves) / len(moves)
        if len(moves) == _FIRST and np.all(np.diag(added) < _MATTERS**2 * np.diag(plain)):
            return fitted
    share = min(sum(map(_wander, fitted.solution.residuals)) / float(np.mean(left)), 1.0)
    # a residual that is autocorrelated has shown part of it already: the larger of the two
    both = largest([fitted.covariance, plain + share * added])
    return replace(fitted, covariance=both)


def _disturbed(
    experiment: Experiment, axis: Axis, noise: float, rng: np.random.Generator
) -> Experiment:
    """Return the run with white noise on its drive."""
    signal = experiment.signals[axis.drive]
    values = signal.values + noise * rng.standard_normal(signal.values.size)
    changed = {axis.drive: replace(signal, values=values)}
    return replace(experiment, signals={**experiment.signals, **changed})


def _wander(rows: FloatArray) -> float:
    """Sum of squares of what changes slowly in the rows of a run: of the means of blocks.

    What white noise has in them is subtracted, down to a quarter of it: less could not be told
    from none.
    """
    count = rows.size // _WANDERS
    if count < 2:
        return float(rows @ rows) / _WANDERS
    blocks = rows[: count * _WANDERS].reshape(count, -1)
    white = float(blocks.var(axis=1, ddof=1).sum()) / _WANDERS
    return max(float(np.sum(blocks.mean(axis=1) ** 2)) - white, 0.25 * white)


def drive_notices(axis: Axis, experiments: Sequence[Experiment]) -> Iterator[Notice]:
    """Warn of rows that are missing, and of a drive that is taken for held and carries noise.

    A static level is then sought between values that never acted; the search cannot know by how
    much it is off.
    """
    drives = [e.signals[axis.drive] for e in experiments]
    missing = sum(map(_missing_rows, drives))
    if missing:
        yield Notice(
            "gap",
            f"at {missing} places rows are missing, in which nobody knows the {axis.drive}: what "
            "it did there to the motion is not in the intervals. Log every row, or keep to a "
            "part without gaps by --window.",
        )
    noise = max(map(_held_noise, drives))
    if noise:
        yield Notice(
            "command-noise",
            f"'{axis.drive}' is taken for held between samples, as a command is, but carries "
            f"noise of {noise:.2g} {drives[0].unit} rms: the static levels may be off by many of "
            f"their standard errors. Log the command, or give --hold {axis.drive}=smooth if it "
            "was measured.",
        )


def _missing_rows(signal: Signal) -> int:
    """Count the gaps between samples of a drive."""
    steps = np.diff(signal.time)
    return int(np.count_nonzero(steps > _MISSING * np.median(steps))) if steps.size else 0


def _measured_noise(signal: Signal) -> float:
    """Standard deviation of the noise of a drive that is not a command [SI]."""
    return 0.0 if settled_hold(signal) == "zoh" else noise_floor(signal.values, _ORDER)


def _held_noise(signal: Signal) -> float:
    """Standard deviation of what is neither a curve nor a level that was commanded [SI]."""
    if settled_hold(signal) != "zoh":
        return 0.0
    span, noise = float(np.ptp(signal.values)), noise_floor(signal.values, _ORDER)
    return noise if _HELD_NOISE[0] * span < noise < _HELD_NOISE[1] * span else 0.0
