"""Force maps of a cylinder with hysteresis: small networks of command and force.

    command = f_u(force, position, motion state)               (equation 5 of [1]_)
    force   = f_F(command, position, velocity, motion state)   (equation 6 of [1]_)

    f(x) = offset + scale (W_2 phi(W_1 (x - x_0) / s_x + b_1) + b_2)

The first network is the feed-forward controller, the second the observer of the force that
needs no load cell. Spring, friction and valve are not modelled one by one: that is the gray
box ``spring-cylinder``. The paper trains 3-5-1 and 4-7-1 ReLU networks.

The motion state is printed as ``s = u_j - u_(j-1)`` (equation 3). Taken literally it is
zero whenever the command rests and grows with the sampling time; the branches of the
hysteresis are told apart by its sign, held while the command rests. A dead band keeps
noise from reversing it. A log's own direction column may be used instead.

Samples of one position are nearly copies of each other, so whole positions or whole logs
are held out for validation, never random rows.

A ``length`` that is the same throughout each log names the specimen. Specimens differ by more
than their lengths: a curve through all of them is no guide to the next, so that between the
recorded lengths the output is held near a straight line (:class:`..estimation.network.Chords`).
How near is judged on the recorded logs alone: by the error on whole lengths held out, and by
the error on the lengths there are.

References
----------
.. [1] X. Wu, H. Hua, S. Feng, Y. Zhao, Y. Yang, Z. Liao, "Data-Driven Feedforward Force
   Control of a Single-Acting Pneumatic Cylinder with a Nonlinear Hysteresis
   Characteristic", Actuators 14, 162, 2025.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from ..errors import LogError, Notice, NotIdentifiedError, UsageError
from ..estimation.network import (
    Activation,
    Chords,
    Network,
    Search,
    activation_regions,
    cross_validate,
    gradient_interval,
    polynomial_fit,
    polynomial_terms,
    robust_deviation,
    search,
    thin,
    train_from,
)
from ..estimation.parametric import check_request
from ..experiment import Experiment, FloatArray, Hold
from ..family import (
    Block,
    Curve,
    Estimate,
    Family,
    Option,
    ParameterSpec,
    Quantity,
    Request,
    Role,
    StaticView,
    Value,
    Variant,
)
from ..signals import held_direction, smooth

BoolArray = npt.NDArray[np.bool_]

_TARGETS = ("command", "force")
_PAPER_UNITS = {"command": 5, "force": 7}  # hidden units of the paper
_SWEEP = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 16, 20)
_WORTH = 0.03  # relative gain of validation below which more is not worth its cost
_DECAYS = (1e-5, 1e-6, 3e-5)  # weight decay: the usual one, and rivals
_STRAIGHT = (0.03, 0.0, 1.0)  # strength of the chords along a length, likewise
_STRAIGHT_FEW = 1.0  # with three lengths or two: one odd specimen looks like a curve
_OBJECTION = 0.05  # relative gain of validation from which a rival takes over
_MOST_LENGTHS = 8  # with more of them the data say what is between
_MOST_FOLDS = 4
_SPIKE = 12.0  # errors beyond this many robust standard deviations do not choose a network
_ENUMERATED = 8  # hidden units up to which the regions are enumerated
_SETTLED = 0.1  # share of the range after a reversal within which branches change over
_MEETING = 8  # samples after a reversal that belong to it in any case
_ALIASES = {
    "pressure": "command", "voltage": "command", "contraction": "position",
    "state": "direction", "motion-state": "direction", "motion_state": "direction",
}  # fmt: skip


# ------------------------------------------------------------------------- the equation


def force_map(
    parameters: Mapping[str, Value], x: FloatArray, activation: str = "relu"
) -> FloatArray:
    """Output of a network for inputs in SI.

    ``y = output_offset + output_scale (W_L phi(... W_1 (x - input_offset) / input_scale ...))``

    Parameters
    ----------
    parameters
        As in the file.
    x : (n, inputs)
        Inputs in the file's order [SI].
    activation
        ``relu`` or ``tanh``.

    Returns
    -------
    (n,) [SI unit of the target]
    """
    net = network_of(parameters, activation)
    offset, scale = (np.asarray(parameters[f"input_{k}"], dtype=float) for k in ("offset", "scale"))
    y = net((x - offset) / scale)
    return _number(parameters["output_offset"]) + _number(parameters["output_scale"]) * y


def network_of(parameters: Mapping[str, Value], activation: str = "relu") -> Network:
    """The network of a file, in standardised coordinates."""
    layers = [k for k in ("1", "2", "3") if f"weights_{k}" in parameters]
    return Network(
        tuple(np.asarray(parameters[f"weights_{k}"], dtype=float) for k in layers),
        tuple(np.asarray(parameters[f"biases_{k}"], dtype=float) for k in layers),
        cast(Activation, activation),
    )


def _number(value: Value) -> float:
    return float(np.asarray(value, dtype=float).ravel()[0])


# ------------------------------------------------------------------------- motion state


def motion_state(column: FloatArray) -> FloatArray:
    """A log's direction column as 1 (loading), -1 (unloading) or 0 (unknown).

    Positive is loading and negative unloading; a column of 1 and 2 (pressurising, venting)
    or of 1 and 0 is understood as well.
    """
    kinds = set(np.unique(column).tolist())
    if kinds <= {1.0, 2.0}:
        return np.where(column == 1.0, 1.0, -1.0)
    if kinds == {0.0, 1.0}:
        return np.where(column == 1.0, 1.0, -1.0)
    return np.sign(column)


def choose_dead_band(values: FloatArray) -> float:
    """Change that is no noise: what a median over five samples leaves, or 0.5 % of the range."""
    if values.size < 8:
        return 0.0
    flicker = np.abs(values - _running_median(values, 2))
    third = np.abs(np.diff(values, 3))
    noise = 1.4826 * float(np.median(third)) / np.sqrt(20.0)
    return float(max(3.0 * np.quantile(flicker, 0.9), 6.0 * noise, 5e-3 * float(np.ptp(values))))


def _running_median(values: FloatArray, half: int) -> FloatArray:
    padded = np.pad(values, half, mode="reflect" if values.size > half else "edge")
    return np.asarray(
        np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)
    )


def _direction(e: Experiment, size: int, source: str, dead_band: float | None) -> FloatArray:
    """Motion state of each sample: the log's own, or the held sign of a change."""
    if "direction" in e:
        return motion_state(_column(e, "direction", size))
    values = _column(e, source, size)
    band = choose_dead_band(values) if dead_band is None else dead_band
    return held_direction(values, band).astype(float)


def _fill_start(direction: FloatArray) -> None:
    """Give the samples before the first change its direction, in place."""
    known = np.flatnonzero(direction)
    if known.size:
        direction[: known[0]] = direction[known[0]]


def _settled(values: FloatArray, direction: FloatArray, least: float) -> BoolArray:
    """Samples that have moved away from the last reversal by at least ``least``.

    The first few do not count however far a command has jumped: a rod that left the sensor
    meets it again in them.
    """
    turned = np.concatenate(([0], np.flatnonzero(np.diff(direction)) + 1))
    now = np.arange(values.size)
    last = turned[np.searchsorted(turned, now, side="right") - 1]
    return np.asarray((np.abs(values - values[last]) >= least) & (now - last >= _MEETING))


# ------------------------------------------------------------------------------ options


@dataclass(frozen=True)
class _Options:
    """What the user chose. ``inputs`` is empty for the default, ``hidden`` for ``auto``."""

    target: str
    inputs: tuple[str, ...]
    compare: bool
    hidden: tuple[int, ...]
    activation: Activation
    dead_band: float | None
    starts: int

    @classmethod
    def read(cls, given: Mapping[str, Any]) -> _Options:
        target = given.get("target") or "command"
        text = str(given.get("inputs") or "").strip().lower()
        compare = text == "compare"
        inputs = () if compare or not text else _read_inputs(text, target)
        return cls(
            target,
            inputs,
            compare,
            _read_hidden(str(given.get("hidden") or _PAPER_UNITS[target])),
            given.get("activation") or "relu",
            given.get("dead-band"),
            int(given.get("starts") or 16),
        )

    @property
    def source(self) -> str:
        """Whose change is the motion state while training."""
        return "command"


def _read_inputs(text: str, target: str) -> tuple[str, ...]:
    known = [r.name for r in _ROLES if r.name not in ("time", target)]
    found = tuple(_ALIASES.get(word.strip(), word.strip()) for word in text.split(","))
    for name in found:
        if name not in known:
            said = "is what the network predicts" if name == target else "is not a role"
            raise UsageError(
                f"--inputs {text}: '{name}' {said}",
                expected=f"For --target {target}: {', '.join(known)}, or compare.",
            )
    if len(set(found)) < len(found):
        raise UsageError(f"--inputs {text} names an input twice", remedy="Name each input once.")
    return found


def _read_hidden(text: str) -> tuple[int, ...]:
    """Hidden units per layer; empty for ``auto``."""
    if text.strip().lower() == "auto":
        return ()
    words = [w.strip() for w in text.split(",")]
    if len(words) <= 2 and all(w.isdigit() and 1 <= int(w) <= 64 for w in words):
        return tuple(int(w) for w in words)
    raise UsageError(
        f"--hidden {text}: no such hidden layer",
        expected="auto, a number from 1 to 64, or two of them for two layers (16,16).",
    )


def _layers(target: str) -> list[tuple[str, ...]]:
    """The four input layers that the paper compares (figures 7 and 8)."""
    first = "force" if target == "command" else "command"
    return [
        (first, "position"),
        (first, "position", "velocity"),
        (first, "position", "direction"),
        (first, "position", "velocity", "direction"),
    ]


def _default_inputs(options: _Options, experiments: Sequence[Experiment]) -> tuple[str, ...]:
    """The paper's best layer, as far as the logs hold it, with any length added."""
    layer = _layers(options.target)[2 if options.target == "command" else 3]
    kept = [n for n in layer if n != "velocity" or _has_velocity(experiments)]
    if all("length" in e for e in experiments):
        kept.insert(2, "length")
    return tuple(kept)


def _has_velocity(experiments: Sequence[Experiment]) -> bool:
    return all("velocity" in e or (e.time.size > 4 and e["position"].size > 1) for e in experiments)


# ----------------------------------------------------------------------------- the data


def _size(e: Experiment) -> int:
    return int(e.time.size) or max(s.values.size for s in e.signals.values())


def _column(e: Experiment, role: str, size: int) -> FloatArray:
    """Values of a role at every sample; a constant given by ``--step`` is spread out.

    Raises
    ------
    LogError
        When the log does not hold it and it cannot be computed.
    """
    if role == "velocity" and "velocity" not in e:
        return _velocity(e, size)
    if role not in e:
        raise LogError(
            f"the network needs '{role}', and there is none.",
            where=e.name,
            remedy=f"Give --column {role}=HEADER, --step {role}=VALUE:VALUE for a constant, or "
            "--inputs without it.",
        )
    s = e.signals[role]
    if s.values.size == size:
        return s.values
    if not e.time.size:
        return np.full(size, s.values[-1])
    at = np.searchsorted(s.time, e.time, side="right")
    return np.asarray(np.append(s.before, s.values)[at])


def _velocity(e: Experiment, size: int) -> FloatArray:
    """Velocity from position: local polynomials, or differences on uneven time [m/s]."""
    if e.time.size < 5 or "position" not in e:
        raise LogError(
            "the network needs 'velocity', and without time it cannot be computed.",
            where=e.name,
            remedy="Give --column velocity=HEADER or --column time=HEADER, or --inputs without it.",
        )
    position = _column(e, "position", size)
    if e.uniform:
        return smooth(position, e.sample_time, 5).rate
    return np.asarray(np.gradient(position, e.time))


@dataclass(frozen=True)
class _Data:
    """All logs in one table.

    ``x`` has shape ``(n, inputs)``, all others ``(n,)`` [SI]. ``used`` marks what is fitted,
    ``settled`` what lies well within a branch.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    x: FloatArray
    y: FloatArray
    used: BoolArray
    direction: FloatArray
    settled: BoolArray
    position: FloatArray
    log: npt.NDArray[np.intp]
    parts: tuple[slice, ...]
    unit: str

    def split(self, values: FloatArray) -> list[FloatArray]:
        """Values per experiment."""
        return [values[p] for p in self.parts]


def _inputs(e: Experiment, names: Sequence[str], options: _Options) -> FloatArray:
    """Inputs of one experiment, shape ``(n, inputs)`` [SI]."""
    size = _size(e)
    source = options.source if options.source in e else "force"
    return np.column_stack(
        [
            _direction(e, size, source, options.dead_band if source == "command" else None)
            if n == "direction"
            else _column(e, n, size)
            for n in names
        ]
    )


def _gather(experiments: Sequence[Experiment], names: tuple[str, ...], options: _Options) -> _Data:
    x, y, directions, settled, positions, logs = [], [], [], [], [], []
    parts, begin = [], 0
    for e in experiments:
        size = _size(e)
        x.append(_inputs(e, names, options))
        y.append(_column(e, options.target, size))
        command = _column(e, "command", size)
        direction = _direction(e, size, "command", options.dead_band)
        directions.append(direction)
        settled.append(_settled(command, direction, _SETTLED * float(np.ptp(command))))
        positions.append(_column(e, "position", size))
        logs.append(np.full(size, e.log))
        parts.append(slice(begin, begin + size))
        begin += size
    table = np.vstack(x)
    state = np.concatenate(directions)
    used = np.isfinite(table).all(axis=1) & np.isfinite(np.concatenate(y))
    if "direction" in names:
        used &= state != 0.0
    units = tuple(
        "m/s" if n == "velocity" and n not in experiments[0] else
        "1" if n == "direction" else experiments[0].signals[n].unit for n in names
    )  # fmt: skip
    return _Data(
        names, units, table, np.concatenate(y), used, state, np.concatenate(settled),
        np.concatenate(positions), np.concatenate(logs), tuple(parts),
        experiments[0].signals[options.target].unit,
    )  # fmt: skip


def _check_data(data: _Data, options: _Options) -> None:
    """Refuse data that no network can be trained on."""
    rows = int(data.used.sum())
    units = options.hidden or (2,)
    needed = 2 * (sum(units) * (data.x.shape[1] + 2) + 1)
    if rows < needed:
        raise NotIdentifiedError(
            f"{rows} samples cannot determine a network of {needed // 2} weights or so.",
            expected=f"At least {needed} samples with a known motion state.",
            remedy="Record longer, give fewer --hidden units, or check --dead-band.",
        )
    moving = [k for k, n in enumerate(data.names) if n != "direction"]
    spread = [float(np.ptp(data.x[data.used, k])) for k in moving]
    main = (
        data.names.index("force" if options.target == "command" else "command")
        if ({"force", "command"} & set(data.names))
        else -1
    )
    still = main >= 0 and spread[moving.index(main)] == 0.0
    if still or float(np.ptp(data.y[data.used])) == 0.0:
        raise NotIdentifiedError(
            f"command or force does not change in these {rows} samples.",
            remedy="Record the force while the command is raised and lowered over its range.",
        )


def _data_notices(data: _Data) -> list[Notice]:
    """Warnings about what the data cannot tell."""
    out = []
    for k, name in enumerate(data.names):
        if np.ptp(data.x[data.used, k]) > 0.0:
            continue
        value, unit = data.x[data.used][0, k], data.units[k]
        out.append(
            Notice(
                "input-constant",
                f"{name} is {value:.6g} {unit} in all samples: the network says nothing about "
                f"another {name}. Record more of them, or leave it out of --inputs.",
            )
        )
    return out


@dataclass(frozen=True)
class _Scaling:
    """From SI to order one: ``z = (x - offset) / scale``, the output alike."""

    offset: FloatArray
    scale: FloatArray
    base: float
    span: float

    @classmethod
    def of(cls, data: _Data) -> _Scaling:
        x, y = data.x[data.used], data.y[data.used]
        offset, scale = x.mean(axis=0), x.std(axis=0)
        for k, name in enumerate(data.names):
            if name == "direction":  # 1 and -1 are of order one, and stay readable
                offset[k], scale[k] = 0.0, 1.0
        scale = np.where(scale > 1e-12 * np.maximum(np.abs(offset), 1e-300), scale, 1.0)
        return cls(offset, scale, float(y.mean()), float(y.std()))

    def inputs(self, x: FloatArray) -> FloatArray:
        return np.asarray((x - self.offset) / self.scale)

    def output(self, y: FloatArray) -> FloatArray:
        return np.asarray((y - self.base) / self.span)


# ---------------------------------------------------------------------------- validation


@dataclass(frozen=True)
class _Split:
    """Held-out rows per fold, over the used rows, and what they were split by."""

    folds: tuple[BoolArray, ...]
    by: str
    groups: int


def _levels(position: FloatArray) -> npt.NDArray[np.intp]:
    """Number of the position level of each sample: gaps of 3 % of the range divide them."""
    order = np.argsort(position, kind="stable")
    gap = np.diff(position[order]) > 0.03 * float(np.ptp(position))
    out = np.empty(position.size, dtype=np.intp)
    out[order] = np.concatenate(([0], np.cumsum(gap)))
    return out


def _split(data: _Data, seed: int) -> _Split:
    """Fold the used rows by position, by log, or by stretches of the record.

    The outermost positions are never held out: beyond them a network extrapolates.
    """
    position, logs = data.position[data.used], data.log[data.used]
    levels = _levels(position)
    count, records = int(levels.max()) + 1, np.unique(logs)
    if count >= 5 or (count >= 3 and records.size < 3):
        by, labels, inner = "position", levels, list(range(1, count - 1))
    elif records.size >= 3:
        means = {int(k): float(position[logs == k].mean()) for k in records}
        ends = {min(means.values()), max(means.values())}
        alone = {k for k, m in means.items() if m in ends and list(means.values()).count(m) == 1}
        by, labels, inner = "log", logs, [k for k in means if k not in alone]
    else:
        by, labels = "stretch of the record", np.arange(position.size) * 6 // position.size
        inner = [1, 2, 3, 4]
    order = np.random.default_rng(seed).permutation(inner)
    folds = min(_MOST_FOLDS, order.size)
    return _Split(tuple(np.isin(labels, order[k::folds]) for k in range(folds)), by, order.size)


def _rms(error: FloatArray) -> float:
    """Root mean square of what is finite."""
    found = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(found**2))) if found.size else float("nan")


def _clipped_rms(error: FloatArray) -> float:
    """Root mean square with spikes cut off."""
    found = error[np.isfinite(error)]
    limit = _SPIKE * robust_deviation(found)
    return float(np.sqrt(np.mean(np.minimum(np.abs(found), limit) ** 2)))


# ------------------------------------------------------------------------------ training


@dataclass(frozen=True)
class _Rows:
    """Standardised used rows with their split, and the column of the specimens' length."""

    x: FloatArray
    y: FloatArray
    split: _Split
    length: int | None

    def chords(self, x: FloatArray, strength: float) -> Chords | None:
        """Chords along the length, for some of the rows."""
        if self.length is None or strength == 0.0:
            return None
        return Chords.along(x, self.length, strength)

    @property
    def usual_straightness(self) -> float:
        """Strength of the chords unless validation objects."""
        return _STRAIGHT[0] if len(self.held_lengths()) > 1 else _STRAIGHT_FEW

    def held_lengths(self) -> list[BoolArray]:
        """Rows of each length but the shortest and the longest."""
        if self.length is None:
            return []
        values = self.x[:, self.length]
        return [np.asarray(values == v) for v in np.unique(values)[1:-1]]


def _length_column(data: _Data) -> int | None:
    """Column of a length that names the specimens; ``None`` where there is none."""
    if "length" not in data.names:
        return None
    k = data.names.index("length")
    fixed = all(np.ptp(part) == 0.0 for part in data.split(data.x[:, k]))
    return k if fixed and 2 <= np.unique(data.x[:, k]).size <= _MOST_LENGTHS else None


@dataclass(frozen=True)
class _Trial:
    """One row of a table: an input layer with hidden units and what validation says."""

    names: tuple[str, ...]
    hidden: tuple[int, ...]
    decay: float
    error: FloatArray
    straightness: float

    def row(self, span: float) -> dict[str, Any]:
        """As it stands in the file; ``span`` is the scale of the output."""
        sizes = (len(self.names), *self.hidden, 1)
        weights = sum(a * b for a, b in pairwise(sizes))
        return {
            "inputs": ",".join(self.names),
            "hidden": list(self.hidden),
            "validation_rms": _rms(self.error) * span,
            "parameters": weights + sum(sizes[1:]),
            "multiplications": weights,
        }


def _try(
    rows: _Rows, names: tuple[str, ...], hidden: tuple[int, ...], options: _Options, seed: int,
    decays: Sequence[float] = _DECAYS, strength: float | None = None,
) -> _Trial:  # fmt: skip
    """Cross-validate a layer with the usual weight decay, or one that is clearly better."""
    straightness = rows.usual_straightness if strength is None else strength
    trials = [
        _Trial(
            names, hidden, decay,
            _held_out(rows, rows.split.folds, hidden, options, seed, decay, straightness),
            straightness,
        )
        for decay in decays
    ]  # fmt: skip
    return trials[_usual_or_better([_clipped_rms(t.error) for t in trials])]


def _usual_or_better(scores: Sequence[float]) -> int:
    """Number of the best score if it beats the first by enough to be no accident, or 0."""
    best = int(np.argmin(scores))
    return best if scores[best] < (1.0 - _OBJECTION) * scores[0] else 0


def _few_rows(rows: _Rows, hidden: tuple[int, ...]) -> int:
    """Rows of a search for validation."""
    return max(1200, 12 * sum(hidden) * (rows.x.shape[1] + 1))


def _held_out(
    rows: _Rows, folds: Sequence[BoolArray], hidden: tuple[int, ...], options: _Options, seed: int,
    decay: float, straightness: float,
) -> FloatArray:  # fmt: skip
    """Errors on rows that were not trained; see :func:`cross_validate`."""
    return cross_validate(
        rows.x, rows.y, folds, hidden, seed, activation=options.activation, decay=decay,
        chords=lambda x: rows.chords(x, straightness), rows=_few_rows(rows, hidden),
    )  # fmt: skip


def _straighten(
    rows: _Rows, trial: _Trial, options: _Options, seed: int
) -> tuple[_Trial, list[dict[str, float]]]:
    """Judge how nearly straight the output has to be along the length.

    Two questions weigh the same: another log of the same specimens, answered by the error of
    the fit (rows abound), and another specimen, answered by whole lengths held out. The usual
    strength stands unless a rival is clearly better. Of three lengths only one can be held
    out, and between the two that are left nothing is curved: there is nothing to judge.

    Returns
    -------
    trial
        With the strength that is kept.
    table
        Strength, and both errors, standardised.
    """
    folds, table, scores = rows.held_lengths(), [], []
    for strength in _STRAIGHT if len(folds) > 1 else ():
        between = _held_out(rows, folds, trial.hidden, options, seed, trial.decay, strength)
        few = thin(rows.y.size, _few_rows(rows, trial.hidden))
        x, y = rows.x[few], rows.y[few]
        found = search(
            x, y, trial.hidden, np.random.default_rng([seed, 3]), activation=options.activation,
            decay=trial.decay, chords=rows.chords(x, strength), starts=4, finalists=2,
            rows=few.size, iterations=25,
        )  # fmt: skip
        both = _clipped_rms(y - found.best.network(x)), _clipped_rms(between)
        table.append({"strength": strength, "recorded_rms": both[0], "held_out_rms": both[1]})
        scores.append(float(np.hypot(*both)))
    kept = _usual_or_better(scores) if scores else 0
    if kept == 0:
        return trial, table
    strength = table[kept]["strength"]
    again = _try(rows, trial.names, trial.hidden, options, seed, (trial.decay,), strength)
    return again, table


def _sweep(
    rows: _Rows, names: tuple[str, ...], options: _Options, request: Request
) -> list[_Trial]:
    """More and more hidden units until validation gains nothing twice in a row."""
    out: list[_Trial] = []
    for units in _SWEEP:
        request.progress(f"validating {units} hidden units")
        out.append(_try(rows, names, (units,), options, request.seed, _DECAYS[:1]))
        scores = [_clipped_rms(t.error) for t in out]
        if len(out) > 4 and min(scores[-2:]) > (1.0 - _WORTH) * min(scores[:-2]):
            break
    return out


def _smallest_sufficient(trials: Sequence[_Trial]) -> _Trial:
    """The cheapest of those that validate nearly as well as the best."""
    scores = [_clipped_rms(t.error) for t in trials]
    return next(t for t, s in zip(trials, scores) if s <= (1.0 + _WORTH) * min(scores))


@dataclass(frozen=True)
class _Fit:
    """A trained network in standardised coordinates, and how it came about."""

    data: _Data
    scaling: _Scaling
    network: Network
    trial: _Trial
    split: _Split
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
                _fill_start(x[part, self.data.names.index("direction")])
        return np.asarray(s.base + s.span * self.network(s.inputs(x)))


def _find_spikes(data: _Data, output: FloatArray, residual: FloatArray) -> BoolArray:
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
        off = np.abs(r - _running_median(r, 3))
        floor = 1e-6 * float(np.abs(output[part]).max())
        limit = max(10.0 * 1.4826 * float(np.median(off)), floor)
        jump = np.abs(output[part] - _running_median(output[part], 3))
        far = 3.0 * 1.4826 * float(np.median(np.abs(r)))
        alone[part] = (np.minimum(off, jump) > limit) & (off > far)
    return alone & data.settled  # just after a reversal a lone sample is the seal's creep


def _choose_candidate(found: Search, scaling: _Scaling, data: _Data, source: str) -> Network:
    """The best network; of nearly equal ones a monotone one."""
    most = 1.05 * found.best.cost
    for candidate in found.candidates:
        net = candidate.network
        if candidate.cost > most or net.activation != "relu" or len(net.weights) > 2:
            break
        if net.hidden[0] > _ENUMERATED:
            break
        if certify(net, scaling, data).monotone(source):
            return net
    return found.best.network


def _train(data: _Data, rows: _Rows, trial: _Trial, options: _Options, request: Request) -> _Fit:
    """Train the final network on all used rows, spikes left out."""
    request.progress(f"training {len(data.names)}-{'-'.join(map(str, trial.hidden))}-1")
    scaling = _Scaling.of(data)
    rng = np.random.default_rng([request.seed, 7])
    chords = rows.chords(rows.x, trial.straightness)
    found = search(
        rows.x, rows.y, trial.hidden, rng, activation=options.activation, decay=trial.decay,
        chords=chords, starts=options.starts,
        rows=max(3000, 30 * sum(trial.hidden) * (rows.x.shape[1] + 1)),
    )  # fmt: skip
    net = _choose_candidate(found, scaling, data, _driver(options))
    z, t = scaling.inputs(data.x), scaling.output(data.y)
    measured = np.isfinite(t)
    rest = np.where(measured, t - net(z), 0.0)
    spikes = _find_spikes(data, np.where(measured, t, 0.0), rest) & data.used
    kept = data.used & ~spikes
    last = train_from(
        net, z[kept], t[kept], decay=trial.decay, limit=found.limit, chords=chords, iterations=10,
        tolerance=1e-5,
    )  # fmt: skip
    return _Fit(
        replace(data, used=kept), scaling, last.network, trial, rows.split, found,
        int(spikes.sum()), last.iterations,
    )  # fmt: skip


def _driver(options: _Options) -> str:
    """The input that the output has to rise with."""
    return "force" if options.target == "command" else "command"


# --------------------------------------------------------------------------- certificates


@dataclass(frozen=True)
class Certificate:
    """Range of the slopes of a network inside the data's box, per input [SI].

    ``exact`` says whether the regions were enumerated (``regions`` of them); otherwise the
    bounds are safe and wider than the truth. ``worst`` is a point of the smallest slope of
    each input.
    """

    names: tuple[str, ...]
    low: FloatArray
    high: FloatArray
    worst: FloatArray
    exact: bool
    regions: int

    def monotone(self, name: str) -> bool:
        """Whether the output rises with an input everywhere in the box."""
        return name not in self.names or bool(self.low[self.names.index(name)] >= 0.0)

    @property
    def lipschitz(self) -> FloatArray:
        """Largest size of the slope by each input."""
        return np.asarray(np.maximum(np.abs(self.low), np.abs(self.high)))


def certify(net: Network, scaling: _Scaling, data: _Data) -> Certificate:
    """Bound the slopes of a network for each motion state inside the data's box."""
    x = data.x[data.used]
    low, high = scaling.inputs(x.min(axis=0)), scaling.inputs(x.max(axis=0))
    boxes = [(low, high)]
    if "direction" in data.names:
        k = data.names.index("direction")
        boxes = []
        for state in np.unique(x[:, k]):
            corners = low.copy(), high.copy()
            corners[0][k] = corners[1][k] = state
            boxes.append(corners)
    factor = scaling.span / scaling.scale
    exact = net.activation == "relu" and len(net.weights) == 2 and net.hidden[0] <= _ENUMERATED
    if exact:
        regions = [r for a, b in boxes for r in activation_regions(net, a, b)]
        slopes = np.array([r.gradient for r in regions]) * factor
        points = np.array([r.inside for r in regions]) * scaling.scale + scaling.offset
        worst = points[slopes.argmin(axis=0)]
        return Certificate(
            data.names, slopes.min(axis=0), slopes.max(axis=0), worst, True, len(regions)
        )
    bounds = [gradient_interval(net, a, b) for a, b in boxes]
    smallest = np.min([b[0] for b in bounds], axis=0) * factor
    largest = np.max([b[1] for b in bounds], axis=0) * factor
    nowhere = np.full((len(data.names), len(data.names)), np.nan)
    return Certificate(data.names, smallest, largest, nowhere, False, 0)


def _certificate_details(c: Certificate, data: _Data, source: str) -> dict[str, Any]:
    """The certificate for the file."""
    out: dict[str, Any] = {
        "method": f"{c.regions} activation regions enumerated" if c.exact else "interval bound",
        "exact": c.exact,
        "inside": {
            n: [float(v) for v in (data.x[data.used, k].min(), data.x[data.used, k].max())]
            for k, n in enumerate(data.names)
        },
        "slopes": {
            n: [float(c.low[k]), float(c.high[k])]
            for k, n in enumerate(c.names)
            if n != "direction"
        },
        "lipschitz": {n: float(c.lipschitz[k]) for k, n in enumerate(c.names) if n != "direction"},
    }
    if source in c.names:
        k = c.names.index(source)
        out["rises_with"] = {"input": source, "certified": c.monotone(source)}
        if not c.monotone(source) and c.exact:
            where = {n: float(v) for n, v in zip(c.names, c.worst[k])}
            out["rises_with"]["violated_at"] = where
    return out


def _certificate_notice(c: Certificate, data: _Data, source: str, target: str) -> list[Notice]:
    if c.monotone(source) or not c.exact:
        return []
    k = c.names.index(source)
    where = ", ".join(
        f"{n} {v:.4g} {u}".rstrip(" 1") if u == "1" else f"{n} {v:.4g} {u}"
        for n, v, u in zip(c.names, c.worst[k], data.units)
    )
    return [
        Notice(
            "not-monotone",
            f"inside the data's range the {target} falls with rising {source} somewhere, by "
            f"{-c.low[k]:.3g} per unit of the {source}: at {where}. A loop closed over it would "
            "have the wrong sign there. Give other --hidden units or another --seed, or record "
            "more data around it.",
        )
    ]


# ------------------------------------------------------------------------------- results


def _scores(data: _Data, error: FloatArray) -> dict[str, Any]:
    """Errors over all used samples, by branch, and well within the branches [SI]."""
    out: dict[str, Any] = {"rmse": _rms(error[data.used])}
    for name, sign in (("loading", 1.0), ("unloading", -1.0)):
        branch = data.used & (data.direction == sign)
        if branch.any():
            inside = branch & data.settled
            out[name] = {"samples": int(branch.sum()), "rmse": _rms(error[branch])}
            if inside.any():
                out[name]["in_branch_rmse"] = _rms(error[inside])
    return out


def _polynomial(fit: _Fit, rows: _Rows) -> dict[str, Any]:
    """A cubic polynomial of the same inputs: in sample, by branch, and on the same folds."""
    data, s = fit.data, fit.scaling
    z, t = s.inputs(data.x), s.output(data.y)
    error = s.span * (t - polynomial_fit(z[data.used], t[data.used])(z))
    held = np.full(rows.y.size, np.nan)
    for fold in fit.split.folds:
        rest = np.flatnonzero(~fold)
        rest = rest[thin(rest.size, 20_000)]
        held[fold] = rows.y[fold] - polynomial_fit(rows.x[rest], rows.y[rest])(rows.x[fold])
    return {
        "terms": len(polynomial_terms(data.x.shape[1], 3)),
        **_scores(data, error),
        "validation_rms": s.span * _rms(held),
    }


def _parameters(fit: _Fit) -> dict[str, Quantity]:
    """Layers and scalings as they stand in the file."""
    out: dict[str, Quantity] = {}
    for k, (w, b) in enumerate(zip(fit.network.weights, fit.network.biases), start=1):
        out[f"weights_{k}"] = Quantity(w.tolist(), "1")
        out[f"biases_{k}"] = Quantity(b.tolist(), "1")
    s, x = fit.scaling, fit.data.x[fit.data.used]
    for name, value in (
        ("input_offset", s.offset), ("input_scale", s.scale),
        ("input_low", x.min(axis=0)), ("input_high", x.max(axis=0)),
    ):  # fmt: skip
        out[name] = Quantity(value.tolist(), "1", "derived")
    out["output_offset"] = Quantity(s.base, "1", "derived")
    out["output_scale"] = Quantity(s.span, "1", "derived")
    return out


def _details(fit: _Fit, rows: _Rows, options: _Options, certificate: Certificate) -> dict[str, Any]:
    data, span = fit.data, fit.scaling.span
    error = data.y - fit.predicted
    held = np.full(data.y.size, np.nan)
    held[_originally_used(fit)] = span * fit.trial.error
    judged = replace(data, used=np.isfinite(held))
    used = data.used
    return {
        "method": "multi-start Levenberg-Marquardt, Huber cost",
        "target": options.target,
        "inputs": list(data.names),
        "input_units": list(data.units),
        "hidden": list(fit.network.hidden),
        "activation": fit.network.activation,
        "network_parameters": fit.network.parameters,
        "multiplications": fit.network.multiplications,
        "training": {
            "starts": fit.found.tried,
            "weight_decay": fit.trial.decay,
            "huber_limit": fit.found.limit * span,
            "iterations": fit.iterations,
        },
        "spikes": fit.spikes,
        "correlation": float(np.corrcoef(data.y[used], fit.predicted[used])[0, 1]),
        "branches": _scores(data, error),
        "validation": {
            "split_by": fit.split.by,
            "groups_held_out": fit.split.groups,
            "folds": len(fit.split.folds),
            **_scores(judged, held),
        },
        "cubic_polynomial": _polynomial(fit, rows),
        "certificate": _certificate_details(certificate, data, _driver(options)),
        **fit.tables,
    }


def _originally_used(fit: _Fit) -> npt.NDArray[np.intp]:
    return np.asarray(fit.tables["_rows"], dtype=np.intp)


# ------------------------------------------------------------------ what a controller runs


class ForceMapBlock(Block):
    """A force map that a controller calls with its inputs by name, in SI.

    ``block(force=30.0, position=0.012, direction=1)`` gives the command; arrays go
    through at once. A network with a motion state takes it as ``direction`` (1 loading,
    -1 unloading); for an array it is otherwise taken from the held sign of the change
    of the force or command given.
    """

    family = "force-map"

    def __init__(
        self, parameters: Mapping[str, Value], inputs: Sequence[str], target: str,
        activation: str = "relu",
    ) -> None:  # fmt: skip
        self.parameters = dict(parameters)
        self.inputs = tuple(inputs)
        self.target = target
        self.activation = activation
        size = len(self.inputs)
        self._low = np.asarray(parameters.get("input_low", [-np.inf] * size), dtype=float)
        self._high = np.asarray(parameters.get("input_high", [np.inf] * size), dtype=float)

    def __call__(self, **values: npt.ArrayLike) -> float | FloatArray:
        """Command or force for the inputs by name [SI]; scalars or arrays of one shape."""
        x, shape = self._table(values)
        y = force_map(self.parameters, x, self.activation)
        if "direction" in self.inputs:  # a state that is not known lies between the branches
            k = self.inputs.index("direction")
            rest = x[:, k] == 0.0
            if rest.any():
                ends = [np.where(np.arange(x.shape[1]) == k, s, x[rest]) for s in (1.0, -1.0)]
                y[rest] = np.mean([force_map(self.parameters, e, self.activation) for e in ends], 0)
        return float(y[0]) if not shape else y.reshape(shape)

    def outside(self, **values: npt.ArrayLike) -> Any:
        """Whether inputs lie outside the range of the data, where the map extrapolates."""
        x, shape = self._table(values)
        slack = 1e-9 * (self._high - self._low)
        out = ~((x >= self._low - slack) & (x <= self._high + slack)).all(axis=1)
        return bool(out[0]) if not shape else out.reshape(shape)

    @property
    def validity(self) -> dict[str, tuple[float, float]]:
        """Range of each input that the data covered [SI]."""
        return {n: (float(a), float(b)) for n, a, b in zip(self.inputs, self._low, self._high)}

    def _table(self, values: Mapping[str, npt.ArrayLike]) -> tuple[FloatArray, tuple[int, ...]]:
        given = {k: np.asarray(v, dtype=float) for k, v in values.items()}
        source = "force" if self.target == "command" else "command"
        if "direction" in self.inputs and "direction" not in given:
            v = given.get(source)
            if v is None or v.ndim != 1:
                raise UsageError(
                    "the motion state is missing",
                    remedy="Give direction=1 while loading and direction=-1 while unloading.",
                )
            given["direction"] = held_direction(v, choose_dead_band(v)).astype(float)
        unknown, missing = set(given) - set(self.inputs), set(self.inputs) - set(given)
        if unknown or missing:
            wrong = ", ".join(sorted(unknown | missing))
            raise UsageError(
                f"{'unknown' if unknown else 'missing'} input: {wrong}",
                expected="This map takes " + ", ".join(self.inputs) + ".",
            )
        columns = np.broadcast_arrays(*(given[n] for n in self.inputs))
        shape = columns[0].shape
        return np.column_stack([np.ravel(c) for c in columns]), shape


# ----------------------------------------------------------------------------- the family

_ROLES = (
    Role("time", "s", "time of each sample", required=False),
    Role("command", "V", "valve command or pressure", alternatives=("Pa", "A", "1"), hold="zoh"),
    Role("position", "m", "position of the piston, or contraction as a ratio",
         alternatives=("1",), hold="zoh"),
    Role("force", "N", "force of the actuator", hold="zoh"),
    Role("velocity", "m/s", "velocity; computed from position where needed and not given",
         required=False, alternatives=("1/s",), hold="zoh"),
    Role("direction", "1", "motion state: 1 loading, -1 (or 2) unloading; held sign of the "
         "command's change where not given", required=False, hold="zoh"),
    Role("length", "m", "another input, such as the length of a muscle", required=False,
         hold="zoh"),
)  # fmt: skip


def _spec(name: str, rank: int, text: str, optional: bool = False) -> ParameterSpec:
    scaling = name.startswith(("input", "output"))
    minimum = 1e-300 if name.endswith("scale") else -np.inf
    return ParameterSpec(
        name, "1", text, rank=rank, optional=optional, minimum=minimum,  # type: ignore[arg-type]
        remedy="Record command, position and force over their whole ranges.",
        any_unit=scaling,
    )  # fmt: skip


_PARAMETERS = (
    _spec("weights_1", 2, "weights of the first layer: one row per unit, one column per input"),
    _spec("biases_1", 1, "biases of the first layer"),
    _spec("weights_2", 2, "weights of the second layer (the output with one hidden layer)"),
    _spec("biases_2", 1, "biases of the second layer"),
    _spec("weights_3", 2, "weights of the output with two hidden layers", True),
    _spec("biases_3", 1, "bias of the output with two hidden layers", True),
    _spec("input_offset", 1, "taken off each input, in its SI unit"),
    _spec("input_scale", 1, "each input is divided by, in its SI unit"),
    _spec("output_offset", 0, "added to the scaled output, in the SI unit of the target"),
    _spec("output_scale", 0, "the output is multiplied by, in the SI unit of the target"),
    _spec("input_low", 1, "lowest value of each input in the data, in its SI unit", True),
    _spec("input_high", 1, "highest value of each input in the data, in its SI unit", True),
)


def _variant(target: str) -> Variant:
    roles = tuple(replace(r, output=r.name == target) for r in _ROLES)
    return Variant(target, roles, _PARAMETERS)


class ForceMap(Family):
    """Small networks for the force of a cylinder with hysteresis, either way round."""

    name = "force-map"
    title = "Force map: small networks of command and force with hysteresis"
    equation = (
        "target = output_offset + output_scale * (weights_2 relu(weights_1 "
        "(inputs - input_offset) / input_scale + biases_1) + biases_2)"
    )
    variants = tuple(_variant(t) for t in _TARGETS)
    options = (
        Option("target", "choice", "what the network predicts: the command for a wanted force, "
               "or the force", default="command", choices=_TARGETS),
        Option("inputs", "text", "inputs in order, as force,position,direction; compare tries the "
               "four input layers of the paper (default: the paper's best)"),
        Option("hidden", "text", "hidden units, as 5 or 16,16; auto adds units while validation "
               "gains (default: 5 for the command, 7 for the force)"),
        Option("activation", "choice", "of the hidden units", default="relu",
               choices=("relu", "tanh")),
        Option("dead-band", "float", "change of the command that reverses the motion state, in "
               "its SI unit (default: from its noise)", minimum=0.0),
        Option("starts", "int", "searches from different starts", default=16, minimum=1),
    )  # fmt: skip

    def variants_for(self, options: Mapping[str, Any]) -> tuple[Variant, ...]:
        """The variant whose output is the target that the options name."""
        target = options.get("target") or "command"
        return tuple(v for v in self.variants if v.name == target)

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request
    ) -> Estimate:
        """Train the network; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        if request.fixed or request.start or request.bounds:
            raise UsageError(
                "the weights of a network cannot be fixed, started or bounded one by one",
                remedy="Leave out --fix, --start and --bounds; --hidden and --seed choose.",
            )
        options = _Options.read(request.options)
        fit, rows = _fit(experiments, options, request)
        data = fit.data
        certificate = certify(fit.network, fit.scaling, data)
        notices = [
            *_data_notices(data),
            *_certificate_notice(certificate, data, _driver(options), options.target),
            *_spike_notice(fit),
        ]
        details = _details(fit, rows, options, certificate)
        del details["_rows"]
        measured = np.where(data.used, data.y, np.nan)
        return Estimate(
            _parameters(fit), {}, (), np.zeros((0, 0)), data.split(fit.predicted),
            data.split(measured), notices, details,
            options=_chosen(data.names, fit.network, options),
        )  # fmt: skip

    def simulate(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> FloatArray:
        """Command or force from the inputs; see :meth:`Family.simulate`."""
        chosen = _Options.read(options)
        names = chosen.inputs or _default_inputs(chosen, [experiment])
        x = _inputs(experiment, names, chosen)
        if "direction" in names:
            _fill_start(x[:, names.index("direction")])
        return force_map(parameters, x, chosen.activation)

    def model_section(
        self, variant: Variant, parameters: Mapping[str, Value], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """The size of the network; weights and scalings are the parameters."""
        net = network_of(parameters)
        return {
            "network": {
                "layers": [net.inputs, *net.hidden, 1],
                "parameters": net.parameters,
                "multiplications": net.multiplications,
            }
        }

    def static_view(
        self,
        variant: Variant,
        estimate: Estimate,
        experiments: Sequence[Experiment],
        options: Mapping[str, Any],
    ) -> StaticView:
        """Output over command or force, with the branches at the outermost positions."""
        chosen = _Options.read(options)
        names = chosen.inputs or _default_inputs(chosen, experiments)
        source = _driver(chosen) if _driver(chosen) in names else names[0]
        x = np.vstack([_inputs(e, names, chosen) for e in experiments])
        raw = np.concatenate([_column(e, chosen.target, _size(e)) for e in experiments])
        used = np.isfinite(np.concatenate(list(estimate.measured)))
        values = {n: q.value for n, q in estimate.parameters.items()}
        unit = experiments[0].signals[source].unit if source in experiments[0] else "m/s"
        return StaticView(
            source, unit, chosen.target, experiments[0].signals[chosen.target].unit,
            x[:, names.index(source)], raw, np.concatenate(list(estimate.simulated)), used,
            _branches(values, x[used], names, names.index(source), chosen.activation),
        )  # fmt: skip

    def block(self, variant: Variant, document: Mapping[str, Any]) -> ForceMapBlock:
        """The map that a controller calls with its inputs by name."""
        chosen = _Options.read(document.get("options") or {})
        values = {n: p["value"] for n, p in document["parameters"].items()}
        names = chosen.inputs or _layers(chosen.target)[2 if chosen.target == "command" else 3]
        return ForceMapBlock(values, names, chosen.target, chosen.activation)


def _fit(
    experiments: Sequence[Experiment], options: _Options, request: Request
) -> tuple[_Fit, _Rows]:
    """Choose inputs and hidden units where asked to, then train."""
    tables: dict[str, Any] = {}
    names = options.inputs or _default_inputs(options, experiments)
    units = options.hidden or (_PAPER_UNITS[options.target],)
    if options.compare:
        layers = [n for n in _layers(options.target)
                  if "velocity" not in n or _has_velocity(experiments)]  # fmt: skip
        trials = []
        for layer in layers:
            request.progress("validating inputs " + ", ".join(layer))
            data, rows = _prepare(experiments, layer, options, request.seed)
            trials.append((_try(rows, layer, units, options, request.seed), data))
        tables["input_layers"] = [t.row(_Scaling.of(d).span) for t, d in trials]
        names = _smallest_sufficient([t for t, _ in trials]).names
    data, rows = _prepare(experiments, names, options, request.seed)
    if not options.hidden:
        swept = _sweep(rows, names, options, request)
        span = _Scaling.of(data).span
        table = [t.row(span) for t in swept]
        tables["hidden_units"] = table
        tables["accuracy_over_cost"] = {
            k: [row[k] for row in table] for k in ("validation_rms", "multiplications")
        }
        units = _smallest_sufficient(swept).hidden
    # judging rivals for a network of two layers would cost ten times its training
    rivals = len(units) == 1
    trial = _try(rows, names, units, options, request.seed, _DECAYS if rivals else _DECAYS[:1])
    straightness: list[dict[str, float]] = []
    if rivals:
        trial, straightness = _straighten(rows, trial, options, request.seed)
    if rows.length is not None:
        span = _Scaling.of(data).span
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
    experiments: Sequence[Experiment], names: tuple[str, ...], options: _Options, seed: int
) -> tuple[_Data, _Rows]:
    data = _gather(experiments, names, options)
    _check_data(data, options)
    s = _Scaling.of(data)
    split = _split(data, seed)
    x, y = s.inputs(data.x[data.used]), s.output(data.y[data.used])
    return data, _Rows(x, y, split, _length_column(data))


def _chosen(names: tuple[str, ...], network: Network, options: _Options) -> dict[str, Any]:
    """What was chosen, for the file: weights mean nothing without the order of the inputs."""
    return {
        "target": options.target,
        "inputs": ",".join(names),
        "hidden": ",".join(str(n) for n in network.hidden),
        "activation": network.activation,
    }


def _spike_notice(fit: _Fit) -> list[Notice]:
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


def _branches(
    values: Mapping[str, Value], x: FloatArray, names: Sequence[str], source: int, activation: str
) -> list[Curve]:
    """Both branches at the lowest and the highest position, all other inputs at their means."""
    along = np.linspace(x[:, source].min(), x[:, source].max(), 200)
    out = []
    ends: list[tuple[str, float | None]] = [("", None)]
    if "position" in names:
        p = x[:, names.index("position")]
        ends = [("low position", float(p.min())), ("high position", float(p.max()))]
    states: list[tuple[str, float | None]] = (
        [("loading", 1.0), ("unloading", -1.0)] if "direction" in names else [("", None)]
    )
    for place, position in ends:
        for branch, state in states:
            table = np.tile(x.mean(axis=0), (along.size, 1))
            table[:, source] = along
            if position is not None:
                table[:, list(names).index("position")] = position
            if state is not None:
                table[:, list(names).index("direction")] = state
            label = ", ".join(w for w in (branch, place) if w) or "network"
            out.append(Curve(label, along, force_map(values, table, activation)))
    return out
