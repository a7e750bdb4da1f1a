"""What rests on numbers that were given and not measured, and on the clock of the log.

A mass from a data sheet, an area, a value that was fixed, and the assumption that all channels
were read at the same instant enter the estimate like data, without a standard error. How far a
parameter would move with each of them follows from one simulation: ``-(J'J)^-1 J' d`` for a
change ``d`` of the output, and so does whether the residual would show the error. The file says
both.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import Notice
from ..estimation.least_squares import scaled_least_squares
from ..estimation.solution import moved
from ..experiment import FloatArray
from ..options import describe
from .optimum import Optimum, delayed

_PERCENT = 0.01


@dataclass(frozen=True)
class Reliance:
    """What an error of a given number would do to the parameter that it moves most.

    ``shift`` [unit of the parameter] and ``errors`` (standard errors) are for an error of one
    per cent, or of one sample; ``seen`` is in how many standard errors the residual would show it.
    """

    given: str
    parameter: str
    shift: float
    errors: float
    seen: float


def find_reliance(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """What every given number would do, for the file; it is no fault of the fit."""
    part = at.part
    found = {"one_sample_late": _late(part), "one_percent_more": _other_numbers(part)}
    # what a part shows, the whole shows by as much more as the root of their samples
    more = float(np.sqrt(at.samples / part.samples))
    table = {
        key: {name: _entry(_reliance(part, name, columns, more)) for name, columns in rows}
        for key, rows in found.items()
    }
    return {key: rows for key, rows in table.items() if rows}, []


def _entry(r: Reliance) -> dict[str, Any]:
    return {
        "parameter": r.parameter,
        "shift": r.shift,
        "standard_errors": r.errors,
        "seen_in_residual": r.seen,
    }


def _late(at: Optimum) -> Iterator[tuple[str, list[FloatArray]]]:
    """Every input one sample later than recorded."""
    runs = at.experiments
    if not all(e.time.size > 1 for e in runs):
        return
    step = min(e.sample_time for e in runs)
    for role in at.variant.driving:
        if all(role.name in e and e.signals[role.name].time.size > 1 for e in runs):
            yield role.name, at.change([delayed(e, role.name, step) for e in runs])


def _other_numbers(at: Optimum) -> Iterator[tuple[str, list[FloatArray]]]:
    """Every fixed parameter and every number among the options one per cent larger."""
    for name, q in at.solution.parameters.items():
        if q.status == "fixed" and isinstance(q.value, float) and q.value:
            yield name, at.change(plant=moved(at.plant, name, _PERCENT * q.value))
    for option in describe(at.family.options_type):
        field = option.name.replace("-", "_")
        value = getattr(at.plant.options, field)
        if option.kind == "float" and value:
            options = replace(at.plant.options, **{field: value * (1.0 + _PERCENT)})
            yield option.name, at.change(plant=replace(at.plant, options=options))


def _reliance(at: Optimum, name: str, columns: list[FloatArray], more: float) -> Reliance:
    """How the parameters make up for a change of the output, and what is left of it."""
    beside = at.beside_residual(columns)
    white = beside.whiten()
    j, d, r = white[:, :-2], white[:, -2], white[:, -1]
    shifts = -scaled_least_squares(j, d)
    left = d + j @ shifts
    sigma = float(np.linalg.norm(r)) / np.sqrt(beside.rows)
    errors = shifts / at.errors
    worst = int(np.argmax(np.abs(errors)))
    return Reliance(
        name, at.names[worst], float(shifts[worst]), float(errors[worst]),
        more * float(np.linalg.norm(left)) / max(sigma, 1e-300),
    )  # fmt: skip
