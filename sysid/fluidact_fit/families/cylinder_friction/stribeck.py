"""How friction rises at low speed: the search for it in a regression."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

from ...errors import Notice
from ...estimation.stribeck import STRIBECK, RiseSearch, shape_notice, slowest_and_fastest
from .regression import System
from .samples import Data, moving_speeds


def _search(
    data: Sequence[Data], names: Sequence[str], held: Mapping[str, float], exponent: float = 2.0
) -> RiseSearch:
    others = [n for n in names if n != "stribeck_speed"]

    def solve(speed: float) -> tuple[float, float]:
        """Sum of squares [N2], and the level [N]."""
        at = System(data, others, held, stribeck=(0.0, speed), exponent=exponent)
        cost, values = at.quiet()
        return cost, {**held, **values}["stribeck"]

    speeds = moving_speeds(data)
    return RiseSearch(slowest_and_fastest(speeds), speeds.size, solve)


def linearise(
    data: Sequence[Data], names: Sequence[str], held: Mapping[str, float]
) -> tuple[float, float]:
    """Stribeck level and speed [N, m/s] at which to make the equation linear; zeros: none."""
    if "stribeck_speed" not in names:
        return held.get("stribeck", 0.0), held.get("stribeck_speed", 0.0)
    return _search(data, names, held).rise[1:]


def other_shape(
    data: Sequence[Data], names: Sequence[str], held: Mapping[str, float]
) -> Notice | None:
    """Say that another law fits better with as many unknowns, where one does."""
    if not set(STRIBECK) <= set(names):
        return None
    return shape_notice(partial(_search, data, names, held))
