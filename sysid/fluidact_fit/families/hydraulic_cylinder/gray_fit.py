"""The gray box of pressures and position: its fit, and what it refuses to say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...errors import Notice, NotIdentifiedError
from ...estimation.minimise import Minimum
from ...estimation.named_model import Values, make_unknowns
from ...estimation.noise import noise_floor
from ...estimation.results import Refusal, Solved, determine, left_open
from ...estimation.stribeck import STRIBECK, free_names, slowest_and_fastest, undetermined
from ...experiment import Experiment, FloatArray
from ...family import NoiseModel, Quantity, Solution, make_solution
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.hydraulic_cylinder import GRAY_NAMES, THETA
from .case import Case
from .command_noise import command_noise
from .gray_box import CHANNELS, GrayBox, GrayLog, make_gray_log
from .gray_search import GrayPoint, GrayProblem, moving_speeds, solve_gray_box
from .nearby import Nearby
from .options import HydraulicCylinderOptions
from .regression import directional_gains, fit_flow, fit_friction, sensible_widths
from .simulation import simulate_runs

_PART = 4_000  # samples in which a search begins
_LONG = 16_000  # samples from which every search does, and not that for a Stribeck rise alone
_SPEEDS = 6  # at which the search for a Stribeck rise begins
_SHARES = (0.3, 0.6)  # of the dry friction that are Stribeck rise at first
_ROUNDS = ((2, 4), (6, 2), (20, 1))  # steps from each start, and how many of them go on
_BESIDE = (0.63, 0.8, 1.25, 1.6)  # times the best speed, where a better one is looked for
_SIDE_STEPS = 6  # of that search, at that speed and then free
_MARGIN = 1.5  # by which friction may fall more steeply than where that search ended
_CERTAIN = 0.3  # half-width of an interval of the bulk modulus that still says something


class _Search:
    """Fits the gray box again and again; weights and start are those of the last time."""

    def __init__(self, case: Case) -> None:
        self.case = case
        first = fit_flow(case, lenient=True)
        self.start, scales = _start(case, first.values)
        friction = make_unknowns(case.variant.parameters, (*scales,), scales, case.request)
        self.unknowns = {**first.unknowns, **friction}
        self.logs = [make_gray_log(e, case.machine) for e in case.experiments]
        fall = FrictionLaw.of(case.request.fixed).fall
        self.box = GrayBox.following(self.logs, case.machine, scales["viscous"], fall)
        self.initial: list[FloatArray] | None = None
        self.sigma = _noise(case.experiments)
        self.low = free_names(case.options.stribeck == "estimate", case.request.fixed)

    def solve(self, held: Mapping[str, float]) -> Minimum[GrayPoint]:
        """Estimate what is not held, of long logs first in part of them."""
        low = [n for n in self.low if n not in held]
        samples = self.case.samples
        part = [piece for log in self.logs for piece in log.pieces(_PART / samples)]
        if low and not self.start.get("stribeck_speed"):
            plain = self._settle(part, {**held, **dict.fromkeys(low, 0.0)})
            self._begin_rise(plain.point, low, held)
        if self.initial is None and samples > _LONG:
            self._settle(part, held, low)
        end = self._settle(self.logs, held, low, self.initial)
        self.initial = end.point.initial
        return end

    def _settle(
        self, logs: Sequence[GrayLog], held: Mapping[str, float], low: Sequence[str] = (),
        initial: Sequence[FloatArray] | None = None,
    ) -> Minimum[GrayPoint]:  # fmt: skip
        """Search from the last values; the weights follow the residuals."""
        free = [self.unknowns[n] for n in (*GRAY_NAMES, *low) if n not in held]
        begin = {**self.start, **held}
        for _ in range(3):
            problem = GrayProblem(self.box, logs, free, self.sigma)
            end = solve_gray_box(problem, begin, initial)
            begin, initial = end.point.values, end.point.initial
            self.case.request.progress(
                f"gray box: {end.iterations} steps, weighted error {end.point.cost:.6g}"
            )
            old, self.sigma = self.sigma, _spread(end.point)
            if np.all(np.abs(self.sigma / old - 1.0) < 0.05):
                break
        self.start = end.point.values
        return end

    def _begin_rise(self, plain: GrayPoint, low: Sequence[str], held: Mapping[str, float]) -> None:
        """Go to the best of several Stribeck speeds, from a fit without a rise.

        Stick and slip make the output anything but linear in that speed; from a wrong one the
        search ends in a minimum where the piston sticks at other times.
        """
        request = self.case.request
        slowest, fastest = slowest_and_fastest(moving_speeds(plain))
        dry = max(plain.values["coulomb"], self.unknowns["coulomb"].scale)
        scales = {"stribeck": dry, "stribeck_speed": float(np.sqrt(slowest * fastest))}
        limits = {"stribeck_speed": (0.5 * slowest, 2.0 * fastest)}
        self.unknowns |= make_unknowns(self.case.variant.parameters, low, scales, request, limits)
        free = [*plain.problem.free, *(self.unknowns[n] for n in low)]
        problem = replace(plain.problem, free=free)
        starts: list[tuple[Values, Sequence[FloatArray]]] = []
        for speed in np.geomspace(slowest, fastest, _SPEEDS + 2)[1:-1]:
            for share in _SHARES:
                begin = {"stribeck": share * dry, "stribeck_speed": float(speed)}
                begin = {n: request.start.get(n, held.get(n, begin[n])) for n in STRIBECK}
                if "coulomb" not in held:
                    begin["coulomb"] = (1.0 - share) * plain.values["coulomb"]
                starts.append(({**plain.values, **begin}, plain.initial))
        best = _best_end(problem, starts)
        for factor in _BESIDE if "stribeck_speed" in low else ():
            speed = factor * best.values["stribeck_speed"]
            other = {**best.values, "stribeck_speed": speed}
            # all else first, or the search slides back
            held_there = replace(problem, free=[u for u in free if u.name != "stribeck_speed"])
            side = solve_gray_box(held_there, other, best.initial, max_iterations=_SIDE_STEPS).point
            end = solve_gray_box(problem, side.values, side.initial, max_iterations=_SIDE_STEPS)
            best = min(best, end.point, key=lambda s: s.cost)
        self.start = best.values
        fall = _MARGIN * FrictionLaw.of(self.start).fall
        self.box = GrayBox.following(self.logs, self.case.machine, self.start["viscous"], fall)

    def undetermined(self, end: Minimum[GrayPoint]) -> list[Refusal]:
        """Return the parameter whose interval says least, if it says nothing."""
        solved, speeds = _solved(end.point), moving_speeds(end.point)
        rise = undetermined(solved, speeds, lambda held: _solved(self.solve(held).point))
        if rise:
            return rise
        sizes = {n: 0.5 * max(abs(solved.values[n]), 1e-300) for n in solved.names}
        friction = {n: self.unknowns[n].scale for n in ("viscous", "coulomb")}
        sensible = {**sizes, **sensible_widths(self.unknowns), **friction}
        sensible["bulk_modulus"] = _CERTAIN * solved.values["bulk_modulus"]
        sensible |= dict.fromkeys(STRIBECK, np.inf)  # that was all about them
        specs = [self.case.variant.parameter(n) for n in solved.names]
        # Losses and dead zone are refused before the gains, which may be certain without them. Not
        # so the bulk modulus: without them it would look certain in logs of plateaus alone.
        last = [s for s in specs if s.neutral is None and s.name != "bulk_modulus"]
        groups = ([s for s in specs if s.name == "bulk_modulus"],
                  [s for s in specs if s.neutral is not None], last)  # fmt: skip
        for group in groups:
            if refusals := left_open(solved, {s.name: s for s in group}, sensible):
                return refusals
        return []


def _best_end(
    problem: GrayProblem, starts: Sequence[tuple[Values, Sequence[FloatArray]]]
) -> GrayPoint:
    """Search from every start for a few steps, and go on with those that got farthest."""
    for steps, most in _ROUNDS:
        ends = [solve_gray_box(problem, *s, max_iterations=steps).point for s in starts]
        ends.sort(key=lambda s: s.cost)
        starts = [(s.values, s.initial) for s in ends[:most]]
    return ends[0]


def _solved(point: GrayPoint) -> Solved:
    """Values and covariance; nothing is known of a bulk modulus at its bound."""
    names, matrix = point.problem.names, point.uncertainty.covariance.copy()
    if "bulk_modulus" in names:
        k = names.index("bulk_modulus")
        matrix[k, k] = np.inf if point.active[k] else matrix[k, k]
    return Solved(point.values, names, matrix, point.uncertainty.degrees)


def fit_gray(case: Case) -> Solution[HydraulicCylinderOptions]:
    """Output error of pressures and position, refusing what the data do not determine."""
    search = _Search(case)
    fixed = {n: float(v) for n, v in case.request.fixed.items() if n in THETA}
    specs = {s.name: s for s in case.variant.parameters}
    try:
        found = determine(search.solve, search.undetermined, specs, fixed=fixed)
    except np.linalg.LinAlgError as error:
        raise NotIdentifiedError(
            "the equations of pressure and motion cannot follow these logs",
            expected="Nothing was written.",
            remedy="Check areas, volumes, mass and whether the supply pressure is steady; or leave "
            "out --mass: gains then follow from the balance of the flows.",
        ) from error
    end, notices = found.solution, found.notices
    point = end.point
    if not end.converged:
        notices.append(
            Notice(
                "not-converged",
                "the gray box stopped before it had settled: check areas, volumes, mass and "
                "supply pressure, or give --start values.",
            )
        )
    by_command, noise = command_noise(point)
    solved = Solved(
        point.values, point.problem.names, point.uncertainty.covariance + by_command,
        point.uncertainty.degrees, fixed, found.refused,
    )  # fmt: skip
    parameters, order, matrix = solved.quantities(case.variant.parameters)
    sigma = point.problem.sigma.tolist()
    options = replace(
        case.options, stage="gray-box", window=case.window, rest_position=case.rest_position,
        residual_pressure_1=sigma[0], residual_pressure_2=sigma[1], residual_position=sigma[2],
    )  # fmt: skip
    gains = directional_gains(case, {n: q.number for n, q in parameters.items()})
    return make_solution(
        simulate_runs, case.experiments, case.variant, options, parameters, order,
        NoiseModel(matrix), jacobians=_jacobians(point),
        simulate_near=Nearby(point, [(e.log, e.name) for e in case.experiments]),
        derived={**gains, **_resonance(case, solved)},
        notices=notices,
        details={
            "method": "gray-box output error of pressures and position",
            "iterations": end.iterations,
            "converged": end.converged,
            "command_noise": noise,
            "covariance": "long-run variance of the scores",
        },
    )  # fmt: skip


def _jacobians(point: GrayPoint) -> list[dict[str, FloatArray]]:
    """Derivatives of every measured channel of every log by the free parameters, ``(n, q)``."""
    out = []
    for log, rows in zip(point.problem.logs, point.jacobian):
        parts = rows.reshape(len(log.channels), log.samples, -1)
        sigma = point.problem.sigma
        out.append({CHANNELS[c]: sigma[c] * part for c, part in zip(log.channels, parts)})
    return out


def _start(case: Case, first: Values) -> tuple[dict[str, float], dict[str, float]]:
    """Start values from the flow balance, and the sizes of the friction."""
    machine = case.machine
    force = 0.01 * (machine.supply - machine.tank) * machine.area(1)
    speeds = [np.abs(np.diff(e["position"])).sum() / np.ptp(e.time) for e in case.experiments]
    speed = max(float(np.mean(speeds)), 1e-6)
    values = scales = {"viscous": force / speed, "coulomb": force}
    if case.friction.moving.sum() >= 8:
        found = fit_friction(case, lenient=True)[0].values
        values = {n: found[n] for n in scales}
        scales = {n: max(v, scales[n]) for n, v in values.items()}
    start = {**dict.fromkeys(GRAY_NAMES, 0.0), **first, **values}
    start["bulk_modulus"] = float(np.clip(first["bulk_modulus"], 2e8, 3e9))
    return {**start, **{n: v for n, v in case.request.start.items() if n in start}}, scales


def _noise(experiments: Sequence[Experiment]) -> FloatArray:
    """Noise of the three channels, with a floor [Pa, Pa, m]."""

    def noise(e: Experiment, role: str) -> float:
        least = max(e.signals[role].resolution, 1e-4 * float(np.ptp(e[role])))
        return noise_floor(e[role], 2) + least

    found = ([noise(e, role) for e in experiments if role in e] for role in CHANNELS)
    return np.array([max(values, default=1.0) for values in found])


def _spread(point: GrayPoint) -> FloatArray:
    """Root mean square of the residuals of each channel over all logs [Pa, Pa, m]."""
    total, count = np.zeros(3), np.zeros(3)
    for log, states in zip(point.problem.logs, point.states):
        rows = list(log.channels)
        total[rows] += np.sum((log.measured - states.T[rows]) ** 2, axis=1)
        count[rows] += log.samples
    spread = np.sqrt(total / np.maximum(count, 1.0))
    return np.where(spread > 0.0, spread, point.problem.sigma)


def _resonance(case: Case, solved: Solved) -> dict[str, Quantity]:
    """Undamped resonance of the piston between the closed chambers, in the middle of the logs."""
    m, mass, middle = case.machine, case.machine.mass or 1.0, np.array(case.rest_position)
    compliance = sum(m.area(i) ** 2 / float(m.volume(i, middle)) for i in (1, 2))

    def function(v: Values) -> Values:
        omega = np.sqrt(v["bulk_modulus"] * compliance / mass)
        return {"natural_frequency": omega, "damping_ratio": v["viscous"] / (2.0 * mass * omega)}

    return solved.derive({"natural_frequency": "rad/s", "damping_ratio": "1"}, function)
