"""Angles that begin again after a full turn, and counters of encoders that overflow.

They are continued where that is certain: all readings lie within one turn, and a step of nearly all
of it, less a turn, is as the steps beside it are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import LogError, Notice
from ..experiment import FloatArray, IndexArray, at_rows
from ..rows import blocks
from ..units import after_number
from .columns import Binding
from .grid import Run
from .log import Log, count_of, name_lines

_SLOW = 0.25  # turns from one sample to the next, beyond which the direction is not certain
_REGISTERS = range(8, 33)  # bits
_NEARLY = 0.9  # of the range
_RARE = 0.05  # of the steps
_WITHIN = 3  # samples over which a filter spreads a jump


@dataclass(frozen=True)
class Turn:
    """What a column counts to before it begins again, and the rows in which it does."""

    size: float
    rows: IndexArray


def settle_turns(
    log: Log, bindings: Mapping[str, Binding], runs: Sequence[Run]
) -> tuple[dict[str, float], list[Notice]]:
    """Return after what the columns of angles and positions begin again, as written; and notices.

    As the user or the file says, else as the column shows. 0 where it is not to be continued.

    Raises
    ------
    LogError
        When an angle seems to begin again, but not certainly, or not after a full turn.
    """
    turns, notices = {}, []
    for role, binding in bindings.items():
        rotary = binding.role.unit == "rad"
        if not rotary and binding.role.unit != "m":
            continue
        given = log.turns.get(role)
        parts = list(_parts(binding, runs))
        found = _as_given(parts, given) if given is not None else _found(log, binding, parts)
        if given is not None or found is not None:
            turns[role] = found.size if found is not None else 0.0
        if found is not None and found.rows.size:
            notices.append(_notice(log, binding, found))
    return turns, notices


def continued(values: FloatArray, turn: float) -> FloatArray:
    """Readings of shape ``(n,)`` from the first on without what a turn takes back."""
    if not turn or values.size < 2:
        return values
    turned = np.cumsum(np.round(np.diff(values) / turn))
    return values if not turned.any() else values - turn * np.concatenate(([0.0], turned))


def _parts(binding: Binding, runs: Sequence[Run]) -> Iterator[tuple[IndexArray, FloatArray]]:
    """Rows and readings of every run, without those that hold none."""
    for run in runs:
        values = at_rows(binding.column.values, run.rows)
        finite = np.isfinite(values)
        if finite.all():
            yield run.rows, values
        else:
            yield np.asarray(run.rows)[finite], values[finite]


def _as_given(parts: Sequence[tuple[IndexArray, FloatArray]], size: float) -> Turn | None:
    if not size:
        return None
    rows = [np.asarray(r)[1:][np.abs(np.diff(v)) > size / 2] for r, v in parts]
    return Turn(size, np.concatenate(rows))


def _found(
    log: Log, binding: Binding, parts: Sequence[tuple[IndexArray, FloatArray]]
) -> Turn | None:
    """What a column shows, ``None`` where it does not begin again."""
    span = _span(parts)
    if not span or not any(_jumps(v, span) for _, v in parts):
        return None
    steps = _Steps(parts, span)
    rotary = binding.role.unit == "rad"
    whole = all(bool(np.all(v == np.round(v))) for _, v in parts)
    turn = 2.0 * math.pi / abs(binding.to_si) if rotary else 0.0
    if whole and abs(turn - round(turn)) < 1e-6 * turn:
        turn = float(round(turn))
    sizes = [turn] * rotary + [2.0**bits for bits in _REGISTERS if whole]
    for size in sizes:
        if steps.begin_again_at(size):
            return Turn(size, steps.rows)
    if rotary and (seen := steps.seems_to_begin_again(turn)):
        raise _doubt(log, binding, turn, seen, steps.rows)
    return None


def _span(parts: Sequence[tuple[IndexArray, FloatArray]]) -> float:
    ends = [(float(v.min()), float(v.max())) for _, v in parts if v.size > 1]
    return max(high for _, high in ends) - min(low for low, _ in ends) if ends else 0.0


def _jumps(values: FloatArray, span: float) -> bool:
    """Whether readings go through most of their range within a few samples."""
    for at in blocks(values.size):
        some = values[at.start : at.stop + _WITHIN]
        for apart in (1, _WITHIN):
            if some.size > apart and np.abs(some[apart:] - some[:-apart]).max() > 0.5 * span:
                return True
    return False


class _Steps:
    """Steps of the runs of a column: those over most of its range, and the speed beside them.

    ``span`` is that of all readings.
    """

    def __init__(self, parts: Sequence[tuple[IndexArray, FloatArray]], span: float) -> None:
        self.span = span
        steps, beside, rows, usual, bends = [], [], [], [], []
        self.spread = 0.0  # of what goes back within a few samples
        for at, values in parts:
            d = np.diff(values)
            far = np.abs(d) > 0.5 * span
            speed = np.where(far, np.nan, d)
            near = np.pad(speed, 2, constant_values=np.nan)
            around = np.stack([near[k : k + d.size] for k in (0, 1, 3, 4)])[:, far]
            known = np.isfinite(around)
            count = np.maximum(known.sum(axis=0), 1)
            beside.append(np.where(known, around, 0.0).sum(axis=0) / count)
            steps.append(d[far])
            rows.append(np.asarray(at)[1:][far])
            usual.append(d[~far])
            bend = np.diff(speed)
            bends.append(bend[np.isfinite(bend)])
            if values.size > _WITHIN:
                over = np.abs(values[_WITHIN:] - values[:-_WITHIN])
                self.spread = max(self.spread, float(over.max()))
        self.far, self.beside = np.concatenate(steps), np.concatenate(beside)
        self.rows = np.concatenate(rows)
        self.usual = np.abs(np.concatenate(usual))
        bend = np.abs(np.concatenate(bends))
        self.bend = 3.0 * float(np.quantile(bend, 0.98)) if bend.size else 0.0

    def begin_again_at(self, size: float) -> bool:
        """Whether all steps over most of the range certainly are by a turn of a size."""
        if not self.far.size or not self.usual.size or self.span > size * (1 + 1e-6):
            return False
        left = self.far - np.sign(self.far) * size
        slow = max(float(self.usual.max()), float(np.abs(left).max())) <= _SLOW * size
        aside = np.abs(left - self.beside)
        return slow and bool(aside.max() <= max(self.bend, 0.02 * size))

    def seems_to_begin_again(self, turn: float) -> float:
        """After what the readings begin again as far as can be told; 0 where they do not."""
        if not self.usual.size:
            return 0.0
        back = self.far[1:] * self.far[:-1] < 0.0
        rare = self.far.size <= _RARE * self.usual.size
        if rare and np.any(back & (np.diff(self.rows) <= _WITHIN)):
            return 0.0  # readings that were lost for a moment
        moves = float(np.quantile(self.usual, 0.95))
        whole = _NEARLY * turn <= self.span <= turn * (1 + 1e-6)
        jumps = self.far.size and float(np.abs(self.far).min()) > _NEARLY * self.span - moves
        if jumps and (whole or (self.far.size > 1 and moves < 0.1 * self.span)):
            return float(np.median(np.abs(self.far - self.beside)))
        resampled = whole and moves < 0.05 * self.span and self.spread > 0.75 * self.span
        return self.span if resampled else 0.0


def _column(binding: Binding) -> str:
    return f"{binding.role.name} (column '{binding.column.label}')"


def _written(binding: Binding, size: float) -> str:
    """A number of a column, in its unit where it is not scaled."""
    return f"{size:.10g}{after_number(binding.unit) if binding.scale == 1.0 else ''}"


def _notice(log: Log, binding: Binding, found: Turn) -> Notice:
    return Notice(
        "angle-wraps",
        f"{log.name}: {_column(binding)} begins again after {_written(binding, found.size)} in "
        f"{count_of(found.rows.size, 'place')} ({name_lines(log.lines[found.rows])}) and was "
        f"continued. If it jumps there, give --unwrap {binding.role.name}=none.",
    )


def _doubt(log: Log, binding: Binding, turn: float, seen: float, rows: IndexArray) -> LogError:
    name = binding.role.name
    places = f" ({name_lines(log.lines[rows])})" if rows.size else ""
    seen_text = _written(binding, float(f"{seen:.4g}"))
    return LogError(
        f"{_column(binding)} seems to begin again after about {seen_text}{places}, but "
        f"not certainly after a full turn, which would be {_written(binding, turn)}: the steps "
        "beside are too large or too uneven, or it was filtered or resampled since.",
        where=log.name,
        expected="Expected an angle that goes on, or one that begins again after a turn and is "
        "sampled four times a turn or more.",
        remedy=f"If its unit is another, give --unit {name}=...; if it begins again, --unwrap "
        f"{name}=TURN (in its own numbers), and if it does not, --unwrap {name}=none.",
    )
