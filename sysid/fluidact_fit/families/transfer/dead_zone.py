"""A dead zone before a mass: its parameters, what is seen of it, and what is no dead zone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...errors import NotIdentifiedError
from ...estimation.inputs import beyond_dead_zone
from ...estimation.transfer_model import EDGES
from ...estimation.unmodelled_effects import slopes, soft_edges
from ...experiment import Experiment, FloatArray, Hold
from ...family import (
    Curve,
    ParameterSpec,
    PhysicsView,
    Plant,
    Request,
    Runs,
    Simulate,
    Solution,
    UnmodelledEffect,
    Variant,
)
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.held import HeldMass
from ...mechanics.local_motion import delayed, local_motion
from ...specification import quotient_unit
from .base import T, TransferFamily

_RESTING = 0.03  # of the highest speed, below which the piston rests
_ASIDE = 0.05  # of the largest force, by which all those at rest may be on one side of zero


def _edge(side: str, beyond: str, low: float, high: float) -> ParameterSpec:
    return ParameterSpec(
        f"dead_zone_{side}", "N", f"force {beyond} which the piston moves", neutral=0.0,
        minimum=low, maximum=high, curved=True,
        remedy=f"Record strokes in the {side} direction that pass the edge of the "
        "dead zone slowly, several times.",
    )  # fmt: skip


DEAD_ZONE = _edge("negative", "below", -np.inf, 0.0), _edge("positive", "above", 0.0, np.inf)


class BehindDeadZone(TransferFamily[T]):
    """Base of a ``mass`` with ``damping`` that a force moves to a position, behind a dead zone."""

    dead_zone = True

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request[T]
    ) -> Solution[T]:
        """Fit; a refusal names a zero of the load cell that is off. See :meth:`Family.estimate`."""
        try:
            return super().estimate(variant, experiments, request)
        except NotIdentifiedError as error:
            _blame_load_cell(error, experiments)
            raise

    def model(self, plant: Plant[T], sample_time: float, hold: Hold) -> dict[str, Any]:
        """The dead zone, and what is behind it; see :meth:`Family.model`."""
        edges = {n: plant.numbers[n] for n in EDGES}
        section = super().model(plant, sample_time, hold)
        return {"input_nonlinearity": {**edges, "slope": 1.0}, **section}

    def unmodelled_effects(self, plant: Plant[T]) -> Sequence[UnmodelledEffect]:
        """Soft edges, and dry friction; see :meth:`Family.unmodelled_effects`."""
        low, high = (plant.numbers[n] for n in EDGES)
        soft = soft_edges(plant, plant.variant.driving[0].name, (low, high))
        # friction and spring: see the spring cylinder
        dry = [] if "stiffness" in plant.values else [_dry_friction(plant)]
        return [soft, *super().unmodelled_effects(plant), *dry]

    def prior_guess(
        self, name: str, plant: Plant[T], amplitude: tuple[float, float], sample_time: float
    ) -> float | None:
        """A dead zone of a fifth of the range; see :meth:`Family.prior_guess`."""
        if name in EDGES:
            return 0.2 * amplitude[EDGES.index(name)]
        return super().prior_guess(name, plant, amplitude, sample_time)

    def physics_view(self, plant: Plant[T], runs: Runs) -> PhysicsView | None:
        """Steady velocity over force; none with a spring, which has no such curve."""
        v, units = plant.numbers, runs[0][0].units
        if v.get("stiffness"):
            return None
        forces, velocities = [], []
        for e, s in runs:
            position, force = e.sampled("position"), e.sampled("force")
            noise = float(np.nanstd(position - s.output))
            fine = 0.05 * float(np.std(force)) / v["damping"]
            velocities.append(local_motion(e.time, position, noise, fine)[0])
            forces.append(delayed(e.time, force, v.get("dead_time", 0.0)))
        x, (low, high) = np.concatenate(forces), (v[n] for n in EDGES)
        along = np.unique([*np.linspace(np.nanmin(x), np.nanmax(x), 200), low, high])
        steady = beyond_dead_zone(along, low, high) / v["damping"]
        return PhysicsView(
            "Steady velocity over force, with the dead zone", "force", units["force"], "velocity",
            quotient_unit(units["position"], "s"), Curve("measured", x, np.concatenate(velocities)),
            [Curve("dead zone and damping", along, steady)],
        )  # fmt: skip


def speeds(experiments: Sequence[Experiment]) -> tuple[FloatArray, float]:
    """Speed at every sample of all logs, shape ``(n,)``, and the highest but for 2 % [m/s]."""
    found = [np.abs(np.gradient(e["position"], e.time)) for e in experiments]
    every = np.concatenate(found)
    return every, float(np.quantile(every, 0.98))


def _blame_load_cell(error: NotIdentifiedError, experiments: Sequence[Experiment]) -> None:
    """Raise a refusal anew where the zero of the load cell seems to be off.

    Within the dead zone the piston rests, and the force passes zero: where it rests at forces of
    one sign alone, but for 2 %, zero is not within the dead zone.
    """
    forces, (speed, fast) = (
        np.concatenate([e.sampled("force") for e in experiments]),
        speeds(experiments),
    )
    resting = forces[speed < _RESTING * fast]
    low, high = np.quantile(resting, (0.02, 0.98)) if resting.size else (0.0, 0.0)
    if max(low, -high) <= _ASIDE * np.abs(forces).max():
        return
    force = experiments[0].signals["force"]
    raise NotIdentifiedError(
        f"the piston only rests at forces of {force.text(low, '.3g')} to "
        f"{force.text(high, '.3g')}: the zero of the load cell seems to be off, or "
        f"a weight or a spring pulls, and {error.what}",
        expected=error.expected,
        remedy="Read the force while nothing acts, and subtract it from the column. "
        f"Otherwise: {error.remedy}",
    ) from error


def _dry_friction(plant: Plant[Any]) -> UnmodelledEffect:
    """Dry friction in place of a part of the dead zone; see :meth:`.Family.unmodelled_effects`.

    It is tried behind the dead zone, where the model is linear, as a force against the motion that
    the fit gives.
    """
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
        first = np.flatnonzero(np.isfinite(s.output))[:2]  # a beginning may be left out
        speed = float(np.diff(s.output[first])[0] / np.diff(e.time[first])[0])
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
