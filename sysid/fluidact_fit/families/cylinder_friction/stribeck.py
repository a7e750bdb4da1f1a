"""How friction rises at low speed: its search, and when the logs show none or another law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...errors import UsageError
from ...estimation.results import Refusal, Solved
from ...experiment import FloatArray
from .regression import System
from .samples import Data, slowest_and_fastest

STRIBECK = ("stribeck", "stribeck_speed")
_ALIKE, _DIFFERENT = 1.1, 1.5  # ratios of speeds that are one, and that are two
_HELD = 0.01  # least share of the samples that a speed has
_GRID = 16  # speeds at which the search begins


def free_names(asked: bool, fixed: Mapping[str, float]) -> tuple[str, ...]:
    """Stribeck parameters that are estimated: those asked for and not fixed."""
    given = [n for n in STRIBECK if n in fixed]
    if len(given) == 1 and not asked:
        (other,) = set(STRIBECK) - set(given)
        raise UsageError(
            f"--fix {given[0]} means nothing without {other}",
            remedy=f"Give --fix {other}=VALUE too, or --stribeck=estimate.",
        )
    return tuple(n for n in STRIBECK if asked and n not in fixed)


@dataclass(frozen=True)
class _Search:
    """The speed on a grid from the slowest to the fastest sample; all else is linear in it."""

    data: Sequence[Data]
    names: Sequence[str]
    held: Mapping[str, float]
    exponent: float = 2.0

    @cached_property
    def grid(self) -> FloatArray:
        """Logarithms of the speeds, shape ``(_GRID,)``."""
        low, high = slowest_and_fastest(self.data)
        return np.linspace(np.log(low), np.log(high), _GRID)

    def solve(self, logarithm: float) -> tuple[float, float]:
        """Sum of squares [N2], and the level [N]."""
        others = [n for n in self.names if n != "stribeck_speed"]
        at = (0.0, float(np.exp(logarithm)))
        cost, values = System(
            self.data, others, self.held, stribeck=at, exponent=self.exponent
        ).quiet()
        return cost, {**self.held, **values}["stribeck"]

    @cached_property
    def found(self) -> tuple[FloatArray, FloatArray]:
        """Costs and levels over the grid."""
        costs, levels = zip(*(self.solve(s) for s in self.grid))
        return np.array(costs), np.array(levels)

    def best(self) -> tuple[float, float]:
        """Level and speed of the best rise towards rest, of the best fall where none rises."""
        from scipy.optimize import minimize_scalar

        costs, levels = self.found
        k = int(np.argmin(np.where(levels > 0.0, costs, np.inf) if levels.max() > 0.0 else costs))
        ends = self.grid[max(k - 1, 0)], self.grid[min(k + 1, _GRID - 1)]
        at = minimize_scalar(lambda s: self.solve(s)[0], bounds=ends, method="bounded",
                             options={"xatol": 1e-4}).x  # fmt: skip
        return self.solve(at)[1], float(np.exp(at))


def linearise(
    data: Sequence[Data], names: Sequence[str], held: Mapping[str, float]
) -> tuple[float, float]:
    """Stribeck level and speed [N, m/s] at which to make the equation linear; zeros: none."""
    if "stribeck_speed" not in names:
        return held.get("stribeck", 0.0), held.get("stribeck_speed", 0.0)
    return _Search(data, names, held).best()


def other_shape(
    data: Sequence[Data], names: Sequence[str], held: Mapping[str, float]
) -> tuple[str, float] | None:
    """A law that fits better with as many unknowns, and by how much of the misfit.

    A level that *falls* towards rest is what friction that grows faster than in proportion
    to the speed looks like.
    """
    if not set(STRIBECK) <= set(names):
        return None
    search = _Search(data, names, held)
    costs, levels = search.found
    if levels.max() <= 0.0:
        return None
    own = float(np.min(costs[levels > 0.0]))
    rivals = [
        (float(np.min(np.where(levels < 0.0, costs, np.inf))),
         "that grows faster than in proportion to the speed"),
        (float(np.min(_Search(data, names, held, exponent=1.0).found[0])),
         "that falls off from rest as exp(-|v| / stribeck_speed)"),
    ]  # fmt: skip
    cost, words = min(rivals)
    return None if cost > own else (words, 1.0 - cost / own)


def _count_speeds(data: Sequence[Data]) -> int:
    """How many clearly different speeds the logs have; a continuous range counts by its width."""
    speed = np.abs(np.concatenate([d.speed for d in data]))
    bins = np.floor(np.log(speed / speed.min()) / np.log(_ALIKE)).astype(int)
    share = np.bincount(bins) / speed.size
    held = np.flatnonzero(share >= _HELD)
    runs = np.split(held, np.flatnonzero(np.diff(held) > 1) + 1)
    return sum(max(1, round(r.size * np.log(_ALIKE) / np.log(_DIFFERENT))) for r in runs)


def undetermined(found: Solved, data: Sequence[Data]) -> list[Refusal]:
    """Both parameters, where the rise is not beyond doubt or its speed could be any."""
    if not any(n in found.names for n in STRIBECK):
        return []
    level, speed = (found.values[n] for n in STRIBECK)
    low, high = slowest_and_fastest(data)
    axis = data[0].axis
    half = {n: found.half_width(n) for n in STRIBECK if n in found.names}
    seen = f"the logs show motion from {low:.2g} to {high:.2g} {axis.speed_unit}"
    speeds, needed = _count_speeds(data), 2 + len(half)
    if speeds < needed:
        reason = f"that takes {needed} clearly different speeds, and the strokes have {speeds}."
    elif level <= half.get("stribeck", 0.0):
        rise = f"{level:.3g} ± {half.get('stribeck', 0.0):.2g} {axis.force_unit}"
        reason = f"friction does not rise beyond doubt at low speed ({rise}); {seen}."
    elif "stribeck_speed" in half and not (
        low < speed < 0.7 * high and half["stribeck_speed"] < 0.7 * speed
    ):
        found_speed = f"{speed:.2g} ± {half['stribeck_speed']:.2g} {axis.speed_unit}"
        reason = f"its speed would be {found_speed}; {seen}."
    else:
        return []
    return [Refusal(n, reason) for n in STRIBECK if n in found.names]
