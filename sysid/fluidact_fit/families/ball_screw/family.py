"""Ball-screw (or any) drive: inertia, viscous friction and four Coulomb levels.

    J theta'' = tau - b theta' - F_k(sign theta')       moving
    theta' = 0 while -F_s- <= tau <= F_s+               stuck

Kinetic and static level may differ and both may differ by direction [1]_. Friction falls from the
one to the other at once when the axis moves, or with ``--stribeck estimate`` over the speed:
``F = F_k + (F_s - F_k) exp(-(theta' / v_s)^2)``. A linear axis is the same with mass, force and
position. The motion is solved with events (:mod:`.stick_slip`, :mod:`.curved`); nothing is smoothed
in the estimate.

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

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ...estimation.information import sensitivity
from ...estimation.inputs import settled_hold
from ...estimation.parametric import Fitted, bind, check_request, fit_named
from ...estimation.separable import solve
from ...experiment import Experiment, FloatArray, Hold
from ...family import (
    Estimate,
    Excitation,
    Family,
    FamilyOptions,
    Information,
    ParameterDocument,
    ParameterSpec,
    Plant,
    Request,
    Role,
    Simulated,
    Variant,
)
from ...options import choice, settled
from .beyond import BEYOND_HELP, DECISIVE, beyond_notice, residual_to_noise, with_derivatives
from .block import DriveBlock
from .brackets import Bracket, bracket_levels, bracket_widths, narrow_levels
from .drive_errors import warn_of_held_noise, with_drive_errors
from .model import (
    BREAKAWAY,
    EXCESS,
    LINEAR,
    ROTARY,
    SIDES,
    SPEED,
    Axis,
    Compared,
    DriveModel,
    axis_of,
)
from .reported import derived_numbers, in_levels, refusal_notices, specs_of_file, with_brackets
from .stages import Stage, excess_specs, first_stages, initial_speeds, speed_unknowns
from .stribeck import (
    fastest,
    inside_cells,
    undetermined,
    with_curve,
    with_levels,
    without_level,
)

UNKNOWN_FORCES = (
    "the motion is dominated by forces beyond this model, which move the instant of "
    "break-away more than the static level does."
)
LOST_ROWS = (
    "rows are missing from the log, between which the drive jumps: it is not known what it was "
    "when the axis broke away."
)
_ELSEWHERE = (0.05, 0.2, 0.5)  # excess of a static level over the kinetic one
_KNOWN = 0.02  # of a kinetic level, to which a drive in lost rows has to be known


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
                            neutral=0.0, minimum=0.0, optional=True,
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
    )  # fmt: skip


@dataclass(frozen=True)
class BallScrewOptions(FamilyOptions):
    """Symmetry of the friction, and what the fit compares."""

    viscous: str = choice(
        "symmetric", ("symmetric", "asymmetric"), "one viscous value, or one per direction"
    )
    stribeck: str = choice(
        "none",
        ("none", "estimate"),
        "whether to estimate how friction rises at low speed",
        SPEED,
    )
    compared: str | None = settled(
        "choice", "whether speed and acceleration were compared beside the position",
        choices=("position", "derivatives"),
    )  # fmt: skip


class BallScrew(Family[BallScrewOptions]):
    """Stick-slip drive with asymmetric kinetic and static friction."""

    name = "ball-screw"
    title = "Ball-screw drive: inertia, viscous friction and four Coulomb levels"
    equation = (
        "inertia * angle'' = torque - viscous * angle' - friction(direction), stuck below "
        "breakaway; friction = coulomb + (breakaway - coulomb) * exp(-(angle' / stribeck_speed)^2)"
    )
    variants = (
        _variant("rotary", ROTARY, "N m", "rad", "kg m2", "N m s/rad"),
        _variant("linear", LINEAR, "N", "m", "kg", "N s/m"),
    )
    options_type = BallScrewOptions

    def estimate(
        self,
        variant: Variant,
        experiments: Sequence[Experiment],
        request: Request[BallScrewOptions],
    ) -> Estimate[BallScrewOptions]:
        """Fit inertia and friction in three stages; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        axis = axis_of(variant)
        one_sided = request.options.viscous == "asymmetric"
        stage = first_stages(variant, experiments, request, one_sided)
        if request.options.stribeck == "none" or SPEED in request.fixed:
            found = _fit_position(variant, _levels_and_forces(stage, request), request)
            return _finish(found, variant, request)
        refusal = without_level(stage)
        if refusal is None:
            request.progress("looking for the fall of friction at low speed")
            curved = _levels_and_forces(with_curve(stage, request), request)
            refusal = without_level(curved.stage)
        if refusal is None:
            found = _fit_position(variant, curved, request)
            unit = variant.parameter(SPEED).unit
            refusal = undetermined(found.fitted, fastest(experiments, axis), unit)
        if refusal is None:
            return _finish(found, variant, request)
        plain = replace(stage, names=(*stage.names, SPEED)).refuse(refusal)
        found = _fit_position(variant, _levels_and_forces(plain, request), request)
        return _finish(found, variant, request)

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

    def excitation(self, variant: Variant, document: ParameterDocument) -> Excitation:
        """A torque or force, played to the drive; see :meth:`Family.excitation`."""
        return Excitation("command")

    def suppose(
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

    def block(self, variant: Variant, document: ParameterDocument) -> DriveBlock:
        """The drive that a controller steps; see :class:`DriveBlock`."""
        return DriveBlock(document, variant)


@dataclass(frozen=True)
class _Ready:
    """What is known before the last fit: brackets of static levels, and forces beyond the model."""

    stage: Stage
    brackets: Mapping[str, Bracket]
    beyond: bool


@dataclass(frozen=True)
class _Found:
    """A finished fit of the position, and what was compared in it."""

    ready: _Ready
    fitted: Fitted
    drive: DriveModel
    weights: Sequence[FloatArray]


def _fit_position(variant: Variant, ready: _Ready, request: Request[BallScrewOptions]) -> _Found:
    """Fit the position, and speed and acceleration beside it where forces are beyond the model."""
    stage, brackets, beyond = ready.stage, ready.brackets, ready.beyond
    compared, weights = Compared(), list[FloatArray]()
    if beyond:
        request.progress("forces beyond the model: comparing speed and acceleration too")
        compared, weights = with_derivatives(stage)
    drive = DriveModel(stage.experiments, stage.axis, compared)
    model = replace(
        drive.named(stage.names, weights),
        sigma_floor=0.0 if beyond else stage.rounding,
        channels=[compared.channels(e.samples) for e in stage.experiments],
    )
    fit = partial(
        fit_named,
        model,
        [*variant.parameters, *excess_specs(variant)],
        replace(request, fixed=stage.fixed),
        stage.unknowns,
        refusals=stage.refusals,
        sensible=_sensible(stage),
    )
    fitted = fit([stage.start])
    if lost := [s for s in stage.open_sides() if EXCESS[s] in fitted.refused]:
        request.progress(f"looking again for the static levels: {', '.join(lost)}")
        fitted = fit([stage.start, *_levels_elsewhere(fitted.values, lost)])
    if brackets and stage.curved:
        fitted, brackets = with_levels(fitted, model, drive, brackets), {}
    return _Found(_Ready(stage, brackets, beyond), fitted, drive, weights)


def _finish(
    found: _Found, variant: Variant, request: Request[BallScrewOptions]
) -> Estimate[BallScrewOptions]:
    """What stands in the file: levels for excesses, errors of the drive, and what to say."""
    stage, drive, beyond = found.ready.stage, found.drive, found.ready.beyond
    experiments = stage.experiments
    fitted = in_levels(
        with_drive_errors(found.fitted, drive, experiments, found.weights, request.seed)
    )
    solved = with_brackets(fitted, found.ready.brackets)
    parameters, order, covariance = solved.quantities(
        specs_of_file(variant, fitted.values, stage.resting)
    )
    table, drift = fitted.compare_logs(experiments)
    last = "position, speed and acceleration" if beyond else "position"
    notices = [
        *refusal_notices(variant, fitted.refused, stage.resting),
        *drift,
        *warn_of_held_noise(stage.axis, experiments),
        *([beyond_notice(parameters)] if beyond else []),
    ]
    return Estimate(
        parameters,
        derived_numbers(solved, stage.axis.inertia, variant.role(stage.axis.drive).unit),
        order,
        covariance,
        replace(request.options, compared="derivatives" if beyond else "position"),
        notices,
        {**fitted.details(), **table, "stages": ["inverse dynamics", "increments", last]},
        fitted.sensitivity(),
    )


def _follow(
    experiment: Experiment, axis: Axis, values: Mapping[str, float], place: float
) -> Simulated:
    """Follow the motion of a run; without a record it starts at rest at ``place`` [SI]."""
    model = DriveModel([experiment], axis)
    if axis.motion not in experiment:
        return Simulated(model.columns(0, values).known + place, offset=place)
    moving = initial_speeds([experiment], axis)
    named = model.named([*values, *moving])
    found = solve(bind(named, speed_unknowns(moving), values), np.array([*moving.values()]))
    return Simulated(found.simulated[0], offset=float(found.local[0][0]))


def _levels_and_forces(stage: Stage, request: Request[BallScrewOptions]) -> _Ready:
    """Bracket the static levels where that can be done, and weigh what the model leaves out.

    Once forces beyond the model decide the instant of break-away, no level is left to
    bracket and it is refused. A file says which of both it was.
    """
    request.progress("fitting positions")
    known = request.options.compared
    brackets: dict[str, Bracket] = {}
    held, stepped = stage, stage.stepped
    if stepped and stage.curved and stage.open_sides() and known != "derivatives":
        held, brackets = inside_cells(stage)
    elif stepped and not stage.curved and known != "derivatives":
        request.progress("bracketing the static levels")
        held, brackets = bracket_levels(stage)
    ratio = residual_to_noise(held) if known is None else 0.0
    if brackets and ratio < BEYOND_HELP and not stage.curved:
        held, brackets = narrow_levels(held, brackets)
        ratio = residual_to_noise(held) if known is None else 0.0
    beyond = known == "derivatives" or ratio > DECISIVE
    if brackets and not beyond and _unknown(stage):
        excesses = {s: brackets[b].value - held.start[f"coulomb_{s}"] for s, b in BREAKAWAY.items()
                    if b in brackets}  # fmt: skip
        return _Ready(stage.refuse_levels(LOST_ROWS, list(excesses), excesses), {}, False)
    if not (beyond and stepped):
        return _Ready(held, brackets, beyond)
    return _Ready(stage.refuse_levels(UNKNOWN_FORCES, stage.open_sides()), {}, True)


def _unknown(stage: Stage) -> bool:
    """Whether rows were lost in which the drive may have been below or above a static level."""
    levels = (stage.start[f"coulomb_{s}"] for s in SIDES)
    return stage.unknown_drive > _KNOWN * min(levels)


def _levels_elsewhere(
    values: Mapping[str, float], sides: Sequence[str]
) -> Iterator[dict[str, float]]:
    """Starts beside a fit in which a static level slid to where no event shows it any more."""
    for ratio in _ELSEWHERE:
        yield {**values, **{EXCESS[s]: ratio * values[f"coulomb_{s}"] for s in sides}}


def _sensible(stage: Stage) -> dict[str, float]:
    """Half-widths of intervals that say nothing.

    Viscous friction that alone would use up the whole drive at the highest speed is one.
    """
    speed = fastest(stage.experiments, stage.axis)
    out = dict.fromkeys(stage.unknowns, stage.largest_drive)
    for n in out:
        if n.startswith("viscous"):
            out[n] = stage.largest_drive / max(speed, 1e-300)
        if n.startswith("initial_speed") or n == SPEED:
            out[n] = np.inf
    return {**out, stage.axis.inertia: stage.start[stage.axis.inertia]}
