"""One fit: static levels, forces beyond the model, the last search, and what stands in the file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import Notice
from ...estimation.named_model import Values, check_request
from ...estimation.parametric import Fitted, fit_named
from ...estimation.profile_likelihood import Interval
from ...estimation.results import Refusal, Solved, refuse
from ...experiment import Experiment, FloatArray
from ...family import (
    NoiseModel,
    ParameterSpec,
    Request,
    Simulate,
    Solution,
    Variant,
    make_solution,
)
from ...mechanics.friction_law import mean_and_offset, unequal_levels
from .drive_record import drive_notices, with_drive_errors
from .levels import Bracket, find_levels, refine_levels
from .model import BREAKAWAY, SIDES, SPEED, BallScrewOptions, Compared, DriveModel
from .start import Stage, fastest, first_stage, without_idle_levels
from .stribeck import undetermined, with_curve, without_level
from .unmodelled_forces import (
    DECISIVE,
    DECISIVE_HELD,
    residual_to_noise,
    unmodelled_forces_notice,
    with_derivatives,
)

UNKNOWN_FORCES = (
    "the motion is dominated by forces beyond this model, which move the instant of "
    "break-away more than the static level does."
)


def fit_drive(
    variant: Variant, experiments: Sequence[Experiment], request: Request[BallScrewOptions],
    simulate: Simulate,
) -> Solution[BallScrewOptions]:  # fmt: skip
    """Fit inertia and friction of a drive; see :meth:`.Family.estimate`."""
    check_request(variant.parameters, request)
    one_sided = request.options.viscous == "asymmetric"
    stage = first_stage(variant, experiments, request, one_sided)
    request.progress("looking for the static levels")
    stage, brackets = find_levels(stage)
    plain = without_idle_levels(stage)
    if request.options.stribeck == "estimate" and SPEED not in request.fixed:
        units = variant.parameter(SPEED).unit, variant.parameter("coulomb_positive").unit
        refusal = without_level(stage)
        if refusal is None:
            request.progress("looking for the fall of friction at low speed")
            curve = without_idle_levels(with_curve(stage, request))
            refusal = without_level(curve)
        if refusal is None:
            found = _fit_position(variant, curve, {}, request)
            top = fastest(experiments, stage.axis)
            refusal = undetermined(found.fitted, top, *units)
        if refusal is None:
            return _finish(found, variant, request, simulate)
        plain = replace(plain, names=(*plain.names, SPEED)).refuse(refusal)
    plain, brackets = refine_levels(plain, brackets)
    found = _fit_position(variant, plain, brackets, request)
    return _finish(found, variant, request, simulate)


@dataclass(frozen=True)
class _Found:
    """A fit of the position; speed and acceleration count as well under forces ``beyond`` it."""

    stage: Stage
    brackets: Mapping[str, Bracket]
    fitted: Fitted
    beyond: bool


def _fit_position(
    variant: Variant, stage: Stage, brackets: Mapping[str, Bracket],
    request: Request[BallScrewOptions],
) -> _Found:  # fmt: skip
    """Fit the position, and speed and acceleration beside it where forces are beyond the model.

    Once these decide the instants of break-away, no level is left to bracket and it is refused.
    """
    request.progress("fitting positions")
    opened = [BREAKAWAY[s] for s in stage.open_sides()]
    inside = {} if stage.curved else {n: b for n, b in brackets.items() if n in opened}
    held = {n: b.value for n, b in inside.items()}
    begin = replace(stage, fixed={**stage.fixed, **held})
    beyond = request.options.compared == "derivatives"
    if request.options.compared is None:
        ratio, begin = residual_to_noise(begin)
        beyond = ratio > (DECISIVE_HELD if inside else DECISIVE)
    compared, weights = Compared(), list[FloatArray]()
    if beyond:
        request.progress("forces beyond the model: comparing speed and acceleration too")
        if stage.stepped and not stage.curved:
            inside, begin = {}, stage.refuse_levels(UNKNOWN_FORCES, stage.open_sides())
        compared, weights = with_derivatives(begin)
    drive = DriveModel(begin.experiments, begin.axis, compared)
    model = replace(
        drive.named(begin.names, weights),
        sigma_floor=0.0 if beyond else begin.rounding,
        channels=[compared.channels(e.samples) for e in begin.experiments],
    )
    fitted = fit_named(
        model,
        variant.parameters,
        replace(request, fixed=begin.fixed, start={}),
        begin.unknowns,
        [begin.start],
        refusals=begin.refusals,
        max_half_widths=_max_half_widths(begin),
    )
    return _Found(begin, inside, fitted, beyond)


def _finish(
    found: _Found, variant: Variant, request: Request[BallScrewOptions], simulate: Simulate
) -> Solution[BallScrewOptions]:
    """Entries of the file, with the errors of the drive in their intervals, and notices."""
    stage, beyond = found.stage, found.beyond
    experiments = stage.experiments
    fitted = found.fitted
    if not beyond:  # otherwise residuals come from forces that the model lacks, and it is warned
        fitted = with_drive_errors(fitted, stage.axis, experiments, request.seed)
    noisy = drive_notices(stage.axis, experiments, None if beyond else fitted, request.seed)
    fitted = as_written(fitted)
    solved = with_brackets(fitted, found.brackets)
    parameters, order, covariance = solved.quantities(
        specs_of_file(variant, fitted.values, stage.resting)
    )
    table, drift = fitted.compare_logs(experiments)
    drive = stage.axis.drive
    unit = variant.role(drive).unit
    units = {"coulomb_mean": unit, "coulomb_offset": unit, "time_constant": "s"}
    derived = solved.derive(units, derived_numbers)
    last = "position, speed and acceleration" if beyond else "position"
    unequal = unequal_levels(
        derived, drive, "the zero of the amplifier or sensor, weight",
        f"Log the {drive} at rest, unloaded: if it shows zero, the levels do differ.",
    )  # fmt: skip
    notices = [
        *refusal_notices(variant, fitted.refused, stage.resting),
        *drift,
        *noisy,
        *([unmodelled_forces_notice(SPEED in parameters)] if beyond else []),
        *(Notice("levels-or-offset", text) for text in unequal),
    ]
    return make_solution(
        simulate,
        experiments,
        variant,
        replace(request.options, compared="derivatives" if beyond else "position"),
        parameters,
        order,
        NoiseModel(covariance),
        jacobians=[{variant.output.name: j} for j in fitted.sensitivity()],
        derived=derived,
        notices=notices,
        details={**fitted.details(), **table, "stages": ["inverse dynamics", "levels", last]},
    )


def _max_half_widths(stage: Stage) -> dict[str, float]:
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


def as_written(fitted: Fitted) -> Fitted:
    """Return the fit with refused values as in the file, not as they were held to rest."""
    refused = {n: replace(r, hold=None) for n, r in fitted.refused.items()}
    neutral = {n: r.value(fitted.specs[n]) for n, r in refused.items()}
    return replace(fitted, values={**fitted.values, **neutral}, refused=refused)


def with_brackets(solved: Solved, brackets: Mapping[str, Bracket]) -> Solved:
    """Bracketed levels, which were held in the fit, among the estimates."""
    size = len(solved.names)
    found = {n: Interval(b.low, b.high, "bracket") for n, b in brackets.items()}
    covariance = np.diag([0.0] * size + [b.std_error**2 for b in brackets.values()])
    covariance[:size, :size] = solved.covariance
    return replace(
        solved,
        names=(*solved.names, *brackets),
        covariance=covariance,
        fixed={n: v for n, v in solved.fixed.items() if n not in brackets},
        intervals={**solved.intervals, **found},
    )


def specs_of_file(
    variant: Variant, values: Mapping[str, float], resting: Mapping[str, float]
) -> list[ParameterSpec]:
    """Parameters of the file; a static level that is not known has one all the same.

    The kinetic level is the least that it can be, and where nothing ever moved, the
    strongest push that the axis withstood (``resting``, by direction).
    """
    neutral = {BREAKAWAY[s]: max(values[f"coulomb_{s}"], resting.get(s, 0.0)) for s in SIDES}
    return [
        replace(spec, neutral=neutral.get(spec.name, spec.neutral)) for spec in variant.parameters
    ]


def refusal_notices(
    variant: Variant, refused: Mapping[str, Refusal], resting: Mapping[str, float]
) -> list[Notice]:
    """Notices of what was refused, in the words of the file."""
    written = dict.fromkeys(BREAKAWAY.values(), "the kinetic level")
    for s, push in resting.items():
        if push > 0.0:
            written[BREAKAWAY[s]] = "the strongest push that the axis withstood"
    return [refuse(variant.parameter(n), r.reason, written.get(n, "")) for n, r in refused.items()]


def derived_numbers(values: Values) -> Values:
    """Mean of the kinetic levels and half their difference, and the time constant of coasting."""
    levels, viscous = mean_and_offset(values), values.get("viscous", 0.0)
    if np.real(viscous) <= 0.0:
        return levels
    return {**levels, "time_constant": values["mass" if "mass" in values else "inertia"] / viscous}
