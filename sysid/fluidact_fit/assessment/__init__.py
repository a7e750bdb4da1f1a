"""How far a finished fit can be trusted: what the residuals show, and the verdict."""

from __future__ import annotations

from .examination import Examined, examine
from .influence import Outlier, most_outliers, outlier_notice, set_aside
from .refusal_causes import Cause, find_cause, leads, moves_against
from .verdict import judge, residual_whiteness

__all__ = [
    "Cause",
    "Examined",
    "Outlier",
    "examine",
    "find_cause",
    "judge",
    "leads",
    "most_outliers",
    "moves_against",
    "outlier_notice",
    "residual_whiteness",
    "set_aside",
]
