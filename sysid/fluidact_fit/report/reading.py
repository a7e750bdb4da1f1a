"""Readable content of a figure: its panels, their scales and their lines."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from .html import Panel, Picture
from .save import render

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LABEL = re.compile(r"(.*?)(?: \[(.*)\])?", re.DOTALL)


def picture(figure: Figure, title: str, words: str) -> Picture:
    """A figure for a page, with its panels and lines as a script finds them in the SVG."""
    lines = [_name_lines(axes, f"panel{k}") for k, axes in enumerate(figure.axes)]
    svg = render(figure, "svg")  # first: it may move the axes
    panels = [_panel(a, named) for a, named in zip(figure.axes, lines) if a.axison]
    return Picture(title, words, svg, panels)


def _name_lines(axes: Axes, panel: str) -> list[tuple[str, str]]:
    """Give every line that has one height at each x an id; return ids and names.

    A line without a name is that of the vertical axis where it is the only one.
    """
    named, plain = [], []
    for k, line in enumerate(axes.lines):
        x = np.asarray(line.get_xdata(), dtype=float)
        drawn = line.get_linestyle() != "None" and line.get_linewidth() > 0.0
        if line.get_transform() != axes.transData or not drawn or np.any(np.diff(x) < 0.0):
            continue
        line.set_gid(f"{panel}-line{k}")
        label = str(line.get_label())
        if label.startswith("_"):
            plain.append((f"{panel}-line{k}", _label(axes.get_ylabel())[0]))
        else:
            named.append((f"{panel}-line{k}", label))
    return named or (plain if len(plain) == 1 else [])


def _panel(axes: Axes, lines: list[tuple[str, str]]) -> Panel:
    place = axes.get_position()
    box = place.x0, 1.0 - place.y1, place.x1, 1.0 - place.y0
    left, top, right, bottom = (round(float(edge), 5) for edge in box)
    x, y = axes.get_xlim(), axes.get_ylim()
    return Panel((left, top, right, bottom), x, y, _label(axes.get_xlabel()),
                 _label(axes.get_ylabel()), lines)  # fmt: skip


def _label(text: str) -> tuple[str, str]:
    """Name and unit of an axis."""
    found = _LABEL.fullmatch(text)
    return (found[1], found[2] or "") if found else (text, "")
