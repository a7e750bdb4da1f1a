"""Friction that the logs cannot tell: sides at rest, no break-away, unknown forces."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ...estimation.results import Refusal
from ...experiment import Experiment
from .model import EXCESS, SIDES, Axis, DriveModel

UNKNOWN_FORCES = (
    "the motion is dominated by forces beyond this model, which move the instant of "
    "break-away more than the static level does."
)
_NEVER = "the axis never breaks away from rest in this direction."


def withstood(experiments: Sequence[Experiment], axis: Axis) -> dict[str, float]:
    """Directions in which no log ever moves, and the strongest push there [SI], at least 0."""
    travel = dict.fromkeys(SIDES, 0.0)
    push = dict.fromkeys(SIDES, 0.0)
    for e in experiments:
        y, drive = e[axis.motion], e.sampled(axis.drive)
        lag = max(1, y.size // 200)
        d = y[lag:] - y[:-lag]
        for s, sign in zip(SIDES, (1.0, -1.0)):
            travel[s] = max(travel[s], float((sign * d).max()))
            push[s] = max(push[s], float((sign * drive).max()))
    resolution = max(e.signals[axis.motion].resolution for e in experiments)
    least = max(3.0 * resolution, 0.01 * max(travel.values()))
    return {s: push[s] for s in SIDES if travel[s] <= least}


def sides_at_rest(
    resting: Mapping[str, float], axis: Axis, unit: str, hold: float, viscous: Collection[str]
) -> list[Refusal]:
    """Friction of the directions in which no log ever moves; ``hold`` [``unit``] is never left."""
    out = []
    for s, push in resting.items():
        tried = f"at most {push:.3g} {unit} push that way" if push > 0.0 else "nothing pushes"
        reason = f"the {axis.motion} never moves in the {s} direction ({tried})."
        out += [Refusal(f"coulomb_{s}", reason, hold), Refusal(EXCESS[s], reason, 0.0)]
        if f"viscous_{s}" in viscous:
            out.append(Refusal(f"viscous_{s}", reason, 0.0))
    return out


def without_breakaway(
    model: DriveModel, start: Mapping[str, float], names: Collection[str], known: Sequence[Refusal]
) -> list[Refusal]:
    """Static levels of directions in which the axis never breaks away from rest."""
    counts = np.zeros(2, dtype=int)
    for i in range(len(model.inputs)):
        counts += np.array(model.motion(i, start)[0].breakaways)
    silent = [s for s, count in zip(SIDES, counts) if count == 0]
    return [Refusal(n, _NEVER, 0.0) for n in open_levels(names, known, silent)]


def open_levels(
    names: Collection[str], known: Sequence[Refusal], sides: Collection[str] = SIDES
) -> list[str]:
    """Excesses that are to be fitted and have not been refused."""
    refused = {r.parameter for r in known}
    return [EXCESS[s] for s in sides if EXCESS[s] in names and EXCESS[s] not in refused]
