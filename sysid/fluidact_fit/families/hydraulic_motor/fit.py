"""Fit of curve and lag: a motor that breaks away late from rest must not pass for a slow lag.

Residuals far outside the others count less (Huber weights). The limit is settled by the fit; a
simulation finds the offset of a log with the same one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import NotIdentifiedError
from ...estimation.named_model import NamedModel, Values, bind, make_unknowns
from ...estimation.parametric import Fitted, fit_named
from ...estimation.problem import Unknown
from ...estimation.results import Refusal
from ...estimation.separable import solve
from ...experiment import Experiment, FloatArray
from ...family import FamilyOptions, ParameterSpec, Request, Simulated
from ...options import choice, settled
from .equation import MotorModel
from .starts import find_starts, highest_command, sizes

_ROUNDS = 6  # of reweighting
_SIGNIFICANT = 12.0  # rise of the squared residuals, in variances, without a saturation
_POSSIBLE = 3.0  # the same, from which a saturation cannot be ruled out
_MATTERS = 5.0  # that rise times the standard errors by which it would move a parameter
_BENDS = (0.97, 0.93, 0.89, 0.85, 0.8, 0.75, 0.7, 0.6, 0.5, 0.4)  # shares of the highest command
_FAR = 4.0  # robust standard deviations from which a residual counts less


@dataclass(frozen=True)
class MotorOptions(FamilyOptions):
    """What is estimated beside the curve and the lag, and what the fit settles."""

    dead_time: str = choice(
        "estimate", ("none", "estimate"), "whether to estimate a dead time", "dead_time"
    )
    command_noise: float | None = settled(
        "float", "noise of a command of held levels, which are taken as their means", minimum=0.0
    )
    residual_limit: float | None = settled(
        "float", "residual of the speed beyond which a sample counts less", minimum=0.0
    )


@dataclass(frozen=True)
class MotorFit:
    """A finished fit, its model and the roots of the weights, and the limit of the residuals.

    ``bend`` are values with a saturation that the logs neither show nor rule out, where it would
    move others by a good part of their errors: one further out than any that was tried moves more.
    """

    fitted: Fitted
    model: NamedModel
    weights: list[FloatArray]
    limit: float
    bend: dict[str, float] | None = None

    @property
    def held(self) -> dict[str, float]:
        """Values that are not estimated: what was given, and what the data do not determine."""
        f = self.fitted
        return {**f.fixed, **{n: f.values[n] for n in f.refused}}

    def needs(self, name: str, without: float) -> bool:
        """Whether the fit is significantly better than one with a parameter at another value."""
        f = self.fitted
        held = {**self.held, name: without}
        start = [f.values[n] for n in self.model.nonlinear if n not in held]
        other = solve(bind(self.model, f.unknowns, held), np.array(start))
        rows = sum(r.size for r in f.solution.residuals)
        return bool(other.cost - f.solution.cost > _SIGNIFICANT * f.solution.cost / rows)

    def moved(self, values: Values) -> float:
        """How far other values of the parameters lie, in their standard errors, at most."""
        f = self.fitted
        return max((abs(values[n] - f.values[n]) / f.std_error(n) for n in f.names), default=0.0)


def fit_motor(
    specs: Sequence[ParameterSpec], experiments: Sequence[Experiment],
    request: Request[MotorOptions],
) -> MotorFit:  # fmt: skip
    """Fit with a saturation where the speeds show one, else without.

    A saturation that is not determined, or that the residuals do not ask for, is none. A search
    for it can slide to the highest command, where it leaves no trace; it is then sought again
    from the best fit without one.
    """
    name = "saturation_command"
    found = _fit_saturated(specs, experiments, request)
    if found is not None:
        return found
    without = _fit(specs, experiments, request, saturated=False)
    if name in request.start:
        return without
    bend, rise = _find_bend(specs, experiments, request, without)
    again = _fit_saturated(specs, experiments, request, [bend]) if rise > _SIGNIFICANT else None
    # the more it moves, the less has to speak for it
    possible = rise > _POSSIBLE and rise * without.moved(bend) > _MATTERS
    return again or replace(without, bend=bend if possible else None)


def _fit_saturated(
    specs: Sequence[ParameterSpec],
    experiments: Sequence[Experiment],
    request: Request[MotorOptions],
    begin: Sequence[Mapping[str, float]] = (),
) -> MotorFit | None:
    """The fit with a saturation, ``None`` where the logs do not show it."""
    name = "saturation_command"
    try:
        found = _fit(specs, experiments, request, True, begin)
    except NotIdentifiedError:
        if name in request.fixed:
            raise
        return None
    beyond = 10.0 * highest_command(experiments)
    if name in request.fixed or (
        _saturates(found.fitted, experiments) and found.needs(name, beyond)
    ):
        return found
    return None


def _find_bend(
    specs: Sequence[ParameterSpec],
    experiments: Sequence[Experiment],
    request: Request[MotorOptions],
    without: MotorFit,
) -> tuple[dict[str, float], float]:
    """Values with the saturation that improves most on a fit without one, and by how much.

    That is the fall of the squared residuals, in variances.
    """
    model, unknowns = _setup(specs, experiments, request, saturated=True)
    model, fitted = replace(model, weights=without.weights), without.fitted
    values, top = fitted.values, highest_command(experiments)
    found, best = dict(values), fitted.solution.cost
    for share in _BENDS:
        held = {**without.held, "saturation_command": share * top}
        free = [n for n in model.nonlinear if n not in held]
        problem = bind(model, unknowns, held)
        solution = solve(problem, np.array([values[n] for n in free]))
        if solution.cost < best:
            linear = [n for n in model.linear if n not in held]
            best = solution.cost
            found = {**values, **held, **dict(zip(free, solution.eta.tolist()))}
            found |= dict(zip(linear, solution.linear.tolist()))
    rows = sum(y.size for y in model.measured)
    return found, rows * (fitted.solution.cost / best - 1.0)


def _setup(
    specs: Sequence[ParameterSpec],
    experiments: Sequence[Experiment],
    request: Request[MotorOptions],
    saturated: bool,
) -> tuple[NamedModel, dict[str, Unknown]]:
    scales, limits = sizes(experiments, saturated)
    unknowns = make_unknowns(specs, tuple(scales), scales, request, limits)
    return MotorModel(experiments).named(tuple(scales), [e["speed"] for e in experiments]), unknowns


def _fit(
    specs: Sequence[ParameterSpec],
    experiments: Sequence[Experiment],
    request: Request[MotorOptions],
    saturated: bool,
    begin: Sequence[Mapping[str, float]] = (),
) -> MotorFit:
    model, unknowns = _setup(specs, experiments, request, saturated)
    top, measured = highest_command(experiments), model.measured
    sensible = {
        "dead_zone": 0.3 * top, "hysteresis": 0.3 * top, "curvature": 3.0 / top,
        "dead_time": 20.0 * unknowns["dead_time"].scale,
    }  # fmt: skip
    begin = begin or find_starts(model, unknowns, request)
    settled_limit = request.options.residual_limit
    weights = [np.ones(y.size) for y in measured]
    for _ in range(_ROUNDS):
        used = weights
        model = replace(model, weights=used)
        fitted = fit_named(
            model, specs, request, unknowns, begin,
            sensible=sensible, refusals=_one_way(experiments),
        )  # fmt: skip
        rest = [y - m for y, m in zip(measured, fitted.solution.simulate())]
        typical = 1.4826 * float(np.median(np.abs(np.concatenate(rest))))
        limit = _FAR * typical if settled_limit is None else settled_limit
        new = [_weights(r, limit) for r in rest]
        change = max(float(np.abs(a - b).max()) for a, b in zip(new, weights))
        weights, begin = new, [fitted.values]
        if change < 0.05:
            break
    return MotorFit(fitted, model, used, limit)


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
    problem = bind(model.named(tuple(values), [e["speed"]]), {}, values)
    basis, weights = problem.model.basis(0, np.zeros(0)), np.ones(e.samples)
    rest, local = e["speed"] - basis.known, np.asarray(basis.local, dtype=float)
    for _ in range(_ROUNDS):
        found = np.linalg.lstsq(local * weights[:, None], rest * weights, rcond=None)[0]
        weights = _weights(rest - local @ found, limit)
    return Simulated(np.asarray(basis.known + local @ found), offset=float(found[0]))


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


def _saturates(fitted: Fitted, experiments: Sequence[Experiment]) -> bool:
    """Whether the commands go beyond the saturation by more than its uncertainty."""
    name = "saturation_command"
    reach = highest_command(experiments) - 0.5 * fitted.values["hysteresis"]
    return name in fitted.names and fitted.values[name] + 2.0 * fitted.std_error(name) < reach
