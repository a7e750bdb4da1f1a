"""Stick-slip response of a drive as a named model, and what of it is compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ...estimation.inputs import PiecewiseInput, piecewise
from ...estimation.linear import Grid, make_grid
from ...estimation.parametric import NamedModel, Values
from ...estimation.separable import Basis, Slopes
from ...experiment import Experiment, FloatArray, Signal
from ...family import Variant
from .stick_slip import Motion, StickSlip, simulate_stick_slip

Array = npt.NDArray[Any]
SIDES: tuple[Literal["positive"], Literal["negative"]] = ("positive", "negative")
BREAKAWAY: dict[str, str] = {s: f"breakaway_{s}" for s in SIDES}  # static level
EXCESS: dict[str, str] = {s: f"excess_{s}" for s in SIDES}  # of the static level
LONG = 40_000  # samples beyond which the early stages look at a part of the log


@dataclass(frozen=True)
class Axis:
    """The names that differ between a rotary and a linear axis."""

    drive: str
    motion: str
    inertia: str


def axis_of(variant: Variant) -> Axis:
    """The names of a variant's axis."""
    rotary = variant.name == "rotary"
    return Axis("torque", "angle", "inertia") if rotary else Axis("force", "position", "mass")


@dataclass(frozen=True)
class Compared:
    """What of the position is compared with the measurement.

    ``lag`` samples: differences over that many samples. ``half_width`` samples: position,
    and besides it the speed and acceleration of a local quadratic of that half-width.
    Neither: position alone.
    """

    lag: int = 0
    half_width: int = 0

    def reduce(self, y: Array) -> Array:
        """Turn positions, shape ``(..., n)``, into the compared rows, last axis."""
        if self.lag:
            return y[..., self.lag :] - y[..., : -self.lag]
        if not self.half_width:
            return y
        windows = np.lib.stride_tricks.sliding_window_view(y, 2 * self.half_width + 1, axis=-1)
        return np.concatenate((y, windows @ self._kernel(1), windows @ self._kernel(2)), axis=-1)

    def _kernel(self, order: int) -> FloatArray:
        offsets = np.arange(-self.half_width, self.half_width + 1)
        return np.linalg.pinv(np.vander(offsets, 3, increasing=True))[order]

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
        return [
            slice(0, samples),
            slice(samples, samples + inner),
            slice(samples + inner, samples + 2 * inner),
        ]


class DriveModel:
    """Stick-slip response of one or several logs as a named model.

    Static levels enter as ``excess_* = breakaway_* - coulomb_* >= 0`` unless a
    ``breakaway_*`` value is given. ``initial_speed[i]`` is a nuisance value of the runs
    that do not start at rest.
    """

    def __init__(
        self, experiments: Sequence[Experiment], axis: Axis, compared: Compared | None = None
    ) -> None:
        self.axis, self.compared = axis, compared or Compared()
        self.inputs: list[tuple[PiecewiseInput, Grid, npt.NDArray[np.intp]]] = []
        for e in experiments:
            self.inputs.append(_on_samples(e.signals[axis.drive], e.time))
        outputs = [e[axis.motion] for e in experiments if axis.motion in e]
        self.measured = [self.compared.reduce(y) for y in outputs]
        self.resolutions = [
            e.signals[axis.motion].resolution for e in experiments if axis.motion in e
        ]

    def _parameters(self, index: int, values: Values) -> tuple[StickSlip, Array]:
        """Rows of parameters and of the initial speed."""
        rows = {k: np.atleast_1d(v) for k, v in values.items()}
        inertia = rows[self.axis.inertia]
        size = max(v.size for v in rows.values())

        def row(name: str, otherwise: Array | None = None) -> Array:
            value = rows.get(name, otherwise)
            assert value is not None
            return np.broadcast_to(value, (size,))

        static = []
        for s in SIDES:
            kinetic = row(f"coulomb_{s}")
            if BREAKAWAY[s] in rows:
                given = row(BREAKAWAY[s])
                static.append(np.where(np.real(given) > np.real(kinetic), given, kinetic))
            else:
                static.append(kinetic + row(EXCESS[s]))
        forward = row("viscous_positive", rows.get("viscous"))
        backward = row("viscous_negative", rows.get("viscous"))
        p = StickSlip(
            np.broadcast_to(inertia, (size,)), forward, row("coulomb_positive"),
            row("coulomb_negative"), static[0], static[1], backward,
        )  # fmt: skip
        return p, row(f"initial_speed[{index}]", np.zeros(1))

    def motion(self, index: int, values: Values) -> tuple[Motion, npt.NDArray[np.intp]]:
        """Simulated motion of one log and the nodes that are its samples."""
        p, speed = self._parameters(index, values)
        u, grid, samples = self.inputs[index]
        return simulate_stick_slip(p, u, grid, initial_speed=speed), samples

    def _rows(self, index: int, values: Values) -> tuple[Array, int]:
        motion, samples = self.motion(index, values)
        return self.compared.reduce(motion.position[:, samples]), samples.size

    def columns(self, index: int, values: Values) -> Basis:
        """Simulated position and the offset column."""
        y, samples = self._rows(index, values)
        return self._basis(y[0], samples)

    def _basis(self, y: Array, samples: int) -> Basis:
        return Basis(y, np.zeros((y.size, 0)), self.compared.offset(samples, y.size))

    def slopes(self, index: int, values: Values, names: Sequence[str]) -> tuple[Basis, Slopes]:
        """Position with its exact derivatives, all in one pass through the events."""
        p = len(names)
        rows: dict[str, Any] = {}
        steps = np.array([1e-30 * max(abs(float(values[n])), 1e-12) for n in names])
        for name, value in values.items():
            row = np.full(p + 1, complex(value))
            if name in names:
                k = names.index(name)
                row[k] += 1j * steps[k]
            rows[name] = row
        y, samples = self._rows(index, rows)
        basis = self._basis(np.real(y[p]), samples)
        n = basis.known.size
        slopes = np.imag(y[:p]) / steps[:, None]
        local = np.zeros((p, n, basis.local.shape[1]))
        return basis, Slopes(slopes, np.zeros((p, n, 0)), local)

    def named(self, names: Sequence[str], weights: Sequence[FloatArray] = ()) -> NamedModel:
        """The model in the form the estimation takes."""
        return NamedModel(
            tuple(names),
            (),
            self.columns,
            self.measured,
            self.slopes,
            weights,
            resolutions=self.resolutions,
        )


def _on_samples(
    signal: Signal, time: FloatArray
) -> tuple[PiecewiseInput, Grid, npt.NDArray[np.intp]]:
    """Split the input at the samples, so that every sample is a node."""
    u = piecewise(signal)
    if u.nodes.shape == time.shape and np.array_equal(u.nodes, time):
        return u, make_grid(time), np.arange(time.size)
    nodes = np.union1d(u.nodes[(u.nodes > time[0]) & (u.nodes < time[-1])], time)
    piece = np.searchsorted(u.nodes, nodes, side="right") - 1
    coefficients = u.coefficients[np.maximum(piece, 0)]
    coefficients[piece < 0] = 0.0
    coefficients[piece < 0, 0] = signal.before
    return PiecewiseInput(nodes, coefficients), make_grid(nodes), np.searchsorted(nodes, time)


def leading_part(experiment: Experiment, samples: int) -> Experiment:
    """The first samples of a log."""
    if experiment.samples <= samples:
        return experiment
    part = slice(0, samples)
    signals = {
        r: replace(s, time=s.time[part], values=s.values[part]) if s.values.size > 1 else s
        for r, s in experiment.signals.items()
    }
    return replace(experiment, time=experiment.time[part], signals=signals)


def increment_lag(experiments: Sequence[Experiment], axis: Axis) -> int:
    """Samples over which an increment is well above the encoder's resolution."""
    e = experiments[0]
    y = e[axis.motion]
    resolution = e.signals[axis.motion].resolution
    lag = 1
    while lag < y.size // 100 and np.std(y[lag:] - y[:-lag]) < 10.0 * resolution:
        lag *= 2
    return lag
