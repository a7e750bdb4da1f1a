"""Waveforms that the search for a dynamic model begins with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..experiment import FloatArray
from .task import Task, Unknown
from .waveforms import Waveform


def first_waveforms(task: Task) -> list[Waveform]:
    """Shapes to begin with; the search stretches their times and frequencies."""
    span, step = task.limits.duration, task.limits.sample_time
    holds = np.geomspace(max(4.0 * step, 0.002 * span), 0.12 * span, 8)
    bands, lowest = [1.0 / (2.0 * h) for h in holds[:6]], 1.0 / span
    sizes = ((1.0, 0.5), (2.0, 0.35))
    shapes = [
        *(("steps", {"hold": h, "levels": n}) for h in holds for n in (2.0, 5.0)),
        *(("square", {"hold": h, "last": h * g}) for h in holds for g in (1.0, 4.0)),
        *(("two sizes", {"hold": h, "small": h * g, "part": p}) for h in holds for g, p in sizes),
        *(("rest and go", {"hold": h, "pause": h * g}) for h in holds for g in (0.3, 1.0)),
        *(("chirp", {"first": lowest, "last": f, "log": k}) for f in bands for k in (0.0, 1.0)),
        *(("multisine", {"first": lowest, "last": f}) for f in bands),
        *(("triangle", {"period": span / n}) for n in (1.0, 2.0, 4.0, 8.0)),
    ]
    out = [Waveform(shape, numbers, task.seed) for shape, numbers in shapes]
    slow = Waveform("triangle", {"period": 0.25 * span})
    for h in holds[1:6]:
        out.append(replace(slow, then=Waveform("steps", {"hold": h, "levels": 2.0}, task.seed)))
    return [*out, *_mixtures(holds), *_approaches(task)]


def _mixtures(holds: FloatArray) -> list[Waveform]:
    """Slow squares of two sizes, which show levels and slopes, and then a quick one."""
    out = []
    for q in holds[1:6:2]:
        quick = Waveform("square", {"hold": q, "last": q})
        for h in holds[4:]:
            slow = Waveform("two sizes", {"hold": h, "small": h, "part": 0.6}, then=quick)
            out += [replace(slow, turn=turn) for turn in (0.35, 0.65)]
    return out


def _approaches(task: Task) -> list[Waveform]:
    """Slow passages through the static levels, for models that have any."""
    levels: dict[str, float] = {}
    for side, limit in zip(("positive", "negative"), reversed(task.limits.amplitude)):
        unknown = next((u for u in task.unknowns if u.spec.threshold == side), None)
        if unknown is None or not limit:
            return []
        low, high = _ramp_range(task, unknown)
        levels[f"low_{side}"] = low / abs(limit)
        levels[f"high_{side}"] = min(high / abs(limit), 1.0)
    span = task.limits.duration
    out = []
    # A fit of slow passages alone has several optima; vigorous motion has one.
    for last in (10.0, 40.0):
        lively = Waveform("chirp", {"first": 2.0 / span, "last": last / span, "log": 0.0})
        for n in (2.0, 4.0, 6.0):
            for pause in (0.15, 0.3):
                numbers = {"half": 0.5 * span / n, "pause": pause, "push": 0.03, **levels}
                out.append(Waveform("approach", numbers, then=lively))
    return out


def _ramp_range(task: Task, unknown: Unknown) -> tuple[float, float]:
    """Levels between which a static level is sure to lie [SI of the drive]."""
    below = task.values.get(unknown.spec.base)
    base = below if isinstance(below, float) else 0.0
    if unknown.supposed or unknown.present is None:
        return base, max(2.0 * base, 1.3 * unknown.value)
    half = max(4.0 * unknown.present, 0.02 * unknown.value)
    return max(unknown.value - half, base), unknown.value + half
