"""Fit of curve and lag: a motor that breaks away late from rest must not pass for a slow lag.

Residuals far outside the others count less (Huber weights). The limit is settled by the fit; a
simulation finds the offset of a log with the same one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...errors import LogError
from ...estimation.parametric import Fitted, bind, fit_named, make_unknowns
from ...estimation.results import Refusal
from ...estimation.separable import evaluate
from ...experiment import Experiment, FloatArray
from ...family import ParameterSpec, Request, Simulated
from .equation import MotorModel
from .options import MotorOptions

NAMES = ("dead_zone", "gain", "curvature", "saturation_command", "hysteresis", "time_constant",
         "dead_time")  # fmt: skip
_ROUNDS = 6  # of reweighting
_FAR = 4.0  # robust standard deviations from which a residual counts less


def fit_motor(
    specs: Sequence[ParameterSpec],
    experiments: Sequence[Experiment],
    request: Request[MotorOptions],
    names: tuple[str, ...],
) -> tuple[Fitted, float]:
    """Fit some parameters; returns the limit of the residuals as well [unit of the speed]."""
    scales, limits, starts = _sizes(experiments)
    unknowns = make_unknowns(specs, names, scales, request, limits)
    sensible = {
        "dead_zone": 0.3 * scales["saturation_command"],
        "hysteresis": 0.3 * scales["saturation_command"],
        "curvature": 3.0 / scales["saturation_command"],
        "dead_time": limits["dead_time"][1],
    }
    model, measured = MotorModel(experiments), [e["speed"] for e in experiments]
    weights = [np.ones(y.size) for y in measured]
    begin: Sequence[Mapping[str, float]] = [{**s, **request.start} for s in starts]
    settled = request.options.residual_limit
    for _ in range(_ROUNDS):
        fitted = fit_named(
            model.named(names, measured, weights), specs, request, unknowns, begin,
            sensible=sensible, refusals=_one_way(experiments),
        )  # fmt: skip
        rest = [y - m for y, m in zip(measured, fitted.solution.simulated)]
        limit = _far(rest) if settled is None else settled
        new = [_weights(r, limit) for r in rest]
        change = max(float(np.abs(a - b).max()) for a, b in zip(new, weights))
        weights, begin = new, [fitted.values]
        if change < 0.05:
            break
    return fitted, limit


def _far(residuals: Sequence[FloatArray]) -> float:
    return _FAR * 1.4826 * float(np.median(np.abs(np.concatenate(residuals))))


def _weights(residual: FloatArray, limit: float) -> FloatArray:
    """Roots of Huber's weights, which multiply the residuals."""
    return np.sqrt(np.minimum(1.0, limit / np.maximum(np.abs(residual), 1e-300)))


def far_samples(residual: FloatArray, limit: float) -> int:
    """Number of samples that count less."""
    return int(np.sum(np.abs(residual) > limit))


def simulate_motor(
    experiments: Sequence[Experiment],
    values: Mapping[str, float],
    limit: float,
    offset: float | None,
) -> list[Simulated]:
    """Speeds of all runs, offset and fading deviation by run fitted to their speeds."""
    measured = [e for e in experiments if "speed" in e]
    fitted = iter(_fit_offsets(measured, values, limit) if measured else [])
    from_rest, start = MotorModel(experiments), offset or 0.0
    return [
        next(fitted)
        if "speed" in e
        else Simulated(np.asarray(from_rest.speed(i, values) + start), offset=start)
        for i, e in enumerate(experiments)
    ]


def _fit_offsets(
    experiments: Sequence[Experiment], values: Mapping[str, float], limit: float
) -> list[Simulated]:
    """The same least squares as the fit, with nothing but offsets and deviations unknown."""
    model, measured = MotorModel(experiments), [e["speed"] for e in experiments]
    weights = [np.ones(y.size) for y in measured]
    for _ in range(_ROUNDS):
        problem = bind(model.named(tuple(values), measured, weights), {}, values)
        found = evaluate(problem, np.zeros(0))
        weights = [_weights(y - m, limit) for y, m in zip(measured, found.simulated)]
    return [Simulated(y, offset=float(own[0])) for y, own in zip(found.simulated, found.local)]


def _one_way(experiments: Sequence[Experiment]) -> list[Refusal]:
    """Refuse the hysteresis where no log raises and lowers the command by a fair amount.

    Going one way it only shifts the curve, which dead zone and saturation do as well.
    """
    top = highest_command(experiments)
    for e in experiments:
        u = np.abs(e.sampled("command"))
        up = float(np.max(u - np.minimum.accumulate(u)))
        down = float(np.max(np.maximum.accumulate(u) - u))
        if min(up, down) > 0.25 * top:
            return []
    return [Refusal("hysteresis", "every log moves the command in one direction only.")]


def highest_command(experiments: Sequence[Experiment]) -> float:
    """Largest size of the command in any log [unit of the command]."""
    return max(float(np.abs(e.sampled("command")).max()) for e in experiments)


def saturates(fitted: Fitted, experiments: Sequence[Experiment]) -> bool:
    """Whether the commands go beyond the saturation by more than its uncertainty."""
    if "saturation_command" not in fitted.names:
        return False
    reach = highest_command(experiments) - 0.5 * fitted.values["hysteresis"]
    return (
        fitted.values["saturation_command"] + 2.0 * fitted.std_error("saturation_command") < reach
    )


def _sizes(
    experiments: Sequence[Experiment],
) -> tuple[dict[str, float], dict[str, tuple[float, float]], list[dict[str, float]]]:
    """Typical sizes, search ranges and starts."""
    top = highest_command(experiments)
    speed = max(float(np.ptp(e["speed"])) for e in experiments)
    if top == 0.0 or speed == 0.0:
        raise LogError(
            "command or speed does not change in any log",
            remedy="Record a staircase of the command from zero to saturation and back.",
        )
    step = max(e.sample_time for e in experiments)
    span = min(float(np.ptp(e.time)) for e in experiments)
    scales = {
        "dead_zone": 0.1 * top, "gain": 2.0 * speed / top, "saturation_command": top,
        "curvature": 1.0 / top, "hysteresis": 0.05 * top, "time_constant": 3.0 * step,
        "dead_time": step,
    }  # fmt: skip
    limits = {
        "dead_zone": (0.0, 0.5 * top), "gain": (0.1 * speed / top, 100.0 * speed / top),
        "saturation_command": (0.5 * top, top), "curvature": (0.0, 20.0 / top),
        "hysteresis": (0.0, 0.5 * top), "time_constant": (0.1 * step, 0.5 * span),
        "dead_time": (0.0, 20.0 * step),
    }  # fmt: skip
    starts = [
        {
            "dead_zone": 0.05 * top, "gain": gain * speed / top, "curvature": bend / top,
            "saturation_command": 0.93 * top, "hysteresis": 0.03 * top,
            "time_constant": tau * step, "dead_time": 0.5 * step,
        }
        for gain, bend in ((1.2, 0.3), (2.0, 1.5))
        for tau in (2.0, 10.0)
    ]  # fmt: skip
    return scales, limits, starts
