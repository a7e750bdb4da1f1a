"""Friction that the logs cannot tell: sides at rest, no break-away, unknown forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...estimation.parametric import Refusal
from ...experiment import Experiment
from .model import SIDES, Axis, DriveModel


def sides_at_rest(
    experiments: Sequence[Experiment], axis: Axis, viscous: Sequence[str]
) -> list[Refusal]:
    """Friction of a direction in which no log ever moves."""
    travel = dict.fromkeys(SIDES, 0.0)
    for e in experiments:
        y = e[axis.motion]
        lag = max(1, y.size // 200)
        d = y[lag:] - y[:-lag]
        travel["positive"] = max(travel["positive"], float(d.max()))
        travel["negative"] = max(travel["negative"], float(-d.min()))
    drive = max(float(np.abs(e[axis.drive]).max()) for e in experiments)
    resolution = max(e.signals[axis.motion].resolution for e in experiments)
    largest = max(travel.values())
    out = []
    for s in SIDES:
        if travel[s] <= max(3.0 * resolution, 0.01 * largest):
            sign = 1.0 if s == "positive" else -1.0
            reach = max(float((sign * e[axis.drive]).max()) for e in experiments)
            unit = experiments[0].signals[axis.drive].unit
            tried = f"at most {reach:.3g} {unit} push that way" if reach > 0.0 else "nothing pushes"
            reason = f"the {axis.motion} never moves in the {s} direction ({tried})."
            out += [
                Refusal(n, reason, 1.5 * drive if "coulomb" in n else 0.0)
                for n in (f"coulomb_{s}", f"stiction_{s}", f"viscous_{s}")
                if not n.startswith("viscous") or n in viscous
            ]
    return out


def without_breakaway(
    model: DriveModel,
    start: Mapping[str, float],
    static: Sequence[str],
    known: Sequence[Refusal],
) -> list[Refusal]:
    """Static levels of directions in which the axis never breaks away from rest."""
    counts = np.zeros(2, dtype=int)
    for i in range(len(model.inputs)):
        counts += np.array(model.motion(i, start)[0].breakaways)
    refused = {r.parameter for r in known}
    reason = "the axis never breaks away from rest in this direction."
    return [
        Refusal(name, reason, 0.0)
        for name, count in zip(static, counts)
        if count == 0 and name.startswith("stiction") and name not in refused
    ]


def static_out_of_reach(static: Sequence[str], known: Sequence[Refusal]) -> list[Refusal]:
    """Static levels of a drive commanded in steps, when unknown forces decide its start."""
    refused = {r.parameter for r in known}
    reason = (
        "the motion is dominated by forces beyond this model, which move the instant of "
        "break-away more than the static level does."
    )
    return [
        Refusal(name, reason, 0.0)
        for name in static
        if name.startswith("stiction") and name not in refused
    ]
