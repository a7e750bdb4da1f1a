"""Static levels of a drive commanded in steps: between two commanded levels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from ...estimation.price import exhausted, spent
from ...estimation.uncertainty import independent_samples
from ...experiment import FloatArray
from .model import (
    BREAKAWAY,
    EXCESS,
    SIDES,
    Compared,
    DriveModel,
    increments,
    leading_parts,
)
from .stages import Stage, values_at

_ROUNDS = 12  # of bracketing the levels and refitting the others, at most
_PASSES = 8  # of choosing among neighbouring levels, at most
_WORTH = 1e-3  # share by which the cost has to fall in a round to be worth another one
_NEAR = 4  # commanded levels on either side of a bracket that are tried as well
_CELLS = 20  # into which the first pass over the levels divides them
_CELLS_NEAR = 14  # into which a later one does, near what an earlier one found
# A search may cost this much, counted in nodes that are simulated, an event being worth many;
# some seconds. Logs whose every level fits differently (lost rows, noise) would take for ever.
_LIMIT = 1e7
_EVENT = 250
_REFITS = 3  # at one level, however much has been spent
_HOPELESS = 20.0  # times the best cost: more than that by linear prediction is not refitted
_TOLD = 4.0  # twice the logarithm of the likelihoods of two levels: two standard errors
_FAR = 6.0  # times the error of the encoder: a fit so far off may be at the wrong levels
_BETTER = 0.25  # of the cost, that is left at the right ones: noise of the drive stays
_AROUND = 8  # cells on either side of both levels that are tried together
_PAIRS = 5  # of them that are refitted
_CELLS_REFITTED = 40  # at most, inside a bracket, when everything is refitted beside them


@dataclass(frozen=True)
class Bracket:
    """A static level between the highest torque that held and the lowest that did not.

    ``value`` lies where the logs are fitted best: in the middle, unless levels in between
    fit worse than both ends.
    """

    low: float
    high: float
    value: float

    @property
    def std_error(self) -> float:
        """Of a value that lies anywhere in between."""
        return (self.high - self.low) / float(np.sqrt(12.0))


def over_cells(edges: FloatArray, costs: FloatArray, most: float, margin: int = 0) -> Bracket:
    """Bracket over every cell of a cost up to ``most``, its value among those around the best.

    The cells lie between ascending ``edges``; ``margin`` more on either side are taken in.
    """
    best, last = int(np.argmin(costs)), costs.size - 1
    good, bad = np.flatnonzero(costs <= most), np.flatnonzero(costs > most)
    around = bad[bad < best].max(initial=-1) + 1, bad[bad > best].min(initial=last + 1) - 1

    def ends(first: int, final: int) -> tuple[float, float]:
        low, high = max(first - margin, 0), min(final + margin, last) + 1
        return float(edges[low]), float(edges[high])

    return Bracket(*ends(good[0], good[-1]), 0.5 * sum(ends(*around)))


def search_level(
    cost: Callable[[float], float],
    levels: FloatArray,
    slack: float,
    near: Bracket | None = None,
    exhausted: Callable[[], bool] = lambda: False,
) -> Bracket:
    """Find the steps of a staircase that fit best, coarse to fine.

    The cost is constant between two neighbours of the ascending ``levels``; a share of
    ``slack`` more than the least is as good. What an earlier pass found is looked for
    again ``near`` it. Cells that fit equally well may lie apart. What counts is how much they
    span, not how many they are: where that is nearly all that was looked at, or where the
    search is ``exhausted``, looking again is not worth its price.
    """
    low, high, cells = 0, levels.size - 1, _CELLS
    if near is not None:
        reach, cells = 0.15 * near.value, _CELLS_NEAR
        low = max(int(np.searchsorted(levels, near.low - reach)) - 1, 0)
        high = min(int(np.searchsorted(levels, near.high + reach)), high)
    if high <= low:
        return Bracket(float(levels[low]), float(levels[low]), float(levels[low]))
    while True:
        marks = np.unique(np.linspace(low, high, cells + 1).astype(int))
        costs = np.array([cost(0.5 * (levels[a] + levels[b])) for a, b in pairwise(marks)])
        most = float(costs.min()) * (1.0 + slack)
        first, final = np.flatnonzero(costs <= most)[[0, -1]]
        finest = costs.size == high - low
        if finest or final - first + 3 >= costs.size or exhausted():
            # a coarse cell is judged by its middle, so the right level may lie next to it
            return over_cells(levels[marks], costs, most, margin=0 if finest else 1)
        low, high = int(marks[max(first - 1, 0)]), int(marks[min(final + 2, costs.size)])


def bracket_levels(stage: Stage) -> tuple[Stage, dict[str, Bracket]]:
    """Bracket the static levels of a drive that is commanded in steps.

    A held torque jumps past the static level, so the motion does not depend on where
    between two commanded levels it lies: the cost is a staircase, which a gradient does
    not see. It is searched level by level, the other parameters refitted in between, until
    the cost no longer falls.

    Returns the stage with the levels held and the others refitted, and the brackets by the
    name of the level. Nothing is changed where there is no level to find.
    """
    sides = stage.open_sides()
    if not sides:
        return stage, {}
    staircase = _Staircase(stage, lag=True)
    least, values = np.inf, dict(stage.start)
    brackets: dict[str, Bracket] = {}
    for _ in range(_ROUNDS):
        before = dict(brackets)
        for s in sides:
            found = staircase.search(values, s, brackets.get(BREAKAWAY[s]))
            brackets[BREAKAWAY[s]] = found
            values[BREAKAWAY[s]] = found.value
        refitted = staircase.refit(values)
        values = refitted.values
        if brackets == before or refitted.cost > least * (1.0 - _WORTH) or staircase.exhausted():
            break
        least = refitted.cost
    brackets = staircase.recorded(brackets, values)
    return _held(stage, brackets, values), brackets


def narrow_levels(
    stage: Stage, brackets: Mapping[str, Bracket]
) -> tuple[Stage, dict[str, Bracket]]:
    """Choose among neighbouring brackets by the position itself, all else refitted.

    One break-away a sample late displaces all that follows by less than a step of the
    encoder: increments do not see it, the position does, and it would bend every other
    parameter.
    """
    staircase, found = _Staircase(stage, lag=False), dict(brackets)
    best = staircase.refit(stage.start)
    for _ in range(_PASSES):
        before = best.cost
        for name in brackets:
            found[name], best = staircase.choose(name, found[name], best)
        if best.cost < before * (1.0 - staircase.slack) and not staircase.exhausted():
            continue
        moved = staircase.choose_both(found, best)
        if moved is None:
            break
        found, best = moved
    found = staircase.recorded(found, best.values)
    return _held(stage, found, best.values), found


def _held(stage: Stage, brackets: Mapping[str, Bracket], values: Mapping[str, float]) -> Stage:
    """The stage with bracketed levels held in place of the excesses."""
    levels = {n: b.value for n, b in brackets.items()}
    renamed = {EXCESS[s]: BREAKAWAY[s] for s in SIDES if BREAKAWAY[s] in levels}
    return replace(
        stage,
        names=tuple(renamed.get(n, n) for n in stage.names),
        start={n: v for n, v in values.items() if n not in renamed},
        fixed={**stage.fixed, **levels},
    )


class _Staircase:
    """Cost of the logs over the static levels; the ``others`` are refitted beside them."""

    def __init__(self, stage: Stage, lag: bool) -> None:
        part = leading_parts(stage.experiments)
        self.stage, self.axis = replace(stage, experiments=part, refusals=()), stage.axis
        self.compared = increments(part, stage.axis) if lag else Compared()
        self.model = DriveModel(part, stage.axis, self.compared)
        kept = {*stage.held, *BREAKAWAY.values(), *EXCESS.values()}
        self.others = [n for n in stage.names if n not in kept]
        # share of the cost that does not count as a difference
        self.slack = _TOLD / sum(y.size for y in self.model.measured)
        motions = self.model.motions(stage.start)
        price = sum(m.velocity.size + _EVENT * m.stops for m in motions)
        share = sum(e.samples for e in part) / sum(e.samples for e in stage.experiments)
        self._most = spent() + share * _LIMIT / price

    def exhausted(self) -> bool:
        """Whether the search has simulated as much as it may, whatever the computer."""
        return spent() > self._most or exhausted()

    def levels(self, values: Mapping[str, float], side: str) -> FloatArray:
        """The kinetic level and every commanded one above it, ascending, lost rows included."""
        acting = [passes.torque.coefficients[:, 0] for passes, _ in self.model.inputs]
        return levels_above(acting, values, side)

    def recorded(
        self, brackets: Mapping[str, Bracket], values: Mapping[str, float]
    ) -> dict[str, Bracket]:
        """The brackets from recorded level to recorded level: a lost row's is not known."""
        drives = [e.sampled(self.axis.drive) for e in self.stage.experiments]
        out = {}
        for name, b in brackets.items():
            levels = levels_above(drives, values, name.removeprefix("breakaway_"))
            below, above = levels[levels <= b.low], levels[levels >= b.high]
            low, high = below.max(initial=-np.inf), above.min(initial=np.inf)
            out[name] = replace(
                b,
                low=float(low) if np.isfinite(low) else b.low,
                high=float(high) if np.isfinite(high) else b.high,
            )
        return out

    def cost(self, values: Mapping[str, float]) -> float:
        """Sum of squared errors, the offset of the position of every run taken out."""
        r = self.errors(values)
        return float(r @ r)

    def errors(self, values: Mapping[str, float]) -> FloatArray:
        """Errors of all runs, the offset of the position of every run taken out."""
        out = []
        for y, model in zip(self.model.measured, self.model.compared_rows(values)):
            r = y - model
            out.append(r if self.compared.lag else r - r.mean())
        return np.concatenate(out)

    def search(self, values: Mapping[str, float], side: str, near: Bracket | None) -> Bracket:
        """The level of one direction, all else held."""
        name = BREAKAWAY[side]
        return search_level(
            lambda x: self.cost({**values, name: x}), self.levels(values, side), self.slack, near,
            self.exhausted,
        )  # fmt: skip

    def refit(self, values: Mapping[str, float]) -> _Refitted:
        """Fit the others, the static levels held."""
        fixed = {n: v for n, v in values.items() if n not in self.others}
        stage = replace(self.stage, names=tuple(values), start=values, fixed=fixed)
        problem = stage.problem(self.compared)
        found = stage.solve(problem, max_iterations=15, tolerance=0.05)
        now = {**values, **values_at(problem, found.eta)}
        independent = sum(map(_independent, found.residuals))
        return _Refitted(found.cost, now, np.vstack(found.jacobian), independent)

    def choose(self, name: str, bracket: Bracket, best: _Refitted) -> tuple[Bracket, _Refitted]:
        """The bracket of one level among the commanded ones, and the fit there."""
        levels = self.levels(best.values, name.removeprefix("breakaway_"))
        if levels.size < 2:
            return bracket, best
        edges = narrowing_edges(levels, bracket)
        skipped = edges.size < np.ptp(np.searchsorted(levels, edges)) + 1
        middles = 0.5 * (edges[1:] + edges[:-1])
        errors = [self.errors({**best.values, name: x}) for x in middles]
        plain = np.array([r @ r for r in errors])
        # cells of the same cost have the same events: one refit stands for all of them
        groups = np.split(np.arange(middles.size), np.flatnonzero(np.diff(plain) != 0.0) + 1)
        least = best.predict(np.array([errors[g[0]] for g in groups]))
        sure = least > _HOPELESS * best.cost
        found: dict[int, _Refitted] = {}
        for k in map(int, np.argsort(least, kind="stable")):
            if sure[k] or (len(found) >= _REFITS and self.exhausted()):
                break
            middle = middles[groups[k][groups[k].size // 2]]
            found[k] = self.refit({**best.values, name: float(middle)})
            least[k], sure[k] = found[k].cost, True
        if not found:
            return bracket, best
        first = min(found.values(), key=lambda f: f.cost)
        # what forces beyond the model leave is autocorrelated, and says less of a level
        slack = max(self.slack, _TOLD / max(min(first.independent, best.independent), 1.0))
        most = min(first.cost, best.cost) * (1.0 + slack)
        if first.cost > most:
            return bracket, best
        sizes = [g.size for g in groups]
        # what was not refitted any more may be as good, but it is not known to be
        ends = over_cells(edges, np.repeat(np.where(sure, least, most), sizes), most, int(skipped))
        known = over_cells(edges, np.repeat(np.where(sure, least, np.inf), sizes), most)
        value = known.value
        if first.cost < best.cost:
            best = first
        return replace(ends, value=value), best.at(name, value)

    def choose_both(
        self, brackets: Mapping[str, Bracket], best: _Refitted
    ) -> tuple[dict[str, Bracket], _Refitted] | None:
        """The brackets of two levels moved together, to the cells near them that fit best.

        Each makes up for the other, so that neither can be moved alone. ``None`` where the position
        is not missed by far, or not by far less than before.
        """
        rows = sum(y.size for y in self.model.measured)
        far = best.cost > rows * (_FAR * self.stage.rounding) ** 2
        if not far or len(brackets) < 2 or self.exhausted():
            return None
        cells = [self._cells_near(name, best) for name in brackets]
        pairs = list(product(*(range(edges.size - 1) for edges in cells)))
        if not pairs:
            return None
        points = [
            {n: 0.5 * float(e[k] + e[k + 1]) for n, e, k in zip(brackets, cells, pair)}
            for pair in pairs
        ]
        predicted = best.predict(np.array([self.errors({**best.values, **p}) for p in points]))
        chosen = list(np.argsort(predicted, kind="stable")[:_PAIRS])
        found = {int(k): self.refit({**best.values, **points[k]}) for k in chosen}
        k, first = min(found.items(), key=lambda pair: pair[1].cost)
        if first.cost > _BETTER * best.cost:
            return None
        # what was as good before is looked at again
        return {
            n: Bracket(min(b.low, float(e[i])), max(b.high, float(e[i + 1])), points[k][n])
            for (n, b), e, i in zip(brackets.items(), cells, pairs[k])
        }, first

    def _cells_near(self, name: str, best: _Refitted) -> FloatArray:
        """Commanded levels about the present value of a static one."""
        levels = self.levels(best.values, name.removeprefix("breakaway_"))
        at = int(np.searchsorted(levels, best.values[name]))
        return levels[max(at - 1 - _AROUND, 0) : at + 1 + _AROUND]


@dataclass(frozen=True)
class _Refitted:
    """A fit beside held static levels: its cost, all values, and the Jacobian there.

    ``independent`` is how many independent samples its residuals are worth.
    """

    cost: float
    values: dict[str, float]
    jacobian: FloatArray
    independent: float

    def predict(self, errors: FloatArray) -> FloatArray:
        """Costs that refits would reach from rows of errors if the Jacobian stayed as it is."""
        size = np.linalg.norm(self.jacobian, axis=0)
        basis, _ = np.linalg.qr(self.jacobian / np.where(size > 0.0, size, 1.0))
        left = errors - (errors @ basis) @ basis.T
        return np.sum(np.square(left), axis=1)

    def at(self, name: str, level: float) -> _Refitted:
        """The same fit at another level that the logs cannot tell from its own."""
        return replace(self, values={**self.values, name: level})


def _independent(residual: FloatArray) -> float:
    """How many independent samples would show the size of the residual as well."""
    power = float(residual @ residual)
    if power == 0.0:
        return float(residual.size)
    alike = min(max(float(residual[1:] @ residual[:-1]) / power, 0.0), 1.0 - 1e-6)
    return independent_samples(alike, residual.size)


def levels_above(
    drives: Sequence[FloatArray], values: Mapping[str, float], side: str
) -> FloatArray:
    """The kinetic level of a direction and all levels of the drives above it, ascending."""
    drive = np.concatenate(drives) * (1.0 if side == "positive" else -1.0)
    kinetic = values[f"coulomb_{side}"]
    return np.concatenate(([kinetic], np.unique(drive[drive > kinetic])))


def narrowing_edges(levels: FloatArray, bracket: Bracket) -> FloatArray:
    """Commanded levels about a bracket: its neighbours, and not too many inside."""
    low, high = (int(k) for k in np.searchsorted(levels, (bracket.low, bracket.high)))
    inside = np.linspace(low, high, _CELLS_REFITTED + 1).astype(int)
    ends = (np.arange(k - _NEAR, k + _NEAR + 1) for k in (low, high))
    kept = np.unique(np.concatenate((inside, *ends)))
    return np.asarray(levels[kept[(kept >= 0) & (kept < levels.size)]])


def bracket_widths(
    drive: FloatArray, speed: FloatArray, values: Mapping[str, float]
) -> dict[str, float]:
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
        out[BREAKAWAY[s]] = max(float(high) - low, 0.0) / float(np.sqrt(12.0))
    return out
