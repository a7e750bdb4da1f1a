"""How friction rises at low speed: the Stribeck speed, and when the logs do not show it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...errors import UsageError
from ...estimation.results import Refusal, Solved
from .regression import System
from .samples import Data, slowest_and_fastest

STRIBECK = ("stribeck", "stribeck_speed")
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


def linearise(
    data: Sequence[Data], names: Sequence[str], held: Mapping[str, float]
) -> tuple[float, float]:
    """Stribeck level and speed [N, m/s] at which to make the equation linear; zeros: none.

    At a given speed the equation is linear in all else, so the speed is searched alone: on a
    grid from the slowest to the fastest sample, then between the neighbours of the best one.
    """
    from scipy.optimize import minimize_scalar

    if "stribeck_speed" not in names:
        return held.get("stribeck", 0.0), held.get("stribeck_speed", 0.0)
    others = [n for n in names if n != "stribeck_speed"]
    low, high = slowest_and_fastest(data)

    def solve(logarithm: float) -> tuple[float, dict[str, float]]:
        return System(data, others, held, stribeck=(0.0, float(np.exp(logarithm)))).quiet()

    grid = np.linspace(np.log(low), np.log(high), _GRID)
    k = int(np.argmin([solve(s)[0] for s in grid]))
    ends = grid[max(k - 1, 0)], grid[min(k + 1, _GRID - 1)]
    best = minimize_scalar(lambda s: solve(s)[0], bounds=ends, method="bounded",
                           options={"xatol": 1e-4}).x  # fmt: skip
    return {**held, **solve(best)[1]}["stribeck"], float(np.exp(best))


def undetermined(found: Solved, data: Sequence[Data]) -> list[Refusal]:
    """Both parameters, where the rise is not beyond doubt or its speed could be any."""
    if not any(n in found.names for n in STRIBECK):
        return []
    level, speed = (found.values[n] for n in STRIBECK)
    low, high = slowest_and_fastest(data)
    half = {n: found.half_width(n) for n in STRIBECK if n in found.names}
    seen = f"the logs show motion from {low:.2g} to {high:.2g} m/s"
    if level <= half.get("stribeck", 0.0):
        rise = f"{level:.3g} ± {half.get('stribeck', 0.0):.2g} N"
        reason = f"friction does not rise beyond doubt at low speed ({rise}); {seen}."
    elif "stribeck_speed" in half and not (
        low < speed < 0.7 * high and half["stribeck_speed"] < 0.7 * speed
    ):
        reason = f"its speed would be {speed:.2g} ± {half['stribeck_speed']:.2g} m/s; {seen}."
    else:
        return []
    return [Refusal(n, reason) for n in STRIBECK if n in found.names]
