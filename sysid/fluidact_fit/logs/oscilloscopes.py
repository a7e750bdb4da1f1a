"""CSV of oscilloscopes that write settings among the samples: Rigol, Yokogawa, older Tektronix.

Rigol: ``X,CH1,CH2,Start,Increment`` names the columns, ``Sequence,Volt,Volt,-3e-3,1e-5`` has their
units and, in seconds, the first instant and the step of numbered samples. Tektronix (TDS, TPS): the
first lines hold a setting in their first two cells (``Record Length,2.5e+03``, ``Source,CH1``,
``Vertical Units,V``, ``Horizontal Units,s``), and every line an instant and a value in its fourth
and fifth one. Yokogawa (DL, DLM, SL): every line of the head has a key and one cell per trace
(``TraceName,CH1,CH2``, ``VUnit,V,V``), ``HResolution`` and ``HOffset`` the step and the first
instant of the samples in ``HUnit``.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import LogError
from ..units import conversion_factor, same_dimension
from .groups import counted_groups
from .layout import Counted, Group, Hints, Layout, number_of, split_cells
from .log import count_of
from .source import Source

_RIGOL = Hints("Rigol oscilloscope", sparse=True)
_TEKTRONIX = Hints("Tektronix oscilloscope")
_YOKOGAWA = Hints("Yokogawa oscilloscope", sparse=True)
_SETTINGS = 40  # lines that can hold one
_LEAD = 3  # cells before the instant


def lay_out(source: Source) -> Layout | None:
    """The layout of an export, ``None`` where the text is none.

    Raises
    ------
    LogError
        When no instants follow from start and step.
    """
    lines = source.data[: 1 << 16].decode(errors="replace").split("\n")[:_SETTINGS]
    rows = [split_cells(line, ",") for line in lines]
    if lines[0].startswith("Record Length,") and len(rows[0]) >= _LEAD + 2 and not rows[0][2]:
        return _lay_out_settings(rows)
    if len(rows) > 1 and rows[0][0] == "X" and rows[1][0] == "Sequence":
        return _lay_out_numbered(rows[0], rows[1], source.name)
    keys = {row[0]: k for k, row in enumerate(rows) if row[0] and number_of(row[0]) is None}
    if {"TraceName", "VUnit", "HResolution"} <= keys.keys():
        return _lay_out_traces(rows, keys, source.name)
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
    places = where["Start"], where["Increment"]
    start, step = (units[k] if k < len(units) else "" for k in places)
    counted = _count(start, step, "s", first_row=2, where=f"{name}, line 2")
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
        groups=(Group(tuple(range(1, width)), None, (counted,)),),
    )


def _lay_out_traces(rows: Sequence[list[str]], keys: dict[str, int], name: str) -> Layout | None:
    """The layout of an export with a line per setting of its traces, ``None`` without samples."""
    last = max(keys.values())
    first = next((k for k, row in enumerate(rows) if k > last and any(row)), None)
    if first is None:
        return None
    places = [k for k, cell in enumerate(rows[keys["TraceName"]]) if k and cell]

    def settings(key: str, otherwise: str = "") -> list[str]:
        row = rows[keys[key]] if key in keys else []
        return [row[k] if k < len(row) else otherwise for k in places]

    samples, blocks = rows[first], {*settings("BlockNumber", "1"), "1"} - {""}
    lead = next(k for k, cell in enumerate(samples) if cell)
    width = len(samples) - lead - (samples[-1] == "")
    if width != len(places) or len(blocks) > 1:
        raise LogError(
            f"{count_of(len(places), 'trace')} (blocks: {max(blocks)}), and rows of "
            f"{count_of(width, 'cell')}.",
            where=f"{name}, line {first + 1}",
            expected="Expected one block of samples, with one cell for every trace.",
            remedy="Export every block to a file of its own, or give --skip-rows "
            f"{first} and --sample-time SECONDS.",
        )
    told = zip(settings("HOffset", "0"), settings("HResolution"), settings("HUnit", "s"))
    where = f"{name}, line {keys['HResolution'] + 1}"
    counted = [(_count(*each, first_row=first, where=where),) for each in told]
    return Layout(
        delimiter=",",
        decimal=".",
        width=width,
        lead=lead,
        trailing=samples[-1] == "",
        first_row=first,
        hints=_YOKOGAWA,
        header_row=keys["TraceName"],
        units_row=keys["VUnit"],
        headers=["time", *settings("TraceName")],
        units=["s", *settings("VUnit")],
        groups=tuple(counted_groups(range(width), counted)),
    )


def _count(start: str, step: str, unit: str, /, *, first_row: int, where: str) -> Counted:
    """The instants of numbered samples, of which the first and the step are written once."""
    first, between = number_of(start), number_of(step)
    if first is None or between is None or between <= 0.0 or not same_dimension(unit, "s"):
        raise LogError(
            f"no times follow from start '{start[:40]}' and step '{step[:40]}' [{unit[:40]}].",
            where=where,
            expected="Expected two numbers in seconds, the step above zero.",
            remedy=f"Export it again, or give --skip-rows {first_row} and --sample-time SECONDS.",
        )
    factor = conversion_factor(unit, "s")
    return Counted(first_row + 1, factor * first, factor * between)
