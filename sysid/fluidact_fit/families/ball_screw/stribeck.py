"""How friction falls from the static to the kinetic level: its search, and when the logs show none.

The speed of the curve is one more unknown of the position. It is sought on a grid after the first
stages, which know only the two levels; from then on it is fitted with the others.

Under a torque that is held between samples the static level acts in two ways. When it is passed
shows only in steps, from one commanded level to the next; how the motion begins and ends depends
on it smoothly. Inside the cell between two commanded levels that fits best it is therefore fitted
like any other, and what the logs know of it is the change of the motion over its whole bracket.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...estimation.named_model import NamedModel
from ...estimation.parametric import BESIDE, DECIDED, Fitted, at_end_of_search
from ...estimation.problem import Unknown
from ...estimation.results import Refusal, Solved
from ...estimation.separable import solve
from ...estimation.stribeck import EXPONENT, another_fall
from ...estimation.uncertainty import covariance, t_quantile
from ...experiment import Experiment, FloatArray
from ...family import FamilyOptions, Quantity, Request, Simulate, UnmodelledEffect
from .brackets import Bracket, levels_above
from .model import (
    BREAKAWAY,
    EXCESS,
    SIDES,
    SPEED,
    Axis,
    DriveModel,
    increments,
    leading_parts,
)
from .stages import Stage, follow, values_at

_GRID = (0.003, 0.01, 0.03, 0.1, 0.3)  # of the fastest motion, where the search begins
_RANGE = (1e-4, 1.0)  # of the fastest motion, in which it goes on
_SEARCHED = 10_000  # samples of every log that the grid looks at
_LEAST_EXCESS = 0.2  # of the kinetic level, by which a static one begins above it
_FOLLOWED = 20_000  # samples of every log in which cells are tried
_WALK = 12  # cells that a level may move on
_TOLD = 4.0  # twice the logarithm of the likelihoods of two cells: two standard errors
_GLANCE = 6  # steps of a fit inside a cell, after which one may be given up
_HOPELESS = 4.0  # times the cost of the best cell, above which it is
_NARROW = 2.0  # times the least speed of the search: a curve that is narrower still
_WIDER = 10.0  # times the least speed of the search: a curve that the logs show, if there is one
_FASTEST = 0.7  # of the fastest motion, below which the kinetic level shows
_KNOWN = 0.7  # of its own value, to which the speed has to be known


def fastest(experiments: Sequence[Experiment], axis: Axis) -> float:
    """Speed that is hardly exceeded [rad/s or m/s]."""
    rates = [np.abs(np.gradient(e[axis.motion], e.time)) for e in experiments]
    return max(float(np.quantile(r, 0.99)) for r in rates)


def with_curve(stage: Stage, request: Request[FamilyOptions]) -> Stage:
    """The stage with the speed of the curve among its unknowns, where a grid fits best."""
    axis, top = stage.axis, fastest(stage.experiments, stage.axis)
    low, high = request.bounds.get(SPEED, (_RANGE[0] * top, _RANGE[1] * top))
    names = (*stage.names, SPEED)
    unknowns = {**stage.unknowns, SPEED: Unknown(SPEED, low, high, 0.1 * top)}
    lively = sorted(stage.experiments, key=lambda e: -float(np.ptp(e[axis.motion])))[:2]
    part = leading_parts(lively, _SEARCHED)
    searched = replace(stage, experiments=part, names=names, unknowns=unknowns)
    least = {EXCESS[s]: _LEAST_EXCESS * stage.start[f"coulomb_{s}"] for s in stage.open_sides()}
    begin = {**stage.start, **{n: max(x, stage.start[n]) for n, x in least.items()}}
    speeds = [request.start[SPEED]] if SPEED in request.start else [r * top for r in _GRID]
    best, start = np.inf, begin
    for speed in speeds:
        first = {**begin, SPEED: float(np.clip(speed, low, high))}
        problem = searched.problem(increments(part, axis))
        found = replace(searched, start=first).solve(problem, max_iterations=6, tolerance=0.05)
        if found.cost < best:
            best, start = found.cost, {**first, **values_at(problem, found.eta)}
    return replace(stage, names=names, unknowns=unknowns, start=start)


def fall_of(axis: Axis, values: Mapping[str, float]) -> UnmodelledEffect:
    """Another fall of friction; the derivative goes through the events."""

    def response(
        experiments: Sequence[Experiment], simulate: Simulate
    ) -> list[dict[str, FloatArray]]:
        out = []
        for e in experiments:
            model, _, begun = follow(e, axis, values)
            _, by = model.slopes(0, {**begun, EXPONENT: 2.0}, [EXPONENT])
            out.append({axis.motion: -by.known[0]})
        return out

    return another_fall(response)


def inside_cells(stage: Stage) -> tuple[Stage, dict[str, Bracket]]:
    """Fit the static levels of a drive that is commanded in steps, and the others beside them.

    First as if the motion depended on them smoothly everywhere, then inside the cells in which
    that ends and, until none fits better, inside their neighbours. Where the curve is as narrow as
    the search allows there is none, and the levels are not followed any further.

    Returns the stage with the levels held, and by their names the ranges that the logs leave to
    them: what is less than two standard errors away by the motion alone.
    """
    names = [BREAKAWAY[s] for s in stage.open_sides()]
    part = replace(stage, experiments=leading_parts(stage.experiments, _FOLLOWED))
    levels = {BREAKAWAY[s]: stage.start[f"coulomb_{s}"] + stage.start[EXCESS[s]]
              for s in stage.open_sides()}  # fmt: skip
    renamed = _with_levels_of_their_own(part, levels)
    drives = DriveModel(part.experiments, part.axis).inputs
    acting = [passes.torque.coefficients[:, 0] for passes, _ in drives]
    best = _Inside(renamed, dict.fromkeys(names, (0.0, np.inf)), levels)
    edges = {n: levels_above(acting, best.values, n.removeprefix("breakaway_")) for n in names}
    best = best.within({n: _cell(edges[n], best.values[n]) for n in names})
    worth = 1.0 - _TOLD / sum(e.samples for e in part.experiments)
    tried = {tuple(best.cells.items())}
    for _ in range(_WALK):
        if best.values[SPEED] <= _NARROW * stage.unknowns[SPEED].low:
            break
        nearby = [c for n in names for c in best.neighbours(n, edges[n])]
        new = [c for c in nearby if tuple(c.items()) not in tried]
        tried |= {tuple(c.items()) for c in new}
        better = min((best.within(c) for c in new), key=lambda o: o.cost, default=best)
        if better.cost >= worth * best.cost:
            break
        best = better
    found = {n: best.bracket(n) for n in names}
    fixed = {**stage.fixed, **{n: best.values[n] for n in names}}
    whole = _with_levels_of_their_own(stage, levels)
    return replace(whole, start={**whole.start, **best.values}, fixed=fixed), found


def _with_levels_of_their_own(stage: Stage, levels: Mapping[str, float]) -> Stage:
    """The stage with static levels in place of excesses."""
    own = {EXCESS[s]: BREAKAWAY[s] for s in SIDES if BREAKAWAY[s] in levels}
    start = {n: v for n, v in stage.start.items() if n not in own}
    return replace(
        stage, names=tuple(own.get(n, n) for n in stage.names), start={**start, **levels}
    )  # fmt: skip


def _cell(edges: FloatArray, level: float) -> tuple[float, float]:
    """The cell between ascending levels that holds one; the first and the last are wide."""
    k = int(np.clip(np.searchsorted(edges, level, side="right"), 1, max(edges.size - 1, 1)))
    return float(edges[k - 1]), float(edges[min(k, edges.size - 1)])


class _Inside:
    """A fit whose static levels stay in given cells.

    It is given up early where its cost stays far above ``rival``, that of another cell.
    """

    def __init__(
        self,
        stage: Stage,
        cells: Mapping[str, tuple[float, float]],
        start: Mapping[str, float],
        rival: float = np.inf,
    ) -> None:
        self.cells, self._stage = dict(cells), stage
        bounds = {n: Unknown(n, *cells[n], scale=x or 1.0) for n, x in start.items()}
        free = replace(
            stage, unknowns={**stage.unknowns, **bounds}, start={**stage.start, **start},
            fixed={n: v for n, v in stage.fixed.items() if n not in cells},
        )  # fmt: skip
        problem = free.problem()
        found = free.solve(problem, max_iterations=_GLANCE, tolerance=1e-4)
        if not found.converged and found.cost <= _HOPELESS * rival:
            found = solve(problem, found.eta, max_iterations=30 - _GLANCE, tolerance=1e-4)
        self._found = found
        self._order = [u.name for u in problem.nonlinear]
        self.cost = self._found.cost
        self.values = {**free.start, **values_at(problem, self._found.eta)}

    def bracket(self, name: str) -> Bracket:
        """Two standard errors of the motion on either side, no more than the cell if it is wide."""
        plain = covariance(self._found.jacobian, self._found.residuals, robust=False).covariance
        k, level, (low, high) = self._order.index(name), self.values[name], self.cells[name]
        reach = 2.0 * float(np.sqrt(plain[k, k]))
        if reach > high - low:
            return Bracket(max(level - reach, 0.0), level + reach, level)
        return Bracket(max(level - reach, low), min(level + reach, high), level)

    def within(self, cells: Mapping[str, tuple[float, float]]) -> _Inside:
        """The fit from where this one ended, levels that lie outside their cells in the middle."""
        begin = {n: self.values[n] for n in cells}
        begin |= {n: 0.5 * (a + b) for n, (a, b) in cells.items() if not a <= begin[n] <= b}
        return _Inside(replace(self._stage, start=self.values), cells, begin, self.cost)

    def neighbours(self, name: str, edges: FloatArray) -> Iterator[dict[str, tuple[float, float]]]:
        """The cells with that of one level moved by one, down and up, between ascending edges."""
        k = int(np.searchsorted(edges, self.cells[name][0]))
        for near in (k - 1, k + 1):
            if 0 <= near < edges.size - 1:
                yield {**self.cells, name: (float(edges[near]), float(edges[near + 1]))}


def with_levels(
    fitted: Fitted, model: NamedModel, drive: DriveModel, brackets: Mapping[str, Bracket]
) -> Fitted:
    """The fit with its bracketed levels among the estimates.

    What a level does to the position is taken over its bracket: the instants of break-away move
    in steps, which a derivative does not see.
    """
    columns = [_over_bracket(drive, fitted.values, n, b) for n, b in brackets.items()]
    jacobian = [
        np.column_stack((j, *(c[i] - c[i].mean() for c in columns)))
        for i, j in enumerate(fitted.solution.jacobian)
    ]
    solution = replace(fitted.solution, jacobian=jacobian)
    found = model.uncertainty(solution)
    return replace(
        fitted, solution=solution, names=(*fitted.names, *brackets), covariance=found.covariance,
        degrees=found.degrees, order=found.order,
        fixed={n: v for n, v in fitted.fixed.items() if n not in brackets},
    )  # fmt: skip


def _over_bracket(
    drive: DriveModel, values: Mapping[str, float], name: str, bracket: Bracket
) -> list[FloatArray]:
    """Change of every log per change of a level, from end to end of its bracket."""
    down, up = (drive.compared_rows({**values, name: x}) for x in (bracket.low, bracket.high))
    return [(b - a) / (bracket.high - bracket.low) for a, b in zip(down, up)]


def undetermined(found: Solved, top: float, unit: str, level_unit: str) -> Refusal | None:
    """The speed of the curve, where the logs do not show it; ``top`` is the fastest motion.

    A fall that is not beyond doubt has a speed by chance only, whatever its own interval says.
    """
    if SPEED in found.refused:
        return found.refused[SPEED]
    if SPEED not in found.names:
        return None
    speed, half = found.values[SPEED], found.half_width(SPEED)
    t = t_quantile(0.975, found.degrees)
    falls = [(q.number, t * float(np.asarray(q.std_error))) for q in _falls(found, level_unit)]
    if falls and all(fall <= doubt for fall, doubt in falls):
        fall, doubt = max(falls)
        return Refusal(
            SPEED, "static friction is not above the kinetic one beyond doubt "
            f"({fall:.2g} ± {doubt:.2g} {level_unit})."
        )  # fmt: skip
    seen = f"{speed:.2g} ± {half:.2g} {unit}, the logs move at up to {top:.2g} {unit}"
    if not half < _KNOWN * speed:
        reason = f"friction that falls at once when the axis moves explains them as well ({seen})."
    elif not speed < _FASTEST * top:
        reason = f"the axis never moves so fast that only kinetic friction is left ({seen})."
    else:
        return None
    return Refusal(SPEED, reason)


def _falls(found: Solved, unit: str) -> list[Quantity]:
    """How far each static level that was estimated lies above its kinetic one [``unit``]."""
    sides = [s for s in SIDES if {EXCESS[s], BREAKAWAY[s]} & {*found.names}]

    def function(v: Mapping[str, Any]) -> dict[str, Any]:
        return {
            s: v[EXCESS[s]] if EXCESS[s] in found.names else v[BREAKAWAY[s]] - v[f"coulomb_{s}"]
            for s in sides
        }

    return list(found.derive(dict.fromkeys(sides, unit), function).values())


def without_curve(stage: Stage, unit: str) -> Refusal | None:
    """The speed of the curve, where the beginnings of long logs tell that friction falls at once.

    The search ends as far down as it goes, and a speed ten times that is out of the question: the
    rest of the logs can only add to it.
    """
    part = leading_parts(stage.experiments, _SEARCHED)
    samples, low = sum(e.samples for e in part), stage.unknowns[SPEED].low
    if samples == sum(e.samples for e in stage.experiments):
        return None
    least = replace(stage, experiments=part)
    problem = least.problem()
    found = least.solve(problem, max_iterations=30, tolerance=0.05)
    values = {**stage.start, **values_at(problem, found.eta)}
    if values[SPEED] > (1.0 + BESIDE) * low:
        return None
    wider = replace(least, start=values, fixed={**stage.fixed, SPEED: _WIDER * low})
    other = wider.solve(wider.problem(), max_iterations=10, tolerance=0.05)
    if (other.cost - found.cost) * samples <= DECIDED * found.cost:
        return None
    return at_end_of_search(SPEED, values[SPEED], unit)


def without_level(stage: Stage) -> Refusal | None:
    """The speed of the curve, where no static level is known from which friction could fall."""
    if stage.open_sides() or any(b in stage.names for b in BREAKAWAY.values()):
        return None
    reasons = [r.reason for r in stage.refusals if r.parameter in EXCESS.values()]
    return Refusal(SPEED, f"no static level is known from which friction could fall: {reasons[-1]}")
