"""Friction of a drive over its speed, as it was measured and as the model has it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...experiment import BoolArray, Experiment, FloatArray
from ...family import Curve, PhysicsView, Plant, Runs, Simulated
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.local_motion import local_motion
from .model import SIDES, Axis, BallScrewOptions, axis_of

_AROUND = 3  # samples on either side that have to move the same way
_STUCK = 0.01  # of the highest speed
_HALF_WIDTH = 0.06  # of a mark of a static level, in highest speeds


def friction_view(plant: Plant[BallScrewOptions], runs: Runs) -> PhysicsView:
    """Drive less inertia over speed: measured, the kinetic law, and the static levels.

    Samples whose neighbours stick or move the other way are left out: a parabola through both
    is neither.
    """
    axis, v = axis_of(plant.variant), plant.numbers
    parts = [_measured(e, s, axis, v) for e, s in runs]
    speed, friction = (np.concatenate(part) for part in zip(*parts))
    top = float(np.nanmax(np.abs(speed), initial=0.0)) or 1.0
    laws = [_law(FrictionLaw.of(v), way, top) for way in (1.0, -1.0)]
    kinetic, static = (_joined(pairs) for pairs in zip(*laws))
    units = runs[0][0].units
    return PhysicsView(
        f"Friction over speed: {axis.drive} less inertia", "speed", f"{units[axis.motion]}/s",
        "friction", units[axis.drive], Curve("measured", speed, friction),
        [Curve("kinetic", *kinetic), Curve("static", *static)],
    )  # fmt: skip


def _measured(
    e: Experiment, s: Simulated, axis: Axis, values: dict[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Speed and friction at every sample of a run, ``(n,)``; NaN where they cannot be had."""
    position, drive = e.sampled(axis.motion), e.sampled(axis.drive)
    noise = float(np.nanstd(position - s.output))
    fastest = float(np.nanmax(np.abs(np.gradient(s.output, e.time)), initial=0.0))
    levels = [values.get(f"coulomb_{side}", 0.0) for side in SIDES]
    fine = 0.1 * max(levels) / values[axis.inertia] or np.inf
    speed, acceleration = local_motion(e.time, position, noise, _STUCK * fastest, fine)
    # a held drive acts at a sample half as before it and half as after it
    acting = 0.5 * (drive + np.concatenate((drive[:1], drive[:-1])))
    friction = np.where(
        _alike(speed, _STUCK * fastest), acting - values[axis.inertia] * acceleration, np.nan
    )
    return speed, friction


def _alike(speed: FloatArray, stuck: float) -> BoolArray:
    """Samples all of whose neighbours stick, or move, as they do, ``(n,)``."""
    way = np.where(np.abs(speed) <= stuck, 0.0, np.sign(speed))
    padded = np.pad(way, _AROUND, constant_values=np.nan)
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1)
    return np.asarray((around == way[:, None]).all(axis=1))


def _law(
    law: FrictionLaw, way: float, top: float
) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    """Kinetic friction over speed in one direction, and a mark at its static level."""
    speed, mark = way * np.linspace(0.0, top, 400), np.array([-_HALF_WIDTH, _HALF_WIDTH]) * top
    return (speed, law.moving(speed, way)), (mark, np.full(2, law.at_rest(way * np.inf)))


def _joined(pairs: Sequence[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Lines as one, with NaN between them."""
    x, y = (np.concatenate([np.append(line, np.nan) for line in lines]) for lines in zip(*pairs))
    return x, y
