"""Forces that vary along the travel of a cylinder or shaft."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ...estimation.solution import moved
from ...experiment import Experiment, FloatArray
from ...family import Plant, Simulate, UnmodelledEffect
from .axis import axis_of, is_place, motion_role
from .options import FrictionOptions
from .samples import LEVELS

_PLACES = 9  # along the travel, between which a force changes linearly


def unmodelled_effects(plant: Plant[FrictionOptions]) -> Iterator[UnmodelledEffect]:
    """Yield friction and load that vary along the travel, where the position was recorded."""
    if not is_place(motion_role(plant.variant)):
        return
    axis = axis_of(plant.variant)
    for name, words, remedy, rubs in (
        ("friction along the travel", "friction varies along the travel",
         "A bent rod, a worn seal or a tight bearing: fit parts of the travel by themselves "
         "(--window, --exclude).", True),
        ("load along the travel", "a load varies along the travel",
         "A spring, a hose, a cable or a slope: record its force, or remove it.", False),
    ):  # fmt: skip
        response = partial(_along_the_travel, plant, rubs)
        yield UnmodelledEffect(name, words, remedy, response, axis.force_unit, shaped=True)


def _along_the_travel(
    plant: Plant[FrictionOptions],
    rubs: bool,
    experiments: Sequence[Experiment],
    simulate: Simulate,
) -> list[dict[str, FloatArray]]:
    """Derivatives of the output by a force at each place, ``(n, places)``.

    The force opposes the motion where it ``rubs``, as a level of friction does; a load is one that
    pushes one way.
    """
    role, output = motion_role(plant.variant), plant.variant.output.name
    plant = replace(plant, options=replace(plant.options, force_offset=False))
    pushed = moved(moved(plant, LEVELS[0], 1.0), LEVELS[1], 1.0 if rubs else -1.0)
    ends = [f(e[role]) for e in experiments for f in (np.min, np.max)]
    places = np.linspace(min(ends), max(ends), _PLACES)
    out = []
    runs = (simulate(p, experiments) for p in (pushed, plant))
    for e, more, less in zip(experiments, *runs, strict=True):
        hats = np.column_stack([np.interp(e[role], places, one) for one in np.eye(_PLACES)])
        out.append({output: (more.output - less.output)[:, None] * hats})
    return out
