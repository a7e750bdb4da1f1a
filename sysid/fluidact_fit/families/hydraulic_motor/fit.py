"""Fit of a motor to logs: with a saturation where the speeds show one, else without."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TypeVar

import numpy as np

from ...errors import LogError, NotIdentifiedError
from ...estimation.named_map import NamedFit
from ...estimation.named_model import NamedModel, Values, bind
from ...estimation.response import Response, fit_response
from ...estimation.response_model import (
    Beginning,
    Plan,
    ResponseOptions,
    ResponseTask,
    Searched,
)
from ...estimation.results import Refusal, Solved
from ...estimation.separable import profile, solve
from ...estimation.significance import DECISIVE
from ...estimation.starts import time_scales
from ...estimation.transfer_model import ANY, TransferResponse
from ...experiment import Experiment
from ...options import choice
from ...signals import rise_and_fall
from ...specification import Plant, Request, Simulated, Variant
from .equation import MotorModel, SettledModel

STATIC = "static"
SATURATION, OFFSET = "saturation_command", "command_offset"
EDGES = ("dead_zone_negative", "dead_zone_positive")
_TRIFLE = 0.02  # of the motion in one direction: less of the other may be the zero of a sensor
_EXCLUDED = 4.0  # variances by which residuals rise with a saturation that is ruled out
_MATTERS = 3.0  # standard errors by which one that is not would move a parameter
_BEST = 3  # starts of a search
_BENDS = (0.97, 0.93, 0.89, 0.85, 0.8, 0.75, 0.7, 0.6, 0.5, 0.4)  # shares of the highest command
_MIDDLES = (0.0, -0.15, 0.15, -0.3, 0.3, -0.5, 0.5)  # shares of it, about their middle
_SHARES = {  # of the highest command, of one over it for the curvature
    **dict.fromkeys(("dead_zone", *EDGES), (0.05, 0.3, 0.65)),
    SATURATION: (0.9, 0.7, 0.4),
    "curvature": (0.3, 3.0),
    "hysteresis": (0.03, 0.2),
}
_OTHER_EDGES = (  # where a search is begun again, in parts of the values that it has ended at
    (("hysteresis",), 0.25),
    ((SATURATION,), 0.75),
    (("dead_zone", *EDGES), 1.3),
)


@dataclass(frozen=True)
class MotorOptions(ResponseOptions):
    """Options: what is estimated beside the curve and the lag."""

    mode: str = choice(
        "dynamic", ("dynamic", "static"),
        "whether the rows are samples in time or settled points, in the order recorded",
    )  # fmt: skip
    dead_zone: str = choice(
        "symmetric", ("symmetric", "asymmetric"), "one dead zone, or an edge for each direction",
        "dead_zone_positive",
    )  # fmt: skip
    command_offset: str = choice(
        "none", ("none", "estimate"),
        "whether to estimate the command at which the motor stands still (1500 us of a servo)",
        "command_offset",
    )  # fmt: skip
    dead_time: str = choice(
        "estimate", ("none", "estimate"), "whether to estimate a dead time", "dead_time"
    )


def highest_command(experiments: Sequence[Experiment], offset: float) -> float:
    """Largest distance of the command from its offset in any log [unit of the command]."""
    return max(float(np.abs(e.sampled("command") - offset).max()) for e in experiments)


def command_range(experiments: Sequence[Experiment]) -> tuple[float, float]:
    """Lowest and highest command of all logs [its unit]."""
    commands = [e.sampled("command") for e in experiments]
    return min(float(u.min()) for u in commands), max(float(u.max()) for u in commands)


def middle_of_commands(experiments: Sequence[Experiment], request: Request[MotorOptions]) -> float:
    """Offset of the command as far as it is known before a search [unit of the command]."""
    known = {**request.start, **request.fixed}
    if OFFSET in known or request.options.command_offset == "none":
        return known.get(OFFSET, 0.0)
    return 0.5 * sum(command_range(experiments))


def output_of(experiments: Sequence[Experiment]) -> str:
    """Role of the output, the only one besides the command."""
    return next(role for role in experiments[0].signals if role != "command")


def edge_names(options: MotorOptions) -> tuple[str, ...]:
    """Parameters that the dead zone has."""
    return EDGES if options.dead_zone == "asymmetric" else ("dead_zone",)


class MotorResponse(TransferResponse[MotorOptions]):
    """Declaration of the motor: its models, what is searched for, and from where."""

    gain, robust, common_offset, many_minima = "gain", True, False, True

    def transfer_model(
        self, variant: Variant, experiments: Sequence[Experiment], begin: Beginning = ANY
    ) -> MotorModel:
        """The model of some experiments over time."""
        return MotorModel(variant, experiments, begin)

    def response(
        self, variant: Variant, experiments: Sequence[Experiment], begin: Beginning,
        names: tuple[str, ...],
    ) -> NamedModel:  # fmt: skip
        """The model as the estimation takes it; see :meth:`ResponseModel.response`."""
        if variant.name == STATIC:
            return SettledModel(experiments).named(names)
        return super().response(variant, experiments, begin, names)

    def simulate(
        self, plant: Plant[MotorOptions], experiments: Sequence[Experiment],
        offset: float | None = None,
    ) -> list[Simulated]:  # fmt: skip
        """Output from command; see :meth:`.Family.simulate`."""
        if plant.variant.name != STATIC:
            return super().simulate(plant, experiments, offset)
        model = SettledModel(experiments)
        return [Simulated(model.response(k, plant.numbers)) for k in range(len(experiments))]

    def fastest(self, values: Values) -> float:
        """The only pole [rad/s]."""
        return 1.0 / float(values["time_constant"])

    def plan(self, experiments: Sequence[Experiment], request: Request[MotorOptions]) -> Plan:
        """Return typical sizes and ranges; see :func:`fit_motor` for the saturation.

        Raises
        ------
        LogError
            When nothing moves.
        """
        options, (low, high) = request.options, command_range(experiments)
        output = output_of(experiments)
        if low == high or not any(np.ptp(e[output]) for e in experiments):
            raise LogError(
                f"command or {output} does not change in any log",
                remedy="Record a staircase of the command from zero to saturation and back.",
            )
        top = highest_command(experiments, middle_of_commands(experiments, request))
        zones = dict.fromkeys(edge_names(options), (0.0, 0.95 * top))
        if EDGES[0] in zones:
            zones[EDGES[0]] = -0.95 * top, 0.0
        searched = [Searched(n, 0.1 * top, z, max_half_width=0.3 * top) for n, z in zones.items()]
        if options.command_offset == "estimate" or OFFSET in request.fixed:
            searched.append(Searched(OFFSET, 0.1 * top, (low, high), max_half_width=0.3 * top))
        searched += [
            Searched("curvature", 1.0 / top, (0.0, 50.0 / top), max_half_width=3.0 / top),
            Searched(SATURATION, top, (0.02 * top, top), no_effect_at=10.0 * top),
            Searched("hysteresis", 0.05 * top, (0.0, 1.5 * top), max_half_width=0.3 * top),
        ]
        if options.mode == "dynamic":
            step, span = time_scales(experiments)
            searched += [
                Searched("time_constant", 3.0 * step, (0.01 * step, 2.0 * span)),
                Searched("dead_time", step, (0.0, 0.5 * span), max_half_width=20.0 * step),
            ]
        return Plan(searched, refusals=_refused_beforehand(experiments, request))

    def starts(
        self, task: ResponseTask[MotorOptions], experiments: Sequence[Experiment], begin: Beginning
    ) -> list[dict[str, float]]:
        """Best of a grid of lags for a typical curve, then of grids of curves behind that lag.

        The gain is linear: at any other values it follows without a search.
        """
        problem, unknowns = task.problem(experiments, begin), task.unknowns
        free = problem.names
        top = 1.0 / unknowns["curvature"].scale
        size = {"curvature": 1.0 / top, EDGES[0]: -top}
        curves = {n: [s * size.get(n, top) for s in shares] for n, shares in _SHARES.items()}
        values = {n: axis[0] for n, axis in curves.items()} | task.held
        middle = middle_of_commands(task.experiments, task.request)
        first = {OFFSET: [middle + share * top for share in _MIDDLES]}
        if "dead_time" in unknowns:
            step, late = unknowns["dead_time"].scale, unknowns["dead_time"].high
            lags = np.unique([0.5 * step, *np.geomspace(min(2.0 * step, late), late, 8)])
            slow = np.geomspace(step, max(0.3 * late, 2.0 * step), 5)
            first |= {"time_constant": slow.tolist(), "dead_time": lags.tolist()}

        def rank(**wanted: Sequence[float]) -> list[dict[str, float]]:
            grid = {n: points for n, points in wanted.items() if n in free}
            every = [{**values, **dict(zip(grid, point))} for point in product(*grid.values())]
            every = [{**v, **task.request.start} for v in every]
            cost = profile(problem, np.array([[v[n] for n in free] for v in every]))
            return [every[k] for k in np.argsort(cost, kind="stable")]

        values = rank(**first)[0]
        return rank(**curves)[:_BEST]

    def alternative_starts(self, values: Values, step: float) -> list[dict[str, float]]:
        """Other edges: each level of a held command that one of them passes may make a minimum.

        In an angle what is wrong adds up, and minima far from the best are deep.
        """
        return [
            {n: share * values[n] for n in names if n in values}
            for names, share in _OTHER_EDGES
            if any(n in values for n in names)
        ]


def _refused_beforehand(
    experiments: Sequence[Experiment], request: Request[MotorOptions]
) -> list[Refusal]:
    """Refusals of parameters that no sample depends on."""
    middle, out = middle_of_commands(experiments, request), []
    back = [min(rise_and_fall(np.abs(e.sampled("command") - middle))) for e in experiments]
    if max(back) <= 0.25 * highest_command(experiments, middle):
        # going one way it only shifts the curve, which dead zone and saturation do as well
        out.append(Refusal("hysteresis", "every log moves the command in one direction only."))
    free = request.options.command_offset == "estimate" and OFFSET not in request.fixed
    if free and not _turns_both_ways(experiments):
        out.append(Refusal(
            OFFSET, "the motor turns in one direction only, where an offset and a dead zone shift "
            "the curve alike.",
        ))  # fmt: skip
    return out


def _turns_both_ways(experiments: Sequence[Experiment]) -> bool:
    """Return whether the motor turns forward and backward by more than a trifle."""
    output = output_of(experiments)
    ways = [
        (e[output].max(), -e[output].min()) if output == "speed" else rise_and_fall(e[output])
        for e in experiments
    ]
    forward, backward = (max(0.0, *each) for each in zip(*ways))
    return bool(min(forward, backward) > _TRIFLE * max(forward, backward))


F = TypeVar("F", Response[MotorOptions], NamedFit)


def without_saturation(task: ResponseTask[MotorOptions]) -> ResponseTask[MotorOptions]:
    """The task of a motor whose speed grows with every command."""
    searched = [s for s in task.plan.searched if s.name != SATURATION]
    return replace(task, plan=replace(task.plan, searched=searched))


def fit_saturated(
    task: ResponseTask[MotorOptions], fit: Callable[[ResponseTask[MotorOptions]], F]
) -> F | None:
    """The fit with a saturation; ``None`` where the logs neither show one nor it was given."""
    given = SATURATION in task.request.fixed
    try:
        found = fit(task)
    except NotIdentifiedError:
        if given:
            raise
        return None
    return found if given or _is_reached(task.experiments, found.solved) else None


def fit_motor(
    task: ResponseTask[MotorOptions],
) -> tuple[Response[MotorOptions], dict[str, float]]:
    """Fit with a saturation where the speeds show one, else without.

    A saturation that is not determined, or that the residuals do not ask for, is none. A search
    for it can slide to the highest command, where it leaves no trace; it is then sought again
    from the best fit without one.

    Returns
    -------
    The fit, and a saturation that the logs neither show nor rule out, with the values that others
    would have with it; empty where there is none that matters.
    """
    found = fit_saturated(task, fit_response)
    if found is not None:
        return found, {}
    found = fit_response(without_saturation(task))
    if SATURATION in task.request.start:
        return found, {}
    bends, fitted = _find_bends(task, found), found.solved
    rise, best = max(bends, key=lambda b: b[0])
    if rise > DECISIVE:
        request = replace(task.request, start={n: best[n] for n in task.plan.names})
        again = fit_saturated(replace(task, request=request), fit_response)
        if again is not None:
            return again, {}

    def errors(values: Values) -> dict[str, float]:
        return {n: abs(values[n] - fitted.values[n]) / fitted.std_error(n) for n in fitted.names}

    possible = [values for rise, values in bends if rise > -_EXCLUDED]
    bend = max(possible, key=lambda values: max(errors(values).values(), default=0.0))
    moved = {n: bend[n] for n, by in errors(bend).items() if by >= 1.0}
    if max(errors(bend).values(), default=0.0) < _MATTERS:
        return found, {}
    return found, {SATURATION: bend[SATURATION], **moved}


def _is_reached(experiments: Sequence[Experiment], solved: Solved) -> bool:
    """Return whether an estimated saturation lies clearly below the highest command of the spool.

    The play takes half the hysteresis from the command.
    """
    values = solved.values
    top = highest_command(experiments, values.get(OFFSET, 0.0)) - 0.5 * values["hysteresis"]
    return values[SATURATION] + 2.0 * solved.std_error(SATURATION) < top


def _find_bends(
    task: ResponseTask[MotorOptions], without: Response[MotorOptions]
) -> list[tuple[float, dict[str, float]]]:
    """By how many variances the residuals fall with some saturations, and the values then.

    The first is none at all.
    """
    fitted = without.solved
    top = highest_command(task.experiments, fitted.values.get(OFFSET, 0.0))
    model = replace(task.named(task.experiments, without.begin), weights=without.weights)
    refused = {n: fitted.values[n] for n in fitted.refused}
    rows, out = sum(y.size for y in model.measured), [(0.0, dict(fitted.values))]
    for share in _BENDS:
        held = {**task.held, **refused, SATURATION: share * top}
        problem = bind(model, task.unknowns, held)
        found = solve(problem, problem.vector(fitted.values))
        values = problem.named((*found.eta, *found.linear))
        rise = rows * (fitted.solution.cost / found.cost - 1.0)
        out.append((rise, {**fitted.values, **held, **values}))
    return out
