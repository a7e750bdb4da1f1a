"""CSV of oscilloscopes that write settings among the samples: Rigol and older Tektronix.

Rigol: ``X,CH1,CH2,Start,Increment`` names the columns, ``Sequence,Volt,Volt,-3e-3,1e-5`` has their
units and, in seconds, the first instant and the step of numbered samples. Tektronix (TDS, TPS): the
first lines hold a setting in their first two cells (``Record Length,2.5e+03``, ``Source,CH1``,
``Vertical Units,V``, ``Horizontal Units,s``), and every line an instant and a value in its fourth
and fifth one.
"""

from __future__ import annotations

from ..errors import LogError
from .layout import Counted, Group, Hints, Layout, number_of, split_cells
from .source import Source

_RIGOL = Hints("Rigol oscilloscope", sparse=True)
_TEKTRONIX = Hints("Tektronix oscilloscope")
_SETTINGS = 20  # lines that can hold one
_LEAD = 3  # cells before the instant


def lay_out(source: Source) -> Layout | None:
    """The layout of an export, ``None`` where the text is none.

    Raises
    ------
    LogError
        When start or step are no numbers.
    """
    lines = source.data[: 1 << 16].decode(errors="replace").split("\n")[:_SETTINGS]
    rows = [split_cells(line, ",") for line in lines]
    if lines[0].startswith("Record Length,") and len(rows[0]) >= _LEAD + 2 and not rows[0][2]:
        return _lay_out_settings(rows)
    if len(rows) > 1 and rows[0][0] == "X" and rows[1][0] == "Sequence":
        return _lay_out_numbered(rows[0], rows[1], source.name)
    return None


def _lay_out_settings(rows: list[list[str]]) -> Layout:
    """The layout of an export with settings beside its first samples."""
    settings = {row[0]: row[1] for row in rows if len(row) > 1}
    return Layout(
        delimiter=",",
        decimal=".",
        width=2,
        lead=_LEAD,
        trailing=len(rows[0]) > _LEAD + 2,
        first_row=0,
        hints=_TEKTRONIX,
        headers=["time", settings.get("Source", "")],
        units=[settings.get("Horizontal Units", ""), settings.get("Vertical Units", "")],
    )


def _lay_out_numbered(names: list[str], units: list[str], name: str) -> Layout | None:
    """The layout of numbered samples, ``None`` where start and step have no names."""
    where = {name: k for k, name in enumerate(names)}
    if not {"Start", "Increment"} <= where.keys() or where["Start"] < 2:
        return None
    said = [units[where[k]] if where[k] < len(units) else "" for k in ("Start", "Increment")]
    start, step = map(number_of, said)
    if start is None or step is None or step <= 0.0:
        raise LogError(
            f"start '{said[0][:40]}' and step '{said[1][:40]}' of the samples are no instants.",
            where=f"{name}, line 2",
            expected="Expected two numbers in seconds, the step above zero.",
            remedy="Export it again, or give --skip-rows 2 and --sample-time SECONDS.",
        )
    width = where["Start"]
    return Layout(
        delimiter=",",
        decimal=".",
        width=width,
        first_row=2,
        hints=_RIGOL,
        header_row=0,
        units_row=1,
        headers=["time", *names[1:width]],
        units=["s", *units[1:width]],
        groups=(Group(tuple(range(1, width)), None, (Counted(3, start, step),)),),
    )
