"""CSV of older Tektronix oscilloscopes (TDS, TPS): settings beside the first samples.

The first lines hold a setting in their first two cells (``Record Length,2.5e+03``, ``Source,CH1``,
``Vertical Units,V``, ``Horizontal Units,s``), and every line an instant and a value in its fourth
and fifth one.
"""

from __future__ import annotations

from .layout import Hints, Layout, split_cells
from .source import Source

_HINTS = Hints("Tektronix oscilloscope")
_SETTINGS = 20  # lines that can hold one
_LEAD = 3  # cells before the instant


def lay_out(source: Source) -> Layout | None:
    """The layout of an export, ``None`` where the text is none."""
    lines = source.data[: 1 << 13].decode(errors="replace").split("\n")[:_SETTINGS]
    if not lines[0].startswith("Record Length,"):
        return None
    rows = [split_cells(line, ",") for line in lines]
    if len(rows[0]) < _LEAD + 2 or rows[0][2]:
        return None
    settings = {row[0]: row[1] for row in rows if len(row) > 1}
    return Layout(
        delimiter=",",
        decimal=".",
        width=2,
        lead=_LEAD,
        trailing=len(rows[0]) > _LEAD + 2,
        first_row=0,
        hints=_HINTS,
        header_row=None,
        units_row=None,
        headers=["time", settings.get("Source", "")],
        units=[settings.get("Horizontal Units", ""), settings.get("Vertical Units", "")],
    )
