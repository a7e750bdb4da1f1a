"""Options of the hydraulic motor."""

from __future__ import annotations

from dataclasses import dataclass

from ...family import FamilyOptions
from ...options import choice, settled


@dataclass(frozen=True)
class MotorOptions(FamilyOptions):
    """What is estimated beside the curve and the lag, and what the fit settles."""

    dead_time: str = choice("estimate", ("estimate", "none"), "whether to estimate a dead time")
    residual_limit: float | None = settled(
        "float", "residual of the speed beyond which a sample counts less", minimum=0.0
    )
