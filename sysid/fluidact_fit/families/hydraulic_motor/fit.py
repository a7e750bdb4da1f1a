"""Fit of curve and lag: a motor that breaks away late from rest must not pass for a slow lag.

Residuals far outside the others count less (Huber weights). The limit is settled by the fit; a
simulation finds the offset of a log with the same one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import LogError
from ...estimation.parametric import Fitted, Values, bind, fit_named, make_unknowns
from ...estimation.results import Refusal
from ...estimation.separable import evaluate
from ...experiment import Experiment, FloatArray
from ...family import FamilyOptions, ParameterSpec, Request, Simulated
from ...options import choice, settled
from .equation import MotorModel

_ROUNDS = 6  # of reweighting
_FAR = 4.0  # robust standard deviations from which a residual counts less


@dataclass(frozen=True)
class MotorOptions(FamilyOptions):
    """What is estimated beside the curve and the lag, and what the fit settles."""

    dead_time: str = choice(
        "estimate", ("estimate", "none"), "whether to estimate a dead time", "dead_time"
    )
    residual_limit: float | None = settled(
        "float", "residual of the speed beyond which a sample counts less", minimum=0.0
    )


def fit_motor(
    specs: Sequence[ParameterSpec],
    experiments: Sequence[Experiment],
    request: Request[MotorOptions],
    saturated: bool,
) -> tuple[Fitted, float]:
    """Fit with or without a saturation; returns the limit of the residuals [unit of the speed]."""
    sizes, starts = _sizes(experiments)
    if not saturated:
        del sizes["saturation_command"]
    names = tuple(sizes)
    scales = {n: scale for n, (scale, _, _) in sizes.items()}
    limits = {n: (low, high) for n, (_, low, high) in sizes.items()}
    unknowns = make_unknowns(specs, names, scales, request, limits)
    top = highest_command(experiments)
    sensible = {
        "dead_zone": 0.3 * top, "hysteresis": 0.3 * top, "curvature": 3.0 / top,
        "dead_time": limits["dead_time"][1],
    }  # fmt: skip
    model, measured = MotorModel(experiments), [e["speed"] for e in experiments]
    weights = [np.ones(y.size) for y in measured]
    begin: Sequence[Mapping[str, float]] = starts
    settled_limit = request.options.residual_limit
    for _ in range(_ROUNDS):
        fitted = fit_named(
            model.named(names, measured, weights), specs, request, unknowns, begin,
            sensible=sensible, refusals=_one_way(experiments),
        )  # fmt: skip
        rest = [y - m for y, m in zip(measured, fitted.solution.simulated)]
        typical = 1.4826 * float(np.median(np.abs(np.concatenate(rest))))
        limit = _FAR * typical if settled_limit is None else settled_limit
        new = [_weights(r, limit) for r in rest]
        change = max(float(np.abs(a - b).max()) for a, b in zip(new, weights))
        weights, begin = new, [fitted.values]
        if change < 0.05:
            break
    return fitted, limit


def _weights(residual: FloatArray, limit: float) -> FloatArray:
    """Roots of Huber's weights, which multiply the residuals."""
    return np.sqrt(np.minimum(1.0, limit / np.maximum(np.abs(residual), 1e-300)))


def simulate_run(e: Experiment, values: Values, limit: float, offset: float | None) -> Simulated:
    """Speed of a run, offset and fading deviation fitted to its own speed where it has one.

    That is the least squares of the fit with nothing but offset and deviation unknown.
    """
    model = MotorModel([e])
    if "speed" not in e:
        start = offset or 0.0
        return Simulated(model.speed(0, values) + start, offset=start)
    weights = np.ones(e.samples)
    for _ in range(_ROUNDS):
        problem = bind(model.named(tuple(values), [e["speed"]], [weights]), {}, values)
        found = evaluate(problem, np.zeros(0))
        weights = _weights(e["speed"] - found.simulated[0], limit)
    return Simulated(found.simulated[0], offset=float(found.local[0][0]))


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
    name = "saturation_command"
    reach = highest_command(experiments) - 0.5 * fitted.values["hysteresis"]
    return name in fitted.names and fitted.values[name] + 2.0 * fitted.std_error(name) < reach


def _sizes(
    experiments: Sequence[Experiment],
) -> tuple[dict[str, tuple[float, float, float]], list[dict[str, float]]]:
    """Typical size and search range of every parameter, and starts."""
    top = highest_command(experiments)
    speed = max(float(np.ptp(e["speed"])) for e in experiments)
    if top == 0.0 or speed == 0.0:
        raise LogError(
            "command or speed does not change in any log",
            remedy="Record a staircase of the command from zero to saturation and back.",
        )
    step = max(e.sample_time for e in experiments)
    span = min(float(np.ptp(e.time)) for e in experiments)
    sizes = {
        "dead_zone": (0.1 * top, 0.0, 0.5 * top),
        "gain": (2.0 * speed / top, 0.1 * speed / top, 100.0 * speed / top),
        "curvature": (1.0 / top, 0.0, 20.0 / top),
        "saturation_command": (top, 0.5 * top, top),
        "hysteresis": (0.05 * top, 0.0, 0.5 * top),
        "time_constant": (3.0 * step, 0.1 * step, 0.5 * span),
        "dead_time": (step, 0.0, 20.0 * step),
    }
    starts = [
        {
            "dead_zone": 0.05 * top, "gain": gain * speed / top, "curvature": bend / top,
            "saturation_command": 0.93 * top, "hysteresis": 0.03 * top,
            "time_constant": tau * step, "dead_time": 0.5 * step,
        }
        for gain, bend in ((1.2, 0.3), (2.0, 1.5))
        for tau in (2.0, 10.0)
    ]  # fmt: skip
    return sizes, starts
