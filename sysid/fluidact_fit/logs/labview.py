"""LabVIEW measurement files (LVM).

A block on the file, ended by ``***End_of_Header***``; then, once or once per segment, a block on
the channels (``Channels``, ``Samples``, ``X0``, ``Delta_X``, ...) with the same end, and the names
of the columns from ``X_Value`` on. There is one column of X for all channels, one per channel, or
an empty one: the samples are then ``Delta_X`` apart. A column of comments may end the rows.
``Samples`` is not believed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..errors import LogError
from .groups import counted_groups, group_columns
from .layout import (
    SAMPLE,
    Counted,
    Group,
    Hints,
    Layout,
    Written,
    decimal_of,
    number_of,
    split_cells,
)
from .source import Source

_FIRST = "LabVIEW Measurement"
_END = "***End_of_Header***"
_HINTS = Hints("LabVIEW measurement", sparse=True)
_SEPARATORS = {"tab": "\t", "comma": ",", "semicolon": ";", "space": " "}
_LONGEST = 200  # lines of a block on the channels


@dataclass(frozen=True)
class _Segment:
    """Rows that share a block on their channels: indices of its first line and of the names,
    the names without comments, and start and step of X, and unit, by channel."""

    begin: int
    top: int
    names: tuple[str, ...]
    commented: bool
    starts: tuple[float, ...]
    steps: tuple[float, ...]
    units: tuple[str, ...]
    dimension: str


def lay_out(source: Source, written: Written) -> Layout | None:
    """The layout of a measurement, ``None`` where the text is none.

    Raises
    ------
    LogError
        When the names are missing, or segments hold different channels.
    """
    if not source.data.lstrip().startswith(_FIRST.encode()):
        return None
    lines = source.data.decode(errors="replace").split("\n")
    delimiter = _delimiter(lines)
    tops = [k for k, line in enumerate(lines) if line.startswith("X_Value")]
    if not tops:
        raise _refusal(
            source.name,
            "a LabVIEW measurement without the names of its columns ('X_Value').",
            "Expected them above the samples.",
            "Write it again with segment headers, or give --skip-rows with the lines above them.",
        )
    segments = [_segment(lines, top, delimiter) for top in tops]
    for number, segment in enumerate(segments[1:], start=2):
        if (segment.names, segment.units) != (segments[0].names, segments[0].units):
            raise _refusal(
                f"{source.name}, line {segment.top + 1}",
                f"segment {number} holds other channels or units than the first one: "
                f"{', '.join(segment.names)}.",
                f"Expected {', '.join(segments[0].names)}.",
                f"Split the file above line {segment.begin + 1}.",
            )
    return _build(source, written, lines, delimiter, segments)


def _refusal(where: str, what: str, expected: str, remedy: str) -> LogError:
    return LogError(what, where=where, expected=expected, remedy=remedy)


def _delimiter(lines: Sequence[str]) -> str:
    """The separator that the block on the file names, a tab without."""
    for line in lines[:40]:
        key, _, value = re.sub(r"[\t,;]", " ", line).partition(" ")
        if key == "Separator":
            return _SEPARATORS.get(value.strip().casefold(), "\t")
    return "\t"


def _segment(lines: Sequence[str], top: int, delimiter: str) -> _Segment:
    """Read the block on the channels above the line of their names."""
    begin = top
    while begin > max(0, top - _LONGEST) and not lines[begin].startswith("Channels"):
        begin -= 1
    keyed = [split_cells(line, delimiter) for line in lines[begin:top]]
    block = {row[0]: row[1:] for row in keyed if row} if lines[begin].startswith("Channels") else {}
    names = split_cells(lines[top], delimiter)
    while names and not names[-1]:
        names.pop()
    commented = names[-1] == "Comment"
    names = names[: len(names) - commented]
    channels = [k - 1 for k, name in enumerate(names) if name != "X_Value"]  # behind the key
    cells = _by_channel(block, channels)
    return _Segment(
        begin=begin if block else top,
        top=top,
        names=tuple(names),
        commented=commented,
        starts=_numbers(cells.get("X0", ()), len(channels)),
        steps=_numbers(cells.get("Delta_X", ()), len(channels)),
        units=tuple(cells.get("Y_Unit_Label", [""] * len(channels))),
        dimension=next(iter(block.get("X_Dimension", ())), "Time"),
    )


def _by_channel(
    block: Mapping[str, Sequence[str]], channels: Sequence[int]
) -> dict[str, list[str]]:
    """The cells of every line of a block, one per channel.

    They stand above the ``channels``, which have columns of X between them, or one after the other:
    as in a line where every channel has one.
    """
    in_a_row = range(len(channels))
    filled = [{k for k, cell in enumerate(cells) if cell} for cells in block.values()]
    places = in_a_row if any(set(in_a_row) <= found for found in filled) else channels
    return {
        key: [cells[k] if k < len(cells) else "" for k in places] for key, cells in block.items()
    }


def _numbers(cells: Sequence[str], count: int) -> tuple[float, ...]:
    return tuple([number_of(c) or 0.0 for c in cells] or [0.0] * count)


def _build(
    source: Source,
    written: Written,
    lines: Sequence[str],
    delimiter: str,
    segments: Sequence[_Segment],
) -> Layout:
    first = segments[0]
    start = first.top + 1
    body = [line for line in lines[start : start + SAMPLE] if line.strip()]
    cells = split_cells(body[0], delimiter) if body else []
    groups = group_columns(first.names, "X_Value")
    if not any(cells[g.time] for g in groups if g.time is not None and g.time < len(cells)):
        groups = _counted(groups, segments)
    held = [k for group in groups for k in group.columns]
    channels = [k for k, name in enumerate(first.names) if name != "X_Value"]
    numbered = any(part.step != s.steps[0] for g in groups for part, s in zip(g.counted, segments))
    x_name = "index" if numbered else first.dimension.lower()
    blocks = [(s.begin, s.top + 1) for s in segments[1:]]
    return Layout(
        delimiter=delimiter,
        decimal=written.decimal or _decimal(lines, body, delimiter),
        width=len(first.names) + first.commented,
        thousands=written.thousands or "",
        first_row=start,
        hints=_HINTS,
        header_row=first.top,
        headers=[x_name, *(first.names[k] for k in held)],
        units=["s" if x_name == "time" else "", *(first.units[channels.index(k)] for k in held)],
        groups=tuple(groups),
        skipped={
            k + 1: "header of a segment"
            for begin, end in blocks
            for k in range(begin, end)
            if lines[k].strip()
        },
    )


def _counted(groups: Sequence[Group], segments: Sequence[_Segment]) -> list[Group]:
    """Groups of channels that start and step alike in every segment."""
    channels = [k for group in groups for k in group.columns]
    counted = [
        tuple(Counted(s.top + 2, s.starts[place], s.steps[place]) for s in segments)
        for place in range(len(channels))
    ]
    if any(part.step <= 0.0 for parts in counted for part in parts):
        # Nothing says how far the samples are apart: their numbers stand for the time.
        counted = [tuple(Counted(s.top + 2, 0.0, 1.0) for s in segments)] * len(channels)
    return counted_groups(channels, counted)


def _decimal(lines: Sequence[str], body: Sequence[str], delimiter: str) -> str:
    """The decimal sign of the samples; what the header says of it where they do not tell."""
    cells = [cell for line in body for cell in split_cells(line, delimiter)]
    said = next((line for line in lines[:40] if line.startswith("Decimal_Separator")), "")
    numbers = " ".join(cell for cell in cells if number_of(cell) is not None)
    return decimal_of(numbers, delimiter, "," if said.rstrip().endswith(",") else ".")
