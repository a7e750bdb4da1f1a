"""Simulation of pressures and motion over a log, with sensitivities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...estimation.budget import simulated
from ...estimation.inputs import piecewise
from ...estimation.named_model import Values
from ...estimation.stribeck import EXPONENT
from ...experiment import Experiment, FloatArray
from ...mechanics.coupled import InPlace, motion
from ...mechanics.hydraulic_cylinder import SYSTEM, THETA, Machine, parameter_vector
from ...signals import smooth

CHANNELS = ("pressure_1", "pressure_2", "position")
SLOPES = THETA[: THETA.index(EXPONENT)]  # parameters by which the states are differentiated
_LONGEST = 5e-4  # s: Runge-Kutta step
_FALL = 0.5  # growth of a speed over a step where friction falls with it
_ANGLE = 0.3  # rad of the pressure resonance that a step may turn
_STIFF = 1e9  # Pa: bulk modulus of the resonance that the steps are made for
_MOST_STEPS = 16  # per sample
_SEGMENT = 50  # samples that are integrated in one call


@dataclass(frozen=True)
class GrayLog:
    """One experiment as the gray box sees it.

    ``command`` [V] and ``step`` [s] have shape ``(n - 1,)``. ``measured`` holds the channels,
    ``(3, n)``, zeros where one was not recorded, and ``codes`` the steps of their converters, 0
    where unknown. ``guess`` holds all four states from smoothed signals, ``(n, 4)``.
    """

    command: FloatArray
    step: FloatArray
    measured: FloatArray
    guess: FloatArray
    codes: Sequence[float] = (0.0, 0.0, 0.0)

    @property
    def samples(self) -> int:
        """Number of samples."""
        return int(self.guess.shape[0])

    def pieces(self, length: int) -> list[GrayLog]:
        """Return four pieces of so many samples from all over the log, or it itself."""
        if 4 * length >= self.samples:
            return [self]
        out = []
        for k in np.linspace(0, self.samples - length, 4).astype(int).tolist():
            held, at = slice(k, k + length - 1), slice(k, k + length)
            out.append(GrayLog(self.command[held], self.step[held], self.measured[:, at],
                               self.guess[at], self.codes))  # fmt: skip
        return out


def make_gray_log(e: Experiment, machine: Machine) -> GrayLog:
    """Prepare one experiment: measured channels and a first guess of all four states."""
    half = max(2, round(0.006 / e.sample_time))
    motion = smooth(e["position"], e.sample_time, 2 * half, 3)
    measured, guess = np.zeros((3, e.samples)), np.zeros((e.samples, 4))
    guess[:, 2], guess[:, 3] = motion.value, motion.rate
    codes = [0.0, 0.0, 0.0]
    for k, role in enumerate(CHANNELS):
        if role in e:
            measured[k], codes[k] = e.sampled(role), e.signals[role].resolution
            if k < 2:
                guess[:, k] = smooth(measured[k], e.sample_time, max(1, half // 2), 2).value
    inertia = (machine.mass or 0.0) * motion.curvature
    if CHANNELS[0] not in e and CHANNELS[1] not in e:
        guess[:, 0] = machine.at_rest(0.0)[0]
    if CHANNELS[1] not in e:
        guess[:, 1] = (guess[:, 0] * machine.area(1) - inertia) / machine.area(2)
    elif CHANNELS[0] not in e:
        guess[:, 0] = (guess[:, 1] * machine.area(2) + inertia) / machine.area(1)
    guess[:, :2] = np.clip(guess[:, :2], machine.tank, machine.supply)
    return GrayLog(mean_command(e), np.diff(e.time), measured, guess, codes)


def mean_command(e: Experiment) -> FloatArray:
    """Command over every interval between samples, ``(n - 1,)`` [V].

    Held between its samples it is the command itself. One that acts late or moves between them
    counts by its mean: the valve's flow is proportional to it, and the oil integrates the flow.
    """
    signal = e.signals["command"]
    if signal.hold in (None, "zoh") and np.array_equal(signal.time, e.time):
        return e.sampled("command")[:-1]
    from scipy.interpolate import PPoly

    u = piecewise(signal, level=signal.before)
    knots = np.append(u.nodes, max(u.nodes[-1], e.time[-1]) + 1.0)
    total = PPoly(np.real(u.coefficients[:, ::-1].T), knots).antiderivative()
    # what is left of the level is zero before the first node
    return np.asarray(
        signal.before + np.diff(total(np.maximum(e.time, knots[0]))) / np.diff(e.time)
    )


@dataclass(frozen=True)
class GrayBox:
    """A machine, followed in so many Runge-Kutta steps per sample."""

    machine: Machine
    steps: int

    @classmethod
    def following(
        cls, logs: Sequence[GrayLog], machine: Machine, viscous: float, fall: float
    ) -> GrayBox:
        """With steps that follow the logs.

        ``viscous`` is the friction to be expected and ``fall`` how steeply friction falls with the
        speed at most, both [N s/m].
        """
        step = max(float(np.max(log.step)) for log in logs)
        mass, middle = machine.mass or 1.0, np.mean([log.guess[:, 2].mean() for log in logs])
        stiffness = _STIFF * sum(
            machine.area(i) ** 2 / float(machine.volume(i, middle)) for i in (1, 2)
        )
        # Runge-Kutta of order 4 is stable up to 2.78 / h and exact enough below 0.3 / omega
        rates = viscous / mass / 2.0, fall / mass / _FALL, np.sqrt(stiffness / mass) / _ANGLE
        needed = step * max(1.0 / _LONGEST, *rates)
        return cls(machine, int(np.clip(np.ceil(needed - 1e-9), 1, _MOST_STEPS)))

    def simulate(self, log: GrayLog, initial: FloatArray, values: Values) -> FloatArray:
        """States at every sample, ``(n, 4)``, from the initial one [Pa, Pa, m, m/s]."""
        return self._run(log, initial, values, None)[:, 0]

    def slopes(self, log: GrayLog, initial: FloatArray, values: Values) -> FloatArray:
        """Derivatives of the states by the initial one and :data:`SLOPES`, ``(n, 4, 4 + q)``."""
        free = tuple(range(len(SLOPES)))
        return np.swapaxes(self._run(log, initial, values, free)[:, 1:], 1, 2)

    def _run(
        self, log: GrayLog, initial: FloatArray, values: Values, free: tuple[int, ...] | None
    ) -> FloatArray:
        """States and, column after column, their derivatives, ``(n, 1 + columns, 4)``."""
        columns = 0 if free is None else 4 + len(free)
        simulated(log.samples, 1 + columns)
        run = InPlace(motion(SYSTEM, _SEGMENT, self.steps, free))
        state, held, theta = run.arguments
        theta[:] = parameter_vector(values, self.machine)[:, None]
        missing = -log.command.size % _SEGMENT  # the last segment is filled up
        inputs = np.pad((log.command, log.step), ((0, 0), (0, missing)), mode="edge")
        out = np.empty((inputs.shape[1] + 1, 4 * (1 + columns)))
        out[0] = np.concatenate((initial, np.eye(columns, 4).ravel()))
        for first in range(0, inputs.shape[1], _SEGMENT):
            after = first + _SEGMENT
            state[:, 0], held[:] = out[first], inputs[:, first:after]
            out[first + 1 : after + 1] = run().T
        return out[: log.samples].reshape(-1, 1 + columns, 4)
