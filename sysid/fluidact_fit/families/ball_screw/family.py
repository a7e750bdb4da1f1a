"""Ball-screw (or any) drive: inertia, viscous friction and four Coulomb levels.

    J theta'' = tau - b theta' - F_k(sign theta')       moving
    theta' = 0 while -F_s- <= tau <= F_s+               stuck

Kinetic and static level may differ and both may differ by direction [1]_. A linear axis is
the same with mass, force and position. The motion is solved with events
(:mod:`..estimation.stick_slip`); nothing is smoothed in the estimate.

Three stages: the inverse dynamics by linear least squares on smoothed derivatives, then
increments of position (no drift), then position. A one-shot fit of the position from a
guess ends in a local minimum.

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

import numpy as np

from ..estimation.information import Information, sensitivity
from ..estimation.inputs import interpolation
from ..estimation.parametric import (
    Fitted,
    Values,
    check_request,
    derive,
    fit_named,
    quantities,
    scalars,
)
from ..experiment import Experiment, FloatArray, Hold
from ..family import Estimate, Family, Option, ParameterSpec, Request, Role, Value, Variant
from .drive.beyond import beyond_notice, forces_beyond_model, with_derivatives
from .drive.brackets import append_variance, bracket_widths, static_levels
from .drive.model import SIDES, Axis, Compared, DriveModel, axis_of
from .drive.refusals import sides_at_rest, without_breakaway
from .drive.starts import fit_increments, initial_speeds, inverse_dynamics, make_drive_unknowns
from .drive.stiction import rename_notices, stiction_specs, to_breakaway


def _variant(name: str, drive: str, drive_unit: str, motion: str, motion_unit: str,
             inertia: str, inertia_unit: str, viscous_unit: str) -> Variant:  # fmt: skip
    """Roles and parameters of the rotary or the linear axis."""
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
                            neutral=0.0, minimum=0.0, optional=True,
                            remedy=f"Record motion at two clearly different speeds in the {s} "
                            "direction.") for s in SIDES),
            *(ParameterSpec(f"coulomb_{s}", drive_unit, f"kinetic friction, {s} direction",
                            neutral=0.0, minimum=0.0,
                            remedy=f"Record motion in the {s} direction.") for s in SIDES),
            *(ParameterSpec(f"breakaway_{s}", drive_unit, f"static friction, {s} direction",
                            neutral=0.0, minimum=0.0, remedy=slow) for s in SIDES),
        ),
    )  # fmt: skip


class BallScrew(Family):
    """Stick-slip drive with asymmetric kinetic and static friction."""

    name = "ball-screw"
    title = "Ball-screw drive: inertia, viscous friction and four Coulomb levels"
    equation = (
        "inertia * angle'' = torque - viscous * angle' - coulomb(direction), stuck below breakaway"
    )
    variants = (
        _variant("rotary", "torque", "N m", "angle", "rad", "inertia", "kg m2", "N m s/rad"),
        _variant("linear", "force", "N", "position", "m", "mass", "kg", "N s/m"),
    )
    options = (
        Option("viscous", "choice", "one viscous value, or one per direction", "symmetric",
               ("symmetric", "asymmetric")),
    )  # fmt: skip

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request
    ) -> Estimate:
        """Fit inertia and friction in three stages; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        axis = axis_of(variant)
        one_sided = request.options["viscous"] == "asymmetric"
        viscous = [f"viscous_{s}" for s in SIDES] if one_sided else ["viscous"]
        direct = {*request.fixed, *request.bounds}
        static = [
            f"breakaway_{s}" if f"breakaway_{s}" in direct else f"stiction_{s}" for s in SIDES
        ]
        names = [axis.inertia, *viscous, *(f"coulomb_{s}" for s in SIDES), *static]
        specs = [*variant.parameters, *stiction_specs(variant)]
        request.progress("inverse dynamics")
        guess = inverse_dynamics(experiments, axis, one_sided)
        moving = initial_speeds(experiments, axis)
        unknowns = make_drive_unknowns(specs, names, guess, moving, request)
        refusals = sides_at_rest(experiments, axis, viscous)
        start = fit_increments(experiments, axis, names, unknowns, guess, request, refusals)
        start = {**start, **moving}
        model = DriveModel(experiments, axis)
        refusals += without_breakaway(model, start, static, refusals)
        request.progress("fitting positions")
        start, names, request, refusals, brackets = static_levels(
            experiments, axis, [*names, *moving], static, unknowns, start, request, refusals
        )
        beyond = forces_beyond_model(experiments, axis, names, unknowns, start, request, refusals)
        drive = max(float(np.abs(e[axis.drive]).max()) for e in experiments)
        resolution = max(e.signals[axis.motion].resolution for e in experiments)
        sensible = {
            **dict.fromkeys(unknowns, drive),
            **_widths(experiments, axis, drive, viscous),
            axis.inertia: start[axis.inertia],
            **dict.fromkeys(moving, np.inf),
        }
        compared = Compared()
        weights: list[FloatArray] = []
        if beyond:
            compared, weights = with_derivatives(
                experiments, axis, names, unknowns, start, request, refusals
            )
        fitted = fit_named(
            DriveModel(experiments, axis, compared).named(names, weights),
            specs,
            request,
            unknowns,
            [start],
            refusals=refusals,
            sensible=sensible,
            sigma_floor=0.0 if compared.half_width else resolution / np.sqrt(12.0),
            channels=[compared.channels(e.samples) for e in experiments],
        )
        fitted = to_breakaway(fitted)
        table, drift = fitted.compare_logs(experiments)
        parameters, order, covariance = quantities(fitted, variant.parameters)
        for name, bracket in brackets.items():
            parameters[name] = bracket.quantity(parameters[name].unit)
            order = (*order, name)
            covariance = append_variance(covariance, bracket.std_error**2)
        last = "position, speed and acceleration" if compared.half_width else "position"
        details = {**fitted.details(), **table, "encoder_resolution": resolution,
                   "stages": ["inverse dynamics", "increments", last]}  # fmt: skip
        return Estimate(
            parameters,
            _derived(fitted, axis, variant),
            order,
            covariance,
            [y[: e.samples] for y, e in zip(fitted.solution.simulated, experiments)],
            [e[axis.motion] for e in experiments],
            [
                *rename_notices(fitted.notices, variant),
                *drift,
                *(beyond_notice(parameters) if beyond else ()),
            ],
            details,
            fitted.sensitivity(),
        )

    def information(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> Information:
        """Sensitivities by complex steps; see :meth:`Family.information`."""
        values = scalars(parameters)
        axis = axis_of(variant)
        model = DriveModel([experiment], axis)
        held = interpolation(experiment.signals[axis.drive]) == "zoh"
        names = [n for n in values if not (held and n.startswith("breakaway"))]
        found = sensitivity(model.named(names), values)
        if not held:
            return found
        motion, samples = model.motion(0, values)
        drive = experiment.sampled(axis.drive)
        speed = np.real(motion.velocity[0, samples])
        return replace(found, floor=bracket_widths(drive, speed, values))

    def simulate(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> FloatArray:
        """Position from the drive's torque or force; see :meth:`Family.simulate`."""
        axis = axis_of(variant)
        values: dict[str, Any] = dict(scalars(parameters))
        if axis.motion in experiment:
            values["initial_speed[0]"] = initial_speeds([experiment], axis).get(
                "initial_speed[0]", 0.0
            )
        model = DriveModel([experiment], axis)
        y = np.real(model.columns(0, values).known)
        if axis.motion in experiment:
            y = y + float(np.mean(experiment[axis.motion] - y))
        return y

    def model_section(
        self, variant: Variant, parameters: Mapping[str, Value], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """Linear part of the drive; friction is compensated from the parameters."""
        from ..discrete import discretise

        v = scalars(parameters)
        b = v.get(
            "viscous", 0.5 * (v.get("viscous_positive", 0.0) + v.get("viscous_negative", 0.0))
        )
        num, den = [1.0], [v[axis_of(variant).inertia], b, 0.0]
        section: dict[str, Any] = {
            "continuous": {"numerator": num, "denominator": den, "dead_time": 0.0}
        }
        if sample_time > 0.0:
            section["discrete"] = discretise(num, den, sample_time, "zoh")
        return section


def _widths(
    experiments: Sequence[Experiment], axis: Axis, drive: float, viscous: Sequence[str]
) -> dict[str, float]:
    """Viscous friction that alone would use up the whole drive at the highest speed."""
    speed = max(
        float(np.quantile(np.abs(np.gradient(e[axis.motion], e.time)), 0.99)) for e in experiments
    )
    return dict.fromkeys(viscous, drive / max(speed, 1e-300))


def _derived(fitted: Fitted, axis: Axis, variant: Variant) -> Mapping[str, Any]:
    """Offset and mean of the kinetic levels, and the time constant of coasting."""
    unit = variant.role(axis.drive).unit

    def function(v: Values) -> dict[str, Any]:
        out = {
            "coulomb_mean": 0.5 * (v["coulomb_positive"] + v["coulomb_negative"]),
            "coulomb_offset": 0.5 * (v["coulomb_positive"] - v["coulomb_negative"]),
        }
        if fitted.values.get("viscous", 0.0) > 0.0:
            out["time_constant"] = v[axis.inertia] / v["viscous"]
        return out

    units = {"coulomb_mean": unit, "coulomb_offset": unit, "time_constant": "s"}
    return derive(fitted, units, function)
