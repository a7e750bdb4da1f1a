"""The gray box of pressures and position: its fit, and what it refuses to say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ...errors import Notice
from ...estimation.noise import noise_floor
from ...estimation.parametric import Fitted, make_unknowns
from ...estimation.results import Refusal, Solved, determine, left_open, refuse
from ...estimation.separable import Unknown
from ...estimation.uncertainty import Uncertainty, score_covariance
from ...experiment import Experiment, FloatArray
from ...family import Quantity
from .case import Case
from .command_noise import with_command_noise
from .equations import GRAY_NAMES
from .flow import one_sided, sensible_widths
from .friction import FrictionRows, fit_friction
from .gray_box import CHANNELS, GrayBox, GrayLog, make_gray_log
from .gray_search import GrayProblem, GraySolution, solve_gray_box
from .options import HydraulicCylinderOptions

MARGIN = 1.3  # of the friction that the steps of the simulation are made for
_CERTAIN = 0.3  # half-width of an interval of the bulk modulus that still says something


@dataclass(frozen=True)
class GrayFit:
    """A finished fit of the gray box, with the options it settled and what the file says of it."""

    solved: Solved
    options: HydraulicCylinderOptions
    details: dict[str, Any]
    notices: list[Notice]


class _Attempt(NamedTuple):
    """One search with some parameters held."""

    problem: GrayProblem
    solution: GraySolution
    uncertainty: Uncertainty


class _Search:
    """Fits the gray box again and again; weights and start are those of the last time."""

    def __init__(self, case: Case, first: Fitted, rows: FrictionRows) -> None:
        self.case = case
        self.start, scales = _start(case, first, rows)
        friction = make_unknowns(
            case.variant.parameters, ("viscous", "coulomb"), scales, case.request
        )
        self.unknowns: dict[str, Unknown] = {**first.unknowns, **friction}
        logs = [make_gray_log(e, case.machine) for e in case.experiments]
        largest = (MARGIN * scales["coulomb"], MARGIN * scales["viscous"])
        self.box = GrayBox(logs, case.machine, largest, slip=case.options.slip)
        self.sigma = _noise(case.experiments)

    def solve(self, held: Mapping[str, float]) -> _Attempt:
        """Estimate what is not held; the weights follow the residuals."""
        free = [self.unknowns[n] for n in GRAY_NAMES if n not in held]
        begin, initial = {**self.start, **held}, None
        for _ in range(3):
            problem = GrayProblem(self.box, free, self.sigma)
            solution = solve_gray_box(problem, begin, initial)
            begin, initial = solution.values, solution.initial
            self.case.request.progress(
                f"gray box: {solution.iterations} steps, weighted error {solution.cost:.6g}"
            )
            old, self.sigma = self.sigma, _spread(self.box.logs, solution)
            if np.all(np.abs(self.sigma / old - 1.0) < 0.05):
                break
        self.start = solution.values
        return _Attempt(problem, solution, self.uncertainty(solution))

    def uncertainty(self, solution: GraySolution) -> Uncertainty:
        """Covariance of the free parameters; the channels of a log share their errors."""
        channels = [
            [slice(k * log.samples, (k + 1) * log.samples) for k in range(len(log.channels))]
            for log in self.box.logs
        ]
        return score_covariance(solution.jacobian, solution.residuals, channels)

    def undetermined(self, attempt: _Attempt) -> list[Refusal]:
        """The parameter whose interval says least, if it says nothing."""
        problem, solution, uncertainty = attempt
        sizes = {n: 0.5 * max(abs(solution.values[n]), 1e-300) for n in problem.names}
        friction = {n: self.unknowns[n].scale for n in ("viscous", "coulomb")}
        sensible = {**sizes, **sensible_widths(self.unknowns), **friction}
        matrix = uncertainty.covariance.copy()
        if "bulk_modulus" in problem.names:
            k = problem.names.index("bulk_modulus")
            sensible["bulk_modulus"] *= _CERTAIN / 0.5
            matrix[k, k] = np.inf if solution.active[k] else matrix[k, k]
        solved = Solved(solution.values, problem.names, matrix, uncertainty.degrees)
        specs = [self.case.variant.parameter(n) for n in problem.names]
        # what can be left out goes first: a gain may be sure once the losses are gone
        dispensable = {s.name: s for s in specs if s.neutral is not None}
        others = {s.name: s for s in specs if s.neutral is None}
        return left_open(solved, dispensable, sensible) or left_open(solved, others, sensible)

    def check_bulk_modulus(self, attempt: _Attempt) -> None:
        """Refuse a bulk modulus that looks certain only because other parameters were held.

        Raises
        ------
        NotIdentifiedError
            When its interval is wide once losses and dead zone may vary again.
        """
        problem, solution, _ = attempt
        every = [self.unknowns[n] for n in GRAY_NAMES if n not in self.case.request.fixed]
        if "bulk_modulus" not in problem.names or len(every) == len(problem.names):
            return
        wide = replace(problem, free=every, sigma=solution.sigma)
        again = solve_gray_box(wide, solution.values, solution.initial, max_iterations=0)
        k = wide.names.index("bulk_modulus")
        half = 1.96 * float(np.sqrt(max(self.uncertainty(again).covariance[k, k], 0.0)))
        if not half <= _CERTAIN * solution.values["bulk_modulus"]:
            refuse(
                self.case.variant.parameter("bulk_modulus"),
                "the logs hold no transients of the pressures that would tell it from valve and "
                "losses.",
            )


def fit_gray(case: Case, first: Fitted, rows: FrictionRows) -> GrayFit:
    """Output error of pressures and position, refusing what the data do not determine."""
    search = _Search(case, first, rows)
    fixed = {n: float(v) for n, v in case.request.fixed.items() if n in GRAY_NAMES}
    specs = {s.name: s for s in case.variant.parameters}
    found = determine(
        search.solve, search.undetermined, specs, fixed=fixed, refusals=one_sided(case)
    )
    search.check_bulk_modulus(found.solution)
    (problem, solution, uncertainty), notices = found.solution, found.notices
    uncertainty, noise = with_command_noise(search.box, solution, uncertainty)
    if not solution.converged:
        notices.append(
            Notice(
                "not-converged",
                "the gray box stopped before it had settled: check areas, volumes, mass and "
                "supply pressure, or give --start values.",
            )
        )
    solved = Solved(
        solution.values, problem.names, uncertainty.covariance, uncertainty.degrees,
        fixed, found.refused,
    )  # fmt: skip
    sigma = solution.sigma.tolist()
    options = replace(
        case.options, stage="gray-box", slip=search.box.slip,
        residual_pressure_1=sigma[0], residual_pressure_2=sigma[1], residual_position=sigma[2],
    )  # fmt: skip
    details = {
        "method": "gray-box output error of pressures and position (multiple shooting)",
        "iterations": solution.iterations,
        "converged": solution.converged,
        "covariance": "long-run variance of the scores",
        "command_noise": noise,
    }
    return GrayFit(solved, options, details, notices)


def _start(
    case: Case, first: Fitted, rows: FrictionRows
) -> tuple[dict[str, float], dict[str, float]]:
    """Start values from the flow balance, and the sizes of the friction."""
    machine = case.machine
    force = 0.01 * (machine.supply - machine.tank) * machine.area(1)
    speeds = [np.abs(np.diff(e["position"])).sum() / np.ptp(e.time) for e in case.experiments]
    speed = max(float(np.mean(speeds)), 1e-6)
    values = scales = {"viscous": force / speed, "coulomb": force}
    if rows.moving.sum() >= 8:
        found = fit_friction(case, rows, lenient=True).values
        values = {n: found[n] for n in scales}
        scales = {n: max(v, scales[n]) for n, v in values.items()}
    start = {**dict.fromkeys(GRAY_NAMES, 0.0), **first.values, **values}
    start["bulk_modulus"] = float(np.clip(first.values["bulk_modulus"], 2e8, 3e9))
    return {**start, **{n: v for n, v in case.request.start.items() if n in start}}, scales


def _noise(experiments: Sequence[Experiment]) -> FloatArray:
    """Noise of the three channels, with a floor [Pa, Pa, m]."""

    def noise(e: Experiment, role: str) -> float:
        least = max(e.signals[role].resolution, 1e-4 * float(np.ptp(e[role])))
        return noise_floor(e[role], 2) + least

    found = ([noise(e, role) for e in experiments if role in e] for role in CHANNELS)
    return np.array([max(values, default=1.0) for values in found])


def _spread(logs: Sequence[GrayLog], solution: GraySolution) -> FloatArray:
    """Root mean square of the residuals of each channel over all logs [Pa, Pa, m]."""
    total, count = np.zeros(3), np.zeros(3)
    for log, states in zip(logs, solution.states):
        rows = list(log.channels)
        total[rows] += np.sum((log.measured - states.T[rows]) ** 2, axis=1)
        count[rows] += log.samples
    spread = np.sqrt(total / np.maximum(count, 1.0))
    return np.where(spread > 0.0, spread, solution.sigma)


def resonance(case: Case, solved: Solved) -> dict[str, Quantity]:
    """Undamped resonance of the piston between the closed chambers, in the middle of the logs."""
    m, mass = case.machine, case.machine.mass or 1.0
    middle = np.array(case.rest_position())
    volumes = {i: m.volume(i, middle) for i in (1, 2)}
    compliance = sum(m.area(i) ** 2 / float(v) for i, v in volumes.items() if v is not None)

    def function(v: Mapping[str, Any]) -> dict[str, Any]:
        omega = np.sqrt(v["bulk_modulus"] * compliance / mass)
        return {"natural_frequency": omega, "damping_ratio": v["viscous"] / (2.0 * mass * omega)}

    return solved.derive({"natural_frequency": "rad/s", "damping_ratio": "1"}, function)
