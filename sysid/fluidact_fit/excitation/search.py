"""Trials of waveforms: simulated within the limits, scored by their information."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..estimation.information import cramer_rao
from ..experiment import FloatArray
from ..family import Information
from .task import Task
from .waveforms import Waveform, limit_slope, smooth_corners, to_segments

RISE = 8  # samples in which a command that is not held crosses its range
_PIECES = 40  # straight pieces that are shaped one by one


@dataclass(frozen=True)
class Trial:
    """An excitation and the information in it; a positive ``balance`` drives upwards."""

    waveform: Waveform
    command: FloatArray
    output: FloatArray
    errors: FloatArray
    score: float
    balance: float = 0.0


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
            command, balance = self._balance(waveform)
            output = self._simulate(command)
            if self._within(output):
                errors = self._errors(command)
                score = self.task.score(errors)
                return Trial(waveform, command, output, errors, score, balance)
            share = self.task.limits.travel / float(np.ptp(output))
            waveform = waveform.shrink(min(max(share, 0.4), 0.85))
        nothing = np.full(len(self.task.unknowns), np.inf)
        return Trial(waveform, command, output, nothing, np.inf)

    def straighten(self, trial: Trial) -> Waveform | None:
        """The straight pieces that a trial consists of; ``None`` if it does not.

        Neither do slow passages, whose levels hold for whatever the static level is.
        """
        if trial.waveform.absolute:
            return None
        return to_segments(self._sample(trial.waveform, trial.balance), _PIECES)

    def _drifts(self) -> bool:
        """Whether a push displaces the output for good: its level is then free."""
        n = self.time.size
        push = np.zeros(n)
        push[n // 10 : n // 5] = 1.0
        for sign in (1.0, -1.0):
            y = self._simulate(self._to_command(sign * push))
            if abs(y[-1] - y[0]) > 0.05 * float(np.ptp(y)) > 0.0:
                return True
        return False

    def _balance(self, waveform: Waveform) -> tuple[FloatArray, float]:
        """Command [SI] that ends where it began, within a tenth of the stroke, if that can be.

        Only where the output drifts; returned with the balance that it took.
        """
        limits, balance = self.task.limits, 0.0
        command = self._to_command(self._sample(waveform, balance))
        if limits.stroke is None or not self.drifts or waveform.absolute:
            return command, balance
        low, high = -0.95, 0.95
        for _ in range(6):
            y = self._simulate(command)
            drift = float(y[-1] - y[0])
            if abs(drift) < 0.1 * limits.travel:
                break
            low, high = (low, balance) if drift > 0.0 else (balance, high)
            balance = 0.5 * (low + high)
            command = self._to_command(self._sample(waveform, balance))
        return command, balance

    def _sample(self, waveform: Waveform, balance: float) -> FloatArray:
        """Values between -1 and 1 after a short rest, shape ``(n,)``.

        A shape with a duty is balanced by how long each direction lasts, which costs no
        amplitude; any other by how strong it is.
        """
        n = self.time.size
        rest = 0 if waveform.shape == "segments" else min(max(n // 50, 2), 20)
        duty = float(np.exp(-2.0 * balance))
        played = waveform.sample(n - rest, self.task.limits.sample_time, duty)
        shape = np.concatenate((np.zeros(rest), played))
        if waveform.has_duty:
            return shape
        return np.where(shape > 0.0, min(1.0, 1.0 + balance), min(1.0, 1.0 - balance)) * shape

    def _to_command(self, shape: FloatArray) -> FloatArray:
        """Command of a shape [SI]."""
        task = self.task
        low, high = task.limits.amplitude
        above, below = np.maximum(shape, 0.0), np.minimum(shape, 0.0)
        u = task.rest + (high - task.rest) * above + (task.rest - low) * below
        most = None if task.limits.rate is None else task.limits.rate * task.limits.sample_time
        if task.hold != "zoh":
            # the steepest point of a Hann window is twice its mean
            width = int(np.ceil(2.0 * float(np.ptp(u)) / most)) if most else RISE
            u = smooth_corners(u, max(RISE, width))
        return u if most is None else limit_slope(u, most)

    def _simulate(self, command: FloatArray) -> FloatArray:
        task = self.task
        run = task.run(self.time, command, task.hold)
        (found,) = task.family.simulate(task.variant, task.values, [run], task.options)
        return np.asarray(found.output, dtype=float)

    def _errors(self, command: FloatArray) -> FloatArray:
        """Predicted standard errors in the order of the task's unknowns, shape ``(p,)``."""
        task = self.task
        found = task.inform(task.run(self.time, command, task.hold), task.options)
        bread = cramer_rao(found.jacobian.T @ found.jacobian)
        variance = np.diag(bread) * task.sigma**2
        step = (task.document.fit.details or {}).get("output_resolution")
        if step and step >= task.sigma:
            variance = np.maximum(variance, _converter_variance(bread, found, step))
        spread = dict(zip(found.names, np.sqrt(np.maximum(variance, 0.0))))
        return np.array(
            [max(spread.get(n, 0.0), found.floor.get(n, 0.0)) or np.inf for n in task.names]
        )

    def _within(self, output: FloatArray) -> bool:
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
