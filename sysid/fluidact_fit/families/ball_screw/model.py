"""Stick-slip response of a drive as a named model, and what of it is compared."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
import numpy.typing as npt

from ...estimation.budget import simulated
from ...estimation.lost_rows import fill_lost_rows
from ...estimation.named_model import NamedModel, Values
from ...estimation.problem import Basis
from ...estimation.stribeck import stribeck_choice
from ...experiment import Experiment, FloatArray
from ...family import FamilyOptions, Variant
from ...mechanics.motion import Motion, StickSlip
from ...mechanics.stick_slip import Passes, simulate_stick_slip
from ...options import choice, settled

SIDES: tuple[Literal["positive"], Literal["negative"]] = ("positive", "negative")
BREAKAWAY: dict[str, str] = {s: f"breakaway_{s}" for s in SIDES}  # static level
SPEED = "stribeck_speed"  # of the curve that joins a static level to its kinetic one
_LONG = 40_000  # samples beyond which the early stages look at a part of the log


@dataclass(frozen=True)
class BallScrewOptions(FamilyOptions):
    """Symmetry of the friction, and what the fit compares."""

    viscous: str = choice(
        "symmetric",
        ("symmetric", "asymmetric"),
        "one viscous value, or one per direction",
        "viscous_positive",
    )
    # The score test of a missing response does not offer it (``frees``): near zero the motion is
    # not linear in the speed of the curve. The warning of forces beyond the model names it.
    stribeck: str = stribeck_choice(frees="")
    compared: str | None = settled(
        "choice", "whether speed and acceleration were compared beside the position",
        choices=("position", "derivatives"),
    )  # fmt: skip


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
    """Compared part of the position: differences of some ``orders``.

    Those of order 0 are the position itself, of order 1 what it gains over ``lag`` samples, of
    order 2 what that gains.
    """

    orders: tuple[int, ...] = (0,)
    lag: int = 1

    def reduce(self, y: FloatArray) -> FloatArray:
        """Turn positions, shape ``(..., n)``, into the compared rows, last axis."""
        parts = [y]
        for _ in range(max(self.orders)):
            parts.append(parts[-1][..., self.lag :] - parts[-1][..., : -self.lag])
        kept = [parts[k] for k in self.orders]
        return kept[0] if len(kept) == 1 else np.concatenate(kept, axis=-1)

    def offset(self, samples: int) -> list[FloatArray]:
        """Column of an unknown offset of the position, shape ``(rows,)``, where there is one."""
        return [self.reduce(np.ones(samples))] * self.orders.count(0)

    def channels(self, samples: int) -> list[slice]:
        """Rows of each compared quantity."""
        ends = np.cumsum([0, *(samples - k * self.lag for k in self.orders)]).tolist()
        return [slice(*pair) for pair in pairwise(ends)]


class DriveModel:
    """Stick-slip response of one or several logs as a named model.

    A static level below its kinetic one acts as the kinetic level. ``initial_speed[i]`` is a
    nuisance value of the runs that do not start at rest. ``logged`` says that a logger recorded
    the drive, which may have lost rows; a drive that somebody chose has all of them, however
    uneven.
    """

    def __init__(
        self, experiments: Sequence[Experiment], axis: Axis, compared: Compared | None = None,
        *, logged: bool = True,
    ) -> None:  # fmt: skip
        self.axis, self.compared = axis, compared or Compared()
        self.times = [e.time for e in experiments]
        drives = [e.signals[axis.drive] for e in experiments]
        self.drives = [fill_lost_rows(s) for s in drives] if logged else drives
        self.inputs = [Passes.on_samples(s, t) for s, t in zip(self.drives, self.times)]
        motions = [e.signals[axis.motion] for e in experiments if axis.motion in e]
        self.measured = [self.compared.reduce(s.values) for s in motions]
        self.resolutions = [s.resolution for s in motions]

    def disturbed(self, errors: Sequence[FloatArray]) -> DriveModel:
        """The model under drives with errors at their nodes, lost rows included [SI]."""
        other = copy(self)
        other.drives = [replace(s, values=s.values + e) for s, e in zip(self.drives, errors)]
        other.inputs = [Passes.on_samples(s, t) for s, t in zip(other.drives, self.times)]
        return other

    def motion(self, index: int, values: Values) -> tuple[Motion, npt.NDArray[np.intp]]:
        """Simulated motion of one log and the nodes that are its samples.

        Values may be rows of equal length, which are simulated together.
        """
        size = max(np.size(v) for v in values.values())
        inertia = np.broadcast_to(values[self.axis.inertia], (size,))
        passes, samples = self.inputs[index]
        speed = np.broadcast_to(values.get(f"initial_speed[{index}]", 0.0), (size,))
        drive = StickSlip.of(inertia, values)
        return simulate_stick_slip(drive, passes, initial_speed=speed), samples

    def motions(self, values: Values) -> list[Motion]:
        """Simulated motions of all logs at their nodes, which are counted."""
        simulated(sum(t.size for t in self.times))
        return [self.motion(i, values)[0] for i in range(len(self.times))]

    def compared_rows(self, values: Values) -> list[FloatArray]:
        """Simulate the compared rows of all logs, and count them."""
        simulated(sum(t.size for t in self.times))
        return [np.real(self.columns(i, values).known) for i in range(len(self.measured))]

    def columns(self, index: int, values: Values) -> Basis:
        """Simulated position and the offset column."""
        motion, samples = self.motion(index, values)
        return self._basis(index, self.compared.reduce(motion.position[0, samples]))

    def _basis(self, index: int, y: FloatArray) -> Basis:
        samples = self.inputs[index][1].size
        return Basis(y, local=self.compared.offset(samples))

    def slopes(self, index: int, values: Values, names: Sequence[str]) -> tuple[Basis, FloatArray]:
        """Position with its exact derivatives, all in one pass through the events."""
        p = len(names)
        steps = np.array([1e-30 * max(abs(float(values[n])), 1e-12) for n in names])
        rows = {name: np.full(max(p, 1), complex(value)) for name, value in values.items()}
        for k, name in enumerate(names):
            rows[name][k] += 1j * steps[k]
        motion, samples = self.motion(index, rows)
        y = motion.position[:, samples]
        basis = self._basis(index, self.compared.reduce(np.real(y[0])))
        return basis, self.compared.reduce(np.imag(y[:p]) / steps[:, None])

    def named(self, names: Sequence[str], weights: Sequence[FloatArray] = ()) -> NamedModel:
        """The model in the form the estimation takes."""
        return NamedModel(
            tuple(names), (), self.columns, self.measured, self.slopes, weights,
            resolutions=self.resolutions,
        )  # fmt: skip


def leading_parts(experiments: Sequence[Experiment], samples: int = _LONG) -> list[Experiment]:
    """Samples of the early stages: the first of every log, fewer of each of many."""
    each = max(samples // len(experiments), samples // 10)
    return [e.beginning(each) for e in experiments]


def increments(experiments: Sequence[Experiment], axis: Axis) -> Compared:
    """Increments over so many samples that they are well above the encoder's resolution."""
    motion = experiments[0].signals[axis.motion]
    y, lag = motion.values, 1
    while lag < y.size // 100 and np.std(y[lag:] - y[:-lag]) < 10.0 * motion.resolution:
        lag *= 2
    return Compared((1,), lag)
