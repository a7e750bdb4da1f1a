"""Effect of errors of the recorded drive on the estimate: noise of its samples, lost rows.

The error moves the instants at which the axis breaks away and, until the next stop, the speed.
Residuals show only part of this: a static level is wrong by what the torque was wrong by at the few
instants of break-away. So the drive is disturbed at random by as much as it may be wrong, followed
through all events, and the estimate moved by ``(J'J)^-1 J' dy``.

What is left of ``dy`` beside the parameters wanders in the residual. Where the residual wanders
less than after any of the disturbances the error was smaller, and the moves are taken for as much
smaller: a drive that was rounded in the machine is no error of the record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from zlib import crc32

import numpy as np

from ...errors import Notice
from ...estimation.inputs import settled_hold
from ...estimation.least_squares import orthonormal, without
from ...estimation.lost_rows import find_lost_rows
from ...estimation.noise import noise_floor
from ...estimation.parametric import Fitted
from ...estimation.uncertainty import covariance, largest
from ...experiment import Experiment, FloatArray, Signal
from .model import Axis, DriveModel

_DRAWS = 24, 96  # fewest and most disturbances; they tell a standard error to 14 and 7 %
_ROWS = 80_000  # of all of them together, where these are more than the fewest
_FIRST = 4  # of them, after which it shows whether they matter at all
_MATTERS = 0.1  # of a standard error, which the first have to move an estimate by
_WANDERS = 20  # rows over which white noise averages out, but not what a wrong break-away does
_ORDER = 8  # of the differences that leave noise of a drive, and nothing of a sine
# of the range of a held drive: below is the curve of a chirp, above are levels that were commanded
_HELD_NOISE = (5e-4, 0.02)


def with_drive_errors(
    fitted: Fitted,
    model: DriveModel,
    experiments: Sequence[Experiment],
    weights: Sequence[FloatArray],
    seed: int,
) -> Fitted:
    """The fit with the errors of its drive in the covariance.

    ``weights`` are those of the compared rows, one array ``(n_i,)`` per run or none at all.
    Nothing changes for a held drive that was recorded whole: a command is what it is.
    """
    drives = [e.signals[model.axis.drive] for e in experiments]
    errors = [_errors(s) for s in drives]
    if not any(e.any() for e in errors) or not fitted.names:
        return fitted
    # logs of one bench are alike: what chance makes of some draws must not be the same for all
    rng = np.random.default_rng([seed, *(crc32(np.asarray(s.values).tobytes()) for s in drives)])
    scale: list[FloatArray | float] = [*weights] or [1.0] * len(drives)
    before = model.compared_rows(fitted.values)
    jacobian, residuals = fitted.solution.jacobian, fitted.solution.residuals
    # a position may lie beside the simulated one: that is no error of the drive
    beside = [model.compared.offset(t.size) for t in model.times]
    free = [orthonormal((w * column.T).T) for w, column in zip(scale, beside)]
    j = np.vstack(jacobian)
    # a residual that is autocorrelated has shown part of it already: the larger of the two
    plain = covariance(jacobian, residuals, robust=False)
    shown = sum(map(_wander, residuals))
    moves: list[FloatArray] = []
    left: list[float] = []
    most = int(np.clip(_ROWS // sum(y.size for y in before), *_DRAWS))
    for count in (_FIRST, most):
        while len(moves) < count:
            disturbed = model.disturbed([e * rng.standard_normal(e.size) for e in errors])
            after = disturbed.compared_rows(fitted.values)
            change = [without(q, w * (a - b)) for q, w, a, b in zip(free, scale, after, before)]
            moves.append(np.linalg.lstsq(j, np.concatenate(change), rcond=1e-12)[0])
            left.append(sum(_wander(c - k @ moves[-1]) for c, k in zip(change, jacobian)))
        # speed and acceleration are compared where the model lacks forces: they show those
        smaller = shown < min(left) and not weights
        share = shown / float(np.mean(left)) if smaller else 1.0
        added = share * np.transpose(moves) @ np.array(moves) / count
        if np.all(np.diag(added) < _MATTERS**2 * np.diag(plain.covariance)):
            return fitted
    both = np.asarray(plain.covariance + added)
    variances = np.diag(both)
    part = (np.diag(added) / np.maximum(variances, 1e-300)).max(initial=_MATTERS)
    degrees = int(most / part**2)
    if np.any(np.diag(fitted.covariance) > variances):
        degrees = min(degrees, fitted.degrees)
    return replace(fitted, covariance=largest([fitted.covariance, both]), degrees=degrees)


def _wander(rows: FloatArray) -> float:
    """Sum of squares of what changes slowly in the rows of a run.

    That of the means of blocks, less what white noise has in them. A quarter of the latter is left
    at least: less could not be told from none.
    """
    count = rows.size // _WANDERS
    if count < 2:
        return float(rows @ rows) / _WANDERS
    parts = rows[: count * _WANDERS].reshape(count, -1)
    white = float(parts.var(axis=1, ddof=1).sum()) / _WANDERS
    return max(float(np.sum(parts.mean(axis=1) ** 2)) - white, 0.25 * white)


def warn_of_held_noise(axis: Axis, experiments: Sequence[Experiment]) -> list[Notice]:
    """Say that a drive that is taken for held carries noise, which no command does.

    A static level is then sought between values that never acted; the search cannot know by how
    much it is off.
    """
    drives = [e.signals[axis.drive] for e in experiments]
    noise = max(
        (n for s in drives if settled_hold(s) == "zoh" and (n := _held_noise(s))), default=0.0
    )
    if not noise:
        return []
    text = (
        f"'{axis.drive}' is taken for held between samples, as a command is, but carries noise of "
        f"{noise:.2g} {drives[0].unit} rms: the static levels may be off by many of their standard "
        f"errors. Log the command, or give --hold {axis.drive}=smooth if it was measured."
    )
    return [Notice("command-noise", text)]


def _held_noise(signal: Signal) -> float:
    """Standard deviation of what is neither a curve nor a level that was commanded [SI]."""
    span, noise = float(np.ptp(signal.values)), noise_floor(signal.values, _ORDER)
    return noise if _HELD_NOISE[0] * span < noise < _HELD_NOISE[1] * span else 0.0


def _errors(signal: Signal) -> FloatArray:
    """Standard deviations of a drive at its nodes, lost rows included [SI]."""
    noise = 0.0 if settled_hold(signal) == "zoh" else noise_floor(signal.values, _ORDER)
    lost = find_lost_rows(signal)
    time = signal.time if lost is None else np.concatenate((signal.time, lost.time))
    errors = np.full(time.size, noise)
    if lost is not None:
        errors[signal.time.size :] = np.hypot(noise, lost.error)
    return errors[np.argsort(time, kind="stable")]
