"""Stage two: the gray box of pressures and position, and what it refuses to say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...errors import Notice
from ...estimation.command_noise import with_command_noise
from ...estimation.gray_box import GrayBox, GraySolution, make_gray_log, solve_gray_box
from ...estimation.hydraulics import (
    GRAY_NAMES,
    Machine,
)
from ...estimation.parametric import (
    Fitted,
    Refusal,
    derive,
    make_unknowns,
    refuse,
)
from ...estimation.separable import Search, Solution, Unknown
from ...estimation.uncertainty import Uncertainty, score_covariance, t_quantile
from ...experiment import Experiment, FloatArray
from ...family import Quantity
from .flow import one_sided, sensible_widths
from .friction import FrictionRows, fit_friction
from .stage import Stage, all_windows, spec_of


def fit_gray(stage: Stage, first: Fitted, rows: FrictionRows) -> tuple[Fitted, GraySolution, float]:
    """Output error of pressures and position, refusing what the data do not determine.

    Returns the fit, its simulation and the noise found on the command [V].
    """
    fixed = {n: float(v) for n, v in stage.request.fixed.items() if n in GRAY_NAMES}
    unknowns = dict(first.unknowns)
    start, scales = _gray_start(stage, first, rows)
    extra = make_unknowns(stage.specs, ("viscous", "coulomb"), scales, stage.request)
    unknowns.update(extra)
    logs = [make_gray_log(e, stage.machine) for e in stage.experiments]
    box = GrayBox(logs, stage.machine, (1.3 * scales["coulomb"], 1.3 * scales["viscous"]))
    refused = {r.parameter: r for r in one_sided(stage, all_windows(stage))}
    notices = [refuse(spec_of(stage.specs, n), r.reason) for n, r in refused.items()]
    sigma, initial = _noise(stage.experiments), None
    bounds = {n: (u.low, u.high) for n, u in unknowns.items()}
    while True:
        held = {**fixed, **{n: spec_of(stage.specs, n).neutral or 0.0 for n in refused}}
        free = [n for n in GRAY_NAMES if n not in held]
        begin = {**start, **held}
        solution = None
        for _ in range(3):  # the weights follow the residuals
            solution = solve_gray_box(
                box, begin, free, {n: unknowns[n].scale for n in free}, bounds, sigma, initial
            )
            begin, initial = solution.values, solution.initial
            stage.request.progress(
                f"gray box: {solution.iterations} steps, weighted error {solution.cost:.6g}"
            )
            new = _spread(logs, solution)
            settled = bool(np.all(np.abs(new / sigma - 1.0) < 0.05))
            sigma = new
            if settled:
                break
        assert solution is not None
        channels = [
            [slice(k * log.samples, (k + 1) * log.samples) for k in range(len(log.channels))]
            for log in logs
        ]
        uncertainty = score_covariance(solution.jacobian, solution.residuals, channels)
        worst = _undetermined(free, solution, uncertainty, unknowns, stage)
        if worst is None:
            break
        notices.append(refuse(spec_of(stage.specs, worst[0]), worst[1]))
        refused[worst[0]] = Refusal(*worst)
        start, initial = solution.values, None
    _check_bulk_modulus(stage, box, solution, free, unknowns, bounds, channels)
    uncertainty, noise = with_command_noise(box, solution, uncertainty)
    fitted = _as_fitted(stage, solution, free, fixed, refused, uncertainty, unknowns, notices)
    if not solution.converged:
        fitted.notices.append(
            Notice("not-converged", "the gray box stopped before it had settled: check areas, "
                   "volumes, mass and supply pressure, or give --start values.")
        )  # fmt: skip
    return fitted, solution, noise


def _gray_start(
    stage: Stage, first: Fitted, rows: FrictionRows
) -> tuple[dict[str, float], dict[str, float]]:
    """Start values from stage one, and the sizes of the friction."""
    machine = stage.machine
    force = 0.01 * (machine.supply - machine.tank) * machine.area(1)
    speeds = [np.abs(np.diff(e["position"])).sum() / np.ptp(e.time) for e in stage.experiments]
    speed = max(float(np.mean(speeds)), 1e-6)
    values = {"viscous": force / speed, "coulomb": force}
    if rows.moving.sum() >= 8:
        found = fit_friction(stage, rows, lenient=True).values
        values = {n: found[n] for n in values}
    scales = {
        "viscous": max(values["viscous"], force / speed),
        "coulomb": max(values["coulomb"], force),
    }
    start = {**dict.fromkeys(GRAY_NAMES, 0.0), **first.values, **values}
    start["bulk_modulus"] = float(np.clip(first.values["bulk_modulus"], 2e8, 3e9))
    return {**start, **{n: v for n, v in stage.request.start.items() if n in start}}, scales


def _noise(experiments: Sequence[Experiment]) -> FloatArray:
    """Noise of the three channels from second differences, with a floor [Pa, Pa, m]."""
    out = []
    for role in ("pressure_1", "pressure_2", "position"):
        found = [
            float(np.median(np.abs(np.diff(e[role], 2)))) / 0.6745 / np.sqrt(6.0)
            + max(e.signals[role].resolution, 1e-4 * float(np.ptp(e[role])))
            for e in experiments
            if role in e
        ]
        out.append(max(found, default=1.0))
    return np.array(out)


def _spread(logs: Sequence[Any], solution: GraySolution) -> FloatArray:
    """Root mean square of the residuals of each channel over all logs [Pa, Pa, m]."""
    total, count = np.zeros(3), np.zeros(3)
    for log, states in zip(logs, solution.states):
        for c, y in zip(log.channels, log.measured):
            total[c] += float(np.sum((y - states[:, c]) ** 2))
            count[c] += y.size
    spread = np.sqrt(total / np.maximum(count, 1.0))
    return np.where(spread > 0.0, spread, solution.sigma)


def _undetermined(
    free: Sequence[str],
    solution: GraySolution,
    uncertainty: Uncertainty,
    unknowns: Mapping[str, Unknown],
    stage: Stage,
) -> tuple[str, str] | None:
    """The parameter whose interval says least, if it says nothing."""
    quantile = t_quantile(0.975, uncertainty.degrees)
    sensible = {**sensible_widths(unknowns), "viscous": unknowns["viscous"].scale,
                "coulomb": unknowns["coulomb"].scale}  # fmt: skip
    found: list[tuple[bool, float, str, str]] = []
    for k, name in enumerate(free):
        half = quantile * float(np.sqrt(max(uncertainty.covariance[k, k], 0.0)))
        value, spec = solution.values[name], spec_of(stage.specs, name)
        if name == "bulk_modulus" and solution.active[k]:
            half = np.inf
        width = sensible.get(name, (0.3 if name == "bulk_modulus" else 0.5) * abs(value))
        if not half <= width:
            reason = (
                f"its 95 % interval would be {value:.3g} ± {half:.2g} {spec.unit}, wide enough "
                "to hold every sensible value."
                if np.isfinite(half)
                else "the pressures and the position hardly depend on it in these logs."
            )
            ratio = half / width if np.isfinite(half) and width > 0.0 else np.inf
            found.append((spec.neutral is not None, ratio, name, reason))
    # what can be left out goes first: a gain may be sure once the losses are gone
    return max(found)[2:] if found else None


def _check_bulk_modulus(
    stage: Stage,
    box: GrayBox,
    solution: GraySolution,
    free: Sequence[str],
    unknowns: Mapping[str, Unknown],
    bounds: Mapping[str, tuple[float, float]],
    channels: Sequence[Sequence[slice]],
) -> None:
    """Refuse a bulk modulus that looks certain only because other parameters were held.

    Raises
    ------
    NotIdentifiedError
        When its interval is wide once losses and dead zone may vary again.
    """
    every = [n for n in GRAY_NAMES if n not in stage.request.fixed]
    if "bulk_modulus" not in free or len(every) == len(free):
        return
    scales = {n: unknowns[n].scale for n in every}
    wide = solve_gray_box(box, solution.values, every, scales, bounds, solution.sigma,
                          solution.initial, max_iterations=0)  # fmt: skip
    found = score_covariance(wide.jacobian, wide.residuals, channels)
    k = every.index("bulk_modulus")
    half = 1.96 * float(np.sqrt(max(found.covariance[k, k], 0.0)))
    if not half <= 0.3 * solution.values["bulk_modulus"]:
        raise_for = spec_of(stage.specs, "bulk_modulus")
        refuse(raise_for, "the logs hold no transients of the pressures that would tell it from "
               "valve and losses.")  # fmt: skip


def _as_fitted(
    stage: Stage,
    solution: GraySolution,
    free: Sequence[str],
    fixed: Mapping[str, float],
    refused: Mapping[str, Refusal],
    uncertainty: Uncertainty,
    unknowns: Mapping[str, Unknown],
    notices: list[Notice],
) -> Fitted:
    status = dict.fromkeys(free, "estimated")
    status |= dict.fromkeys(fixed, "fixed") | dict.fromkeys(refused, "not_identified")
    eta = np.array([solution.values[n] for n in free])
    plain = Solution(
        eta, np.zeros(0), [], solution.cost, solution.residuals,
        [s[:, 2] for s in solution.states], solution.jacobian,
        iterations=solution.iterations, converged=solution.converged,
    )  # fmt: skip
    values = {n: solution.values[n] for n in GRAY_NAMES}
    return Fitted(values, tuple(free), uncertainty, status, Search(plain, 1, 1, ()), plain,
                  notices, unknowns)  # fmt: skip


def gray_details(
    fitted: Fitted, solution: GraySolution, first: Fitted, noise: float
) -> dict[str, Any]:
    """What the file says of the fit beside its numbers."""
    return {
        "method": "gray-box output error of pressures and position (multiple shooting)",
        "iterations": solution.iterations,
        "converged": solution.converged,
        "covariance": fitted.details()["covariance"],
        "residual_rms": {
            "pressure_1": float(solution.sigma[0]),
            "pressure_2": float(solution.sigma[1]),
            "position": float(solution.sigma[2]),
        },
        "command_noise": noise,
        "stage_one": {n: float(v) for n, v in first.values.items()},
    }


def simulate_gray(
    experiment: Experiment, machine: Machine, values: Mapping[str, float]
) -> FloatArray:
    """Position from the command alone, with the initial state fitted."""
    log = make_gray_log(experiment, machine)
    friction = (max(values["coulomb"], 1e-9), values["viscous"])
    box = GrayBox([log], machine, friction)
    some = {n: values[n] for n in GRAY_NAMES}
    solution = solve_gray_box(box, some, (), {}, {}, _noise([experiment]))
    return np.asarray(solution.states[0][:, 2])


def resonance(stage: Stage, fitted: Fitted) -> dict[str, Quantity]:
    """Undamped resonance of the piston between the closed chambers, in the middle of the logs."""
    middle = float(np.mean([np.mean(e["position"]) for e in stage.experiments]))
    m = stage.machine
    volumes = [float(np.real(m.volume(i, np.array(middle)))) for i in (1, 2)]  # type: ignore[arg-type]
    compliance = m.area(1) ** 2 / volumes[0] + m.area(2) ** 2 / volumes[1]

    def function(v: Mapping[str, Any]) -> dict[str, Any]:
        omega = np.sqrt(v["bulk_modulus"] * compliance / (m.mass or 1.0))
        ratio = v["viscous"] / (2.0 * (m.mass or 1.0) * omega)
        return {"natural_frequency": omega, "damping_ratio": ratio}

    return derive(fitted, {"natural_frequency": "rad/s", "damping_ratio": "1"}, function)
