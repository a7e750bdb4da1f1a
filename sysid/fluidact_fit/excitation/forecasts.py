"""Standard errors of the file and of the design side by side."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..experiment import FloatArray
from .result import Forecast
from .task import Task, Unknown

_QUANTILE = 1.96


def finite_or_none(value: Any) -> float | None:
    """A number, or ``None`` if it is infinite or none."""
    return float(value) if np.isfinite(value) else None


def make_forecasts(task: Task, errors: FloatArray) -> tuple[Forecast, ...]:
    """Present and predicted standard errors side by side."""
    specs = {s.name: s for s in task.variant.parameters}
    out = []
    for u, error in zip(task.unknowns, errors):
        predicted = finite_or_none(error)
        spec = specs[u.name.split("[")[0]]

        def interval(
            e: float | None, u: Unknown = u, low: float = spec.minimum, high: float = spec.maximum
        ) -> tuple[float, float] | None:
            if e is None:
                return None
            return max(u.value - _QUANTILE * e, low), min(u.value + _QUANTILE * e, high)

        present = interval(u.present)
        stated = task.document.parameters.get(u.name)
        if stated is not None and stated.ci95 is not None and u.present is not None:
            ends: Any = stated.ci95
            present = float(ends[0]), float(ends[1])
        ratio = predicted / u.present if predicted is not None and u.present else None
        out.append(Forecast(u.name, u.unit, u.value, u.present, predicted, ratio, present,
                            interval(predicted), u.supposed))  # fmt: skip
    return tuple(out)
