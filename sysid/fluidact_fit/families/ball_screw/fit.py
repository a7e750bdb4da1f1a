"""One fit: stages, static levels, forces beyond the model, and what stands in the file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...estimation.named_model import check_request
from ...estimation.parametric import Fitted, fit_named
from ...experiment import Experiment, FloatArray
from ...family import NoiseModel, Request, Simulate, Solution, Variant, make_solution
from .beyond import (
    BEYOND_HELP,
    DECISIVE,
    DECISIVE_HELD,
    beyond_notice,
    residual_to_noise,
    with_derivatives,
)
from .brackets import Bracket, bracket_levels, narrow_levels
from .drive_errors import warn_of_held_noise, with_drive_errors
from .model import BREAKAWAY, EXCESS, SIDES, SPEED, Compared, DriveModel, axis_of
from .options import BallScrewOptions
from .reported import derived_numbers, in_levels, refusal_notices, specs_of_file, with_brackets
from .stages import (
    Stage,
    excess_specs,
    first_stages,
    with_high_levels,
    without_idle_levels,
)
from .stribeck import (
    fastest,
    inside_cells,
    undetermined,
    with_curve,
    with_levels,
    without_curve,
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


def fit_drive(
    variant: Variant,
    experiments: Sequence[Experiment],
    request: Request[BallScrewOptions],
    simulate: Simulate,
) -> Solution[BallScrewOptions]:
    """Fit inertia and friction of a drive, in three stages; see :meth:`.Family.estimate`."""
    check_request(variant.parameters, request)
    axis = axis_of(variant)
    one_sided = request.options.viscous == "asymmetric"
    stage = first_stages(variant, experiments, request, one_sided)
    if request.options.stribeck == "none" or SPEED in request.fixed:
        ready = _levels_and_forces(without_idle_levels(stage), request)
        if ready.beyond and request.options.compared is None:
            # a search that began beside a static level may never have broken away there
            again = _levels_and_forces(with_high_levels(stage), request)
            ready = ready if again.beyond else again
        return _finish(_fit_position(variant, ready, request), variant, request, simulate)
    units = variant.parameter(SPEED).unit, variant.parameter("coulomb_positive").unit
    refusal = without_level(stage)
    if refusal is None:
        request.progress("looking for the fall of friction at low speed")
        curve = without_idle_levels(with_curve(stage, request))
        refusal = None if SPEED in request.bounds else without_curve(curve, units[0])
    if refusal is None:
        curved = _levels_and_forces(curve, request)
        refusal = without_level(curved.stage)
    if refusal is None:
        found = _fit_position(variant, curved, request)
        refusal = undetermined(found.fitted, fastest(experiments, axis), *units)
    if refusal is None:
        return _finish(found, variant, request, simulate)
    plain = replace(without_idle_levels(stage), names=(*stage.names, SPEED)).refuse(refusal)
    found = _fit_position(variant, _levels_and_forces(plain, request), request)
    return _finish(found, variant, request, simulate)


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
    found: _Found,
    variant: Variant,
    request: Request[BallScrewOptions],
    simulate: Simulate,
) -> Solution[BallScrewOptions]:
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
    options = replace(request.options, compared="derivatives" if beyond else "position")
    return make_solution(
        simulate,
        experiments,
        variant,
        options,
        parameters,
        order,
        NoiseModel(covariance, solved.degrees),
        jacobians=[{variant.output.name: j} for j in fitted.sensitivity()],
        derived=derived_numbers(solved, stage.axis.inertia, variant.role(stage.axis.drive).unit),
        notices=notices,
        details={**fitted.details(), **table, "stages": ["inverse dynamics", "increments", last]},
    )


def _levels_and_forces(stage: Stage, request: Request[BallScrewOptions]) -> _Ready:
    """Bracket the static levels where that can be done, and weigh what the model leaves out.

    Once forces beyond the model decide the instant of break-away, no level is left to
    bracket and it is refused. A file says which of both it was.
    """
    request.progress("fitting positions")
    known = request.options.compared

    def weigh(at: Stage) -> tuple[float, Stage]:
        return residual_to_noise(at) if known is None else (0.0, at)

    brackets: dict[str, Bracket] = {}
    held, stepped = stage, stage.stepped
    if stepped and stage.curved and stage.open_sides() and known != "derivatives":
        held, brackets = inside_cells(stage)
    elif stepped and not stage.curved and known != "derivatives":
        request.progress("bracketing the static levels")
        held, brackets = bracket_levels(stage)
    ratio, moved = weigh(held)
    if brackets and ratio < BEYOND_HELP and not stage.curved:
        held, brackets = narrow_levels(held, brackets)
        ratio, moved = weigh(held)
    beyond = known == "derivatives" or ratio > (DECISIVE_HELD if brackets else DECISIVE)
    if brackets and not beyond and _unknown(stage):
        excesses = {s: brackets[b].value - held.start[f"coulomb_{s}"] for s, b in BREAKAWAY.items()
                    if b in brackets}  # fmt: skip
        return _Ready(stage.refuse_levels(LOST_ROWS, list(excesses), excesses), {}, False)
    if not beyond:  # the last fit goes on from there, unless the curve was lost on the way
        return _Ready(moved if moved.curved == held.curved else held, brackets, False)
    if not stepped:
        return _Ready(held, {}, True)
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
