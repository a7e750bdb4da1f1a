"""Trials of waveforms: simulated within the limits, scored by their information."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..estimation.information import cramer_rao
from ..experiment import Experiment, FloatArray, Signal
from ..family import Information
from .task import Task, score_of
from .waveforms import Waveform, limit_slope, smooth_corners, to_segments

RISE = 8  # samples in which a command that is not held crosses its range
_PIECES = 40  # straight pieces that are shaped one by one


@dataclass(frozen=True)
class Trial:
    """An excitation and the information in it."""

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

    def _drifts(self) -> bool:
        """Whether a push displaces the output for good: its level is then free."""
        n = self.time.size
        push = np.zeros(n)
        push[n // 10 : n // 5] = 1.0
        for sign in (1.0, -1.0):
            y = self._simulate(self._to_command(sign * push, 0.0))
            if abs(y[-1] - y[0]) > 0.05 * float(np.ptp(y)) > 0.0:
                return True
        return False

    def _to_command(self, shape: FloatArray, balance: float) -> FloatArray:
        """Command of a shape [SI]; ``balance`` weakens one direction against the other."""
        task = self.task
        low, high = task.limits.amplitude
        up, down = min(1.0, 1.0 + balance), min(1.0, 1.0 - balance)
        above, below = up * np.maximum(shape, 0.0), down * np.minimum(shape, 0.0)
        u = task.rest + (high - task.rest) * above + (task.rest - low) * below
        rate = task.limits.rate
        if task.hold != "zoh":
            u = smooth_corners(u, self._corner_width(float(np.ptp(u)), rate))
        if rate is not None:
            u = limit_slope(u, rate * task.limits.sample_time)
        return np.asarray(u)

    def _corner_width(self, span: float, rate: float | None) -> int:
        """Samples over which a jump is spread, of a command that is not held."""
        if not rate:
            return RISE
        # the steepest point of a Hann window is twice its mean
        return max(RISE, int(np.ceil(2.0 * span / (rate * self.task.limits.sample_time))))

    def _run(self, command: FloatArray) -> Experiment:
        name, step = self.task.drive.name, self.task.limits.sample_time
        before = float(command[0])
        signal = Signal(name, self.time, command, self.task.unit, self.task.hold, before)
        return Experiment("design", 0, self.time, {name: signal}, step, True)

    def _simulate(self, command: FloatArray) -> FloatArray:
        task = self.task
        run = self._run(command)
        (found,) = task.family.simulate(task.variant, task.values, [run], task.options)
        return np.asarray(found.output, dtype=float)

    def _inform(self, command: FloatArray) -> Information:
        task = self.task
        run = self._run(command)
        found = task.family.information(task.variant, task.values, run, task.options)
        assert found is not None, f"{task.family.name} has a command but no information"
        return found

    def errors(self, found: Information) -> FloatArray:
        """Predicted standard errors in the order of the task's unknowns, shape ``(p,)``."""
        names = [u.name for u in self.task.unknowns]
        used = [n for n in names if n in found.names]
        jacobian = found.jacobian[:, [found.names.index(n) for n in used]]
        bread = cramer_rao(jacobian.T @ jacobian)
        variance = np.diag(bread) * self.task.sigma**2
        step = (self.task.document.fit.details or {}).get("output_resolution")
        if step and step >= self.task.sigma:
            variance = np.maximum(variance, _converter_variance(bread, jacobian, found, step))
        spread = dict(zip(used, np.sqrt(np.maximum(variance, 0.0))))
        return np.array([max(spread.get(n, 0.0), found.floor.get(n, 0.0)) or np.inf for n in names])

    def try_out(self, waveform: Waveform) -> Trial:
        """Simulate a waveform; smaller until it stays within the stroke."""
        for _ in range(5):
            absolute = waveform.shape == "approach"  # its levels are what matters
            drifts = self.drifts and not absolute
            command, balance = self._balanced(waveform) if drifts else self._command(waveform, 0.0)
            output = self._simulate(command)
            if self._within(output):
                errors = self.errors(self._inform(command))
                return Trial(
                    waveform, command, output, errors, score_of(self.task, errors), balance
                )
            stroke = self.task.limits.stroke
            if stroke is None:
                break
            share = min(max((stroke[1] - stroke[0]) / float(np.ptp(output)), 0.4), 0.85)
            if absolute and waveform.then is not None:
                then = replace(waveform.then, size=share * waveform.then.size)
                waveform = replace(waveform, then=then)
            else:
                waveform = replace(waveform, size=share * waveform.size)
        nothing = np.full(len(self.task.unknowns), np.inf)
        return Trial(waveform, command, output, nothing, np.inf)

    def straighten(self, trial: Trial) -> Waveform | None:
        """The straight pieces that a trial consists of; ``None`` if it does not.

        Neither do slow passages, whose levels hold for whatever the static level is.
        """
        if trial.waveform.shape == "approach":
            return None
        shape, weaken = self._shape(trial.waveform, trial.balance)
        up, down = min(1.0, 1.0 + weaken), min(1.0, 1.0 - weaken)
        return to_segments(np.where(shape > 0.0, up, down) * shape, _PIECES)

    def _shape(self, waveform: Waveform, balance: float) -> tuple[FloatArray, float]:
        """Values between -1 and 1 after a short rest, and the balance that is left to make.

        A shape with a duty is balanced by how long each direction lasts, which costs no
        amplitude; any other by how strong it is.
        """
        turned = waveform.lengthen(float(np.exp(-2.0 * balance)))
        n = self.time.size
        rest = 0 if waveform.shape == "segments" else min(max(n // 50, 2), 20)
        shape = turned.sample(n - rest, self.task.limits.sample_time)
        return np.concatenate((np.zeros(rest), shape)), 0.0 if turned != waveform else balance

    def _command(self, waveform: Waveform, balance: float) -> tuple[FloatArray, float]:
        """Command [SI] and its ``balance``; a positive one drives upwards."""
        return self._to_command(*self._shape(waveform, balance)), balance

    def _balanced(self, waveform: Waveform) -> tuple[FloatArray, float]:
        """Command that ends where it began, within a tenth of the stroke, if that can be."""
        stroke = self.task.limits.stroke
        command, _ = self._command(waveform, 0.0)
        if stroke is None:
            return command, 0.0
        low, high, balance = -0.95, 0.95, 0.0
        for _ in range(6):
            y = self._simulate(command)
            drift = float(y[-1] - y[0])
            if abs(drift) < 0.1 * (stroke[1] - stroke[0]):
                break
            low, high = (low, balance) if drift > 0.0 else (balance, high)
            balance = 0.5 * (low + high)
            command, _ = self._command(waveform, balance)
        return command, balance

    def _within(self, output: FloatArray) -> bool:
        stroke = self.task.limits.stroke
        if stroke is None:
            return True
        if self.drifts:
            return bool(np.ptp(output) <= stroke[1] - stroke[0])
        # the file's range is that of noisy samples and of an offset that belongs to its log
        slack = 0.05 * (stroke[1] - stroke[0]) + 4.0 * self.task.sigma
        return bool(output.min() >= stroke[0] - slack and output.max() <= stroke[1] + slack)


def _converter_variance(
    bread: FloatArray, jacobian: FloatArray, found: Information, step: float
) -> FloatArray:
    """Variances by the error of a converter, which lasts as long as a reading, shape ``(p,)``.

    As in :func:`.estimation.uncertainty.covariance`: an axis at rest repeats the same error
    over and over again.
    """
    starts = np.flatnonzero(np.diff(np.floor(found.output / step), prepend=np.nan) != 0.0)
    sums = np.add.reduceat(jacobian, starts, axis=0)
    known = np.where(np.isfinite(bread), bread, 0.0)
    return np.diag(known @ (sums.T @ sums) @ known) * step**2 / 12.0
