"""From experiments to a trained network: choice of the layers, training, spikes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...branches import BoolArray, fill_start, running_median
from ...errors import Notice
from ...estimation.network import Network, Search, search, train_from
from ...experiment import Experiment, FloatArray
from ...family import Request
from .certificates import ENUMERATED, certify
from .data import Data, Scaling, check_data, gather
from .options import PAPER_UNITS, Options, default_inputs, driver, has_velocity, input_layers
from .validation import (
    DECAYS,
    Rows,
    Split,
    Trial,
    length_column,
    smallest_sufficient,
    split_rows,
    straighten,
    sweep,
    try_layer,
)


@dataclass(frozen=True)
class Fit:
    """A trained network in standardised coordinates, and how it came about."""

    data: Data
    scaling: Scaling
    network: Network
    trial: Trial
    split: Split
    found: Search
    spikes: int
    iterations: int
    tables: Mapping[str, Any] = field(default_factory=dict)

    @property
    def predicted(self) -> FloatArray:
        """Output of the network at all samples, shape ``(n,)`` [SI]."""
        s, x = self.scaling, self.data.x.copy()
        if "direction" in self.data.names:
            for part in self.data.parts:
                fill_start(x[part, self.data.names.index("direction")])
        return np.asarray(s.base + s.span * self.network(s.inputs(x)))


def fit_network(
    experiments: Sequence[Experiment], options: Options, request: Request
) -> tuple[Fit, Rows]:
    """Choose inputs and hidden units where asked to, then train."""
    tables: dict[str, Any] = {}
    names = options.inputs or default_inputs(options, experiments)
    units = options.hidden or (PAPER_UNITS[options.target],)
    if options.compare:
        layers = [n for n in input_layers(options.target)
                  if "velocity" not in n or has_velocity(experiments)]  # fmt: skip
        trials = []
        for layer in layers:
            request.progress("validating inputs " + ", ".join(layer))
            data, rows = _prepare(experiments, layer, options, request.seed)
            trials.append((try_layer(rows, layer, units, options, request.seed), data))
        tables["input_layers"] = [t.row(Scaling.of(d).span) for t, d in trials]
        names = smallest_sufficient([t for t, _ in trials]).names
    data, rows = _prepare(experiments, names, options, request.seed)
    if not options.hidden:
        swept = sweep(rows, names, options, request)
        span = Scaling.of(data).span
        table = [t.row(span) for t in swept]
        tables["hidden_units"] = table
        tables["accuracy_over_cost"] = {
            k: [row[k] for row in table] for k in ("validation_rms", "multiplications")
        }
        units = smallest_sufficient(swept).hidden
    # judging rivals for a network of two layers would cost ten times its training
    rivals = len(units) == 1
    trial = try_layer(rows, names, units, options, request.seed, DECAYS if rivals else DECAYS[:1])
    straightness: list[dict[str, float]] = []
    if rivals:
        trial, straightness = straighten(rows, trial, options, request.seed)
    if rows.length is not None:
        span = Scaling.of(data).span
        tables["straight"] = {
            "along": "length",
            "strength": trial.straightness,
            "judged": [
                {k: v * (span if k.endswith("rms") else 1.0) for k, v in row.items()}
                for row in straightness
            ],
        }
    fit = _train(data, rows, trial, options, request)
    return replace(fit, tables={**tables, "_rows": np.flatnonzero(data.used)}), rows


def _prepare(
    experiments: Sequence[Experiment], names: tuple[str, ...], options: Options, seed: int
) -> tuple[Data, Rows]:
    data = gather(experiments, names, options)
    check_data(data, options)
    s = Scaling.of(data)
    split = split_rows(data, seed)
    x, y = s.inputs(data.x[data.used]), s.output(data.y[data.used])
    return data, Rows(x, y, split, length_column(data))


def _train(data: Data, rows: Rows, trial: Trial, options: Options, request: Request) -> Fit:
    """Train the final network on all used rows, spikes left out."""
    request.progress(f"training {len(data.names)}-{'-'.join(map(str, trial.hidden))}-1")
    scaling = Scaling.of(data)
    rng = np.random.default_rng([request.seed, 7])
    chords = rows.chords(rows.x, trial.straightness)
    # a larger network has more to tell apart, and more optima nearly as good
    weights = sum(trial.hidden) * (rows.x.shape[1] + 1)
    found = search(
        rows.x, rows.y, trial.hidden, rng, activation=options.activation, decay=trial.decay,
        chords=chords, starts=options.starts, rows=int(np.clip(100 * weights, 3000, 8000)),
        finalists=3 if sum(trial.hidden) <= ENUMERATED else 6,
    )  # fmt: skip
    net = _choose_candidate(found, scaling, data, driver(options))
    z, t = scaling.inputs(data.x), scaling.output(data.y)
    measured = np.isfinite(t)
    rest = np.where(measured, t - net(z), 0.0)
    spikes = _find_spikes(data, np.where(measured, t, 0.0), rest) & data.used
    kept = data.used & ~spikes
    last = train_from(
        net, z[kept], t[kept], decay=trial.decay, limit=found.limit, chords=chords, iterations=10,
        tolerance=1e-5,
    )  # fmt: skip
    return Fit(
        replace(data, used=kept), scaling, last.network, trial, rows.split, found,
        int(spikes.sum()), last.iterations,
    )  # fmt: skip


def _choose_candidate(found: Search, scaling: Scaling, data: Data, source: str) -> Network:
    """The best network; of nearly equal ones a monotone one."""
    most = 1.05 * found.best.cost
    for candidate in found.candidates:
        net = candidate.network
        if candidate.cost > most or net.activation != "relu" or len(net.weights) > 2:
            break
        if net.hidden[0] > ENUMERATED:
            break
        if certify(net, scaling, data).monotone(source):
            return net
    return found.best.network


def _find_spikes(data: Data, output: FloatArray, residual: FloatArray) -> BoolArray:
    """Samples that stand alone: off the fit, off their neighbours' residuals, and off them.

    Misfit of the network lasts for many samples; a load-cell spike for one to three. A jump
    of an input, as of a velocity, moves the residual but not what was measured. ``output``
    and ``residual`` are standardised.
    """
    alone = np.zeros(data.y.size, dtype=bool)
    for part in data.parts:
        r = residual[part]
        if r.size < 8:
            continue
        off = np.abs(r - running_median(r, 3))
        floor = 1e-6 * float(np.abs(output[part]).max())
        limit = max(10.0 * 1.4826 * float(np.median(off)), floor)
        jump = np.abs(output[part] - running_median(output[part], 3))
        far = 3.0 * 1.4826 * float(np.median(np.abs(r)))
        alone[part] = (np.minimum(off, jump) > limit) & (off > far)
    return alone & data.settled  # just after a reversal a lone sample is the seal's creep


def spike_notice(fit: Fit) -> list[Notice]:
    """Say how many spikes were left out, where they are more than a curiosity."""
    if not fit.spikes:
        return []
    share = 100.0 * fit.spikes / (fit.spikes + int(fit.data.used.sum()))
    return [
        Notice(
            "force-spikes",
            f"{fit.spikes} samples ({share:.2g} %) stand alone far off their neighbours: spikes "
            "of the load cell. They were left out.",
        )
    ]
