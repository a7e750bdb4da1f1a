"""Colours and style of every panel. Colours are those of Okabe and Ito."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from types import ModuleType

    from matplotlib.axes import Axes

MEASURED = "#8E979E"
SPARSE = "#3F484E"
SIMULATED = "#D55E00"
INPUT = "#0072B2"
RESIDUAL = "#0072B2"
BAND = "#56B4E9"
LEFT_OUT = "#B0B0B0"
REPLACED = "#B3261E"  # a sample that was recorded and replaced
POINTS = "#009E73"
INK = "#22262A"
FAINT = "#6B7278"
_FRAME = "#9AA0A6"
VERDICT = {"pass": "#007A5A", "warn": "#9A6700", "fail": "#B3261E"}

SMALL, NORMAL, LARGE = 8.0, 9.0, 15.0
_PANEL = 125  # small characters that fit across a panel of a static map

# What a user's own style must not change: a report looks the same everywhere.
SETTINGS: dict[str, Any] = {
    "text.usetex": False,
    "font.family": ["sans-serif"],
    "font.sans-serif": ["DejaVu Sans"],
    "axes.unicode_minus": True,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 5),
    "axes.facecolor": "white",
    "figure.facecolor": "white",
    "savefig.facecolor": "auto",
    "agg.path.chunksize": 20_000,
}


def load_matplotlib() -> ModuleType:
    """Import matplotlib, which refuses to be where the environment asks for an unknown backend.

    Figures here need none; a known one is left to what else draws in this process.
    """
    asked = None if "matplotlib" in sys.modules else os.environ.pop("MPLBACKEND", None)
    try:
        import matplotlib
    finally:
        if asked is not None:
            os.environ["MPLBACKEND"] = asked
    if asked:
        with suppress(ValueError):
            matplotlib.rcParams["backend"] = asked
    return matplotlib


def dress(axes: Axes, title: str = "") -> None:
    """Thin frame on two sides, faint grid, small labels; the title at the upper left."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set(color=_FRAME, linewidth=0.8)
    axes.tick_params(which="both", labelsize=SMALL, colors=INK, color=_FRAME, width=0.8, length=3)
    for axis in (axes.xaxis, axes.yaxis):
        axis.label.set(fontsize=NORMAL, color=INK)
    axes.grid(True, color="#E6E8EA", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.set_title(title, loc="left", fontsize=NORMAL, color=INK, pad=5, parse_math=False)


def band(axes: Axes, half: float, alpha: float, label: str | None = None) -> None:
    """The zero line with a band on both sides of it."""
    axes.axhspan(-half, half, color=BAND, alpha=alpha, lw=0, label=label)
    axes.axhline(0.0, color=FAINT, linewidth=0.7)


def legend(axes: Axes, *others: Axes, columns: int = 4) -> None:
    """Legend above a panel at the right, where no curve can pass under it.

    Entries of ``others`` come first; as many columns, up to ``columns``, as the panel is wide
    enough for.
    """
    found = [a.get_legend_handles_labels() for a in (*others, axes)]
    handles, labels = (list(chain.from_iterable(part)) for part in zip(*found))
    axes.legend(
        handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), fontsize=SMALL,
        ncols=_fitting_columns(labels, columns), frameon=False, borderaxespad=0.1,
        handlelength=1.6, columnspacing=1.2,
    )  # fmt: skip


def _fitting_columns(labels: Sequence[str], most: int) -> int:
    """Columns whose longest entries stay within a panel, filled column by column."""
    for columns in range(min(most, max(len(labels), 1)), 1, -1):
        short, longer = divmod(len(labels), columns)  # the first columns hold one more
        ends = np.cumsum([short + (k < longer) for k in range(columns)])
        longest = [max(map(len, labels[a:b])) for a, b in zip([0, *ends], ends)]
        if sum(longest) + 7 * columns <= _PANEL:
            return columns
    return 1
