"""Held-out positions, logs and lengths, and what is chosen by them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from ...estimation.network import (
    Activation,
    Chords,
    Training,
    cross_validate,
    robust_deviation,
    search,
    thin,
)
from ...estimation.noise import noise_floor
from ...experiment import BoolArray, FloatArray
from .data import Data, Scaling

_SWEEP = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 16, 20)
_WORTH = 0.03  # relative gain of validation below which more is not worth its cost
DECAYS = (1e-5, 1e-6, 3e-5)  # weight decay: the usual one, and rivals
_STRAIGHT = (0.03, 0.0, 1.0)  # strength of the chords along a length, likewise
_STRAIGHT_FEW = 1.0  # with three lengths or two: one odd specimen looks like a curve
_OBJECTION = 0.05  # relative gain of validation from which a rival takes over
_MOST_LENGTHS = 8  # with more of them the data say what is between
_MOST_FOLDS = 4
_LEVEL = 0.01  # smallest part of the samples that is a level of the position
_APART = 1.0  # standard deviations of a level by which the next one lies apart
_MOVES = 20.0  # range of a position that moves, in standard deviations of its noise
_SPIKE = 12.0  # errors beyond this many robust standard deviations do not choose a network


def _split(data: Data, seed: int) -> tuple[list[BoolArray], str, int]:
    """Fold the used rows by position, by log, or by stretches of the record.

    The outermost positions are never held out: beyond them a network extrapolates.
    Returns the rows held out in each fold, what they were split by, and the number of groups.
    """
    position, logs = data.position[data.used], data.log[data.used]
    levels = _levels(position)
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
    order = np.random.default_rng(seed).permutation(inner)
    folds = min(_MOST_FOLDS, order.size)
    return [np.isin(labels, order[k::folds]) for k in range(folds)], by, order.size


def _levels(position: FloatArray) -> npt.NDArray[np.intp]:
    """Number of the position level of each sample: gaps of 3 % of the range divide them.

    A few samples by themselves, as noise makes them, are no level but belong to the one below,
    and so do those whose gap is lost in the scatter of the level on either side.
    """
    order = np.argsort(position, kind="stable")
    gap = np.diff(position[order]) > 0.03 * float(np.ptp(position))
    label = np.concatenate(([0], np.cumsum(gap)))
    own = np.bincount(label) >= max(5, int(_LEVEL * position.size))
    level = np.maximum(np.cumsum(own) - 1, 0)[label]
    ascending = position[order]
    first = np.flatnonzero(np.diff(level)) + 1
    scatter = np.array([part.std() for part in np.split(ascending, first)])
    wide = np.maximum(scatter[:-1], scatter[1:])
    apart = ascending[first] - ascending[first - 1] > _APART * wide
    out = np.empty(position.size, dtype=np.intp)
    out[order] = np.concatenate(([0], np.cumsum(apart)))[level]
    return out


def positions_held_out(data: Data) -> bool:
    """Whether positions between others were recorded, so that some can be held out.

    A position that moves all the time is as good as many; one that only shows its noise is one.
    """
    position = data.position[data.used]
    if int(_levels(position).max()) >= 2:
        return True
    floor = max(noise_floor(position, 1, robust=False), 1e-300)
    return int(_levels(position).max()) == 0 and float(np.ptp(position)) > _MOVES * floor


def rms(error: FloatArray) -> float:
    """Root mean square of what is finite."""
    found = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(found**2))) if found.size else float("nan")


def clipped_rms(error: FloatArray) -> float:
    """Root mean square with spikes cut off."""
    found = error[np.isfinite(error)]
    limit = _SPIKE * robust_deviation(found)
    return float(np.sqrt(np.mean(np.minimum(np.abs(found), limit) ** 2)))


@dataclass(frozen=True)
class Rows:
    """The used rows of the data, standardised, with their split and the settings of a training.

    Rows of the ``groups`` inside are held out together, ``folds`` tells in which turn;
    ``length`` is the column of a length that names the specimens.
    """

    data: Data
    scaling: Scaling
    x: FloatArray
    y: FloatArray
    folds: Sequence[BoolArray]
    split_by: str
    groups: int
    length: int | None
    activation: Activation
    seed: int

    @classmethod
    def of(cls, data: Data, activation: Activation, seed: int) -> Self:
        """Standardise and split the used rows."""
        s = Scaling.of(data)
        x, y = s.inputs(data.x[data.used]), s.output(data.y[data.used])
        return cls(data, s, x, y, *_split(data, seed), _length_column(data), activation, seed)

    def chords(self, x: FloatArray, strength: float) -> Chords | None:
        """Chords along the length, for some of the rows."""
        if self.length is None or strength == 0.0:
            return None
        return Chords.along(x, self.length, strength)

    def held_lengths(self) -> list[BoolArray]:
        """Rows of each length but the shortest and the longest."""
        if self.length is None:
            return []
        values = self.x[:, self.length]
        return [np.asarray(values == v) for v in np.unique(values)[1:-1]]

    def brief(self, hidden: tuple[int, ...], decay: float) -> Training:
        """A short search, for validation."""
        few = max(1200, 12 * sum(hidden) * (self.x.shape[1] + 1))
        return Training(hidden, self.activation, decay, 4, few, iterations=25, finalists=2)

    def held_out(
        self, folds: Sequence[BoolArray], hidden: tuple[int, ...], decay: float, strength: float
    ) -> FloatArray:
        """Errors on rows that were not trained; see :func:`cross_validate`."""
        return cross_validate(
            self.x, self.y, folds, self.brief(hidden, decay), self.seed,
            lambda x: self.chords(x, strength),
        )  # fmt: skip


def _length_column(data: Data) -> int | None:
    """Column of a length that names the specimens; ``None`` where there is none."""
    if "length" not in data.names:
        return None
    k = data.names.index("length")
    fixed = all(np.ptp(part) == 0.0 for part in np.split(data.x[:, k], data.cuts))
    return k if fixed and 2 <= np.unique(data.x[:, k]).size <= _MOST_LENGTHS else None


@dataclass(frozen=True)
class Trial:
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
            "validation_rms": rms(self.error) * span,
            "parameters": weights + sum(sizes[1:]),
            "multiplications": weights,
        }


def try_layer(
    rows: Rows,
    hidden: tuple[int, ...],
    decays: Sequence[float] = DECAYS,
    strength: float | None = None,
) -> Trial:
    """Cross-validate a layer with the usual weight decay, or one that is clearly better."""
    if strength is None:
        strength = _STRAIGHT[0] if len(rows.held_lengths()) > 1 else _STRAIGHT_FEW
    errors = [rows.held_out(rows.folds, hidden, decay, strength) for decay in decays]
    best = _usual_or_better([clipped_rms(e) for e in errors])
    return Trial(rows.data.names, hidden, decays[best], errors[best], strength)


def _usual_or_better(scores: Sequence[float]) -> int:
    """Number of the best score if it beats the first by enough to be no accident, or 0."""
    best = int(np.argmin(scores))
    return best if scores[best] < (1.0 - _OBJECTION) * scores[0] else 0


def straighten(rows: Rows, trial: Trial) -> tuple[Trial, list[dict[str, float]]]:
    """Judge how nearly straight the output has to be along the length.

    Two questions weigh the same: another log of the same specimens, answered by the error of
    the fit (rows abound), and another specimen, answered by whole lengths held out. The usual
    strength stands unless a rival is clearly better. Of three lengths only one can be held
    out, and between the two that are left nothing is curved: there is nothing to judge.

    Returns the trial with the strength that is kept, and a table of strengths with both errors
    [unit of the output].
    """
    folds, span, table, scores = rows.held_lengths(), rows.scaling.span, [], []
    if len(folds) < 2:
        return trial, []
    brief = rows.brief(trial.hidden, trial.decay)
    few = thin(rows.y.size, brief.rows)
    x, y = rows.x[few], rows.y[few]
    for strength in _STRAIGHT:
        between = rows.held_out(folds, trial.hidden, trial.decay, strength)
        rng = np.random.default_rng([rows.seed, 3])
        found = search(x, y, brief, rng, rows.chords(x, strength))
        here, there = clipped_rms(y - found.best.network(x)), clipped_rms(between)
        table.append(
            {"strength": strength, "recorded_rms": span * here, "held_out_rms": span * there}
        )
        scores.append(float(np.hypot(here, there)))
    kept = _usual_or_better(scores)
    if kept == 0:
        return trial, table
    return try_layer(rows, trial.hidden, (trial.decay,), _STRAIGHT[kept]), table


def sweep(rows: Rows, progress: Callable[[str], None]) -> list[Trial]:
    """More and more hidden units until validation gains nothing twice in a row."""
    out: list[Trial] = []
    for units in _SWEEP:
        progress(f"validating {units} hidden units")
        out.append(try_layer(rows, (units,), DECAYS[:1]))
        scores = [clipped_rms(t.error) for t in out]
        if len(out) > 4 and min(scores[-2:]) > (1.0 - _WORTH) * min(scores[:-2]):
            break
    return out


def smallest_sufficient(trials: Sequence[Trial]) -> Trial:
    """The cheapest of those that validate nearly as well as the best."""
    scores = [clipped_rms(t.error) for t in trials]
    return next(t for t, s in zip(trials, scores) if s <= (1.0 + _WORTH) * min(scores))
