"""From experiments to a trained network: choice of the layers, training, spikes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...errors import Notice
from ...estimation.motion_state import BoolArray
from ...estimation.network import Cost, Network, Search, Training, search, train_from
from ...experiment import Experiment, FloatArray
from ...family import Request
from .certificates import ENUMERATED, certify
from .data import Data, Scaling, check_data, gather, settle_dead_bands
from .equation import NetworkMap
from .options import PAPER_UNITS, ForceMapOptions, default_inputs, has_velocity, input_layers
from .prediction import predict_runs
from .validation import (
    DECAYS,
    Rows,
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
    """A trained network, and how it came about.

    ``data.used`` are the samples that it claims to describe, ``rows`` those it was chosen with;
    ``predicted`` is its output at all samples, shape ``(n,)`` [SI].
    """

    data: Data
    map: NetworkMap
    scaling: Scaling
    trial: Trial
    rows: Rows
    found: Search
    predicted: FloatArray
    iterations: int
    tables: Mapping[str, Any] = field(default_factory=dict)

    @property
    def network(self) -> Network:
        """The network in standardised coordinates."""
        return self.map.network

    @property
    def spikes(self) -> int:
        """Number of lone samples that were left out."""
        return self.rows.y.size - int(self.data.used.sum())


def fit_network(
    experiments: Sequence[Experiment], request: Request[ForceMapOptions]
) -> tuple[Fit, ForceMapOptions]:
    """Choose inputs and hidden units where asked to, then train; settle the options."""
    options, seed = settle_dead_bands(experiments, request.options), request.seed
    tables: dict[str, Any] = {}
    names = options.names or default_inputs(options, experiments)
    if options.inputs == "compare":
        names, tables["input_layers"] = _compare_layers(experiments, options, request)
    data, rows = _prepare(experiments, names, options, seed)
    span, units = Scaling.of(data).span, options.layers
    if not units:
        swept = sweep(rows, names, options, request)
        tables["hidden_units"] = [t.row(span) for t in swept]
        units = smallest_sufficient(swept).hidden
    trial, judged = _choose_training(rows, names, units, options, seed)
    if rows.length is not None:
        tables["straight"] = {
            "along": "length",
            "strength": trial.straightness,
            "judged": [
                {k: v * (span if k.endswith("rms") else 1.0) for k, v in row.items()}
                for row in judged
            ],
        }
    options = replace(
        options, inputs=",".join(names), hidden=",".join(map(str, units)),
        weight_decay=trial.decay, straightness=None if rows.length is None else trial.straightness,
    )  # fmt: skip
    fit = _train(experiments, data, rows, trial, replace(request, options=options))
    return replace(fit, tables=tables), options


def _compare_layers(
    experiments: Sequence[Experiment], options: ForceMapOptions, request: Request[ForceMapOptions]
) -> tuple[tuple[str, ...], list[dict[str, Any]]]:
    """Cross-validate the input layers of the paper; the cheapest good one, and the table."""
    units, trials, table = options.layers or (PAPER_UNITS[options.target],), [], []
    for layer in input_layers(options.target):
        if "velocity" in layer and not has_velocity(experiments):
            continue
        request.progress("validating inputs " + ", ".join(layer))
        data, rows = _prepare(experiments, layer, options, request.seed)
        trials.append(try_layer(rows, layer, units, options, request.seed))
        table.append(trials[-1].row(Scaling.of(data).span))
    return smallest_sufficient(trials).names, table


def _choose_training(
    rows: Rows, names: tuple[str, ...], units: tuple[int, ...], options: ForceMapOptions, seed: int
) -> tuple[Trial, list[dict[str, float]]]:
    """Weight decay and straightness, as settled or by validation.

    Judging rivals for a network of two layers would cost ten times its training.
    """
    if options.weight_decay is not None:
        decays = (options.weight_decay,)
        return try_layer(rows, names, units, options, seed, decays, options.straightness), []
    if len(units) > 1:
        return try_layer(rows, names, units, options, seed, DECAYS[:1]), []
    return straighten(rows, try_layer(rows, names, units, options, seed), options, seed)


def _prepare(
    experiments: Sequence[Experiment], names: tuple[str, ...], options: ForceMapOptions, seed: int
) -> tuple[Data, Rows]:
    data = gather(experiments, names, options)
    check_data(data, options)
    s = Scaling.of(data)
    split = split_rows(data, seed)
    x, y = s.inputs(data.x[data.used]), s.output(data.y[data.used])
    return data, Rows(x, y, split, length_column(data))


def _train(
    experiments: Sequence[Experiment], data: Data, rows: Rows, trial: Trial,
    request: Request[ForceMapOptions],
) -> Fit:  # fmt: skip
    """Train the final network on all used rows, spikes left out."""
    options = request.options
    request.progress(f"training {len(data.names)}-{'-'.join(map(str, trial.hidden))}-1")
    s = Scaling.of(data)
    rng = np.random.default_rng([request.seed, 7])
    chords = rows.chords(rows.x, trial.straightness)
    # a larger network has more to tell apart, and more optima nearly as good
    weights = sum(trial.hidden) * (rows.x.shape[1] + 1)
    training = Training(
        trial.hidden, options.activation, trial.decay, options.starts,
        rows=int(np.clip(100 * weights, 3000, 8000)),
        finalists=3 if sum(trial.hidden) <= ENUMERATED else 6,
    )  # fmt: skip
    found = search(rows.x, rows.y, training, rng, chords)

    def used_by(network: Network) -> tuple[NetworkMap, FloatArray, BoolArray]:
        made = NetworkMap(network, s.offset, s.scale, s.base, s.span)
        runs = predict_runs(made, experiments, options)
        used = np.concatenate([r.used for r in runs if r.used is not None])
        return made, np.concatenate([r.output for r in runs]), used

    net = _choose_candidate(found, s, data, options.driver)
    kept = used_by(net)[2]
    last = train_from(
        net, s.inputs(data.x[kept]), s.output(data.y[kept]),
        Cost(trial.decay, found.limit, chords), iterations=10, tolerance=1e-5,
    )  # fmt: skip
    made, predicted, used = used_by(last.network)
    return Fit(replace(data, used=used), made, s, trial, rows, found, predicted, last.iterations)


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
