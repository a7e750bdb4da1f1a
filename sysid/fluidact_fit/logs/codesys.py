"""Traces of CODESYS and ctrlX as CSV: the channels one below the other, each with its own instants.

``KEY; VALUE`` lines on the trace, then for every channel its attributes (``0.Variable; GVL.p``,
``0.Class; 14``, ...) and below ``0.Data;`` one line per sample, ``; INSTANT; VALUE``. Instants are
in ms where no key says otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ..errors import LogError, Notice
from ..units import same_dimension
from .groups import Base, require_order, unite
from .layout import Hints, Layout, Written, decimal_of
from .log import count_of
from .source import Source
from .table import Table, read_table

_HEAD = 1 << 16  # bytes in which the first channel has to begin
_FIRST = re.compile(rb"^[ \t]*\d+\.Variable\s*([;,\t])", re.MULTILINE)
_KEY = re.compile(r" *(?:(\d+)\.)?([^\s;,\t][^;,\t]*)[;,\t]")
_RESOLUTION = re.compile(r"time ?(stamp)? ?(unit|base|resolution)|resolution", re.IGNORECASE)
_HINTS = Hints("CODESYS trace", sparse=True)


@dataclass(frozen=True)
class _Channel:
    """Attributes of a channel, and the indices of its first line, first sample and next line."""

    keys: Mapping[str, str]
    top: int
    first: int
    end: int


def read_trace(source: Source, written: Written) -> tuple[Layout, Table] | None:
    """The layout and the samples of a trace, ``None`` where the text is none.

    Raises
    ------
    LogError
        When a channel has no name, its samples cannot be read or are not in order, or the unit of
        the instants is none.
    """
    found = _FIRST.search(source.data[:_HEAD])
    if found is None or written.delimiter or written.skip_rows or written.header_row is not None:
        return None
    lines = source.lines()
    sign = found[1].decode()
    top, channels = _channels(lines, source.name)
    filled = [c for c in channels if any(map(str.strip, lines[c.first : c.end]))]
    if not filled:
        raise LogError(
            "a trace without samples.",
            where=source.name,
            expected="Expected '; INSTANT; VALUE' below '0.Data'.",
            remedy="Record and export it again.",
        )
    unit = _unit_of_time(top, source.name)
    tables = [_samples(source, lines, c, sign, written) for c in filled]
    first = filled[0]
    layout = Layout(
        delimiter=sign,
        decimal=tables[0][0].decimal,
        width=len(filled) + 1,
        first_row=first.first,
        hints=_HINTS,
        header_row=first.top,
        headers=["time", *(c.keys["Variable"] for c in filled)],
        units=[unit, *(c.keys.get("Unit", "") for c in filled)],
    )
    empty = [c.keys["Variable"] for c in channels if c not in filled]
    return layout, _merged(source.name, filled, [table for _, table in tables], lines, empty)


def _channels(lines: Sequence[str], name: str) -> tuple[dict[str, str], list[_Channel]]:
    """Read the description of the trace, and its channels."""
    top: dict[str, str] = {}
    keys: dict[str, str] = {}
    out: list[_Channel] = []
    begin, number, first = 0, "", None
    for index, line in enumerate([*lines, "END;"]):
        found = _KEY.match(line)
        if found is None:
            continue  # a sample, or blank
        key, value = found[2].strip(), line[found.end() :].strip(" \t;,")
        if first is not None:
            out.append(_Channel(keys, begin, first, index))
            keys, first, begin = {}, None, index
        if index == len(lines):
            break
        if found[1] is None:
            top[key] = value
            continue
        if not keys:
            begin, number = index, found[1]
        if found[1] != number or key in keys:
            raise _refusal(f"'{line.strip()[:60]}' amid those of channel {number}.", name, index)
        keys[key] = value
        if key == "Data":
            if not keys.get("Variable"):
                raise _refusal(f"channel {number} without a name.", name, index)
            first = index + 1
    if keys:
        raise _refusal(f"channel {number} without '{number}.Data'.", name, len(lines) - 1)
    return top, out


def _refusal(what: str, name: str, index: int) -> LogError:
    return LogError(
        what,
        where=f"{name}, line {index + 1}",
        expected="Expected 'N.Variable; NAME' to 'N.Data;' and the samples for every channel N.",
        remedy="Export the trace again.",
    )


def _unit_of_time(top: Mapping[str, str], name: str) -> str:
    """Unit of the instants: ms, unless the trace says another one."""
    for key, value in top.items():
        if not _RESOLUTION.fullmatch(key):
            continue
        unit = value.removeprefix("1 ").strip()
        if not same_dimension(unit, "s"):
            raise LogError(
                f"'{key}' of the trace is '{value[:40]}', which is not a unit of time.",
                where=name,
                expected="Expected one such as ms or us.",
                remedy="Correct the line, or remove it if the instants are in ms.",
            )
        return unit
    return "ms"


def _samples(
    source: Source, lines: Sequence[str], channel: _Channel, sign: str, written: Written
) -> tuple[Layout, Table]:
    """The instants and values of one channel."""
    block = "\n".join(lines[channel.first : channel.end])
    layout = Layout(
        delimiter=sign,
        decimal=written.decimal or decimal_of(block, sign),
        width=2,
        lead=1,
        thousands=written.thousands or "",
        first_row=channel.first,
        hints=_HINTS,
        header_row=channel.top,
        headers=["time", channel.keys["Variable"]],
        units=["", ""],
    )
    own = replace(source, data=b"\n" * channel.first + block.encode() + b"\n")
    return layout, read_table(own, layout)


def _merged(
    name: str,
    channels: Sequence[_Channel],
    tables: Sequence[Table],
    lines: Sequence[str],
    empty: Sequence[str],
) -> Table:
    """The channels over the instants of all."""
    bases = [
        Base(f"'{c.keys['Variable']}'", t.values[0], t.values[1:], t.bad[1:], t.lines)
        for c, t in zip(channels, tables)
    ]
    for base in bases:
        require_order(base, name)
    whole = unite(bases, name)
    ends = {number for c in channels for number in range(c.first, c.end)}
    heads = range(channels[0].first, len(lines))
    between = [(k + 1, "header of a channel") for k in heads if k not in ends and lines[k].strip()]
    notices = [notice for table in tables for notice in table.notices]
    if empty:
        notices.append(
            Notice(
                "variables-left-out",
                f"{name}: {count_of(len(empty), 'channel')} without samples left out: "
                f"{', '.join(empty[:8])}.",
            )
        )
    return Table(
        whole.values,
        whole.bad,
        whole.lines,
        tuple(sorted([*between, *(part for table in tables for part in table.left_out)])),
        tuple(notices),
        sum(table.data_lines for table in tables),
    )
