"""Views of recorded runs that need no model, and of a model as seen in the same way.

The model's response is estimated from what it simulates for the recorded input, by the same
estimator: what differs then is the machine, not the method.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..experiment import Experiment, FloatArray
from ..family import Variant
from ..outcome import Outcome, Simulation
from ..specification import quotient_unit
from .impulse_response import ImpulseResponse, impulse_response, respond_alike
from .spectra import CrossCorrelation, FrequencyResponse, cross_correlation, frequency_response


@dataclass(frozen=True)
class Views:
    """Response of the output to one input.

    Attributes
    ----------
    role, output
        Names.
    unit
        Of the output per input [SI].
    response, frequency
        Of what was recorded.
    model : (n,)
        Taps of what a model simulates, where there is one.
    model_frequency
        The same by frequency.
    residual
        Correlation of its residual with the input.
    """

    role: str
    output: str
    unit: str
    response: ImpulseResponse
    frequency: FrequencyResponse | None
    model: FloatArray | None = None
    model_frequency: FrequencyResponse | None = None
    residual: CrossCorrelation | None = None


def view_fit(result: Outcome) -> Views | None:
    """Views of the runs of a fit, with its model; ``None`` without one input over even time."""
    return _views(result.variant, [s.experiment for s in result.fitted], result.fitted)


def view_runs(variant: Variant, runs: Sequence[Experiment]) -> Views | None:
    """Views of runs without a model; ``None`` without one input over even time."""
    return _views(variant, runs, ())


def _views(
    variant: Variant, runs: Sequence[Experiment], fitted: Sequence[Simulation]
) -> Views | None:
    driving = [r.name for r in variant.driving if all(r.name in e for e in runs)]
    output = variant.output.name
    even = all(e.uniform and e.time.size and output in e for e in runs)
    steps = [e.sample_time for e in runs]
    if len(driving) != 1 or not runs or not even or max(steps) > 1.01 * min(steps):
        return None
    (role,), step = driving, float(np.median(steps))
    inputs = [e.sampled(role) for e in runs]
    measured = list(zip(inputs, [e.sampled(output) for e in runs], strict=True))
    held = all(e.signals[role].hold == "zoh" for e in runs)
    response = impulse_response(measured, step, held=held)
    if response is None:
        return None
    unit = quotient_unit(runs[0].units[output], runs[0].units[role])
    views = Views(role, output, unit, response, frequency_response(measured, step))
    if not fitted or not all(np.isfinite(s.simulated).all() for s in fitted):
        return views
    simulated = list(zip(inputs, [s.simulated for s in fitted], strict=True))
    return Views(
        role, output, unit, response, views.frequency, respond_alike(response, simulated),
        frequency_response(simulated, step),
        cross_correlation(inputs, [s.residual for s in fitted], step),
    )  # fmt: skip
