"""How far a finished fit can be trusted: what the residuals show, and the verdict."""

from __future__ import annotations

from .examination import Examined, examine
from .influence import Outlier, most_outliers, outlier_notice, set_aside
from .verdict import judge, residual_whiteness

__all__ = [
    "Examined",
    "Outlier",
    "examine",
    "judge",
    "most_outliers",
    "outlier_notice",
    "residual_whiteness",
    "set_aside",
]
