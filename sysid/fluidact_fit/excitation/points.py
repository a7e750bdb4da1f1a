"""Positions at which to sample a static map, and for how long."""

from __future__ import annotations

import numpy as np

from ..estimation.information import cramer_rao, optimal_measure
from ..experiment import FloatArray
from .forecasts import make_forecasts
from .result import Design
from .static_map import evaluate_map, static_rows, static_samples
from .task import Task

_SPREAD = 0.2  # share of a static design that is spread evenly, to show a wrong model


def design_points(task: Task) -> Design:
    """Where to sample a static map."""
    grid = np.linspace(*task.limits.amplitude, 161)
    rows = static_rows(task, grid)
    scales = np.array([u.scale for u in task.unknowns])
    chosen: str | int = task.criterion
    if task.criterion not in ("worst", "determinant"):
        chosen = [u.name for u in task.unknowns].index(task.criterion)
    share = optimal_measure(rows, scales, chosen)
    points, counts = _support(grid, share, _SPREAD)
    weights = counts * static_samples(task)
    return _positions(task, points, weights, _static_errors(task, points, weights))


def _static_errors(task: Task, points: FloatArray, weights: FloatArray) -> FloatArray:
    """Predicted standard errors of so many samples at some points, shape ``(p,)``."""
    at = static_rows(task, points)
    return np.sqrt(np.diag(cramer_rao(at.T @ (weights[:, None] * at)))) * task.sigma


def _support(grid: FloatArray, share: FloatArray, spread: float) -> tuple[FloatArray, FloatArray]:
    """Points that carry the design and their shares; ``spread`` of it goes to an even grid."""
    kept = np.flatnonzero(share > 0.02 * share.max())
    apart = (np.diff(kept) > 2) | (grid[kept[:-1]] * grid[kept[1:]] < 0.0)
    groups = np.split(kept, np.flatnonzero(apart) + 1)
    points = [float(grid[g] @ share[g] / share[g].sum()) for g in groups]
    weights = np.array([float(share[g].sum()) for g in groups])
    weights *= (1.0 - spread) / weights.sum()
    even = np.linspace(grid[0], grid[-1], 21)
    all_points = np.concatenate((points, even))
    all_weights = np.concatenate((weights, np.full(even.size, spread / even.size)))
    merged, where = np.unique(np.round(all_points, 9), return_inverse=True)
    return np.asarray(merged, dtype=float), np.bincount(where.ravel(), all_weights).astype(float)


def _positions(task: Task, points: FloatArray, weights: FloatArray, errors: FloatArray) -> Design:
    """A list of positions to hold, each for a number of samples."""
    output = task.variant.output
    counts = np.maximum(np.round(weights), 1.0)
    reference = evaluate_map(task, task.unknowns[0].name, task.unknowns[0].value, points)
    note = (
        f"{100.0 * _SPREAD:.0f} % of the samples are spread evenly: the rest would not show "
        "whether the curve has another shape."
    )
    return Design(
        family=task.family.name,
        description=f"{points.size} positions to hold",
        time=np.zeros(0),
        signals={output.name: reference, task.drive.name: points, "samples": counts},
        units={output.name: output.unit, task.drive.name: task.unit, "samples": "1"},
        forecasts=make_forecasts(task, errors),
        criterion=task.criterion,
        limits=task.limits,
        binding=("amplitude", "duration"),
        notes=(*task.notes, note),
        candidates=(),
    )
