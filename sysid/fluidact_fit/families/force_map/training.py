"""From experiments to a trained network: choice of the layers, training, what is said of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from ...errors import Notice
from ...estimation.map import (
    Index,
    cross_validate,
    fold_squares,
    interior_folds,
    robust_deviation,
    smallest_sufficient,
)
from ...estimation.network import Chords, Training, search, thin
from ...estimation.noise import noise_floor
from ...estimation.robust_weights import SPIKE
from ...estimation.scaled_network import ScaledNetwork, Scaling
from ...experiment import BoolArray, Experiment, FloatArray
from ...family import Quantity, Request
from ...units import after_number
from .certificates import ENUMERATED, Certificate
from .data import Data, check_data, gather, predict_runs, settle_dead_bands, state_column
from .options import ForceMapOptions, default_inputs

_SWEEP = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 16, 20)  # hidden units that are tried
_DECAY = 1e-5  # weight decay
_STRAIGHT = (0.03, 1.0)  # strength of chords along a length, of many lengths and of few
_MOST_LENGTHS = 8  # with more of them the data say what is between
_MATTERS = 5e-3  # share of the range of the target that is worth a warning


# ------------------------------------------------------------------------------ what is fitted


@dataclass(frozen=True)
class Rows:
    """The used rows of the data, standardised, and the folds that they are held out in.

    Rows of the ``groups`` inside are held out together; ``length`` is the column of a length that
    names the specimens.
    """

    data: Data
    scaling: Scaling
    x: FloatArray
    y: FloatArray
    folds: Index
    split_by: str
    groups: int
    length: int | None
    request: Request[ForceMapOptions]

    @classmethod
    def of(
        cls,
        experiments: Sequence[Experiment],
        names: tuple[str, ...],
        request: Request[ForceMapOptions],
    ) -> Self:
        """Gather, check, standardise and split the used rows."""
        data = gather(experiments, names, request.options)
        check_data(data, request.options)
        x, y, length = data.x[data.used], data.y[data.used], None
        if "length" in names and all(np.ptp(e["length"]) == 0.0 for e in experiments):
            column = names.index("length")
            length = column if 2 <= np.unique(x[:, column]).size <= _MOST_LENGTHS else None
        # 1 and -1 of a motion state are of order one, and stay readable
        s, split = Scaling.of(x, y, kept=state_column(names)), _split(data, request.seed)
        return cls(data, s, s.inputs(x), s.output(y), *split, length, request)

    @property
    def lengths(self) -> int:
        """Number of lengths that name specimens."""
        return 0 if self.length is None else np.unique(self.x[:, self.length]).size

    def chords(self, x: FloatArray) -> Chords | None:
        """Chords along the length, for some of the rows: an odd one of few would bend the map."""
        if self.length is None:
            return None
        return Chords.along(x, self.length, _STRAIGHT[int(self.lengths <= 3)])

    def held_out(self, hidden: tuple[int, ...]) -> FloatArray:
        """Errors on rows that were not trained, by short searches, shape ``(n,)``."""
        few = max(1200, 12 * sum(hidden) * (self.x.shape[1] + 1))
        brief = Training(
            hidden, self.request.options.activation, _DECAY, 4, few, iterations=25, finalists=2
        )

        def predict(rest: BoolArray, held: BoolArray, fold: int) -> FloatArray:
            kept = np.flatnonzero(rest)
            kept = kept[thin(kept.size, few)]
            rng, x = np.random.default_rng([self.request.seed, fold]), self.x[kept]
            found = search(x, self.y[kept], brief, rng, self.chords(x))
            return self.y[held] - found[0].network(self.x[held])

        return cross_validate(self.folds, predict)


def _split(data: Data, seed: int) -> tuple[Index, str, int]:
    """Fold the used rows by position, by log, or by stretches of the record.

    The outermost positions are never held out: beyond them a network extrapolates.
    Returns the fold of each row, what they were split by, and the number of groups.
    """
    position, logs = data.position[data.used], data.log[data.used]
    levels = data.levels
    count, records = int(levels.max()) + 1, np.unique(logs)
    if count >= 5 or (count >= 3 and records.size < 3):
        by, labels, inner = "position", levels, np.arange(1, count - 1)
    elif records.size >= 3:
        means = np.array([position[logs == k].mean() for k in records])
        outer = (means == means.min()) | (means == means.max())
        alone = outer & (np.sum(means[:, None] == means, axis=0) == 1)
        by, labels, inner = "log", logs, records[~alone]
    else:
        by, labels = "stretch of the record", np.arange(position.size) * 6 // position.size
        inner = np.arange(1, 5)
    return interior_folds(labels, inner, 4, seed), by, inner.size


# ------------------------------------------------------------------------ choice and training


@dataclass(frozen=True)
class Fit:
    """A trained network, and how it came about.

    ``data.used`` are the samples that it claims to describe, ``rows`` those it was chosen with,
    ``error`` what it missed held-out rows by, standardised; ``predicted`` is its output at all
    samples, shape ``(n,)`` [SI]. ``options`` are settled.
    """

    data: Data
    map: ScaledNetwork
    rows: Rows
    error: FloatArray
    predicted: FloatArray
    options: ForceMapOptions
    tables: dict[str, Any]

    @property
    def spikes(self) -> int:
        """Number of lone samples, which no error includes."""
        return self.rows.y.size - int(self.data.used.sum())


def fit_network(experiments: Sequence[Experiment], request: Request[ForceMapOptions]) -> Fit:
    """Choose inputs and hidden units where asked to, then train; settle the options."""
    options = settle_dead_bands(experiments, request.options)
    names = options.names or default_inputs(options, experiments)
    rows = Rows.of(experiments, names, replace(request, options=options))
    units, tables = (options.layers, {}) if options.layers else _choose_units(rows)
    options = replace(options, inputs=",".join(names), hidden=",".join(map(str, units)))
    error = rows.held_out(units)
    request.progress(f"training {len(names)}-{'-'.join(map(str, units))}-1")
    best = _train(rows, units, options)
    runs = predict_runs(best, experiments, options)
    output = np.concatenate([r.output for r in runs])
    used = np.concatenate([r.used for r in runs if r.used is not None])
    return Fit(replace(rows.data, used=used), best, rows, error, output, options, tables)


def _choose_units(rows: Rows) -> tuple[tuple[int, ...], dict[str, Any]]:
    """Cross-validate hidden layers, smallest first: the first sufficient one, and a table.

    More and more units are tried until three in a row gain nothing.
    """
    scores: list[FloatArray] = []
    table, inputs = [], len(rows.data.names)
    for units in _SWEEP:
        rows.request.progress(f"validating {', '.join(rows.data.names)} with {units} hidden units")
        error = rows.held_out((units,))
        scores.append(fold_squares(_clipped(error), rows.folds))
        weights = (inputs + 1) * units
        table.append({
            "hidden": [units], "validation_rms": rms(error) * rows.scaling.span,
            "parameters": weights + units + 1, "multiplications": weights,
        })  # fmt: skip
        if len(scores) > 4 and smallest_sufficient(scores) < len(scores) - 3:
            break
    return (_SWEEP[smallest_sufficient(scores)],), {"hidden_units": table}


def _train(rows: Rows, hidden: tuple[int, ...], options: ForceMapOptions) -> ScaledNetwork:
    """The network of all used rows: of nearly equal optima a monotone one, if there is any."""
    # a larger network has more to tell apart, and more optima nearly as good
    weights = sum(hidden) * (rows.x.shape[1] + 1)
    training = Training(
        hidden, options.activation, _DECAY, options.starts,
        rows=int(np.clip(100 * weights, 3000, 8000)),
        finalists=3 if sum(hidden) <= ENUMERATED else 6,
    )  # fmt: skip
    rng = np.random.default_rng([rows.request.seed, 7])
    found = search(rows.x, rows.y, training, rng, rows.chords(rows.x))
    alike = [
        ScaledNetwork(c.network, rows.scaling) for c in found if c.cost <= 1.05 * found[0].cost
    ]
    marks = (Certificate.of(net, rows.data, options.driver) for net in alike)
    return next((net for net, mark in zip(alike, marks) if mark and not mark.fault), alike[0])


# ------------------------------------------------------------------------- what is said of it


def rms(error: FloatArray) -> float:
    """Root mean square of what is finite."""
    found = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(found**2))) if found.size else float("nan")


def _clipped(error: FloatArray) -> FloatArray:
    """Errors with spikes cut off."""
    limit = SPIKE * robust_deviation(error[np.isfinite(error)])
    return np.clip(error, -limit, limit)


def training_notices(fit: Fit) -> Iterator[Notice]:
    """Warn of spikes, of too few positions, and of a large held-out error.

    What is missed beyond the training error has to exceed that error and a size that matters: a
    held-out position lies twice as far from others as any place in use does.
    """
    data, rows = fit.data, fit.rows
    if fit.spikes:
        yield Notice(
            "force-spikes",
            f"{fit.spikes} samples ({100.0 * fit.spikes / rows.y.size:.2g} %) stand alone far off "
            f"their neighbours: spikes of the {fit.options.target}. They hardly count, and no "
            "error includes them.",
        )
    if "position" in data.names:
        yield from _position_notices(data)
    if rows.lengths == 2:
        yield Notice(
            "few-positions",
            "only two lengths were recorded: between them the map is a straight line that nothing "
            "has tested. Record at least one length in between.",
        )
    held = rows.scaling.span * rms(_clipped(fit.error))
    here = rms(_clipped((data.y - fit.predicted)[data.used]))
    least = _MATTERS * float(np.ptp(data.y[data.used]))
    if held**2 - here**2 > max(here, least) ** 2:
        yield Notice(
            "validation-worse",
            f"the map misses what was held out by {held:.3g}, {held / here:.1f} times as much as "
            f"what it was trained on ({here:.3g}, SI): between the recorded positions it may be "
            "off by the former. Record more positions, or give fewer --hidden units.",
        )


def _position_notices(data: Data) -> Iterator[Notice]:
    """Warn where no position between others was recorded, or of an untested gap between two.

    A position that moves all the time is as good as many; one that only shows its noise is one. Of
    a gap the distance of its middle to what was trained is compared with that of the most remote
    sample of a level that was held out.
    """
    position, levels, highest = data.position[data.used], data.levels, int(data.levels.max())
    noise = max(noise_floor(position, 1, robust=False), 1e-300)
    if highest == 1 or (highest == 0 and float(np.ptp(position)) <= 20.0 * noise):
        yield Notice(
            "few-positions",
            "no position between others was recorded, so that none could be held out: the "
            "validation error is that of the recorded positions, and the map may be off by any "
            "amount at others. Record at least five positions over the range in use, or leave "
            "position out of --inputs and use the map where it was recorded.",
        )
    if highest < 2:
        return
    parts = [position[levels == k] for k in range(highest + 1)]
    low, high = np.array([(p.min(), p.max()) for p in parts]).T
    below, above, gaps = high[:-2], low[2:], low[1:] - high[:-1]
    remote = np.clip(0.5 * (below + above), low[1:-1], high[1:-1])
    k = int(np.argmax(gaps))
    unit = after_number(data.units[data.names.index("position")])
    if 0.5 * gaps[k] > np.minimum(remote - below, above - remote).max():
        yield Notice(
            "few-positions",
            f"no position between {high[k]:.3g} and {low[k + 1]:.3g}{unit} was recorded, and the "
            "map was tested over no gap as wide: within it the map may be off by any amount. "
            "Record positions in between.",
        )


def file_parameters(fit: Fit) -> dict[str, Quantity]:
    """Layers and scalings as they stand in the file."""
    x = fit.data.x[fit.data.used]
    ends = {"input_low": x.min(axis=0).tolist(), "input_high": x.max(axis=0).tolist()}
    return {
        name: Quantity(value, "1", "estimated" if name[-2:-1] == "_" else "derived")
        for name, value in (fit.map.numbers() | ends).items()
    }


def fit_details(fit: Fit) -> dict[str, Any]:
    """Training and errors for the file."""
    data, net, rows = fit.data, fit.map.network, fit.rows
    held = np.full(data.y.size, np.nan)
    held[rows.data.used] = rows.scaling.span * fit.error
    return {
        "inputs": list(data.names),
        "input_units": list(data.units),
        "hidden": list(net.hidden),
        "network_parameters": net.parameters,
        "multiplications": net.multiplications,
        "spikes": fit.spikes,
        "correlation": float(np.corrcoef(data.y[data.used], fit.predicted[data.used])[0, 1]),
        "branches": _scores(data, data.y - fit.predicted),
        "validation": {
            "split_by": rows.split_by,
            "groups_held_out": rows.groups,
            "folds": int(rows.folds.max()) + 1,
            **_scores(replace(data, used=np.isfinite(held)), held),
        },
        **fit.tables,
    }


def _scores(data: Data, error: FloatArray) -> dict[str, Any]:
    """Errors over all used samples, by branch, and well within the branches [SI]."""
    out: dict[str, Any] = {"rmse": rms(error[data.used])}
    for name, sign in (("loading", 1.0), ("unloading", -1.0)):
        branch = data.used & (data.direction == sign)
        if branch.any():
            inside = branch & data.settled
            out[name] = {"samples": int(branch.sum()), "rmse": rms(error[branch])}
            if inside.any():
                out[name]["in_branch_rmse"] = rms(error[inside])
    return out
