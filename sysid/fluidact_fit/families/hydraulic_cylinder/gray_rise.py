"""Where the search for a Stribeck rise begins: from several speeds, and the best one counts.

Stick and slip make the output anything but linear in the speed at which friction rises; from a
wrong one the iteration ends beside the answer, in a minimum where the piston sticks at other times.
The misfit is then followed along that speed, all else fitted again, for as long as that leads to
a better minimum.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ...estimation.named_model import Values, make_unknowns
from ...estimation.stribeck import STRIBECK, slowest_and_fastest
from ...experiment import FloatArray
from .case import Case
from .gray_search import GraySolution, moving_speeds, solve_gray_box

_SPEEDS = 6  # to begin with, evenly apart on a logarithmic scale
_SHARES = (0.3, 0.6)  # of the dry friction that are Stribeck rise at first
_ROUNDS = (
    (2, 14),
    (2, 6),
    (8, 2),
    (20, 1),
)  # steps of the search from each start, and how many go on
_BESIDE = (0.63, 0.8, 1.25, 1.6)  # times the speed of a minimum, from where a better one is sought
_HOPS = 3  # from minimum to minimum, at most
_SIDE_STEPS = 6  # of the search from there, at that speed and then free
_BETTER = 0.01  # part of the misfit that another minimum has to save
_ENOUGH = 0.1 * _BETTER  # a step that saves less does not make one


def find_rise(
    plain: GraySolution,
    first: Values,
    low: Sequence[str],
    held: Mapping[str, float],
    case: Case,
    *,
    near: bool,
) -> GraySolution:
    """Add a Stribeck rise, of the unknown parameters ``low``, to a fit without one.

    Its values, and the ``first`` ones that it began with, are what the search begins with: a fit
    without a rise that is there may be far off. ``near`` is that of :func:`.solve_gray_box`.
    """
    problem, request = plain.problem, case.request
    slowest, fastest = slowest_and_fastest(moving_speeds(plain))
    sizes = {u.name: u.scale for u in problem.free}
    dry = max(plain.values["coulomb"], sizes.get("coulomb", 0.0))
    scales = {"stribeck": dry, "stribeck_speed": float(np.sqrt(slowest * fastest))}
    limits = {"stribeck_speed": (0.5 * slowest, 2.0 * fastest)}
    unknowns = make_unknowns(case.variant.parameters, low, scales, request, limits)
    wider = replace(problem, free=[*problem.free, *unknowns.values()])
    starts: list[tuple[Values, Sequence[FloatArray]]] = []
    for base in (plain.values, {**plain.values, **{n: first[n] for n in problem.names}}):
        for speed in np.geomspace(slowest, fastest, _SPEEDS + 2)[1:-1]:
            for share in _SHARES:
                begin = {"stribeck": share * dry, "stribeck_speed": float(speed)}
                begin = {n: request.start.get(n, held.get(n, begin[n])) for n in STRIBECK}
                if "coulomb" in sizes:
                    begin["coulomb"] = (1.0 - share) * base["coulomb"]
                starts.append(({**base, **begin}, plain.initial))
    best = plain
    for steps, most in _ROUNDS:
        ends = [
            solve_gray_box(wider, values, initial, steps, near=near) for values, initial in starts
        ]
        ends.sort(key=lambda s: s.cost)
        best, starts = ends[0], [(s.values, s.initial) for s in ends[:most]]
        request.progress(
            f"Stribeck friction {best.values['stribeck']:.3g} N at "
            f"{best.values['stribeck_speed']:.3g} m/s: error {best.cost:.6g}"
        )
    return _hop(best, case, near) if "stribeck_speed" in low else best


def _hop(best: GraySolution, case: Case, near: bool) -> GraySolution:
    """Go on from a minimum to better ones beside it, along the Stribeck speed."""
    free = best.problem.free
    others = replace(best.problem, free=[u for u in free if u.name != "stribeck_speed"])
    (unknown,) = [u for u in free if u.name == "stribeck_speed"]
    side = partial(solve_gray_box, max_iterations=_SIDE_STEPS, near=near, enough=_ENOUGH)
    for _ in range(_HOPS):
        ends = []
        for factor in _BESIDE:
            speed = min(max(factor * best.values["stribeck_speed"], unknown.low), unknown.high)
            begin = {**best.values, "stribeck_speed": speed}
            at = side(others, begin, best.initial)
            ends.append(side(best.problem, at.values, at.initial))
        other = min(ends, key=lambda s: s.cost)
        if not other.cost < (1.0 - _BETTER) * best.cost:
            break
        best = other
        case.request.progress(
            f"Stribeck friction {best.values['stribeck']:.3g} N at "
            f"{best.values['stribeck_speed']:.3g} m/s instead: error {best.cost:.6g}"
        )
    return best
