"""CSV of Rigol oscilloscopes: numbered samples, their start and step written once.

``X,CH1,CH2,Start,Increment`` names the columns, ``Sequence,Volt,Volt,-3e-3,1e-5`` has their units
and, in seconds, the first instant and the step.
"""

from __future__ import annotations

from ..errors import LogError
from .layout import NUMBER, Counted, Group, Hints, Layout, split_cells, to_number
from .source import Source

_HINTS = Hints("Rigol oscilloscope", sparse=True)


def lay_out(source: Source) -> Layout | None:
    """The layout of an export, ``None`` where the text is none.

    Raises
    ------
    LogError
        When start or step are no numbers.
    """
    lines = source.data[: 1 << 16].decode(errors="replace").split("\n")[:2]
    if len(lines) < 2:
        return None
    names, units = (split_cells(line, ",") for line in lines)
    if names[0] != "X" or units[0] != "Sequence":
        return None
    where = {name: k for k, name in enumerate(names)}
    if not {"Start", "Increment"} <= where.keys() or where["Start"] < 2:
        return None
    start, step = (
        units[where[key]] if where[key] < len(units) else "" for key in ("Start", "Increment")
    )
    if not (NUMBER["."].match(start) and NUMBER["."].match(step)) or to_number(step) <= 0.0:
        raise LogError(
            f"start '{start[:40]}' and step '{step[:40]}' of the samples are no instants.",
            where=f"{source.name}, line 2",
            expected="Expected two numbers in seconds, the step above zero.",
            remedy="Export it again, or give --skip-rows 2 and --sample-time SECONDS.",
        )
    width = where["Start"]
    return Layout(
        delimiter=",",
        decimal=".",
        width=width,
        first_row=2,
        hints=_HINTS,
        header_row=0,
        units_row=1,
        headers=["time", *names[1:width]],
        units=["s", *units[1:width]],
        groups=(
            Group(tuple(range(1, width)), None, (Counted(3, to_number(start), to_number(step)),)),
        ),
    )
