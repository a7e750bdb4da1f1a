"""Stick-slip response of a drive as a named model, and what of it is compared."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ...estimation.grid import make_grid
from ...estimation.inputs import PiecewiseInput, piecewise
from ...estimation.lost_rows import fill_lost_rows
from ...estimation.named_model import NamedModel, Values
from ...estimation.price import simulated
from ...estimation.problem import Basis, Slopes
from ...estimation.stribeck import EXPONENT
from ...experiment import Array, Experiment, FloatArray, Signal
from ...family import Variant
from ...mechanics.motion import Motion, StickSlip
from ...mechanics.stick_slip import Passes, simulate_stick_slip

SIDES: tuple[Literal["positive"], Literal["negative"]] = ("positive", "negative")
BREAKAWAY: dict[str, str] = {s: f"breakaway_{s}" for s in SIDES}  # static level
EXCESS: dict[str, str] = {s: f"excess_{s}" for s in SIDES}  # of the static level
SPEED = "stribeck_speed"  # of the curve that joins a static level to its kinetic one
_LONG = 40_000  # samples beyond which the early stages look at a part of the log


@dataclass(frozen=True)
class Axis:
    """The names that differ between a rotary and a linear axis."""

    drive: str
    motion: str
    inertia: str


ROTARY = Axis("torque", "angle", "inertia")
LINEAR = Axis("force", "position", "mass")


def axis_of(variant: Variant) -> Axis:
    """The names of a variant's axis."""
    return ROTARY if variant.name == "rotary" else LINEAR


@dataclass(frozen=True)
class Compared:
    """What of the position is compared with the measurement.

    ``lag`` samples: differences over that many samples. ``half_width`` samples: position,
    and besides it the speed and acceleration of a local quadratic of that half-width.
    Neither: position alone.
    """

    lag: int = 0
    half_width: int = 0

    def reduce(self, y: FloatArray) -> FloatArray:
        """Turn positions, shape ``(..., n)``, into the compared rows, last axis."""
        if self.lag:
            return y[..., self.lag :] - y[..., : -self.lag]
        if not self.half_width:
            return y
        width, samples = 2 * self.half_width + 1, y.shape[-1]
        size = 1 << (samples + width - 1).bit_length()
        spectrum = np.fft.rfft(y, size)
        smoothed = [
            np.fft.irfft(spectrum * kernel, size)[..., width - 1 : samples]
            for kernel in np.fft.rfft(self._kernels[:, ::-1], size)
        ]
        return np.concatenate((y, *smoothed), axis=-1)

    @cached_property
    def _kernels(self) -> FloatArray:
        """Weights of a window for the slope and the curvature at its middle."""
        offsets = np.arange(-self.half_width, self.half_width + 1)
        return np.linalg.pinv(np.vander(offsets, 3, increasing=True))[1:]

    def offset(self, samples: int, rows: int) -> FloatArray:
        """Column of an unknown offset of the position, shape ``(rows, 0 or 1)``."""
        if self.lag:
            return np.zeros((rows, 0))
        column = np.zeros((rows, 1))
        column[:samples] = 1.0
        return column

    def channels(self, samples: int) -> list[slice]:
        """Rows of each compared quantity."""
        if self.lag or not self.half_width:
            return [slice(0, samples - self.lag)]
        inner = samples - 2 * self.half_width
        ends = (0, samples, samples + inner, samples + 2 * inner)
        return [slice(*pair) for pair in pairwise(ends)]


class DriveModel:
    """Stick-slip response of one or several logs as a named model.

    Static levels enter as ``excess_* = breakaway_* - coulomb_* >= 0`` unless a
    ``breakaway_*`` value is given. ``initial_speed[i]`` is a nuisance value of the runs
    that do not start at rest. ``logged`` says that a logger recorded the drive, which may have
    lost rows; a drive that somebody chose has all of them, however uneven.
    """

    def __init__(
        self, experiments: Sequence[Experiment], axis: Axis, compared: Compared | None = None,
        *, logged: bool = True,
    ) -> None:  # fmt: skip
        self.axis, self.compared = axis, compared or Compared()
        self.times = [e.time for e in experiments]
        drives = [e.signals[axis.drive] for e in experiments]
        self.drives = [fill_lost_rows(s) for s in drives] if logged else drives
        self.inputs = [_on_samples(s, t) for s, t in zip(self.drives, self.times)]
        motions = [e.signals[axis.motion] for e in experiments if axis.motion in e]
        self.measured = [self.compared.reduce(s.values) for s in motions]
        self.resolutions = [s.resolution for s in motions]

    def disturbed(self, errors: Sequence[FloatArray]) -> DriveModel:
        """The model under drives with errors at their nodes, lost rows included [SI]."""
        other = copy(self)
        other.drives = [replace(s, values=s.values + e) for s, e in zip(self.drives, errors)]
        other.inputs = [_on_samples(s, t) for s, t in zip(other.drives, self.times)]
        return other

    def motion(self, index: int, values: Values) -> tuple[Motion, npt.NDArray[np.intp]]:
        """Simulated motion of one log and the nodes that are its samples.

        Values may be rows of equal length, which are simulated together.
        """
        size = max(np.size(v) for v in values.values())

        def row(value: Any) -> Array:
            return np.broadcast_to(value, (size,))

        kinetic = [row(values[f"coulomb_{s}"]) for s in SIDES]
        forward, backward = (
            row(values.get(f"viscous_{s}", values.get("viscous", 0.0))) for s in SIDES
        )
        static = [self._static(s, level, values) for s, level in zip(SIDES, kinetic)]
        levels = kinetic[0], kinetic[1], static[0], static[1]
        curve = row(values.get(SPEED, 0.0))
        shape = row(values.get(EXPONENT, 2.0))
        p = StickSlip(row(values[self.axis.inertia]), forward, *levels, backward, curve, shape)
        passes, samples = self.inputs[index]
        speed = row(values.get(f"initial_speed[{index}]", 0.0))
        return simulate_stick_slip(p, passes, initial_speed=speed), samples

    def motions(self, values: Values) -> list[Motion]:
        """Simulated motions of all logs at their nodes, which are counted."""
        simulated(sum(t.size for t in self.times))
        return [self.motion(i, values)[0] for i in range(len(self.times))]

    def compared_rows(self, values: Values) -> list[FloatArray]:
        """What is compared of all logs, simulated and counted."""
        simulated(sum(t.size for t in self.times))
        return [np.real(self.columns(i, values).known) for i in range(len(self.measured))]

    @staticmethod
    def _static(side: str, kinetic: Array, values: Values) -> Array:
        """Static level of one direction, never below the kinetic one."""
        given = values.get(BREAKAWAY[side])
        if given is None:
            return kinetic + values[EXCESS[side]]
        return np.where(np.real(given) > np.real(kinetic), given, kinetic)

    def columns(self, index: int, values: Values) -> Basis:
        """Simulated position and the offset column."""
        motion, samples = self.motion(index, values)
        return self._basis(index, self.compared.reduce(motion.position[0, samples]))

    def _basis(self, index: int, y: FloatArray) -> Basis:
        samples = self.inputs[index][1].size
        return Basis(y, np.zeros((y.size, 0)), self.compared.offset(samples, y.size))

    def slopes(self, index: int, values: Values, names: Sequence[str]) -> tuple[Basis, Slopes]:
        """Position with its exact derivatives, all in one pass through the events."""
        p = len(names)
        steps = np.array([1e-30 * max(abs(float(values[n])), 1e-12) for n in names])
        rows = {name: np.full(max(p, 1), complex(value)) for name, value in values.items()}
        for k, name in enumerate(names):
            rows[name][k] += 1j * steps[k]
        motion, samples = self.motion(index, rows)
        y = motion.position[:, samples]
        basis = self._basis(index, self.compared.reduce(np.real(y[0])))
        none, local = (np.zeros((p, *c.shape)) for c in (basis.shared, basis.local))
        change = np.imag(y[:p]) / steps[:, None]
        return basis, Slopes(self.compared.reduce(change), none, local)

    def named(self, names: Sequence[str], weights: Sequence[FloatArray] = ()) -> NamedModel:
        """The model in the form the estimation takes."""
        return NamedModel(
            tuple(names), (), self.columns, self.measured, self.slopes, weights,
            resolutions=self.resolutions,
        )  # fmt: skip


def _on_samples(signal: Signal, time: FloatArray) -> tuple[Passes, npt.NDArray[np.intp]]:
    """The input split at the samples, so that every sample is a node; and which are."""
    u = piecewise(signal)
    nodes = np.union1d(u.nodes[(u.nodes > time[0]) & (u.nodes < time[-1])], time)
    piece = np.searchsorted(u.nodes, nodes, side="right") - 1
    coefficients = u.coefficients[np.maximum(piece, 0)]
    coefficients[piece < 0] = 0.0
    coefficients[piece < 0, 0] = signal.before
    passes = Passes(PiecewiseInput(nodes, coefficients), make_grid(nodes))
    return passes, np.searchsorted(nodes, time)


def leading_parts(experiments: Sequence[Experiment], samples: int = _LONG) -> list[Experiment]:
    """What the early stages look at: the first samples of every log."""
    return [e.beginning(samples) for e in experiments]


def increments(experiments: Sequence[Experiment], axis: Axis) -> Compared:
    """Increments over so many samples that they are well above the encoder's resolution."""
    motion = experiments[0].signals[axis.motion]
    y, lag = motion.values, 1
    while lag < y.size // 100 and np.std(y[lag:] - y[:-lag]) < 10.0 * motion.resolution:
        lag *= 2
    return Compared(lag=lag)
