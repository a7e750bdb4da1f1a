"""A static map at chosen points: its value, its slopes, how many samples it gets."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import UsageError
from ..experiment import FloatArray
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
    entries = {k: {"value": v} for k, v in values.items()}
    block: Any = task.family.block(task.variant, {"parameters": entries})
    if block is None or not callable(block):
        raise UsageError(f"the next experiment of {task.family.name} cannot be designed.")
    return np.asarray(block(points), dtype=float)
