"""Figures as files: the same figure gives the same bytes."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files import check_suffix
from ..parameters import write_atomically
from .style import load_matplotlib

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "ModDate": None, "Producer": None, "Creator": None},
    "svg": {"Date": None, "Creator": None},
}


def render(figure: Figure, kind: str) -> bytes:
    """The figure as png, pdf or svg, without a date."""
    buffer = io.BytesIO()
    fixed = {"svg.hashsalt": "fluidact-fit", "svg.fonttype": "path", "pdf.fonttype": 42}
    with load_matplotlib().rc_context(fixed):
        figure.savefig(buffer, format=kind, dpi=130, metadata=_METADATA[kind])
    return buffer.getvalue()


def save_figure(figure: Figure, path: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
    """Write a figure, whole or not at all.

    Parameters
    ----------
    figure
        For example of :func:`.plot_result`.
    path
        Ends with ``.png``, ``.pdf`` or ``.svg``.
    overwrite
        Whether an existing file may be replaced.

    Raises
    ------
    UsageError
        When the suffix is another.
    OutputError
        When the file exists and may not be replaced, or cannot be written.
    """
    check_suffix(os.fspath(path), path, [f".{kind}" for kind in _METADATA])
    kind = Path(path).suffix.lower().removeprefix(".")
    return write_atomically(path, render(figure, kind), overwrite=overwrite)
