"""CSV recordings of dSPACE ControlDesk.

A block of ``descriptions,GROUP,KEY,VALUE`` lines, then one line per attribute of the signals,
keyed in its first cell (``trace_names``, ``trace_units``, ``path``, ``min``, ...), and the samples
from ``trace_values,TIME,VALUE,...`` on, where they begin on that very line; below it the first
cell is empty. The second cell is the time in seconds. Signals of another raster have holes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from ..errors import LogError
from .layout import Hints, Layout, split_cells
from .source import Source

_VALUES = b"trace_values,"
_HEAD = 1 << 22  # bytes in which the values have to begin
_HINTS = Hints("dSPACE ControlDesk", sparse=True)


def lay_out(source: Source) -> Layout | None:
    """The layout of a recording, ``None`` where the text is none.

    Raises
    ------
    LogError
        When the names of the signals are missing.
    """
    begin = source.data.find(b"\n" + _VALUES, 0, _HEAD) + 1
    if not begin:
        return None
    lines = source.data[:begin].decode(errors="replace").split("\n")
    rows = {key: k for k, line in enumerate(lines) if (key := line.partition(",")[0])}
    if "trace_names" not in rows:
        raise LogError(
            "a ControlDesk recording without a line 'trace_names'.",
            where=source.name,
            expected="Expected the names of the signals above 'trace_values'.",
            remedy="Export the recording again, with its header.",
        )
    names = _cells(lines[rows["trace_names"]])
    width = len(names)
    paths = _cells(lines[rows["path"]]) if "path" in rows else []
    units_row = rows.get("trace_units")
    units = [""] * width if units_row is None else _cells(lines[units_row])
    units = (units + [""] * width)[:width]
    return Layout(
        delimiter=",",
        decimal=".",
        width=width,
        lead=1,
        first_row=len(lines) - 1,
        hints=_HINTS,
        header_row=rows["trace_names"],
        units_row=units_row,
        headers=["time", *_told_apart(names, paths)[1:]],
        units=["s", *units[1:]],
    )


def _cells(line: str) -> list[str]:
    """Cells of an attribute, the key left out."""
    return split_cells(line, ",")[1:]


def _told_apart(names: Sequence[str], paths: Sequence[str]) -> list[str]:
    """Names, those that repeat with as much of their path as tells them apart.

    Simulink calls many a signal ``In1``.
    """
    counts = Counter(names)
    out = []
    for k, name in enumerate(names):
        steps = [s for s in paths[k].split("/") if s] if k < len(paths) else []
        if counts[name] > 1 and steps:
            name = _shortest([p for i, p in enumerate(paths) if names[i] == name], steps)
        out.append(name)
    return out


def _shortest(paths: Sequence[str], steps: Sequence[str]) -> str:
    """The last steps of a path that no other path ends with."""
    for count in range(2, len(steps) + 1):
        tail = "/".join(steps[-count:])
        if sum(path.endswith(tail) for path in paths) == 1:
            return tail
    return "/".join(steps)
