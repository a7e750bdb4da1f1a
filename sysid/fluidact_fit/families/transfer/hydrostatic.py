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

from ...errors import LogError
from ...estimation.named_model import Values, bind
from ...estimation.problem import Unknown
from ...estimation.response_model import Beginning, Plan, ResponseOptions, ResponseTask, Searched
from ...estimation.separable import solve
from ...estimation.starts import dead_time_axis, grid_search, time_scales
from ...estimation.transfer_model import EDGES
from ...experiment import Array, Experiment
from ...family import ParameterSpec, Request, Role, Structure, Variant
from ...options import choice
from .base import ASKED, any_dead_time, dead_time
from .dead_zone import DEAD_ZONE, BehindDeadZone, speeds


@dataclass(frozen=True)
class HydrostaticOptions(ResponseOptions):
    """Options: what is estimated beside mass, damping and dead zone."""

    stiffness: str = choice("none", ASKED, "whether to estimate a spring", "stiffness")
    dead_time: str = choice("none", ASKED, "whether to estimate a dead time", "dead_time")


class Hydrostatic(BehindDeadZone[HydrostaticOptions]):
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
                *DEAD_ZONE,
                dead_time(
                    "dead time between force and position",
                    "Record sharp changes of the force at a higher sampling rate.", optional=True,
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
    reach = 1  # a free mass goes astray behind edges that are wrong: all look alike in the end

    def coefficients(self, values: Values) -> tuple[list[Any], list[Any]]:
        """``1 / (mass s^2 + damping s + stiffness)``."""
        return [1.0], [values["mass"], values["damping"], values.get("stiffness", 0.0)]

    def beginnings(self, values: Values, offset: bool) -> tuple[Array, Array, Sequence[int]]:
        """An initial velocity, and with a spring a constant force beside the offset.

        Beside an offset the constant force stands for an initial position, and it can be computed
        with a spring that hardly is one. Without a spring the initial position is an offset.
        """
        a, b, c = self.realise(values)
        k = values.get("stiffness")
        if k is None or not offset:
            return a, c, (1,) if offset else (0, 1)
        pushed = np.zeros((3, 3), dtype=a.dtype)
        pushed[:2, :2] = a
        if np.real(k) != 0.0:
            pushed[:2, 2] = b
        return pushed, np.append(c, 0.0), (1, 2)

    def alternative_starts(self, values: Values, step: float) -> list[dict[str, float]]:
        """No spring at all: a weak one and a free initial position stand for a drift.

        A search that ends beside zero may have stopped there with edges that make up for it.
        """
        return [{"stiffness": 0.0}] if values.get("stiffness") else []

    def plan(self, experiments: Sequence[Experiment], request: Request[HydrostaticOptions]) -> Plan:
        """Typical sizes, search range and the widest useful intervals.

        Raises
        ------
        LogError
            When nothing moves.
        """
        (step, span), forces = time_scales(experiments), [e["force"] for e in experiments]
        ends = min(0.0, *(f.min() for f in forces)), max(0.0, *(f.max() for f in forces))
        force, speed = float(max(-ends[0], ends[1])), speeds(experiments)[1]
        if force <= 0.0 or speed <= 0.0:
            raise LogError(
                "force or position does not change in any log",
                remedy="Record strokes with a force that moves the piston.",
            )
        damping, travel = force / speed, max(float(np.ptp(experiments[0]["position"])), 1e-12)
        # masses and stiffnesses to try first are per damping
        masses = np.geomspace(0.5 * step, 0.05 * span, 4)
        stiffnesses = np.array([0.1, 1.0, 10.0]) * 2.0 * np.pi / span
        shares = np.array([0.04, 0.3, 0.6, 0.8])
        searched = [
            Searched("mass", damping * step, (1e-4 * damping * step, 1e3 * damping * span), masses),
            Searched("damping", damping, (1e-4 * damping, 1e4 * damping)),
            *(
                Searched(n, force, (min(end, 0.0), max(end, 0.0)), end * shares, 0.5 * force, end)
                for n, end in zip(EDGES, ends)
            ),
            Searched("stiffness", damping / span, axis=stiffnesses, max_half_width=force / travel),
            any_dead_time(step, span),
        ]
        return Plan(searched, lag=lambda at: 3.0 * step)

    def starts(
        self,
        task: ResponseTask[HydrostaticOptions],
        experiments: Sequence[Experiment],
        begin: Beginning,
    ) -> list[dict[str, float]]:
        """Profile over time constant, edges and the rest; ``1/damping`` is eliminated."""
        names = tuple(n for n in task.plan.names if n != "damping")
        free = {n: Unknown(n) for n in names} | {"mobility": Unknown("mobility", 1e-300)}
        model = _PerDamping().response(task.variant, experiments, begin, names)
        problem, axes = bind(model, free, {}), {s.name: s.axis for s in task.plan.searched}
        step, out = time_scales(experiments)[0], []
        for found in grid_search(
            problem, axes, lambda at: dead_time_axis(step, 8.0 * step, task.plan.lag(at))
        ):
            mobility = solve(problem, problem.vector(found), max_iterations=0).linear[0]
            sizes = dict.fromkeys(("mass", "damping", "stiffness"), 1.0 / max(mobility, 1e-300))
            out.append({n: x * sizes.get(n, 1.0) for n, x in {**found, "damping": 1.0}.items()})
        return out

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


class _PerDamping(Hydrostatic):
    """The same with mass and stiffness per damping, and one over that as its gain."""

    gain = "mobility"

    def coefficients(self, values: Values) -> tuple[list[Any], list[Any]]:
        """``1 / (mass s^2 + s + stiffness)``."""
        return super().coefficients({**values, "damping": 1.0})
