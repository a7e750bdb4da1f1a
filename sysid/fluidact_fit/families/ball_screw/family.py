"""Ball-screw (or any) drive: inertia, viscous friction and four Coulomb levels.

    J theta'' = tau - b theta' - F_k(sign theta')       moving
    theta' = 0 while -F_s- <= tau <= F_s+               stuck

Kinetic and static level may differ and both may differ by direction [1]_. Friction falls from the
one to the other at once when the axis moves, or with ``--stribeck estimate`` over the speed:
``F = F_k + (F_s - F_k) exp(-(theta' / v_s)^2)``. A linear axis is the same with mass, force and
position. The motion is solved with events (:mod:`fluidact_fit.mechanics`); nothing is smoothed
in the estimate.

Three stages: inverse dynamics, static levels, position; see ``docs/theory/static-levels.md``.

References
----------
.. [1] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   equations 1 and 7, table 3.
.. [2] A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS",
   Nonlinear System Identification Benchmarks, 2019.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from ...estimation.information import sensitivity
from ...estimation.inputs import settled_hold
from ...estimation.stribeck import FRICTION_STRUCTURES
from ...experiment import Experiment, Hold
from ...family import (
    Excitation,
    Family,
    Information,
    ParameterSpec,
    PhysicsView,
    Plant,
    Request,
    Role,
    Runs,
    Simulated,
    Solution,
    UnmodelledEffect,
    Variant,
)
from .block import DriveBlock
from .fit import derived_numbers, fit_drive
from .levels import bracket_widths
from .model import (
    BREAKAWAY,
    LINEAR,
    ROTARY,
    SIDES,
    SPEED,
    Axis,
    BallScrewOptions,
    DriveModel,
    axis_of,
)
from .start import follow
from .stribeck import fall_of
from .view import friction_view


def _variant(
    name: str, axis: Axis, drive_unit: str, motion_unit: str, inertia_unit: str, viscous_unit: str
) -> Variant:
    """Roles and parameters of the rotary or the linear axis."""
    drive, motion, inertia = axis.drive, axis.motion, axis.inertia
    slow = "Record slow reversals from rest in this direction, several of them."
    return Variant(
        name,
        (
            Role("time", "s", "time of each sample"),
            Role(drive, drive_unit, f"{drive} the drive applies", hold="zoh"),
            Role(motion, motion_unit, f"{motion} of the axis", output=True),
        ),
        (
            ParameterSpec(inertia, inertia_unit, f"{inertia} of everything that moves",
                          minimum=1e-30,
                          remedy="Record quicker accelerations, or a higher sampling rate."),
            ParameterSpec("viscous", viscous_unit, "viscous friction", neutral=0.0, minimum=0.0,
                          optional=True, remedy="Record motion at two clearly different speeds."),
            *(ParameterSpec(f"viscous_{s}", viscous_unit, f"viscous friction, {s} direction",
                            neutral=0.0, minimum=0.0, optional=True, general="viscous",
                            remedy=f"Record motion at two clearly different speeds in the {s} "
                            "direction.") for s in SIDES),
            *(ParameterSpec(f"coulomb_{s}", drive_unit, f"kinetic friction, {s} direction",
                            neutral=0.0, minimum=0.0,
                            remedy=f"Record motion in the {s} direction.") for s in SIDES),
            *(ParameterSpec(f"breakaway_{s}", drive_unit, f"static friction, {s} direction",
                            neutral=0.0, minimum=0.0, remedy=slow, threshold=s,
                            base=f"coulomb_{s}") for s in SIDES),
            ParameterSpec(SPEED, f"{motion_unit}/s",
                          "speed at which 1/e of the fall from static to kinetic friction is left",
                          neutral=0.0, minimum=0.0, optional=True,
                          remedy="Record slow motion: reversals, starts and stops that take many "
                          "samples; leave --stribeck out if friction falls at once."),
        ),
        equation=_equation(axis),
    )  # fmt: skip


def _equation(axis: Axis) -> str:
    return (
        f"{axis.inertia} * {axis.motion}'' = {axis.drive} - viscous * {axis.motion}' - "
        "friction(direction), stuck below breakaway; friction = coulomb (+ (breakaway - coulomb) * "
        f"exp(-{axis.motion}'^2 / stribeck_speed^2))"
    )


class BallScrew(Family[BallScrewOptions]):
    """Stick-slip drive with asymmetric kinetic and static friction."""

    name = "ball-screw"
    title = "Ball-screw drive: inertia, viscous friction and four Coulomb levels"
    equation = _equation(ROTARY)
    variants = (
        _variant("rotary", ROTARY, "N m", "rad", "kg m2", "N m s/rad"),
        _variant("linear", LINEAR, "N", "m", "kg", "N s/m"),
    )
    options_type = BallScrewOptions
    block_type = DriveBlock
    structures = FRICTION_STRUCTURES
    examined = 40_000
    next_experiment = Excitation("command")

    def estimate(
        self,
        variant: Variant,
        experiments: Sequence[Experiment],
        request: Request[BallScrewOptions],
    ) -> Solution[BallScrewOptions]:
        """Fit inertia and friction in three stages; see :meth:`Family.estimate`."""
        return fit_drive(variant, experiments, request, self.simulate)

    def simulate(
        self,
        plant: Plant[BallScrewOptions],
        experiments: Sequence[Experiment],
        offset: float | None = None,
    ) -> list[Simulated]:
        """Position from the torque or force; see :meth:`Family.simulate`.

        The axis may have been anywhere, and moving, when a run began: both belong to the run.
        """
        axis = axis_of(plant.variant)
        return [_follow(e, axis, plant.numbers, offset or 0.0) for e in experiments]

    def information(self, plant: Plant[BallScrewOptions], experiment: Experiment) -> Information:
        """Sensitivities by complex steps; see :meth:`Family.information`."""
        v, axis = plant.numbers, axis_of(plant.variant)
        model = DriveModel([experiment], axis)
        if settled_hold(experiment.signals[axis.drive]) != "zoh":
            return sensitivity(model.named(list(v)), v)
        found = sensitivity(model.named([n for n in v if n not in BREAKAWAY.values()]), v)
        motion, samples = model.motion(0, v)
        speed = motion.velocity[samples]
        return replace(found, floor=bracket_widths(experiment.sampled(axis.drive), speed, v))

    def physics_view(self, plant: Plant[BallScrewOptions], runs: Runs) -> PhysicsView:
        """Friction over speed, kinetic law and static levels; see :func:`friction_view`."""
        return friction_view(plant, runs)

    def model(
        self, plant: Plant[BallScrewOptions], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """Inertia and friction, and the period of the controller."""
        friction = plant.numbers
        name = axis_of(plant.variant).inertia
        section: dict[str, Any] = {name: friction.pop(name), "friction": friction}
        if sample_time > 0.0:
            section["discrete"] = {"sample_time": sample_time, "hold": "zoh"}
        return section

    def derived(self, values: Mapping[str, Any], options: BallScrewOptions) -> Mapping[str, Any]:
        """Levels and time constant of coasting; see :meth:`Family.derived`."""
        return derived_numbers(values)

    def unmodelled_effects(self, plant: Plant[BallScrewOptions]) -> Sequence[UnmodelledEffect]:
        """Another fall from static to kinetic friction; see :meth:`Family.unmodelled_effects`."""
        values = plant.numbers
        return [fall_of(axis_of(plant.variant), values)] if values.get(SPEED) else []

    def prior_guess(
        self,
        name: str,
        plant: Plant[BallScrewOptions],
        amplitude: tuple[float, float],
        sample_time: float,
    ) -> float | None:
        """A kinetic level of a fifth of the range, a static one that is higher by a third.

        At which speed friction falls nobody can guess.
        """
        if name == SPEED:
            return None
        v = plant.numbers
        for s, limit in zip(SIDES, reversed(amplitude)):
            if name == f"coulomb_{s}":
                return 0.2 * abs(limit)
            if name == BREAKAWAY[s]:
                return 1.3 * v[f"coulomb_{s}"]
        return v[name]


def _follow(
    experiment: Experiment, axis: Axis, values: Mapping[str, float], place: float
) -> Simulated:
    """Follow the motion of a run; without a record it starts at rest at ``place`` [SI]."""
    if axis.motion not in experiment:
        alone = DriveModel([experiment], axis)
        return Simulated(alone.columns(0, values).known + place, offset=place)
    model, found, begun = follow(experiment, axis, values)
    output = model.columns(0, begun).combined(found.linear, found.local[0])
    return Simulated(output, offset=float(found.local[0][0]))
