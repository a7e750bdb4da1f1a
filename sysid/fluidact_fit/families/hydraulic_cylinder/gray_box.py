"""Output error of pressures and position: simulation, sensitivities, and the search for a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...estimation.budget import simulated
from ...estimation.converter_errors import codes_matter, noise_beside
from ...estimation.least_squares import orthonormal, without
from ...estimation.minimise import Minimum, minimise
from ...estimation.named_model import Values
from ...estimation.noise import noise_floor
from ...estimation.problem import Unknown, bounds_of
from ...estimation.stribeck import EXPONENT
from ...estimation.uncertainty import (
    Uncertainty,
    enlarge,
    inverse_information,
    score_covariance,
    with_codes,
)
from ...experiment import Experiment, FloatArray
from ...mechanics.coupled import InPlace, motion
from ...mechanics.hydraulic_cylinder import SYSTEM, THETA, HydraulicMachine, parameter_vector
from ...signals import smooth
from .windows import mean_command

CHANNELS = ("pressure_1", "pressure_2", "position")
SLOPES = THETA[: THETA.index(EXPONENT)]  # parameters by which the states are differentiated
_LONGEST = 5e-4  # s: Runge-Kutta step
_A_PERIOD = 21.0  # steps in one of the pressure resonance: a step turns it by 0.3 rad
_STIFF = 1e9  # Pa: bulk modulus of the resonance that the steps are made for
_MOST_STEPS = 16  # per sample
_SEGMENT = 50  # samples that are integrated in one call
_TOLERANCE = 1e-2  # standard errors
_ASTRAY = 1e12  # residuals in standard deviations beyond which a simulation has run away
_DRAWS = 16  # of noise on a command
_SEEN = 0.5  # share of the noise that the machine did not see: certainly less, and it saw it
_SURE = 3.0  # standard errors
_SPAN = 5  # samples of the median that takes the noise off a command


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


def make_gray_log(e: Experiment, machine: HydraulicMachine) -> GrayLog:
    """Prepare one experiment: measured channels and a first guess of all four states."""
    half = max(2, round(0.006 / e.sample_time))
    motion = smooth(e["position"], e.sample_time, 2 * half, 3)
    measured, guess = np.zeros((3, e.samples)), np.zeros((e.samples, 4))
    guess[:, :2], guess[:, 2], guess[:, 3] = machine.at_rest(0.0)[:2], motion.value, motion.rate
    codes = [0.0, 0.0, 0.0]
    for k, role in enumerate(CHANNELS):
        if role in e:
            measured[k], codes[k] = e.sampled(role), e.signals[role].resolution
            if k < 2:
                guess[:, k] = smooth(measured[k], e.sample_time, max(1, half // 2), 2).value
    guess[:, :2] = np.clip(guess[:, :2], machine.tank, machine.supply)
    return GrayLog(mean_command(e), np.diff(e.time), measured, guess, codes)


@dataclass(frozen=True)
class GrayBox:
    """A machine, followed in so many Runge-Kutta steps per sample."""

    machine: HydraulicMachine
    steps: int

    @classmethod
    def following(
        cls, logs: Sequence[GrayLog], machine: HydraulicMachine, values: Values
    ) -> GrayBox:
        """With steps that follow the logs, under the friction that ``values`` have."""
        middle = float(np.mean([log.guess[:, 2].mean() for log in logs]))
        values = {**values, "bulk_modulus": _STIFF}
        rate = max(1.0 / _LONGEST, machine.step_rate(values, middle, _A_PERIOD))
        needed = max(float(np.max(log.step)) for log in logs) * rate
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


@dataclass(frozen=True)
class GrayPoint:
    """All logs simulated with some parameters from some initial states.

    ``sigma`` holds the standard deviation of the residuals of p1, p2 and y [Pa, Pa, m], infinite
    where a channel does not count. ``values`` holds all parameters [SI], ``initial`` the state of
    every log at its beginning. ``free`` are the parameters that a search may change. Rows of a log
    are its channels, one after the other, each divided by its ``sigma``.
    """

    box: GrayBox
    logs: Sequence[GrayLog]
    sigma: FloatArray
    values: Values
    initial: Sequence[FloatArray]
    free: Sequence[Unknown] = ()

    @classmethod
    def of(
        cls, box: GrayBox, logs: Sequence[GrayLog], sigma: FloatArray, values: Values
    ) -> GrayPoint:
        """Begin where the measured signals do."""
        return cls(box, logs, sigma, values, [log.guess[0] for log in logs])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters."""
        return tuple(u.name for u in self.free)

    @property
    def rows(self) -> int:
        """Number of residuals that count."""
        return int(np.isfinite(self.sigma).sum()) * sum(log.samples for log in self.logs)

    @cached_property
    def states(self) -> list[FloatArray]:
        """p1, p2, y and v of every log, ``(n, 4)`` each [Pa, Pa, m, m/s]."""
        pairs = zip(self.logs, self.initial)
        return [self.box.simulate(log, x, self.values) for log, x in pairs]

    @cached_property
    @np.errstate(all="ignore")  # of a simulation that has run away
    def residuals(self) -> list[FloatArray]:
        """Weighted residuals of every log, ``(3 n,)`` each."""
        pairs = zip(self.logs, self.states)
        return [self._weighted(log.measured - states.T[:3]) for log, states in pairs]

    def _weighted(self, channels: FloatArray) -> FloatArray:
        return (channels / self.sigma[:, None]).ravel()

    @cached_property
    def spread(self) -> FloatArray:
        """Root mean square of the weighted residuals of each channel over all logs, ``(3,)``."""
        rows = np.hstack([r.reshape(3, -1) for r in self.residuals])
        return np.sqrt(np.mean(rows**2, axis=1))

    @cached_property
    @np.errstate(all="ignore")
    def cost(self) -> float:
        """Sum of the squared weighted residuals, infinite where a simulation has run away."""
        cost = sum(float(r @ r) for r in self.residuals)
        return cost if cost < _ASTRAY**2 * self.rows else np.inf

    @cached_property
    def slopes(self) -> list[FloatArray]:
        """Derivatives of the rows by initial state and free parameters, ``(3 n, 4 + p)`` each."""
        columns = [0, 1, 2, 3, *(4 + SLOPES.index(n) for n in self.names)]
        found = (self.box.slopes(log, x, self.values) for log, x in zip(self.logs, self.initial))
        return [np.vstack([j[:, c, columns] / s for c, s in enumerate(self.sigma)]) for j in found]

    @cached_property
    def start_basis(self) -> list[FloatArray]:
        """Orthonormal basis of the effect of the initial state of every log on its rows.

        A piston that sticks forgets the speed that it was said to begin with.
        """
        return [orthonormal(j[:, :4]) for j in self.slopes]

    @cached_property
    def jacobian(self) -> list[FloatArray]:
        """Slopes by the free parameters, initial states projected out, ``(3 n, p)`` each."""
        return [without(q, j[:, 4:]) for q, j in zip(self.start_basis, self.slopes)]

    def change(
        self, k: int, command: FloatArray, box: GrayBox | None = None, values: Values | None = None
    ) -> FloatArray:
        """Change of the rows of a log by its command or more, less what its start explains."""
        log = replace(self.logs[k], command=command)
        moved = (box or self.box).simulate(log, self.initial[k], values or self.values)
        return without(self.start_basis[k], self._weighted((moved - self.states[k]).T[:3]))

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """Covariance of the free parameters; the channels of a log share their errors.

        No variance is less than that of white residuals: what a few hundred instants show of
        their errors is less than there was, because the fit went after them. Errors of a converter
        are added where they matter: a piston at rest is read with one error all the time, which
        the scores of two logs hardly show.
        """
        channels = [[slice(k * n, (k + 1) * n) for k in range(3)]
                    for n in (log.samples for log in self.logs)]  # fmt: skip
        by_scores = score_covariance(self.jacobian, self.residuals, channels)
        total = enlarge(by_scores.covariance, np.diag(self.bread) * self.cost / self.rows)
        for k, sigma in enumerate(self.sigma):
            jacobian = [j[part[k]] for j, part in zip(self.jacobian, channels)]
            residuals = [r[part[k]] for r, part in zip(self.residuals, channels)]
            readings = [(log.measured[k] / sigma, log.codes[k] / sigma) for log in self.logs]
            if codes_matter(jacobian, readings, self.bread, total, self.spread[k]):
                noise = noise_beside(readings, self.spread[k])
                total = with_codes(total, jacobian, residuals, readings, self.bread, noise)
        return replace(by_scores, covariance=total)

    @cached_property
    def bread(self) -> FloatArray:
        """``inv(J'J)`` of the free parameters, ``(p, p)``."""
        return inverse_information(np.vstack(self.jacobian))[0]


def solve_gray_box(begin: GrayPoint, *, max_iterations: int = 40) -> Minimum[GrayPoint]:
    """Minimise the weighted output error over free parameters and initial states.

    Noise of the pressures may let a piston slip that sticks, which no small step of the search
    undoes. Rest is therefore tried as well, at first and at the end.

    Raises
    ------
    LinAlgError
        Where no simulation follows the logs.
    """
    best = _descend(min((begin, _rested(begin)), key=lambda s: s.cost), max_iterations)
    if not np.isfinite(best.point.cost):
        raise np.linalg.LinAlgError("the simulation leaves every measured range")
    rested = _rested(best.point)
    if any(a[3] != b[3] for a, b in zip(rested.initial, best.point.initial)):
        other = _descend(rested, max_iterations)
        other = replace(other, iterations=best.iterations + other.iterations)
        best = min((best, other), key=lambda m: m.point.cost)
    return best


def _descend(begin: GrayPoint, max_iterations: int) -> Minimum[GrayPoint]:
    """Go to the minimum; unknowns are the free parameters and the initial states."""
    names, p = begin.names, len(begin.free)
    start = np.concatenate(([begin.values[n] for n in names], *begin.initial))

    def evaluate(x: FloatArray) -> GrayPoint:
        values = {**begin.values, **dict(zip(names, x[:p].tolist()))}
        return replace(begin, values=values, initial=list(x[p:].reshape(-1, 4)))

    def slopes(point: GrayPoint) -> tuple[FloatArray, FloatArray]:
        gradient, curvature = np.zeros(start.size), np.zeros((start.size, start.size))
        for k, (j, residuals) in enumerate(zip(point.slopes, point.residuals)):
            own = np.r_[p + 4 * k : p + 4 * k + 4, :p]
            gradient[own] += j.T @ residuals
            curvature[np.ix_(own, own)] += j.T @ j
        return gradient, curvature

    bounds = bounds_of([*begin.free, *[Unknown("state")] * (start.size - p)])
    return minimise(
        evaluate, slopes, start, bounds,
        rows=begin.rows, tolerance=_TOLERANCE, max_iterations=max_iterations,
    )  # fmt: skip


def _rested(point: GrayPoint) -> GrayPoint:
    """The same with every log that hardly moves at its beginning at rest, forces balanced."""
    machine, out = point.box.machine, []
    area = np.array([machine.area(1), -machine.area(2)])
    for log, state in zip(point.logs, point.initial):
        slow = min(abs(state[3]), abs(log.guess[0, 3])) * float(np.median(log.step))
        if slow < point.sigma[2]:
            state = np.append(state[:2] - area * (area @ state[:2]) / (area @ area), state[2:])
            state[3] = 0.0
        out.append(state)
    return replace(point, initial=out)


def follow(
    e: Experiment,
    machine: HydraulicMachine,
    values: Values,
    start: FloatArray,
    sigma: Sequence[float],
) -> FloatArray:
    """States of one experiment, ``(n, 4)``.

    They begin with ``start`` ``(4,)`` or, where the position was recorded, with the state that fits
    best; ``sigma`` are the standard deviations of the residuals of the channels [Pa, Pa, m].
    """
    if "position" in e:
        log = make_gray_log(e, machine)
    else:
        guess = np.tile(start, (e.samples, 1))
        log = GrayLog(mean_command(e), np.diff(e.time), np.zeros((3, e.samples)), guess)
    box = GrayBox.following([log], machine, values)
    if "position" in e:
        weights = np.array([s if c in e else np.inf for c, s in zip(CHANNELS, sigma)])
        return solve_gray_box(GrayPoint.of(box, [log], weights, values)).point.states[0]
    return box.simulate(log, start, values)


def moving_speeds(point: GrayPoint) -> FloatArray:
    """Velocities while the piston moves, measured ones where it never does, ``(n,)`` [m/s]."""
    v = np.concatenate([s[:, 3] for s in point.states])
    if not v.any():
        v = np.concatenate([log.guess[:, 3] for log in point.logs])
    return np.asarray(v[v != 0.0])


def command_noise(point: GrayPoint) -> tuple[FloatArray, float]:
    """Covariance of the free parameters by noise on the command, ``(p, p)``, from draws of it.

    Returned as well is the largest standard deviation found on the command of a log [V]. A log
    whose residuals show that the machine followed that noise counts for nothing: estimated beside
    the parameters is the share that it did not follow of what a running median takes off. See
    ``docs/theory/hydraulic-cylinder.md``.
    """
    from scipy.ndimage import median_filter

    rng, bread = np.random.default_rng(0), point.bread
    total, most = np.zeros_like(bread), 0.0
    for k, log in enumerate(point.logs):
        noise = noise_floor(log.command, 4)
        if noise == 0.0:
            continue
        column = point.change(k, median_filter(log.command, _SPAN, mode="nearest"))
        own = point.jacobian[k].T @ column
        size = max(float(column @ column - own @ bread @ own), 1e-300)
        share = float(column @ point.residuals[k]) / size
        if share + _SURE / np.sqrt(size) < _SEEN:
            continue
        most = max(most, noise)
        draws = noise * rng.standard_normal((_DRAWS, log.command.size))
        scores = [bread @ (point.jacobian[k].T @ point.change(k, log.command + d)) for d in draws]
        total += np.transpose(scores) @ scores / _DRAWS
    return total, most
