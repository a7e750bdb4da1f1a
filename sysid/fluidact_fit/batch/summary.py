"""Summary of a batch, as a table and as a page."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..estimation.random_effects import estimate_spread
from ..parameters.atomic import write_together
from ..report.fleet import FleetJob, FleetQuantity, Reason, fleet_page
from ..specification import entry_name
from .jobs import Job
from .outcome import STATUS, JobResult
from .targets import RECORDS, SUMMARY

if TYPE_CHECKING:
    import pandas as pd

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
# What begins a formula, at the beginning of a cell or of what another locale takes for one.
_FORMULA = re.compile(r"(^|;)([\s\x00-\x20]*[=+\-@\t\r\n\uff1d\uff0b\uff0d\uff20\u2212])")
_VARYING = re.compile(r"'[^']*'|\"[^\"]*\"|[-+]?\d[\d.,]*(?:e[-+]?\d+)?|\S*/\S*")


def write_summary(jobs: Sequence[Job], outcomes: Sequence[JobResult], folder: Path) -> list[Path]:
    """Write ``summary.csv``, ``summary.parquet`` and ``index.html``, all or none.

    Text that a spreadsheet would run as a formula stands behind an apostrophe in the CSV.

    Parameters
    ----------
    jobs, outcomes
        In the same order.
    folder
        Where; older ones are replaced.

    Raises
    ------
    OutputError
        When they cannot be written.
    """
    table = summary_table(jobs, outcomes)
    packed: bytes = table.to_parquet(None, index=False)
    text = table.apply(lambda column: column if column.dtype.kind in "iuf" else column.map(_inert))
    contents: tuple[str | bytes, ...] = (text.to_csv(index=False), packed, _page(jobs, outcomes))
    named = {str(folder / name): content for name, content in zip(SUMMARY, contents)}
    return write_together(named, overwrite=True)


def _inert(cell: Any) -> Any:
    """A cell that no spreadsheet runs; a name that is a number stays one."""
    if not isinstance(cell, str) or _NUMBER.fullmatch(cell):
        return cell
    return _FORMULA.sub(r"\1'\2", cell.replace("\r", " "))


def summary_table(jobs: Sequence[Job], outcomes: Sequence[JobResult]) -> pd.DataFrame:
    """One row per job: what came of it, and every number with its standard error.

    A list gives one column an entry, ``control_points[0]``; a number that a job has not is
    empty. Times are not in it: the same jobs give the same table.
    """
    import pandas as pd

    rows = []
    for job, outcome in zip(jobs, outcomes):
        row: dict[str, Any] = {
            "job": job.name, "family": job.family, "status": outcome.status, "exit": outcome.exit,
            "verdict": outcome.verdict, "warnings": " ".join(outcome.warnings),
            "message": " ".join(outcome.message.split()),
        }  # fmt: skip
        for name, _, value, error, status in _numbers(outcome):
            row |= {name: value, f"{name}_std_error": error, f"{name}_status": status}
        rows.append(row)
    return pd.DataFrame(rows)


def _numbers(outcome: JobResult) -> Iterator[tuple[str, str, float, float | None, str]]:
    """Name, unit, value, standard error and status of every number."""
    for name, entry in outcome.parameters.items():
        values, errors = entry["value"], entry.get("std_error")
        for place, value in np.ndenumerate(np.asarray(values, dtype=float)):
            error = None if errors is None else float(np.asarray(errors, dtype=float)[place])
            yield entry_name(name, place), entry["unit"], float(value), error, entry["status"]


def _page(jobs: Sequence[Job], outcomes: Sequence[JobResult]) -> str:
    verdicts, ends = (Counter(x) for x in zip(*((o.verdict, o.status) for o in outcomes)))
    counts = {f"verdict {v}": verdicts[v] for v in ("pass", "warn", "fail")}
    counts |= {text: ends[text] for status, text in STATUS.items() if status}
    warned: dict[str, list[str]] = {}
    for outcome in outcomes:
        for name in dict.fromkeys(outcome.warnings):
            warned.setdefault(name, []).append(outcome.job)
    return fleet_page(
        {name: number for name, number in counts.items() if number},
        [FleetJob(j.name, j.family, o.status, o.verdict, o.warnings, tuple(o.files))
         for j, o in zip(jobs, outcomes)],
        fleet_quantities(jobs, outcomes),
        [_reason(group) for group in by_reason(outcomes)],
        dict(sorted(warned.items(), key=lambda item: -len(item[1]))),
        RECORDS,
    )  # fmt: skip


def fleet_quantities(jobs: Sequence[Job], outcomes: Sequence[JobResult]) -> list[FleetQuantity]:
    """Distribution of every number that has a standard error, by family and name."""
    found: dict[tuple[str, str, str], list[tuple[str, float, float]]] = {}
    for job, outcome in zip(jobs, outcomes):
        for name, unit, value, error, status in _numbers(outcome):
            if status == "estimated" and error is not None and error > 0.0:
                found.setdefault((job.family, name, unit), []).append((job.name, value, error))
    out = []
    for (family, name, unit), entries in found.items():
        names, values, errors = zip(*entries)
        y, s = np.array(values), np.array(errors)
        out.append(FleetQuantity(family, name, unit, names, y, s, estimate_spread(y, s)))
    return out


def by_reason(outcomes: Sequence[JobResult]) -> list[list[JobResult]]:
    """Jobs without a file by what was found, most first.

    Numbers, names and paths in it are no difference.
    """
    groups: dict[tuple[str, str], list[JobResult]] = {}
    for outcome in outcomes:
        if outcome.exit:
            key = outcome.status, _VARYING.sub("…", _words(outcome))
            groups.setdefault(key, []).append(outcome)
    return sorted(groups.values(), key=lambda group: -len(group))


def _words(outcome: JobResult) -> str:
    """What was found, or the message where nothing else was noted."""
    return outcome.reason or outcome.message


def _reason(group: Sequence[JobResult]) -> Reason:
    text = _words(group[0])
    text = _VARYING.sub("…", text) if len(group) > 1 else text
    return Reason(group[0].status, text, [outcome.job for outcome in group])
