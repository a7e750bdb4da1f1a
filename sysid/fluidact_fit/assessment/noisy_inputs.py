"""A recording whose inputs carry noise, beside copies of it with as much noise once more.

Every term that a model may lack is made of the recording and its copies alike, so that
:class:`.copies.Copies` can tell what of it is noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..estimation.noise import noise_floor
from ..estimation.whitening import Whitening, autoregression_from_rest
from ..experiment import Experiment, FloatArray
from ..outcome import Simulation
from .beside import all_of
from .copies import Copies
from .optimum import Optimum

_DRAWS = 3  # of the noise
_ORDER = 8  # of the autoregression that noise of the input makes of the output
_ROWS = 30_000  # of every run, of which so many copies are made
_EXACT = 1e-6  # of the residual, that the noise of the output has at least


def beside_copies(at: Optimum) -> Optimum:
    """The fit over a recording and its copies; itself where its inputs are exact.

    One that was estimated with instruments has those to tell noise by. Where a score was corrected
    for the noise, the output alone was compared.
    """
    if not at.estimate.input_noise or at.instruments:
        return at
    at = at.beginning(_ROWS)
    runs = at.experiments
    draws = [_draw(at, np.random.default_rng(seed)) for seed in range(_DRAWS)]
    every = [*runs, *(run for draw in draws for run in draw)]
    output = at.variant.output.name
    fitted = [
        Simulation.of(e, found, output)
        for e, found in zip(every, at.family.simulate(at.plant, every), strict=True)
    ]
    series, residuals = [], []
    for first in range(0, len(every), len(runs)):
        for s in at.series:
            one = fitted[first + s.run]
            measured, simulated = one.others.get(s.role, (one.measured, one.simulated))
            series.append(replace(
                s, run=first + s.run, experiment=every[first + s.run], simulated=simulated,
            ))  # fmt: skip
            residuals.append(all_of(measured - simulated, s.used) / s.scale)
    a, drive = _response(at, draws)
    filters = [Whitening(a, drive, _white(r)) for r in at.residuals]
    relative = max(noise.relative for noise in at.estimate.input_noise.values())
    plain = replace(at.estimate, nearby=None)  # knows the recording only
    found = replace(at, estimate=plain, fitted=fitted, series=series, residuals=residuals)
    jacobians = found.differences()
    return replace(
        found, jacobians=jacobians, copies=Copies(filters, relative, jacobians, residuals)
    )


def _draw(at: Optimum, rng: np.random.Generator) -> list[Experiment]:
    """All runs with noise added; the level that one starts from belongs to its offset."""
    out = []
    for e in at.experiments:
        for role, noise in at.estimate.input_noise.items():
            drawn = noise.sigma * rng.standard_normal(e.signals[role].values.size)
            drawn[0] = 0.0
            e = e.with_readings(role, e.signals[role].values + drawn)
        out.append(e)
    return out


def _response(at: Optimum, draws: Sequence[Sequence[Experiment]]) -> tuple[FloatArray, float]:
    """Autoregression of what the noise makes of the output, from rest."""
    output, count = at.variant.output.name, len(at.experiments)
    runs = [*at.experiments, *(run for draw in draws for run in draw)]
    # what is not compared with a record begins at rest
    found = at.family.simulate(at.plant, [e.without(output) for e in runs])
    change = [s.output - found[k % count].output for k, s in enumerate(found)][count:]
    return autoregression_from_rest(change, _ORDER)


def _white(residual: FloatArray) -> float:
    """Noise of the output itself [unit of the residual]."""
    return max(noise_floor(residual), _EXACT * float(np.std(residual)), np.finfo(float).tiny)
