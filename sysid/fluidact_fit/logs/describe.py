"""Description of a log, for people and for the provenance of a result."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..errors import LogError, Notice
from ..experiment import Experiment
from ..specification import Role
from ..units import conversion_factor, same_dimension, unit_doubt
from .checks import check_placeholders, check_sampling, smallest_step
from .columns import TIME, Binding, bind_role, reference_of, time_candidate
from .grid import untimed_run
from .log import Column, Log
from .selection import select_runs, selected_part
from .timebase import split_runs
from .turns import settle_turns

_PLAIN = ("delimited", "in memory", "merged")  # forms that have no name of their own


def describe(log: Log) -> dict[str, Any]:
    """Return what ``inspect`` shows: dialect, columns, time base and what is wrong.

    Works without a family; problems of the time column are listed, not raised. Columns and time
    are those of the rows that a fit uses (:func:`.selected_part`), which raises as it does.

    Returns
    -------
    dict
        Plain numbers and text with the keys ``file``, ``sha256``, ``rows``, ``lines`` (what every
        one was taken for), ``elements`` (what became of each of a binary recording), ``dialect``,
        ``columns`` (raw units), ``time`` (``None`` without a time column; ``named`` says whether
        a fit takes it without ``--column``) and ``notices``;
        ``rows_used`` where not all rows are.
    """
    part = selected_part(log)
    notices = [*log.notices, *(n for c in part.columns for n in check_placeholders(part, c))]
    time = _describe_time(log, notices)
    notices += _turns(part)
    dialect = log.dialect
    return {
        "file": log.name,
        "sha256": log.sha256,
        "rows": log.rows,
        **({} if part is log else {"rows_used": part.rows}),
        "lines": {
            "total": log.account.total_lines,
            "header": log.account.header_lines,
            "blank": log.account.blank_lines,
            "left_out": [{"line": n, "reason": why} for n, why in log.account.left_out],
        },
        "elements": [vars(element) for element in log.account.elements],
        "dialect": {
            "name": dialect.name,
            "encoding": dialect.encoding,
            "delimiter": dialect.delimiter,
            "decimal": dialect.decimal,
            "preamble_lines": dialect.preamble,
            "header_line": dialect.header_line,
            "units_line": dialect.units_line,
            "first_data_line": dialect.first_data_line,
        },
        "columns": [
            {**_describe_column(column), "reference": reference_of(part, column)}
            for column in part.columns
        ],
        "time": time,
        "notices": [{"code": n.code, "message": n.message} for n in notices],
    }


def provenance(log: Log, experiments: Sequence[Experiment]) -> dict[str, Any]:
    """Return the entry of ``provenance.logs`` for a log and the experiments made of it.

    It holds base name, checksum, rows, sample time [s] and the columns by role.
    """
    entry: dict[str, Any] = {"file": log.name, "sha256": log.sha256, "rows": log.rows}
    steps = [e.sample_time for e in experiments if e.sample_time > 0]
    if steps:
        entry["sample_time"] = float(np.median(steps))
    details: dict[str, Any] = {}
    if log.dialect.name not in _PLAIN:
        details["format"] = log.dialect.name
    if len(experiments) > 1:
        details["runs"] = len(experiments)
    if log.window_text.strip(":"):
        details["window"] = log.window_text
    if log.exclude:
        details["exclude"] = [x.text for x in log.exclude]
    if log.written:
        details["reading"] = dict(log.written)
    if log.invalid is not None:
        details["invalid"] = log.invalid
    if dropped := max((e.attributes.get("dropped", 0) for e in experiments), default=0):
        details["rows_dropped"] = dropped
    if log.account.left_out:
        details["lines_left_out"] = len(log.account.left_out)
    if details:
        entry["details"] = details
    columns: dict[str, Any] = {}
    if experiments and experiments[0].time.size and log.sample_time is None:
        columns |= _column_entry(log, TIME)
    turns = experiments[0].attributes.get("turns", {}) if experiments else {}
    for role, signal in experiments[0].signals.items() if experiments else ():
        if role in log.steps:
            step, scale = log.steps[role], log.scales.get(role, 1.0)
            columns[role] = {
                "step": {"from": scale * step.start, "to": scale * step.end, "at": step.at},
                "unit": step.unit or log.units.get(role, signal.unit),
            }
            if role in log.from_name:
                columns[role]["from_name"] = log.from_name[role]
        else:
            columns |= _column_entry(log, Role(role, signal.unit, ""))
        if role in turns:
            columns[role]["turn"] = turns[role]
        if signal.hold is not None:
            columns[role]["hold"] = signal.hold
    entry["columns"] = columns
    return entry


def _column_entry(log: Log, role: Role) -> dict[str, dict[str, Any]]:
    """Return the entry of the column that was bound to a role; empty without one."""
    binding = bind_role(log, role)
    if binding is None:
        return {}
    entry: dict[str, Any] = {"header": binding.column.label, "unit": binding.unit}
    if binding.scale != 1.0:
        entry["scale"] = binding.scale
    if binding.assumed:
        entry["assumed"] = True
    return {role.name: entry}


def _describe_column(column: Column) -> dict[str, Any]:
    finite = column.values[np.isfinite(column.values)]
    return {
        "number": column.index,
        "header": column.header or None,
        "name": column.name or None,
        "unit": column.unit,
        "unit_doubt": unit_doubt(column.unit) if column.unit else "",
        "low": float(finite.min()) if finite.size else None,
        "high": float(finite.max()) if finite.size else None,
        "resolution": smallest_step(column.stamps[np.isfinite(column.stamps)]),
        "invalid_cells": 0 if column.sparse else int(column.values.size - finite.size),
        "samples": int(finite.size),
    }


def _turns(log: Log) -> list[Notice]:
    """Columns of angles that wrap, or seem to."""
    notices = []
    for column in log.columns:
        if column.unit and same_dimension(column.unit, "rad"):
            to_si = conversion_factor(column.unit, "rad")
            role = Role("angle", "rad", "")
            binding = Binding(role, column, column.unit, 1.0, to_si, assumed=False)
            try:
                found = settle_turns(log, {role.name: binding}, [untimed_run(log.rows)]).notices
            except LogError as error:
                found = [Notice("angle-doubtful", error.text.replace("\n", " "))]
            notices += found
    return notices


def _describe_time(log: Log, notices: list[Notice]) -> dict[str, Any] | None:
    try:
        binding = time_candidate(log)
        if binding is None:
            return None
        runs, found = split_runs(log, binding)
        runs = select_runs(log, runs)
    except LogError as error:
        notices.append(Notice("time-unusable", error.text.replace("\n", " ")))
        return None
    notices += found
    notices += check_sampling(log, runs)
    steps = np.concatenate([np.diff(run.time) for run in runs])
    usual = float(np.median(steps)) if steps.size else 0.0
    return {
        "column": binding.column.index,
        "header": binding.column.header or None,
        "unit": binding.unit,
        "assumed": binding.assumed,
        "named": bind_role(log, TIME) is not None,
        "runs": len(runs),
        "sample_time": usual,
        "uniform": all(run.uniform for run in runs),
        "jitter": float(np.abs(steps - usual).max()) if steps.size else 0.0,
        "start": float(min(run.time[0] for run in runs)),
        "end": float(max(run.time[-1] for run in runs)),
    }
