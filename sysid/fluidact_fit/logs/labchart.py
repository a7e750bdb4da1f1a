"""Text of LabChart and PowerLab: blocks of samples, each below what is said of its channels.

``KEY=`` and its values, one per channel, between tabs: ``Interval=``, ``ExcelDateTime=``,
``TimeFormat=``, ``DateFormat=``, ``ChannelTitle=``, ``Range=``. The rows have a time, a date where
one is exported, and the channels; a comment (``#* text``) may stand behind them. Every block begins
with ``Interval=`` again.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

from ..errors import LogError, Notice
from ..units import conversion_factor, same_dimension
from .clock import find_clocks
from .layout import (
    NUMBER,
    SAMPLE,
    Counted,
    Cut,
    Group,
    Hints,
    Layout,
    Written,
    decimal_of,
    to_number,
)
from .log import count_of, name_lines
from .source import Source

_FIRST = "Interval="
_KEY = re.compile(r"(\w+)=(?:\t|$)")
_COMMENT = re.compile(r"\t#")
_SIZE = re.compile(r"\s*([+-]?\d+(?:[.,]\d*)?(?:[eE][+-]?\d+)?)\s*(.*)")
_HINTS = Hints("LabChart", sparse=True)
_NEAR = 0.05


def lay_out(source: Source, written: Written) -> Layout | None:
    """The layout of an export, ``None`` where the text is none.

    Raises
    ------
    LogError
        When the names of the channels are missing, blocks hold different channels, or the rows
        have other cells or other times than is said of them.
    """
    if not source.data.lstrip().startswith(_FIRST.encode()):
        return None
    lines = source.lines()
    blocks = _blocks(lines)
    keys, first = blocks[0][0], blocks[0][2]
    if "ChannelTitle" not in keys or first >= len(lines):
        raise _refusal(
            source.name, "LabChart text without 'ChannelTitle=', or without samples.",
            "Expected the titles of the channels, and rows of numbers below them.",
        )  # fmt: skip
    names, units = keys["ChannelTitle"], _units(keys)
    for other, begin, _ in blocks[1:]:
        if (other.get("ChannelTitle"), _units(other)) != (names, units):
            raise _refusal(
                f"{source.name}, line {begin + 1}", "a block with other channels or other units.",
                f"Expected {', '.join(names)}.", f"Cut the file above line {begin + 1}.",
            )  # fmt: skip
    heads = {k for _, begin, end in blocks for k in range(begin, end)}
    body = [_without_comment(s) for k, s in enumerate(lines) if k not in heads and s.strip()]
    before = max((s.count("\t") + 1 for s in body[:SAMPLE]), default=0) - len(names)
    if before not in (0, 1, 2):
        raise _refusal(
            f"{source.name}, line {first + 1}",
            f"{count_of(before + len(names), 'cell')} where {count_of(len(names), 'channel')} and "
            "at most a time and a date were expected.",
            "Expected one cell per channel.",
        )  # fmt: skip
    cut = Cut(
        "\t", written.decimal or decimal_of("".join(body[:SAMPLE]), "\t"), before + len(names)
    )
    cut = replace(cut, tidy=_without_comment, thousands=written.thousands or "")
    rows = [row for s in body[:SAMPLE] if len(row := cut.split(s)) == cut.width]
    clocks = find_clocks(rows) if before else {}
    if before and not clocks:
        _require_interval([row[0] for row in rows], keys, cut, source.name)
    return Layout(
        **vars(cut),
        first_row=first,
        hints=_HINTS,
        header_row=lines.index(next(s for s in lines if s.startswith("ChannelTitle="))),
        headers=[*(["time", "date"][:before] if before else ["time"]), *names],
        units=[*(["s", ""][:before] if before else ["s"]), *units],
        clocks=clocks,
        groups=() if before else (_counted(blocks, len(names), source.name),),
        skipped={k + 1: "header of a block" for k in heads if k >= first and lines[k].strip()},
        notices=(*_commented(lines, heads, source.name),),
    )


def _refusal(
    where: str, what: str, expected: str, remedy: str = "Export the recording again."
) -> LogError:
    return LogError(what, where=where, expected=expected, remedy=remedy)


def _blocks(lines: Sequence[str]) -> list[tuple[dict[str, list[str]], int, int]]:
    """Return the description of every block, the index of its first line and of its first row."""
    out, end = [], 0
    for begin, line in enumerate(lines):
        if begin < end or not line.startswith(_FIRST):
            continue
        keys, end = {}, begin
        while end < len(lines) and ((found := _KEY.match(lines[end])) or not lines[end].strip()):
            if found:
                keys[found[1]] = [cell.strip() for cell in lines[end].rstrip("\t").split("\t")[1:]]
            end += 1
        out.append((keys, begin, end))
    return out


def _units(keys: Mapping[str, Sequence[str]]) -> list[str]:
    """Units of the channels: those that are named, or those of their ranges."""
    count = len(keys.get("ChannelTitle", ()))
    ranges = [found[2] if (found := _SIZE.fullmatch(c)) else c for c in keys.get("Range", ())]
    named = next((keys[key] for key in ("UnitName", "Units", "Unit") if key in keys), ranges)
    return ["" if unit in ("*", "-") else unit for unit in [*named, *[""] * count][:count]]


def _without_comment(line: str) -> str:
    found = _COMMENT.search(line)
    return line[: found.start()] if found else line


def _commented(lines: Sequence[str], heads: set[int], name: str) -> list[Notice]:
    """Say which comments beside the samples were not read."""
    places = [k for k, line in enumerate(lines) if k not in heads and _COMMENT.search(line)]
    if not places:
        return []
    texts = ", ".join(f"'{lines[k].partition(chr(9) + '#')[2].strip()[:30]}'" for k in places[:3])
    text = f"{name}: {count_of(len(places), 'comment')} beside samples left out "
    return [Notice("comments-left-out", f"{text}({name_lines([k + 1 for k in places])}: {texts}).")]


def _interval(keys: Mapping[str, Sequence[str]], name: str) -> float:
    """Time between two samples [s]."""
    text = next(iter(keys.get("Interval", ())), "")
    found = _SIZE.fullmatch(text)
    unit = found[2].strip() if found else ""
    if found is None or not same_dimension(unit, "s") or float(found[1].replace(",", ".")) <= 0:
        raise _refusal(
            name, f"'Interval=' is '{text[:40]}'.", "Expected a time above zero, such as 0.001 s.",
            "Correct it, or give --skip-rows with the lines above the samples.",
        )  # fmt: skip
    return float(found[1].replace(",", ".")) * conversion_factor(unit, "s")


def _counted(
    blocks: Sequence[tuple[dict[str, list[str]], int, int]], channels: int, name: str
) -> Group:
    """Instants of samples that were exported without a time."""
    steps = [Counted(first + 1, 0.0, _interval(keys, name)) for keys, _, first in blocks]
    return Group(tuple(range(channels)), None, tuple(steps))


def _require_interval(
    cells: Sequence[str], keys: Mapping[str, Sequence[str]], cut: Cut, name: str
) -> None:
    """Refuse times that are not the stated interval apart: they may not be seconds."""
    texts = [text for text in cells if NUMBER[cut.decimal].match(text)]
    times = [to_number(text) for text in texts]
    steps = sorted(b - a for a, b in pairwise(times) if b > a)
    coarse = any(a == b for a, b in pairwise(times))  # printed with few decimals
    if not steps or coarse or "Interval" not in keys:
        return
    usual, stated = steps[len(steps) // 2], _interval(keys, name)
    if abs(usual - stated) > _NEAR * stated:
        raise _refusal(
            name, f"times {usual:g} apart, where 'Interval=' says {stated:g} s.",
            "Expected times in seconds.",
            "Export the times in seconds, or give --skip-rows with the lines above the samples and "
            "--unit time=UNIT.",
        )  # fmt: skip
