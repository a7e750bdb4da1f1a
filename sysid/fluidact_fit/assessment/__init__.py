"""Assessment of a finished fit: tests of its residuals, and the verdict."""

from __future__ import annotations

from .examination import Examination, examine
from .implausible import find_implausible
from .influence import Outlier, most_outliers, outlier_notice, set_aside
from .refusal_causes import Cause, direction, find_cause, leads
from .verdict import judge, residual_whiteness

__all__ = [
    "Cause",
    "Examination",
    "Outlier",
    "direction",
    "examine",
    "find_cause",
    "find_implausible",
    "judge",
    "leads",
    "most_outliers",
    "outlier_notice",
    "residual_whiteness",
    "set_aside",
]
