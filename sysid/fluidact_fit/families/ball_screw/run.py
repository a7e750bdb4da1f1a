"""One run simulated with known parameters: the motion, from where and how fast it began."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...estimation.parametric import bind
from ...estimation.separable import solve
from ...experiment import Experiment
from ...family import Simulated
from .model import Axis, DriveModel
from .starts import initial_speeds, speed_unknowns


def follow(
    experiment: Experiment, axis: Axis, values: Mapping[str, float], place: float
) -> Simulated:
    """Follow the motion of a run.

    The place and the speed at which it began are fitted to the recorded motion. A run
    without one starts at rest at ``place`` [SI].
    """
    model = DriveModel([experiment], axis)
    if axis.motion not in experiment:
        return Simulated(model.columns(0, values).known + place, offset=place)
    moving = initial_speeds([experiment], axis)
    named = model.named([*values, *moving])
    found = solve(bind(named, speed_unknowns(moving), values), np.array([*moving.values()]))
    return Simulated(found.simulated[0], offset=float(found.local[0][0]))
