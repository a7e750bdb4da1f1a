"""Static levels: one profile of the misfit over the levels that a drive was commanded to.

The cells between commanded levels are tried, coarse to fine, all other parameters refitted; see
``docs/theory/static-levels.md``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from ...estimation.uncertainty import independent_samples
from ...experiment import FloatArray
from .model import BREAKAWAY, SIDES, Compared, DriveModel, increments, leading_parts
from .start import Stage

_ROUNDS = 8  # of one level after the other, at most
_CELLS = 24  # into which a pass over the commanded levels divides them
_REFITS = 2, 6  # of the others in one look at a level: by increments and by position, at most
_NEAR = 4  # commanded levels on either side of a bracket that are tried as well
_WORTH = 1e-2  # share by which the misfit has to fall in a round to be worth another one
_HOPELESS = 20.0  # times the best misfit: more than that by linear prediction is not refitted
_BEYOND_HELP = 100.0  # times the noise
_TOLD = 4.0  # twice the logarithm of the likelihoods of two levels: two standard errors


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


def find_levels(stage: Stage) -> tuple[Stage, dict[str, Bracket]]:
    """Find the static levels that are open, all else refitted beside them.

    By increments of the position, in which an early error does not displace all that follows.
    Returns where the search has ended, and the brackets by the name of the level.
    """
    part = leading_parts(stage.experiments)
    rough = _Profile(replace(stage, experiments=part), increments(part, stage.axis))
    # inverse dynamics knows no static level: beside a wrong one a search would leave its values
    at, brackets = rough.settle(rough.fit(stage.values, 0), {})
    return stage.at(at.values), brackets


def refine_levels(
    stage: Stage, near: Mapping[str, Bracket]
) -> tuple[Stage, dict[str, Bracket]]:  # fmt: skip
    """Choose among neighbouring brackets by the position itself, all else refitted.

    Of a drive that is held: one break-away a sample late moves the position by less than
    increments see, and would bend every other parameter.
    """
    opened = [BREAKAWAY[s] for s in stage.open_sides()]
    brackets = {n: b for n, b in near.items() if n in opened and stage.stepped}
    if not brackets:
        return stage, {}
    part = leading_parts(stage.experiments)
    fine = _Profile(replace(stage, experiments=part), Compared())
    at = fine.fit(stage.values)
    # far beyond the noise no other instant of a break-away would make the misfit small
    if at.cost < (_BEYOND_HELP * stage.noise) ** 2 * sum(e.samples for e in part):
        at, brackets = fine.settle_both(*fine.settle(at, brackets))
    unsure = stage.unknown_drive  # the drive of a row that was lost is known to that
    wide = {n: replace(b, low=max(b.low - unsure, 0.0), high=b.high + unsure)
            for n, b in brackets.items()}  # fmt: skip
    return stage.at(at.values), wide


class _Profile:
    """Misfit of the logs over the static levels; the ``others`` are refitted beside them."""

    def __init__(self, stage: Stage, compared: Compared) -> None:
        self.stage, self.compared = stage, compared
        self.model = DriveModel(stage.experiments, stage.axis, compared)
        weigh = _per_reading if 0 in compared.orders else np.ones_like
        self.weights = [weigh(y) for y in self.model.measured]
        kept = {*stage.held, *BREAKAWAY.values()}
        self.others = [n for n in stage.names if n not in kept]

    def settle(
        self, at: _Refitted, brackets: Mapping[str, Bracket]
    ) -> tuple[_Refitted, dict[str, Bracket]]:
        """Choose one level after the other until the misfit no longer falls.

        Where the drive is not held that is a start: the levels are free in what follows.
        """
        found = dict(brackets)
        for _ in range(_ROUNDS if self.stage.stepped else 1):
            before = at.cost
            for s in self.stage.open_sides():
                near = found[BREAKAWAY[s]] if brackets else None
                found[BREAKAWAY[s]], at = self._choose(s, at, near)
            if at.cost > before * (1.0 - _WORTH):
                break
        return at, found

    def settle_both(
        self, at: _Refitted, brackets: Mapping[str, Bracket]
    ) -> tuple[_Refitted, dict[str, Bracket]]:
        """Move both levels to cells nearby at once as long as the misfit falls.

        A break-away too late one way hides behind one too late, or too early, the other way: moved
        alone, either level fits worse.
        """
        found = dict(brackets)
        for _ in range(_ROUNDS if len(found) == len(SIDES) else 0):
            cells = [self._nearby(s, at, found[BREAKAWAY[s]]) for s in SIDES]
            pairs = [dict(zip(BREAKAWAY.values(), pair)) for pair in product(*cells)]
            levels = [{n: b.value for n, b in pair.items()} for pair in pairs]
            errors = np.array([self._errors({**at.values, **pair}) for pair in levels])
            # cells of the same events have the same errors: one refit stands for all of them
            costs, first = np.unique(at.predict(errors), return_index=True)
            likely = first[: _REFITS[1]][costs[: _REFITS[1]] < _HOPELESS * at.cost].tolist()
            tried = {k: self.fit({**at.values, **levels[k]}) for k in likely}
            best = min(tried, key=lambda k: tried[k].cost, default=-1)
            if best < 0 or tried[best].cost >= at.cost * (1.0 - _WORTH):
                break
            at, found = self.settle(tried[best], pairs[best])
        return at, found

    def _nearby(self, side: str, at: _Refitted, now: Bracket) -> list[Bracket]:
        """The cells below and above a bracket, and it itself."""
        levels = self._levels(side, at, now)
        below, above = levels[levels <= now.low][-_NEAR - 1 :], levels[levels >= now.high]
        ends = [*pairwise(below.tolist()), *pairwise(above[: _NEAR + 1].tolist())]
        return [now, *(Bracket(low, high, 0.5 * (low + high)) for low, high in ends)]

    def _levels(self, side: str, at: _Refitted, near: Bracket | None) -> FloatArray:
        """Commanded levels between which the static level of a direction can lie, ascending.

        Beside a bracket that is ``near``, its ends and such as act on the axis at rest.
        """
        limits = self.stage.unknowns[BREAKAWAY[side]]
        acting = [p.torque.coefficients[:, 0] for p, _ in self.model.inputs]
        if near is not None:
            speeds = [m.velocity for m in self.model.motions(at.values)]
            acting = [_at_rest(u, v) for u, v in zip(acting, speeds)]
        levels = levels_above(acting, at.values, side)
        if near is not None:
            levels = np.append(levels, (near.low, near.high))
        return np.unique(np.clip(levels, limits.low, limits.high))

    def fit(self, values: Mapping[str, float], iterations: int = 15) -> _Refitted:
        """Fit the others, the static levels held."""
        fixed = {n: v for n, v in values.items() if n not in self.others}
        stage = replace(
            self.stage, names=tuple(values), start=values, fixed=fixed, refusals=()
        )  # fmt: skip
        found, ended = stage.solve(self.compared, iterations, weights=self.weights)
        independent = sum(map(_independent, found.residuals, self.weights))
        return _Refitted(found.cost, dict(ended.start), np.vstack(found.jacobian), independent)

    def _errors(self, values: Mapping[str, float]) -> FloatArray:
        """Weighted errors of all runs, the offset of the position of every run taken out."""
        free = 0 in self.compared.orders
        errors = map(np.subtract, self.model.measured, self.model.compared_rows(values))
        return np.concatenate(
            [w * (e - np.average(e, weights=w**2) * free) for e, w in zip(errors, self.weights)]
        )

    def _choose(self, side: str, at: _Refitted, near: Bracket | None) -> tuple[Bracket, _Refitted]:
        """The bracket of one level among the commanded ones, and the fit there."""
        name, levels = BREAKAWAY[side], self._levels(side, at, near)
        low, high = 0, levels.size - 1
        if near is not None:
            low = max(int(np.searchsorted(levels, near.low)) - _CELLS // 2, low)
            high = min(int(np.searchsorted(levels, near.high)) + _CELLS // 2, high)
        if high <= low:
            edge = float(levels[min(low, levels.size - 1)])
            return Bracket(edge, edge, edge), at
        slack = _TOLD / max(at.independent, 1.0)
        while True:
            marks = np.unique(np.linspace(low, high, _CELLS + 1).astype(int))
            edges = levels[marks]
            middles = 0.5 * (edges[1:] + edges[:-1])
            errors = np.array([self._errors({**at.values, name: x}) for x in middles])
            costs = at.predict(errors)
            good = np.flatnonzero(costs <= costs.min() * (1.0 + slack))
            first, last = max(good[0] - 1, 0), min(good[-1] + 2, costs.size)
            finest = costs.size == high - low
            if finest or not self.stage.stepped or last - first >= costs.size:
                break
            low, high = int(marks[first]), int(marks[last])
        return self._refit(name, edges, errors, costs, at, 0 if finest else 1)

    def _refit(
        self, name: str, edges: FloatArray, errors: FloatArray, costs: FloatArray, at: _Refitted,
        margin: int,
    ) -> tuple[Bracket, _Refitted]:  # fmt: skip
        """Refit the others in the cells that may be best, and take all that are as good."""
        middles = 0.5 * (edges[1:] + edges[:-1])
        # cells of the same errors have the same events: one refit stands for all of them
        same = np.flatnonzero(np.any(np.diff(errors, axis=0) != 0.0, axis=1)) + 1
        groups = np.split(np.arange(middles.size), same)
        least = np.array([costs[g[0]] for g in groups])
        best = at
        refitted = np.zeros(len(groups), dtype=bool)
        most = _REFITS[0 in self.compared.orders]
        for k in np.argsort(least, kind="stable")[:most].tolist():
            if least[k] > _HOPELESS * best.cost:
                break
            cells = groups[k]
            found = self.fit({**at.values, name: float(middles[cells[cells.size // 2]])})
            least[k], refitted[k] = found.cost, True
            best = min(best, found, key=lambda f: f.cost)
        slack = _TOLD / max(min(at.independent, best.independent), 1.0)
        limit = best.cost * (1.0 + slack)
        sizes = [g.size for g in groups]
        ends = np.flatnonzero(np.repeat(least <= limit, sizes))
        if not ends.size:
            value = at.values[name]
            above = int(np.clip(np.searchsorted(edges, value), 1, edges.size - 1))
            low, high = min(edges[above - 1], value), max(edges[above], value)
            return Bracket(float(low), float(high), value), at
        known = np.repeat((least <= limit) & refitted, sizes)
        around = _around(known, int(np.argmin(np.repeat(np.where(refitted, least, np.inf), sizes))))
        value = 0.5 * float(edges[around[0]] + edges[around[1] + 1])
        low, high = max(ends[0] - margin, 0), min(ends[-1] + margin, middles.size - 1) + 1
        # a level that the logs cannot tell from that of the best fit
        best = replace(best, values={**best.values, name: value})
        return Bracket(float(edges[low]), float(edges[high]), value), best


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


def _around(good: np.ndarray, best: int) -> tuple[int, int]:
    """First and last of the good cells that lie about the best one without a gap."""
    bad = np.flatnonzero(~good)
    return int(bad[bad < best].max(initial=-1)) + 1, int(bad[bad > best].min(initial=good.size)) - 1


def _per_reading(values: FloatArray) -> FloatArray:
    """Weights by which rows of one reading, which share the error of its code, count as one."""
    first = np.flatnonzero(np.diff(values, prepend=np.inf))
    alike = np.diff(first, append=values.size)
    return 1.0 / np.sqrt(np.repeat(alike, alike))


def _independent(residual: FloatArray, weights: FloatArray) -> float:
    """Number of independent samples that would show the size of the residual as well."""
    power, samples = float(residual @ residual), float(weights @ weights)
    if power == 0.0:
        return samples
    alike = min(max(float(residual[1:] @ residual[:-1]) / power, 0.0), 1.0 - 1e-6)
    return independent_samples(alike, samples)


def _at_rest(drive: FloatArray, speed: FloatArray) -> FloatArray:
    """Levels of a drive at nodes ``(m,)`` while the axis rests or turns, and the next ones."""
    first = np.flatnonzero(np.diff(drive, prepend=np.inf))
    stands = np.flatnonzero(speed[:-1] * speed[1:] <= 0.0)
    held = np.unique(np.searchsorted(first, stands, side="right") - 1)
    reached = np.unique(held[:, None] + np.arange(_NEAR + 1))
    return drive[first[reached[reached < first.size]]]


def levels_above(
    drives: Sequence[FloatArray], values: Mapping[str, float], side: str
) -> FloatArray:
    """The kinetic level of a direction and all levels of the drives above it, ascending."""
    drive = np.concatenate(drives) * (1.0 if side == "positive" else -1.0)
    kinetic = values[f"coulomb_{side}"]
    return np.concatenate(([kinetic], np.unique(drive[drive > kinetic])))


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
