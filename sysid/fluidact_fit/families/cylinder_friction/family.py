"""Friction of a cylinder: two Coulomb levels and viscous friction, which can differ as well.

    F_f = F_c+ [v > 0] - F_c- [v < 0] + b v (+ sign(v) F_s exp(-(v / v_s)^2) with --stribeck)
    F_f = F - (A_1 p_1 - A_2 p_2) - m a      with a load cell that feels what drives
    F_f = A_1 p_1 - A_2 p_2 - F - m a        with one that feels the load: --pressures=drive
    F_f = A_1 p_1 - A_2 p_2 - m a            without: the pressures drive

``F`` drives the motion, positive along positive velocity, or is the load against it. Pressure
forces and the inertia ``m a`` are subtracted when areas and mass are given. Of a shaft, torque,
moment of inertia and angular velocity stand in the same equation, with friction in N m. All
levels are magnitudes. Only moving samples are used [1]_. Noise of the motion and the filter of a
position's slope: ``docs/theory/regression.md``.

Without a second speed in at least one direction ``viscous`` is not identified and the levels
include all friction; with ``--viscous=asymmetric`` each ``b`` needs two speeds in its direction.

References
----------
.. [1] A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS", Nonlinear
   System Identification Benchmarks, 2019: regression on filtered velocity with slow
   samples left out.
.. [2] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   equations 17 to 19: friction levels by direction with a velocity tolerance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...estimation.named_model import check_request
from ...estimation.stribeck import (
    FRICTION_STRUCTURES,
    STRIBECK,
    Rise,
    friction_columns,
    rise_words,
    stribeck_specs,
)
from ...experiment import Experiment, Hold
from ...family import (
    Curve,
    Excitation,
    Family,
    Information,
    NoiseModel,
    ParameterDocument,
    ParameterSpec,
    Plant,
    Request,
    Role,
    Runs,
    Simulated,
    Solution,
    StaticView,
    UnmodelledEffect,
    Variant,
    make_solution,
)
from ...mechanics.friction_law import FrictionLaw, mean_and_offset
from .axis import LINEAR, PRESSURES, ROTARY, Axis, axis_of, is_place, motion_role
from .block import FrictionBlock
from .fit import SECOND_SPEED, FrictionFit
from .notices import fit_details, fit_notices
from .options import ONE_SIDED, SIDES, FrictionOptions
from .samples import (
    LEVELS,
    check_measured,
    count_kept,
    leave_out_accelerations,
    leave_out_turns,
    prepare,
    sides_moved,
    simulate_force,
)
from .unmodelled import unmodelled_effects

_AREAS = "area * pressure - area_2 * pressure_2"
_PRESSURE = Role(
    "pressure", "Pa", "pressure whose force is not friction", required=False, gauge=True
)
# with a hold, --step can stand for a pressure of which only the levels are known
_OTHER = Role(
    "pressure_2", "Pa", "pressure of the other chamber", required=False, hold="auto", gauge=True,
    opposes=True,
)  # fmt: skip


def _parameters(axis: Axis) -> tuple[ParameterSpec, ...]:
    """The friction of an axis."""
    spec = partial(ParameterSpec, neutral=0.0, minimum=0.0)
    sides = [(s, f", {s} direction") for s in SIDES]
    return (
        spec("viscous", axis.viscous, "viscous friction", optional=True,
             remedy="Add one stroke, or one log, at another speed in the same direction: "
             f"{SECOND_SPEED:g} times faster or more."),
        *(
            spec(f"viscous_{s}", axis.viscous, f"viscous friction{of}", optional=True,
                 general="viscous", remedy=f"Record strokes in the {s} direction at two speeds, "
                 f"one of them {SECOND_SPEED:g} times the other or more.")
            for s, of in sides
        ),
        *(
            spec(f"coulomb_{s}", axis.force_unit, f"kinetic friction{of} (magnitude)",
                 remedy=f"Record at least one stroke in the {s} direction, at steady speed.")
            for s, of in sides
        ),
        *stribeck_specs(axis.force_unit, axis.speed_unit),
    )  # fmt: skip


def _variant(axis: Axis, motion: str, pressures: bool = False) -> Variant:
    """Speed or place as the motion, which the force, the torque or the pressures drive."""
    unit = axis.place_unit if is_place(motion) else axis.speed_unit
    roles = [
        Role("time", "s", "time of each sample", required=is_place(motion)),
        Role(motion, unit, f"{motion.replace('_', ' ')} of the {axis.body}"),
    ]
    driven = f"{axis.drive} - ({_AREAS})" if axis is LINEAR else axis.drive
    if pressures:
        driven, motion = _AREAS, motion + PRESSURES
        words = "pressure that drives positive motion (with --area)"
        roles += [replace(_PRESSURE, description=words, required=True, output=True), _OTHER]
    else:
        words = f"{axis.drive} that drives the motion, positive along positive {axis.speed_words}"
        roles.insert(1, Role(axis.drive, axis.force_unit, words, output=True))
        roles += [_PRESSURE, _OTHER] if axis is LINEAR else []
    return Variant(motion, tuple(roles), _parameters(axis), equation=_equation(axis, driven))


def _equation(axis: Axis, driven: str) -> str:
    return (
        f"{driven} - {axis.inertia} * acceleration = "
        "coulomb_positive [v > 0] - coulomb_negative [v < 0] + viscous * v "
        f"(+ sign(v) * stribeck * exp(-v^2 / stribeck_speed^2)), v the {axis.speed_words}"
    )


class CylinderFriction(Family[FrictionOptions]):
    """Coulomb and viscous friction of a cylinder or shaft by regression on moving samples."""

    name = "cylinder-friction"
    title = "Friction of a cylinder: Coulomb levels by direction and viscous friction"
    equation = (
        f"{_equation(LINEAR, f'force - ({_AREAS})')}; without a force, {_AREAS} drives, and with "
        "--pressures=drive against the force of a load; torque, inertia and angular velocity of a "
        "shaft alike"
    )
    variants = tuple(
        _variant(axis, motion, pressures)
        for axis, pressures in ((LINEAR, False), (LINEAR, True), (ROTARY, False))
        for motion in (axis.speed, axis.place)
    )
    options_type = FrictionOptions
    block_type = FrictionBlock
    structures = FRICTION_STRUCTURES
    steady_offset = True

    def estimate(
        self,
        variant: Variant,
        experiments: Sequence[Experiment],
        request: Request[FrictionOptions],
    ) -> Solution[FrictionOptions]:
        """Fit levels and viscous friction; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        data, options = prepare(variant, experiments, request.options)
        kept = [sum(d.kept.size for d in data), count_kept(data)]
        sides_moved(data)
        check_measured(data)
        data, options, notices = leave_out_accelerations(data, options)
        kept.append(count_kept(data))
        data, options = leave_out_turns(data, options)
        kept.append(count_kept(data))
        fit = FrictionFit(variant, data, replace(request, options=options))
        notices += [*fit.notices, *fit_notices(fit)]
        causes = ("slow_or_reversing", "accelerating", "turning")
        left_out = {cause: a - b for cause, a, b in zip(causes, kept, kept[1:])}
        parameters, order, matrix = fit.solved.quantities(variant.parameters)
        noise = NoiseModel(matrix, fit.solved.independent)
        simulate = partial(simulate_force, known=[d.motion for d in data])
        return make_solution(
            simulate, experiments, variant, fit.options, parameters, order, noise,
            derived=fit.derived(), notices=notices, covered=fit.covered,
            details=fit_details(fit, left_out),
        )  # fmt: skip

    def simulate(
        self,
        plant: Plant[FrictionOptions],
        experiments: Sequence[Experiment],
        offset: float | None = None,
    ) -> list[Simulated]:
        """Force needed for the motion of every run; see :meth:`Family.simulate`."""
        return simulate_force(plant, experiments, offset)

    def information(self, plant: Plant[FrictionOptions], experiment: Experiment) -> Information:
        """Sensitivities of a motion; see :meth:`Family.information`.

        The rows are those of the force before any filter, at the samples that a fit would
        keep. Without the mass they are those of steady speed. Speeds other than those of the
        file are as good.
        """
        moved = self.variant(motion_role(plant.variant))
        free = replace(
            plant.options.unpressed, acceleration_limit=None, turn_limit=None, force_offset=None
        )
        (d,), _ = prepare(moved, [experiment], free)
        if free.moved is None:
            slope = np.abs(d.motion.acceleration)
            d = replace(d, kept=d.kept & (slope <= 0.01 * float(slope.max())))
        law, v = FrictionLaw.of(plant.numbers), d.motion.sharp
        rise, sign = Rise(law.stribeck, law.stribeck_speed), np.sign(v)
        columns = friction_columns(sign, v, rise.columns(sign, v))
        names = (*free.rates, *LEVELS, *(STRIBECK if min(rise.level, rise.speed) > 0.0 else ()))
        rows = np.column_stack([d.kept * columns[n] for n in names])
        return Information(names, rows, law.moving(v))

    def excitation(self, variant: Variant, document: ParameterDocument) -> Excitation:
        """Strokes at constant speeds; see :meth:`Family.excitation`.

        Slow ones keep clear of the dead band by as much again, to allow for noise.
        """
        options = document.settled_options(FrictionOptions).unpressed
        details = document.fit.details or {}
        speed = document.validity.get(axis_of(variant).speed)
        noise: Any = details.get("force_noise")
        if not isinstance(noise, float):
            return Excitation("none", "the file does not say how much noise its logs had "
                              "(fit.details.force_noise)")  # fmt: skip
        fast = max(-speed.low, speed.high) if speed else 0.0
        if not is_place(motion_role(variant)):  # what noise the filter met, a design has not
            options = replace(options, filter=None)
        return Excitation(
            "strokes",
            fastest=(-fast, fast),
            slowest=2.0 * (options.deadband or 0.0),
            noise=abs(noise),
            options=options,
        )

    def prior_guess(
        self,
        name: str,
        plant: Plant[FrictionOptions],
        amplitude: tuple[float, float],
        sample_time: float,
    ) -> float | None:
        """Assume the values of the other direction; no viscous friction at all, and no rise."""
        pair = next((names for names in (LEVELS, ONE_SIDED) if name in names), ())
        return max((plant.numbers[n] for n in pair), default=0.0)

    def unmodelled_effects(self, plant: Plant[FrictionOptions]) -> Sequence[UnmodelledEffect]:
        """Forces along the travel; see :meth:`Family.unmodelled_effects`."""
        return list(unmodelled_effects(plant))

    def derived(self, values: Mapping[str, Any], options: FrictionOptions) -> Mapping[str, Any]:
        """Mean of the Coulomb levels, half their difference; see :meth:`Family.derived`."""
        return mean_and_offset(values)

    def model(
        self, plant: Plant[FrictionOptions], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """The static map for feed-forward compensation."""
        viscous, axis = "viscous*v", axis_of(plant.variant)
        if plant.options.viscous == "asymmetric":
            viscous = "viscous_positive*v*(v>0) + viscous_negative*v*(v<0)"
        return {
            "friction": {
                "equation": f"coulomb_positive*(v>0) - coulomb_negative*(v<0) + {viscous}"
                + rise_words(plant.values, "sign(v)"),
                "input": {"name": axis.speed, "unit": axis.speed_unit},
                "output": {"name": axis.drive, "unit": axis.force_unit},
                **plant.numbers,
            }
        }

    def static_view(self, plant: Plant[FrictionOptions], runs: Runs) -> StaticView:
        """Friction over velocity: drive less pressure, inertia and offset, and the fitted lines."""
        axis = axis_of(plant.variant)
        data, _ = prepare(plant.variant, [e for e, _ in runs], plant.options)
        law = FrictionLaw.of(plant.numbers)
        v = np.concatenate([d.motion.sharp for d in data])
        used = np.concatenate([d.kept for d in data])
        offsets = [d.scale * (s.offset or 0.0) for d, (_, s) in zip(data, runs)]
        friction = np.concatenate([d.friction - c for d, c in zip(data, offsets)])
        lines = []
        for side, sign in zip(SIDES, (1.0, -1.0)):
            speeds = sign * v[used]
            if np.any(speeds > 0.0):
                x = sign * np.linspace(0.0, speeds.max(), 200 if law.curved else 2)
                lines.append(Curve(f"fitted, {side}", x, law.moving(x, np.full(x.size, sign))))
        return StaticView(
            axis.speed_words, axis.speed_unit, "friction", axis.force_unit,
            v, friction, law.moving(v), used, lines,
        )  # fmt: skip
