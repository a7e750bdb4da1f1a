"""TDMS files of LabVIEW: every channel at its own instants."""

from __future__ import annotations

import math
import os
import struct
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ..errors import LogError
from .sink import Array, Sink, library, seconds_of

_OPEN = (1 << 64) - 1  # how long a segment is whose writing was never ended
_UNSET = np.datetime64("1904-01-02")  # clocks that were not set begin with 1904
_TO_1970 = 2_082_844_800  # s from 1904
_LEAD = struct.Struct("<4sIIQQ")


def read(path: str, sink: Sink) -> None:
    """Hand over the channels of a TDMS file."""
    nptdms = library("nptdms", "tdms")
    sink.dialect = "TDMS"
    cut = _cut(path)
    with open(path, "rb") as raw, nptdms.TdmsFile.open(raw, raw_timestamps=True) as file:
        channels = [(g.name, c) for g in file.groups() for c in g.channels()]
        starts = {id(c): _start(c) for _, c in channels}
        first = _first(starts.values())
        several = len({s for s in starts.values() if s is not None}) > 1
        short = []
        bases: dict[tuple[float, float, int], int] = {}
        for group, channel in channels:
            stated = channel.properties.get("wf_samples")
            if cut and isinstance(stated, int) and 0 <= len(channel) < stated:
                short.append(f"'{channel.name}' {len(channel)} of {stated} samples")
            after = _after(first, starts[id(channel)], channel)
            if after is not None and several and starts[id(channel)] is None:
                why = "it does not say when it began, and others began at different instants"
                sink.leave(str(channel.name), why, group=group)
                continue
            since = 0 if first is None else int(first.astype(np.int64))
            _take(sink, group, channel, bases, after, since)
    if cut:
        told = f" ({', '.join(short[:6])})" if short else ""
        sink.notice("recording-cut", f"{cut}{told}; what precedes it was read")


def _take(
    sink: Sink,
    group: str,
    channel: Any,
    bases: dict[tuple[float, float, int], int],
    after: float | None,
    since: int,
) -> None:
    """One channel; ``after`` is its start [s] behind the earliest, where it has instants."""
    name, size = str(channel.name), len(channel)
    unit = str(channel.properties.get("unit_string") or "").strip() or None
    if size == 0:
        sink.leave(name, "no samples", group=group, signal=False)
        return
    if size * 8 > sink.left:
        raise sink.too_large(name, size)
    values: Any = channel[:]
    if len(values) != size:
        raise LogError(
            f"channel '{name}' has {len(values)} samples where {size} are stated.",
            remedy="Export the recording again.",
        )
    if hasattr(values, "as_datetime64"):
        seconds, since, bad = seconds_of(_instants(values["seconds"], values["second_fractions"]))
        how = "instants to seconds since the first"
        sink.add(name, seconds, group=group, unit="s", bad=bad, clock=True, since=since, how=how)
        return
    values = np.asarray(values)
    if not sink.holds_numbers(name, values, group):
        return
    step = channel.properties.get("wf_increment")
    instants = None
    if after is not None:
        key = (after, float(step), size)
        if key not in bases:
            times = evenly(after, float(step), size)
            bases[key] = sink.add("time", times, unit="s", since=since, role="instants")
        instants = bases[key]
    sink.add(name, values, group=group, unit=unit, instants=instants)


def evenly(first: float, step: float, size: int) -> Array:
    """Instants, rounded so that those of channels that began later are the same numbers."""
    times = first + step * np.arange(size)
    largest = max(abs(float(times[0])), abs(float(times[-1])), 1.0)
    return np.round(times, min(12, 14 - math.ceil(math.log10(largest))))


def _instants(seconds: Any, fractions: Any) -> Array:
    """Instants of seconds since 1904 and 2^-64 of one, shape ``(n,)``, to the nearest ns."""
    parts = np.rint(np.asarray(fractions, dtype=np.float64) * (1e9 / 2.0**64)).astype(np.int64)
    whole = (np.asarray(seconds, dtype=np.int64) - _TO_1970) * 1_000_000_000 + parts
    return np.asarray(whole.view("M8[ns]"))


def _start(channel: Any) -> Any:
    """The instant at which a channel begins; ``None`` where that was not recorded."""
    start = channel.properties.get("wf_start_time")
    if start is None:
        return None
    if hasattr(start, "second_fractions"):
        start = _instants(np.array([start.seconds]), np.array([start.second_fractions]))[0]
    start = np.datetime64(start, "ns")
    return None if np.isnat(start) or start < _UNSET else start


def _first(starts: Any) -> Any:
    known = [s for s in starts if s is not None]
    return min(known) if known else None


def _after(first: Any, start: Any, channel: Any) -> float | None:
    """Start of a channel after the earliest of all [s]; ``None`` without even instants."""
    properties: Mapping[str, Any] = channel.properties
    step, offset = properties.get("wf_increment"), properties.get("wf_start_offset", 0.0)
    if step is None:
        return None
    if not (math.isfinite(step) and step > 0.0 and math.isfinite(offset)):
        return None
    since = 0.0
    if start is not None and first is not None:
        since = int((start - first).astype(np.int64)) / 1e9
    return since + float(offset)


def _cut(path: str) -> str:
    """Remark on a file that ends before its last segment does; empty for a whole one."""
    size = os.path.getsize(path)
    with open(path, "rb") as file:
        for place, lead in _leads(file, size):
            if lead is None:
                return f"the file ends within the head of a segment, at byte {place}"
            ends = place + _LEAD.size + lead
            if lead == _OPEN:
                return f"the segment at byte {place} was never finished"
            if ends > size:
                return f"the file is cut: its last segment misses {ends - size} bytes"
    return ""


def _leads(file: Any, size: int) -> Iterator[tuple[int, int | None]]:
    """Places of the segments, and how many bytes follow the head of each."""
    place = 0
    while place < size:
        file.seek(place)
        head = file.read(_LEAD.size)
        if len(head) < _LEAD.size:
            yield place, None
            return
        tag, toc, _, following, _ = _LEAD.unpack(head)
        if toc & 0x40:  # big endian, all but the table of contents
            following = int.from_bytes(head[12:20], "big")
        if tag != b"TDSm":
            raise LogError(
                f"there is no segment at byte {place}.", remedy="Export the recording again."
            )
        yield place, following
        place += _LEAD.size + following
