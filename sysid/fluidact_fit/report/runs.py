"""Choice of the runs that a picture shows, and of their samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..experiment import FloatArray
from ..family import Variant
from ..outcome import Outcome, Simulation
from ..rows import blocks

_MOST_COLUMNS = 3
_MOST_OVERLAID = 60
_LONG = 1 << 20  # samples of a run, beyond which what is computed from all of it takes too long


@dataclass(frozen=True)
class Choice:
    """Runs that are shown, how, and the sentence that says so."""

    runs: Sequence[Simulation]
    overlay: bool
    note: str


def drive_role(variant: Variant) -> str:
    """Name of the first role that drives the model, empty when there is none."""
    return next((r.name for r in variant.driving), "")


def is_too_long(result: Outcome) -> bool:
    """Return whether a run is too long for pictures that compute anything from all of it."""
    return any(run.measured.size > _LONG for run in result.fitted)


def instants(run: Simulation) -> FloatArray:
    """Instants of the samples [s]; their numbers in a log without time."""
    time, size = run.experiment.time, run.measured.size
    return time if time.size == size else np.arange(size, dtype=float)


def choose(runs: Sequence[Simulation]) -> Choice:
    """Up to three runs side by side; many short ones overlaid; else the extremes."""
    if len(runs) <= _MOST_COLUMNS:
        return Choice(runs, False, "")
    spans = np.array([np.ptp(instants(r)) for r in runs])
    if spans.max() <= 3.0 * np.median(spans) and max(r.measured.size for r in runs) <= 2000:
        if len(runs) <= _MOST_OVERLAID:
            return Choice(runs, True, f"all {len(runs)} runs overlaid")
        shown = subset(len(runs), _MOST_OVERLAID)
        note = f"{shown.size} of {len(runs)} runs overlaid, evenly chosen"
        return Choice([runs[k] for k in shown], True, note)
    order = np.argsort([r.agreement.fit_percent for r in runs])[::-1]
    picked = [order[0], order[len(order) // 2], order[-1]]
    note = f"3 of {len(runs)} runs: the best, the middle and the worst fit"
    return Choice([runs[k] for k in picked], False, note)


def worst_residual(run: Simulation) -> tuple[float, int]:
    """Largest magnitude of a run's residual [SI], and its sample; block by block."""
    size, where = 0.0, 0
    for at in blocks(run.measured.size):
        part = np.nan_to_num(np.abs(run.residual[at]))
        if part.size and part.max() > size:
            size, where = float(part.max()), at.start + int(part.argmax())
    return size, where


def envelope(x: FloatArray, y: FloatArray, bins: int = 1500) -> tuple[FloatArray, FloatArray]:
    """Keep the smallest and the largest value of every bin: peaks survive.

    ``bins`` of equal count, about the pixels of the axis; nothing is left out when there are
    not many more than ``2 * bins`` samples.
    """
    if y.size <= 4 * bins:
        return x, y
    width = y.size // bins
    whole = y[: width * bins].reshape(bins, width)
    low = np.where(np.isnan(whole), np.inf, whole).argmin(axis=1)
    high = np.where(np.isnan(whole), -np.inf, whole).argmax(axis=1)
    start = np.arange(bins) * width
    kept = np.unique([0, *(start + low), *(start + high), *range(width * bins, y.size)])
    return x[kept], y[kept]


def subset(size: int, most: int) -> npt.NDArray[np.intp]:
    """Indices of at most so many samples, evenly spread."""
    if size <= most:
        return np.arange(size)
    return np.unique(np.linspace(0, size - 1, most).astype(np.intp))
