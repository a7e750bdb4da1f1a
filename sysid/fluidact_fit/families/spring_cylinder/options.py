"""Options of the family, and what the fit settles."""

from __future__ import annotations

from dataclasses import dataclass

from ...estimation.stribeck import stribeck_choice
from ...options import FamilyOptions, choice, number, settled


@dataclass(frozen=True)
class SpringOptions(FamilyOptions):
    """Levels of friction, motion state, and which samples are described."""

    levels: str = choice(
        "auto",
        ("auto", "equal", "free"),
        "friction levels: equal, free (needs --fix preload=...), or auto: free where a constant "
        "is fixed",
    )
    stribeck: str = stribeck_choice()
    motion_state: str = choice(
        "auto",
        ("auto", "direction", "command", "position"),
        "source of the motion state (loading or unloading): a direction column, the command or "
        "pressure, or the position (where a test machine moves the rod); auto takes the column if "
        "there is one, and the position where command or pressure never change within a log",
    )
    dead_band: float | None = number(
        help="change that reverses the motion state, in SI (default: from the noise)", minimum=0
    )
    settle: float = number(
        0.05,
        help="share of the range of command or pressure (of the position, if that gives the "
        "motion state) that is left out after a reversal, while the seal still creeps",
        minimum=0,
    )
    spike: float | None = settled(
        "float", "distance from the model beyond which a sample is a spike", unit="N"
    )
