"""Trials of waveforms: simulated within the limits, scored by their information."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..estimation.information import cramer_rao
from ..experiment import FloatArray
from ..family import Information
from .task import Task, make_run
from .waveforms import Waveform, limit_slope, smooth_corners

RISE = 8  # samples in which a command that is not held crosses its range


@dataclass(frozen=True)
class Trial:
    """An excitation and the information in it; ``shape`` is the command between -1 and 1."""

    waveform: Waveform
    shape: FloatArray
    command: FloatArray
    output: FloatArray
    errors: FloatArray
    score: float


class Search:
    """Simulates waveforms within the limits and scores them."""

    def __init__(self, task: Task) -> None:
        self.task = task
        limits = task.limits
        self.time = limits.sample_time * np.arange(limits.count, dtype=np.float64)
        self.drifts = self._drifts()

    def try_out(self, waveform: Waveform) -> Trial:
        """Simulate a waveform; smaller until it stays within the stroke."""
        for _ in range(5):
            shape, command, output = self._balance(waveform)
            if self.is_within_stroke(output):
                errors = self._errors(command)
                score = self.task.score(errors)
                return Trial(waveform, shape, command, output, errors, score)
            moved = float(np.ptp(output))
            if not moved > 0.0:
                break  # it rests outside the stroke, and does so however small the shape is
            share = self.task.limits.travel / moved
            waveform = waveform.shrink(min(max(share, 0.4), 0.85))
        nothing = np.full(len(self.task.unknowns), np.inf)
        return Trial(waveform, shape, command, output, nothing, np.inf)

    def _drifts(self) -> bool:
        """Return whether a push displaces the output for good: its level is then free."""
        n = self.time.size
        push = np.zeros(n)
        push[n // 10 : n // 5] = 1.0
        for sign in (1.0, -1.0):
            y = self._simulate(self._to_command(sign * push))
            if abs(y[-1] - y[0]) > 0.05 * float(np.ptp(y)) > 0.0:
                return True
        return False

    def _balance(self, waveform: Waveform) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Shape, command [SI] and output [SI], shape ``(n,)`` each.

        Where the output drifts, the run ends within a tenth of the stroke of where it began,
        if that can be: a positive balance drives upwards.
        """
        limits, balance = self.task.limits, 0.0
        low, high = -0.95, 0.95
        free = limits.stroke is not None and self.drifts and not waveform.absolute
        for left in reversed(range(7 if free else 1)):
            shape = self._sample(waveform, balance)
            command = self._to_command(shape)
            output = self._simulate(command)
            drift = float(output[-1] - output[0])
            if not left or abs(drift) < 0.1 * limits.travel:
                break
            low, high = (low, balance) if drift > 0.0 else (balance, high)
            balance = 0.5 * (low + high)
        return shape, command, output

    def _sample(self, waveform: Waveform, balance: float) -> FloatArray:
        """Values between -1 and 1 after a short rest, shape ``(n,)``.

        A shape with a duty is balanced by how long each direction lasts, which costs no
        amplitude; any other by how strong it is.
        """
        n = self.time.size
        rest = 0 if waveform.pieces else min(max(n // 50, 2), 20)
        duty = float(np.exp(-2.0 * balance))
        played = waveform.sample(n - rest, self.task.limits.sample_time, duty)
        shape = np.concatenate((np.zeros(rest), played))
        if waveform.has_duty:
            return shape
        return np.where(shape > 0.0, min(1.0, 1.0 + balance), min(1.0, 1.0 - balance)) * shape

    def _to_command(self, shape: FloatArray) -> FloatArray:
        """Command of a shape [SI]."""
        limits, rest = self.task.limits, self.task.rest
        low, high = limits.amplitude
        u = rest + (high - rest) * np.maximum(shape, 0.0) + (rest - low) * np.minimum(shape, 0.0)
        most = None if limits.rate is None else limits.rate * limits.sample_time
        if self.task.drive.hold != "zoh":
            # The steepest point of a Hann window is twice its mean; one as long as the run is as
            # smooth as can be, and the slope is limited below.
            width = min(2.0 * float(np.ptp(u)) / most, u.size) if most else RISE
            u = smooth_corners(u, max(RISE, int(np.ceil(width))))
        return u if most is None else limit_slope(u, most)

    def _simulate(self, command: FloatArray) -> FloatArray:
        task = self.task
        run = make_run(task.drive, self.time, command)
        (found,) = task.family.simulate(task.plant, [run])
        return np.asarray(found.output, dtype=float)

    def _errors(self, command: FloatArray) -> FloatArray:
        """Predicted standard errors in the order of the task's unknowns, shape ``(p,)``."""
        task = self.task
        found = task.inform(make_run(task.drive, self.time, command))
        bread = cramer_rao(found.jacobian.T @ found.jacobian)
        variance = np.diag(bread) * task.sigma**2
        step = (task.document.fit.details or {}).get("output_resolution")
        if step and step >= task.sigma:
            variance = np.maximum(variance, _converter_variance(bread, found, step))
        spread = dict(zip(found.names, np.sqrt(np.maximum(variance, 0.0))))
        return np.array(
            [max(spread.get(n, 0.0), found.floor.get(n, 0.0)) or np.inf for n in task.names]
        )

    def is_within_stroke(self, output: FloatArray) -> bool:
        """Return whether an output, shape ``(n,)`` [SI], stays within the stroke."""
        limits = self.task.limits
        if limits.stroke is None:
            return True
        if self.drifts:
            return bool(np.ptp(output) <= limits.travel)
        # the file's range is that of noisy samples and of an offset that belongs to its log
        slack = 0.05 * limits.travel + 4.0 * self.task.sigma
        low, high = limits.stroke
        return bool(output.min() >= low - slack and output.max() <= high + slack)


def _converter_variance(bread: FloatArray, found: Information, step: float) -> FloatArray:
    """Variances by the error of a converter, which lasts as long as a reading, shape ``(p,)``.

    As in :func:`.estimation.uncertainty.covariance`: an axis at rest repeats the same error
    over and over again.
    """
    starts = np.flatnonzero(np.diff(np.floor(found.output / step), prepend=np.nan) != 0.0)
    sums = np.add.reduceat(found.jacobian, starts, axis=0)
    known = np.where(np.isfinite(bread), bread, 0.0)
    return np.diag(known @ (sums.T @ sums) @ known) * step**2 / 12.0
