"""Figures and the HTML page: the only place that imports matplotlib."""

from __future__ import annotations

from .figure import plot_result, plot_validation
from .inspection import inspection_page, plot_channels, plot_views
from .page import document_page, result_page, write_document_html, write_html
from .response import plot_response
from .save import render, save_figure

__all__ = [
    "document_page",
    "inspection_page",
    "plot_channels",
    "plot_response",
    "plot_result",
    "plot_validation",
    "plot_views",
    "render",
    "result_page",
    "save_figure",
    "write_document_html",
    "write_html",
]
