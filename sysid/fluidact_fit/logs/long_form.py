"""Channels one below the other with their names in a column of their own: refused.

As one table they would be read as runs of a single channel, or as samples at the same instant.
"""

from __future__ import annotations

import re
from collections import defaultdict

import numpy as np

from ..errors import LogError
from .log import Column, Log

_NAMES = re.compile(
    r"(?:(?:channel|kanal|canal|voie|signal|sensor|tag|trace|curve|kurve|series|variable|var|"
    r"parameter|point|item|metric)(?:_?(?:name|id))?|_?field|_?measurement|quantity|messstelle|"
    r"messgröße|通道|通道名|变量|变量名|信号)",
    re.IGNORECASE,
)
_FEWEST = 3  # rows of a channel
_MOST = 1000  # channels


def refuse_long_form(log: Log) -> None:
    """Refuse a log with a column of names of channels, each of which has a time of its own.

    Some other column then grows from row to row of every one of these names, but not from row to
    row of the log.
    """
    for column in log.columns:
        if len(column.bad) < 2 * _FEWEST or not _NAMES.fullmatch(re.sub(r"\s", "", column.header)):
            continue
        rows: dict[str, list[int]] = defaultdict(list)
        for row, text in column.bad.items():
            rows[text.strip()].append(row)
        groups = [np.array(found) for found in rows.values() if len(found) >= _FEWEST]
        if not 1 < len(groups) < _MOST:
            continue
        if any(_is_time_of_each(other, groups) for other in log.columns):
            names = ", ".join(f"'{name[:40]}'" for name in list(rows)[:3])
            raise LogError(
                f"column '{column.label}' names channels ({names}) that stand one below the other.",
                where=log.name,
                expected="Expected a column for every channel.",
                remedy="Export the channels side by side, or give each as a log of its own.",
            )


def _is_time_of_each(column: Column, groups: list[np.ndarray]) -> bool:
    """Return whether a column grows within every group of rows, but not from row to row."""
    together = column.stamps[np.sort(np.concatenate(groups))]
    if np.isnan(together).any() or bool(np.all(np.diff(together) > 0.0)):
        return False
    return all(bool(np.all(np.diff(column.stamps[rows]) > 0.0)) for rows in groups)
