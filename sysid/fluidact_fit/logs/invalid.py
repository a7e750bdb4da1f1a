"""Cells of used columns that are missing or no number: refused, or their rows left out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import LogError, Notice
from ..experiment import BoolArray, IndexArray, at_rows, is_finite
from .columns import TIME, Binding
from .grid import Run
from .layout import BLANKS, GROUPED, THOUSANDS
from .log import MIN_RUN, Log, count_of, name_lines
from .stamps import PAIR


def require_numbers(log: Log, binding: Binding, rows: IndexArray) -> None:
    """Refuse cells of a used column that are no finite number; the error names the first."""
    values = at_rows(binding.column.values, rows)
    if not is_finite(values):
        raise _refusal(log, binding, rows, np.asarray(rows)[~np.isfinite(values)])


def usable_rows(log: Log, binding: Binding, rows: IndexArray) -> IndexArray:
    """Rows whose cell is a number: all, unless those of other cells are to be left out.

    Raises
    ------
    LogError
        For other cells that are not to be left out; for more than half; and for numbers that may
        be written in another way, of which those that are left would be a choice by size.
    """
    values = at_rows(binding.column.values, rows)
    if is_finite(values):
        return rows
    finite, every = np.isfinite(values), np.asarray(rows)
    wrong = every[~finite]
    texts = (binding.column.bad.get(int(row)) or "" for row in wrong)
    odd = [row for row, text in zip(wrong, texts) if _way_out(binding.role.name, text)]
    if log.invalid != "drop" or 2 * wrong.size > every.size or binding.column.doubt:
        raise _refusal(log, binding, rows, wrong)
    if odd:
        raise _refusal(log, binding, rows, np.array(odd))
    return every[finite]


@dataclass(frozen=True)
class Kept:
    """A log without the rows in which a used cell is no number.

    Attributes
    ----------
    runs
        Every run without these rows, and whole. The other rows keep their instants.
    bindings
        What drives the machine is ``sparse``: it is known where its own cells are numbers.
    dropped
        Number of rows left out, those without a time included.
    notices
        What was left out, in words.
    """

    runs: list[tuple[Run, Run]]
    bindings: dict[str, Binding]
    dropped: int = 0
    notices: tuple[Notice, ...] = ()


def without_invalid(log: Log, bindings: Mapping[str, Binding], runs: Sequence[Run]) -> Kept:
    """Leave out the rows in which a used cell is no number, if the user wants that."""
    everything = Kept([(run, run) for run in runs], dict(bindings))
    if log.invalid != "drop":
        return everything
    wrong = {
        role: ~np.isfinite(b.column.values)
        for role, b in bindings.items()
        if not b.column.sparse and not is_finite(b.column.values)
    }
    for role in wrong.keys() - {TIME.name}:
        for run in runs:
            usable_rows(log, bindings[role], run.rows)
    bad: BoolArray = np.zeros(log.rows, dtype=np.bool_)
    for at in wrong.values():
        bad |= at
    dropped = np.flatnonzero(bad & _used(bindings, runs, log.rows))
    if not dropped.size:
        return everything
    kept = [~bad[run.rows] for run in runs]
    pairs = [
        (run if at.all() else replace(run.part(at), uniform=False), run)
        for run, at in zip(runs, kept)
        if at.sum() >= MIN_RUN
    ]
    if not pairs:
        raise LogError(
            "no row holds a number in every column that is used.",
            where=log.name,
            remedy="Give --column ROLE=... for other columns, or leave out --invalid.",
        )
    listed = ", ".join(
        f"{np.count_nonzero(at[dropped])} in '{bindings[role].column.label}'"
        for role, at in wrong.items()
    )
    text = (
        f"{log.name}: {count_of(dropped.size, 'row')} with a missing or non-numeric cell left out "
        f"({name_lines(log.lines[dropped])}; {listed}); each is a gap in time."
    )
    known = {
        role: replace(b, column=replace(b.column, sparse=True)) if b.role.hold else b
        for role, b in bindings.items()
    }
    return Kept(pairs, known, int(dropped.size), (Notice("rows-dropped", text),))


def _used(bindings: Mapping[str, Binding], runs: Iterable[Run], rows: int) -> BoolArray:
    """Rows of the runs, and those that are in none because they have no time."""
    used: BoolArray = np.zeros(rows, dtype=np.bool_)
    for run in runs:
        used[run.rows] = True
    time = bindings.get(TIME.name)
    return used if time is None else used | ~np.isfinite(time.column.values)


def _refusal(log: Log, binding: Binding, rows: IndexArray, wrong: IndexArray) -> LogError:
    role, column = binding.role.name, binding.column
    text = column.bad.get(int(wrong[0]))
    if text is None:
        found = "holds something that is not a number."
    elif not text:
        found = "is empty."
    else:
        found = f"holds '{text[:60]}', which is not a{' finite' if _is_nan(text) else ''} number."
    if wrong.size > 1:
        found += f" {wrong.size - 1} more such cells ({name_lines(log.lines[wrong[1:]])})."
    remedy = f"Give --column {role}=... if this is not the {role}, "
    remedy += "or remove the line. Give " if wrong.size == 1 else "or "
    remedy += "--invalid=drop to leave such rows out."
    if 2 * wrong.size > rows.size:
        remedy = f"Give --column {role}=... with a column of numbers."
        if role == TIME.name and text:
            remedy = "Export the time in seconds, or give --sample-time SECONDS."
    remedy = _way_out(role, text or "") or remedy
    if column.doubt:
        found, remedy = column.doubt.split("\n")
        found = f"was not read: {found}"
    return LogError(f"column '{column.label}' {found}", where=log.where(wrong[0]), remedy=remedy)


def _way_out(role: str, text: str) -> str:
    """Suggest what to do with a cell that may be a number in another form; empty for any other."""
    if any(form.match(text) for form in (*GROUPED.values(), THOUSANDS, BLANKS)):
        sign = next(c for c in text if not c.isdigit() and c not in "+-")
        return f"If '{sign}' stands between thousands, give --thousands '{sign}'."
    if role == TIME.name and PAIR.fullmatch(text):
        return (
            "It may be hours and minutes or minutes and seconds: export it with both, as 00:12:30, "
            "or give --sample-time SECONDS."
        )
    return ""


def _is_nan(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
