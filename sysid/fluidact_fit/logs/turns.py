"""Angles that begin again after a full turn, and counters of encoders that overflow.

They are continued where that is certain: all readings lie within one turn, the first step is short,
and less the turns in them the steps change little from one to the next.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import LogError, Notice
from ..experiment import FloatArray, IndexArray, at_rows, is_finite
from ..units import after_number
from .columns import Binding
from .grid import Run
from .log import Log, count_of, name_lines

_REGISTERS = range(8, 33)  # bits
_SLOW = 0.25  # turns of the first step, beyond which its direction is not certain
_SMOOTH = 0.2  # turns by which a step may differ from the one before
_FEW = 10
_HEAD = 1000
_NEARLY = 0.9  # of the range
_LEAST = 1e-4  # of a turn: what moves less begins nothing again
_RARE = 0.05  # of the steps
_WITHIN = 3  # samples over which a filter spreads a jump


@dataclass(frozen=True)
class Turn:
    """Value at which a column wraps, and the rows in which it does."""

    size: float
    rows: IndexArray


@dataclass(frozen=True)
class Turned:
    """Columns of angles and positions that go on where they were begun again.

    Attributes
    ----------
    bindings
        All of them, by role.
    turns
        After what the columns begin again, as written, by role; 0 for never, where that was said.
    notices
        What was found.
    """

    bindings: dict[str, Binding]
    turns: dict[str, float]
    notices: list[Notice]


def settle_turns(log: Log, bindings: Mapping[str, Binding], runs: Sequence[Run]) -> Turned:
    """Let columns of angles and positions go on, as the user or the file says, else as they show.

    Raises
    ------
    LogError
        When an angle seems to begin again, but not certainly, or not after a full turn.
    """
    out = Turned(dict(bindings), {}, [])
    for role, binding in bindings.items():
        if binding.role.unit not in ("rad", "m"):
            continue
        given = log.turns.get(role)
        if given is None and binding.role.unit == "m" and not _are_whole(binding.column.values):
            continue  # no counter
        parts = list(_parts(binding, runs))
        in_time = any(run.time.size for run in runs)
        found = (
            _as_given(parts, given) if given is not None else _found(log, binding, parts, in_time)
        )
        if given is not None or found is not None:
            out.turns[role] = found.size if found is not None else 0.0
        if found is not None and found.rows.size:
            values = binding.column.values.copy()
            for rows, readings in parts:
                values[rows] = continued(readings, found.size)
            out.bindings[role] = replace(binding, column=replace(binding.column, values=values))
            out.notices.append(_notice(log, binding, found))
    return out


def continued(values: FloatArray, turn: float) -> FloatArray:
    """Readings of shape ``(n,)`` from the first on without what a turn takes back."""
    if not turn or values.size < 2:
        return values
    steps = np.diff(values)
    turns = np.round((steps - _followed(steps, turn)) / turn)
    if not turns.any():
        return values
    return values - turn * np.concatenate(([0.0], np.cumsum(turns)))


def _followed(steps: FloatArray, turn: float) -> FloatArray:
    """Steps less the turns in them: the shortest ones, or such as go on from the ones before.

    The latter where a fast shaft needs it, and its speed changes little from sample to sample.
    """
    short = steps - turn * np.round(steps / turn)
    change = np.diff(short)
    if np.abs(short).max() + np.abs(change).max(initial=0.0) < 0.5 * turn:
        return short
    change -= turn * np.round(change / turn)
    if np.abs(change).max(initial=0.0) > _SMOOTH * turn:
        return short
    return short[0] + np.concatenate(([0.0], np.cumsum(change)))


def _parts(binding: Binding, runs: Sequence[Run]) -> Iterator[tuple[IndexArray, FloatArray]]:
    """Rows and readings of every run, without those that hold none."""
    for run in runs:
        values = at_rows(binding.column.values, run.rows)
        if is_finite(values):
            yield run.rows, values
        else:
            finite = np.isfinite(values)
            yield np.asarray(run.rows)[finite], values[finite]


def _are_whole(values: FloatArray) -> bool:
    """Return whether the first readings are whole numbers."""
    head = values[:_HEAD]
    head = head[np.isfinite(head)]
    return bool(np.all(head == np.round(head)))


def _as_given(parts: Sequence[tuple[IndexArray, FloatArray]], size: float) -> Turn | None:
    if not size:
        return None
    rows = []
    for at, values in parts:
        back = np.abs(np.diff(values - continued(values, size))) > size / 2
        rows.append(np.asarray(at)[1:][back])
    return Turn(size, np.concatenate(rows))


def _found(
    log: Log, binding: Binding, parts: Sequence[tuple[IndexArray, FloatArray]], in_time: bool
) -> Turn | None:
    """Detect the wrap of a column, ``None`` where there is none.

    Points that are not ``in_time`` may jump: what is not certain is then no turn.
    """
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
            return _as_given(parts, size)
    if rotary and in_time and (seen := steps.seems_to_begin_again(turn)):
        raise _doubt(log, binding, turn, seen, steps.rows)
    return None


def _span(parts: Sequence[tuple[IndexArray, FloatArray]]) -> float:
    ends = [(float(v.min()), float(v.max())) for _, v in parts if v.size > 1]
    return max(high for _, high in ends) - min(low for low, _ in ends) if ends else 0.0


def _jumps(values: FloatArray, span: float) -> bool:
    """Return whether readings go through most of their range within a few samples."""
    return any(
        values.size > apart and np.abs(values[apart:] - values[:-apart]).max() > 0.5 * span
        for apart in (1, _WITHIN)
    )


class _Steps:
    """Steps of the runs of a column, and which of them are over most of its range.

    ``span`` is that of all readings.
    """

    def __init__(self, parts: Sequence[tuple[IndexArray, FloatArray]], span: float) -> None:
        self.span = span
        self.runs = [np.diff(values) for _, values in parts]
        far = [np.abs(d) > 0.5 * span for d in self.runs]
        self.far = np.concatenate([d[x] for d, x in zip(self.runs, far)])
        self.rows = np.concatenate([np.asarray(r)[1:][x] for (r, _), x in zip(parts, far)])
        self.usual = np.abs(np.concatenate([d[~x] for d, x in zip(self.runs, far)]))
        long = (v for _, v in parts if v.size > _WITHIN)
        self.spread = max(
            (float(np.abs(v[_WITHIN:] - v[:-_WITHIN]).max()) for v in long), default=0.0
        )  # of what goes back within a few samples

    def begin_again_at(self, size: float) -> bool:
        """Return whether the readings certainly begin again after a turn of a size.

        Speed then changes little from sample to sample, as little where they begin again as
        elsewhere, and the first step is short.
        """
        if self.span > size * (1 + 1e-6):
            return False
        turned, first, changes, at = 0, 0.0, [], []
        for steps in self.runs:
            if steps.size < 2:
                continue
            left = _followed(steps, size)
            turns = np.round((steps - left) / size) != 0
            turned += int(np.count_nonzero(turns))
            first = max(first, abs(float(left[0])))
            changes.append(np.abs(np.diff(left)))
            at.append(turns[1:] | turns[:-1])
        if not turned:
            return False
        change, here = np.concatenate(changes), np.concatenate(at)
        most = _SMOOTH * size
        if np.count_nonzero(~here) >= _FEW:
            most = min(most, max(3.0 * float(change[~here].max()), 0.02 * size))
        return first <= _SLOW * size and float(change[here].max()) <= most

    def seems_to_begin_again(self, turn: float) -> float:
        """After what the readings begin again as far as can be told; 0 where they do not."""
        if not self.usual.size or self.span < _LEAST * turn:
            return 0.0
        back = self.far[1:] * self.far[:-1] < 0.0
        rare = self.far.size <= _RARE * self.usual.size
        if rare and np.any(back & (np.diff(self.rows) <= _WITHIN)):
            return 0.0  # readings that were lost for a moment
        moves = float(np.quantile(self.usual, 0.95))
        whole = _NEARLY * turn <= self.span <= turn * (1 + 1e-6)
        jumps = self.far.size and float(np.abs(self.far).min()) > _NEARLY * self.span - moves
        if jumps and (whole or (self.far.size > 1 and moves < 0.1 * self.span)):
            return self.span  # a turn, but for what the shaft moves between two samples
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
    seen_text = _written(binding, float(f"{seen:.3g}"))
    return LogError(
        f"{_column(binding)} seems to begin again after about {seen_text}{places}, but "
        f"not certainly after a full turn, which would be {_written(binding, turn)}: the steps "
        "between its samples are too large or too uneven, or it was filtered or resampled since.",
        where=log.name,
        expected="Expected an angle that goes on, or one that begins again after a turn and is "
        "sampled often in every turn.",
        remedy=f"If its unit is another, give --unit {name}=...; if it begins again, --unwrap "
        f"{name}=TURN (in its own numbers), and if it does not, --unwrap {name}=none.",
    )
