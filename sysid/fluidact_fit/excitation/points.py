"""A static map at chosen points: where to sample it, for how long, and what that shows."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np

from ..estimation.information import cramer_rao, optimal_measure
from ..experiment import FloatArray
from ..specification import Role
from .result import Design
from .task import Task, Unknown, driving_role, make_run

_NOTICEABLE = 0.01  # of the range of a map
_SPREAD = 0.2  # share of a static design that is spread evenly, to show a wrong model


def design_points(task: Task) -> Design:
    """Positions to hold, each for a number of samples."""
    grid = np.linspace(*task.limits.amplitude, 161)
    chosen: str | int = task.criterion
    if task.criterion not in ("worst", "determinant"):
        chosen = task.names.index(task.criterion)
    rows = static_rows(task, grid)
    share = optimal_measure(rows, _sizes(task, grid, rows), chosen)
    points, shares = _support(grid, share)
    weights = shares * static_samples(task)
    output, unknown = task.output, task.unknowns[0]
    samples = np.maximum(np.round(weights), 1.0)
    back = np.floor(0.5 * samples)  # half of them from the other side: a hysteresis shows
    way = np.append(points, points[::-1][back[::-1] > 0.0])
    planned = f"planned_{output.name}"  # the table is no log: nothing takes this for measured
    note = (
        f"{100.0 * _SPREAD:.0f} % of the samples are spread evenly: the rest would not show "
        "whether the curve has another shape."
    )
    return Design(
        family=task.family.name,
        description=f"{points.size} positions to hold, going up and coming back",
        time=np.zeros(0),
        signals={
            planned: _evaluate(task, unknown, unknown.value, way),
            task.drive.name: way,
            "samples": np.append(samples - back, back[::-1][back[::-1] > 0.0]),
        },
        units={planned: output.unit, task.drive.name: task.drive.unit, "samples": "1"},
        forecasts=task.forecasts(task.sigma * static_errors(static_rows(task, points), weights)),
        criterion=task.criterion,
        limits=task.limits,
        binding=("amplitude", "duration"),
        notes=(*task.notes, note),
    )


def _sizes(task: Task, grid: FloatArray, rows: FloatArray) -> FloatArray:
    """Sizes that the standard errors are compared with, shape ``(p,)``.

    No experiment makes the relative error of a zero small: what may be zero counts from where it
    moves the map noticeably.
    """
    unknown = task.unknowns[0]
    reach = float(np.ptp(_evaluate(task, unknown, unknown.value, grid)))
    least = _NOTICEABLE * reach / np.maximum(np.sqrt(np.mean(rows**2, axis=0)), 1e-300)
    zero = [u.present is not None and abs(u.value) < 2.0 * u.present for u in task.unknowns]
    return np.where(zero, np.maximum(task.scales, least), task.scales)


def static_samples(task: Task) -> int:
    """Samples of the next static experiment: those of the longest log, or the duration's."""
    if task.limits.sample_time and task.limits.duration:
        return task.limits.count
    return max((source.rows for source in task.document.provenance.logs), default=1000)


def static_rows(task: Task, points: FloatArray) -> FloatArray:
    """Derivative of the map by the unknowns at some points, shape ``(n, p)``."""
    rows = []
    for u in task.unknowns:
        size = 1e-5 * u.scale
        up, down = (_evaluate(task, u, u.value + s * size, points) for s in (1.0, -1.0))
        rows.append((up - down) / (2.0 * size))
    return np.column_stack(rows)


def static_errors(rows: FloatArray, weights: FloatArray) -> FloatArray:
    """Standard errors by so many samples of unit noise at the points of ``rows``, ``(p,)``."""
    return np.sqrt(np.diag(cramer_rao(rows.T @ (weights[:, None] * rows))))


def is_speed(role: Role) -> bool:
    """Return whether a role is a speed, by its unit."""
    return role.unit.endswith("/s")


def speed_and_place(task: Task) -> tuple[Role, Role]:
    """Roles of the family that hold the speed and the place of the motion that a file is about."""
    place_unit = task.drive.unit.removesuffix("/s")
    driving = [driving_role(v) for v in task.family.variants]
    speed = next(r for r in driving if r.unit == f"{place_unit}/s")
    return speed, next(r for r in driving if r.unit == place_unit)


def _evaluate(task: Task, unknown: Unknown, value: float, points: FloatArray) -> FloatArray:
    """The map with one number changed."""
    changed: Any = value
    if unknown.index is not None:
        changed = deepcopy(task.plant.values[unknown.spec.name])
        changed[unknown.index] = value
    variant = task.variant
    if task.excitation.kind == "strokes":  # a map over the speed itself
        speed, _ = speed_and_place(task)
        variant = next(v for v in task.family.variants if driving_role(v) == speed)
    run = make_run(driving_role(variant), np.zeros(0), points)
    values = {**task.plant.values, unknown.spec.name: changed}
    options = task.excitation.options or task.plant.options
    plant = replace(task.plant, variant=variant, values=values, options=options)
    (found,) = task.family.simulate(plant, [run])
    return np.asarray(found.output, dtype=float)


def _support(grid: FloatArray, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points that carry the design and their shares; some of it goes to an even grid."""
    kept = np.flatnonzero(share > 0.02 * share.max())
    apart = (np.diff(kept) > 2) | (grid[kept[:-1]] * grid[kept[1:]] < 0.0)
    groups = np.split(kept, np.flatnonzero(apart) + 1)
    points = [float(grid[g] @ share[g] / share[g].sum()) for g in groups]
    weights = np.array([float(share[g].sum()) for g in groups])
    weights *= (1.0 - _SPREAD) / weights.sum()
    even = np.linspace(grid[0], grid[-1], 21)
    all_points = np.concatenate((points, even))
    all_weights = np.concatenate((weights, np.full(even.size, _SPREAD / even.size)))
    merged, where = np.unique(np.round(all_points, 9), return_inverse=True)
    return np.asarray(merged, dtype=float), np.bincount(where.ravel(), all_weights).astype(float)
