"""Losses of a hydrostatic machine that no parameter stands for: turbulence and dry friction.

Both are tried behind the dead zone, where the model is linear: as a force against the motion that
the fit gives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...estimation.inputs import beyond_dead_zone
from ...estimation.unmodelled_effects import slopes
from ...experiment import Experiment, FloatArray
from ...family import Plant, Simulate, Simulated, UnmodelledEffect
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.held import HeldMass

_EDGES = ("dead_zone_negative", "dead_zone_positive")
Forces = tuple[list[FloatArray], float]
"""Forces behind the dead zone of all runs, ``(n,)`` [N] each, with a loss, and its size."""
Lossy = Callable[[Plant[Any], Sequence[Experiment], Sequence[Simulated]], Forces | None]
"""What gives them, of the runs as recorded and as simulated; ``None`` where there is no loss."""


def other_losses(plant: Plant[Any]) -> list[UnmodelledEffect]:
    """Unmodelled losses of a hydrostatic machine; see :meth:`.Family.unmodelled_effects`."""
    turbulent = UnmodelledEffect(
        "turbulent losses",
        "losses grow with the square of the speed, not with the speed alone",
        "Damping and edges are those of the speeds of these logs: record each range of "
        "speeds by itself, or look for a bore or a fitting that throttles.",
        partial(_lossy, _throttled, plant),
        "N s2/m2",
        positive=True,
    )
    if "stiffness" in plant.values:  # friction and spring: see the spring cylinder
        return [turbulent]
    dry = UnmodelledEffect(
        "dry friction",
        "dry friction acts on the piston, with a force that changes sign with its speed",
        "The model has a dead zone, which is no friction: it lets the piston run on within "
        "it. Use mass and edges for motions like those of the logs only, or fit a family "
        "that knows friction (fluidact-fit families).",
        partial(_lossy, _rubbed, plant),
        plant.variant.role("force").unit,
        positive=True,
    )
    return [turbulent, dry]


def _lossy(
    loss: Lossy, plant: Plant[Any], experiments: Sequence[Experiment], simulate: Simulate
) -> list[dict[str, FloatArray]]:
    """Change of the position by a loss, per size; none for forces at instants of their own."""
    if not all(e["force"].size == e.samples > 1 for e in experiments):
        return [{} for _ in experiments]
    behind = replace(plant, values={**plant.values, **dict.fromkeys(_EDGES, 0.0)})
    edges = [plant.numbers[name] for name in _EDGES]
    pushed = [e.with_readings("force", beyond_dead_zone(e["force"], *edges)) for e in experiments]
    before = simulate(behind, pushed)
    found = loss(plant, experiments, before)
    if found is None:
        return [{} for _ in experiments]
    forces, size = found
    resisted = [e.with_readings("force", f) for e, f in zip(experiments, forces, strict=True)]
    return slopes(before, simulate(behind, resisted), "position", size)


def _throttled(
    plant: Plant[Any], experiments: Sequence[Experiment], simulated: Sequence[Simulated]
) -> Forces | None:
    """A loss with the square of the speed [N s2/m2]."""
    edges = [plant.numbers[name] for name in _EDGES]
    speeds = [np.gradient(s.output, e.time) for e, s in zip(experiments, simulated, strict=True)]
    highest = max(float(np.abs(v).max()) for v in speeds)
    if not highest:
        return None
    size = plant.numbers["damping"] / highest
    return [
        beyond_dead_zone(e["force"], *edges) - size * v * np.abs(v)
        for e, v in zip(experiments, speeds, strict=True)
    ], size


def _rubbed(
    plant: Plant[Any], experiments: Sequence[Experiment], simulated: Sequence[Simulated]
) -> Forces | None:
    """A friction [N] that stands for so much of either edge.

    A force that rises finds the same edges with both; one that falls brakes with friction.
    """
    mass, damping, low, high = (plant.numbers[name] for name in ("mass", "damping", *_EDGES))
    friction = 0.5 * min(-low, high)
    if friction <= 0.0:  # no dead zone to stand in
        return None
    out = []
    for e, s in zip(experiments, simulated, strict=True):
        free = beyond_dead_zone(e["force"], low + friction, high - friction)
        speed = float(s.output[1] - s.output[0]) / float(e.time[1] - e.time[0])
        out.append(free - _friction(e.time, free, friction, mass, damping, speed))
    return out, friction


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
