"""Reading options of a parameter file's logs, for logs that are checked and simulated with it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

from .errors import FluidactError, LogError, Notice, UsageError, listed
from .logs import Log, LogLike, StepInput, open_logs, share_columns
from .logs.columns import matching, missing_roles, reference_of
from .logs.exclusions import find_in_name, parse_exclusion, with_constants, without
from .logs.opening import listed_logs
from .parameters.document import Column, LogSource, ParameterDocument, window_ends
from .specification import Role
from .units import parse_unit_from_header

_LISTED = 4  # logs whose constant a message names


def open_as_fitted(
    document: ParameterDocument,
    logs: Sequence[LogLike] | LogLike,
    *,
    beside: Iterable[LogLike] = (),
    **reading: Any,
) -> list[Log]:
    """Open logs; where they cannot be read by themselves, as those of the file were written.

    Raises
    ------
    LogError, UsageError
        Of the first try, when both fail.
    """
    each, others = listed_logs(logs), list(beside)
    try:
        return open_logs(each, beside=others, **reading)
    except LogError:
        own = ((s.details or {}).get("reading") for s in document.provenance.logs)
        recorded: dict[str, Any] = next(filter(None, own), {})
        given = {name: value for name, value in reading.items() if value is not None}
        used = {name: value for name, value in recorded.items() if name not in given}
        opened = []
        if used:
            with suppress(FluidactError):
                opened = open_logs(each, beside=others, **given, **used)
        if not opened:
            raise
    options = " ".join(f"--{n.replace('_', '-')} {value}" for n, value in used.items())
    return [
        replace(log, notices=(*log.notices, Notice(
            "read-as-fitted", f"{log.name}: read with {options}, as the logs of the fit were.")))
        for log in opened
    ]  # fmt: skip


def recall_columns(document: ParameterDocument, log: Log) -> Log:
    """Bind a log's columns as the file's own logs were bound, where nothing else was said.

    The example is the log itself where it was fitted, whatever it is called now, else the log of
    the provenance whose headers this one shares most; roles without a header there take the
    columns of their own name, as usual.

    Raises
    ------
    UsageError
        When a role was constant in every log of the file, at another value each, and nothing says
        what it was in this one.
    """
    sources = document.provenance.logs
    if not sources:
        return log
    named = {
        role: entry.from_name
        for source in sources
        for role, entry in source.columns.items()
        if entry.from_name is not None and role not in {*log.steps, *log.bindings}
    }
    if log.invalid is None and any((s.details or {}).get("invalid") == "drop" for s in sources):
        log = replace(log, invalid="drop")
    same = next((s for s in sources if s.sha256 == log.sha256), None)
    own = same.columns if same is not None else {}
    if same is not None:
        log = _recall_parts(log, same.details or {})
    log = _recall_constants(log, named, {r: own[r] for r in named if r in own})
    told_apart = set() if same is not None else _told_apart(log, sources)
    candidates = sources if same is None else [same]
    fitting = [
        {r: c for r, c in _present(log, source.columns).items() if r not in {*named, *told_apart}}
        for source in candidates
    ]
    best = max(range(len(candidates)), key=lambda i: len(fitting[i]))
    known = _apply(log, fitting[best])
    known = replace(known, turns={**_turns(log, candidates[best].columns), **log.turns})
    # a column that the user names is still drawn between its samples as the fit settled it
    held = {r: c.hold for s in sources for r, c in s.columns.items() if c.hold and c.step is None}
    followed = {r: h for r, h in held.items() if r in {*fitting[best], *log.bindings}}
    known = replace(known, holds={**followed, **log.holds})
    known = _recall_scales(known, candidates[best].columns)
    timed = "time" in {*candidates[best].columns, *log.bindings}
    if not timed and log.sample_time is None and candidates[best].sample_time:
        known = replace(known, sample_time=candidates[best].sample_time)
    return known


def _turns(log: Log, columns: Mapping[str, Column]) -> dict[str, float]:
    """Counter ranges of the columns of a log, where they are those of the file."""
    out = {}
    for role, entry in columns.items():
        named = log.bindings.get(role, entry.header or "")
        alike = [c for c in matching(log, named) if c.label == entry.header]
        if entry.turn is not None and alike:
            out[role] = entry.turn
    return out


def _told_apart(log: Log, sources: Sequence[LogSource]) -> set[str]:
    """Roles whose constants belong to the logs of the file, and not to any other log.

    ``UsageError`` where such a role is in every log of the file and nothing gives it in this one.
    """
    steps = {role for s in sources for role, column in s.columns.items() if column.step is not None}
    apart = set()
    for role in steps - {*log.steps, *log.bindings}:
        entries = [s.columns.get(role) for s in sources]
        if len({(e.step.start, e.step.end, e.step.at, e.unit) if e and e.step else None
                for e in entries}) == 1:  # fmt: skip
            continue
        apart.add(role)
        if all(entries) and not any(matching(log, text) for text in _headers(role, entries)):
            _refuse_unknown(log, role, sources)
    return apart


def _headers(role: str, entries: Sequence[Column | None]) -> set[str]:
    """Headers by which a log would have a column of a role."""
    return {role, *(e.header for e in entries if e is not None and e.header is not None)}


def _refuse_unknown(log: Log, role: str, sources: Sequence[LogSource]) -> None:
    known = [(s.file, s.columns[role]) for s in sources]
    texts = [
        f"{file} {_value_text(c.step.start, c.step.end)} {c.unit}" if c.step else f"{file} recorded"
        for file, c in known
    ]
    in_file = f"In the file: {listed(texts, _LISTED)}."
    if any(c.step and c.step.start != c.step.end for _, c in known):
        raise UsageError(
            f"'{role}' was not recorded in the logs of the parameter file, each with a step of its "
            "own, and is not known in this one.",
            where=log.name,
            expected=in_file,
            remedy=f"Give --step {role}=FROM:TO; of one log of several, "
            f"--step '{log.name}:{role}=FROM:TO'.",
        )
    raise UsageError(
        f"'{role}' was constant in the logs of the parameter file, each at its own value, and is "
        "not known in this one.",
        where=log.name,
        expected=in_file,
        remedy=f'Give --set {role}="VALUE UNIT"; of one log of several, '
        f"--set '{log.name}:{role}=VALUE UNIT'.",
    )


def _value_text(start: float, end: float) -> str:
    return f"{start:.6g}" if start == end else f"{start:.6g} to {end:.6g}"


def _recall_parts(log: Log, details: Mapping[str, Any]) -> Log:
    """The part of a log that was fitted, unless the user names another."""
    recalled = []
    if not log.exclude and (excluded := details.get("exclude")):
        log = without(log, [parse_exclusion(text) for text in excluded])
        recalled += [f"--exclude {text}" for text in excluded]
    if log.window is None and (window := details.get("window")):
        log = replace(log, window=window_ends(window))
        recalled.append(f"--window {window}")
    if not recalled:
        return log
    message = f"{log.name}: it was fitted, and the same part of it is used: {', '.join(recalled)}."
    return replace(log, notices=(*log.notices, Notice("part-recalled", message)))


def _recall_constants(log: Log, named: Mapping[str, str], own: Mapping[str, Column]) -> Log:
    """Constants from the name of a log as the file's own logs had them in theirs.

    What is in no name is known only of a log that was fitted: ``own`` are its columns.
    """
    for role, template in named.items():
        if find_in_name(role, template, log.name) is not None:
            log = with_constants(log, {}, {role: template})
        elif role in own and (step := own[role].step) is not None:
            steps = {**log.steps, role: StepInput(step.start, step.end, step.at)}
            log = replace(log, steps=steps, units={**log.units, role: own[role].unit})
    return log


def _present(log: Log, columns: Mapping[str, Column]) -> dict[str, Column]:
    """Entries of a provenance that a log can follow and the user did not replace."""
    return {
        role: entry
        for role, entry in columns.items()
        if role not in log.bindings
        and (entry.header is None or _header_in(log, entry.header) is not None)
    }


def _header_in(log: Log, header: str) -> str | None:
    """Return a text that ``--column`` takes for the column of a header; ``None`` without one.

    ``p (bar)`` is that of ``p [bar]``, and not of ``p [kPa]``.
    """
    if len(matching(log, header)) == 1:
        return header
    name, unit = parse_unit_from_header(header)
    alike = [c for c in matching(log, name) if unit and c.unit == unit]
    return reference_of(log, alike[0]) if len(alike) == 1 else None


def _apply(log: Log, remembered: Mapping[str, Column]) -> Log:
    bindings, units = dict(log.bindings), dict(log.units)
    steps = dict(log.steps)
    for role, entry in remembered.items():
        if role in log.steps or (role == "time" and log.sample_time is not None):
            continue
        if entry.step is not None:
            steps[role] = StepInput(entry.step.start, entry.step.end, entry.step.at)
        elif entry.header is not None:
            bindings[role] = _header_in(log, entry.header) or entry.header
        if not entry.assumed and not _states_its_own_unit(log, bindings.get(role), entry):
            units.setdefault(role, entry.unit)
    return replace(log, bindings=bindings, units=units, steps=steps)


def _states_its_own_unit(log: Log, header: str | None, entry: Column) -> bool:
    """Return whether another header than that of the file has a unit, which then holds."""
    columns = matching(log, header) if header is not None else []
    return any(c.unit is not None and c.label != entry.header for c in columns)


def _recall_scales(log: Log, columns: Mapping[str, Column]) -> Log:
    """Factors by which raw columns are multiplied: the sensor has them, whatever its header is.

    ``UsageError`` where a factor may have been the conversion to SI, and a unit is stated now.
    """
    scales = dict(log.scales)
    for role, entry in columns.items():
        found = matching(log, log.bindings.get(role, role))
        if entry.scale is None or role in {*scales, *log.steps} or not found:
            continue
        stated = log.units.get(role) or (found[0].label != entry.header and found[0].unit)
        if entry.assumed and stated and abs(entry.scale) != 1.0:
            raise UsageError(
                f"'{role}' was multiplied by {entry.scale:g} in the logs of the parameter file, "
                f"which state no unit, and is in {stated} here.",
                where=log.name,
                remedy=f"Give --scale {role}=1 if the factor made it {entry.unit}, and "
                f"--scale {role}={entry.scale:g} if it is that of the sensor.",
            )
        scales[role] = entry.scale
    return replace(log, scales=scales)


def recall_logs(document: ParameterDocument, logs: Sequence[Log]) -> list[Log]:
    """Bind the columns of logs that belong together as the file's own logs were bound."""
    return share_columns([recall_columns(document, log) for log in logs])


def name_lost_columns(document: ParameterDocument, log: Log, roles: Sequence[Role]) -> Log:
    """Bind required roles that a log lacks to their header in the file: the refusal names it."""
    headers = {
        role: entry.header
        for source in document.provenance.logs
        for role, entry in source.columns.items()
        if entry.header is not None
    }
    lost = {r: headers[r] for r in missing_roles(log, roles) if r in headers}
    return replace(log, bindings={**lost, **log.bindings})
