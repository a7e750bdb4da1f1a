"""How far a finished fit can be trusted: what the residuals show, and the verdict."""

from __future__ import annotations

from .diagnosis import diagnose
from .verdict import judge, residual_whiteness

__all__ = ["diagnose", "judge", "residual_whiteness"]
