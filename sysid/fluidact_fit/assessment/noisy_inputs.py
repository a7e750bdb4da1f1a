"""A recording whose inputs carry noise, beside copies of it with as much noise once more.

Every term that a model may lack is made of the recording and its copies alike, so that
:class:`.copies.Copies` can tell what of it is noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..estimation.input_noise import make_filters
from ..estimation.solution import FittedRun, differences
from ..estimation.whitening import Whitening
from ..experiment import Experiment, FloatArray
from ..outcome import Simulation
from .copies import Copies
from .optimum import Optimum, make_optimum

_DRAWS = 3  # of the noise
_HEAD = 8  # part of a run that is left out at most while a filter settles
_ROWS = 30_000  # of every run, of which so many copies are made


def beside_copies(at: Optimum) -> Optimum:
    """The fit over a recording and its copies; itself where its inputs are exact.

    One that was estimated with instruments has those to tell noise by. Where a score was corrected
    for the noise, the output alone was compared.
    """
    if not at.solution.noise.inputs or at.instruments:
        return at
    at = at.beginning(_ROWS)
    draws = _draws(at)
    every = [*at.experiments, *(run for draw in draws for run in draw)]
    output, simulated = at.variant.output.name, at.family.simulate(at.plant, every)
    fitted = [Simulation.of(e, found, output) for e, found in zip(every, simulated, strict=True)]
    runs = [FittedRun(e, s, {}) for e, s in zip(every, simulated, strict=True)]
    names, covariance = at.solution.names, at.solution.covariance
    tables = differences(at.family.simulate, at.plant, runs, names, covariance)
    runs = [replace(run, jacobians={output: j}) for run, j in zip(runs, tables)]
    plain = replace(at.solution, runs=runs, simulate_near=at.family.simulate)
    found = make_optimum(at.family, at.variant, plain, fitted)
    assert found is not None  # it is made of the same series
    filters = _filters(at, draws)
    relative = max(noise.relative for noise in at.solution.noise.inputs.values())
    return replace(found, copies=Copies(filters, relative, found.jacobians, found.residuals))


def whitened(at: Optimum) -> Optimum:
    """The fit as its score was corrected for noise of inputs: residuals and derivatives white.

    Itself where inputs are exact or stand-ins tell their noise. Left out are the first rows, in
    which the filter settles: the level and the state that a run began with fit them as they like.
    """
    if not at.solution.noise.inputs or at.instruments:
        return at
    at = at.beginning(_ROWS)
    white = [
        (f.filter(r)[begin:], f.filter(j)[begin:])
        for f, r, j in zip(_filters(at, _draws(at)), at.residuals, at.jacobians, strict=True)
        for begin in [min(f.settling, r.size // _HEAD)]
    ]
    residuals, jacobians = zip(*white, strict=True)
    return replace(at, residuals=residuals, jacobians=jacobians)


def _filters(at: Optimum, draws: Sequence[Sequence[Experiment]]) -> list[Whitening]:
    """What whitens the residual of every run, whose inputs carry noise such as the draws."""
    return make_filters(_response(at, draws), at.residuals)


def _draws(at: Optimum) -> list[list[Experiment]]:
    """All runs, with noise added once for every draw."""
    return [_draw(at, np.random.default_rng(seed)) for seed in range(_DRAWS)]


def _draw(at: Optimum, rng: np.random.Generator) -> list[Experiment]:
    """All runs with noise added; the level that one starts from belongs to its offset."""
    out = []
    for e in at.experiments:
        for role, noise in at.solution.noise.inputs.items():
            drawn = noise.sigma * rng.standard_normal(e.signals[role].values.size)
            drawn[0] = 0.0
            e = e.with_readings(role, e.signals[role].values + drawn)
        out.append(e)
    return out


def _response(at: Optimum, draws: Sequence[Sequence[Experiment]]) -> list[FloatArray]:
    """What every draw of the noise makes of the output, from rest."""
    output, count = at.variant.output.name, len(at.experiments)
    runs = [*at.experiments, *(run for draw in draws for run in draw)]
    # what is not compared with a record begins at rest
    found = at.family.simulate(at.plant, [e.without(output) for e in runs])
    return [s.output - found[k % count].output for k, s in enumerate(found)][count:]
