"""Dry friction of a hydrostatic machine, which no parameter stands for.

It is tried behind the dead zone, where the model is linear, as a force against the motion that the
fit gives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...estimation.inputs import beyond_dead_zone
from ...estimation.unmodelled_effects import slopes
from ...experiment import Experiment, FloatArray
from ...family import Plant, Simulate, UnmodelledEffect
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.held import HeldMass

EDGES = ("dead_zone_negative", "dead_zone_positive")


def dry_friction(plant: Plant[Any]) -> UnmodelledEffect:
    """Dry friction in place of a part of the dead zone; see :meth:`.Family.unmodelled_effects`."""
    return UnmodelledEffect(
        "dry friction",
        "dry friction acts on the piston, with a force that changes sign with its speed",
        "The model has a dead zone, which is no friction: it lets the piston run on within "
        "it. Use mass and edges for motions like those of the logs only, or fit a family "
        "that knows friction (fluidact-fit families).",
        partial(_rubbed, plant),
        plant.variant.role("force").unit,
        positive=True,
    )


def _rubbed(
    plant: Plant[Any], experiments: Sequence[Experiment], simulate: Simulate
) -> list[dict[str, FloatArray]]:
    """Change of the position by a friction that stands for so much of either edge, per size [N].

    A force that rises finds the same edges with both; one that falls brakes with friction. Nothing
    without a dead zone to stand in, and for forces at instants of their own.
    """
    v = plant.numbers
    low, high = (v[name] for name in EDGES)
    friction = 0.5 * min(-low, high)
    sampled_alike = all(e["force"].size == e.samples > 1 for e in experiments)
    if friction <= 0.0 or not sampled_alike:
        return [{} for _ in experiments]
    behind = replace(plant, values={**plant.values, **dict.fromkeys(EDGES, 0.0)})
    pushed = [
        e.with_readings("force", beyond_dead_zone(e["force"], low, high)) for e in experiments
    ]
    before = simulate(behind, pushed)
    resisted = []
    for e, s in zip(experiments, before, strict=True):
        free = beyond_dead_zone(e["force"], low + friction, high - friction)
        speed = float(s.output[1] - s.output[0]) / float(e.time[1] - e.time[0])
        lost = _friction(e.time, free, friction, v["mass"], v["damping"], speed)
        resisted.append(e.with_readings("force", free - lost))
    return slopes(before, simulate(behind, resisted), "position", friction)


def _friction(
    time: FloatArray, force: FloatArray, level: float, mass: float, damping: float, speed: float
) -> FloatArray:
    """Force of Coulomb friction on a damped mass, at the samples, shape ``(n,)`` [N].

    The mean force is held over every step.
    """
    body = HeldMass(mass, FrictionLaw(level, level, damping, damping))
    mean, lost = 0.5 * (force[1:] + force[:-1]), -np.expm1(-np.diff(time) * damping / mass)
    out = []
    for push, span, share in zip(mean.tolist(), np.diff(time).tolist(), lost.tolist(), strict=True):
        _, new = body.advance(0.0, speed, push, span)
        out.append(push - damping * (new - speed * (1.0 - share)) / share)
        speed = new
    return np.asarray(0.5 * (np.append(out, out[-1]) + np.insert(out, 0, out[0])))
