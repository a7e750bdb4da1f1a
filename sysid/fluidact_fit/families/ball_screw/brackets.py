"""Static levels of a drive commanded in steps: between two commanded levels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...estimation.inputs import interpolation
from ...estimation.parametric import Refusal, Values, bind
from ...estimation.separable import Unknown, solve
from ...experiment import Experiment, FloatArray
from ...family import Quantity, Request
from .beyond import forces_beyond_model
from .model import LONG, SIDES, Axis, Compared, DriveModel, increment_lag, leading_part
from .refusals import static_out_of_reach

_NEAR = 4  # commanded levels on either side of a bracket that are tried as well


@dataclass(frozen=True)
class Bracket:
    """A static level between the highest torque that held and the lowest that did not."""

    low: float
    high: float

    @property
    def value(self) -> float:
        return 0.5 * (self.low + self.high)

    @property
    def std_error(self) -> float:
        return (self.high - self.low) / float(np.sqrt(12.0))

    def quantity(self, unit: str) -> Quantity:
        """The level with its bracket as interval."""
        ends = [self.low, self.high]
        return Quantity(self.value, unit, "estimated", self.std_error, ends, "bracket")


def static_levels(
    experiments: Sequence[Experiment],
    axis: Axis,
    names: list[str],
    static: Sequence[str],
    unknowns: Mapping[str, Unknown],
    start: dict[str, float],
    request: Request,
    refusals: list[Refusal],
) -> tuple[dict[str, float], list[str], Request, list[Refusal], dict[str, Bracket]]:
    """Bracket the static levels of a drive commanded in steps, when that can be done.

    Once forces beyond the model decide the instant of break-away, no level is left to
    bracket and it is refused.
    """
    nothing: dict[str, Bracket] = {}
    before = start, names, request, refusals, nothing
    if any(interpolation(e.signals[axis.drive]) != "zoh" for e in experiments):
        return before
    request.progress("bracketing the static levels")
    brackets, refitted = _bracket_static(experiments, axis, start, static, unknowns, refusals)
    if not brackets:
        return before
    held, free, asked = _hold_brackets(brackets, {**start, **refitted}, names, request)
    if forces_beyond_model(experiments, axis, free, unknowns, held, asked, refusals):
        return start, names, request, [*refusals, *static_out_of_reach(static, refusals)], {}
    return held, free, asked, refusals, brackets


def _bracket_static(
    experiments: Sequence[Experiment],
    axis: Axis,
    start: Mapping[str, float],
    static: Sequence[str],
    unknowns: Mapping[str, Unknown],
    refusals: Sequence[Refusal],
) -> tuple[dict[str, Bracket], dict[str, float]]:
    """Bracket the static levels of a drive that is commanded in steps.

    A held torque jumps past the static level, so the motion does not depend on where
    between two commanded levels it lies: the cost is a staircase, which a gradient does
    not see. It is searched level by level, the other parameters refitted in between;
    those are returned as well.
    """
    held = {r.parameter: float(r.hold or 0.0) for r in refusals}
    sides = [
        s for s, name in zip(SIDES, static) if name.startswith("stiction") and name not in held
    ]
    values = {k: v for k, v in start.items() if not k.startswith(("stiction", "breakaway"))}
    for s in SIDES:
        inner = f"stiction_{s}"
        values[f"breakaway_{s}"] = start.get(
            f"breakaway_{s}", start[f"coulomb_{s}"] + start.get(inner, 0.0)
        )
    part = [leading_part(e, LONG) for e in experiments]
    model = DriveModel(part, axis, Compared(lag=increment_lag(part, axis)))
    others = [n for n in unknowns if n in values and n not in held and "breakaway" not in n]
    brackets: dict[str, Bracket] = {}
    seen: list[tuple[float, float]] = []
    for _ in range(4):
        for s in sides:
            near = brackets.get(f"breakaway_{s}")
            brackets[f"breakaway_{s}"] = bracket = _search_level(model, part, axis, values, s, near)
            values[f"breakaway_{s}"] = bracket.value
        _, values = _refit(model, values, others, unknowns)
        now = [(b.low, b.high) for b in brackets.values()]
        if now == seen:
            break
        seen = now
    values = _narrow(DriveModel(part, axis), part, axis, brackets, values, others, unknowns)
    return brackets, {n: values[n] for n in others}


def _refit(
    model: DriveModel,
    values: Mapping[str, float],
    others: Sequence[str],
    unknowns: Mapping[str, Unknown],
) -> tuple[float, dict[str, float]]:
    """Cost and values after fitting ``others``, the static levels held."""
    fixed = {n: v for n, v in values.items() if n not in others}
    known = {**unknowns, **{n: Unknown(n, v) for n, v in fixed.items()}}
    problem = bind(model.named(list(values)), known, fixed)
    order = [u.name for u in problem.nonlinear]
    eta = np.array([values[n] for n in order])
    found = solve(problem, eta, max_iterations=15, tolerance=0.05)
    return found.cost, {**values, **dict(zip(order, map(float, found.eta)))}


def _commanded_levels(
    experiments: Sequence[Experiment], axis: Axis, values: Mapping[str, float], side: str
) -> FloatArray:
    """The kinetic level and every commanded one above it, ascending."""
    sign = 1.0 if side == "positive" else -1.0
    drive = np.concatenate([sign * e.sampled(axis.drive) for e in experiments])
    kinetic = values[f"coulomb_{side}"]
    return np.concatenate(([kinetic], np.unique(drive[drive > kinetic])))


def _search_level(
    model: DriveModel,
    experiments: Sequence[Experiment],
    axis: Axis,
    values: Mapping[str, float],
    side: str,
    near: Bracket | None = None,
) -> Bracket:
    """Find the step of the staircase that fits best, coarse to fine.

    ``near`` is where an earlier pass found it: only its neighbourhood is searched again.
    """
    levels = _commanded_levels(experiments, axis, values, side)
    low, high = 0, levels.size - 1
    if near is not None:
        margin = 0.15 * near.value
        low = max(int(np.searchsorted(levels, near.low - margin)) - 1, 0)
        high = min(int(np.searchsorted(levels, near.high + margin)), levels.size - 1)

    def cost(level: float) -> float:
        tried = {**values, f"breakaway_{side}": level}
        total = 0.0
        for i, y in enumerate(model.measured):
            r = y - model.columns(i, tried).known
            total += float(r @ r)
        return total

    samples = sum(y.size for y in model.measured)
    while high - low > 1:
        marks = np.unique(np.linspace(low, high, 15 if near else 21).astype(int))
        costs = np.array([cost(0.5 * (levels[a] + levels[b])) for a, b in pairwise(marks)])
        good = np.flatnonzero(costs <= costs.min() * (1.0 + 4.0 / samples))
        finest = marks.size == high - low + 1
        # a coarse cell is judged by its middle, so the right level may lie next to it
        margin = 0 if finest else 1
        low = int(marks[max(good[0] - margin, 0)])
        high = int(marks[min(good[-1] + 1 + margin, marks.size - 1)])
        if finest or good.size + 2 >= marks.size - 1:
            break
    return Bracket(float(levels[low]), float(levels[high]))


def _narrow(
    model: DriveModel,
    experiments: Sequence[Experiment],
    axis: Axis,
    brackets: dict[str, Bracket],
    values: dict[str, float],
    others: Sequence[str],
    unknowns: Mapping[str, Unknown],
) -> dict[str, float]:
    """Choose among neighbouring brackets by the position itself, all else refitted.

    One break-away a sample late displaces all that follows by less than a step of the
    encoder: increments do not see it, the position does, and it would bend every other
    parameter. ``brackets`` is changed; the refitted values are returned.
    """
    samples = sum(y.size for y in model.measured)
    best, values = _refit(model, values, others, unknowns)
    for _ in range(3):
        before = best
        for name, bracket in list(brackets.items()):
            side = name.removeprefix("breakaway_")
            levels = _commanded_levels(experiments, axis, values, side)
            if levels.size < 2:
                continue
            low = max(int(np.searchsorted(levels, bracket.low)) - _NEAR, 0)
            high = min(int(np.searchsorted(levels, bracket.high)) + _NEAR, levels.size - 1)
            edges = levels[low : high + 1]
            middles = 0.5 * (edges[1:] + edges[:-1])
            plain = np.array([_position_cost(model, {**values, name: x}) for x in middles])
            # cells of the same cost have the same events: one refit stands for all of them
            steps = np.flatnonzero(np.diff(plain) != 0.0) + 1
            groups = np.split(np.arange(middles.size), steps)
            tried = [{**values, name: float(middles[g[g.size // 2]])} for g in groups]
            found = [_refit(model, t, others, unknowns) for t in tried]
            costs = np.array([cost for cost, _ in found])
            k = int(np.argmin(costs))
            if costs[k] >= best:
                costs, k = np.append(costs, best), len(groups)
            good = [g for g, c in zip(groups, costs) if c <= costs[k] * (1.0 + 4.0 / samples)]
            if not good:
                continue
            brackets[name] = Bracket(float(edges[good[0][0]]), float(edges[good[-1][-1] + 1]))
            if k < len(groups):
                best, values = found[k]
            values = {**values, name: brackets[name].value}
        if best >= before:
            break
    return values


def _position_cost(model: DriveModel, values: Values) -> float:
    """Sum of the squared errors of the position, the offset of every log taken out."""
    total = 0.0
    for i, y in enumerate(model.measured):
        r = y - np.real(model.columns(i, values).known)
        r = r - r.mean()
        total += float(r @ r)
    return total


def _hold_brackets(
    brackets: Mapping[str, Bracket],
    start: Mapping[str, float],
    names: Sequence[str],
    request: Request,
) -> tuple[dict[str, float], list[str], Request]:
    """Hold bracketed levels while the rest is fitted."""
    levels = {n: b.value for n, b in brackets.items()}
    replaced = {n.replace("breakaway", "stiction") for n in levels}
    kept = {n: v for n, v in start.items() if n not in replaced}
    free = [n if n not in replaced else n.replace("stiction", "breakaway") for n in names]
    return {**kept, **levels}, free, replace(request, fixed={**request.fixed, **levels})


def bracket_widths(drive: FloatArray, speed: FloatArray, values: Values) -> dict[str, float]:
    """Standard errors that held torques leave to the static levels.

    A level lies between the highest torque that held and the lowest that broke away;
    without a break-away nothing is known of it.
    """
    out = {}
    stuck, holds = speed[:-1] == 0.0, speed[1:] == 0.0
    for s, sign in zip(SIDES, (1.0, -1.0)):
        u = sign * drive[:-1]
        broke = u[stuck & ~holds & (u > 0.0)]
        low = max(u[stuck & holds].max(initial=0.0), values[f"coulomb_{s}"])
        high = broke.min(initial=np.inf)
        out[f"breakaway_{s}"] = max(float(high) - low, 0.0) / float(np.sqrt(12.0))
    return out


def append_variance(covariance: FloatArray, variance: float) -> FloatArray:
    """Add an independent parameter to a covariance."""
    size = covariance.shape[0]
    out = np.zeros((size + 1, size + 1))
    out[:size, :size] = covariance
    out[size, size] = variance
    return out
