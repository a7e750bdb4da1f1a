"""From experiments to a trained network: choice of the layers, training, spikes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...errors import Notice
from ...estimation.network import Cost, Search, Training, search, train_from
from ...experiment import BoolArray, Experiment, FloatArray
from ...family import Request, Simulated
from .certificates import ENUMERATED, certify, is_enumerable
from .data import Data, check_data, gather, settle_dead_bands
from .equation import NetworkMap, predict_runs
from .options import PAPER_UNITS, ForceMapOptions, default_inputs, has_velocity, input_layers
from .validation import (
    DECAYS,
    Rows,
    Trial,
    clipped_rms,
    positions_held_out,
    smallest_sufficient,
    straighten,
    sweep,
    try_layer,
)

_WORSE = 2.0  # held-out over training error from which it is said


@dataclass(frozen=True)
class Fit:
    """A trained network, and how it came about.

    ``data.used`` are the samples that it claims to describe, ``rows`` those it was chosen with;
    ``predicted`` is its output at all samples, shape ``(n,)`` [SI].
    """

    data: Data
    map: NetworkMap
    trial: Trial
    rows: Rows
    found: Search
    predicted: FloatArray
    iterations: int
    tables: Mapping[str, Any]

    @property
    def spikes(self) -> int:
        """Number of lone samples that were left out."""
        return self.rows.y.size - int(self.data.used.sum())


def fit_network(
    experiments: Sequence[Experiment], request: Request[ForceMapOptions]
) -> tuple[Fit, ForceMapOptions]:
    """Choose inputs and hidden units where asked to, then train; settle the options."""
    options = settle_dead_bands(experiments, request.options)
    request = replace(request, options=options)
    tables: dict[str, Any] = {}
    names = options.names or default_inputs(options, experiments)
    if options.inputs == "compare":
        names, tables["input_layers"] = _compare_layers(experiments, request)
    rows = _prepare(experiments, names, request)
    span, units = rows.scaling.span, options.layers
    if not units:
        swept = sweep(rows, request.progress)
        tables["hidden_units"] = [t.row(span) for t in swept]
        units = smallest_sufficient(swept).hidden
    trial, judged = _choose_training(rows, units, options)
    if rows.length is not None:
        tables["straight"] = {"along": "length", "strength": trial.straightness, "judged": judged}
    options = replace(
        options, inputs=",".join(names), hidden=",".join(map(str, units)),
        weight_decay=trial.decay, straightness=None if rows.length is None else trial.straightness,
    )  # fmt: skip
    return _train(experiments, rows, trial, replace(request, options=options), tables), options


def _compare_layers(
    experiments: Sequence[Experiment], request: Request[ForceMapOptions]
) -> tuple[tuple[str, ...], list[dict[str, Any]]]:
    """Cross-validate the input layers of the paper; the cheapest good one, and the table."""
    target = request.options.target
    units, trials, table = request.options.layers or (PAPER_UNITS[target],), [], []
    for layer in input_layers(target):
        if "velocity" in layer and not has_velocity(experiments):
            continue
        request.progress("validating inputs " + ", ".join(layer))
        rows = _prepare(experiments, layer, request)
        trials.append(try_layer(rows, units, DECAYS[:1]))
        table.append(trials[-1].row(rows.scaling.span))
    return smallest_sufficient(trials).names, table


def _choose_training(
    rows: Rows, units: tuple[int, ...], options: ForceMapOptions
) -> tuple[Trial, list[dict[str, float]]]:
    """Weight decay and straightness, as settled or by validation.

    Judging rivals for a network of two layers would cost ten times its training.
    """
    if options.weight_decay is not None:
        return try_layer(rows, units, (options.weight_decay,), options.straightness), []
    if len(units) > 1:
        return try_layer(rows, units, DECAYS[:1]), []
    return straighten(rows, try_layer(rows, units))


def _prepare(
    experiments: Sequence[Experiment], names: tuple[str, ...], request: Request[ForceMapOptions]
) -> Rows:
    data = gather(experiments, names, request.options)
    check_data(data, request.options)
    return Rows.of(data, request.options.activation, request.seed)


def _train(
    experiments: Sequence[Experiment], rows: Rows, trial: Trial,
    request: Request[ForceMapOptions], tables: Mapping[str, Any],
) -> Fit:  # fmt: skip
    """Train the final network on all used rows, spikes left out."""
    options, data, s = request.options, rows.data, rows.scaling
    request.progress(f"training {len(data.names)}-{'-'.join(map(str, trial.hidden))}-1")
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

    best = _choose_candidate(found, rows, options.driver)
    kept = _described(predict_runs(best, experiments, options))
    last = train_from(
        best.network, s.inputs(data.x[kept]), s.output(data.y[kept]),
        Cost(trial.decay, found.limit, chords), iterations=10, tolerance=1e-5,
    )  # fmt: skip
    made = NetworkMap(last.network, s)
    runs = predict_runs(made, experiments, options)
    output = np.concatenate([r.output for r in runs])
    data = replace(data, used=_described(runs))
    return Fit(data, made, trial, rows, found, output, last.iterations, tables)


def _described(runs: Sequence[Simulated]) -> BoolArray:
    return np.concatenate([r.used for r in runs if r.used is not None])


def _choose_candidate(found: Search, rows: Rows, source: str) -> NetworkMap:
    """The best network; of nearly equal ones a monotone one."""
    near = [c.network for c in found.candidates if c.cost <= 1.05 * found.best.cost]
    maps = [NetworkMap(net, rows.scaling) for net in near]
    if not is_enumerable(near[0]):
        return maps[0]
    return next((m for m in maps if certify(m, rows.data).monotone(source)), maps[0])


def validation_notices(fit: Fit) -> list[Notice]:
    """Warn where the held-out error says little, or says that the map does not carry over."""
    data, rows, out = fit.data, fit.rows, []
    if "position" in data.names and not positions_held_out(data):
        text = (
            "no position between others was recorded, so that none could be held out: the "
            "validation error is that of the recorded positions, and the map may be off by any "
            "amount at others. Record at least five positions over the range in use, or leave "
            "position out of --inputs and use the map where it was recorded."
        )
        out.append(Notice("few-positions", text))
    if rows.length is not None and len(rows.held_lengths()) < 1:
        text = (
            "only two lengths were recorded: between them the map is a straight line that nothing "
            "has tested. Record at least one length in between."
        )
        out.append(Notice("few-positions", text))
    held = rows.scaling.span * clipped_rms(fit.trial.error)
    here = clipped_rms((data.y - fit.predicted)[data.used])
    if held > _WORSE * here:
        text = (
            f"the map misses what was held out by {held:.3g}, {held / here:.1f} times as much as "
            f"what it was trained on ({here:.3g}, SI): between the recorded positions expect the "
            "former. Record more positions, or give fewer --hidden units."
        )
        out.append(Notice("validation-worse", text))
    return out


def spike_notice(fit: Fit) -> list[Notice]:
    """Say how many spikes were left out, where they are more than a curiosity."""
    if not fit.spikes:
        return []
    share = 100.0 * fit.spikes / (fit.spikes + int(fit.data.used.sum()))
    text = (
        f"{fit.spikes} samples ({share:.2g} %) stand alone far off their neighbours: spikes "
        "of the load cell. They were left out."
    )
    return [Notice("force-spikes", text)]
