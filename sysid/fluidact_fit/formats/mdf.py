"""MDF files of measurement systems: channels over the time of their group."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..errors import LogError
from .sink import KEPT, Sink, library

_TIME = 1  # a master that counts seconds; others count angles, lengths or samples


def read(path: str, sink: Sink) -> None:
    """Hand over the channels of an MDF file."""
    asammdf = library("asammdf", "mdf")
    sink.dialect = "MDF"
    with asammdf.MDF(path) as file:
        for index, group in enumerate(file.groups):
            _take_group(file, sink, index, group)


def _take_group(file: Any, sink: Sink, index: int, group: Any) -> None:
    """The channels of one group, over its instants."""
    master = file.masters_db.get(index)
    stated = int(group.channel_group.cycles_nr)
    label = _label(group, index)
    channels = [k for k in range(len(group.channels)) if k != master]
    if not stated:
        for k in channels:
            sink.leave(group.channels[k].name, "no samples", group=label, signal=False)
        return
    if stated * 8 > sink.left:
        raise sink.too_large(label, stated)
    instants = None
    for channel, signal in _signals(file, index, group, channels):
        name = channel.name
        values, invalid = signal.samples, signal.invalidation_bits
        if values.shape[:1] != (stated,):
            raise LogError(
                f"channel '{name}' has {len(values)} samples where {stated} are stated.",
                remedy="Export the recording again: it may be cut.",
            )
        if values.dtype.names or values.ndim != 1:
            sink.leave(name, "an array or structure", group=label)
            continue
        if not sink.holds_numbers(name, values, label):
            continue
        timed = master is not None and _is_time(group.channels[master])
        if instants is None and timed:
            times = np.asarray(signal.timestamps, dtype=np.float64)
            instants = sink.add("time", times, unit="s", role="instants")
        bad: dict[int, str] = {}
        how = ""
        if invalid is not None and np.any(invalid):
            marked = np.asarray(invalid, dtype=np.bool_)
            values = values.astype(np.float64)
            values[marked] = np.nan
            bad = {int(k): "marked invalid" for k in np.flatnonzero(marked)[:KEPT]}
            how = f"{int(marked.sum())} samples marked as invalid"
        unit = str(signal.unit or "").strip() or None
        sink.add(name, values, group=label, unit=unit, instants=instants, bad=bad, how=how)
    if master is not None and instants is None and not _is_time(group.channels[master]):
        sink.leave(group.channels[master].name, "a base that is no time", group=label)


def _signals(file: Any, index: int, group: Any, channels: list[int]) -> Iterator[tuple[Any, Any]]:
    """Channels with their samples, which are kept although some are marked invalid.

    Samples that stand for words are read as numbers.
    """
    for k in channels:
        given = {"group": index, "index": k, "ignore_invalidation_bits": True}
        signal = file.get(**given)
        if signal.samples.dtype.kind in "SUO" and signal.samples.ndim == 1:
            plain = file.get(**given, raw=True)
            if plain.samples.dtype.kind in "fiu" and plain.samples.ndim == 1:
                signal = plain
        yield group.channels[k], signal


def _is_time(master: Any) -> bool:
    """Return whether a master channel counts seconds; before MDF 4 all do."""
    return getattr(master, "sync_type", _TIME) in (0, _TIME)


def _label(group: Any, index: int) -> str:
    name = getattr(group.channel_group, "acq_name", "") or ""
    return str(name).strip() or f"group{index + 1}"
