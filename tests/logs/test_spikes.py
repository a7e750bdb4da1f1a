"""Single samples that no machine produces, also in logs without time."""

from __future__ import annotations

import numpy as np

from fluidact_fit.estimation.agreement_of_logs import compare_logs
from fluidact_fit.experiment import Experiment, Signal
from fluidact_fit.family import Role, Variant
from fluidact_fit.logs.spikes import replace_spikes

_VARIANT = Variant("map", (Role("reading", "1", ""), Role("reference", "m", "", output=True)), ())


def test_a_spike_is_found_without_a_time_column() -> None:
    reading = np.linspace(0.0, 1000.0, 200)
    reading[80] = 1e5
    values = {"reading": reading, "reference": 6e-5 * np.linspace(0.0, 1000.0, 200)}
    signals = {n: Signal(n, np.zeros(0), v, "1") for n, v in values.items()}
    log = Experiment("log.csv", 0, np.zeros(0), signals, 0.0, False)
    cleaned, (notice,) = replace_spikes(log, _VARIANT)
    assert abs(cleaned["reading"][80] - 1000.0 * 80 / 199) < 1.0
    assert "in sample 81" in notice.message


def test_what_one_half_cannot_tell_does_not_disagree() -> None:
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 1.0, 400)
    columns = np.column_stack((np.ones(t.size), np.where(t < 0.5, 1e-8, 1.0) * t))
    noise = rng.standard_normal(t.size)
    rest = noise - columns @ np.linalg.lstsq(columns, noise, rcond=None)[0]
    drifts, _ = compare_logs([columns[:200], columns[200:]], [rest[:200], rest[200:]], [0, 1], "ab")
    assert abs(drifts[0].deviations) < 5.0
