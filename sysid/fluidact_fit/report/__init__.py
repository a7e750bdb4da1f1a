"""Figures and the HTML page: the only place that imports matplotlib."""

from __future__ import annotations

from .figure import plot_result, plot_validation
from .page import document_page, result_page, write_document_html, write_html
from .response import plot_response
from .save import render, save_figure

__all__ = [
    "document_page",
    "plot_response",
    "plot_result",
    "plot_validation",
    "render",
    "result_page",
    "save_figure",
    "write_document_html",
    "write_html",
]
