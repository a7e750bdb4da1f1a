"""Where the search of the motor begins, and how far it may go.

The gain is linear: at any other values it follows without a search. Coarse grids of the lag
and then of the curve therefore find the right valley for a few dozen simulations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from ...errors import LogError
from ...estimation.named_model import NamedModel, bind
from ...estimation.problem import Unknown
from ...estimation.separable import profile
from ...experiment import Experiment
from ...family import FamilyOptions, Request

_SHARES = {  # of what limits them
    "dead_zone": (0.05, 0.3, 0.65),
    "saturation_command": (0.9, 0.7, 0.4),
    "curvature": (0.3, 3.0),
    "hysteresis": (0.03, 0.2),
}


def highest_command(experiments: Sequence[Experiment]) -> float:
    """Largest size of the command in any log [unit of the command]."""
    return max(float(np.abs(e.sampled("command")).max()) for e in experiments)


def sizes(
    experiments: Sequence[Experiment], saturated: bool
) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """Typical size of every parameter, and the range that is searched."""
    top = highest_command(experiments)
    speed = max(float(np.ptp(e["speed"])) for e in experiments)
    if top == 0.0 or speed == 0.0:
        raise LogError(
            "command or speed does not change in any log",
            remedy="Record a staircase of the command from zero to saturation and back.",
        )
    step = max(e.sample_time for e in experiments)
    span = min(float(np.ptp(e.time)) for e in experiments)
    table = {
        "dead_zone": (0.1 * top, 0.0, 0.95 * top),
        "gain": (2.0 * speed / top, 0.0, 1e4 * speed / top),
        "curvature": (1.0 / top, 0.0, 50.0 / top),
        "saturation_command": (top, 0.02 * top, top),
        "hysteresis": (0.05 * top, 0.0, 1.5 * top),
        "time_constant": (3.0 * step, 0.01 * step, 2.0 * span),
        "dead_time": (step, 0.0, 0.5 * span),
    }
    if not saturated:
        del table["saturation_command"]
    scales = {n: scale for n, (scale, _, _) in table.items()}
    return scales, {n: (low, high) for n, (_, low, high) in table.items()}


def find_starts(
    model: NamedModel, unknowns: Mapping[str, Unknown], request: Request[FamilyOptions]
) -> list[dict[str, float]]:
    """Best of a grid of lags for a typical curve, then of grids of curves behind that lag."""
    held = {n: v for n, v in request.fixed.items() if n in unknowns}
    free = [n for n in model.nonlinear if n not in held]
    problem = bind(model, unknowns, held)
    top = 10.0 * unknowns["dead_zone"].scale
    size = {"curvature": 1.0 / top}
    values = {n: shares[0] * size.get(n, top) for n, shares in _SHARES.items()}
    step, late = unknowns["dead_time"].scale, unknowns["dead_time"].high
    lags = np.unique([0.5 * step, *np.geomspace(min(2.0 * step, late), late, 8)])
    slow = np.geomspace(step, max(0.3 * late, 2.0 * step), 5)

    def rank(**wanted: Sequence[float]) -> list[dict[str, float]]:
        grid = {n: points for n, points in wanted.items() if n in free}
        every = [{**values, **dict(zip(grid, point))} for point in product(*grid.values())]
        every = [{**v, **request.start} for v in every]
        cost = profile(problem, np.array([[v[n] for n in free] for v in every]))
        return [every[k] for k in np.argsort(cost, kind="stable")]

    values = {**values, "time_constant": slow[0], "dead_time": lags[0]}
    values = rank(time_constant=slow.tolist(), dead_time=lags.tolist())[0]
    curves = {n: [s * size.get(n, top) for s in shares] for n, shares in _SHARES.items()}
    if "saturation_command" not in free:
        return rank(**curves)[:2]
    # a search that slides to the last command sees no saturation any more: one from each
    ends = curves.pop("saturation_command")
    return [rank(**curves, saturation_command=[end])[0] for end in ends]
