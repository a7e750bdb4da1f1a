"""A static map at chosen points: its value, its slopes, how many samples it gets."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..experiment import Experiment, FloatArray, Signal
from ..family import Role, Variant
from .task import Task


def static_samples(task: Task) -> int:
    """Samples of the next static experiment: those of the longest log, or the duration's."""
    limits = task.limits
    if limits.sample_time and limits.duration:
        return limits.count
    return max((source.rows for source in task.document.provenance.logs), default=1000)


def static_rows(task: Task, points: FloatArray) -> FloatArray:
    """Derivative of the map by the unknowns at some points, shape ``(n, p)``."""
    rows = []
    for u in task.unknowns:
        size = 1e-5 * u.scale
        up, down = (evaluate_map(task, u.name, u.value + s * size, points) for s in (1.0, -1.0))
        rows.append((up - down) / (2.0 * size))
    return np.column_stack(rows)


def evaluate_map(task: Task, name: str, value: float, points: FloatArray) -> FloatArray:
    """The map with one number changed."""
    values: dict[str, Any] = {
        k: list(v) if isinstance(v, list) else v for k, v in task.values.items()
    }
    head, bracket, index = name.partition("[")
    if bracket:
        values[head][int(index[:-1])] = value
    else:
        values[head] = value
    variant = _over(task)
    role = next(r for r in variant.roles if r.name != "time" and not r.output and r.required)
    signal = Signal(role.name, np.zeros(0), points, role.unit, role.hold)
    run = Experiment("design", 0, np.zeros(0), {role.name: signal}, 0.0, False)
    (found,) = task.family.simulate(variant, values, [run], task.options)
    return np.asarray(found.output, dtype=float)


def _over(task: Task) -> Variant:
    """The variant whose map is over what is chosen: of strokes, the speed itself."""
    if task.excitation.kind != "strokes":
        return task.variant
    return next(v for v in task.family.variants if any(is_speed(r) for r in v.roles))


def is_speed(role: Role) -> bool:
    """Whether a role is a speed, by its unit."""
    return role.unit.endswith("/s")
