"""Runs as a picture shows them, and which of many are shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..experiment import FloatArray, Signal
from ..family import Variant
from ..outcome import Outcome, Simulation, agreement

MOST_COLUMNS = 3
MOST_OVERLAID = 60


@dataclass(frozen=True)
class Run:
    """One run: measured and simulated output, and the signal that drove it."""

    name: str
    time: FloatArray
    measured: FloatArray
    simulated: FloatArray
    drive: Signal | None

    @property
    def residual(self) -> FloatArray:
        """Measured less simulated, shape ``(n,)``; NaN where a sample was left out."""
        return self.measured - self.simulated

    @property
    def fit_percent(self) -> float:
        """Agreement of this run alone [%]."""
        return agreement([self.measured], [self.simulated]).fit_percent


@dataclass(frozen=True)
class Choice:
    """Runs that are shown, how, and the sentence that says so."""

    runs: Sequence[Run]
    overlay: bool
    note: str


def drive_role(variant: Variant) -> str:
    """Name of the first role that drives the model, empty when there is none."""
    return next((r.name for r in variant.driving), "")


def make_runs(variant: Variant, simulations: Sequence[Simulation]) -> list[Run]:
    """Simulations as a picture shows them, over time or, without one, by number."""
    role = drive_role(variant)
    out = []
    for s in simulations:
        e, size = s.experiment, s.measured.size
        time = e.time if e.time.size == size else np.arange(size, dtype=float)
        out.append(Run(e.name, time, s.measured, s.simulated, e.signals.get(role)))
    return out


def fitted_runs(result: Outcome) -> list[Run]:
    """Runs of the logs that were fitted."""
    return make_runs(result.variant, result.fitted)


def validated_runs(result: Outcome) -> list[Run]:
    """Runs of the logs that were not fitted."""
    return make_runs(result.variant, result.validation)


def choose(runs: Sequence[Run]) -> Choice:
    """Up to three runs side by side; many short ones overlaid; else the extremes."""
    if len(runs) <= MOST_COLUMNS:
        return Choice(runs, False, "")
    spans = np.array([np.ptp(r.time) for r in runs])
    if spans.max() <= 3.0 * np.median(spans) and max(r.time.size for r in runs) <= 2000:
        if len(runs) <= MOST_OVERLAID:
            return Choice(runs, True, f"all {len(runs)} runs overlaid")
        shown = np.unique(np.linspace(0, len(runs) - 1, MOST_OVERLAID).astype(int))
        note = f"{shown.size} of {len(runs)} runs overlaid, evenly chosen"
        return Choice([runs[k] for k in shown], True, note)
    order = np.argsort([r.fit_percent for r in runs])[::-1]
    picked = [order[0], order[len(order) // 2], order[-1]]
    return Choice(
        [runs[k] for k in picked], False,
        f"3 of {len(runs)} runs: the best, the middle and the worst fit",
    )  # fmt: skip
