"""Errors of the recorded drive: noise of a measured one, noise of a command, lost rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from zlib import crc32

import numpy as np

from ...errors import Notice
from ...estimation.inputs import settled_hold
from ...estimation.lost_rows import find_lost_rows
from ...estimation.noise import noise_floor
from ...estimation.parametric import Fitted
from ...estimation.uncertainty import covariance, largest
from ...experiment import Experiment, FloatArray, Signal
from .model import Axis, DriveModel

_FIRST, _DRAWS = 4, 48  # disturbances: the first show whether noise matters, all tell how much
_MATTERS = 0.1  # of a standard error, by which the first disturbances have to move an estimate
_ACTED = 1e-2  # of what noise of the record alone leaves: less says that it acted
_WANDERS = 20  # rows over which white noise averages out, but not what a wrong break-away does
_ORDER = 8  # of the differences that leave noise of a drive, and nothing of a sine
# of the range of a held drive: below is the curve of a chirp, above are levels that were commanded
_HELD_NOISE = (5e-4, 0.02)


def with_drive_errors(
    fitted: Fitted, axis: Axis, experiments: Sequence[Experiment], seed: int
) -> Fitted:
    """Return the fit with the errors of its recorded drive in its covariance.

    The drive is disturbed at random by its noise and by the uncertainty of rows that the logger
    lost, followed through all events, and the estimate moved by ``(J'J)^-1 J' dy``. Where the
    residual wanders less than what is left of ``dy``, part of the noise was in the machine (such as
    rounding of a command), and the moves count for less.
    """
    errors = [_errors(s, _measured_noise(s)) for s in (e.signals[axis.drive] for e in experiments)]
    if not any(e.any() for e in errors) or not fitted.names:
        return fitted
    jacobian = fitted.solution.jacobian
    plain = covariance(jacobian, fitted.solution.residuals, robust=False).covariance
    moves, left = list[FloatArray](), list[float]()
    for move, wander in islice(_disturbances(fitted, axis, experiments, errors, seed), _DRAWS):
        moves.append(move)
        left.append(wander)
        added = np.transpose(moves) @ np.array(moves) / len(moves)
        if len(moves) == _FIRST and np.all(np.diag(added) < _MATTERS**2 * np.diag(plain)):
            return fitted
    share = min(sum(map(_wander, fitted.solution.residuals)) / float(np.mean(left)), 1.0)
    # a residual that is autocorrelated has shown part of it already: the larger of the two
    both = largest([fitted.covariance, plain + share * added])
    return replace(fitted, covariance=both)


def _disturbances(
    fitted: Fitted, axis: Axis, experiments: Sequence[Experiment], errors: Sequence[FloatArray],
    seed: int,
) -> Iterator[tuple[FloatArray, float]]:  # fmt: skip
    """Moves of the estimate by random errors of the drive, and how much is left that wanders."""
    # logs of one bench are alike: what chance makes of some draws must not be the same for all
    drives = [np.asarray(e.signals[axis.drive].values) for e in experiments]
    rng = np.random.default_rng([seed, *(crc32(values.tobytes()) for values in drives)])
    model = DriveModel(experiments, axis)
    clean = model.compared_rows(fitted.values)
    jacobian = fitted.solution.jacobian
    while True:
        noisy = model.disturbed([e * rng.standard_normal(e.size) for e in errors])
        shifts = [a - b for a, b in zip(noisy.compared_rows(fitted.values), clean)]
        change = [shift - shift.mean() for shift in shifts]  # the offset of a run is free
        move = np.linalg.lstsq(np.vstack(jacobian), np.concatenate(change), rcond=1e-12)[0]
        yield move, sum(_wander(c - j @ move) for c, j in zip(change, jacobian))


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


def drive_notices(
    axis: Axis, experiments: Sequence[Experiment], fitted: Fitted | None, seed: int
) -> list[Notice]:
    """Warn of a drive that is taken for held and carries noise that did not act.

    A static level is then sought between values that never acted; the search cannot know by how
    much it is off. Noise of an encoder that a controller has made part of its command did act: of
    a fit of the position (``fitted``) the residual does not wander as without it.
    """
    drives = [e.signals[axis.drive] for e in experiments]
    noises = [_held_noise(s) for s in drives]
    noise = max(noises)
    if not noise:
        return []
    if fitted is not None and fitted.names:
        errors = [_errors(s, own) for s, own in zip(drives, noises)]
        draws = islice(_disturbances(fitted, axis, experiments, errors, seed), _FIRST)
        left = float(np.mean([wander for _, wander in draws]))
        if sum(map(_wander, fitted.solution.residuals)) < _ACTED * left:
            return []
    return [
        Notice(
            "command-noise",
            f"'{axis.drive}' is taken for held between samples, as a command is, but carries "
            f"noise of {noise:.2g} {drives[0].unit} rms: the static levels may be off by many of "
            f"their standard errors. Log the command, or give --hold {axis.drive}=smooth if it "
            "was measured.",
        )
    ]


def _errors(signal: Signal, noise: float) -> FloatArray:
    """Standard deviations of a drive at its nodes, lost rows included [SI]."""
    lost = find_lost_rows(signal)
    time = signal.time if lost is None else np.concatenate((signal.time, lost.time))
    errors = np.full(time.size, noise)
    if lost is not None:
        errors[signal.time.size :] = np.hypot(noise, lost.error)
    return errors[np.argsort(time, kind="stable")]


def _measured_noise(signal: Signal) -> float:
    """Standard deviation of the noise of a drive that was measured [SI]; 0 of a command."""
    return 0.0 if settled_hold(signal) == "zoh" else noise_floor(signal.values, _ORDER)


def _held_noise(signal: Signal) -> float:
    """Standard deviation of what is neither a curve nor a level that was commanded [SI]."""
    if settled_hold(signal) != "zoh":
        return 0.0
    span, noise = float(np.ptp(signal.values)), noise_floor(signal.values, _ORDER)
    return noise if _HELD_NOISE[0] * span < noise < _HELD_NOISE[1] * span else 0.0
