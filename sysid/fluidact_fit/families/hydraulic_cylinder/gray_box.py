"""Simulation of all four states with sensitivities, log by log and segment by segment.

:mod:`.stick_slip` has the equations and what happens within a sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np

from ...estimation.inputs import piecewise
from ...estimation.named_model import Values
from ...estimation.price import simulated
from ...experiment import Experiment, FloatArray
from ...signals import smooth
from .equations import EDGES, THETA, Machine, gray_values
from .stick_slip import InPlace, segment_function

CHANNELS = ("pressure_1", "pressure_2", "position")
_STEP = 5e-4  # s: longest Runge-Kutta step
_FALL = 0.5  # growth of a speed over a step where friction falls with it
_ANGLE = 0.3  # rad of the pressure resonance that a step may turn
# rad that the piston on the oil of one chamber may turn in a step; it was followed at 1.5, and ran
# away at 1.8
_FOLLOWED = 1.7
_STIFF = 1e9  # Pa: bulk modulus of the resonance that the steps are made for
_MOST_STEPS = 16  # per sample
_PIECES = 4  # from all over a log, beside its liveliest part


@dataclass(frozen=True)
class GrayLog:
    """One experiment as the gray box sees it.

    ``command`` and ``step`` have shape ``(n - 1,)``; ``channels`` holds the measured states
    (0: p1, 1: p2, 2: y) and ``measured`` their values, ``(len(channels), n)``. ``guess`` holds
    all four states from smoothed signals, ``(n, 4)``.
    """

    command: FloatArray
    step: FloatArray
    channels: tuple[int, ...]
    measured: FloatArray
    guess: FloatArray

    @property
    def samples(self) -> int:
        """Number of samples."""
        return int(self.guess.shape[0])

    def liveliest(self, samples: int) -> GrayLog:
        """So many samples in a row in which the piston moves most; all where there are no more."""
        if self.samples <= samples:
            return self
        way = np.append(0.0, np.cumsum(np.abs(np.diff(self.guess[:, 2]))))
        return self._cut(
            int(np.argmax(way[samples - 1 :] - way[: way.size - samples + 1])), samples
        )

    def telling(self, samples: int) -> list[GrayLog]:
        """Parts of so many samples in all: the liveliest, and pieces from all over the log.

        What shows at low speed or in other strokes need not show where the piston moves most.
        """
        if self.samples <= samples:
            return [self]
        piece = samples // (2 * _PIECES)
        begins = np.linspace(0, self.samples - piece, _PIECES).astype(int).tolist()
        return [self.liveliest(samples // 2), *(self._cut(first, piece) for first in begins)]

    def _cut(self, first: int, samples: int) -> GrayLog:
        after = first + samples
        return GrayLog(
            self.command[first : after - 1], self.step[first : after - 1], self.channels,
            self.measured[:, first:after], self.guess[first:after],
        )  # fmt: skip


def make_gray_log(e: Experiment, machine: Machine) -> GrayLog:
    """Prepare one experiment: measured channels and a first guess of all four states."""
    half = max(2, round(0.006 / e.sample_time))
    motion = smooth(e["position"], e.sample_time, 2 * half, 3)
    guess = np.zeros((e.samples, 4))
    guess[:, 2], guess[:, 3] = motion.value, motion.rate
    channels = tuple(k for k, role in enumerate(CHANNELS) if role in e)
    for k in channels[:-1]:
        guess[:, k] = smooth(e.sampled(CHANNELS[k]), e.sample_time, max(1, half // 2), 2).value
    inertia = (machine.mass or 0.0) * motion.curvature
    if channels == (2,):
        guess[:, 0] = machine.at_rest(0.0)[0]
    if 1 not in channels:
        guess[:, 1] = (guess[:, 0] * machine.area(1) - inertia) / machine.area(2)
    elif 0 not in channels:
        guess[:, 0] = (guess[:, 1] * machine.area(2) + inertia) / machine.area(1)
    guess[:, :2] = np.clip(guess[:, :2], machine.tank, machine.supply)
    measured = np.array([e.sampled(CHANNELS[k]) for k in channels])
    return GrayLog(mean_command(e), np.diff(e.time), channels, measured, guess)


def mean_command(e: Experiment) -> FloatArray:
    """Command over every interval between samples, ``(n - 1,)`` [V].

    Held between its samples it is the command itself. One that acts late or moves between them
    counts by its mean: the valve's flow is proportional to it, and the oil integrates the flow.
    """
    signal = e.signals["command"]
    if signal.hold in (None, "zoh") and np.array_equal(signal.time, e.time):
        return e.sampled("command")[:-1]
    u = piecewise(signal, level=signal.before)
    pieces = np.clip(np.searchsorted(u.nodes, e.time, side="right") - 1, 0, None)
    power = np.arange(1, u.coefficients.shape[1] + 1)
    whole = np.sum(u.coefficients[:-1] * np.diff(u.nodes)[:, None] ** power / power, axis=1)
    since = np.maximum(e.time - u.nodes[pieces], 0.0)
    part = np.sum(u.coefficients[pieces] * since[:, None] ** power / power, axis=1)
    total = np.append(0.0, np.cumsum(whole))[pieces] + part
    return np.asarray(signal.before + np.diff(total) / np.diff(e.time))


@dataclass(frozen=True)
class Linear:
    """States ``value + slope [d, 1]`` for a change ``d`` of initial state and parameters.

    The last column closes the gaps between the segments. ``chain`` says the same of the nodes;
    ``defects`` are the gaps between the end of a segment and the next node.
    """

    value: FloatArray
    slope: FloatArray
    chain: FloatArray
    defects: FloatArray


class GrayBox:
    """Simulation and sensitivities of several logs, in segments of so many samples.

    The viscous friction to be expected, the steepest ``fall`` of friction with the speed, both
    [N s/m], and the pressure resonance set the number of Runge-Kutta steps per sample.
    """

    def __init__(
        self, logs: Sequence[GrayLog], machine: Machine, viscous: float, segment: int = 50,
        fall: float = 0.0,
    ) -> None:  # fmt: skip
        self.logs, self.machine = list(logs), machine
        self.segment = min(segment, *(log.samples - 1 for log in logs))
        step = self._sample_time
        mass, middle = machine.mass or 1.0, np.mean([log.guess[:, 2].mean() for log in logs])
        stiffness = _STIFF * sum(
            machine.area(i) ** 2 / float(machine.volume(i, middle)) for i in (1, 2)
        )
        # Runge-Kutta of order 4 is stable up to 2.78 / h and exact enough below 0.3 / omega
        rates = viscous / mass / 2.0, fall / mass / _FALL, np.sqrt(stiffness / mass) / _ANGLE
        needed = step * max(1.0 / _STEP, *rates)
        self.steps = int(np.clip(np.ceil(needed - 1e-9), 1, _MOST_STEPS))

    @property
    def _sample_time(self) -> float:
        """Longest interval between samples [s]."""
        return max(float(np.max(log.step)) for log in self.logs)

    def least_volume(self, chamber: int, values: Values) -> float:
        """Volume [m3] of a chamber whose oil is so stiff that no step follows the piston on it."""
        step = self._sample_time / self.steps
        stiffness = values["bulk_modulus"] * self.machine.area(chamber) ** 2
        return float(stiffness * (step / _FOLLOWED) ** 2 / (self.machine.mass or 1.0))

    def _inputs(self, log: GrayLog) -> FloatArray:
        """Command and step of every sample, the last segment filled up, ``(2, m)``."""
        missing = -log.command.size % self.segment
        return np.pad((log.command, log.step), ((0, 0), (0, missing)), mode="edge")

    def integrate(
        self, log: GrayLog, nodes: FloatArray, values: Values, free: Sequence[str]
    ) -> tuple[FloatArray, FloatArray]:
        """States ``(segments, segment, 4)`` after every sample, from nodes ``(segments, 4)``.

        Beside them their derivatives by the node's state and the free parameters,
        ``(segments, segment, 4, 4 + free)``. ``values`` holds all parameters.
        """
        count, length, columns = nodes.shape[0], self.segment, 4 + len(free)
        simulated(log.samples, 1 + columns)
        run = InPlace(segment_function(self.machine, length, self.steps, tuple(free), count))
        begin, inputs, theta = run.arguments
        begin[:4], begin[4:] = nodes.T, np.eye(columns, 4).reshape(-1, 1)
        inputs[:], theta[:] = self._inputs(log), _theta(values)
        out = run().T.reshape(count, length, 1 + columns, 4)
        return out[:, :, 0], np.swapaxes(out[:, :, 1:], 2, 3)

    def simulate(self, log: GrayLog, initial: FloatArray, values: Values) -> FloatArray:
        """States at every sample, ``(n, 4)``, from the initial one [Pa, Pa, m, m/s]."""
        simulated(log.samples)
        run = InPlace(segment_function(self.machine, self.segment, self.steps, None))
        begin, held, theta = run.arguments
        theta[:] = _theta(values)
        inputs = self._inputs(log)
        states = np.empty((inputs.shape[1] + 1, 4))
        states[0] = initial
        for first in range(0, inputs.shape[1], self.segment):
            after = first + self.segment
            begin[:, 0], held[:] = states[first], inputs[:, first:after]
            states[first + 1 : after + 1] = run().T
        return states[: log.samples]

    def per_sample(
        self, log: GrayLog, states: FloatArray, values: Values
    ) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the state after every sample of a simulation, ``(n, 4)``.

        By the state before the sample, ``(n - 1, 4, 4)``, and by the command over it,
        ``(n - 1, 4)``.
        """
        single = copy(self)
        single.segment = 1
        slopes = single.integrate(log, states[:-1], values, EDGES)[1][:, 0]
        # a command further up is both edges of the dead zone further down
        return slopes[:, :, :4], -slopes[:, :, 4:].sum(axis=2)

    def nodes_of(self, states: FloatArray) -> FloatArray:
        """States at the beginning of every segment, ``(segments, 4)``."""
        return states[: -1 : self.segment].copy()

    def linearise(
        self, log: GrayLog, nodes: FloatArray, values: Values, free: Sequence[str]
    ) -> Linear:
        """Condense one log: states as an affine function of initial state and parameters."""
        states, slopes = self.integrate(log, nodes, values, free)
        (count, length), q = states.shape[:2], 4 + len(free)
        slope, chain = np.empty((count * length + 1, 4, q + 1)), np.empty((count, 4, q + 1))
        defects = np.zeros((count, 4))
        defects[:-1] = states[:-1, -1] - nodes[1:]
        now = np.eye(4, q + 1)  # by initial state and parameters, and the gaps in the last column
        slope[0] = now
        for k in range(count):
            chain[k] = now
            rows = slope[k * length + 1 : (k + 1) * length + 1]
            rows[:] = slopes[k, :, :, :4] @ now
            rows[:, :, 4:q] += slopes[k, :, :, 4:]
            now = rows[-1].copy()
            now[:, q] += defects[k]
        value = np.vstack((nodes[:1], states.reshape(-1, 4)))
        return Linear(value[: log.samples], slope[: log.samples], chain, defects)


def _theta(values: Values) -> FloatArray:
    numbers = gray_values(values)
    if numbers["stribeck_speed"] <= 0.0:  # no rise, whatever its speed
        numbers |= {"stribeck": 0.0, "stribeck_speed": 1.0}
    return np.array([[numbers[n]] for n in THETA])
