"""How far a finished fit can be trusted: what the residuals show, and the verdict."""

from __future__ import annotations

from .diagnosis import diagnose
from .optimum import make_optimum
from .outliers import Outlier, find_outliers, most_outliers, outlier_notice, set_aside
from .verdict import judge, residual_whiteness

__all__ = [
    "Outlier",
    "diagnose",
    "find_outliers",
    "judge",
    "make_optimum",
    "most_outliers",
    "outlier_notice",
    "residual_whiteness",
    "set_aside",
]
