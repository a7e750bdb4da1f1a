"""Parameter files of one family, or logs, beside each other: what differs, and by how much.

A parameter differs from that of the first file by ``z = (v - v_1) / sqrt(s^2 + s_1^2)`` standard
errors. All that both files estimated are judged together by ``d' (C + C_1)^-1 d``, which has a
chi-squared distribution where nothing differs [1]_: parameters may each agree, and not together.
Both hold for logs of their own; of files that share logs it is said.

References
----------
.. [1] A. Wald, "Tests of statistical hypotheses concerning several parameters when the number of
   observations is large", Transactions of the American Mathematical Society 54, 1943.
"""

from __future__ import annotations

import os
from abc import abstractmethod
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import hypot, isclose
from os import PathLike
from pathlib import Path
from typing import Any, Unpack, cast

import numpy as np

from .alignment import Estimates, align
from .errors import UsageError
from .families import get_family
from .files import shell_command
from .logs import Log, LogLike, Reading, describe, open_logs
from .logs.log import count_of
from .logs.opening import check_keywords
from .options import describe as describe_options
from .parameter_table import Entry, entries_of, recorded_units
from .parameters.document import LogSource, ParameterDocument, window_ends
from .presentation import ParametersLike, Presented, document_of
from .tables import Shown, Table, format_estimate, format_number, probability_text
from .units import after_number, display_unit

_PARAMETERS = (".yaml", ".yml")
# Keywords that the command line has by another name.
_OPTIONS = {"columns": "column", "units": "unit", "scales": "scale", "steps": "step",
            "holds": "hold", "constants": "set"}  # fmt: skip

_DIFFERS = 1e-3  # probability of a difference that large by chance
_UNLIKE = 3.0  # ratio of two ranges that are said to differ
_SAME_STEP = 0.01  # part by which two sample times may differ


@dataclass(frozen=True)
class ParameterComparison:
    """One parameter, or entry of a list, in every file; ``None`` where a file has it not.

    ``deviations`` are its differences from the first file in standard errors.
    """

    name: str
    unit: str
    values: tuple[float | None, ...]
    std_errors: tuple[float | None, ...]
    statuses: tuple[str | None, ...]
    deviations: tuple[float | None, ...]

    def cells(self, recorded: Sequence[str]) -> tuple[str, ...]:
        """Return the row of a table: name, unit, and of every file value and deviation."""
        size = max((abs(v) for v in self.values if v is not None), default=0.0)
        shown = display_unit(self.unit, size, recorded)
        row = [self.name, shown.unit]
        every = zip(self.values, self.std_errors, self.statuses, self.deviations)
        for k, (value, error, status, z) in enumerate(every):
            row.append(_number(value, error, status, shown.factor))
            row += [("" if z is None else f"{z:+.1f}")] if k else []
        return tuple(row)


@dataclass(frozen=True)
class Together:
    """All that a file and the first one estimated, judged together.

    ``statistic`` has ``degrees`` degrees of freedom; ``shared_logs`` are those that both were
    fitted to, which makes their errors alike and the test mean little.
    """

    file: str
    statistic: float
    degrees: int
    p_value: float
    shared_logs: tuple[str, ...]

    @property
    def differs(self) -> bool:
        """Return whether chance does not explain it."""
        return self.degrees > 0 and self.p_value < _DIFFERS

    @property
    def words(self) -> str:
        """Describe the finding for people."""
        if not self.degrees:
            return f"{self.file}: nothing that both files estimated"
        verdict = "differs by more than chance" if self.differs else "does not differ beyond chance"
        text = f"{self.file}: {verdict} ({self.degrees} numbers together, "
        text += f"{probability_text(self.p_value)})"
        if self.shared_logs:
            text += (
                f"; both were fitted to {', '.join(self.shared_logs)}: their errors are the same "
                "in part, so the differences are more certain than shown"
            )
        return text


class _Compared(Shown):
    """A table and conclusions."""

    @abstractmethod
    def table(self) -> Table:
        """Return the table."""

    @property
    @abstractmethod
    def conclusions(self) -> tuple[str, ...]:
        """Sentences below it."""

    def parts(self) -> list[Table | str]:
        """Return the table and the conclusions."""
        return [self.table(), "\n".join(self.conclusions)]


@dataclass(frozen=True)
class Comparison(_Compared):
    """Parameter files of one family beside each other [SI].

    Tables are in the ``recorded_units`` of the first file where these suit; ``options`` are
    sentences about given numbers that differ.
    """

    family: str
    files: tuple[str, ...]
    parameters: tuple[ParameterComparison, ...]
    together: tuple[Together, ...]
    recorded_units: tuple[str, ...] = ()
    options: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers and text."""
        return asdict(self)

    def table(self) -> Table:
        """Return every parameter of every file, as a table that shows itself."""
        head = ["parameter", "unit"]
        for k, name in enumerate(_distinct(self.files)):
            head += [name, *(["std errors"] if k else [])]
        rows = [p.cells(self.recorded_units) for p in self.parameters]
        return Table(tuple(head), tuple(rows))

    @property
    def conclusions(self) -> tuple[str, ...]:
        """Conclusions from all parameters of each file together."""
        scale = "Differences are in standard errors of the difference."
        return (scale, *self.options, *(t.words for t in self.together))


def _number(value: float | None, error: float | None, status: str | None, factor: float) -> str:
    if value is None:
        return "-"
    if status == "not_identified":
        return "not identified"
    if error is None:
        return f"{format_number(factor * value)} {status}"
    return format_estimate(factor * value, factor * error)


def compare(
    *given: ParametersLike | LogLike, **reading: Unpack[Reading]
) -> Comparison | Recordings:
    """Compare parameters of one family, or logs, with the first of them.

    Parameters
    ----------
    *given
        Parameter files (``.yaml``), results or models; or logs: other files, DataFrames, mappings
        of header to array, or logs that have been read; one by one, or a list of them.
    **reading
        How logs are read, as for a fit (:class:`.logs.Reading`).

    Returns
    -------
    Comparison or Recordings
        Of parameters: every one with its standard error, how many standard errors it differs from
        that of the first, and whether all together differ by more than chance. Of logs: columns,
        units, ranges and sampling, and where they differ.

    Raises
    ------
    UsageError
        For fewer than two, for parameters beside logs, of different families, and for ``reading``
        where there are no logs.
    ParameterFileError, LogError
        When a file cannot be read.
    """
    if len(given) == 1 and isinstance(given[0], list | tuple):
        given = tuple(given[0])
    kinds = {_holds_parameters(item) for item in given}
    names = [_name(item, k) for k, item in enumerate(given, 1)]
    if len(kinds) > 1:
        files = [name for name, item in zip(names, given) if _holds_parameters(item)]
        logs = [name for name in names if name not in files]
        command = shell_command(["fluidact-fit", "check", files[0], *logs])
        raise UsageError(
            "parameter files and logs cannot be compared with each other.",
            remedy=f"To see whether a file describes logs: {command}.",
        )
    if True not in kinds:
        return compare_recordings(list(zip(names, open_logs(list(given), **reading))))
    check_keywords(reading)
    if said := next((name for name, value in reading.items() if value), None):
        option = f"--{_OPTIONS.get(said, said).replace('_', '-')}"
        raise UsageError(
            f"{option} is about logs, and parameter files are compared.", remedy="Leave it out."
        )
    documents = [document_of(item, get_family) for item in cast("Sequence[ParametersLike]", given)]
    return compare_documents(list(zip(names, documents)))


def _holds_parameters(item: ParametersLike | LogLike) -> bool:
    if isinstance(item, str | PathLike):
        return Path(item).suffix.lower() in _PARAMETERS
    return isinstance(item, Presented | ParameterDocument)


def _name(item: ParametersLike | LogLike, number: int) -> str:
    """Name of a compared item: the path of a file, or its number."""
    if isinstance(item, str | PathLike):
        return str(item)
    return str(getattr(item, "name", "") or f"#{number}")


def compare_documents(files: Sequence[tuple[str, ParameterDocument]]) -> Comparison:
    """Compare parameter files with the first of them.

    Parameters
    ----------
    files
        Name and document of each, of one family.

    Raises
    ------
    UsageError
        For fewer than two files, and for files of different families or units.
    """
    _require_two(files)
    first_name, first = files[0]
    for name, document in files[1:]:
        if document.family != first.family:
            raise UsageError(
                f"{name} is a file of {_kind(document)}, {first_name} of {_kind(first)}.",
                remedy="Compare files of one family.",
            )
    each, about = align(get_family(first.family), [Estimates.of(document) for _, document in files])
    tables = [{entry.name: entry for entry in entries_of(e.quantities)} for e in each]
    every = list(dict.fromkeys(n for table in tables for n in table))
    _require_one_unit([name for name, _ in files], tables)
    parameters = tuple(_beside(n, tables) for n in every)
    together = tuple(
        _together(each[0], other, name, _shared_logs(first, document))
        for other, (name, document) in zip(each[1:], files[1:])
    )
    names = tuple(n for n, _ in files)
    shown = [f"{about[0].upper()}{about[1:]}."] if about else []
    options = (*shown, *_different_options(files))
    return Comparison(first.family, names, parameters, together, recorded_units(first), options)


def _require_one_unit(names: Sequence[str], tables: Sequence[Mapping[str, Entry]]) -> None:
    """Refuse files in which a parameter is another quantity: their machines were read otherwise."""
    for parameter, known in tables[0].items():
        for name, table in zip(names[1:], tables[1:]):
            if parameter in table and table[parameter].unit != known.unit:
                raise UsageError(
                    f"{parameter} is in {table[parameter].unit} in {name} and in {known.unit} in "
                    f"{names[0]}: a column was in another quantity.",
                    remedy="Compare files whose logs were in the same quantities.",
                )


def _different_options(files: Sequence[tuple[str, ParameterDocument]]) -> Iterator[str]:
    """Sentences about numbers that were given or settled otherwise: parameters depend on them."""
    first, known = files[0]
    options = describe_options(get_family(known.family).options_type)
    units = {option.name: option.unit for option in options}
    for name, document in files[1:]:
        settled = known.options or {}
        for option, value in (document.options or {}).items():
            before, unit = settled.get(option), after_number(units.get(option, ""))
            if (
                not unit
                or not isinstance(value, int | float)
                or not isinstance(before, int | float)
            ):
                continue
            if not isclose(value, before, rel_tol=1e-9):
                yield (
                    f"--{option} is {value:.6g}{unit} in {name} and {before:.6g}{unit} in {first}: "
                    "parameters that depend on it differ by that, too."
                )


def _require_two(given: Sequence[Any]) -> None:
    if len(given) < 2:
        raise UsageError("there is nothing to compare with.", remedy="Give two files or more.")


def _kind(document: ParameterDocument) -> str:
    same = document.variant in (None, document.family)
    return document.family if same else f"{document.family} ({document.variant})"


def _beside(name: str, tables: Sequence[Mapping[str, Entry]]) -> ParameterComparison:
    found = [table.get(name) for table in tables]
    first = found[0]
    deviations = [None if k == 0 else _deviation(first, e) for k, e in enumerate(found)]
    return ParameterComparison(
        name,
        next(e.unit for e in found if e is not None),
        tuple(None if e is None else e.value for e in found),
        tuple(None if e is None else e.std_error for e in found),
        tuple(None if e is None else e.status for e in found),
        tuple(deviations),
    )


def _deviation(first: Entry | None, other: Entry | None) -> float | None:
    """Difference in standard errors, where both were estimated or one of them was given."""
    if first is None or other is None or "not_identified" in (first.status, other.status):
        return None
    if first.value is None or other.value is None:
        return None
    error = hypot(first.std_error or 0.0, other.std_error or 0.0)
    return (other.value - first.value) / error if error > 0.0 else None


def _together(first: Estimates, other: Estimates, name: str, shared: tuple[str, ...]) -> Together:
    from scipy.special import chdtrc

    common = [n for n in first.order if n in other.order]
    if not common:
        return Together(name, 0.0, 0, 1.0, shared)
    at, place = ([e.order.index(n) for n in common] for e in (first, other))
    difference = other.vector()[place] - first.vector()[at]
    spread = first.covariance[np.ix_(at, at)] + other.covariance[np.ix_(place, place)]
    scale = np.sqrt(np.maximum(np.diag(spread), 1e-300))
    scaled = spread / np.outer(scale, scale)
    # what two numbers have in common is told once, whatever their units
    values, vectors = np.linalg.eigh(scaled)
    kept = values > 1e-10 * float(values.max())
    along = vectors[:, kept].T @ (difference / scale)
    statistic, degrees = float(along @ (along / values[kept])), int(kept.sum())
    return Together(name, statistic, degrees, float(chdtrc(degrees, statistic)), shared)


def _shared_logs(first: ParameterDocument, other: ParameterDocument) -> tuple[str, ...]:
    """Logs of which both files were fitted to the same part, or to parts that overlap."""
    known = defaultdict(list)
    for source in first.provenance.logs:
        known[source.sha256].append(source)
    return tuple(dict.fromkeys(
        one.file for two in other.provenance.logs for one in known[two.sha256]
        if _windows_overlap(one, two)
    ))  # fmt: skip


def _windows_overlap(one: LogSource, two: LogSource) -> bool:
    """Return whether two parts of a log have time in common [s]."""
    windows = [window_ends((s.details or {}).get("window")) for s in (one, two)]
    starts = [low for low, _ in windows if low is not None]
    ends = [high for _, high in windows if high is not None]
    return max(starts, default=-np.inf) < min(ends, default=np.inf)


@dataclass(frozen=True)
class Recordings(_Compared):
    """Logs beside each other: what :func:`.logs.describe` says of each, and where they differ."""

    logs: tuple[dict[str, Any], ...]
    findings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers and text."""
        return {"logs": list(self.logs), "findings": list(self.findings)}

    def table(self) -> Table:
        """Return rows, sampling and the range of every column, as a table that shows itself."""
        rows = [["rows", *(str(log["rows"]) for log in self.logs)]]
        steps = [(log["time"] or {}).get("sample_time") for log in self.logs]
        rows.append(["every", *("-" if not s else f"{s:g} s" for s in steps)])
        tables = [{column_key(c): c for c in log["columns"]} for log in self.logs]
        names = {key: _label(c) for table in reversed(tables) for key, c in table.items()}
        for key in dict.fromkeys(k for table in tables for k in table):
            rows.append([names[key], *(_range(table.get(key)) for table in tables)])
        head = ("", *_distinct([log["file"] for log in self.logs]))
        return Table(head, tuple(map(tuple, rows)))

    @property
    def conclusions(self) -> tuple[str, ...]:
        """Differences between the logs, for people."""
        if not self.findings:
            return ("same columns, units, rows and sampling, and similar ranges",)
        files = [log["file"] for log in self.logs]
        findings = list(self.findings)
        for path, name in zip(files, _distinct(files)):
            findings = [finding.replace(path, name) for finding in findings]
        return tuple(findings)


def _distinct(paths: Sequence[str]) -> Sequence[str]:
    """Names of files without the folders that they have in common."""
    names = [Path(path).name for path in paths]
    if len(set(names)) == len(names) or len(set(paths)) < len(paths):
        return names
    try:
        common = os.path.commonpath([os.path.dirname(os.path.abspath(path)) for path in paths])
        return [os.path.relpath(path, common) for path in paths]
    except ValueError:  # on several drives
        return paths


def _range(column: Mapping[str, Any] | None) -> str:
    if column is None:
        return "-"
    if column["low"] is None:
        return "no numbers"
    return f"{column['low']:.5g} … {column['high']:.5g} {column['unit'] or ''}".rstrip()


def compare_recordings(logs: Sequence[tuple[str, Log]]) -> Recordings:
    """Compare logs, named as they are to be called, with the first of them.

    Raises
    ------
    UsageError
        For fewer than two.
    """
    _require_two(logs)
    described = [{**describe(log), "file": name} for name, log in logs]
    findings = [f for other in described[1:] for f in _findings(described[0], other)]
    return Recordings(tuple(described), tuple(findings))


def column_key(column: Mapping[str, Any]) -> str:
    """Name of a column by which it is found in another log, whatever its case."""
    return _label(column).casefold()


def _label(column: Mapping[str, Any]) -> str:
    """Name of a column as it stands in the log, or its number where it has none."""
    return str(column["name"] or column["header"] or f"#{column['number']}")


def _findings(first: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """Describe the differences between a log and the first one."""
    out = []
    name, before = other["file"], first["file"]
    if other["sha256"] == first["sha256"]:
        return [f"{name} and {before} are the same to the byte"]
    columns, known = ({column_key(c): c for c in log["columns"]} for log in (other, first))
    out += [f"{name} has no column '{_label(c)}', {before} has"
            for k, c in known.items() if k not in columns]  # fmt: skip
    out += [f"{name} has a column '{_label(c)}', {before} has none"
            for k, c in columns.items() if k not in known]  # fmt: skip
    for key in (k for k in known if k in columns):
        out += _of_column(columns[key], known[key], name, before)
    if other["rows"] != first["rows"]:
        out.append(f"{name} has {count_of(other['rows'], 'row')}, {before} has {first['rows']}")
    now, then = (float((log["time"] or {}).get("sample_time") or 0.0) for log in (other, first))
    if now and then and abs(now - then) > _SAME_STEP * then:
        out.append(f"{name} was sampled every {now:g} s, {before} every {then:g} s")
    return out


def _of_column(
    column: Mapping[str, Any], known: Mapping[str, Any], name: str, before: str
) -> list[str]:
    key = _label(known)
    if column["unit"] != known["unit"]:
        units = [c["unit"] or "no unit" for c in (column, known)]
        return [f"'{key}' is in {units[0]} in {name}, in {units[1]} in {before}"]
    if any(c["low"] is None for c in (column, known)):
        return []
    one, two = (c["high"] - c["low"] for c in (column, known))
    unit = f" {column['unit']}" if column["unit"] else ""
    if max(one, two) > _UNLIKE * min(one, two):
        return [f"'{key}' covers {one:.4g}{unit} in {name}, {two:.4g}{unit} in {before}"]
    if max(c["low"] for c in (column, known)) > min(c["high"] for c in (column, known)):
        return [f"'{key}' is {_range(column)} in {name}, {_range(known)} in {before}"]
    return []
