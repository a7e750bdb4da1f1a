"""CSV exports of TwinCAT Scope.

A block on the export (``Name``, ``File``, ``Starttime of export``, ...), then one line per
attribute of the channels (``Name``, ``SampleTime[ms]``, ``Unit``, ...). The key of an attribute
stands above every column of time, in ms from the start or as FILETIME, and the channels of one
sample time follow it. Without columns of time the samples are counted. Channels that end before
the others leave cells blank or end their lines early. The decimal sign of the header is that of
the machine, the one of the samples that of the export.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

from ..errors import LogError, Notice
from .clock import FILETIME
from .groups import counted_groups, group_columns
from .layout import (
    Counted,
    Group,
    Hints,
    Layout,
    Written,
    count_filled,
    decimal_of,
    number_of,
    split_cells,
)
from .source import Source

_HEAD = 1 << 22  # bytes in which the samples have to begin
_TOP = 400  # lines in which the names of the channels have to stand
_HINTS = Hints("TwinCAT Scope", sparse=True)
_KEYS = {
    "Starttime of export",
    "Endtime of export",
    "SymbolComment",
    "Data-Type",
    "SampleTime[ms]",
    "SymbolName",
}
_PROJECT = {"File", "Starttime of export", "Endtime of export"}
_NAME = re.compile(r'"?Name"?([\t ;,:])')
_NO_UNIT = {"(none)", "none", "-", "null"}
_NEUTRAL = {"Offset": 0.0, "ScaleFactor": 1.0, "Unit Offset": 0.0, "Unit ScaleFactor": 1.0}


def lay_out(source: Source, written: Written) -> Layout | None:
    """The layout of an export, ``None`` where the text is none.

    Raises
    ------
    LogError
        When names or samples are missing, or commas both separate cells and decimals.
    """
    lines = source.data[:_HEAD].decode(errors="replace").split("\n")
    tops = [k for k, line in enumerate(lines[:_TOP]) if _NAME.match(line)]
    if not tops:
        return None
    delimiter = str(_NAME.match(lines[tops[-1]])[1])  # type: ignore[index]
    rows = [split_cells(line, delimiter) for line in lines[:_TOP]]
    names = rows[tops[-1]]
    first = _first_row(lines, tops[-1], delimiter)
    if not _is_export(rows[:first], names):
        return None
    while names and not names[-1]:
        names = names[:-1]
    cells = split_cells(lines[first], delimiter) if first < len(lines) else []
    attributes = {row[0]: row for row in rows[tops[-1] : first] if row and row[0]}
    _require_table(source.name, names, attributes, cells, delimiter)
    return _build(source, written, names, attributes, cells, delimiter, tops[-1], first)


def _first_row(lines: Sequence[str], top: int, delimiter: str) -> int:
    """Index of the first line below the attributes whose first cell is a number, or blank."""
    for k in range(top + 1, len(lines)):
        cells = split_cells(lines[k], delimiter)
        if any(cells) and (not cells[0] or number_of(cells[0]) is not None):
            return k
    return len(lines)


def _is_export(rows: Sequence[Sequence[str]], names: Sequence[str]) -> bool:
    """Return whether the lines above the samples are those of an export."""
    return names.count("Name") > 1 or any(row and row[0] in _KEYS for row in rows)


def _require_table(
    name: str, names: Sequence[str], attributes: Iterable[str], cells: Sequence[str], delimiter: str
) -> None:
    """Refuse an export without channels or samples, and one that cannot be cut."""
    if not cells or len(names) < 2 or not _PROJECT.isdisjoint(attributes):
        raise LogError(
            "a TwinCAT Scope export without channels or samples.",
            where=name,
            expected="Expected the names of the channels, and lines of numbers below them.",
            remedy="Export the recording again, with its channels and their samples.",
        )
    filled = count_filled(cells)
    if filled > len(names):
        both = delimiter == ","
        raise LogError(
            f"{filled} cells where the header has {len(names)}"
            + (": commas separate the columns, and the decimals too." if both else "."),
            where=name,
            expected="Expected one cell per column.",
            remedy="Export again with tabs or semicolons between the columns."
            if both
            else "Export the recording again.",
        )


def _build(
    source: Source,
    written: Written,
    names: Sequence[str],
    attributes: Mapping[str, Sequence[str]],
    cells: Sequence[str],
    delimiter: str,
    top: int,
    first: int,
) -> Layout:
    """Put the layout together from the parts of the header and the first row."""
    groups = group_columns(names, "Name")
    held = [k for group in groups for k in group.columns]
    times = [group.time for group in groups if group.time is not None]
    width, clocks, time_unit = len(names), {}, "ms"
    # Columns of time that are left out, or there but blank.
    left_out = count_filled(cells) == len(held)
    if left_out or not any(cells[k] for k in times if k < len(cells)):
        width = len(held) if left_out else len(names)
        groups = _counted(held, attributes.get("SampleTime[ms]", ()), first, left_out)
        held = [held[k] if left_out else k for group in groups for k in group.columns] or held
        timed = bool(groups)
    else:
        timed = True
        if FILETIME.fullmatch(cells[times[0]]):
            clocks, time_unit = dict.fromkeys(times), "s"
        groups = groups if len(groups) > 1 else []
    headers = [names[k] for k in held]
    units = [_unit(attributes.get("Unit", ()), k) for k in held]
    samples = source.data.decode(errors="replace").split("\n", first)[-1]
    end = source.data.rstrip()
    lines = end.count(b"\n") + 1
    marked = end[end.rfind(b"\n") + 1 :].strip(b'" \t;,:') == b"EOF"
    return Layout(
        delimiter=delimiter,
        decimal=written.decimal or decimal_of(samples, delimiter),
        width=width,
        trailing=not groups and len(cells) == width + 1 and not cells[-1],
        thousands=written.thousands or "",
        first_row=first,
        hints=_HINTS,
        header_row=top,
        headers=["time", *headers] if timed else headers,
        units=[time_unit, *units] if timed else units,
        clocks=clocks,
        groups=tuple(groups),
        skipped={lines: "end mark"} if marked else {},
        notices=_scaled(source.name, names, held, attributes),
    )


def _counted(
    held: Sequence[int], periods: Sequence[str], first: int, left_out: bool
) -> list[Group]:
    """Groups whose samples are counted, one per sample time; none where that is not written.

    ``held`` are the channels' places in the header, where the rows have the columns of time
    ``left_out`` or not.
    """
    steps = [(k < len(periods) and number_of(periods[k])) or 0.0 for k in held]
    if min(steps) <= 0.0:
        return []
    places = range(len(held)) if left_out else held
    return counted_groups(places, [(Counted(first + 1, 0.0, step),) for step in steps])


def _unit(cells: Sequence[str], column: int) -> str:
    unit = cells[column] if column < len(cells) else ""
    return "" if unit.casefold() in _NO_UNIT else unit


def _scaled(
    name: str,
    names: Sequence[str],
    held: Sequence[int],
    attributes: Mapping[str, Sequence[str]],
) -> tuple[Notice, ...]:
    """Say which channels are scaled for display, which is not applied."""
    found = []
    for k in held:
        for key, neutral in _NEUTRAL.items():
            text = attributes.get(key, ())[k : k + 1]
            value = number_of(text[0]) if text else None
            if value not in (None, neutral):
                found.append(f"'{names[k]}' ({key} {value:g})")
    if not found:
        return ()
    return (
        Notice(
            "display-scale",
            f"{name}: Scope scales {', '.join(found)} for display; the numbers were read as they "
            "are written. Where the export is not scaled, give --scale ROLE=FACTOR.",
        ),
    )
