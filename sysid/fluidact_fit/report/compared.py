"""Picture of parameter files beside each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..comparison import Comparison, ParameterComparison
from . import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST = 40  # parameters that fit in a picture
_REACH = 1.96  # standard errors on either side of a 95 % interval
_COLOURS = (style.SIMULATED, style.POINTS, style.INPUT, "#CC79A7", "#E69F00")


def plot_comparison(comparison: Comparison) -> Figure | None:
    """Differences from the first file in per cent of it, with 95 % intervals.

    ``None`` where no parameter was estimated in two files, or where there are too many.
    """
    from matplotlib.figure import Figure

    shown = [p for p in comparison.parameters if p.values[0] and any(p.deviations)]
    if not 0 < len(shown) <= _MOST:
        return None
    others = comparison.files[1:]
    with style.load_matplotlib().rc_context(style.SETTINGS):
        figure = Figure(figsize=(8.0, 1.3 + 0.32 * len(shown)), layout="constrained")
        axes = figure.subplots()
        for row, p in enumerate(shown):
            half = _reach(p, 0)
            axes.barh(row, 2.0 * half, left=-half, height=0.62, color=style.BAND, alpha=0.35,
                      linewidth=0, label=comparison.files[0] if row == 0 else None)  # fmt: skip
        for k, name in enumerate(others, start=1):
            colour, labelled = _COLOURS[(k - 1) % len(_COLOURS)], False
            for row, p in enumerate(shown):
                value, first = p.values[k], p.values[0]
                if value is None or first is None or p.statuses[k] == "not_identified":
                    continue
                place = row + 0.36 * (k / (len(others) + 1) - 0.5)
                axes.errorbar(100.0 * (value - first) / abs(first), place, xerr=_reach(p, k),
                              fmt="o", color=colour, markersize=4.5, capsize=2.5, linewidth=1.2,
                              label=None if labelled else name)  # fmt: skip
                labelled = True
        axes.axvline(0.0, color=style.INK, linewidth=0.8)
        axes.set_yticks(range(len(shown)), [p.name for p in shown], fontsize=style.NORMAL)
        axes.invert_yaxis()
        words = f"difference from {comparison.files[0]} [% of its value]"
        axes.set_xlabel(words, color=style.FAINT, parse_math=False)
        style.dress(axes)
        style.legend(axes, columns=3)
    return figure


def _reach(p: ParameterComparison, k: int) -> float:
    """Half of the interval of a file, in per cent of the value of the first."""
    return 100.0 * _REACH * (p.std_errors[k] or 0.0) / abs(p.values[0] or 1.0)
