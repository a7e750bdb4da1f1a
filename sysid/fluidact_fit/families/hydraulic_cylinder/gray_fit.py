"""The gray box of pressures and position: its fit, and what it refuses to say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...errors import Notice, NotIdentifiedError
from ...estimation.minimise import Minimum
from ...estimation.named_model import make_unknowns
from ...estimation.noise import noise_floor
from ...estimation.parametric import at_limits
from ...estimation.results import Refusal, Solved, determine, find_uninformative
from ...estimation.stribeck import (
    STRIBECK,
    free_names,
    slowest_and_fastest,
    undetermined,
    with_speed,
)
from ...experiment import Experiment
from ...family import NoiseModel, Plant, Simulated, Solution, make_solution
from ...mechanics.hydraulic_cylinder import GRAY_NAMES, THETA
from .gray_box import (
    CHANNELS,
    GrayBox,
    GrayPoint,
    command_noise,
    make_gray_log,
    moving_speeds,
    solve_gray_box,
)
from .options import HydraulicCylinderOptions
from .regression import allowed_half_widths, directional_gains, fit_flow, fit_friction
from .setup import Setup, read_machine
from .simulation import simulate_runs
from .windows import mean_command

_PART = 4_000  # samples in which the search for a Stribeck rise begins
_SHORTEST = 100  # samples of a piece of a log
_SPEEDS = 6  # at which the search for a Stribeck rise begins
_SHARES = (0.3, 0.6)  # of the dry friction that are Stribeck rise at first
_ROUNDS = ((2, 4), (6, 2), (20, 1))  # steps from each start, and how many of them go on
_BESIDE = (0.63, 0.8, 1.25, 1.6)  # times the best speed, where a better one is looked for
_SIDE_STEPS = 6  # of that search, at that speed and then free
_MARGIN = 1.5  # by which friction may fall more steeply than where that search ended
_CERTAIN = 0.3  # half-width of an interval of the bulk modulus that still says something


class _Search:
    """Fits the gray box again and again; ``begin`` has weights and values of the last time."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        first = fit_flow(setup, lenient=True)
        sizes = _friction_sizes(setup)
        start = {**dict.fromkeys(GRAY_NAMES, 0.0), **first.values, **sizes}
        if setup.friction.moving.sum() >= 8:
            found = fit_friction(setup)[0]
            start |= {n: found.values[n] for n in found.names if n in sizes}
        start["bulk_modulus"] = float(np.clip(first.values["bulk_modulus"], 2e8, 3e9))
        start |= {n: v for n, v in setup.request.start.items() if n in start}
        friction = make_unknowns(setup.variant.parameters, (*sizes,), sizes, setup.request)
        self.unknowns = {**first.unknowns, **friction}
        logs = [make_gray_log(e, setup.machine) for e in setup.experiments]
        box = GrayBox.following(logs, setup.machine, {**setup.request.fixed, **sizes})
        sigma = np.array([
            max(noise_floor(e[c], 2) + max(e.signals[c].resolution, 1e-4 * float(np.ptp(e[c])))
                for e in setup.experiments)
            for c in CHANNELS
        ])  # fmt: skip
        self.begin = GrayPoint.of(box, logs, sigma, start)
        self.low = free_names(setup.options.stribeck == "estimate", setup.request.fixed)

    def solve(self, held: Mapping[str, float]) -> Minimum[GrayPoint]:
        """Estimate what is not held."""
        low, whole = [n for n in self.low if n not in held], self.begin
        if low and not whole.values.get("stribeck_speed"):
            length = max(_PART // (4 * len(whole.logs)), _SHORTEST)
            pieces = [piece for log in whole.logs for piece in log.pieces(length)]
            self.begin = GrayPoint.of(whole.box, pieces, whole.sigma, whole.values)
            plain = self._settle({**held, **dict.fromkeys(low, 0.0)})
            best = self._with_rise(plain.point, low, held)
            self.begin = GrayPoint.of(best.box, whole.logs, self.begin.sigma, best.values)
        return self._settle(held, low)

    def _settle(self, held: Mapping[str, float], low: Sequence[str] = ()) -> Minimum[GrayPoint]:
        """Search from the last values; the weights follow the residuals."""
        free = [self.unknowns[n] for n in (*GRAY_NAMES, *low) if n not in held]
        self.begin = replace(self.begin, free=free, values={**self.begin.values, **held})
        for _ in range(3):
            end = solve_gray_box(self.begin)
            self.setup.request.progress(
                f"gray box: {end.iterations} steps, weighted error {end.point.cost:.6g}"
            )
            spread = np.where(end.point.spread > 0.0, end.point.spread, 1.0)
            self.begin = replace(end.point, sigma=end.point.sigma * spread)
            if np.all(np.abs(spread - 1.0) < 0.05):
                break
        return end

    def _with_rise(
        self, plain: GrayPoint, low: Sequence[str], held: Mapping[str, float]
    ) -> GrayPoint:
        """Go to the best of several Stribeck speeds, from a fit without a rise.

        Stick and slip make the output anything but linear in that speed; from a wrong one the
        search ends in a minimum where the piston sticks at other times.
        """
        request = self.setup.request
        slowest, fastest = slowest_and_fastest(moving_speeds(plain))
        dry = max(plain.values["coulomb"], self.unknowns["coulomb"].scale)
        scales = {"stribeck": dry, "stribeck_speed": float(np.sqrt(slowest * fastest))}
        limits = {"stribeck_speed": (0.5 * slowest, 2.0 * fastest)}
        self.unknowns |= make_unknowns(self.setup.variant.parameters, low, scales, request, limits)
        free = [*plain.free, *(self.unknowns[n] for n in low)]
        points = []
        for speed in np.geomspace(slowest, fastest, _SPEEDS + 2)[1:-1]:
            for share in _SHARES:
                begin = {"stribeck": share * dry, "stribeck_speed": float(speed)}
                begin = {n: request.start.get(n, held.get(n, begin[n])) for n in STRIBECK}
                if "coulomb" not in held:
                    begin["coulomb"] = (1.0 - share) * plain.values["coulomb"]
                points.append(replace(plain, free=free, values={**plain.values, **begin}))
        for steps, most in _ROUNDS:
            ends = (solve_gray_box(s, max_iterations=steps).point for s in points)
            points = sorted(ends, key=lambda s: s.cost)[:most]
        best = points[0]
        # with all else first at another speed, or the search slides back
        others = [u for u in free if u.name != "stribeck_speed"]
        for factor in _BESIDE if "stribeck_speed" in low else ():
            values = {**best.values, "stribeck_speed": factor * best.values["stribeck_speed"]}
            point = replace(best, values=values)
            for some in (others, free):
                point = replace(point, free=some)
                point = solve_gray_box(point, max_iterations=_SIDE_STEPS).point
            best = min(best, point, key=lambda s: s.cost)
        steeper = {**best.values, "stribeck": _MARGIN * best.values["stribeck"]}
        return replace(best, box=GrayBox.following(best.logs, best.box.machine, steeper))

    def undetermined(self, end: Minimum[GrayPoint]) -> list[Refusal]:
        """Return the parameter whose interval says least, if it says nothing."""
        solved, speeds = _solved(end.point), moving_speeds(end.point)
        rise = undetermined(solved, speeds, lambda held: _solved(self.solve(held).point))
        if rise:
            return rise
        request, specs = self.setup.request, {s.name: s for s in self.setup.variant.parameters}
        if ends := at_limits(solved, specs, self.unknowns, request):
            return ends
        sizes = {n: 0.5 * max(abs(solved.values[n]), 1e-300) for n in solved.names}
        friction = {n: self.unknowns[n].scale for n in ("viscous", "coulomb")}
        max_half_widths = {**sizes, **allowed_half_widths(self.unknowns), **friction}
        max_half_widths["bulk_modulus"] = _CERTAIN * solved.values["bulk_modulus"]
        max_half_widths |= dict.fromkeys(STRIBECK, np.inf)  # that was all about them
        # Losses and dead zone are refused before the gains, which may be certain without them. Not
        # so the bulk modulus: without them it would look certain in logs of plateaus alone.
        bulk = {"bulk_modulus": specs["bulk_modulus"]}
        neutral = {n: s for n, s in specs.items() if s.neutral is not None}
        for group in (bulk, neutral, specs):
            if refusals := find_uninformative(solved, group, max_half_widths):
                return refusals
        return []


def _solved(point: GrayPoint) -> Solved:
    found = point.uncertainty
    return Solved(point.values, point.names, found.covariance, found.degrees)


def fit_gray(setup: Setup) -> Solution[HydraulicCylinderOptions]:
    """Output error of pressures and position, refusing what the data do not determine."""
    search = _Search(setup)
    fixed = {n: float(v) for n, v in setup.request.fixed.items() if n in THETA}
    specs = {s.name: s for s in setup.variant.parameters}
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
    solved = _solved(point)
    solved = replace(
        solved, covariance=solved.covariance + by_command, fixed=fixed, refused=found.refused
    )
    parameters, order, matrix = solved.quantities(setup.variant.parameters)
    sigma = point.sigma.tolist()
    options = replace(
        setup.options, stage="gray-box", window=setup.window, rest_position=setup.rest_position,
        residual_pressure_1=sigma[0], residual_pressure_2=sigma[1], residual_position=sigma[2],
    )  # fmt: skip
    gains = directional_gains(setup, {n: q.number for n, q in parameters.items()})
    return make_solution(
        simulate_runs, setup.experiments, setup.variant, options, parameters, order,
        NoiseModel(matrix), jacobians=[
            dict(zip(CHANNELS, point.sigma[:, None, None] * j.reshape(3, log.samples, -1)))
            for log, j in zip(point.logs, point.jacobian)
        ],
        simulate_near=Nearby(point, [(e.log, e.name) for e in setup.experiments]),
        derived={
            **gains,
            **solved.derive(
                {"natural_frequency": "rad/s", "damping_ratio": "1"},
                lambda v: resonance(v, options),
            ),
        },
        notices=notices,
        details={
            "method": "gray-box output error of pressures and position",
            "iterations": end.iterations,
            "converged": end.converged,
            "command_noise": noise,
            "covariance": "long-run variance of the scores",
        },
    )  # fmt: skip


@dataclass(frozen=True)
class Nearby:
    """Simulation of the fitted runs with slightly other inputs, values or options.

    Initial states are taken to first order, which takes an eighth of a search for them.
    ``runs`` are log and name of each fitted one.
    """

    fit: GrayPoint
    runs: Sequence[tuple[int, str]]

    def __call__(
        self, plant: Plant[HydraulicCylinderOptions], experiments: Sequence[Experiment]
    ) -> list[Simulated]:
        """Simulate some of the fitted runs, or their beginnings; see `.Family.simulate`."""
        values = with_speed(plant.numbers, moving_speeds(self.fit))
        box = replace(self.fit.box, machine=read_machine(plant.options, (1, 2)))
        return [self._run(e, box, values) for e in experiments]

    def _run(self, e: Experiment, box: GrayBox, values: Mapping[str, float]) -> Simulated:
        k = self.runs.index((e.log, e.name))
        command = self.fit.logs[k].command.copy()
        command[: e.samples - 1] = mean_command(e)  # of a beginning
        change = self.fit.change(k, command, box, values).reshape(3, -1)
        channels = self.fit.states[k].T[:3] + change * self.fit.sigma[:, None]
        simulated = dict(zip(CHANNELS, channels[:, : e.samples]))
        return Simulated(simulated.pop(CHANNELS[-1]), also=simulated)


def _friction_sizes(setup: Setup) -> dict[str, float]:
    """Friction to begin with: 1 % of the largest force, at the mean speed for the viscous one."""
    machine = setup.machine
    force = 0.01 * (machine.supply - machine.tank) * machine.area(1)
    speeds = [np.abs(np.diff(e["position"])).sum() / np.ptp(e.time) for e in setup.experiments]
    return {"viscous": force / max(float(np.mean(speeds)), 1e-6), "coulomb": force}


def resonance(values: Mapping[str, Any], options: HydraulicCylinderOptions) -> dict[str, Any]:
    """Undamped resonance of the piston between the closed chambers, in the middle of the logs."""
    m = read_machine(options, (1, 2))
    mass, stiffness = m.mass or 1.0, m.stiffness(options.rest_position or 0.0)
    omega = np.sqrt(values["bulk_modulus"] * stiffness / mass)
    return {"natural_frequency": omega, "damping_ratio": values["viscous"] / (2.0 * mass * omega)}
