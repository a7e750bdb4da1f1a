"""Hydrostatic transmission: a dead zone in series with a moving mass of fluid.

    m x'' + c x' (+ k x) = DZ(F),   DZ(F) = max(F - F+, 0) + min(F - F-, 0)

A Hammerstein model whose static part has slope one by construction, so that mass and
damping keep their physical meaning. The thesis [1]_ found 53.7 kg and 1720.5 N s/m for two
lines of 2.36 m.

The force is that of a hand, which changes between samples. Taking it as held biases the
mass by ``-c Ts / 2`` (8.6 kg at 100 Hz), so it is not held by default.

References
----------
.. [1] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   equations 8 to 10 and figure 18.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...errors import LogError, NotIdentifiedError
from ...estimation.named_model import Values, bind
from ...estimation.problem import Unknown
from ...estimation.response_model import Beginning, Plan, ResponseOptions, ResponseTask, Searched
from ...estimation.separable import solve
from ...estimation.starts import dead_time_axis, grid_search, time_scales
from ...experiment import Experiment
from ...family import (
    Curve,
    ParameterSpec,
    PhysicsView,
    Plant,
    Request,
    Role,
    Runs,
    Solution,
    Structure,
    UnmodelledEffect,
    Variant,
)
from ...mechanics.local_motion import delayed, local_motion
from ...options import choice
from ...specification import quotient_unit
from .base import ASKED, TransferFamily
from .dry_friction import dry_friction
from .model import Free, TransferModel

_RESTING = 0.03  # of the highest speed, below which the piston rests
_ASIDE = 0.05  # of the largest force, by which all those at rest may be on one side of zero


@dataclass(frozen=True)
class HydrostaticOptions(ResponseOptions):
    """Options: what is estimated beside mass, damping and dead zone."""

    stiffness: str = choice("none", ASKED, "whether to estimate a spring", "stiffness")
    dead_time: str = choice("none", ASKED, "whether to estimate a dead time", "dead_time")


def _edge(side: str, beyond: str, low: float, high: float) -> ParameterSpec:
    """An edge of the dead zone, on one side of zero."""
    return ParameterSpec(
        f"dead_zone_{side}", "N", f"force {beyond} which the piston moves", neutral=0.0,
        minimum=low, maximum=high, curved=True,
        remedy=f"Record strokes in the {side} direction that pass the edge of the "
        "dead zone slowly, several times.",
    )  # fmt: skip


class Hydrostatic(TransferFamily[HydrostaticOptions]):
    """Dead zone followed by mass, damping and an optional spring."""

    name = "hydrostatic"
    title = "Hydrostatic transmission: dead zone, mass and damping"
    equation = "mass x'' + damping x' (+ stiffness x) = dead_zone(force)"
    variants = (
        Variant(
            "hydrostatic",
            (
                Role("time", "s", "time of each sample"),
                Role("force", "N", "force on the master piston", hold="auto"),
                Role("position", "m", "position of the piston", output=True),
            ),
            (
                ParameterSpec(
                    "mass", "kg", "apparent mass of pistons and fluid", minimum=1e-12,
                    remedy="Move faster: the mass shows above damping/mass rad/s. Record the "
                    "force at a higher rate, or fix the mass with --fix mass=...",
                ),
                ParameterSpec(
                    "damping", "N s/m", "viscous damping of the lines", minimum=1e-12,
                    remedy="Record strokes with a force well outside the dead zone.",
                ),
                ParameterSpec(
                    "stiffness", "N/m", "stiffness of a spring at the piston", minimum=0.0,
                    neutral=0.0, optional=True,
                    remedy="Record strokes that stop at several positions.",
                ),
                _edge("negative", "below", -np.inf, 0.0),
                _edge("positive", "above", 0.0, np.inf),
                ParameterSpec(
                    "dead_time", "s", "dead time between force and position", neutral=0.0,
                    minimum=0.0, optional=True, curved=True,
                    remedy="Record sharp changes of the force at a higher sampling rate.",
                ),
            ),
        ),
    )  # fmt: skip
    options_type = HydrostaticOptions
    structures = (
        Structure(
            "no dead zone", {"dead-time": "none", "stiffness": "none"},
            {"dead_zone_negative": 0.0, "dead_zone_positive": 0.0},
        ),
        Structure("dead zone", {"dead-time": "none", "stiffness": "none"}),
        Structure("dead zone, dead time", {"dead-time": "estimate", "stiffness": "none"}),
        Structure(
            "dead zone, spring", {"dead-time": "none", "stiffness": "estimate"}, instead=True
        ),
        Structure(
            "dead zone, dead time, spring", {"dead-time": "estimate", "stiffness": "estimate"}
        ),
    )  # fmt: skip
    dead_zone = True
    reach = 1  # a free mass goes astray behind edges that are wrong: all look alike in the end

    @staticmethod
    def realise(values: Values) -> tuple[Any, Any, Any]:
        """State space of ``1/(m s^2 + c s + k)``, position and velocity."""
        m = values["mass"]
        a = np.array([[0.0, 1.0], [-values.get("stiffness", 0.0) / m, -values["damping"] / m]])
        return a, np.array([0.0, 1.0 / m]), np.array([1.0, 0.0])

    def beginnings(self, values: Values) -> Free:
        """An initial velocity, and with a spring a constant force beside the offset.

        Beside an offset the constant force stands for an initial position, and it can be computed
        with a spring that hardly is one. Without a spring the initial position is an offset.
        """
        a, b, c = self.realise(values)
        k = values.get("stiffness")
        if k is None:
            return Free(a, c, (1,))
        pushed = np.zeros((3, 3), dtype=a.dtype)
        pushed[:2, :2] = a
        if np.real(k) != 0.0:
            pushed[:2, 2] = b
        return Free(pushed, np.append(c, 0.0), (1, 2))

    def elsewhere(self, values: Values, step: float) -> list[dict[str, float]]:
        """No spring at all: a weak one and a free initial position stand for a drift.

        A search that ends beside zero may have stopped there with edges that make up for it.
        """
        return [{"stiffness": 0.0}] if values.get("stiffness") else []

    def physics_view(self, plant: Plant[HydrostaticOptions], runs: Runs) -> PhysicsView | None:
        """Velocity over force with the dead zone; none with a spring, which has no such curve."""
        v = plant.numbers
        if v.get("stiffness"):
            return None
        forces, speeds = [], []
        for e, s in runs:
            position, force = e.sampled("position"), e.sampled("force")
            noise = float(np.nanstd(position - s.output))
            fine = 0.05 * float(np.std(force)) / v["damping"]
            speeds.append(local_motion(e.time, position, noise, fine)[0])
            forces.append(delayed(e.time, force, v.get("dead_time", 0.0)))
        x, units = np.concatenate(forces), runs[0][0].units
        edges = v["dead_zone_negative"], v["dead_zone_positive"]
        along = np.unique([*np.linspace(np.nanmin(x), np.nanmax(x), 200), *edges])
        beyond = np.maximum(along - edges[1], 0.0) + np.minimum(along - edges[0], 0.0)
        return PhysicsView(
            "Steady velocity over force, with the dead zone", "force", units["force"], "velocity",
            quotient_unit(units["position"], "s"), Curve("measured", x, np.concatenate(speeds)),
            [Curve("dead zone and damping", along, beyond / v["damping"])],
        )  # fmt: skip

    def coefficients(self, values: Mapping[str, float]) -> tuple[list[float], list[float]]:
        """``1 / (mass s^2 + damping s + stiffness)``."""
        return [1.0], [values["mass"], values["damping"], values.get("stiffness", 0.0)]

    def estimate(
        self,
        variant: Variant,
        experiments: Sequence[Experiment],
        request: Request[HydrostaticOptions],
    ) -> Solution[HydrostaticOptions]:
        """Fit; a refusal names a zero of the load cell that is off. See :meth:`Family.estimate`.

        Within the dead zone the piston rests, and the force passes zero: where it rests at forces
        of one sign alone, zero is not within the dead zone.
        """
        try:
            return super().estimate(variant, experiments, request)
        except NotIdentifiedError as error:
            low, high, largest = _forces_at_rest(experiments)
            if max(low, -high) <= _ASIDE * largest:
                raise
            force = experiments[0].signals["force"]
            raise NotIdentifiedError(
                f"the piston only rests at forces of {force.text(low, '.3g')} to "
                f"{force.text(high, '.3g')}: the zero of the load cell seems to be off, or "
                f"a weight or a spring pulls, and {error.what}",
                expected=error.expected,
                remedy="Read the force while nothing acts, and subtract it from the column. "
                f"Otherwise: {error.remedy}",
            ) from error

    def plan(self, experiments: Sequence[Experiment], request: Request[HydrostaticOptions]) -> Plan:
        """Typical sizes, search range and the widest useful intervals."""
        step, span = time_scales(experiments)
        low, high, speed = _ranges(experiments)
        force, shares = max(high, -low), np.array([0.04, 0.3, 0.6, 0.8])
        damping, negative, positive = force / speed, min(low, 0.0), max(high, 0.0)
        travel = max(float(np.ptp(experiments[0]["position"])), 1e-12)
        # masses and stiffnesses to try first are per damping
        masses = np.geomspace(0.5 * step, 0.05 * span, 4)
        stiffnesses = np.array([0.1, 1.0, 10.0]) * 2.0 * np.pi / span
        searched = [
            Searched("mass", damping * step, (1e-4 * damping * step, 1e3 * damping * span), masses),
            Searched("damping", damping, (1e-4 * damping, 1e4 * damping)),
            Searched("dead_zone_negative", force, (negative, 0.0), negative * shares,
                     0.5 * force, idle=negative),
            Searched("dead_zone_positive", force, (0.0, positive), positive * shares,
                     0.5 * force, idle=positive),
        ]  # fmt: skip
        options, given = request.options, request.fixed
        if options.stiffness == "estimate" or "stiffness" in given:
            searched.append(
                Searched("stiffness", damping / span, axis=stiffnesses, sensible=force / travel)
            )
        if options.dead_time == "estimate" or "dead_time" in given:
            searched.append(Searched("dead_time", step, (0.0, 0.5 * span), sensible=0.25 * span))
        return Plan(searched, lag=lambda at: 3.0 * step)

    def starts(
        self,
        task: ResponseTask[HydrostaticOptions],
        experiments: Sequence[Experiment],
        begin: Beginning,
    ) -> list[dict[str, float]]:
        """Profile over time constant, edges and the rest; ``1/damping`` is eliminated."""

        def per_damping(values: Values) -> Values:
            return {**values, "damping": 1.0}

        step, _ = time_scales(experiments)
        used = [n for n in task.plan.names if n != "damping"]
        model = TransferModel(
            experiments, "force", "position", lambda v: self.realise(per_damping(v)),
            lambda v: self.beginnings(per_damping(v)), begin, gain="mobility", dead_zone=True,
        )  # fmt: skip
        free = {n: Unknown(n) for n in used}
        free["mobility"] = Unknown("mobility", 1e-300)
        problem = bind(model.named(used), free, {})
        axes = {s.name: s.axis for s in task.plan.searched}
        out = []
        for found in grid_search(
            problem, axes, lambda at: dead_time_axis(step, 8.0 * step, task.plan.lag(at))
        ):
            eta = np.array([found[n] for n in used])
            damping = 1.0 / max(solve(problem, eta, max_iterations=0).linear[0], 1e-300)
            start = {**found, "damping": damping, "mass": found["mass"] * damping}
            if "stiffness" in found:
                start["stiffness"] = found["stiffness"] * damping
            out.append(start)
        return out

    def unmodelled_effects(self, plant: Plant[HydrostaticOptions]) -> Sequence[UnmodelledEffect]:
        """Soft edges, and dry friction; see :meth:`Family.unmodelled_effects`."""
        effects = list(super().unmodelled_effects(plant))
        if "stiffness" not in plant.values:  # friction and spring: see the spring cylinder
            effects.append(dry_friction(plant))
        return effects

    derived_units: ClassVar[Mapping[str, str]] = {
        "time_constant": "s",
        "dead_zone_half_width": "N",
        "dead_zone_centre": "N",
    }

    def derived(self, values: Values, options: HydrostaticOptions) -> dict[str, Any]:
        """Time constant, half-width and centre of the dead zone.

        The centre cannot be separated from an offset of the load cell, the half-width can.
        """
        low, high = values["dead_zone_negative"], values["dead_zone_positive"]
        return {
            "time_constant": values["mass"] / values["damping"],
            "dead_zone_half_width": 0.5 * (high - low),
            "dead_zone_centre": 0.5 * (high + low),
        }


def _forces_at_rest(experiments: Sequence[Experiment]) -> tuple[float, float, float]:
    """Lowest and highest force at which the piston rests, but for 2 %, and the largest of all."""
    forces = np.concatenate([e.sampled("force") for e in experiments])
    speeds = np.abs(
        np.concatenate([np.gradient(e.sampled("position"), e.time) for e in experiments])
    )
    resting = forces[speeds < _RESTING * np.nanquantile(speeds, 0.98)]
    low, high = np.quantile(resting, (0.02, 0.98)) if resting.size else (0.0, 0.0)
    return float(low), float(high), float(np.abs(forces).max())


def _ranges(experiments: Sequence[Experiment]) -> tuple[float, float, float]:
    """Lowest and highest force [N], and the highest speed but for 2 % [m/s].

    Raises
    ------
    LogError
        When nothing moves.
    """
    high = max(float(e["force"].max()) for e in experiments)
    low = min(float(e["force"].min()) for e in experiments)
    speeds = [np.abs(np.gradient(e["position"], e.time)) for e in experiments]
    speed = float(np.quantile(np.concatenate(speeds), 0.98))
    if max(high, -low) <= 0.0 or speed <= 0.0:
        raise LogError(
            "force or position does not change in any log",
            remedy="Record strokes with a force that moves the piston.",
        )
    return low, high, speed
